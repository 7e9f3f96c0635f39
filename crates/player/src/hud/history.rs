//! The list of changes: a click goes back to one, or forward again.

use egui::Ui;

use super::{Facts, WIDTH};
use crate::actions::Action;
use crate::texts;

/// Lays out the list, the oldest change first.
pub(super) fn lay_out(ui: &mut Ui, facts: &Facts<'_>, actions: &mut Vec<Action>) {
    ui.set_min_width(WIDTH / 2.0);
    let [undo, redo] = facts.editor.history();
    if undo.is_empty() && redo.is_empty() {
        ui.label(texts::NO_CHANGES);
        return;
    }
    let now = undo.len();
    for (k, what) in undo.iter().rev().enumerate() {
        let last = k + 1 == now;
        let text = format!("{}. {}", k + 1, texts::edit_name(what));
        let response = ui.selectable_label(last, text);
        if response.clicked() && !last {
            actions.push(Action::Travel(k as isize + 1 - now as isize));
        }
    }
    for (k, what) in redo.iter().enumerate() {
        let text = format!("{}. {}", now + k + 1, texts::edit_name(what));
        if ui.selectable_label(false, egui::RichText::new(text).weak()).clicked() {
            actions.push(Action::Travel(k as isize + 1));
        }
    }
    ui.horizontal(|ui| {
        if ui.add_enabled(now > 0, egui::Button::new(texts::UNDO)).clicked() {
            actions.push(Action::Undo);
        }
        if ui.add_enabled(!redo.is_empty(), egui::Button::new(texts::REDO)).clicked() {
            actions.push(Action::Redo);
        }
    });
}
