//! How the scene is shown, and how the panels look.

use egui::{DragValue, Slider, SliderClamping, Theme, Ui};
use glam::DVec3;

use super::{Facts, Settings, WIDTH};
use crate::actions::Action;
use crate::swapchain::PresentMode;
use crate::{texts, views};

/// Default of the frame-time limit once it is switched on, milliseconds: 60 frames per second.
const USUAL_BUDGET_MS: f64 = 16.0;
/// Sizes of the panels that can be chosen.
const SIZES: [f32; 5] = [1.0, 1.25, 1.5, 1.75, 2.0];

/// Lays out the settings; the flags are whether the grid and the axes are drawn.
pub(super) fn lay_out(
    ui: &mut Ui,
    facts: &Facts<'_>,
    settings: Settings<'_>,
    [grid, axes]: [&mut bool; 2],
    actions: &mut Vec<Action>,
) {
    ui.set_min_width(WIDTH);
    let Settings { navigator, show, background, present, budget_ms, lod_error_px, occlusion } = settings;
    views::choose(ui, show, navigator.distance(), facts.stats.slabs);
    let mut degrees = navigator.fov_y().to_degrees();
    // What the command line has set stays as it is until it is changed here.
    let only_edits = SliderClamping::Edits;
    let slider = Slider::new(&mut degrees, 5.0..=150.0).clamping(only_edits).suffix(texts::DEGREES);
    if ui.add(slider.text(texts::FIELD_OF_VIEW)).changed() {
        navigator.set_fov_y(degrees.to_radians());
    }
    ui.horizontal(|ui| {
        ui.color_edit_button_rgb(background);
        ui.label(texts::BACKGROUND_COLOUR);
        ui.checkbox(grid, texts::GRID);
        ui.checkbox(axes, texts::AXES);
    });
    ui.horizontal(|ui| {
        ui.label(texts::LOOK_ALONG);
        for (name, along) in
            [(texts::X, DVec3::NEG_X), (texts::Y, DVec3::NEG_Y), (texts::Z, DVec3::NEG_Z), (texts::UP, -facts.up)]
        {
            if ui.button(name).clicked() {
                actions.push(Action::LookAlong(along));
            }
        }
    });
    let slider = Slider::new(lod_error_px, 0.0..=8.0).clamping(only_edits).step_by(0.5);
    ui.add(slider.custom_formatter(|px, _| texts::pixels_or_off(px)).text(texts::DETAIL));
    ui.checkbox(occlusion, texts::OCCLUSION).on_hover_text(texts::WHY_OCCLUSION);
    let mut limited = budget_ms.is_some();
    ui.horizontal(|ui| {
        ui.checkbox(&mut limited, texts::LOWER_RESOLUTION);
        let mut ms = budget_ms.unwrap_or(USUAL_BUDGET_MS);
        let value = DragValue::new(&mut ms).range(1.0..=1000.0).clamp_existing_to_range(false);
        ui.add_enabled(limited, value.suffix(texts::MS));
        *budget_ms = limited.then_some(ms);
    });
    ui.horizontal(|ui| {
        ui.label(texts::PRESENTATION);
        for value in PresentMode::ALL {
            ui.selectable_value(present, value, texts::present_mode(value));
        }
    });
    ui.separator();
    ui.horizontal(|ui| {
        ui.label(texts::THEME);
        for (theme, name) in [(Theme::Dark, texts::DARK), (Theme::Light, texts::LIGHT)] {
            if ui.selectable_label(ui.ctx().theme() == theme, name).clicked() {
                ui.ctx().set_theme(theme);
            }
        }
    });
    ui.horizontal(|ui| {
        ui.label(texts::SIZE_OF_TEXT);
        let now = ui.ctx().zoom_factor();
        for size in SIZES {
            let text = texts::percent(size);
            if ui.selectable_label((now - size).abs() < 0.01, text).clicked() {
                ui.ctx().set_zoom_factor(size);
            }
        }
    });
}
