//! The axes of a Gaussian in a fixed order: the same ellipsoid has 24 pairs of sizes and rotation.

use glam::{DMat3, DVec3};

use super::covariance::{normalised_quat, quat_from_rotation, quat_multiply};

/// Another order of a Gaussian's axes, in which it is the same ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisOrder {
    /// Index of the size that each axis gets.
    sizes: [u8; 3],
    /// What the rotation is multiplied by from the right, w, x, y, z: a unit quaternion.
    turn: [f32; 4],
}

impl AxisOrder {
    /// The order from the largest to the smallest of `log_scales`. Four rotations go with it, which differ by half turns about
    /// the axes: the one is taken in which w is positive and no other component of `quat` (w, x, y, z) is larger. `quat` must be
    /// finite and not zero.
    pub fn sorted(log_scales: [f32; 3], quat: [f32; 4]) -> Self {
        let mut sizes = [0u8, 1, 2];
        sizes.sort_by(|&a, &b| log_scales[usize::from(b)].total_cmp(&log_scales[usize::from(a)]));
        let [first, second] = [sizes[0], sizes[1]].map(|axis| DVec3::AXES[usize::from(axis)]);
        // The third axis is theirs or the opposite one, which is the same to a Gaussian.
        let new_axes = quat_from_rotation(DMat3::from_cols(first, second, first.cross(second)));
        let quat = normalised_quat(quat.map(f64::from));
        let w_of = |turn: &[f64; 4]| quat_multiply(quat, *turn)[0];
        let half_turns = std::array::from_fn::<_, 4, _>(|i| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        let turns = half_turns.map(|half_turn| quat_multiply(new_axes, half_turn));
        let turn =
            turns.into_iter().reduce(|best, turn| if w_of(&turn).abs() > w_of(&best).abs() { turn } else { best });
        let turn = turn.unwrap_or(new_axes);
        let sign = if w_of(&turn) < 0.0 { -1.0 } else { 1.0 };
        Self { sizes, turn: turn.map(|v| (sign * v) as f32) }
    }

    /// Sizes, or offsets of them, in the new order.
    pub fn sizes(&self, log_scales: [f32; 3]) -> [f32; 3] {
        self.sizes.map(|axis| log_scales[usize::from(axis)])
    }

    /// The quaternion, or an offset of it, that goes with the new order. Lengths stay.
    pub fn quat(&self, quat: [f64; 4]) -> [f64; 4] {
        quat_multiply(quat, self.turn.map(f64::from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::covariance::covariance;
    use crate::math::rng::Rng;

    fn sorted_axes(log_scales: [f32; 3], quat: [f32; 4]) -> ([f32; 3], [f32; 4]) {
        let order = AxisOrder::sorted(log_scales, quat);
        (order.sizes(log_scales), order.quat(quat.map(f64::from)).map(|v| v as f32))
    }

    fn covariance_of(log_scales: [f32; 3], quat: [f32; 4]) -> DMat3 {
        covariance(quat.map(f64::from), DVec3::from_array(log_scales.map(f64::from)))
    }

    #[test]
    fn every_order_of_the_axes_is_the_same_ellipsoid() {
        let mut rng = Rng::new(3);
        for case in 0..500 {
            let scales = [rng.normal() as f32, rng.normal() as f32, rng.normal() as f32];
            let quat: [f32; 4] = std::array::from_fn(|_| rng.normal() as f32);
            let (sorted, turned) = sorted_axes(scales, quat);
            assert!(sorted[0] >= sorted[1] && sorted[1] >= sorted[2], "{case}: {sorted:?}");
            let most = turned.iter().fold(0.0f32, |most, v| most.max(v.abs()));
            assert!(turned[0] == most, "{case}: w is not the largest of {turned:?}");
            let [a, b] = [(scales, quat), (sorted, turned)].map(|(s, q)| covariance_of(s, q));
            let error = (a - b).to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
            let size = a.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
            assert!(error < 1e-6 * size, "{case}: {error} of {size}");
            let length = |q: [f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
            assert!((length(turned) / length(quat) - 1.0).abs() < 1e-6, "{case}");
            // What is in order stays.
            let again = sorted_axes(sorted, turned);
            assert!(again.0 == sorted && again.1.iter().zip(turned).all(|(a, b)| (a - b).abs() < 1e-6), "{case}");
        }
    }

    #[test]
    fn equal_sizes_keep_their_order() {
        let (sorted, turned) = sorted_axes([-1.0, -1.0, -2.0], [2.0, 0.0, 0.0, 0.5]);
        assert_eq!((sorted, turned), ([-1.0, -1.0, -2.0], [2.0, 0.0, 0.0, 0.5]));
    }
}
