//! Refines candidates with closest points in both directions, and measures how well the object and its surroundings
//! agree.

use glam::DVec3;
use rayon::prelude::*;

use super::search::{Place, distinct};
use super::select::Selected;
use super::{FindError, FindOptions, Steps};
use crate::register::icp::INLIER_VOXELS;
use crate::register::pose::{Pair, Pose, best_pose};
use crate::register::sample::{BASE, FINE};
use crate::register::surface::Surface;

/// Largest distance of matched points in each step, base voxels, decreasing.
const REACHES: [f64; 12] = [6.0, 6.0, 5.0, 4.0, 3.0, 3.0, 2.5, 2.0, 2.0, 1.5, 1.5, 1.5];
/// The steps after these, for candidates that may be repetitions: points slide along surfaces a little in each.
const LAST_REACHES: [f64; 24] = [1.5; 24];
/// A candidate may be a repetition above this part of the score that it needs.
const NEARLY: f64 = 0.9;
/// Number of these steps that use fewer points, to choose the candidates for the others.
const COARSE: usize = 6;
/// Number of candidates that get all steps.
const MOST_FINE: usize = 100;
/// Candidates nearer than this part of the object's size are one after the coarse steps.
const SAME_PLACE: f64 = 0.1;
/// Blocks of candidates between which progress is reported.
const BLOCKS: usize = 10;
/// Number of progress steps of the refinement.
pub(super) const STEPS: usize = 2 * BLOCKS;

/// A refined candidate for a repetition.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// Maps the object to its repetition, local frame of the selected object.
    pub pose: Pose,
    /// Agreement of the object and the scene there.
    pub agreement: Agreement,
    /// Indices of the scene points that the object explains there, ascending.
    pub own: Vec<u32>,
}

/// Agreement of the object and the scene at a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Agreement {
    /// Part of the object's points that are found.
    pub inliers: f64,
    /// Part of the points in the moved box that the object explains.
    pub explained: f64,
    /// Root mean square distance of the object's points that are found, scene units.
    pub rmse: f64,
}

impl Agreement {
    /// Harmonic mean of both parts, 0..=1.
    pub(super) fn score(&self) -> f64 {
        let sum = self.inliers + self.explained;
        if sum > 0.0 { 2.0 * self.inliers * self.explained / sum } else { 0.0 }
    }
}

/// Refines candidates, coarse steps first; the best distinct ones get the fine steps.
pub(super) fn refined(
    selected: &Selected,
    places: Vec<Place>,
    options: &FindOptions,
    steps: &mut Steps<'_, '_>,
) -> Result<Vec<Candidate>, FindError> {
    let allow_scale = options.min_scale < 1.0;
    let surface = &selected.surface;
    let thin = Surface::new(&selected.scene.samples(), surface.levels[BASE - 1].voxel);
    let coarse = |place: &Place| {
        let level = LevelPoints { own: &surface.levels[BASE - 1].positions, scene: &thin.positions };
        let pose = settled(selected, level, place.pose, &REACHES[..COARSE], allow_scale);
        Place { pose, score: agreement(selected, level, &pose).score() }
    };
    let found = in_blocks(&places, coarse, steps)?;
    let found = distinct(found, SAME_PLACE * surface.size, MOST_FINE);
    let fine = |place: &Place| {
        let level = LevelPoints::finest(selected);
        let mut pose = settled(selected, level, place.pose, &REACHES[COARSE..], allow_scale);
        if agreement(selected, level, &pose).score() > NEARLY * options.min_score {
            pose = settled(selected, level, pose, &LAST_REACHES, allow_scale);
        }
        Candidate { pose, agreement: agreement(selected, level, &pose), own: explained(selected, &pose) }
    };
    in_blocks(&found, fine, steps)
}

/// Maps all candidates in order, reporting progress after each block.
fn in_blocks<T: Send>(
    places: &[Place],
    of: impl Fn(&Place) -> T + Sync,
    steps: &mut Steps<'_, '_>,
) -> Result<Vec<T>, FindError> {
    let mut out = Vec::with_capacity(places.len());
    for block in 0..BLOCKS {
        let part = block * places.len() / BLOCKS..(block + 1) * places.len() / BLOCKS;
        out.par_extend(places[part].par_iter().map(&of));
        steps.advance()?;
    }
    Ok(out)
}

/// Points of the object and of the scene, about equally dense.
#[derive(Clone, Copy)]
pub(super) struct LevelPoints<'a> {
    /// Of the object, about its centroid.
    pub own: &'a [DVec3],
    /// Of the scene, about the same place.
    pub scene: &'a [DVec3],
}

impl<'a> LevelPoints<'a> {
    /// The densest that are compared: those of the base level, and all of the scene.
    pub(super) fn finest(selected: &'a Selected) -> Self {
        Self { own: &selected.surface.levels[BASE].positions, scene: &selected.scene.positions }
    }
}

/// Steps of closest points in both directions. `level` has points of the object and of the scene.
fn settled(selected: &Selected, level: LevelPoints<'_>, start: Pose, reaches: &[f64], allow_scale: bool) -> Pose {
    let LevelPoints { own, scene } = level;
    let mut pose = start;
    let near = near_box(selected, scene, &pose);
    for reach in reaches {
        let reach = reach * selected.surface.voxel() * pose.scale;
        let mut pairs = Vec::with_capacity(own.len() + near.len());
        for &from in own {
            if let Some((j, distance)) = selected.scene.nearest(pose.apply(from))
                && distance < reach
            {
                pairs.push(Pair { from, to: selected.scene.positions[j], weight: 1.0 });
            }
        }
        let model = &selected.surface.levels[FINE];
        for &to in &near {
            let p = pose.apply_inverse(to);
            if selected.holds(p)
                && let Some((j, distance)) = model.nearest(p)
                && distance * pose.scale < reach
            {
                pairs.push(Pair { from: model.positions[j], to, weight: 1.0 });
            }
        }
        let Some(next) = best_pose(&pairs, allow_scale) else { return pose };
        pose = next;
    }
    pose
}

/// Points of the scene that are in the moved box or can come into it while the pose is refined.
fn near_box(selected: &Selected, scene: &[DVec3], pose: &Pose) -> Vec<DVec3> {
    let reach = (0.6 * selected.domain.size.length() * pose.scale).powi(2);
    let middle = pose.apply(selected.domain.center);
    scene.iter().filter(|q| q.distance_squared(middle) < reach).copied().collect()
}

/// Agreement of the object and the points in its moved box.
pub(super) fn agreement(selected: &Selected, level: LevelPoints<'_>, pose: &Pose) -> Agreement {
    let LevelPoints { own, scene } = level;
    let limit = INLIER_VOXELS * selected.surface.voxel() * pose.scale;
    let found: Vec<f64> = own
        .iter()
        .filter_map(|p| selected.scene.nearest(pose.apply(*p)))
        .map(|(_, distance)| distance)
        .filter(|distance| *distance <= limit)
        .collect();
    let model = &selected.surface.levels[FINE];
    let (mut inside, mut explained) = (0, 0);
    for q in near_box(selected, scene, pose) {
        let p = pose.apply_inverse(q);
        if selected.holds(p) {
            inside += 1;
            explained += usize::from(model.nearest(p).is_some_and(|n| n.1 * pose.scale <= limit));
        }
    }
    let part = |count: usize, all: usize| count as f64 / all.max(1) as f64;
    let squares: f64 = found.iter().map(|d| d * d).sum();
    Agreement {
        inliers: part(found.len(), own.len()),
        explained: part(explained, inside),
        rmse: (squares / found.len().max(1) as f64).sqrt(),
    }
}

/// Indices of the scene points that the object explains at a pose, ascending.
pub(super) fn explained(selected: &Selected, pose: &Pose) -> Vec<u32> {
    let limit = INLIER_VOXELS * selected.surface.voxel();
    let reach = (0.6 * selected.domain.size.length() * pose.scale).powi(2);
    let middle = pose.apply(selected.domain.center);
    let model = &selected.surface.levels[FINE];
    let is_own = |q: &DVec3| {
        let p = pose.apply_inverse(*q);
        selected.holds(p) && model.nearest(p).is_some_and(|n| n.1 <= limit)
    };
    let scene = selected.scene.positions.iter().enumerate();
    let near = scene.filter(|(_, q)| q.distance_squared(middle) < reach);
    near.filter(|(_, q)| is_own(q)).map(|(i, _)| i as u32).collect()
}
