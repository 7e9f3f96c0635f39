//! Scene edits: add, remove, move and recolour instances, and thin out templates. One implementation for the command
//! line and for interactive programs.
//!
//! Every edit is a small value, applied as a whole or not at all, so a program can undo it by keeping the previous
//! scene. Most edits touch only instances, groups and offsets; recolouring all instances of a template touches its base
//! colour, and cropping and erasing remove Gaussians from a template, once for all of its instances.
//!
//! Offsets are copy-on-write: a duplicate shares its original's run of records, and an edit that changes the offsets of
//! an instance whose run is shared copies the run first. Unused runs are removed. So it is with the Gaussians that an instance
//! has of its own. Mask ids in `groups` follow the
//! instances; a new instance of a template with a group gets the next free id.

mod arrange;
mod given;
mod membership;
mod offset_runs;
mod own;
mod placement;
mod recolour;
mod relight;
mod scatter;
mod select;
mod thin;
mod unique;

use glam::DVec3;

pub use arrange::AlignTo;
pub use placement::{instance_centres, template_centres};
pub use scatter::{Footprint, MOST_SCATTERED, OffsetSource, Scatter, ScatterOver, footprint};
pub use select::{ParseSelectorError, Selector};
pub use thin::Keep;
pub use unique::Extra;

use crate::math::similarity::{Similarity, SimilarityError};
use crate::scene::instanced_scene::InstancedScene;

/// A rotation about an axis, by the right-hand rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Axis in the world frame, of any length but zero.
    pub axis: DVec3,
    /// Angle by the right-hand rule, radians.
    pub angle: f64,
}

/// One change of a scene. An edit of several instances treats each of them alike, about its own centre: the mean of its
/// template's means, in the world.
#[derive(Clone, Debug, PartialEq)]
pub enum Edit {
    /// Appends a copy of each instance, which shares its offsets and own Gaussians, moved by `by` and rotated about its centre.
    Duplicate {
        /// The instances to copy.
        which: Selector,
        /// Translation of the copy, world units.
        by: DVec3,
        /// Rotation of the copy; `None` keeps the original's.
        turn: Option<Turn>,
    },
    /// Moves instances by a world-space vector.
    MoveBy {
        /// The instances to move.
        which: Selector,
        /// Translation, world units.
        by: DVec3,
    },
    /// Moves one instance so that its centre is at a world position.
    MoveTo {
        /// The instance to move; it must be a single one.
        which: Selector,
        /// The new centre, world units.
        to: DVec3,
    },
    /// Rotates instances about their centres.
    Rotate {
        /// The instances to rotate.
        which: Selector,
        /// Axis and angle of the rotation.
        turn: Turn,
    },
    /// Scales instances about their centres.
    Scale {
        /// The instances to scale.
        which: Selector,
        /// Scale factor, greater than 0.
        by: f64,
    },
    /// Removes instances, and their offsets and own Gaussians unless others share them.
    Delete {
        /// The instances to remove.
        which: Selector,
    },
    /// Shifts the base colour. If all instances of a template are selected, the template itself is shifted, which costs
    /// no memory; otherwise their offsets are, which are created for instances that have none. Own Gaussians are shifted too.
    Recolour {
        /// The instances to recolour.
        which: Selector,
        /// Added to red, green and blue; 1 is the difference between black and white.
        rgb: [f32; 3],
    },
    /// Gives instances another template without moving them. Their offsets and own Gaussians belong to the old template and
    /// are dropped.
    Swap {
        /// The instances to change.
        which: Selector,
        /// Index of the new template.
        template: u32,
    },
    /// Adds instances of a template over a plane or along a path.
    Scatter(Scatter),
    /// Removes the Gaussians of a template whose means are outside, or inside, an axis-aligned box in its frame, with those of
    /// its instances' own; some of the template must remain.
    Crop {
        /// Index of the template.
        template: u32,
        /// Lower and upper corner, template units; infinite coordinates leave a side open.
        corners: [DVec3; 2],
        /// Which side of the box remains.
        keep: Keep,
    },
    /// Removes the Gaussians of a template whose means are within `radius` of any of the centres, with those of its instances'
    /// own; some of the template must remain.
    Erase {
        /// Index of the template.
        template: u32,
        /// Centres of the balls, template's frame.
        centres: Vec<DVec3>,
        /// Radius of the balls, greater than 0, template units.
        radius: f64,
    },
    /// Moves instances along an axis until they have the same coordinate on it.
    Align {
        /// The instances to move, two or more.
        which: Selector,
        /// The axis, world frame, of any length but zero.
        axis: DVec3,
        /// The coordinate that they get.
        to: AlignTo,
    },
    /// Moves instances along an axis until their centres are at equal distances; the outermost two stay.
    Distribute {
        /// The instances to move, three or more.
        which: Selector,
        /// The axis, world frame, of any length but zero.
        axis: DVec3,
    },
    /// Mirrors instances across a plane. Their templates get mirrored twins; offsets and own Gaussians are mirrored, too.
    Mirror {
        /// The instances to mirror.
        which: Selector,
        /// Normal of the plane, world frame, of any length but zero.
        normal: DVec3,
        /// A point of the plane, world units; `None` for the mean of the instances' centres.
        point: Option<DVec3>,
    },
    /// Makes each instance the only one of a new template that has its offsets, colours and own Gaussians built in.
    MakeUnique {
        /// The instances.
        which: Selector,
    },
    /// Removes what sets instances apart from their template.
    Reset {
        /// The instances.
        which: Selector,
        /// What is removed.
        what: Extra,
    },
    /// Gives an instance the Gaussians of the background inside its template's box as its own.
    Give {
        /// The instance; it must be a single one.
        which: Selector,
        /// What the box is grown by on every side, relative to its size; above -0.5.
        margin: f64,
    },
    /// Returns the own Gaussians of instances to the background.
    Take {
        /// The instances.
        which: Selector,
    },
    /// Gives instances the colour matrix of their neighbours of the same template.
    Relight {
        /// The instances.
        which: Selector,
    },
    /// Names the group of a template.
    Rename {
        /// Index of the template.
        template: u32,
        /// The new name, not empty.
        name: String,
    },
}

/// The result of an edit.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct EditOutcome {
    /// Instances that changed, by index after the edit.
    pub changed: Vec<usize>,
    /// New instances, by index after the edit.
    pub added: Vec<usize>,
    /// Removed instances, by index before the edit.
    pub removed: Vec<usize>,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// Why an edit was rejected; the scene is unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{operation}: {reason}")]
pub struct EditError {
    /// Name of the edit on the command line, for instance "duplicate".
    pub operation: &'static str,
    /// What is wrong, and which values exist.
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
    #[error("{which} selects {count} instances, but this edit takes one")]
    Several {
        /// The selector that was given.
        which: Selector,
        /// Number of instances that it selects.
        count: usize,
    },
    /// The scene has no such template.
    #[error("there is no template {template}: {}", templates_text(.count))]
    NoTemplate {
        /// The template that was given.
        template: u32,
        /// Number of templates of the scene.
        count: usize,
    },
    /// Another template shares some of the Gaussians, and would change too.
    #[error("template {other} shares Gaussians with template {template}")]
    SharedTemplate {
        /// The template that was given.
        template: u32,
        /// The template that shares Gaussians with it.
        other: usize,
    },
    /// The edit would leave no Gaussian in a template.
    #[error("all {count} Gaussians of template {template} would be removed; delete its instances instead")]
    EmptyTemplate {
        /// The template that was given.
        template: u32,
        /// Number of its Gaussians.
        count: usize,
    },
    /// An instance's new transform cannot be stored in files or on the device.
    #[error("the new transform of instance {instance} {error}")]
    Transform {
        /// Index of the instance.
        instance: usize,
        /// The reason why the transform is invalid.
        error: SimilarityError,
    },
    /// The scene would have more offset records than it can have, or than memory holds.
    #[error("{total} offset records are too many")]
    OffsetRecords {
        /// Records after the edit.
        total: u64,
    },
    /// The instance whose offsets are asked for has none, and no own Gaussians or colour matrix.
    #[error("instance {which} has neither offsets nor own Gaussians, and its template's colours")]
    NoOffsets {
        /// The selector of the instance.
        which: Selector,
    },
    /// The offsets that are asked for belong to another template's Gaussians.
    #[error("offsets of instance {which} are for template {has}, not {wanted}")]
    OtherOffsets {
        /// The selector of the instance.
        which: Selector,
        /// Template of that instance.
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
    /// An error about a value of the edit, with what is allowed.
    fn value(what: impl Into<String>) -> Self {
        Self::Value(what.into())
    }
}

/// The valid template indices of a scene with `count` templates.
fn templates_text(count: &usize) -> String {
    match *count {
        0 => "the scene has none".into(),
        1 => "the only one is 0".into(),
        count => format!("there are 0 to {}", count - 1),
    }
}

impl Edit {
    /// The edit's name on the command line.
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
            Self::Align { .. } => "align",
            Self::Distribute { .. } => "distribute",
            Self::Mirror { .. } => "mirror",
            Self::MakeUnique { .. } => "unique",
            Self::Reset { .. } => "reset",
            Self::Give { .. } => "give",
            Self::Take { .. } => "take",
            Self::Relight { .. } => "relight",
            Self::Rename { .. } => "rename",
        }
    }
}

/// Applies an edit to a valid scene.
///
/// # Errors
/// The edit is not possible; the scene is then unchanged.
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
        Edit::Align { which, axis, to } => arrange::align(scene, which, *axis, *to),
        Edit::Distribute { which, axis } => arrange::distribute(scene, which, *axis),
        Edit::Mirror { which, normal, point } => arrange::mirror(scene, which, *normal, *point),
        Edit::MakeUnique { which } => unique::make_unique(scene, which),
        Edit::Reset { which, what } => unique::reset(scene, which, *what),
        Edit::Give { which, margin } => given::give(scene, which, *margin),
        Edit::Take { which } => given::take(scene, which),
        Edit::Relight { which } => relight::relight(scene, which),
        Edit::Rename { template, name } => membership::rename(scene, *template, name),
    };
    done.map_err(|reason| EditError { operation: edit.name(), reason })
}

/// Checks that the template exists; the error lists the existing ones.
fn existing_template(scene: &InstancedScene, template: u32) -> Result<(), EditReason> {
    let count = scene.template_ranges.len();
    if (template as usize) < count {
        return Ok(());
    }
    Err(EditReason::NoTemplate { template, count })
}

/// Checks that a transform is finite and a similarity, as files and the device need it.
fn checked(placement: Similarity, k: usize) -> Result<Similarity, EditReason> {
    Similarity::from_rows(placement.rows()).map_err(|error| EditReason::Transform { instance: k, error })
}

#[cfg(test)]
mod tests;
