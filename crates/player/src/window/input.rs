//! Handles the window's events.

use std::path::Path;

use winit::event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{Key, KeyCode, PhysicalKey};
use winit::window::Fullscreen;

use super::keeping::step;
use super::leaving::Leaving;
use super::{After, Live};
use crate::actions::{Action, Panel};
use crate::controls::{Button, FlightKey};
use crate::error::PlayerError;
use crate::views::View;

/// Points of a touch pad's scroll that count as one step of a wheel.
const POINTS_PER_STEP: f64 = 40.0;
/// Factor on the flight speed per press of a speed key.
const SPEED_STEP: f64 = 1.5;

impl Live {
    /// Handles one event and returns whether to redraw.
    pub(super) fn event(&mut self, event: &WindowEvent) -> Result<After, PlayerError> {
        let response = self.screen.ui.on_window_event(&self.screen.window, event);
        let height = f64::from(self.screen.swapchain.size_px()[1]);
        let changed = match event {
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                self.input.controls.per_point = self.screen.window.scale_factor();
                self.screen.resize()?;
                true
            }
            WindowEvent::Focused(false) => {
                let held = self.let_go()?;
                self.input.controls.let_go();
                held
            }
            WindowEvent::ModifiersChanged(modifiers) => {
                let state = modifiers.state();
                (self.input.controls.shift, self.input.controls.control) =
                    (state.shift_key(), state.control_key() || state.super_key());
                false
            }
            WindowEvent::CursorMoved { position, .. } => {
                let moved =
                    self.input.controls.pointer_moved([position.x, position.y], &mut self.camera.navigator, height);
                moved | self.hover(response.consumed)
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let consumed = response.consumed || self.screen.is_over_interface(self.pointer_points());
                self.button(*state, *button, consumed)?
            }
            WindowEvent::MouseWheel { delta, .. } if !response.consumed => {
                let steps = match delta {
                    MouseScrollDelta::LineDelta(_, y) => f64::from(*y),
                    MouseScrollDelta::PixelDelta(by) => by.y / (POINTS_PER_STEP * self.screen.per_point()),
                };
                self.camera.navigator.zoom(steps, self.input.controls.pointer_px(), self.screen.swapchain.size_px());
                steps != 0.0
            }
            WindowEvent::PinchGesture { delta, .. } if !response.consumed => {
                let (at_px, size_px) = (self.input.controls.pointer_px(), self.screen.swapchain.size_px());
                self.camera.navigator.pinch(*delta, at_px, size_px);
                true
            }
            WindowEvent::PanGesture { delta, .. } if !response.consumed => {
                self.camera.navigator.orbit([delta.x, delta.y].map(f64::from), height);
                true
            }
            // A key that was already held when the window got focus was meant for another window.
            WindowEvent::KeyboardInput { event, is_synthetic, .. } if !(*is_synthetic && event.state.is_pressed()) => {
                let Some(code) = code_of(event, self.input.controls.control) else { return Ok(After::Nothing) };
                let down = event.state == ElementState::Pressed;
                match self.key_event(code, down, event.repeat, response.consumed)? {
                    After::Nothing => false,
                    after => return Ok(after),
                }
            }
            WindowEvent::DroppedFile(path) => {
                self.ask_and_open(path);
                true
            }
            _ => false,
        };
        Ok(if changed || response.repaint { After::Redraw } else { After::Nothing })
    }

    /// Opens a file; if that loses work, asks first. True if the file is read.
    pub(super) fn ask_and_open(&mut self, path: &Path) -> bool {
        let asks = self.asks_first(Leaving::Open(path.to_path_buf()));
        if !asks {
            self.read_beside(path);
        }
        !asks
    }

    fn button(&mut self, state: ElementState, button: MouseButton, consumed: bool) -> Result<bool, PlayerError> {
        let button = match button {
            MouseButton::Left => Button::Left,
            MouseButton::Right => Button::Right,
            MouseButton::Middle => Button::Middle,
            _ => return Ok(false),
        };
        if state == ElementState::Pressed {
            // A click in a panel may be the answer: its actions withdraw what they do not answer.
            if !consumed {
                self.input.asked = None;
            }
            let grabbed = !consumed && button == Button::Left && self.grab()?;
            if !(consumed || grabbed) {
                self.input.controls.pressed(button);
            }
            return Ok(false);
        }
        let seconds = self.pacing.seconds();
        let held = self.input.is_held() || self.split.as_ref().is_some_and(|split| split.is_held());
        if button == Button::Left && held {
            self.let_go()?;
            // A click on a handle drags nothing, and does not select what is behind the handle.
            return match self.input.controls.let_hold_go(seconds) {
                Some(click) if click.double => self.focus_at(click.at_px),
                _ => {
                    self.box_stays();
                    Ok(true)
                }
            };
        }
        let Some(click) = self.input.controls.released(button, seconds) else { return Ok(false) };
        if click.double {
            return self.focus_at(click.at_px);
        }
        if self.input.boxing.on {
            self.box_click(click.at_px)?;
        } else if self.hud.edit.draws_points() {
            let point = self.session.viewer.point_at(self.in_picture(click.at_px));
            if let Some(point) = self.found(point)? {
                self.hud.edit.add_point(point);
            }
        } else {
            let instance = self.instance_at(click.at_px)?;
            self.session.viewer.editor_mut().click(instance, self.input.controls.shift);
        }
        self.input.controls.click_done(self.pacing.seconds());
        Ok(true)
    }

    /// After a double click: orbits around the point at a window position from now on; false if no splat is there.
    fn focus_at(&mut self, at_px: [f64; 2]) -> Result<bool, PlayerError> {
        self.box_unclick();
        let point = self.session.viewer.point_at(self.in_picture(at_px));
        let point = self.found(point)?;
        if let Some(point) = point {
            self.camera.navigator.focus(point);
        }
        Ok(point.is_some())
    }

    /// The instance at a window position; `None` with a notice if the device has no room to find it.
    pub(super) fn instance_at(&mut self, at_px: [f64; 2]) -> Result<Option<usize>, PlayerError> {
        self.hud.message = None;
        let instance = self.session.viewer.instance_at(self.in_picture(at_px));
        self.found(instance)
    }

    /// Result of a query of the frame; one that needs too much becomes `None` and a notice.
    pub(super) fn found<T>(&mut self, found: Result<Option<T>, PlayerError>) -> Result<Option<T>, PlayerError> {
        match found {
            Err(error) if error.is_too_much() => {
                self.hud.message = Some(error.to_string());
                Ok(None)
            }
            found => found,
        }
    }

    /// Window pixels converted to pixels of the last frame, which may have a lower resolution.
    pub(super) fn in_picture(&self, at_px: [f64; 2]) -> [f64; 2] {
        let shown = self.screen.swapchain.size_px();
        let picture = self.session.viewer.size_px().unwrap_or(shown);
        [0, 1].map(|axis| at_px[axis] * f64::from(picture[axis]) / f64::from(shown[axis].max(1)))
    }

    /// Handles the press or release of a key; `consumed` by the overlay.
    pub(super) fn key_event(
        &mut self,
        code: KeyCode,
        down: bool,
        repeats: bool,
        consumed: bool,
    ) -> Result<After, PlayerError> {
        // A text field takes keys while it has focus, except for the shortcut that saves.
        let consumed = consumed && !(self.input.controls.control && code == KeyCode::KeyS);
        let flight = flight_key(code).filter(|_| !self.input.controls.control || !down);
        if let Some(key) = flight {
            self.input.controls.flight_key(key, down && !consumed);
            return Ok(if down { After::Redraw } else { After::Nothing });
        }
        if down && !consumed { self.key(code, repeats) } else { Ok(After::Nothing) }
    }

    fn key(&mut self, code: KeyCode, repeats: bool) -> Result<After, PlayerError> {
        if repeats && self.input.asked.is_some() {
            // A key that is held is no answer.
            return Ok(After::Nothing);
        }
        self.input.controls.typed();
        self.hud.message = None;
        let (control, shift) = (self.input.controls.control, self.input.controls.shift);
        self.input.asked.take_if(|asked| !asked.stays_at(code, control, shift));
        if self.edit_key(code, repeats)? {
            return Ok(After::Redraw);
        }
        // With Ctrl, these keys have another meaning or none.
        if repeats || self.input.controls.control {
            return Ok(After::Nothing);
        }
        if let Some(view) = view_key(code) {
            self.session.viewer.options.show = view.show(self.camera.navigator.distance());
            return Ok(After::Redraw);
        }
        match code {
            // Closes the menu of views.
            KeyCode::Escape if egui::Popup::is_any_open(self.screen.ui.egui_ctx()) => {}
            KeyCode::Escape if self.drop_grip()? => {}
            KeyCode::Escape if self.hud.panels.close_one() => {}
            KeyCode::Escape if !self.session.viewer.editor().chosen().is_empty() => {
                self.session.viewer.editor_mut().click(None, false);
            }
            KeyCode::Escape => return Ok(self.leave(Leaving::Escape)),
            KeyCode::KeyB => self.toggle_boxes()?,
            KeyCode::KeyF if self.input.boxing.on => self.find_rest(),
            KeyCode::KeyF => self.act_on_camera(&Action::Frame)?,
            // These two are of instances, as those that `edit_key` leaves out.
            KeyCode::KeyL | KeyCode::KeyG if self.input.boxing.on => {}
            KeyCode::KeyL => {
                self.let_go()?;
                let chosen: Vec<usize> = self.session.viewer.editor().chosen().iter().copied().collect();
                self.session.viewer.editor_mut().set_locked(&chosen, true);
            }
            KeyCode::F1 => self.toggle_panel(Panel::Help),
            KeyCode::F2 => self.toggle_panel(Panel::Scene),
            KeyCode::F3 => self.toggle_panel(Panel::Properties),
            KeyCode::F4 => self.toggle_panel(Panel::View),
            KeyCode::F5 => self.toggle_panel(Panel::Cameras),
            KeyCode::F6 => self.toggle_panel(Panel::History),
            KeyCode::F7 => self.toggle_panel(Panel::Statistics),
            KeyCode::KeyG => {
                self.let_go()?;
                let (editor, scene) = self.session.viewer.editor_and_scene();
                editor.choose_alike(scene);
            }
            KeyCode::KeyO if self.input.boxing.on => self.toggle_other_sizes(),
            KeyCode::KeyH => self.hud.visible = !self.hud.visible,
            KeyCode::KeyR => self.camera.navigator = self.camera.home.clone(),
            KeyCode::BracketLeft => self.camera.navigator.change_speed(1.0 / SPEED_STEP),
            KeyCode::BracketRight => self.camera.navigator.change_speed(SPEED_STEP),
            KeyCode::PageDown => step(&mut self.camera.data_views, 1, &mut self.camera.navigator, &mut self.hud),
            KeyCode::PageUp => step(&mut self.camera.data_views, -1, &mut self.camera.navigator, &mut self.hud),
            KeyCode::KeyV => step(&mut self.camera.kept, 1, &mut self.camera.navigator, &mut self.hud),
            KeyCode::KeyC => self.keep_camera()?,
            KeyCode::KeyP => self.record_path(),
            KeyCode::KeyK => self.toggle_split()?,
            KeyCode::F11 => {
                let full = self.screen.window.fullscreen().is_none();
                self.screen.window.set_fullscreen(full.then_some(Fullscreen::Borderless(None)));
            }
            KeyCode::F12 => self.write_picture(),
            _ => return Ok(After::Nothing),
        }
        Ok(After::Redraw)
    }
}

/// The meaning of a key; see [`code_at`].
fn code_of(event: &KeyEvent, control: bool) -> Option<KeyCode> {
    let place = match event.physical_key {
        PhysicalKey::Code(code) => Some(code),
        PhysicalKey::Unidentified(_) => None,
    };
    code_at(place, &event.logical_key, !control || !event.state.is_pressed())
}

/// The meaning of a key at a place on the keyboard. Flight keys count by their place while keys fly; other keys by the letter or
/// sign on them where that has a meaning here, so that Ctrl+Z is where the layout has its Z. `None` if it means nothing, as a
/// flight key's letter at another place.
fn code_at(place: Option<KeyCode>, written: &Key, flies: bool) -> Option<KeyCode> {
    let is_flight = |code: KeyCode| flies && flight_key(code).is_some();
    match written {
        Key::Character(text) if !place.is_some_and(is_flight) => match written_key(text) {
            None => place,
            code => code.filter(|&code| !is_flight(code)),
        },
        _ => place,
    }
}

/// The key of a US keyboard with this letter or sign; `None` if it has no meaning here.
fn written_key(text: &str) -> Option<KeyCode> {
    use KeyCode::{
        KeyA, KeyB, KeyC, KeyD, KeyE, KeyF, KeyG, KeyH, KeyI, KeyJ, KeyK, KeyL, KeyM, KeyN, KeyO, KeyP, KeyQ, KeyR,
        KeyS, KeyT, KeyU, KeyV, KeyW, KeyX, KeyY, KeyZ,
    };
    const LETTERS: [KeyCode; 26] = [
        KeyA, KeyB, KeyC, KeyD, KeyE, KeyF, KeyG, KeyH, KeyI, KeyJ, KeyK, KeyL, KeyM, KeyN, KeyO, KeyP, KeyQ, KeyR,
        KeyS, KeyT, KeyU, KeyV, KeyW, KeyX, KeyY, KeyZ,
    ];
    let mut characters = text.chars();
    let (first, None) = (characters.next()?.to_ascii_lowercase(), characters.next()) else { return None };
    match first {
        'a'..='z' => LETTERS.get(first as usize - 'a' as usize).copied(),
        '+' => Some(KeyCode::Equal),
        '-' => Some(KeyCode::Minus),
        ',' => Some(KeyCode::Comma),
        '.' => Some(KeyCode::Period),
        '[' => Some(KeyCode::BracketLeft),
        ']' => Some(KeyCode::BracketRight),
        _ => None,
    }
}

/// The view that a digit selects.
fn view_key(code: KeyCode) -> Option<View> {
    use KeyCode::{Digit1, Digit2, Digit3, Digit4, Digit5, Digit6, Digit7, Digit8, Digit9};
    let digits = [Digit1, Digit2, Digit3, Digit4, Digit5, Digit6, Digit7, Digit8, Digit9];
    digits.iter().position(|&digit| digit == code).map(|k| View::ALL[k])
}

fn flight_key(code: KeyCode) -> Option<FlightKey> {
    Some(match code {
        KeyCode::KeyW => FlightKey::Forward,
        KeyCode::KeyS => FlightKey::Back,
        KeyCode::KeyA => FlightKey::Left,
        KeyCode::KeyD => FlightKey::Right,
        KeyCode::KeyE => FlightKey::Up,
        KeyCode::KeyQ => FlightKey::Down,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_known_by_what_is_written_on_them() {
        for (text, code) in [("z", KeyCode::KeyZ), ("Z", KeyCode::KeyZ), ("a", KeyCode::KeyA), ("+", KeyCode::Equal)] {
            assert_eq!(written_key(text), Some(code), "{text}");
        }
        for text in ["", "1", "ab", "\u{44f}", "{"] {
            assert_eq!(written_key(text), None, "{text}");
        }
    }

    #[test]
    fn flying_goes_by_place_alone() {
        let code = |place: KeyCode, text: &str, flies: bool| code_at(Some(place), &Key::Character(text.into()), flies);
        // A French keyboard has A where others have Q, and W where they have Z.
        assert_eq!(code(KeyCode::KeyQ, "a", true), Some(KeyCode::KeyQ));
        assert_eq!(code(KeyCode::KeyZ, "w", true), None, "it neither flies nor is it a Z");
        assert_eq!(code(KeyCode::KeyW, "z", true), Some(KeyCode::KeyW));
        assert_eq!(code(KeyCode::KeyQ, "a", false), Some(KeyCode::KeyA), "Ctrl+A is where A is written");
        assert_eq!(code(KeyCode::Semicolon, "m", true), Some(KeyCode::KeyM));
        assert_eq!(code(KeyCode::Digit1, "&", true), Some(KeyCode::Digit1));
        assert_eq!(
            code_at(Some(KeyCode::Escape), &Key::Named(winit::keyboard::NamedKey::Escape), true),
            Some(KeyCode::Escape)
        );
    }
}
