//! Plays the steps of a script as events of the window.

use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{DeviceId, ElementState, MouseButton, MouseScrollDelta, TouchPhase, WindowEvent};

use super::{After, Live};
use crate::controls::Button;
use crate::error::PlayerError;
use crate::panel_texts::{Target, place_of};
use crate::script::Step;
use instgs_io::picture_png::write_png;
use instgs_vk::gpu::GpuError;

/// Frames that a script waits at most for the window to take a size.
const RESIZE_PICTURES: u32 = 100;
/// Frames that a script waits at most for a widget to appear.
const WIDGET_PICTURES: u32 = 60;

impl Live {
    /// Plays the next step of the script; the first step waits for the first scene.
    pub(super) fn play_step(&mut self) -> Result<After, PlayerError> {
        if self.is_reading_first() {
            return Ok(After::Nothing);
        }
        let Some(step) = self.playback.script.pop_front() else { return Ok(After::Nothing) };
        if self.play_in_panels(&step)? {
            return Ok(After::Redraw);
        }
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
            Step::Pointer(at_px) => self.play_pointer(at_px)?,
            Step::Button(button, down) => self.play_button(button, down)?,
            Step::DoubleClick => {
                for down in [true, false, true, false] {
                    self.play_button(Button::Left, down)?;
                }
            }
            Step::Wheel(steps) => {
                let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
                let delta = MouseScrollDelta::LineDelta(0.0, steps as f32);
                self.event(&WindowEvent::MouseWheel { device_id, delta, phase })?;
            }
            Step::Pinch(delta) => {
                let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
                self.event(&WindowEvent::PinchGesture { device_id, delta, phase })?;
            }
            Step::Pan([x, y]) => {
                let (device_id, phase) = (DeviceId::dummy(), TouchPhase::Moved);
                let delta = PhysicalPosition::new(x as f32, y as f32);
                self.event(&WindowEvent::PanGesture { device_id, delta, phase })?;
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
            // `play_in_panels` plays these.
            Step::Tap(_) | Step::Over(_) | Step::Type(_) | Step::Enter => {}
            Step::Screen(path) => self.playback.screen = Some(path),
            Step::Begin(path) => {
                self.playback.holds_file = true;
                self.event(&WindowEvent::DroppedFile(path))?;
            }
            Step::Opened => {
                self.playback.holds_file = false;
                if self.is_reading() {
                    self.playback.script.push_front(Step::Opened);
                }
            }
            Step::Found => {
                if self.input.boxing.is_searching() {
                    self.playback.script.push_front(step);
                }
            }
            Step::Boxes(path) => self.save_boxes(&path),
            Step::Shot(path) => {
                self.session.viewer.complete()?;
                self.session.viewer.screenshot(&path)?;
            }
            Step::Counts(path) => self.session.write_counts(&path)?,
            Step::Lose => return Err(GpuError::DeviceLost { last_pass: "a script's lose".into() }.into()),
            Step::Drop(path) => {
                self.event(&WindowEvent::DroppedFile(path))?;
            }
            Step::Close => return Ok(self.close()),
            Step::Quit => return Ok(After::Quit),
        }
        Ok(After::Redraw)
    }

    /// Plays a step whose input goes to the panels; false for other steps.
    fn play_in_panels(&mut self, step: &Step) -> Result<bool, PlayerError> {
        match step {
            Step::Tap(target) | Step::Over(target) => self.seek(step, target)?,
            Step::Type(text) => {
                let events = &mut self.screen.ui.egui_input_mut().events;
                events.extend(key_of_panel(egui::Key::A, egui::Modifiers::COMMAND));
                events.extend(key_of_panel(egui::Key::Backspace, egui::Modifiers::NONE));
                events.push(egui::Event::Text(text.clone()));
            }
            Step::Enter => {
                let enter = key_of_panel(egui::Key::Enter, egui::Modifiers::NONE);
                self.screen.ui.egui_input_mut().events.extend(enter);
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Moves the pointer onto a widget, once that is at the same place in two frames, and clicks it if the step says so.
    fn seek(&mut self, step: &Step, target: &Target) -> Result<(), PlayerError> {
        let place = place_of(&self.playback.texts, target);
        let rests = place.is_some() && place == self.playback.sought;
        self.playback.sought = place;
        let Some(place) = place.filter(|_| rests) else {
            self.playback.script.push_front(step.clone());
            self.playback.waited += 1;
            if self.playback.waited < WIDGET_PICTURES {
                return Ok(());
            }
            let there: Vec<&str> = self.playback.texts.iter().map(|text| text.text.as_str()).collect();
            let Target { text, along } = target;
            return Err(PlayerError::Script(format!("there is no {text:?} {along:+} among {there:?}")));
        };
        (self.playback.waited, self.playback.sought) = (0, None);
        let at_px = [place.x, place.y].map(|v| f64::from(v) * self.screen.per_point());
        self.play_pointer(at_px)?;
        if let Step::Tap(_) = step {
            self.play_button(Button::Left, true)?;
            self.playback.script.push_front(Step::Wait);
            self.playback.script.push_front(Step::Button(Button::Left, false));
        }
        Ok(())
    }

    /// Prepares the capture of the window that a script has asked for.
    pub(super) fn begin_capture(&mut self) -> Result<(), PlayerError> {
        if self.playback.screen.is_some() {
            self.screen.swapchain.capture_next()?;
        }
        Ok(())
    }

    /// Writes the captured window.
    pub(super) fn end_capture(&mut self) -> Result<(), PlayerError> {
        let Some(path) = self.playback.screen.take() else { return Ok(()) };
        let [width, height] = self.screen.swapchain.size_px();
        if let Some(rgb) = self.screen.swapchain.take_captured()? {
            write_png(&path, &rgb, (width, height))?;
        }
        Ok(())
    }

    fn play_pointer(&mut self, [x, y]: [f64; 2]) -> Result<(), PlayerError> {
        let (device_id, position) = (DeviceId::dummy(), PhysicalPosition::new(x, y));
        self.event(&WindowEvent::CursorMoved { device_id, position })?;
        Ok(())
    }

    fn play_button(&mut self, button: Button, down: bool) -> Result<(), PlayerError> {
        let (device_id, button) = (DeviceId::dummy(), mouse_button(button));
        let state = if down { ElementState::Pressed } else { ElementState::Released };
        self.event(&WindowEvent::MouseInput { device_id, state, button })?;
        Ok(())
    }
}

/// A key pressed and released in the panels.
fn key_of_panel(key: egui::Key, modifiers: egui::Modifiers) -> [egui::Event; 2] {
    [true, false].map(|pressed| egui::Event::Key { key, physical_key: None, pressed, repeat: false, modifiers })
}

fn mouse_button(button: Button) -> MouseButton {
    match button {
        Button::Left => MouseButton::Left,
        Button::Right => MouseButton::Right,
        Button::Middle => MouseButton::Middle,
    }
}
