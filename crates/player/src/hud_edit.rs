//! The panel of the selection: numbers to type or drag, buttons, and tools for templates. It changes nothing itself but
//! returns the user's actions in order.
//!
//! Edits by a widget while it is held or typed into are one change: each `Live` edit replaces the previous one until
//! `Finish`.

mod arrange;
mod place;
mod scatter;
mod template;

use std::collections::BTreeSet;

use egui::{Button, Context, Id, Ui};
use glam::DVec3;

use super::actions::Action;
use super::editor::Editor;
use super::gizmo::GizmoMode;
use super::texts;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Selector};

pub(super) use place::{one, three};

use place::Relative;
use scatter::ScatterFields;
use template::{CropFields, Shift};

/// Width of the panel, points.
const WIDTH: f32 = 264.0;

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
}

impl EditPanel {
    /// Lays out the panel and appends the user's actions.
    pub(super) fn lay_out(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        self.follow(facts);
        ui.set_min_width(WIDTH);
        self.contents(ui, facts, actions);
    }

    /// True while a change waits for a button of the panel.
    pub(super) fn is_busy(&self) -> bool {
        self.live.is_some() || self.scatter.draws
    }

    /// Takes a point of the scene for scattering along a path or in a polygon; false if no points are drawn.
    pub(super) fn add_point(&mut self, point: DVec3) -> bool {
        if self.scatter.draws {
            self.scatter.points.push(point);
        }
        self.scatter.draws
    }

    /// Removes the last drawn point; false if no points are drawn.
    pub(super) fn remove_point(&mut self) -> bool {
        if self.scatter.draws {
            self.scatter.points.pop();
        }
        self.scatter.draws
    }

    /// Ends the drawing of points; false if none are drawn.
    pub(super) fn stop_points(&mut self) -> bool {
        std::mem::take(&mut self.scatter.draws)
    }

    /// True while clicks draw points.
    pub(super) fn draws_points(&self) -> bool {
        self.scatter.draws
    }

    /// The drawn points, world units, and whether the last is joined to the first.
    pub(super) fn drawn_points(&self) -> (&[DVec3], bool) {
        self.scatter.outline()
    }

    /// True while scattered copies are shown and wait for a button: no other field was changed since.
    fn previews(&self) -> bool {
        self.live.is_some() && self.live == self.scatter.preview
    }

    /// Resets the fields whose selection or undo step is no longer the present one.
    fn follow(&mut self, facts: &EditFacts<'_>) {
        let (steps, is_live) = (facts.editor.steps()[0], facts.editor.is_live());
        if self.scatter.preview.is_some() && !self.previews() {
            // Another field has completed the copies, and changes them from now on.
            self.chosen = facts.editor.chosen().clone();
            self.scatter = ScatterFields::beside(facts);
        }
        let has_grown = steps > self.steps;
        // Scattering selects what it adds, and goes on with the object it began with.
        let previews = self.previews() && is_live;
        if !previews && (*facts.editor.chosen() != self.chosen || steps < self.steps) {
            let brush = self.brush;
            *self = Self { chosen: facts.editor.chosen().clone(), brush, ..Self::default() };
            self.scatter = ScatterFields::beside(facts);
        }
        self.steps = steps;
        // An edit that is not possible leaves nothing in progress; the fields stay, so that they can be set otherwise.
        if !is_live && !facts.editor.has_live_failed() && self.live.take().is_some() {
            // A key or a click ended the change.
            self.crop = None;
            self.scatter.preview = None;
            self.relative = Relative::default();
            if has_grown {
                self.shift.finish();
            } else {
                self.shift.cancel();
            }
        }
    }

    fn contents(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        match facts.editor.chosen().iter().copied().collect::<Vec<usize>>().as_slice() {
            [] => {
                ui.label(texts::NOTHING_SELECTED);
            }
            [one] => {
                name(ui, facts, *one);
                self.of_chosen(ui, facts, actions);
                self.place_of_one(ui, facts, *one, actions);
            }
            several => {
                ui.strong(texts::instances(several.len()));
                self.of_chosen(ui, facts, actions);
                self.place_of_several(ui, facts, actions);
            }
        }
        let Some(&first) = facts.editor.chosen().first() else { return };
        ui.collapsing(texts::COLOUR, |ui| self.recolour(ui, facts, first, actions));
        ui.collapsing(texts::TEMPLATE, |ui| arrange::own_and_template(ui, facts, first, actions));
        ui.collapsing(texts::ARRANGE, |ui| arrange::arrange(ui, facts, actions));
        ui.collapsing(texts::SCATTER, |ui| self.scatter_copies(ui, facts, first, actions));
        ui.collapsing(texts::EDIT_TEMPLATE, |ui| self.crop_and_brush(ui, facts, first, actions));
    }

    /// The buttons that act on the selection.
    fn of_chosen(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        let Some(which) = facts.editor.selector() else { return };
        ui.horizontal(|ui| {
            if ui.button(texts::DUPLICATE).clicked() {
                actions.push(Action::Edit(Edit::Duplicate { which: which.clone(), by: facts.beside, turn: None }));
            }
            if ui.button(texts::DELETE).clicked() {
                actions.push(Action::Edit(Edit::Delete { which }));
            }
            pushes(ui, true, texts::HIDE, Action::Hide, actions);
        });
        ui.horizontal(|ui| {
            pushes(ui, true, texts::SAME_TEMPLATE, Action::ChooseAlike, actions);
            pushes(ui, true, texts::SAME_GROUP, Action::ChooseGroup, actions);
        });
        ui.horizontal(|ui| {
            ui.label(texts::HANDLES);
            for (label, mode) in [
                (texts::MOVE, GizmoMode::Move),
                (texts::ROTATE, GizmoMode::Turn),
                (texts::SCALE, GizmoMode::Scale),
                (texts::NONE, GizmoMode::Off),
            ] {
                if ui.selectable_label(facts.mode == mode, label).clicked() {
                    actions.push(Action::Mode(mode));
                }
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

    /// Completes the change in progress once nothing is held or typed into. A crop and a preview stay in progress until
    /// they are applied or cancelled.
    pub(super) fn settle(&mut self, ctx: &Context, actions: &mut Vec<Action>) {
        let waits = self.previews() || self.crop.as_ref().is_some_and(|crop| self.live == Some(crop.id));
        let held = ctx.input(|input| input.pointer.any_down()) || ctx.memory(|memory| memory.focused().is_some());
        if self.live.is_some() && !waits && !held {
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

/// Names the instance, its template and its group.
fn name(ui: &mut Ui, facts: &EditFacts<'_>, k: usize) {
    let scene = facts.scene;
    let template = scene.instances[k].template;
    let label = scene.instance_label(k);
    let group = label.group.and_then(|g| scene.groups[g].name.as_deref());
    ui.strong(texts::instance(k, label.id));
    let count = scene.template_ranges[template as usize].count;
    ui.label(texts::template_and_group(template, count, scene.own_range(k).count, group));
}

/// The instances that a change of colour applies to.
fn selector(facts: &EditFacts<'_>, whole_template: Option<u32>) -> Selector {
    let chosen = || Selector::Indices(facts.editor.chosen().iter().copied().collect());
    whole_template.map_or_else(chosen, Selector::Template)
}

#[cfg(test)]
mod tests;
