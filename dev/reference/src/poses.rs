//! Twin of passes `gather_pose_gradients` and `refine_poses`: gradients with respect to the poses of instances, and
//! Adam on them.
//!
//! A pose changes in the template's frame: `A' = A e^s exp([w]x)`, `t' = t + A v`. The seven parameters are v (template
//! units), w (radians) and s; gradients are taken at 0, where every step starts.

use glam::{DMat3, DVec3};

use crate::adam::{AdamOptions, AdamState, adam_step};
use instgs_vk::math::similarity::Similarity;

/// The seven pose parameters v, w, s.
pub type PoseStep = [f64; 7];

/// The gradient with respect to v, w and s at 0, from rows of (dL/dA | dL/dt) with every entry of A independent.
pub fn pose_gradient(placement: &Similarity, by_transform: &[[f64; 4]; 3]) -> PoseStep {
    let a = placement.linear();
    let column = |j: usize| DVec3::new(by_transform[0][j], by_transform[1][j], by_transform[2][j]);
    // Uses dA = A ([w]x + s) and dt = A v.
    let by_change = a.transpose() * DMat3::from_cols(column(0), column(1), column(2));
    let n = |i: usize, j: usize| by_change.col(j)[i];
    let by_shift = a.transpose() * column(3);
    let by_turn = DVec3::new(n(2, 1) - n(1, 2), n(0, 2) - n(2, 0), n(1, 0) - n(0, 1));
    let by_scale = n(0, 0) + n(1, 1) + n(2, 2);
    [by_shift.x, by_shift.y, by_shift.z, by_turn.x, by_turn.y, by_turn.z, by_scale]
}

/// The rotation by the angle |w| (radians) about w.
pub fn rotation_of_vector(w: DVec3) -> DMat3 {
    let angle = w.length();
    if angle == 0.0 { DMat3::IDENTITY } else { DMat3::from_axis_angle(w / angle, angle) }
}

/// A pose in f64, with Adam's moments.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseState {
    /// The linear part A = s R.
    pub linear: DMat3,
    /// The translation t, world units.
    pub translation: DVec3,
    /// Moments; its parameters are 0 between steps.
    adam: AdamState,
}

impl PoseState {
    /// The state before the first step.
    pub fn new(placement: &Similarity) -> Self {
        Self { linear: placement.linear(), translation: placement.translation(), adam: AdamState::new(vec![0.0; 7]) }
    }

    /// One step of Adam; `step` counts from 1, `rates` are those of v, w and s, in their units.
    pub fn refine(&mut self, options: &AdamOptions, gradient: &PoseStep, step: u64, rates: [f64; 3]) {
        adam_step(options, &mut self.adam, gradient, step, ([1.0; 2], 7));
        let values = std::mem::replace(&mut self.adam.parameters, vec![0.0; 7]);
        let vector = |first: usize| DVec3::new(values[first], values[first + 1], values[first + 2]);
        self.translation += self.linear * (rates[0] * vector(0));
        self.linear = self.linear * rotation_of_vector(rates[1] * vector(3)) * (rates[2] * values[6]).exp();
    }
}
