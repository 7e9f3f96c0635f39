//! Plays the steps of a script as events of the window.

use std::path::Path;

use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{DeviceId, ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};

use super::{After, Live, WindowJob};
use crate::controls::Button;
use crate::error::PlayerError;
use crate::gpu::GpuError;
use crate::io::IoError;
use crate::script::Step;

/// Frames that a script waits at most for the window to take a size.
const RESIZE_PICTURES: u32 = 100;

impl Live {
    /// Plays the next step of the script.
    pub(super) fn play_step(&mut self, job: &WindowJob) -> Result<After, PlayerError> {
        let Some(step) = self.script.pop_front() else { return Ok(After::Nothing) };
        match step {
            Step::Size([width, height]) => {
                let wanted = PhysicalSize::new(width, height);
                if self.waited == 0 {
                    let _ = self.window.request_inner_size(wanted);
                }
                self.waited = if self.window.inner_size() == wanted { 0 } else { (self.waited + 1) % RESIZE_PICTURES };
                if self.waited > 0 {
                    self.script.push_front(step);
                }
            }
            Step::Pointer([x, y]) => {
                let position = PhysicalPosition::new(x, y);
                let device_id = DeviceId::dummy();
                self.event(&WindowEvent::CursorMoved { device_id, position }, job)?;
            }
            Step::Button(button, down) => self.play_button(button, down, job)?,
            Step::DoubleClick => {
                for down in [true, false, true, false] {
                    self.play_button(Button::Left, down, job)?;
                }
            }
            Step::Wheel(steps) => {
                let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
                let delta = MouseScrollDelta::LineDelta(0.0, steps as f32);
                self.event(&WindowEvent::MouseWheel { device_id, delta, phase }, job)?;
            }
            Step::Key { code, control, shift } => {
                (self.controls.control, self.controls.shift) = (control, shift);
                let after = self.key_event(code, true, false, false)?;
                self.key_event(code, false, false, false)?;
                (self.controls.control, self.controls.shift) = (false, false);
                return Ok(after);
            }
            Step::Hold(code, down) => {
                self.key_event(code, down, false, false)?;
            }
            Step::Wait => {}
            Step::Found => {
                if self.boxing.is_searching() {
                    self.script.push_front(step);
                }
            }
            Step::Boxes(path) => self.save_boxes(&path),
            Step::Shot(path) => self.viewer.screenshot(&path)?,
            Step::Counts(path) => self.write_counts(&path)?,
            Step::Lose => return Err(GpuError::DeviceLost { last_pass: "a script's lose".into() }.into()),
            Step::Drop(path) => {
                self.event(&WindowEvent::DroppedFile(path), job)?;
            }
            Step::Close => return Ok(self.close()),
            Step::Quit => return Ok(After::Quit),
        }
        Ok(After::Redraw)
    }

    /// Writes the device's [`SubmissionCounts`](crate::gpu::SubmissionCounts) as JSON.
    fn write_counts(&self, path: &Path) -> Result<(), PlayerError> {
        let counts = self.gpu.submission_counts();
        let json = serde_json::json!({
            "submissions": counts.submissions, "waits": counts.waits, "drains": counts.drains,
        });
        Ok(std::fs::write(path, json.to_string()).map_err(|error| IoError::new(path, error.to_string()))?)
    }

    fn play_button(&mut self, button: Button, down: bool, job: &WindowJob) -> Result<(), PlayerError> {
        let (device_id, button) = (DeviceId::dummy(), mouse_button(button));
        let state = if down { ElementState::Pressed } else { ElementState::Released };
        self.event(&WindowEvent::MouseInput { device_id, state, button }, job)?;
        Ok(())
    }
}

fn mouse_button(button: Button) -> MouseButton {
    match button {
        Button::Left => MouseButton::Left,
        Button::Right => MouseButton::Right,
        Button::Middle => MouseButton::Middle,
    }
}
