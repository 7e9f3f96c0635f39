//! Poses from features alone, without a first guess: random samples of matched points, ranked by inliers (RANSAC).

use glam::DVec3;

use super::fpfh::{Feature, squared_difference};
use super::pose::{Pair, Pose, best_pose};
use instgs_vk::math::rng::Rng;

/// Points of a sample: the least number that fixes a pose.
const SAMPLE: usize = 3;
/// Least ratio of the shorter to the longer distance of two matched points in the two objects.
const EDGE_RATIO: f64 = 0.9;
/// A match is an inlier if its points are at most this far apart, base voxels.
const AGREE_VOXELS: f64 = 1.5;
/// Largest number of features that are matched: neighbours are similar, and the time grows with the square.
const MOST_FEATURES: usize = 900;
/// Poses that differ by less than this angle, radians (15 degrees), ...
const SAME_ANGLE: f64 = 0.26;
/// ... and by less than this distance, base voxels, are the same: refinement moves farther.
const SAME_VOXELS: f64 = 4.0;

/// Pairs of points, indices into the base levels, of which each is the other's best match.
pub(super) fn mutual_matches(reference: &[Feature], target: &[Feature]) -> Vec<(usize, usize)> {
    let (reference_step, target_step) = (thinned(reference), thinned(target));
    let of = |all: &[Feature], step: usize| -> Vec<Feature> { all.iter().step_by(step).copied().collect() };
    let (reference, target) = (of(reference, reference_step), of(target, target_step));
    let (forth, back) = best_matches(&reference, &target);
    let mutual = forth.iter().enumerate().filter(|(i, j)| back.get(**j) == Some(i));
    mutual.map(|(i, &j)| (i * reference_step, j * target_step)).collect()
}

/// Stride of the features that are matched.
fn thinned(features: &[Feature]) -> usize {
    features.len().div_ceil(MOST_FEATURES).max(1)
}

/// For each feature the index of the nearest one of the other object, the first in a tie; `usize::MAX` if there is none.
fn best_matches(reference: &[Feature], target: &[Feature]) -> (Vec<usize>, Vec<usize>) {
    let none = (usize::MAX, f32::INFINITY);
    let (mut forth, mut back) = (vec![none; reference.len()], vec![none; target.len()]);
    for (i, (a, nearest)) in reference.iter().zip(&mut forth).enumerate() {
        for (j, (b, nearest_back)) in target.iter().zip(&mut back).enumerate() {
            let difference = squared_difference(a, b);
            if difference < nearest.1 {
                *nearest = (j, difference);
            }
            if difference < nearest_back.1 {
                *nearest_back = (i, difference);
            }
        }
    }
    let indices = |nearest: Vec<(usize, f32)>| nearest.into_iter().map(|(index, _)| index).collect();
    (indices(forth), indices(back))
}

/// Poses from samples of matched points: the `modes` best distinct ones, those with most inliers first. `voxel` is the
/// target's base voxel, scene units.
pub(super) fn consensus_poses(
    pairs: &[Pair],
    voxel: f64,
    trials: usize,
    modes: usize,
    allow_scale: bool,
    mut rng: Rng,
) -> Vec<Pose> {
    let reach = AGREE_VOXELS * voxel;
    let mut best: Vec<Mode> = Vec::new();
    if pairs.len() < SAMPLE {
        return Vec::new();
    }
    for _ in 0..trials {
        let sample: [Pair; SAMPLE] = std::array::from_fn(|_| pairs[rng.index(pairs.len())]);
        if !edges_agree(&sample, allow_scale, voxel) {
            continue;
        }
        let Some(pose) = best_pose(&sample, allow_scale) else { continue };
        let agrees = |pair: &Pair| pose.apply(pair.from).distance_squared(pair.to) <= reach * reach;
        if sample.iter().all(agrees) {
            let agreeing = pairs.iter().filter(|pair| agrees(pair)).count();
            insert(&mut best, Mode { agreeing, pose }, modes, SAME_VOXELS * voxel);
        }
    }
    let refined = |Mode { pose, .. }: Mode| {
        let agreeing = pairs.iter().filter(|pair| pose.apply(pair.from).distance_squared(pair.to) <= reach * reach);
        best_pose(&agreeing.copied().collect::<Vec<_>>(), allow_scale).unwrap_or(pose)
    };
    best.into_iter().map(refined).collect()
}

/// Whether the three edges have about the same length in both objects (or the same ratio, if scale is free) and are
/// long enough to fix a rotation.
fn edges_agree(sample: &[Pair; SAMPLE], allow_scale: bool, voxel: f64) -> bool {
    let edge = |a: usize, b: usize, of: fn(&Pair) -> DVec3| of(&sample[a]).distance(of(&sample[b]));
    let ratios = [(0, 1), (1, 2), (2, 0)].map(|(a, b)| {
        let (from, to) = (edge(a, b, |p| p.from), edge(a, b, |p| p.to));
        if from.min(to) > SAME_VOXELS * voxel { to / from } else { f64::NAN }
    });
    let middle = if allow_scale { ratios.iter().sum::<f64>() / SAMPLE as f64 } else { 1.0 };
    ratios.iter().all(|r| (EDGE_RATIO..=1.0 / EDGE_RATIO).contains(&(r / middle)))
}

/// A pose, and how many matches agree with it.
#[derive(Clone, Copy)]
struct Mode {
    agreeing: usize,
    pose: Pose,
}

/// Inserts a pose into the list of the best distinct ones, best first; in a tie the earlier one stays.
fn insert(best: &mut Vec<Mode>, new: Mode, modes: usize, same: f64) {
    if best.len() == modes && best[modes - 1].agreeing >= new.agreeing {
        return;
    }
    let like = |old: &Mode| {
        old.pose.angle_to(&new.pose) < SAME_ANGLE && old.pose.translation.distance(new.pose.translation) < same
    };
    if best.iter().any(|old| like(old) && old.agreeing >= new.agreeing) {
        return;
    }
    best.retain(|old| !like(old));
    let place = best.iter().position(|old| old.agreeing < new.agreeing).unwrap_or(best.len());
    best.insert(place, new);
    best.truncate(modes);
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::covariance::rotation_from_quat;

    /// Of 200 matches four fifths are wrong; the pose of the others is the first mode.
    #[test]
    fn finds_the_pose_that_a_fifth_of_the_matches_agrees_with() {
        for (seed, scale) in [(1, 1.0), (2, 1.0), (3, 1.6)] {
            let mut rng = Rng::new(seed);
            let truth = Pose {
                rotation: rotation_from_quat(rng.rotation_quat()),
                scale,
                translation: rng.normal_vector() * 20.0,
            };
            let pair = |i: usize| {
                let from = rng.normal_vector() * 10.0;
                let to = if i.is_multiple_of(5) { truth.apply(from) } else { truth.apply(rng.normal_vector() * 10.0) };
                Pair { from, to, weight: 1.0 }
            };
            let pairs: Vec<Pair> = (0..200).map(pair).collect();
            let find = |trials| consensus_poses(&pairs, 0.5, trials, 3, scale != 1.0, Rng::new(seed));
            let found = find(20_000);
            assert!(found[0].angle_to(&truth) < 0.02 && (found[0].scale / scale - 1.0).abs() < 0.01, "{:?}", found[0]);
            assert!(found[0].translation.distance(truth.translation) < 0.3);
            assert!(
                found
                    .iter()
                    .skip(1)
                    .all(|p| p.angle_to(&found[0]) > SAME_ANGLE || p.translation.distance(found[0].translation) > 2.0)
            );
            assert_eq!(found, find(20_000), "the same seed, the same poses");
            assert!(find(0).is_empty() && consensus_poses(&pairs[..2], 0.5, 100, 3, false, Rng::new(1)).is_empty());
        }
    }

    #[test]
    fn only_mutual_matches_count() {
        let feature = |v: f32| -> Feature { std::array::from_fn(|_| v) };
        let (a, b) = ([feature(0.0), feature(1.0), feature(1.1)], [feature(1.02), feature(0.1)]);
        assert_eq!(mutual_matches(&a, &b), [(0, 1), (1, 0)]);
        assert!(mutual_matches(&a, &[]).is_empty() && mutual_matches(&[], &b).is_empty());
        assert!(mutual_matches(&[feature(f32::NAN)], &b).is_empty());
    }
}
