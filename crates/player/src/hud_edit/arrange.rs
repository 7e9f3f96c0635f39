//! Buttons that set instances apart from their template or reunite them, and that arrange several.

use egui::{Button, ComboBox, Ui};
use glam::DVec3;

use super::{Action, EditFacts};
use crate::texts;
use instgs_vk::scene::edit::{AlignTo, Edit, Extra, Selector};

/// Growth of the box whose Gaussians are taken from the background, relative to its size.
const GIVE_MARGIN: f64 = 0.05;

/// Name of a template in the list of those to replace by.
fn template_name(facts: &EditFacts<'_>, template: u32) -> String {
    let group = facts.scene.groups.iter().find(|group| group.template_id == template);
    let count = facts.scene.template_ranges[template as usize].count;
    let name = group.and_then(|group| group.name.clone());
    format!("{} ({count})", name.unwrap_or_else(|| texts::template(template)))
}

/// The choice of another template, and buttons for own Gaussians.
pub(super) fn own_and_template(ui: &mut Ui, facts: &EditFacts<'_>, first: usize, actions: &mut Vec<Action>) {
    let Some(which) = facts.editor.selector() else { return };
    let template = facts.scene.instances[first].template;
    let mut wanted = template;
    ComboBox::from_label(texts::REPLACE_BY).selected_text(template_name(facts, template)).show_ui(ui, |ui| {
        for other in 0..facts.scene.template_ranges.len() as u32 {
            ui.selectable_value(&mut wanted, other, template_name(facts, other));
        }
    });
    if wanted != template {
        actions.push(Action::Edit(Edit::Swap { which: which.clone(), template: wanted }));
    }
    let mut button = |ui: &mut Ui, enabled: bool, label: &str, tip: &str, edit: Edit| {
        if ui.add_enabled(enabled, Button::new(label)).on_hover_text(tip).clicked() {
            actions.push(Action::Edit(edit));
        }
    };
    let chosen = facts.editor.chosen();
    let has_own = chosen.iter().any(|&k| facts.scene.own_range(k).count > 0);
    ui.horizontal(|ui| {
        let unique = Edit::MakeUnique { which: which.clone() };
        button(ui, true, texts::MAKE_UNIQUE, texts::MAKE_UNIQUE_TIP, unique);
        let reset = Edit::Reset { which: which.clone(), what: Extra::All };
        button(ui, true, texts::RESET, texts::RESET_TIP, reset);
    });
    ui.horizontal(|ui| {
        let give = Edit::Give { which: Selector::Index(first), margin: GIVE_MARGIN };
        button(ui, chosen.len() == 1, texts::GIVE, texts::GIVE_TIP, give);
        button(ui, has_own, texts::TAKE, texts::TAKE_TIP, Edit::Take { which: which.clone() });
    });
    let lit = !facts.scene.color_from_template.is_empty();
    button(ui, lit, texts::RELIGHT, texts::RELIGHT_TIP, Edit::Relight { which });
}

/// Buttons that align, distribute and mirror the selection along each axis.
pub(super) fn arrange(ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
    let Some(which) = facts.editor.selector() else { return };
    let count = facts.editor.chosen().len();
    let axes = [(texts::X, DVec3::X), (texts::Y, DVec3::Y), (texts::Z, DVec3::Z), (texts::UP, facts.up)];
    let mut row = |ui: &mut Ui, label: &str, least: usize, edit: &dyn Fn(DVec3) -> Edit| {
        ui.horizontal(|ui| {
            ui.label(label);
            for (name, axis) in axes {
                if ui.add_enabled(count >= least, Button::new(name)).clicked() {
                    actions.push(Action::Edit(edit(axis)));
                }
            }
        });
    };
    let which = || which.clone();
    row(ui, texts::ALIGN, 2, &|axis| Edit::Align { which: which(), axis, to: AlignTo::Mean });
    row(ui, texts::DISTRIBUTE, 3, &|axis| Edit::Distribute { which: which(), axis });
    row(ui, texts::MIRROR, 1, &|normal| Edit::Mirror { which: which(), normal, point: None });
    if ui.add_enabled(count > 1, Button::new(texts::ON_GROUND)).clicked() {
        actions.push(Action::Edit(Edit::Align { which: which(), axis: facts.up, to: AlignTo::Base }));
    }
}
