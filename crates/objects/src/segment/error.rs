//! Why a cloud could not be taken apart.

use crate::render::RenderError;

/// Segmentation failed. Its text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum SegmentError {
    /// The cloud does not fit the device, or is no plain cloud.
    #[error(transparent)]
    Cloud(RenderError),
    /// A view could not be rendered.
    #[error("view {view}: {error}")]
    View {
        /// The view's name.
        view: String,
        /// What is wrong.
        error: RenderError,
    },
    /// A mask's ids do not fill its size.
    #[error("view {view}: the mask has {len} ids, not {width}x{height}")]
    Mask {
        /// The view's name.
        view: String,
        /// Its ids.
        len: usize,
        /// Its width.
        width: u32,
        /// Its height.
        height: u32,
    },
    /// An option is out of range.
    #[error("{option}: {reason}")]
    Option {
        /// The option's name.
        option: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// More objects than ids.
    #[error("{count} objects were found in the masks, and there are ids for 65535; use fewer or larger masks")]
    TooManyObjects {
        /// What was found.
        count: usize,
    },
    /// No view has a mask with an object.
    #[error("no view has a mask with an object in it; check that the masks' names are those of the images")]
    NoMasks,
    /// No box can be used.
    #[error("no box is in the world or in one of the views{}", first_of(.notes))]
    NoBoxes {
        /// Why boxes were left out.
        notes: Vec<String>,
    },
    /// Boxes overlap in more ways than there are ids.
    #[error("view {view}: its boxes overlap in more than 65535 ways; leave out those with low scores")]
    TooManyBoxes {
        /// The view's name.
        view: String,
    },
}

/// One reason says enough.
fn first_of(notes: &[String]) -> String {
    notes.first().map_or(String::new(), |note| format!(": {note}"))
}
