//! The last steps of refinement, point to plane. Two samplings of a surface share no points, so steps to nearest points
//! resist sliding along the surface; steps to planes do not.

use glam::{DMat3, DVec3};

use super::pose::Pose;
use super::surface::{Followed, Surface, reach_of};
use instgs_vk::math::eigen::symmetric_eigen;

/// Unknowns: rotation (3), translation (3), scale.
const UNKNOWNS: usize = 7;
/// Directions that the planes constrain this much less than the best one are not changed: an object may be round or
/// flat.
const LEAST_EIGENVALUE: f64 = 1e-4;
/// Distance from the plane at which a point has half its weight, voxels of the model.
const HALF_WEIGHT: f64 = 0.5;
/// Points farther than this from the model are not matched, voxels of the data.
const REACH: f64 = 1.5;
/// The iteration ends when a step moves no point by more than this part of a voxel.
const SETTLED: f64 = 1e-3;
/// Cosine of the largest angle between the normals of matched points: excludes the other side of thin parts.
const SAME_SIDE: f64 = 0.5;

/// Options of [`slide`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Slide {
    /// Largest number of steps.
    pub steps: usize,
    /// Whether the scale is free.
    pub allow_scale: bool,
    /// The only axis of rotation, a unit vector; `None` = any.
    pub axis: Option<DVec3>,
}

/// Refines `start` so that `data`, points of the target, lies on the tangent planes of `model`, points of the
/// reference. Both need unit normals.
pub(super) fn slide(model: &Surface, data: &Surface, start: Pose, options: Slide) -> Pose {
    let reach = reach_of(data);
    let (mut pose, mut followed) = (start, Followed::new(model, data.len()));
    for _ in 0..options.steps {
        let next = step(model, &mut followed, data, reach, &pose, options);
        if !next.is_finite() {
            return pose;
        }
        let moved = next.movement_from(&pose, reach);
        pose = next;
        if moved < SETTLED * data.voxel {
            break;
        }
    }
    pose
}

/// One Gauss-Newton step in the target's frame. Rotations are scaled to lengths at the radius `reach`.
fn step(model: &Surface, followed: &mut Followed<'_>, data: &Surface, reach: f64, pose: &Pose, options: Slide) -> Pose {
    let (mut matrix, mut right) = ([[0.0; UNKNOWNS]; UNKNOWNS], [0.0; UNKNOWNS]);
    let far = REACH * data.voxel / pose.scale;
    for (i, (&q, q_normal)) in data.positions.iter().zip(&data.normals).enumerate() {
        let Some((j, distance)) = followed.nearest(i, pose.apply_inverse(q), far) else { continue };
        let normal = pose.rotation * model.normals[j];
        if distance * pose.scale > REACH * data.voxel || normal.dot(*q_normal) < SAME_SIDE {
            continue;
        }
        let x = pose.apply(model.positions[j]);
        let off = normal.dot(q - x);
        let weight = 1.0 / (1.0 + (off / (HALF_WEIGHT * model.voxel * pose.scale)).powi(2));
        let turn = x.cross(normal) / reach;
        let turn = options.axis.map_or(turn, |axis| axis * axis.dot(turn));
        let growth = if options.allow_scale { (x - pose.translation).dot(normal) / reach } else { 0.0 };
        let row = [turn.x, turn.y, turn.z, normal.x, normal.y, normal.z, growth];
        for a in 0..UNKNOWNS {
            right[a] += weight * row[a] * off;
            for b in 0..UNKNOWNS {
                matrix[a][b] += weight * row[a] * row[b];
            }
        }
    }
    let [a, b, c, x, y, z, growth] = solved(matrix, right);
    let turn = DVec3::new(a, b, c) / reach;
    let rotation = DMat3::from_axis_angle(turn.try_normalize().unwrap_or(DVec3::X), turn.length());
    Pose {
        rotation: rotation * pose.rotation,
        scale: pose.scale * (1.0 + growth / reach),
        translation: rotation * pose.translation + DVec3::new(x, y, z),
    }
}

/// The minimum-norm solution in the directions that the matrix constrains.
fn solved(matrix: [[f64; UNKNOWNS]; UNKNOWNS], right: [f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
    let pairs = symmetric_eigen(matrix);
    let least = LEAST_EIGENVALUE * pairs[UNKNOWNS - 1].0;
    let mut out = [0.0; UNKNOWNS];
    for (value, vector) in pairs.iter().filter(|(value, _)| *value > least) {
        let along = vector.iter().zip(&right).map(|(v, r)| v * r).sum::<f64>() / value;
        out.iter_mut().zip(vector).for_each(|(sum, v)| *sum += along * v);
    }
    out
}
