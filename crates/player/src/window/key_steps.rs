//! Keys that move, turn and scale what is chosen, in steps that show from wherever one looks.

use glam::DVec3;
use winit::keyboard::KeyCode;

use super::Live;
use crate::gizmo::Motion;
use instgs_vk::scene::edit::Turn;

/// What an arrow key moves things by, in distances to the target; with shift a tenth of it.
const STEP_OF_DISTANCE: f64 = 0.01;
const FINE: f64 = 0.1;
/// A copy stands so many steps beside its original.
const DUPLICATE_STEPS: f64 = 10.0;
/// What `,` and `.` turn things by: 5 degrees.
const TURN_STEP: f64 = std::f64::consts::PI / 36.0;
/// What `+` and `-` scale things by.
const SCALE_STEP: f64 = 1.05;

impl Live {
    /// World units for a point of dragging a number.
    pub(super) fn number_step(&self) -> f64 {
        FINE * STEP_OF_DISTANCE * self.navigator.distance()
    }

    /// World units that an arrow key moves things by: steps that show, from wherever one looks.
    fn key_step(&self) -> f64 {
        STEP_OF_DISTANCE * self.navigator.distance() * if self.controls.shift { FINE } else { 1.0 }
    }

    /// Where a copy stands from its original, world units.
    pub(super) fn beside(&self) -> DVec3 {
        let [right, ..] = self.navigator.level_axes();
        DUPLICATE_STEPS * self.key_step() * right
    }

    /// How a key moves, turns or scales what is chosen; `None` for others.
    pub(super) fn key_motion(&self, code: KeyCode) -> Option<Motion> {
        let [right, ahead, up] = self.navigator.level_axes();
        let by = |by: DVec3| Motion::Move(self.key_step() * by);
        let turn = |angle: f64| Motion::Turn(Turn { axis: up, angle });
        let angle = TURN_STEP * if self.controls.shift { FINE } else { 1.0 };
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
