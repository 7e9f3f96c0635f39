//! For tests of panels as a person uses them, without a window: texts are found in what is drawn, and clicked and dragged.

use egui::{Context, Event, PointerButton, Pos2, Rect, Shape};

/// A screen of 900 by 1200 points.
#[derive(Default)]
pub(super) struct TestScreen {
    ctx: Context,
    texts: Vec<(String, Rect)>,
    time: f64,
}

impl TestScreen {
    /// One picture.
    pub(super) fn frame(&mut self, events: Vec<Event>, lay_out: impl FnMut(&Context)) {
        // Longer than an animation; a press and a release are still a click.
        self.time += 0.1;
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, egui::vec2(900.0, 1200.0)));
        let input = egui::RawInput { screen_rect, events, time: Some(self.time), ..egui::RawInput::default() };
        let output = self.ctx.run(input, lay_out);
        self.texts.clear();
        output.shapes.iter().for_each(|clipped| texts(&clipped.shape, &mut self.texts));
    }

    /// True if a text that begins so is on the screen.
    pub(super) fn says(&self, begin: &str) -> bool {
        self.texts.iter().any(|(text, _)| text.starts_with(begin))
    }

    /// Where a text is; of several the first.
    pub(super) fn first_place(&self, text: &str) -> Rect {
        self.texts.iter().find(|(have, _)| have == text).unwrap_or_else(|| panic!("no {text:?} in {:?}", self.texts)).1
    }

    /// Where a text is; of several the last.
    pub(super) fn place(&self, text: &str) -> Rect {
        let found = self.texts.iter().rfind(|(have, _)| have == text);
        found.unwrap_or_else(|| panic!("no {text:?} in {:?}", self.texts)).1
    }
}

/// The left button goes down or up somewhere, in two pictures.
pub(super) fn press(at: Pos2, pressed: bool) -> [Vec<Event>; 2] {
    let button =
        Event::PointerButton { pos: at, button: PointerButton::Primary, pressed, modifiers: Default::default() };
    [vec![Event::PointerMoved(at)], vec![button]]
}

/// A click, and three pictures after it.
pub(super) fn click(at: Pos2) -> Vec<Vec<Event>> {
    let mut pictures = [press(at, true), press(at, false)].concat();
    pictures.resize(pictures.len() + 3, Vec::new());
    pictures
}

/// A drag to the right.
pub(super) fn drag(from: Pos2, by: f32) -> Vec<Vec<Event>> {
    let mut pictures = press(from, true).to_vec();
    pictures.extend([0.4, 0.7, 1.0].map(|part| vec![Event::PointerMoved(from + egui::vec2(part * by, 0.0))]));
    pictures.extend(press(from + egui::vec2(by, 0.0), false));
    pictures.push(Vec::new());
    pictures
}

fn texts(shape: &Shape, out: &mut Vec<(String, Rect)>) {
    match shape {
        Shape::Text(text) => out.push((text.galley.text().into(), text.galley.rect.translate(text.pos.to_vec2()))),
        Shape::Vec(shapes) => shapes.iter().for_each(|shape| texts(shape, out)),
        _ => {}
    }
}
