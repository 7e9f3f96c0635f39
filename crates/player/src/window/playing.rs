//! Plays the steps of a script as events of the window.

use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{DeviceId, ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};

use super::{After, Live, WindowJob};
use crate::controls::Button;
use crate::error::PlayerError;
use crate::script::Step;
use instgs_vk::gpu::GpuError;

/// Frames that a script waits at most for the window to take a size.
const RESIZE_PICTURES: u32 = 100;

impl Live {
    /// Plays the next step of the script.
    pub(super) fn play_step(&mut self, job: &WindowJob) -> Result<After, PlayerError> {
        let Some(step) = self.playback.script.pop_front() else { return Ok(After::Nothing) };
        match step {
            Step::Size([width, height]) => {
                let wanted = PhysicalSize::new(width, height);
                if self.playback.waited == 0 {
                    let _ = self.screen.window.request_inner_size(wanted);
                }
                self.playback.waited = if self.screen.window.inner_size() == wanted {
                    0
                } else {
                    (self.playback.waited + 1) % RESIZE_PICTURES
                };
                if self.playback.waited > 0 {
                    self.playback.script.push_front(step);
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
                (self.input.controls.control, self.input.controls.shift) = (control, shift);
                let after = self.key_event(code, true, false, false)?;
                self.key_event(code, false, false, false)?;
                (self.input.controls.control, self.input.controls.shift) = (false, false);
                return Ok(after);
            }
            Step::Hold(code, down) => {
                self.key_event(code, down, false, false)?;
            }
            Step::Wait => {}
            Step::Found => {
                if self.input.boxing.is_searching() {
                    self.playback.script.push_front(step);
                }
            }
            Step::Boxes(path) => self.save_boxes(&path),
            Step::Shot(path) => self.session.viewer.screenshot(&path)?,
            Step::Counts(path) => self.session.write_counts(&path)?,
            Step::Lose => return Err(GpuError::DeviceLost { last_pass: "a script's lose".into() }.into()),
            Step::Drop(path) => {
                self.event(&WindowEvent::DroppedFile(path), job)?;
            }
            Step::Close => return Ok(self.close()),
            Step::Quit => return Ok(After::Quit),
        }
        Ok(After::Redraw)
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
