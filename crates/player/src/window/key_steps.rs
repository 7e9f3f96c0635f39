//! Keys that move, turn and scale the selection in steps that are visible at the present distance.

use glam::DVec3;
use winit::keyboard::KeyCode;

use super::Live;
use crate::gizmo::Motion;
use instgs_vk::scene::edit::Turn;

/// Step of an arrow key relative to the target distance; with Shift a tenth of it.
const STEP_OF_DISTANCE: f64 = 0.01;
const FINE: f64 = 0.1;
/// Displacement of a copy from its original, in key steps.
const DUPLICATE_STEPS: f64 = 10.0;
/// Rotation per press of `,` or `.`, radians: 5 degrees.
const TURN_STEP: f64 = std::f64::consts::PI / 36.0;
/// Scale factor per press of `+` or `-`.
const SCALE_STEP: f64 = 1.05;

impl Live {
    /// World units per point of dragging a number.
    pub(super) fn number_step(&self) -> f64 {
        FINE * STEP_OF_DISTANCE * self.camera.navigator.distance()
    }

    /// World units per press of an arrow key, which grow with the target distance so that steps are visible.
    fn key_step(&self) -> f64 {
        STEP_OF_DISTANCE * self.camera.navigator.distance() * if self.input.controls.shift { FINE } else { 1.0 }
    }

    /// Displacement of a copy from its original, world units.
    pub(super) fn beside(&self) -> DVec3 {
        let [right, ..] = self.camera.navigator.level_axes();
        DUPLICATE_STEPS * self.key_step() * right
    }

    /// The motion of the selection for a key; `None` for other keys.
    pub(super) fn key_motion(&self, code: KeyCode) -> Option<Motion> {
        let [right, ahead, up] = self.camera.navigator.level_axes();
        let by = |by: DVec3| Motion::Move(self.key_step() * by);
        let turn = |angle: f64| Motion::Turn(Turn { axis: up, angle });
        let angle = TURN_STEP * if self.input.controls.shift { FINE } else { 1.0 };
        Some(match code {
            KeyCode::ArrowLeft => by(-right),
            KeyCode::ArrowRight => by(right),
            KeyCode::ArrowUp => by(ahead),
            KeyCode::ArrowDown => by(-ahead),
            KeyCode::Home => by(up),
            KeyCode::End => by(-up),
            KeyCode::Comma => turn(angle),
            KeyCode::Period => turn(-angle),
            KeyCode::Equal | KeyCode::NumpadAdd => Motion::Scale(SCALE_STEP),
            KeyCode::Minus | KeyCode::NumpadSubtract => Motion::Scale(1.0 / SCALE_STEP),
            _ => return None,
        })
    }
}
