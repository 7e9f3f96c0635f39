//! The list of what is in the scene: kinds of objects with their instances, and the background.

use std::collections::BTreeSet;

use egui::{Button, Key, RichText, ScrollArea, TextEdit, Ui};
use egui_phosphor::regular as icon;

use super::{Facts, WIDTH};
use crate::actions::Action;
use crate::editor::Editor;
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
    /// The list as it was laid out last; none after it was searched or folded in another way.
    listed: Option<Listed>,
}

/// The lines of the list, for what the editor's [`listing`](crate::editor::Editor::listing) was then: with thousands of instances
/// their names take longer than the rest of a frame.
struct Listed {
    listing: u64,
    rows: Vec<Row>,
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
    group.and_then(|group| group.name.clone()).unwrap_or_else(|| texts::template(template))
}

impl Outliner {
    /// Lays out the list.
    pub(super) fn lay_out(&mut self, ui: &mut Ui, facts: &Facts<'_>, actions: &mut Vec<Action>) {
        let Facts { scene, editor, background_len, .. } = *facts;
        self.contents(ui, scene, background_len, editor, actions);
    }

    fn contents(
        &mut self,
        ui: &mut Ui,
        scene: &InstancedScene,
        background_len: u64,
        editor: &Editor,
        actions: &mut Vec<Action>,
    ) {
        ui.set_min_width(WIDTH);
        let count = scene.instances.len();
        if count == 0 {
            ui.label(texts::NO_INSTANCES);
        } else {
            let hint = format!("{} {}", icon::MAGNIFYING_GLASS, texts::SEARCH);
            let field = TextEdit::singleline(&mut self.search).hint_text(hint).desired_width(f32::INFINITY);
            if ui.add(field).changed() {
                self.listed = None;
            }
            let listed = self.take_listed(scene, editor);
            let rows = &listed.rows;
            if rows.is_empty() {
                ui.label(texts::NOTHING_FOUND);
            }
            let height = ui.spacing().interact_size.y;
            let room = HEIGHT.min(ui.ctx().content_rect().height() / 2.0);
            let folds = ScrollArea::vertical().max_height(room).show_rows(ui, height, rows.len(), |ui, range| {
                rows[range].iter().fold(false, |folds, row| self.row(ui, row, editor, actions) | folds)
            });
            self.listed = Some(listed).filter(|_| !folds.inner);
            ui.horizontal(|ui| {
                if ui.button(texts::SELECT_ALL).clicked() {
                    actions.push(Action::Choose((0..count).collect(), false));
                }
                let hidden = !editor.hidden().is_empty();
                if ui.add_enabled(hidden, Button::new(texts::SHOW_ALL)).clicked() {
                    actions.push(Action::ShowAll);
                }
            });
        }
        ui.separator();
        let background = grouped(background_len);
        ui.label(texts::background_gaussians(&background));
    }

    /// The list of the last frame, or a new one if that is out of date.
    fn take_listed(&mut self, scene: &InstancedScene, editor: &Editor) -> Listed {
        let listing = editor.listing();
        let known = self.listed.take().filter(|listed| listed.listing == listing);
        known.unwrap_or_else(|| Listed { listing, rows: self.rows(scene) })
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

    /// Lays out a line; true if it was folded or unfolded.
    fn row(&mut self, ui: &mut Ui, row: &Row, editor: &Editor, actions: &mut Vec<Action>) -> bool {
        ui.horizontal(|ui| match row {
            Row::Kind { template, name, members } => self.kind(ui, (*template, name, members), editor, actions),
            Row::Instance { k, name } => {
                instance(ui, *k, name, editor, actions);
                false
            }
        })
        .inner
    }

    /// The line of a kind of objects; true if it was folded or unfolded.
    fn kind(
        &mut self,
        ui: &mut Ui,
        (template, name, members): (u32, &str, &[usize]),
        editor: &Editor,
        actions: &mut Vec<Action>,
    ) -> bool {
        let unfolded = self.unfolded.contains(&template);
        let caret = if unfolded { icon::CARET_DOWN } else { icon::CARET_RIGHT };
        let folds = ui.add(Button::new(caret).frame(false)).on_hover_text(texts::UNFOLD_TIP).clicked();
        if folds && !self.unfolded.remove(&template) {
            self.unfolded.insert(template);
        }
        if self.renaming.as_ref().is_some_and(|(renamed, _)| *renamed == template) {
            self.rename(ui, name, actions);
            return folds;
        }
        let text = RichText::new(format!("{name}  ({})", members.len())).strong();
        let response = ui.add(Button::selectable(holds(editor.chosen(), members), text).truncate());
        if response.double_clicked() {
            self.renaming = Some((template, name.to_owned()));
        } else if response.clicked() {
            let more = ui.input(|input| input.modifiers.shift || input.modifiers.command);
            actions.push(Action::Choose(members.to_vec(), more));
        }
        eye_and_lock(ui, members, editor, actions);
        if ui.add(Button::new(icon::PENCIL_SIMPLE).frame(false)).on_hover_text(texts::RENAME_TIP).clicked() {
            self.renaming = Some((template, name.to_owned()));
        }
        folds
    }

    /// The field of a new name in the place of `name`; Enter takes it, Esc does not.
    fn rename(&mut self, ui: &mut Ui, name: &str, actions: &mut Vec<Action>) {
        let Some((template, text)) = &mut self.renaming else { return };
        let response = ui.add(TextEdit::singleline(text).desired_width(WIDTH / 2.0));
        if !response.lost_focus() {
            return response.request_focus();
        }
        let is_new = !text.trim().is_empty() && text != name;
        if is_new && !ui.input(|input| input.key_pressed(Key::Escape)) {
            actions.push(Action::Edit(Edit::Rename { template: *template, name: text.clone() }));
        }
        self.renaming = None;
    }
}

/// The line of an instance.
fn instance(ui: &mut Ui, k: usize, name: &str, editor: &Editor, actions: &mut Vec<Action>) {
    ui.add_space(22.0);
    let response = ui.add(Button::selectable(editor.chosen().contains(&k), name).truncate());
    if response.clicked() {
        let more = ui.input(|input| input.modifiers.shift || input.modifiers.command);
        actions.push(if more { Action::Toggle(k) } else { Action::Choose(vec![k], false) });
    }
    if response.double_clicked() {
        actions.push(Action::Frame);
    }
    eye_and_lock(ui, &[k], editor, actions);
}

/// True if all of some instances are in a set.
fn holds(set: &BTreeSet<usize>, members: &[usize]) -> bool {
    set.len() >= members.len() && members.iter().all(|k| set.contains(k))
}

/// Buttons that hide and lock instances; they show what these are.
fn eye_and_lock(ui: &mut Ui, members: &[usize], editor: &Editor, actions: &mut Vec<Action>) {
    let hidden = holds(editor.hidden(), members);
    let locked = holds(editor.locked(), members);
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
    use instgs_vk::scene::edit::Selector;

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

    /// A scene of many instances of one kind, which is unfolded.
    fn many(count: usize) -> (InstancedScene, Outliner) {
        let mut scene = sample_scene();
        scene.instances = vec![scene.instances[0].clone(); count];
        let template = scene.instances[0].template;
        (scene, Outliner { unfolded: [template].into(), ..Outliner::default() })
    }

    fn names(listed: &Listed) -> usize {
        listed.rows.iter().filter(|row| matches!(row, Row::Instance { .. })).count()
    }

    #[test]
    fn the_list_is_made_anew_only_when_it_is_out_of_date() {
        let (mut scene, mut list) = many(50);
        let mut editor = Editor::default();
        let listed = list.take_listed(&scene, &editor);
        let (rows, count) = (listed.rows.as_ptr(), names(&listed));
        list.listed = Some(listed);
        let again = list.take_listed(&scene, &editor);
        assert!(again.rows.as_ptr() == rows && count == 50);
        list.listed = Some(again);
        editor.apply(&mut scene, &Edit::Delete { which: Selector::Indices(vec![3, 4]) }).unwrap();
        assert_eq!(names(&list.take_listed(&scene, &editor)), 48);
    }

    /// Prints what a frame of the panel takes, with the list of the last frame and with a new one in each.
    #[test]
    #[ignore = "a measurement; docs/measurements.md has the figures"]
    #[allow(clippy::print_stdout, reason = "what was measured, with --nocapture")]
    fn frames_of_ten_thousand_instances() {
        for anew in [true, false] {
            let (scene, mut list) = many(10_000);
            let (editor, ctx) = (Editor::default(), egui::Context::default());
            let mut times = Vec::new();
            for _ in 0..200 {
                if anew {
                    list.listed = None;
                }
                let start = std::time::Instant::now();
                let output = ctx.run(egui::RawInput::default(), |ctx| {
                    egui::Window::new("list").show(ctx, |ui| list.contents(ui, &scene, 0, &editor, &mut Vec::new()));
                });
                assert!(!output.shapes.is_empty());
                times.push(1e3 * start.elapsed().as_secs_f64());
            }
            println!("new list in each frame: {anew}: {:.2} ms", instgs_vk::math::statistics::median(&times));
        }
    }
}
