//! Which of the refined places are repetitions.

use glam::DVec3;

use super::refine::{Candidate, explained};
use super::select::Selected;
use super::{FindOptions, Found, FoundObject, RejectedPlace, moved_box, world_map};
use crate::register::pose::Pose;
use crate::scene::ObjectBox;

/// A place of whose points more than this part are those of better ones is theirs.
const TAKEN: f64 = 0.35;
/// A pose that tilts the object by more than this is none, radians (20 degrees).
const MOST_TILT: f64 = 0.35;

/// Decides.
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
        let moved = moved_box(object, &pose, origin, objects.len() as u32 + 1);
        let of_others = own.iter().filter(|i| taken[**i as usize]).count();
        if of_others as f64 > TAKEN * own.len() as f64 {
            continue;
        }
        own.iter().for_each(|i| taken[*i as usize] = true);
        let score = agreement.score();
        let tilt = (pose.rotation * selected.up).angle_between(selected.up);
        let reason = if score < options.min_score {
            let (found, explained) = (100.0 * agreement.inliers, 100.0 * agreement.explained);
            Some(format!("{found:.0} % of the object found, {explained:.0} % of what is there explained"))
        } else if tilt > MOST_TILT {
            Some(format!("tilted by {:.0} degrees", tilt.to_degrees()))
        } else {
            None
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
                note: String::new(),
            }),
        }
    }
    Found { objects, rejected, gaussians: surface.gaussians, on_support: selected.support.is_some() }
}
