//! Iterative closest points (ICP): trimmed, point to point.

use glam::DVec3;

use super::pose::{Pair, Pose, best_pose};
use super::surface::{Followed, Surface, reach_of};

/// Part of the pairs that is kept, nearest first: the rest may be parts that one object lacks.
const TRIM: f64 = 0.9;
/// Points farther than this from the other surface are not matched, voxels of the level.
const REACH: f64 = 4.0;
/// The iteration ends when a step moves no point by more than this part of a voxel.
const SETTLED: f64 = 1e-3;
/// A start is dropped when it comes this near to a known pose, voxels: it would converge to the same pose.
const JOINED: f64 = 0.25;

/// Largest distance of an inlier from the other surface, base voxels.
pub(super) const INLIER_VOXELS: f64 = 1.5;
/// Distances are clamped to this, base voxels: beyond it the surfaces just differ.
pub(super) const MOST_VOXELS: f64 = 3.0;

/// Options of [`icp`] and [`icp_apart`].
#[derive(Clone, Copy, Debug)]
pub(super) struct IcpOptions {
    /// Largest number of steps.
    pub steps: usize,
    /// Whether the scale is free.
    pub allow_scale: bool,
}

/// Refines `start` so that `data`, points of the target, lies on `model`, points of the reference at a finer level.
pub(super) fn icp(model: &Surface, data: &Surface, start: Pose, options: IcpOptions) -> Pose {
    icp_apart(model, data, start, options, &[]).unwrap_or(start)
}

/// Like [`icp`]; `None` as soon as a step ends so near to one of `known` that it would converge to it.
pub(super) fn icp_apart(
    model: &Surface,
    data: &Surface,
    start: Pose,
    options: IcpOptions,
    known: &[Pose],
) -> Option<Pose> {
    let reach = reach_of(data);
    let (mut pose, mut followed) = (start, Followed::new(model, data.len()));
    for _ in 0..options.steps {
        let pairs = closest_pairs(model, &mut followed, data, &pose);
        let Some(next) = best_pose(&pairs, options.allow_scale) else { break };
        let moved = next.movement_from(&pose, reach);
        pose = next;
        if known.iter().any(|known| pose.movement_from(known, reach) <= JOINED * data.voxel) {
            return None;
        }
        if moved <= SETTLED * data.voxel {
            break;
        }
    }
    Some(pose)
}

/// Pairs each point of `data` with the nearest one of `model`, without pairs beyond reach and the farthest ones.
fn closest_pairs(model: &Surface, followed: &mut Followed<'_>, data: &Surface, pose: &Pose) -> Vec<Pair> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::with_capacity(data.len());
    for (i, &to) in data.positions.iter().enumerate() {
        if let Some((j, distance)) = followed.nearest(i, pose.apply_inverse(to), f64::INFINITY) {
            pairs.push((distance * pose.scale, i, j));
        }
    }
    let kept = (TRIM * pairs.len() as f64).ceil() as usize;
    if kept < pairs.len() {
        pairs.select_nth_unstable_by(kept, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pairs.truncate(kept);
    }
    let reach = REACH * data.voxel;
    let within = pairs.iter().filter(|(distance, ..)| *distance <= reach);
    within.map(|&(_, i, j)| Pair { from: model.positions[j], to: data.positions[i], weight: 1.0 }).collect()
}

/// How well a pose aligns the reference with the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Sum of the mean distances from target to reference and back, base voxels; each distance is clamped to
    /// [`MOST_VOXELS`].
    pub cost: f64,
    /// The mean distance from target to reference alone: parts that the target lacks do not count.
    pub cost_there: f64,
    /// Part of the target's points that are inliers, 0..=1.
    pub inliers: f64,
    /// Part of the reference's points near the target, 0..=1; lower if the target was seen in part.
    pub covered: f64,
    /// Root mean square distance of the inliers, scene units.
    pub rmse: f64,
}

/// Mean distance of the target's points from the reference's, in voxels of the target, each clamped to [`MOST_VOXELS`].
pub(super) fn mean_distance(model: &Surface, data: &Surface, pose: &Pose) -> f64 {
    let distance = |p: DVec3| model.nearest(pose.apply_inverse(p)).map_or(f64::INFINITY, |n| n.1 * pose.scale);
    let sum: f64 = data.positions.iter().map(|&p| (distance(p) / data.voxel).min(MOST_VOXELS)).sum();
    sum / data.len().max(1) as f64
}

/// A surface at the resolution of one level, with the same surface at the finest.
#[derive(Clone, Copy)]
pub(super) struct LevelSurface<'a> {
    /// The points that are judged.
    pub points: &'a Surface,
    /// The points that distances are taken to.
    pub finest: &'a Surface,
}

/// Evaluates a pose with the points of one level; distances are taken to the finer `fine_model` and `fine_data`.
pub(super) fn fit(model: LevelSurface<'_>, data: LevelSurface<'_>, pose: &Pose) -> Fit {
    let to_model = |p: DVec3| model.finest.nearest(pose.apply_inverse(p)).map_or(f64::INFINITY, |n| n.1 * pose.scale);
    let to_data = |p: DVec3| data.finest.nearest(pose.apply(p)).map_or(f64::INFINITY, |n| n.1);
    let (model, data) = (model.points, data.points);
    let there: Vec<f64> = data.positions.iter().map(|&p| to_model(p) / data.voxel).collect();
    let back: Vec<f64> = model.positions.iter().map(|&p| to_data(p) / data.voxel).collect();
    let mean = |all: &[f64]| all.iter().map(|d| d.min(MOST_VOXELS)).sum::<f64>() / all.len().max(1) as f64;
    let near: Vec<f64> = there.iter().copied().filter(|d| *d <= INLIER_VOXELS).collect();
    let part = |count: usize, all: &[f64]| count as f64 / all.len().max(1) as f64;
    let squares: f64 = near.iter().map(|d| d * d).sum();
    Fit {
        cost: mean(&there) + mean(&back),
        cost_there: mean(&there),
        inliers: part(near.len(), &there),
        covered: part(back.iter().filter(|d| **d <= INLIER_VOXELS).count(), &back),
        rmse: (squares / near.len().max(1) as f64).sqrt() * data.voxel,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::surface::Sample;
    use glam::DMat3;
    use instgs_vk::math::rng::Rng;

    /// Points on the faces of three boxes, a shape without symmetry.
    fn shape(rng: &mut Rng, count: usize) -> Vec<DVec3> {
        let boxes = [
            (DVec3::ZERO, DVec3::new(8.0, 4.0, 2.0)),
            (DVec3::new(5.0, 1.0, 2.0), DVec3::new(2.0, 2.0, 3.0)),
            (DVec3::new(-6.0, -2.0, 2.0), DVec3::new(1.0, 1.0, 1.5)),
        ];
        let point = |i: usize| {
            let (middle, half) = boxes[[0, 0, 0, 1, 2][i % 5]];
            let mut p = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
            let axis = rng.index(3);
            p[axis] = p[axis].signum();
            middle + half * p
        };
        (0..count).map(point).collect()
    }

    fn surface(points: impl Iterator<Item = DVec3>, voxel: f64) -> Surface {
        let samples = points.map(|position| Sample { position, normal: DVec3::Z, color: DVec3::ZERO });
        Surface::new(&samples.collect::<Vec<_>>(), voxel)
    }

    fn levels(points: &[DVec3]) -> (Surface, Surface) {
        (surface(points.iter().copied(), 0.5), surface(points.iter().copied(), 0.25))
    }

    /// Different samples of the same shape with noise of a tenth of a voxel, a fifth of the target unseen, and starts
    /// off by 15 degrees and three voxels.
    #[test]
    fn finds_the_pose_from_nearby_and_judges_it() {
        for (seed, scale) in [(1, 1.0), (2, 1.0), (3, 1.1)] {
            let mut rng = Rng::new(seed);
            let (model, fine_model) = levels(&shape(&mut rng, 9000));
            let truth = Pose {
                rotation: DMat3::from_axis_angle(rng.unit_vector(), 2.0),
                scale,
                translation: rng.normal_vector() * 3.0,
            };
            let target: Vec<DVec3> = shape(&mut rng, 9000)
                .into_iter()
                .filter(|p| p.x < 5.5)
                .map(|p| truth.apply(p) + 0.05 * rng.normal_vector())
                .collect();
            let (data, fine_data) = levels(&target);
            let start = Pose {
                rotation: DMat3::from_axis_angle(rng.unit_vector(), 0.26) * truth.rotation,
                scale: 1.0,
                translation: truth.translation + 1.5 * rng.unit_vector(),
            };
            let found = icp(&fine_model, &data, start, IcpOptions { steps: 60, allow_scale: scale != 1.0 });
            let (turn, shift) = (found.angle_to(&truth).to_degrees(), found.translation.distance(truth.translation));
            assert!(turn < 0.6 && shift < 0.1 && (found.scale / scale - 1.0).abs() < 0.01, "{turn} {shift} {found:?}");
            let judged = |pose| {
                let model = LevelSurface { points: &model, finest: &fine_model };
                fit(model, LevelSurface { points: &data, finest: &fine_data }, pose)
            };
            let (good, bad) = (judged(&found), judged(&start));
            assert!(good.inliers > 0.95 && good.covered < 0.97 && good.cost < 0.5 * bad.cost, "{good:?} {bad:?}");
        }
    }

    /// A start near a known pose gives nothing new; with only another pose known, it converges.
    #[test]
    fn what_is_on_its_way_to_a_known_pose_is_given_up() {
        let mut rng = Rng::new(4);
        let ((model, fine_model), options) =
            (levels(&shape(&mut rng, 9000)), IcpOptions { steps: 60, allow_scale: false });
        let start = Pose { translation: DVec3::X * 0.7, ..Pose::IDENTITY };
        let found = |known: &[Pose]| icp_apart(&fine_model, &model, start, options, known);
        let off = Pose { translation: DVec3::Y * 3.0, ..Pose::IDENTITY };
        assert_eq!(found(&[off]), Some(icp(&fine_model, &model, start, options)));
        assert_eq!(found(&[off, Pose::IDENTITY]), None);
    }

    #[test]
    fn empty_and_degenerate_sets_leave_the_start() {
        let options = IcpOptions { steps: 5, allow_scale: true };
        let start = Pose { translation: DVec3::X, ..Pose::IDENTITY };
        let (none, one) = (surface([].into_iter(), 1.0), surface([DVec3::ZERO].into_iter(), 1.0));
        for (model, data) in [(&none, &none), (&one, &none), (&none, &one), (&one, &one)] {
            assert_eq!(icp(model, data, start, options), start);
            let level = |points| LevelSurface { points, finest: points };
            let fit = fit(level(model), level(data), &start);
            assert!(fit.cost.is_finite() && fit.inliers.is_finite() && fit.rmse.is_finite(), "{fit:?}");
        }
        // Points on a line leave the turn about it free; that is no failure.
        let line = surface((0..40).map(|i| DVec3::X * f64::from(i)), 1.0);
        let found = icp(&line, &line, Pose { translation: DVec3::X * 0.3, ..start }, options);
        assert!(found.is_finite() && found.translation.length() < 1e-6, "{found:?}");
    }
}
