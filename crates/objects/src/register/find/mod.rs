//! Select one, find the rest: an object of a plain cloud is selected by a box, and everything with the same shape is
//! found, without masks.
//!
//! The contents of the box, without the ground below, give points on the object's surface (`select`). They are aligned
//! with the points of the whole scene at every rotation about the up axis and every translation that brings a few of
//! them onto occupied cells (`field`, `search`). The candidates with most support are refined in both directions
//! (`refine`): the object must be found there, and the points there must be explained by the object. Candidates that
//! agree well and stand on a surface, as the object does, are repetitions (`decide`). Colours are not used, since
//! liveries differ.
//!
//! A window in a wall is the opposite case: any flat patch has its shape, but the frame's colours tell it from the
//! wall. So for an object within an upright surface (`pattern`), the scene is drawn in parallel projection, layer by
//! layer, along 24 directions about the up axis (`picture`), and compared with the picture of the box (`flat`). The
//! comparison ignores brightness. Matches are averaged to a common pattern, so that what differs from window to window,
//! the glass, gets less weight in the next comparison.

mod against;
mod decide;
mod field;
mod flat;
pub mod options;
mod pattern;
mod picture;
mod refine;
mod search;
mod select;

use std::ops::ControlFlow;

use glam::{DMat3, DQuat, DVec3};

use super::error::RegisterError;
use super::pose::Pose;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Camera, Gaussians, ObjectBox};

pub use against::Against;
pub use options::FindOptions;

/// Gaussians that reach farther than this many diagonals of the box show no pattern.
const LARGEST: f64 = 2.0;

/// Input of [`find_alike`].
#[derive(Clone, Copy, Debug)]
pub struct FindInput<'a> {
    /// Trained plain cloud in the world frame.
    pub cloud: &'a Gaussians,
    /// Training views: they give the up axis and the outer side of surfaces. May be empty.
    pub cameras: &'a [Camera],
    /// Box around the selected object: it should contain the whole object and little else; the ground below does no
    /// harm.
    pub object: &'a ObjectBox,
    /// Up direction, world frame; `None` = the box's axis nearest to the cameras' up direction, or to the normal of what they look
    /// straight at if that one finds nothing, or its third axis without cameras.
    pub up: Option<DVec3>,
}

/// Result of [`find_alike`].
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Repetitions without the selected object, best first.
    pub objects: Vec<FoundObject>,
    /// Candidates that were refined and rejected, best first.
    pub rejected: Vec<RejectedPlace>,
    /// Number of Gaussians on the selected object's surface.
    pub gaussians: usize,
    /// Whether the selected object stands on a surface, which was removed.
    pub on_support: bool,
    /// Whether the selected object is part of a wall, so that its colour pattern was searched instead of its shape.
    pub in_wall: bool,
    /// Up direction that was used: a unit vector of the world.
    pub up: DVec3,
}

/// A repetition of the selected object.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundObject {
    /// The selected box, moved here; its id is the smallest free one from 1.
    pub object: ObjectBox,
    /// Maps the selected object onto this one, world to world.
    pub world_from_selected: Similarity,
    /// Part of the selected object's surface that is found here, 0..=1.
    pub inliers: f64,
    /// Part of the points in the moved box that the object explains, 0..=1.
    pub explained: f64,
    /// Root mean square distance of the part that is found, scene units.
    pub rmse: f64,
    /// Agreement in both directions, 0..=1; 1 is the object's agreement with itself.
    pub score: f64,
}

/// A candidate that is no repetition.
#[derive(Clone, Debug, PartialEq)]
pub struct RejectedPlace {
    /// Centre of the selected box when moved there, world frame.
    pub center: DVec3,
    /// Score as in [`FoundObject::score`], 0..=1.
    pub score: f64,
    /// Reason of the rejection, for the user.
    pub reason: String,
}

/// Progress of [`find_alike`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FindProgress {
    /// Number of steps done.
    pub done: usize,
    /// Number of steps in all.
    pub total: usize,
}

/// Errors of [`find_alike`]; the text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// The cloud, a camera or an option is invalid.
    #[error(transparent)]
    Input(#[from] RegisterError),
    /// The box selects nothing that can be found again.
    #[error("the box of object {id} {what}")]
    Selection {
        /// Id of the selected object's box.
        id: u32,
        /// What is wrong with the box, and what to do.
        what: String,
    },
    /// The progress callback stopped the search.
    #[error("stopped")]
    Stopped,
}

/// Progress callback; `Break` stops with [`FindError::Stopped`].
pub type FindTold<'a> = dyn FnMut(FindProgress) -> ControlFlow<()> + 'a;

/// Finds the repetitions of the selected object. The result is deterministic and independent of the number of threads. If there are
/// none about the cameras' up axis, and the cameras look straight at a plane, as on a flight, its normal is tried; progress then begins
/// again.
///
/// # Errors
/// Arrays of wrong length; an invalid camera or option; a box with too few Gaussians; a stop by the callback.
pub fn find_alike(input: &FindInput<'_>, options: &FindOptions, told: &mut FindTold<'_>) -> Result<Found, FindError> {
    options.validate()?;
    if let Some((array, len, want)) = input.cloud.wrong_length() {
        return Err(RegisterError::Cloud { array, len, want }.into());
    }
    input.cameras.iter().try_for_each(Camera::validate).map_err(RegisterError::Camera)?;
    let (up, other) = select::up_axes(input);
    let found = find_about(input, up, options, told);
    let is_nothing = match &found {
        Ok(found) => found.objects.is_empty(),
        Err(error) => matches!(error, FindError::Selection { .. }),
    };
    let Some(other) = other.filter(|_| is_nothing) else { return found };
    match find_about(input, other, options, told) {
        Ok(again) if !again.objects.is_empty() => Ok(again),
        Err(stopped @ FindError::Stopped) => Err(stopped),
        _ => found,
    }
}

/// [`find_alike`] with `up` as the up axis.
fn find_about(
    input: &FindInput<'_>,
    up: DVec3,
    options: &FindOptions,
    told: &mut FindTold<'_>,
) -> Result<Found, FindError> {
    let selected = select::selected(input, up, options)?;
    let reach = LARGEST * selected.object_box.size.length();
    let splats = picture::splats(input.cloud, selected.surface.centroid, reach);
    let frame = pattern::wall_frame(&selected, input.cameras, &splats);
    let more = if frame.is_some() { flat::STEPS } else { search::STEPS + refine::STEPS };
    let mut steps = Steps { told, progress: FindProgress { done: 0, total: 1 + more } };
    steps.advance()?;
    if let Some(frame) = frame {
        let wall = flat::Wall { selected: &selected, splats: &splats, frame: &frame, cameras: input.cameras };
        return flat::found(&wall, input.object, options, &mut steps);
    }
    let places = search::places(&selected, options, &mut steps)?;
    let candidates = refine::refined(&selected, places, options, &mut steps)?;
    Ok(decide::decide(&selected, input.object, candidates, options))
}

/// Reports progress to the caller.
struct Steps<'a, 'b> {
    told: &'a mut FindTold<'b>,
    progress: FindProgress,
}

impl Steps<'_, '_> {
    fn advance(&mut self) -> Result<(), FindError> {
        self.progress.done += 1;
        match (self.told)(self.progress) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(FindError::Stopped),
        }
    }
}

/// A pose between frames that both have their origin at `origin` (world), as a map of the world.
fn world_map(pose: &Pose, origin: DVec3) -> Similarity {
    Similarity::from_parts(pose.rotation, pose.scale, origin + pose.apply(-origin))
}

/// The box moved by a pose of the frame at `origin`, with a new id.
fn moved_box(object: &ObjectBox, pose: &Pose, origin: DVec3, id: u32) -> ObjectBox {
    ObjectBox {
        id,
        category: object.category.clone(),
        center: origin + pose.apply(object.center - origin),
        size: object.size * pose.scale,
        world_from_box: turned(pose.rotation, object.world_from_box),
    }
}

fn turned(rotation: DMat3, before: DQuat) -> DQuat {
    (DQuat::from_mat3(&rotation) * before).normalize()
}
