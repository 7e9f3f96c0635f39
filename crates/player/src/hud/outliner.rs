//! The list of what is in the scene: kinds of objects with their instances, and the background.

use std::collections::BTreeSet;

use egui::{Button, Key, RichText, ScrollArea, TextEdit, Ui};
use egui_phosphor::regular as icon;

use super::{Facts, WIDTH};
use crate::actions::Action;
use crate::texts;
use instgs_vk::math::digits::grouped;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::Edit;

/// Height of the list, points: it fits below the search on small windows, too.
const HEIGHT: f32 = 360.0;

/// What the user has typed and unfolded in the Scene panel.
#[derive(Default)]
pub(super) struct Outliner {
    search: String,
    /// Templates whose instances are listed.
    unfolded: BTreeSet<u32>,
    /// The template that is being renamed, and the text so far.
    renaming: Option<(u32, String)>,
}

/// A line of the list.
#[derive(Debug, PartialEq)]
enum Row {
    Kind { template: u32, name: String, members: Vec<usize> },
    Instance { k: usize, name: String },
}

/// The name of a template: its group's, or its number.
pub(in crate::hud) fn template_name(scene: &InstancedScene, template: u32) -> String {
    let group = scene.groups.iter().find(|group| group.template_id == template);
    group.and_then(|group| group.name.clone()).unwrap_or_else(|| format!("template {template}"))
}

impl Outliner {
    /// Lays out the list.
    pub(super) fn lay_out(&mut self, ui: &mut Ui, facts: &Facts<'_>, actions: &mut Vec<Action>) {
        ui.set_min_width(WIDTH);
        let count = facts.scene.instances.len();
        if count == 0 {
            ui.label(texts::NO_INSTANCES);
        } else {
            let hint = format!("{} {}", icon::MAGNIFYING_GLASS, texts::SEARCH);
            ui.add(TextEdit::singleline(&mut self.search).hint_text(hint).desired_width(f32::INFINITY));
            let rows = self.rows(facts.scene);
            if rows.is_empty() {
                ui.label(texts::NOTHING_FOUND);
            }
            let height = ui.spacing().interact_size.y;
            let room = HEIGHT.min(ui.ctx().content_rect().height() / 2.0);
            ScrollArea::vertical().max_height(room).show_rows(ui, height, rows.len(), |ui, range| {
                rows[range].iter().for_each(|row| self.row(ui, row, facts, actions));
            });
            ui.horizontal(|ui| {
                if ui.button(texts::SELECT_ALL).clicked() {
                    actions.push(Action::Choose((0..count).collect(), false));
                }
                let hidden = !facts.editor.hidden().is_empty();
                if ui.add_enabled(hidden, Button::new(texts::SHOW_ALL)).clicked() {
                    actions.push(Action::ShowAll);
                }
            });
        }
        ui.separator();
        let background = grouped(facts.scene.background.len() as u64);
        ui.label(format!("{}: {background} Gaussians", texts::BACKGROUND));
    }

    /// The lines that match the search: kinds, each followed by its instances if they are unfolded or searched for.
    fn rows(&self, scene: &InstancedScene) -> Vec<Row> {
        let labels = scene.instance_labels();
        let wanted = self.search.trim().to_lowercase();
        let mut members = vec![Vec::new(); scene.template_ranges.len()];
        scene.instances.iter().enumerate().for_each(|(k, instance)| members[instance.template as usize].push(k));
        let mut rows = Vec::new();
        for (template, members) in (0..).zip(members).filter(|(_, members)| !members.is_empty()) {
            let name = template_name(scene, template);
            let whole = name.to_lowercase().contains(&wanted);
            let instance = |&k: &usize| {
                let number = labels[k].id.map_or_else(|| format!("({k})"), |id| id.to_string());
                Row::Instance { k, name: format!("{name} {number}") }
            };
            let found = |row: &Row| match row {
                Row::Instance { name, .. } => whole || name.to_lowercase().contains(&wanted),
                Row::Kind { .. } => whole,
            };
            let instances: Vec<Row> = members.iter().map(instance).filter(found).collect();
            if !whole && instances.is_empty() {
                continue;
            }
            rows.push(Row::Kind { template, name: name.clone(), members });
            // What was searched for by number is listed even if its kind is folded.
            if self.unfolded.contains(&template) || !whole {
                rows.extend(instances);
            }
        }
        rows
    }

    fn row(&mut self, ui: &mut Ui, row: &Row, facts: &Facts<'_>, actions: &mut Vec<Action>) {
        ui.horizontal(|ui| match row {
            Row::Kind { template, name, members } => {
                let unfolded = self.unfolded.contains(template);
                let caret = if unfolded { icon::CARET_DOWN } else { icon::CARET_RIGHT };
                if ui.add(Button::new(caret).frame(false)).on_hover_text(texts::UNFOLD_TIP).clicked() {
                    if unfolded {
                        self.unfolded.remove(template);
                    } else {
                        self.unfolded.insert(*template);
                    }
                }
                if self.renaming.as_ref().is_some_and(|(renamed, _)| renamed == template) {
                    return self.rename(ui, actions);
                }
                let chosen = members.iter().all(|k| facts.editor.chosen().contains(k));
                let text = RichText::new(format!("{name}  ({})", members.len())).strong();
                let response = ui.add(Button::selectable(chosen, text).truncate());
                if response.double_clicked() {
                    self.renaming = Some((*template, name.clone()));
                } else if response.clicked() {
                    let more = ui.input(|input| input.modifiers.shift || input.modifiers.command);
                    actions.push(Action::Choose(members.clone(), more));
                }
                eye_and_lock(ui, members, facts, actions);
                if ui.add(Button::new(icon::PENCIL_SIMPLE).frame(false)).on_hover_text(texts::RENAME_TIP).clicked() {
                    self.renaming = Some((*template, name.clone()));
                }
            }
            Row::Instance { k, name } => {
                ui.add_space(22.0);
                let response = ui.add(Button::selectable(facts.editor.chosen().contains(k), name).truncate());
                if response.clicked() {
                    let more = ui.input(|input| input.modifiers.shift || input.modifiers.command);
                    actions.push(if more { Action::Toggle(*k) } else { Action::Choose(vec![*k], false) });
                }
                if response.double_clicked() {
                    actions.push(Action::Frame);
                }
                eye_and_lock(ui, &[*k], facts, actions);
            }
        });
    }

    /// The field of a new name; Enter takes it, Esc does not.
    fn rename(&mut self, ui: &mut Ui, actions: &mut Vec<Action>) {
        let Some((template, name)) = &mut self.renaming else { return };
        let response = ui.add(TextEdit::singleline(name).desired_width(WIDTH / 2.0));
        if !response.lost_focus() {
            return response.request_focus();
        }
        if !ui.input(|input| input.key_pressed(Key::Escape)) && !name.trim().is_empty() {
            actions.push(Action::Edit(Edit::Rename { template: *template, name: name.clone() }));
        }
        self.renaming = None;
    }
}

/// Buttons that hide and lock instances; they show what these are.
fn eye_and_lock(ui: &mut Ui, members: &[usize], facts: &Facts<'_>, actions: &mut Vec<Action>) {
    let hidden = members.iter().all(|k| facts.editor.hidden().contains(k));
    let locked = members.iter().all(|k| facts.editor.locked().contains(k));
    let eye = if hidden { icon::EYE_SLASH } else { icon::EYE };
    if ui.add(Button::new(eye).frame(false)).on_hover_text(texts::EYE_TIP).clicked() {
        actions.push(Action::SetHidden(members.to_vec(), !hidden));
    }
    let lock = if locked { icon::LOCK_SIMPLE } else { icon::LOCK_SIMPLE_OPEN };
    if ui.add(Button::new(lock).frame(false)).on_hover_text(texts::LOCK_TIP).clicked() {
        actions.push(Action::SetLocked(members.to_vec(), !locked));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;

    #[test]
    fn kinds_are_listed_and_instances_found_by_name() {
        let scene = sample_scene();
        let mut list = Outliner::default();
        let kinds = list.rows(&scene);
        assert!(kinds.iter().all(|row| matches!(row, Row::Kind { .. })) && kinds.len() > 1);
        list.unfolded.extend(0..scene.template_ranges.len() as u32);
        assert_eq!(list.rows(&scene).len(), kinds.len() + scene.instances.len());
        let Some(Row::Instance { name, .. }) = list.rows(&scene).pop() else { panic!("the last is an instance") };
        list.unfolded.clear();
        list.search = name.to_uppercase();
        let found = list.rows(&scene);
        assert!(matches!(&found[..], [Row::Kind { .. }, Row::Instance { name: one, .. }] if *one == name), "{found:?}");
        list.search = "no such thing".into();
        assert_eq!(list.rows(&scene), []);
    }
}
