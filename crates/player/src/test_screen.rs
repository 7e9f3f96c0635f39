//! Helper for tests of panels through simulated user input, without a window: finds texts in egui's output, and clicks
//! and drags them.

use egui::{Context, Event, PointerButton, Pos2, Rect};

use crate::panel_texts::{PanelText, texts_of};

/// A simulated screen of 900 by 1200 points.
#[derive(Default)]
pub(super) struct TestScreen {
    ctx: Context,
    texts: Vec<PanelText>,
    time: f64,
}

impl TestScreen {
    /// Lays out one frame with these events.
    pub(super) fn frame(&mut self, events: Vec<Event>, lay_out: impl FnMut(&Context)) {
        // Longer than an animation, and short enough for a press and a release to be a click.
        self.time += 0.1;
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, egui::vec2(900.0, 1200.0)));
        let input = egui::RawInput { screen_rect, events, time: Some(self.time), ..egui::RawInput::default() };
        let output = self.ctx.run(input, lay_out);
        self.texts = texts_of(&output.shapes);
    }

    /// True if a text on the screen starts with `begin`.
    pub(super) fn says(&self, begin: &str) -> bool {
        self.texts.iter().any(|have| have.text.starts_with(begin))
    }

    /// Rectangle of a text on the screen; the first of several.
    pub(super) fn first_place(&self, text: &str) -> Rect {
        let found = self.texts.iter().find(|have| have.text == text);
        found.unwrap_or_else(|| panic!("no {text:?} in {:?}", self.texts)).rect
    }

    /// Rectangle of a text on the screen; the last of several.
    pub(super) fn place(&self, text: &str) -> Rect {
        let found = self.texts.iter().rfind(|have| have.text == text);
        found.unwrap_or_else(|| panic!("no {text:?} in {:?}", self.texts)).rect
    }
}

/// Presses or releases the left button at a position, in two frames of events.
pub(super) fn press(at: Pos2, pressed: bool) -> [Vec<Event>; 2] {
    let button =
        Event::PointerButton { pos: at, button: PointerButton::Primary, pressed, modifiers: Default::default() };
    [vec![Event::PointerMoved(at)], vec![button]]
}

/// A click, and three frames after it.
pub(super) fn click(at: Pos2) -> Vec<Vec<Event>> {
    let mut pictures = [press(at, true), press(at, false)].concat();
    pictures.resize(pictures.len() + 3, Vec::new());
    pictures
}

/// A drag to the right by a number of points.
pub(super) fn drag(from: Pos2, by: f32) -> Vec<Vec<Event>> {
    let mut pictures = press(from, true).to_vec();
    pictures.extend([0.4, 0.7, 1.0].map(|part| vec![Event::PointerMoved(from + egui::vec2(part * by, 0.0))]));
    pictures.extend(press(from + egui::vec2(by, 0.0), false));
    pictures.push(Vec::new());
    pictures
}
