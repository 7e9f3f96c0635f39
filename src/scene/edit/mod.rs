//! Changing what a scene shows: instances come, go, move and change colour. One implementation for the command line and
//! for interactive programs.
//!
//! Every edit is a small value, applied as a whole or not at all, so a program can undo it by keeping what was there before.
//! Most touch only instances, groups and offsets; recolouring all instances of a template touches its base colour, and
//! cropping and erasing take Gaussians out of a template, once for all of its instances.
//!
//! Offsets are copy-on-write: a duplicate shares its original's run, and an edit that changes the offsets of an instance
//! whose run others use too copies the run first. Runs that nobody uses any more are removed. Mask ids in `groups` follow
//! the instances; a new instance of a template with a group gets the next free id.

mod membership;
mod offset_runs;
mod placement;
mod recolour;
mod scatter;
mod select;
mod thin;

use glam::DVec3;

pub use placement::{instance_centres, template_centres};
pub use scatter::{Footprint, OffsetSource, Scatter, ScatterOver, footprint};
pub use select::{ParseSelectorError, Selector};
pub use thin::Keep;

use crate::math::similarity::{Similarity, SimilarityError};
use crate::scene::instanced_scene::InstancedScene;

/// A rotation about an axis, by the right-hand rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// World direction, of any length but zero.
    pub axis: DVec3,
    /// Radians.
    pub angle: f64,
}

/// One change of a scene. Edits of several instances treat each alike, about its own centre: the mean of its template's
/// means, in the world.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Appends a copy of each instance, which shares its offsets, moved by `by` and turned about its centre.
    Duplicate {
        /// The originals.
        which: Selector,
        /// World units.
        by: DVec3,
        /// `None`: as the original.
        turn: Option<Turn>,
    },
    /// Moves instances by a world vector.
    MoveBy {
        /// Which.
        which: Selector,
        /// World units.
        by: DVec3,
    },
    /// Moves one instance so that its centre is at a world position.
    MoveTo {
        /// Which one.
        which: Selector,
        /// World units.
        to: DVec3,
    },
    /// Turns instances about their centres.
    Rotate {
        /// Which.
        which: Selector,
        /// How far.
        turn: Turn,
    },
    /// Scales instances about their centres.
    Scale {
        /// Which.
        which: Selector,
        /// More than 0.
        by: f64,
    },
    /// Removes instances, and their offsets unless others share them.
    Delete {
        /// Which.
        which: Selector,
    },
    /// Shifts the base colour. A group or template as a whole is shifted in the template, which costs nothing; otherwise
    /// in offsets, which are created for instances that have none.
    Recolour {
        /// Which.
        which: Selector,
        /// Added to red, green and blue, in units of colour (1 = from black to white).
        rgb: [f32; 3],
    },
    /// Gives instances another template and leaves them where they are. Their offsets belong to the old template's
    /// Gaussians and are dropped.
    Swap {
        /// Which.
        which: Selector,
        /// The new template.
        template: u32,
    },
    /// Adds instances of a template over a plane or along a path.
    Scatter(Scatter),
    /// Takes the Gaussians out of a template whose means are outside, or inside, a box along the axes of its frame; some
    /// must stay.
    Crop {
        /// Which.
        template: u32,
        /// Lower and upper corner, template units; infinite numbers leave a side open.
        corners: [DVec3; 2],
        /// What stays.
        keep: Keep,
    },
    /// Takes the Gaussians out of a template whose means are in one of some balls of the same radius; some must stay.
    Erase {
        /// Which.
        template: u32,
        /// Of the balls, in the template's frame.
        centres: Vec<DVec3>,
        /// More than 0, template units.
        radius: f64,
    },
}

/// What an edit did.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EditOutcome {
    /// Instances that are different now; their indices after the edit.
    pub changed: Vec<usize>,
    /// New instances; their indices after the edit.
    pub added: Vec<usize>,
    /// Removed instances; their indices before the edit.
    pub removed: Vec<usize>,
    /// What the user should know, one line each.
    pub warnings: Vec<String>,
}

/// Why an edit was not done; the scene is as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{operation}: {reason}")]
pub struct EditError {
    /// The edit, as on the command line, for instance "duplicate".
    pub operation: &'static str,
    /// What is wrong, and what there is instead.
    pub reason: EditReason,
}

/// What is wrong with an edit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EditReason {
    /// A number, direction or list of the edit is not usable.
    #[error("{0}")]
    Value(String),
    /// The selector names no instance of the scene; the text says what there is.
    #[error("{0}")]
    NoInstance(String),
    /// The edit is for one instance, and the selector names several.
    #[error("{which} is {count} instances, and this is for one")]
    Several {
        /// What was given.
        which: Selector,
        /// Instances that it names.
        count: usize,
    },
    /// The scene has no such template.
    #[error("there is no template {template}: {}", templates_text(.count))]
    NoTemplate {
        /// What was given.
        template: u32,
        /// Templates of the scene.
        count: usize,
    },
    /// Another template has some of the same Gaussians, and would change too.
    #[error("template {other} has some of the same Gaussians as template {template}")]
    SharedTemplate {
        /// What was given.
        template: u32,
        /// The other one.
        other: usize,
    },
    /// Nothing would be left of a template.
    #[error("all {count} Gaussians of template {template} would go; delete its instances instead")]
    EmptyTemplate {
        /// What was given.
        template: u32,
        /// Its Gaussians.
        count: usize,
    },
    /// An instance's new transform cannot be held by files and the device.
    #[error("the transform of instance {instance} {error} then")]
    Transform {
        /// Index of the instance.
        instance: usize,
        /// What is wrong with it.
        error: SimilarityError,
    },
    /// The scene would have more offset records than it can have, or than memory holds.
    #[error("{total} offset records are too many")]
    OffsetRecords {
        /// Records after the edit.
        total: u64,
    },
    /// The instance whose offsets are asked for has none.
    #[error("instance {which} has no offsets")]
    NoOffsets {
        /// The instance.
        which: Selector,
    },
    /// The offsets that are asked for belong to another template's Gaussians.
    #[error("offsets of instance {which} are for template {has}, not {wanted}")]
    OtherOffsets {
        /// The instance.
        which: Selector,
        /// Its template.
        has: u32,
        /// The template of the new instances.
        wanted: u32,
    },
    /// Too few instances fit with the distance that they must keep.
    #[error("only {found} of {count} fit: want a larger extent or a smaller distance")]
    DoNotFit {
        /// Instances that found a place.
        found: usize,
        /// Instances that were asked for.
        count: usize,
    },
}

impl EditReason {
    /// A value of the edit that is not usable, and what is wanted.
    fn value(what: impl Into<String>) -> Self {
        Self::Value(what.into())
    }
}

/// Which templates a scene of so many has.
fn templates_text(count: &usize) -> String {
    match *count {
        0 => "the scene has none".into(),
        1 => "the only one is 0".into(),
        count => format!("there are 0 to {}", count - 1),
    }
}

impl Edit {
    /// The edit's name, as on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Duplicate { .. } => "duplicate",
            Self::MoveBy { .. } | Self::MoveTo { .. } => "move",
            Self::Rotate { .. } => "rotate",
            Self::Scale { .. } => "scale",
            Self::Delete { .. } => "delete",
            Self::Recolour { .. } => "recolour",
            Self::Swap { .. } => "swap",
            Self::Scatter(_) => "scatter",
            Self::Crop { .. } => "crop",
            Self::Erase { .. } => "erase",
        }
    }
}

/// Changes a valid scene, or leaves it as it is and says why.
pub fn apply(scene: &mut InstancedScene, edit: &Edit) -> Result<EditOutcome, EditError> {
    let done = match edit {
        Edit::Duplicate { which, by, turn } => membership::duplicate(scene, which, *by, *turn),
        Edit::MoveBy { which, by } => placement::move_by(scene, which, *by),
        Edit::MoveTo { which, to } => placement::move_to(scene, which, *to),
        Edit::Rotate { which, turn } => placement::rotate(scene, which, *turn),
        Edit::Scale { which, by } => placement::scale(scene, which, *by),
        Edit::Delete { which } => membership::delete(scene, which),
        Edit::Recolour { which, rgb } => recolour::recolour(scene, which, *rgb),
        Edit::Swap { which, template } => membership::swap(scene, which, *template),
        Edit::Scatter(scatter) => scatter::scatter(scene, scatter),
        Edit::Crop { template, corners, keep } => thin::crop(scene, *template, *corners, *keep),
        Edit::Erase { template, centres, radius } => thin::erase(scene, *template, centres, *radius),
    };
    done.map_err(|reason| EditError { operation: edit.name(), reason })
}

/// The template, which must exist.
fn existing_template(scene: &InstancedScene, template: u32) -> Result<(), EditReason> {
    let count = scene.template_ranges.len();
    if (template as usize) < count {
        return Ok(());
    }
    Err(EditReason::NoTemplate { template, count })
}

/// A transform that files and the device can hold.
fn checked(placement: Similarity, k: usize) -> Result<Similarity, EditReason> {
    Similarity::from_rows(placement.rows()).map_err(|error| EditReason::Transform { instance: k, error })
}

#[cfg(test)]
mod tests;
