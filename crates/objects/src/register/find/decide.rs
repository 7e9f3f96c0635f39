//! Decides which refined candidates are repetitions.

use glam::DVec3;

use super::refine::{Candidate, explained};
use super::select::{AROUND, SECTORS, Selected, densest_layer, half_extent, level_reach, sector};
use super::{FindOptions, Found, FoundObject, RejectedPlace, moved_box, world_map};
use crate::register::pose::Pose;
use instgs_vk::scene::ObjectBox;

/// A candidate with more than this part of its points on better ones is a duplicate.
const TAKEN: f64 = 0.35;
/// Largest tilt of a repetition, radians (20 degrees).
const MOST_TILT: f64 = 0.35;

/// An object stands if there are Gaussians beside it at the level of its support in at least this many of eight
/// directions, ...
const STANDING_SECTORS: usize = 3;
/// ... within this part of its height: a pose sunk into the ground or above it has none there.
const STANDS: f64 = 0.1;
/// A pose in the air has the ground below it: down to this part of the object's height, ...
const BELOW: f64 = 0.5;
/// ... at most this many times the Gaussians at its level may lie. Trained ground is uneven, and tables have legs.
const BELOW_PART: f64 = 3.0;
/// Early clouds have stray Gaussians below the ground, on which a sunk pose would stand: at its level must be at least this part
/// of the Gaussians in the fullest layer that is as thick, from [`BELOW`] below to as far above.
const FULL_PART: f64 = 0.25;
/// Another object can stand in the box, a table over a chair. Then the object must be found nearly whole ...
const WHOLE: f64 = 0.85;
/// ... and explain more than this part of the points there.
const MOSTLY: f64 = 0.6;

/// Sorts candidates into repetitions and rejected ones.
pub(super) fn decide(
    selected: &Selected,
    object: &ObjectBox,
    mut candidates: Vec<Candidate>,
    options: &FindOptions,
) -> Found {
    let surface = &selected.surface;
    let origin = surface.centroid;
    candidates.sort_by(|a, b| b.agreement.score().total_cmp(&a.agreement.score()));
    let mut taken = vec![false; selected.scene.len()];
    explained(selected, &Pose::IDENTITY).into_iter().for_each(|i| taken[i as usize] = true);
    let (mut objects, mut rejected) = (Vec::new(), Vec::new());
    for Candidate { pose, agreement, own } in candidates {
        let moved = moved_box(object, &pose, origin, free_id(object.id, objects.len()));
        let of_others = own.iter().filter(|i| taken[**i as usize]).count();
        if of_others as f64 > TAKEN * own.len() as f64 {
            continue;
        }
        own.iter().for_each(|i| taken[*i as usize] = true);
        let score = agreement.score();
        let is_alike = score >= options.min_score || (agreement.inliers >= WHOLE && agreement.explained > MOSTLY);
        let tilt = (pose.rotation * selected.up).angle_between(selected.up);
        let reason = if !is_alike {
            let (found, explained) = (100.0 * agreement.inliers, 100.0 * agreement.explained);
            Some(format!("{found:.0} % of the object found, {explained:.0} % of the points there explained"))
        } else if tilt > MOST_TILT {
            Some(format!("tilted by {:.0} degrees", tilt.to_degrees()))
        } else {
            not_standing(selected, &pose)
        };
        match reason {
            Some(reason) => rejected.push(RejectedPlace { center: moved.center, score, reason }),
            None => objects.push(FoundObject {
                object: moved,
                world_from_selected: world_map(&pose, origin),
                inliers: agreement.inliers,
                explained: agreement.explained,
                rmse: agreement.rmse,
                score,
            }),
        }
    }
    let on_support = selected.support.is_some();
    Found { objects, rejected, gaussians: surface.gaussians, on_support, in_wall: false, up: selected.up }
}

/// Reason why an object does not stand at a pose as the selected one stands; `None` if it does.
fn not_standing(selected: &Selected, pose: &Pose) -> Option<String> {
    let up = selected.up;
    let height = selected.support? * pose.scale;
    let there = moved_box(&selected.object_box, pose, DVec3::ZERO, 1);
    let level = up.dot(pose.translation) + height;
    let off = STANDS * 2.0 * half_extent(&there, up);
    let reach = AROUND * level_reach(&there, up);
    let (mut has_ground, mut at_level, mut below) = ([false; SECTORS], 0, 0);
    let mut around = Vec::new();
    for &p in &selected.ground {
        let away = (p - there.center).reject_from(up);
        if away.length() > reach || there.contains(there.center + away) {
            continue;
        }
        let above = up.dot(p) - level;
        if above.abs() < BELOW / STANDS * off {
            around.push((above, sector(away, up)));
        }
        if above.abs() < off {
            has_ground[sector(away, up)] = true;
            at_level += 1;
        } else if above < 0.0 && above > -BELOW / STANDS * off {
            below += 1;
        }
    }
    let sectors = has_ground.iter().filter(|has| **has).count();
    let stands = sectors >= STANDING_SECTORS && f64::from(below) <= BELOW_PART * f64::from(at_level);
    around.sort_by(|a: &(f64, usize), b| a.0.total_cmp(&b.0));
    let fullest = densest_layer(&around, 2.0 * off).map_or(0, <[_]>::len);
    let stands = stands && f64::from(at_level) >= FULL_PART * fullest as f64;
    (!stands).then(|| "there is no surface to stand on".into())
}

/// The smaller of the box's two edges that are not its most upright one.
pub(super) fn smaller_level_edge(object: &ObjectBox, up: DVec3) -> f64 {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (object.world_from_box * axis).dot(up).abs());
    let upright = (0..3).max_by(|&a, &b| axes[a].total_cmp(&axes[b])).unwrap_or(2);
    (0..3).filter(|k| *k != upright).map(|k| object.size[k]).fold(f64::INFINITY, f64::min)
}

/// Id of the k-th repetition: the smallest that neither the selected object nor an earlier one has.
pub(super) fn free_id(selected: u32, k: usize) -> u32 {
    let id = k as u32 + 1;
    if id < selected { id } else { id + 1 }
}
