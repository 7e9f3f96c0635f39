//! Select one, find the rest: one object of a plain cloud is selected by a box; everything that is shaped like it is found,
//! without masks.
//!
//! What is in the box, without what it stands on, gives points of its surface (`select`). They are laid on the points of
//! the whole scene in every turn about the vertical and at every place where a few of them meet something (`field`,
//! `search`). Places where most do are refined, both ways (`refine`): the object must be found there, and what is there
//! must be explained by the object. Those that agree well and stand on something, as the object does, are repetitions
//! (`decide`). Colours say nothing: liveries differ.
//!
//! With a window in a wall it is the other way round: any flat patch has its shape, and the frame's colours tell it from the
//! wall. So for an object that an upright surface goes on around (`pattern`), every plane that is turned about the vertical
//! like one of 24 is seen straight on, layer by layer (`picture`), and compared with the picture of the box (`flat`). Shade
//! does not matter. Those that are alike say together what they have in common, so that what differs from window to window,
//! the glass, counts less in the next comparison.

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
use crate::math::similarity::Similarity;
use crate::scene::{Camera, Gaussians, ObjectBox};

pub use against::Against;
pub use options::FindOptions;

/// Gaussians that reach farther than so many diagonals of the box show no pattern.
const LARGEST: f64 = 2.0;

/// Where repetitions are looked for.
#[derive(Clone, Copy, Debug)]
pub struct FindInput<'a> {
    /// A trained plain cloud, world frame.
    pub cloud: &'a Gaussians,
    /// The training views: they say what is up, and which side of a surface is outside. May be empty.
    pub cameras: &'a [Camera],
    /// The box around the selected object. It should hold the object whole and little else; the ground does not matter.
    pub object: &'a ObjectBox,
    /// What is up, world; `None` = the axis of the box that the pictures have as up, its third one without pictures.
    pub up: Option<DVec3>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Repetitions, without the selected one, best first.
    pub objects: Vec<FoundObject>,
    /// Places that were refined but are no repetitions, best first.
    pub rejected: Vec<RejectedPlace>,
    /// Gaussians of the selected object's surface.
    pub gaussians: usize,
    /// True if the selected object stands on a surface, which was left out.
    pub on_support: bool,
    /// True if the selected object is part of a wall: then its pattern of colours was looked for, not its shape.
    pub in_wall: bool,
    /// What was up, unit vector, world.
    pub up: DVec3,
}

/// A repetition.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundObject {
    /// The selected box, moved here; its id is the smallest that is free, counted from 1.
    pub object: ObjectBox,
    /// Moves the selected object onto this one, world to world.
    pub world_from_selected: Similarity,
    /// Part of the selected object's surface that is found here, 0..=1.
    pub inliers: f64,
    /// Part of what is in the moved box that the object explains, 0..=1.
    pub explained: f64,
    /// Root mean square distance of the part that is found, scene units.
    pub rmse: f64,
    /// Agreement both ways, 0..=1, 1 = as well as the object agrees with itself.
    pub score: f64,
}

/// A place that is no repetition.
#[derive(Clone, Debug, PartialEq)]
pub struct RejectedPlace {
    /// Where the selected box would be, world.
    pub center: DVec3,
    /// As of a repetition, 0..=1.
    pub score: f64,
    /// Why it is none.
    pub reason: String,
}

/// How far it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FindProgress {
    /// Steps done.
    pub done: usize,
    /// All steps.
    pub total: usize,
}

/// Why nothing could be looked for.
#[derive(Debug, thiserror::Error)]
pub enum FindError {
    /// The cloud, a camera or an option is invalid.
    #[error(transparent)]
    Input(#[from] RegisterError),
    /// The box selects nothing that could be found again.
    #[error("the box of object {id} {what}")]
    Selection {
        /// The box's id.
        id: u32,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// The caller's progress function asked for it.
    #[error("stopped")]
    Stopped,
}

/// Told how far it is; `Break` stops with [`FindError::Stopped`].
pub type FindTold<'a> = dyn FnMut(FindProgress) -> ControlFlow<()> + 'a;

/// Finds the repetitions of the selected object. The same input gives the same answer, with any number of threads.
///
/// # Errors
/// Arrays that do not fit, a camera or an option that is invalid; a box with too few Gaussians in it; a stop.
pub fn find_alike(input: &FindInput<'_>, options: &FindOptions, told: &mut FindTold<'_>) -> Result<Found, FindError> {
    options.validate()?;
    if let Some((array, len, want)) = input.cloud.wrong_length() {
        return Err(RegisterError::Cloud { array, len, want }.into());
    }
    input.cameras.iter().try_for_each(Camera::validate).map_err(RegisterError::Camera)?;
    let selected = select::selected(input, options)?;
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

/// Counts steps for the caller.
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

/// A pose between frames whose origins are both at `origin` (world), as a map of the world onto itself.
fn world_map(pose: &Pose, origin: DVec3) -> Similarity {
    Similarity::from_parts(pose.rotation, pose.scale, origin + pose.apply(-origin))
}

/// The box moved by a pose of the frame at `origin`.
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
