//! Poses in f64, and the least-squares pose for pairs of points.

use glam::{DMat3, DVec3};

use instgs_vk::math::covariance::rotation_from_quat;
use instgs_vk::math::eigen::symmetric_eigen;

/// x -> s R x + t, from the reference's local frame to the target's. A local frame has the world's axes and unit, and
/// its origin at the centroid of the object's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// R, a rotation matrix without reflection.
    pub rotation: DMat3,
    /// Uniform scale s > 0.
    pub scale: f64,
    /// Translation t, scene units.
    pub translation: DVec3,
}

impl Pose {
    /// The pose that moves nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// A rotation about the origin.
    pub fn from_rotation(rotation: DMat3) -> Self {
        Self { rotation, ..Self::IDENTITY }
    }

    /// The image of a point of the reference's frame.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.rotation * p * self.scale + self.translation
    }

    /// The point of the reference's frame whose image is `q`.
    pub fn apply_inverse(&self, q: DVec3) -> DVec3 {
        self.rotation.transpose() * (q - self.translation) / self.scale
    }

    /// The composition that applies `first`, then `self`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            scale: self.scale * first.scale,
            translation: self.apply(first.translation),
        }
    }

    /// The pose from the target's frame to the reference's.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, scale: 1.0 / self.scale, translation: rotation * -self.translation / self.scale }
    }

    /// Angle of the rotation between two poses, radians.
    pub fn angle_to(&self, other: &Self) -> f64 {
        let between = self.rotation.transpose() * other.rotation;
        let trace = between.x_axis.x + between.y_axis.y + between.z_axis.z;
        (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos()
    }

    /// Estimate of how far the change from `before` to `self` moves points at most `reach` from the origin.
    pub fn movement_from(&self, before: &Self, reach: f64) -> f64 {
        let turned = before.angle_to(self) + (self.scale / before.scale - 1.0).abs();
        self.translation.distance(before.translation) + reach * turned
    }

    /// Whether all numbers are finite and the scale is above 0.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.scale.is_finite() && self.scale > 0.0 && self.translation.is_finite()
    }
}

/// Two points that should coincide after the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Point in the frame that the pose maps from.
    pub from: DVec3,
    /// Point in the frame that the pose maps to.
    pub to: DVec3,
    /// Weight in the sum of squares, >= 0.
    pub weight: f64,
}

/// The pose with the least weighted squared distance from the images of `from` to `to` (Umeyama 1991), by Horn's unit
/// quaternion, which never gives a reflection. The scale is 1 unless `allow_scale`. `None` if the pairs fix no
/// rotation: fewer than three, or all points of one side coincide. Points on a line fix it up to a turn about the line.
pub fn best_pose(pairs: &[Pair], allow_scale: bool) -> Option<Pose> {
    let total: f64 = pairs.iter().map(|p| p.weight).sum();
    if pairs.len() < 3 || !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let mean = |of: fn(&Pair) -> DVec3| pairs.iter().map(|p| of(p) * p.weight).sum::<DVec3>() / total;
    let (from, to) = (mean(|p| p.from), mean(|p| p.to));
    // Column a of `products` sums coordinate a of `from` times `to`.
    let mut products = DMat3::ZERO;
    let (mut from_squared, mut to_squared) = (0.0, 0.0);
    for pair in pairs {
        let (p, q) = (pair.from - from, pair.to - to);
        products += DMat3::from_cols(q * p.x, q * p.y, q * p.z) * pair.weight;
        from_squared += pair.weight * p.length_squared();
        to_squared += pair.weight * q.length_squared();
    }
    let rotation = rotation_of(&products, (from_squared * to_squared).sqrt())?;
    let along = (0..3).map(|axis| products.col(axis).dot(rotation.col(axis))).sum::<f64>();
    let scale = if allow_scale { along / from_squared } else { 1.0 };
    let pose = Pose { rotation, scale, translation: to - rotation * from * scale };
    pose.is_finite().then_some(pose)
}

/// The rotation R that maximises the trace of R^T `products`, by Horn's largest eigenvector; `None` if it is not
/// determined. `size` is an upper bound of the largest eigenvalue.
fn rotation_of(products: &DMat3, size: f64) -> Option<DMat3> {
    let s = |a: usize, b: usize| products.col(a)[b];
    let (yz, zx, xy) = (s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0));
    let (x, y, z) = (s(0, 0), s(1, 1), s(2, 2));
    let (sum_xy, sum_zx, sum_yz) = (s(0, 1) + s(1, 0), s(2, 0) + s(0, 2), s(1, 2) + s(2, 1));
    let matrix = [
        [x + y + z, yz, zx, xy],
        [yz, x - y - z, sum_xy, sum_zx],
        [zx, sum_xy, y - x - z, sum_yz],
        [xy, sum_zx, sum_yz, z - x - y],
    ];
    let (value, quat) = symmetric_eigen(matrix)[3];
    // A relative bound of 1e-12: smaller eigenvalues are rounding errors.
    let fixed = value > 1e-12 * size;
    let rotation = rotation_from_quat(quat);
    (fixed && rotation.is_finite()).then_some(rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    fn drawn_pose(rng: &mut Rng, scale: f64) -> Pose {
        Pose { rotation: rotation_from_quat(rng.rotation_quat()), scale, translation: rng.normal_vector() * 3.0 }
    }

    fn pairs(rng: &mut Rng, pose: &Pose, flatten: DVec3) -> Vec<Pair> {
        let points = (0..40).map(|_| rng.normal_vector() * flatten);
        points.map(|from| Pair { from, to: pose.apply(from), weight: 1.0 + from.x.abs() }).collect()
    }

    fn difference(a: &Pose, b: &Pose) -> f64 {
        let turned = (a.rotation - b.rotation).to_cols_array().iter().fold(0.0f64, |m, v| m.max(v.abs()));
        turned.max((a.scale - b.scale).abs()).max((a.translation - b.translation).length())
    }

    /// Exact poses are recovered, also from coplanar points, where a singular value decomposition may reflect.
    #[test]
    fn recovers_poses_of_solid_and_flat_sets() {
        let mut rng = Rng::new(1);
        for flatten in [DVec3::ONE, DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.0, 0.01, 1e-5)] {
            for scale in [1.0, 0.3, 4.0] {
                let pose = drawn_pose(&mut rng, scale);
                let pairs = pairs(&mut rng, &pose, flatten);
                let found = best_pose(&pairs, true).unwrap();
                assert!(difference(&found, &pose) < 1e-9, "{flatten}: {}", difference(&found, &pose));
                let rigid = best_pose(&pairs, false).unwrap();
                assert!(rigid.scale == 1.0 && rigid.angle_to(&pose) < 1e-6);
            }
        }
    }

    /// A mirrored set has no exact pose; the result is still a rotation.
    #[test]
    fn never_mirrors() {
        let mut rng = Rng::new(2);
        let points: Vec<DVec3> = (0..30).map(|_| rng.normal_vector()).collect();
        let mirrored = points.iter().map(|&from| Pair { from, to: from * DVec3::new(-1.0, 1.0, 1.0), weight: 1.0 });
        let pose = best_pose(&mirrored.collect::<Vec<_>>(), true).unwrap();
        assert!((pose.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn weights_count_and_degenerate_sets_have_no_pose() {
        let mut rng = Rng::new(3);
        let pose = drawn_pose(&mut rng, 1.0);
        let mut with_strays = pairs(&mut rng, &pose, DVec3::ONE);
        with_strays.push(Pair { from: DVec3::ZERO, to: DVec3::splat(100.0), weight: 0.0 });
        assert!(difference(&best_pose(&with_strays, false).unwrap(), &pose) < 1e-12);
        with_strays[40].weight = 1.0;
        assert!(difference(&best_pose(&with_strays, false).unwrap(), &pose) > 0.1);
        let at = |from, to| Pair { from, to, weight: 1.0 };
        let one = at(DVec3::ONE, DVec3::X);
        for set in
            [vec![], vec![one; 2], vec![one; 9], vec![at(DVec3::NAN, DVec3::ONE); 5], vec![at(DVec3::X, DVec3::Y); 3]]
        {
            assert_eq!(best_pose(&set, true), None, "{set:?}");
        }
        let line: Vec<Pair> = (0..9).map(|i| at(DVec3::X * f64::from(i), DVec3::Y * f64::from(i))).collect();
        let along = best_pose(&line, true).unwrap();
        assert!((along.apply(DVec3::X) - DVec3::Y).length() < 1e-12);
    }

    #[test]
    fn poses_compose_and_invert() {
        let mut rng = Rng::new(4);
        let (a, b) = (drawn_pose(&mut rng, 0.5), drawn_pose(&mut rng, 3.0));
        let p = rng.normal_vector();
        assert!((a.after(&b).apply(p) - a.apply(b.apply(p))).length() < 1e-12);
        assert!((a.apply_inverse(a.apply(p)) - p).length() < 1e-12);
        assert!(difference(&a.after(&a.inverse()), &Pose::IDENTITY) < 1e-12);
        let turned = Pose::from_rotation(DMat3::from_rotation_z(0.7));
        assert!((turned.angle_to(&Pose::IDENTITY) - 0.7).abs() < 1e-12);
    }
}
