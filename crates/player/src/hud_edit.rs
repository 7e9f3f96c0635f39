//! The panel of the selection: numbers to type or drag, buttons, and tools for templates. It changes nothing itself but
//! returns the user's actions in order.
//!
//! Edits by a widget while it is held or typed into are one change: each `Live` edit replaces the previous one until
//! `Finish`.

mod place;
mod scatter;
mod template;

use std::collections::BTreeSet;
use std::path::PathBuf;

use egui::{Align2, Button, Context, Id, Ui};
use glam::DVec3;

use super::editor::Editor;
use super::gizmo::GizmoMode;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Selector};

pub(super) use place::{one, three};

use place::Relative;
use scatter::ScatterFields;
use template::{CropFields, Shift};

/// Width of the panel, points.
const WIDTH: f32 = 240.0;
/// Height in points that the panel's title and margins take of the window.
const MARGINS: f32 = 60.0;

/// What the panel displays.
pub(super) struct EditFacts<'a> {
    pub(super) scene: &'a InstancedScene,
    pub(super) editor: &'a Editor,
    /// The up axis of the scene.
    pub(super) up: DVec3,
    /// World units per point of dragging a number.
    pub(super) step: f64,
    /// Displacement of a copy from its original, world units.
    pub(super) beside: DVec3,
    pub(super) mode: GizmoMode,
    /// The file that the scene is saved to.
    pub(super) file: String,
}

/// An action that the user asked for in the panel.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Action {
    Edit(Edit),
    Live(Edit),
    Finish,
    Cancel,
    Undo,
    Redo,
    Hide,
    ShowAll,
    ChooseAlike,
    ChooseGroup,
    Mode(GizmoMode),
    /// Writes a file, in the format that its extension names.
    Write(PathBuf),
}

/// The brush that erases Gaussians of a template.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Brush {
    /// True if clicks and drags erase.
    pub(super) on: bool,
    /// Radius of the brush, in template units.
    pub(super) radius: f64,
}

/// State of the panel's fields between frames.
#[derive(Default)]
pub(super) struct EditPanel {
    /// The selection that the fields were filled from.
    chosen: BTreeSet<usize>,
    /// Number of undo steps at the last frame.
    steps: usize,
    /// The widget whose change is in progress.
    live: Option<Id>,
    relative: Relative,
    shift: Shift,
    scatter: ScatterFields,
    crop: Option<CropFields>,
    pub(super) brush: Brush,
    file: String,
}

impl EditPanel {
    /// Lays out the panel and returns the user's actions.
    pub(super) fn lay_out(&mut self, ctx: &Context, facts: &EditFacts<'_>) -> Vec<Action> {
        self.follow(facts);
        let mut actions = Vec::new();
        let corner = ctx.content_rect().right_top() + egui::vec2(-8.0, 8.0);
        egui::Window::new("Edit")
            .pivot(Align2::RIGHT_TOP)
            .default_pos(corner)
            .default_width(WIDTH)
            .resizable(false)
            .show(ctx, |ui| {
                let height = (ctx.content_rect().height() - MARGINS).max(WIDTH / 2.0);
                let contents = egui::ScrollArea::vertical().max_height(height);
                contents.show(ui, |ui| self.contents(ui, facts, &mut actions));
            });
        self.settle(ctx, &mut actions);
        actions
    }

    /// Resets the fields whose selection or undo step is no longer the present one.
    fn follow(&mut self, facts: &EditFacts<'_>) {
        let steps = facts.editor.steps()[0];
        if *facts.editor.chosen() != self.chosen || steps < self.steps {
            let (brush, file) = (self.brush, std::mem::take(&mut self.file));
            *self = Self { chosen: facts.editor.chosen().clone(), brush, file, ..Self::default() };
            self.scatter = ScatterFields::beside(facts);
        }
        self.steps = steps;
        if !facts.editor.is_live() && self.live.take().is_some() {
            // A key or a click ended the crop.
            self.crop = None;
            self.relative = Relative::default();
        }
    }

    fn contents(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        history(ui, facts, actions);
        match facts.editor.chosen().iter().copied().collect::<Vec<usize>>().as_slice() {
            [] => {
                ui.label("Click an object to select it; Shift+click adds or removes one.");
            }
            [one] => {
                name(ui, facts, *one);
                self.of_chosen(ui, facts, actions);
                self.place_of_one(ui, facts, *one, actions);
            }
            several => {
                ui.strong(format!("{} instances", several.len()));
                self.of_chosen(ui, facts, actions);
                self.place_of_several(ui, facts, actions);
            }
        }
        if let Some(&first) = facts.editor.chosen().first() {
            ui.collapsing("Colour and template", |ui| self.recolour_and_swap(ui, facts, first, actions));
            ui.collapsing("Scatter copies", |ui| self.scatter_copies(ui, facts, first, actions));
            ui.collapsing("Crop and erase in the template", |ui| self.crop_and_brush(ui, facts, first, actions));
        }
        ui.separator();
        self.files(ui, facts, actions);
    }

    /// The buttons that act on the selection.
    fn of_chosen(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        let Some(which) = facts.editor.selector() else { return };
        ui.horizontal(|ui| {
            if ui.button("copy").clicked() {
                actions.push(Action::Edit(Edit::Duplicate { which: which.clone(), by: facts.beside, turn: None }));
            }
            if ui.button("delete").clicked() {
                actions.push(Action::Edit(Edit::Delete { which }));
            }
            pushes(ui, true, "hide", Action::Hide, actions);
            pushes(ui, true, "same template", Action::ChooseAlike, actions);
            pushes(ui, true, "same group", Action::ChooseGroup, actions);
        });
        ui.horizontal(|ui| {
            ui.label("handles");
            for (label, mode) in [
                ("move", GizmoMode::Move),
                ("turn", GizmoMode::Turn),
                ("scale", GizmoMode::Scale),
                ("none", GizmoMode::Off),
            ] {
                if ui.selectable_label(facts.mode == mode, label).clicked() {
                    actions.push(Action::Mode(mode));
                }
            }
        });
    }

    fn files(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        if self.file.is_empty() {
            self.file.clone_from(&facts.file);
        }
        ui.horizontal(|ui| {
            ui.add(egui::TextEdit::singleline(&mut self.file).desired_width(180.0));
            if ui.button("write").on_hover_text(".instgs saves; .glb, .ply, .spz and .sog export").clicked() {
                actions.push(Action::Write(PathBuf::from(self.file.trim())));
            }
        });
    }

    /// Records a change by a widget that is still held.
    fn change(&mut self, widget: Id, edit: Edit, actions: &mut Vec<Action>) {
        if self.live != Some(widget) {
            actions.push(Action::Finish);
            self.live = Some(widget);
        }
        actions.push(Action::Live(edit));
    }

    /// Completes the change in progress once nothing is held or typed into. A crop stays in progress until it is
    /// applied or cancelled.
    fn settle(&mut self, ctx: &Context, actions: &mut Vec<Action>) {
        let cropping = self.crop.as_ref().is_some_and(|crop| self.live == Some(crop.id));
        let held = ctx.input(|input| input.pointer.any_down()) || ctx.memory(|memory| memory.focused().is_some());
        if self.live.is_some() && !cropping && !held {
            actions.push(Action::Finish);
            self.live = None;
            self.relative = Relative::default();
            self.shift.finish();
        }
    }
}

/// A button that appends an action.
fn pushes(ui: &mut Ui, enabled: bool, label: &str, action: Action, actions: &mut Vec<Action>) {
    if ui.add_enabled(enabled, Button::new(label)).clicked() {
        actions.push(action);
    }
}

/// Buttons for undo, redo and showing hidden instances.
fn history(ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
    let [undo, redo] = facts.editor.steps();
    let hidden = facts.editor.hidden().len();
    ui.horizontal(|ui| {
        pushes(ui, undo > 0 || facts.editor.is_live(), "undo", Action::Undo, actions);
        pushes(ui, redo > 0, "redo", Action::Redo, actions);
        pushes(ui, hidden > 0, &format!("show all ({hidden} hidden)"), Action::ShowAll, actions);
    });
}

/// Names the instance, its template and its group.
fn name(ui: &mut Ui, facts: &EditFacts<'_>, k: usize) {
    let scene = facts.scene;
    let template = scene.instances[k].template;
    let label = scene.instance_labels()[k];
    let group = label.group.and_then(|g| scene.groups[g].name.clone()).unwrap_or_else(|| "none".into());
    let id = label.id.map_or_else(String::new, |id| format!(", id {id}"));
    ui.strong(format!("instance {k}{id}"));
    let count = scene.template_ranges[template as usize].count;
    let own = scene.own_range(k).count;
    let own = if own > 0 { format!(", {own} of its own") } else { String::new() };
    ui.label(format!("template {template} ({count} Gaussians{own}), group {group}"));
}

/// The instances that a change of colour applies to.
fn selector(facts: &EditFacts<'_>, whole_template: Option<u32>) -> Selector {
    let chosen = || Selector::Indices(facts.editor.chosen().iter().copied().collect());
    whole_template.map_or_else(chosen, Selector::Template)
}

#[cfg(test)]
mod tests;
