//! The texts of the panels as they were laid out last, to find widgets by what stands on them: for scripts and tests.

use egui::epaint::ClippedShape;
use egui::{Pos2, Rect, Shape};

/// A text on the screen, interface points.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PanelText {
    pub(super) text: String,
    pub(super) rect: Rect,
    /// What can be seen of the panel or list that the text is in.
    pub(super) clip: Rect,
}

/// A widget by the text on it, or by its place beside one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// The whole text, with single spaces between words.
    pub text: String,
    /// The widget is so many texts to the right of this one in the same row; to the left if negative.
    pub along: i32,
}

/// All texts among shapes, in the order in which they are drawn.
pub(super) fn texts_of(shapes: &[ClippedShape]) -> Vec<PanelText> {
    fn collect(shape: &Shape, clip: Rect, out: &mut Vec<PanelText>) {
        match shape {
            Shape::Text(text) if !text.galley.text().trim().is_empty() => {
                let rect = text.galley.rect.translate(text.pos.to_vec2());
                out.push(PanelText { text: text.galley.text().into(), rect, clip });
            }
            Shape::Vec(shapes) => shapes.iter().for_each(|shape| collect(shape, clip, out)),
            _ => {}
        }
    }
    let mut out = Vec::new();
    shapes.iter().for_each(|clipped| collect(&clipped.shape, clipped.clip_rect, &mut out));
    out
}

/// The middle of a widget, interface points; of several with the same text the one drawn last. None if it cannot be seen.
pub(super) fn place_of(texts: &[PanelText], target: &Target) -> Option<Pos2> {
    let is_seen = |text: &&PanelText| text.clip.contains(text.rect.center());
    let at = texts.iter().filter(is_seen).rfind(|text| text.text.split_whitespace().eq(target.text.split(' ')))?;
    let in_row = |other: &&PanelText| {
        other.clip == at.clip && (other.rect.center().y - at.rect.center().y).abs() < 0.5 * at.rect.height()
    };
    let mut row: Vec<&PanelText> = texts.iter().filter(is_seen).filter(in_row).collect();
    row.sort_by(|a, b| a.rect.left().total_cmp(&b.rect.left()));
    let here = row.iter().position(|text| std::ptr::eq(*text, at))?;
    let there = here.checked_add_signed(target.along as isize)?;
    row.get(there).map(|text| text.rect.center())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str, [x, y]: [f32; 2], clip: Rect) -> PanelText {
        PanelText { text: text.into(), rect: Rect::from_min_size(Pos2::new(x, y), egui::vec2(20.0, 10.0)), clip }
    }

    #[test]
    fn widgets_are_found_by_text_and_by_their_place_in_the_row() {
        let [left, right] = [0.0, 200.0].map(|x| Rect::from_min_size(Pos2::new(x, 0.0), egui::vec2(150.0, 100.0)));
        let texts = [
            text("chair", [10.0, 0.0], left),
            text(" chair", [10.0, 20.0], left),
            text("lock", [90.0, 21.0], left),
            text("eye", [60.0, 20.0], left),
            text("other panel", [210.0, 20.0], right),
            text("below", [10.0, 120.0], left),
        ];
        let find = |text: &str, along: i32| place_of(&texts, &Target { text: text.into(), along });
        assert_eq!(find("chair", 0), Some(Pos2::new(20.0, 25.0)));
        assert_eq!(find("chair", 1), Some(Pos2::new(70.0, 25.0)));
        assert_eq!(find("lock", -2), find("chair", 0));
        assert_eq!(
            (find("chair", 3), find("chair", -1)),
            (None, None),
            "the other panel's texts are in no row of this one"
        );
        assert_eq!((find("below", 0), find("table", 0)), (None, None), "what is scrolled away cannot be clicked");
    }
}
