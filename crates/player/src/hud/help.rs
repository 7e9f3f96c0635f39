//! All keys, in two columns.

use egui::{Grid, Ui};

use crate::texts;

/// Lays out the list of keys.
pub(super) fn lay_out(ui: &mut Ui) {
    // Side by side where there is room for it.
    let wide = ui.ctx().content_rect().width() > 800.0;
    if wide {
        ui.horizontal_top(|ui| {
            for (k, sections) in texts::KEYS.iter().enumerate() {
                ui.vertical(|ui| column(ui, k, sections));
            }
        });
    } else {
        for (k, sections) in texts::KEYS.iter().enumerate() {
            column(ui, k, sections);
        }
    }
}

fn column(ui: &mut Ui, k: usize, sections: &[(&str, &[(&str, &str)])]) {
    for (title, keys) in sections {
        ui.heading(*title);
        Grid::new((k, title)).num_columns(2).show(ui, |ui| {
            for (key, what) in *keys {
                ui.strong(*key);
                ui.label(*what);
                ui.end_row();
            }
        });
        ui.add_space(6.0);
    }
}
