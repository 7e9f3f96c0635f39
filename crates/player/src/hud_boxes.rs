//! Boxes around objects: their lines over the picture, one line of what to do next, and the panel. It changes nothing
//! itself: it says what is to be done, in order.

use std::path::PathBuf;

use egui::{Align2, Color32, Context, DragValue, Id, Pos2, Stroke, Ui};
use glam::{DQuat, DVec3};

use super::box_handles::{BoxHandles, BoxPart, edges_px};
use super::boxes::{BoxList, Origin};
use super::gizmo::GizmoMode;
use super::hud_edit::{one, three};
use super::hud_gizmo::{HOT, line, paint_lines};
use instgs_vk::scene::{Camera, ObjectBox};

/// Of boxes that were drawn, and that were found.
const DRAWN: Color32 = Color32::from_rgb(255, 150, 40);
const FOUND: Color32 = Color32::from_rgb(70, 220, 240);
/// Of lines, points of the interface; of the chosen box.
const WIDTH: f32 = 1.5;
const CHOSEN_WIDTH: f32 = 3.0;
/// Radius of a dot, points; of the one under the pointer.
const DOT: f32 = 4.5;
const HOT_DOT: f32 = 6.5;
/// Degrees for a point of dragging a number.
const DEGREES_PER_POINT: f64 = 0.5;
/// Edges that can be typed, world units: what f32 clouds can hold.
const EDGES: std::ops::RangeInclusive<f64> = 1e-6..=1e9;
/// Height of the list, points: about eight boxes.
const LIST_HEIGHT: f32 = 150.0;

/// What the panel shows.
pub(super) struct BoxFacts<'a> {
    pub(super) list: &'a BoxList,
    /// The scene's vertical.
    pub(super) up: DVec3,
    /// World units for a point of dragging a number.
    pub(super) step: f64,
    pub(super) mode: GizmoMode,
    /// Of a search: what part is done.
    pub(super) searched: Option<f32>,
    /// Searches find other sizes too.
    pub(super) other_sizes: bool,
    /// Where the boxes are saved.
    pub(super) file: String,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum BoxAction {
    /// The chosen box becomes another; goes on until `Finish`.
    Change(ObjectBox),
    Finish,
    Undo,
    Redo,
    Choose(usize),
    Remove(usize),
    Find,
    CancelSearch,
    /// Searches find other sizes too, or no longer.
    OtherSizes(bool),
    Mode(GizmoMode),
    Save(PathBuf),
    Leave,
}

/// What the fields hold between pictures.
#[derive(Default)]
pub(super) struct BoxPanel {
    /// The widget whose change goes on.
    live: Option<Id>,
    file: String,
}

impl BoxPanel {
    /// Lays the line and the panel out; what their user wants done.
    pub(super) fn lay_out(&mut self, ctx: &Context, facts: &BoxFacts<'_>) -> Vec<BoxAction> {
        let mut actions = Vec::new();
        egui::Area::new("boxes hint".into()).anchor(Align2::CENTER_TOP, [0.0, 8.0]).show(ctx, |ui| {
            let line = egui::Label::new(hint(facts)).extend();
            egui::Frame::popup(ui.style()).show(ui, |ui| ui.add(line));
        });
        let corner = ctx.content_rect().right_top() + egui::vec2(-8.0, 48.0);
        egui::Window::new("Boxes").pivot(Align2::RIGHT_TOP).default_pos(corner).resizable(false).show(ctx, |ui| {
            self.contents(ui, facts, &mut actions);
        });
        let held = ctx.input(|input| input.pointer.any_down()) || ctx.memory(|memory| memory.focused().is_some());
        if self.live.is_some() && !held {
            actions.push(BoxAction::Finish);
            self.live = None;
        }
        actions
    }

    fn contents(&mut self, ui: &mut Ui, facts: &BoxFacts<'_>, actions: &mut Vec<BoxAction>) {
        let [undo, redo] = facts.list.steps();
        ui.horizontal(|ui| {
            pushes(ui, undo > 0 || facts.list.is_live(), "undo", BoxAction::Undo, actions);
            pushes(ui, redo > 0, "redo", BoxAction::Redo, actions);
            pushes(ui, true, "close", BoxAction::Leave, actions);
        });
        if let Some(chosen) = facts.list.chosen_box() {
            ui.strong(format!("box {}", chosen.object.id));
            self.numbers(ui, facts, &chosen.object, actions);
            handles(ui, facts.mode, actions);
        }
        search(ui, facts, actions);
        ui.separator();
        rows(ui, facts.list, actions);
        ui.separator();
        if self.file.is_empty() {
            self.file.clone_from(&facts.file);
        }
        ui.horizontal(|ui| {
            ui.add(egui::TextEdit::singleline(&mut self.file).desired_width(180.0));
            let words = "for instgs-vk masks --boxes and train --boxes";
            if ui.button("save").on_hover_text(words).clicked() {
                actions.extend(self.file().map(BoxAction::Save));
            }
        });
    }

    /// Category, centre, edges and turn of the chosen box.
    fn numbers(&mut self, ui: &mut Ui, facts: &BoxFacts<'_>, object: &ObjectBox, actions: &mut Vec<BoxAction>) {
        let mut category = object.category.clone().unwrap_or_default();
        let typed = ui.horizontal(|ui| {
            ui.label("what it is");
            let field = egui::TextEdit::singleline(&mut category).hint_text("car, chair ...").desired_width(120.0);
            ui.add(field).changed()
        });
        if typed.inner {
            let category = Some(category).filter(|text| !text.trim().is_empty());
            self.change(ui.id().with("category"), ObjectBox { category, ..object.clone() }, actions);
        }
        let mut center = object.center.to_array();
        if three(ui, "centre", &mut center, facts.step, "") {
            let center = DVec3::from_array(center);
            self.change(ui.id().with("centre"), ObjectBox { center, ..object.clone() }, actions);
        }
        let mut size = object.size.to_array();
        if three(ui, "size", &mut size, facts.step, "") {
            let size = DVec3::from_array(size).clamp(DVec3::splat(*EDGES.start()), DVec3::splat(*EDGES.end()));
            self.change(ui.id().with("size"), ObjectBox { size, ..object.clone() }, actions);
        }
        let mut degrees = yaw_degrees(object, facts.up);
        let before = degrees;
        if one(ui, "turn", DragValue::new(&mut degrees).speed(DEGREES_PER_POINT).suffix("°")) {
            let turn = DQuat::from_axis_angle(facts.up, (degrees - before).to_radians());
            let world_from_box = (turn * object.world_from_box).normalize();
            self.change(ui.id().with("turn"), ObjectBox { world_from_box, ..object.clone() }, actions);
        }
    }

    /// A widget changed what goes on while it is held.
    fn change(&mut self, widget: Id, to: ObjectBox, actions: &mut Vec<BoxAction>) {
        if self.live != Some(widget) {
            actions.push(BoxAction::Finish);
            self.live = Some(widget);
        }
        actions.push(BoxAction::Change(to));
    }

    /// Where the field says that boxes go; `None` if it is empty.
    pub(super) fn file(&self) -> Option<PathBuf> {
        Some(self.file.trim()).filter(|name| !name.is_empty()).map(PathBuf::from)
    }

    /// The name in the field follows where the boxes were saved.
    pub(super) fn saved_to(&mut self, file: String) {
        self.file = file;
    }
}

/// What to do next.
fn hint(facts: &BoxFacts<'_>) -> String {
    let [drawn, found] = facts.list.counts();
    let counts = format!("{drawn} drawn, {found} found");
    if facts.searched.is_some() {
        let sizes = if facts.other_sizes { ", of other sizes too" } else { "" };
        return format!("Looking for what is like the box{sizes}; Esc stops it.");
    }
    match (facts.list.chosen_box().map(|listed| listed.origin), found) {
        (None, 0) if drawn == 0 => "Click an object: a box goes around it.  (B leaves)".into(),
        (None, _) => format!("{counts}. Click an object or a box; Shift+click takes a box away; Ctrl+S saves."),
        (Some(Origin::Drawn), 0) => {
            "Drag the dots until the box fits; M moves, T turns it. Then F finds all that look alike.".into()
        }
        (Some(_), _) => format!("{counts}. Shift+click or Delete takes a wrong box away; Ctrl+S saves; F finds again."),
    }
}

fn handles(ui: &mut Ui, mode: GizmoMode, actions: &mut Vec<BoxAction>) {
    ui.horizontal(|ui| {
        ui.label("handles");
        for (label, wanted) in [
            ("move", GizmoMode::Move),
            ("turn", GizmoMode::Turn),
            ("scale", GizmoMode::Scale),
            ("only dots", GizmoMode::Off),
        ] {
            if ui.selectable_label(mode == wanted, label).clicked() {
                actions.push(BoxAction::Mode(wanted));
            }
        }
    });
}

/// What begins a search, or how far it is; and what it looks for.
fn search(ui: &mut Ui, facts: &BoxFacts<'_>, actions: &mut Vec<BoxAction>) {
    ui.horizontal(|ui| match facts.searched {
        Some(part) => {
            ui.add(egui::ProgressBar::new(part).desired_width(140.0).show_percentage());
            pushes(ui, true, "cancel", BoxAction::CancelSearch, actions);
        }
        None => pushes(ui, facts.list.chosen().is_some(), "find the rest (F)", BoxAction::Find, actions),
    });
    let mut other_sizes = facts.other_sizes;
    let switch = egui::Checkbox::new(&mut other_sizes, "other sizes too (O)");
    let words = "half to twice the size; the search takes longer";
    if ui.add_enabled(facts.searched.is_none(), switch).on_hover_text(words).changed() {
        actions.push(BoxAction::OtherSizes(other_sizes));
    }
}

/// One row for each box: a click chooses it, the cross takes it out.
fn rows(ui: &mut Ui, list: &BoxList, actions: &mut Vec<BoxAction>) {
    let [drawn, found] = list.counts();
    ui.label(format!("{drawn} drawn, {found} found"));
    egui::ScrollArea::vertical().max_height(LIST_HEIGHT).auto_shrink([false, true]).show(ui, |ui| {
        for (k, listed) in list.boxes().iter().enumerate() {
            ui.horizontal(|ui| {
                if ui.small_button("x").on_hover_text("take it away").clicked() {
                    actions.push(BoxAction::Remove(k));
                }
                let from = match listed.origin {
                    Origin::Drawn => String::new(),
                    Origin::LikeBox(id) => format!(", like {id}"),
                };
                let category = listed.object.category.as_deref().unwrap_or("no name");
                let words = egui::RichText::new(format!("{}: {category}{from}", listed.object.id));
                let words = words.color(colour_of(listed.origin));
                if ui.selectable_label(list.chosen() == Some(k), words).clicked() {
                    actions.push(BoxAction::Choose(k));
                }
            });
        }
    });
}

/// A button that pushes an action.
fn pushes(ui: &mut Ui, enabled: bool, label: &str, action: BoxAction, actions: &mut Vec<BoxAction>) {
    if ui.add_enabled(enabled, egui::Button::new(label)).clicked() {
        actions.push(action);
    }
}

/// How far the box's first edge is turned about the vertical, degrees.
fn yaw_degrees(object: &ObjectBox, up: DVec3) -> f64 {
    let side = up.any_orthonormal_vector();
    let along = object.world_from_box * DVec3::X;
    along.dot(up.cross(side)).atan2(along.dot(side)).to_degrees()
}

fn colour_of(origin: Origin) -> Color32 {
    match origin {
        Origin::Drawn => DRAWN,
        Origin::LikeBox(_) => FOUND,
    }
}

/// Draws all boxes, and the handles of the chosen one; `hot` is held or under the pointer. The camera's pixels are points of
/// the interface.
pub(super) fn paint_boxes(
    ctx: &Context,
    list: &BoxList,
    camera: &Camera,
    (handles, hot): (Option<&BoxHandles>, Option<BoxPart>),
) {
    for (k, listed) in list.boxes().iter().enumerate() {
        let width = if list.chosen() == Some(k) { CHOSEN_WIDTH } else { WIDTH };
        for edge in edges_px(&listed.object, camera) {
            line(ctx, &edge, Stroke::new(width, colour_of(listed.origin)));
        }
    }
    let Some(handles) = handles else { return };
    let hot_handle = match hot {
        Some(BoxPart::Handle(handle)) => Some(handle),
        _ => None,
    };
    paint_lines(ctx, handles.lines(), hot_handle);
    let painter = ctx.layer_painter(egui::LayerId::background());
    for (part, [x, y]) in handles.dots() {
        let at = Pos2::new(x as f32, y as f32);
        let (radius, colour) = if hot == Some(part) { (HOT_DOT, HOT) } else { (DOT, Color32::WHITE) };
        painter.circle(at, radius, colour, Stroke::new(1.5, Color32::BLACK));
    }
}

#[cfg(test)]
mod tests;
