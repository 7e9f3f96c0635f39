//! Mouse and keyboard input as changes of the camera. Independent of the window system, so that tests can feed it
//! directly.

use super::navigation::{Flight, Navigator};

/// A double click is two clicks within this time (seconds) and distance (points).
const DOUBLE_CLICK: (f64, f64) = (0.4, 5.0);
/// A press whose pointer stays within this distance in points is a click; beyond it, a drag.
const CLICK_POINTS: f64 = 3.0;

/// Mouse buttons with a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Orbits around the target; with Shift, pans.
    Left,
    /// Looks around from where the camera is, for flying.
    Right,
    /// Pans: moves the camera parallel to the image plane.
    Middle,
}

/// Keys that fly while they are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightKey {
    /// Flies forward (key W).
    Forward,
    /// Flies backward (key S).
    Back,
    /// Flies to the left (key A).
    Left,
    /// Flies to the right (key D).
    Right,
    /// Flies upwards (key E).
    Up,
    /// Flies downwards (key Q).
    Down,
}

/// A press and release without a drag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Click {
    /// Position of the pointer, pixels.
    pub at_px: [f64; 2],
    /// True for the second click of a double click.
    pub double: bool,
}

struct Press {
    button: Button,
    at_px: [f64; 2],
    dragged: bool,
}

/// The buttons and keys that are held, and the pointer.
pub struct Controls {
    pointer_px: [f64; 2],
    press: Option<Press>,
    held: [bool; 6],
    /// True while Shift is held.
    pub shift: bool,
    /// True while Ctrl (or Cmd) is held.
    pub control: bool,
    /// Pixels per point, the unit of the interface: 2 on a screen with twice the resolution.
    pub per_point: f64,
    last_click: Option<(f64, [f64; 2])>,
    /// Where a handle was pressed, until the pointer moves far enough for a drag; pixels.
    still_hold_px: Option<[f64; 2]>,
}

impl Default for Controls {
    fn default() -> Self {
        let (pointer_px, held) = ([0.0; 2], [false; 6]);
        Self {
            pointer_px,
            press: None,
            held,
            shift: false,
            control: false,
            per_point: 1.0,
            last_click: None,
            still_hold_px: None,
        }
    }
}

impl Controls {
    /// Position of the pointer, pixels.
    pub fn pointer_px(&self) -> [f64; 2] {
        self.pointer_px
    }

    /// Moves the pointer; true if that changed the camera. `height_px` is the height of the view.
    pub fn pointer_moved(&mut self, to_px: [f64; 2], navigator: &mut Navigator, height_px: f64) -> bool {
        let by = [to_px[0] - self.pointer_px[0], to_px[1] - self.pointer_px[1]];
        self.pointer_px = to_px;
        let reach_px = CLICK_POINTS * self.per_point;
        self.still_hold_px.take_if(|at| distance(to_px, *at) > reach_px);
        let Some(press) = &mut self.press else { return false };
        if !press.dragged && distance(to_px, press.at_px) <= reach_px {
            return false;
        }
        // The motion that the drag threshold held back is included.
        let by = if press.dragged { by } else { [to_px[0] - press.at_px[0], to_px[1] - press.at_px[1]] };
        press.dragged = true;
        match (press.button, self.shift) {
            (Button::Left, false) => navigator.orbit(by, height_px),
            (Button::Left, true) | (Button::Middle, _) => navigator.pan(by, height_px),
            (Button::Right, _) => navigator.look(by, height_px),
        }
        true
    }

    /// True while a drag changes the camera.
    pub fn is_dragging(&self) -> bool {
        self.press.as_ref().is_some_and(|press| press.dragged)
    }

    /// A button is pressed. While one is held, others are ignored.
    pub fn pressed(&mut self, button: Button) {
        if self.press.is_none() {
            self.press = Some(Press { button, at_px: self.pointer_px, dragged: false });
        }
    }

    /// A button is released at a time in `seconds` since a fixed moment; returns a click if the left button was not
    /// dragged.
    pub fn released(&mut self, button: Button, seconds: f64) -> Option<Click> {
        let press = self.press.take_if(|press| press.button == button)?;
        if press.dragged || button != Button::Left {
            return None;
        }
        Some(self.clicked(press.at_px, seconds))
    }

    /// The button was pressed on a handle, which moves once the pointer has passed the drag threshold.
    pub fn take_hold(&mut self) {
        self.still_hold_px = Some(self.pointer_px);
    }

    /// Ends the hold on a handle.
    pub fn forget_hold(&mut self) {
        self.still_hold_px = None;
    }

    /// True while a handle is held and the pointer has not passed the drag threshold.
    pub fn holds_still(&self) -> bool {
        self.still_hold_px.is_some()
    }

    /// Releases the handle; returns a click if it was not dragged. `seconds` as for [`Controls::released`].
    pub fn let_hold_go(&mut self, seconds: f64) -> Option<Click> {
        self.still_hold_px.take().map(|at_px| self.clicked(at_px, seconds))
    }

    fn clicked(&mut self, at_px: [f64; 2], seconds: f64) -> Click {
        let (time, reach) = (DOUBLE_CLICK.0, DOUBLE_CLICK.1 * self.per_point);
        let double = self.last_click.is_some_and(|(then, at)| seconds - then < time && distance(at, at_px) < reach);
        // A third click begins a new pair.
        self.last_click = (!double).then_some((seconds, at_px));
        Click { at_px, double }
    }

    /// Restarts the double click's time after a click was processed, so that a slow reaction does not lengthen the time
    /// between two clicks.
    pub fn click_done(&mut self, seconds: f64) {
        if let Some((then, _)) = &mut self.last_click {
            *then = seconds;
        }
    }

    /// A key was pressed: clicks before and after it are no double click.
    pub fn typed(&mut self) {
        self.last_click = None;
    }

    /// A flight key is pressed or released.
    pub fn flight_key(&mut self, key: FlightKey, down: bool) {
        self.held[key as usize] = down;
    }

    /// Releases everything: the window lost keyboard focus.
    pub fn let_go(&mut self) {
        (self.held, self.press, self.still_hold_px) = ([false; 6], None, None);
        (self.shift, self.control) = (false, false);
    }

    /// The direction of flight of the keys that are held.
    pub fn flight(&self) -> Flight {
        let axis = |plus: FlightKey, minus: FlightKey| {
            f64::from(i8::from(self.held[plus as usize]) - i8::from(self.held[minus as usize]))
        };
        Flight {
            right: axis(FlightKey::Right, FlightKey::Left),
            up: axis(FlightKey::Up, FlightKey::Down),
            forward: axis(FlightKey::Forward, FlightKey::Back),
            fast: self.shift,
        }
    }
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use instgs_vk::scene::trajectory::Orbit;

    fn start() -> (Controls, Navigator) {
        let orbit = Orbit { center: DVec3::ZERO, distance: 3.0, up: DVec3::Z };
        (Controls::default(), Navigator::around(&orbit))
    }

    #[test]
    fn each_button_does_its_own() {
        for (button, shift, want) in [
            (Button::Left, false, "orbit"),
            (Button::Left, true, "pan"),
            (Button::Middle, false, "pan"),
            (Button::Right, false, "look"),
        ] {
            let (mut controls, mut n) = start();
            let mut expected = n.clone();
            controls.shift = shift;
            controls.pointer_moved([50.0, 50.0], &mut n, 180.0);
            assert_eq!(n, expected, "no button, no change");
            controls.pressed(button);
            assert!(controls.pointer_moved([60.0, 53.0], &mut n, 180.0));
            controls.released(button, 0.0);
            assert!(!controls.pointer_moved([90.0, 90.0], &mut n, 180.0));
            match want {
                "orbit" => expected.orbit([10.0, 3.0], 180.0),
                "pan" => expected.pan([10.0, 3.0], 180.0),
                _ => expected.look([10.0, 3.0], 180.0),
            }
            assert_eq!(n, expected, "{want}");
        }
    }

    #[test]
    fn clicks_are_told_from_drags_and_double_clicks_from_clicks() {
        let (mut controls, mut n) = start();
        let here = n.clone();
        let mut click = |to: [f64; 2], drag: f64, seconds: f64| {
            controls.pointer_moved(to, &mut n, 180.0);
            controls.pressed(Button::Left);
            controls.pressed(Button::Right);
            controls.pointer_moved([to[0] + drag, to[1]], &mut n, 180.0);
            assert_eq!(controls.released(Button::Right, seconds), None);
            controls.released(Button::Left, seconds).map(|c| c.double)
        };
        assert_eq!(click([10.0, 10.0], 2.0, 1.0), Some(false));
        assert_eq!(click([12.0, 10.0], 0.0, 1.2), Some(true));
        assert_eq!(click([12.0, 10.0], 0.0, 1.4), Some(false), "the third is a first again");
        assert_eq!(click([30.0, 10.0], 0.0, 1.5), Some(false), "elsewhere");
        assert_eq!(click([30.0, 10.0], 0.0, 2.5), Some(false), "too late");
        controls.click_done(4.5);
        controls.pressed(Button::Left);
        let second = controls.released(Button::Left, 4.6);
        assert_eq!(second.map(|c| c.double), Some(true), "the first took two seconds to be done");
        for want in [Some(false), Some(false)] {
            controls.pressed(Button::Left);
            assert_eq!(controls.released(Button::Left, 5.5).map(|c| c.double), want, "a key between two clicks");
            controls.typed();
        }
        assert_eq!(n, here, "clicks change nothing");
    }

    #[test]
    fn fine_screens_have_more_pixels_for_the_same_hand() {
        for (per_point, click) in [(1.0, false), (2.0, true)] {
            let (mut controls, mut n) = start();
            controls.per_point = per_point;
            controls.pressed(Button::Left);
            controls.pointer_moved([5.0, 0.0], &mut n, 180.0);
            assert_eq!(controls.released(Button::Left, 0.0).is_some(), click, "{per_point}");
        }
    }

    #[test]
    fn a_drag_is_no_click_even_if_it_returns() {
        let (mut controls, mut n) = start();
        controls.pressed(Button::Left);
        controls.pointer_moved([40.0, 0.0], &mut n, 180.0);
        controls.pointer_moved([0.0, 0.0], &mut n, 180.0);
        assert_eq!(controls.released(Button::Left, 0.0), None);
    }

    /// A selected object has a handle at its centre, and a double click there still counts.
    #[test]
    fn a_handle_that_is_not_dragged_was_clicked() {
        let (mut controls, mut n) = start();
        let here = n.clone();
        controls.pressed(Button::Left);
        assert!(controls.released(Button::Left, 1.0).is_some_and(|click| !click.double));
        controls.take_hold();
        controls.pointer_moved([2.0, 0.0], &mut n, 180.0);
        assert!(controls.holds_still());
        assert_eq!(controls.let_hold_go(1.2), Some(Click { at_px: [0.0, 0.0], double: true }));
        controls.take_hold();
        controls.pointer_moved([40.0, 0.0], &mut n, 180.0);
        controls.pointer_moved([0.0, 0.0], &mut n, 180.0);
        assert!(!controls.holds_still());
        assert_eq!(controls.let_hold_go(1.3), None, "dragged, if only to and fro");
        assert_eq!(n, here, "handles do not turn the view");
    }

    #[test]
    fn held_keys_add_up_until_the_window_loses_them() {
        let (mut controls, _) = start();
        controls.flight_key(FlightKey::Forward, true);
        controls.flight_key(FlightKey::Left, true);
        controls.shift = true;
        assert_eq!(controls.flight(), Flight { right: -1.0, up: 0.0, forward: 1.0, fast: true });
        controls.flight_key(FlightKey::Back, true);
        assert_eq!(controls.flight().forward, 0.0);
        controls.let_go();
        assert!(controls.flight().is_still() && !controls.flight().fast);
    }
}
