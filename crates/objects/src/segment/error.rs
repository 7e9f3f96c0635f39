//! Errors of segmentation.

use instgs_vk::render::RenderError;

/// Why segmentation failed. The text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum SegmentError {
    /// The cloud does not fit on the device, or has instances.
    #[error(transparent)]
    Cloud(RenderError),
    /// A view could not be rendered.
    #[error("view {view}: {error}")]
    View {
        /// Name of the view's camera.
        view: String,
        /// What the renderer reports.
        error: RenderError,
    },
    /// The number of ids in a mask is not width times height.
    #[error("view {view}: the mask has {len} ids, not {width}x{height}")]
    Mask {
        /// Name of the view's camera.
        view: String,
        /// Number of ids in the mask.
        len: usize,
        /// Width of the mask, pixels.
        width: u32,
        /// Height of the mask, pixels.
        height: u32,
    },
    /// An option is out of range.
    #[error("{option}: {reason}")]
    Option {
        /// Name of the option's field.
        option: &'static str,
        /// What is wrong with the value, and what is allowed.
        reason: String,
    },
    /// Masks show more objects than 16-bit ids can number.
    #[error("{count} objects were found in the masks, and there are ids for 65535; use fewer or larger masks")]
    TooManyObjects {
        /// Number of objects found.
        count: usize,
    },
    /// Boxes without ids show more objects than there are ids above those of the other boxes.
    #[error(
        "boxes without ids show {wanted} objects, and {free} ids are free above those that boxes have; give boxes lower ids"
    )]
    NoFreeIds {
        /// Number of objects without an id.
        wanted: usize,
        /// Number of ids above the largest in use.
        free: usize,
    },
    /// No view has a mask with an object.
    #[error("no view has a mask with an object in it; check that the masks' names are those of the images")]
    NoMasks,
    /// None of the boxes can be used.
    #[error("no box is of an object in the world or in the views{}", first_of(.notes))]
    NoBoxes {
        /// One note per box that was left out, with the reason.
        notes: Vec<String>,
    },
    /// No Gaussian of the cloud belongs to an object of the boxes.
    #[error("no Gaussian is in a box of an object{}", first_of(.notes))]
    NothingInBoxes {
        /// One note per object, with the reason.
        notes: Vec<String>,
    },
    /// Boxes overlap in more ways than there are ids.
    #[error("view {view}: its boxes overlap in more than 65535 ways; leave out those with low scores")]
    TooManyBoxes {
        /// Name of the view's camera.
        view: String,
    },
}

/// The first note, for the end of the message; the caller has the others.
fn first_of(notes: &[String]) -> String {
    notes.first().map_or(String::new(), |note| format!(": {note}"))
}
