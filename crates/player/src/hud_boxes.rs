//! Interface of the tool for boxes: their lines over the view, a hint of one line, and the panel. It changes nothing
//! itself but returns the user's actions in order.

use std::path::{Path, PathBuf};

use egui::{Align2, Color32, Context, DragValue, Id, Pos2, Stroke, Ui};
use egui_phosphor::regular as icon;
use glam::{DQuat, DVec3};

use super::box_handles::{BoxHandles, BoxPart, edges_px};
use super::boxes::{BoxList, Origin};
use super::gizmo::GizmoMode;
use super::hud_edit::{one, three};
use super::hud_gizmo::{HOT, line, paint_lines};
use super::path_field::PathField;
use super::texts;
use instgs_vk::scene::{Camera, ObjectBox};

/// Colour of drawn boxes; below, of found boxes.
const DRAWN: Color32 = Color32::from_rgb(255, 150, 40);
const FOUND: Color32 = Color32::from_rgb(70, 220, 240);
/// Line width in points; below, that of the selected box.
const WIDTH: f32 = 1.5;
const CHOSEN_WIDTH: f32 = 3.0;
/// Radius of a dot in points; below, of the one under the pointer.
const DOT: f32 = 4.5;
const HOT_DOT: f32 = 6.5;
/// Degrees per point of dragging a number.
const DEGREES_PER_POINT: f64 = 0.5;
/// Range of edge lengths that can be typed, world units: what f32 clouds can represent.
const EDGES: std::ops::RangeInclusive<f64> = 1e-6..=1e9;
/// Height of the list in points: about eight boxes.
const LIST_HEIGHT: f32 = 150.0;

/// What the panel displays.
pub(super) struct BoxFacts<'a> {
    pub(super) list: &'a BoxList,
    /// The up axis of the scene.
    pub(super) up: DVec3,
    /// World units per point of dragging a number.
    pub(super) step: f64,
    pub(super) mode: GizmoMode,
    /// Progress of the running search, 0 to 1; `None` without one.
    pub(super) searched: Option<f32>,
    /// True if searches also find objects of other sizes.
    pub(super) other_sizes: bool,
    /// The file that the boxes are saved to.
    pub(super) file: PathBuf,
}

/// An action that the user asked for in the panel.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum BoxAction {
    /// Replaces the selected box; the change is in progress until `Finish`.
    Change(ObjectBox),
    Finish,
    Undo,
    Redo,
    Choose(usize),
    Remove(usize),
    Find,
    CancelSearch,
    /// Whether searches also find objects of other sizes.
    OtherSizes(bool),
    Mode(GizmoMode),
    Save(PathBuf),
    Leave,
}

/// State of the panel's fields between frames.
#[derive(Default)]
pub(super) struct BoxPanel {
    /// The widget whose change is in progress.
    live: Option<Id>,
    file: PathField,
}

impl BoxPanel {
    /// Lays out hint and panel, and returns the user's actions.
    pub(super) fn lay_out(&mut self, ctx: &Context, facts: &BoxFacts<'_>) -> Vec<BoxAction> {
        let mut actions = Vec::new();
        egui::Area::new("boxes hint".into()).anchor(Align2::CENTER_TOP, [0.0, 8.0]).show(ctx, |ui| {
            let line = egui::Label::new(hint(facts)).extend();
            egui::Frame::popup(ui.style()).show(ui, |ui| ui.add(line));
        });
        let corner = ctx.content_rect().right_top() + egui::vec2(-8.0, 48.0);
        egui::Window::new(texts::BOXES).pivot(Align2::RIGHT_TOP).default_pos(corner).resizable(false).show(ctx, |ui| {
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
            pushes(ui, undo > 0 || facts.list.is_live(), texts::UNDO, BoxAction::Undo, actions);
            pushes(ui, redo > 0, texts::REDO, BoxAction::Redo, actions);
            pushes(ui, true, texts::CLOSE, BoxAction::Leave, actions);
        });
        if let Some(chosen) = facts.list.chosen_box() {
            ui.strong(texts::box_of(chosen.object.id));
            self.numbers(ui, facts, &chosen.object, actions);
            handles(ui, facts.mode, actions);
        }
        search(ui, facts, actions);
        ui.separator();
        rows(ui, facts.list, actions);
        ui.separator();
        if self.file.is_empty() {
            self.file.give(&facts.file);
        }
        ui.horizontal(|ui| {
            ui.add(egui::TextEdit::singleline(&mut self.file.text).desired_width(180.0));
            if ui.button(texts::SAVE).on_hover_text(texts::SAVE_BOXES_TIP).clicked() {
                actions.extend(self.file().map(BoxAction::Save));
            }
        });
    }

    /// Category, centre, size and turn of the selected box.
    fn numbers(&mut self, ui: &mut Ui, facts: &BoxFacts<'_>, object: &ObjectBox, actions: &mut Vec<BoxAction>) {
        let mut category = object.category.clone().unwrap_or_default();
        let typed = ui.horizontal(|ui| {
            ui.label(texts::CATEGORY);
            let field = egui::TextEdit::singleline(&mut category).hint_text(texts::CATEGORY_HINT).desired_width(120.0);
            ui.add(field).changed()
        });
        if typed.inner {
            let category = Some(category).filter(|text| !text.trim().is_empty());
            self.change(ui.id().with("category"), ObjectBox { category, ..object.clone() }, actions);
        }
        let mut center = object.center.to_array();
        if three(ui, texts::CENTRE, &mut center, facts.step, "") {
            let center = DVec3::from_array(center);
            self.change(ui.id().with("centre"), ObjectBox { center, ..object.clone() }, actions);
        }
        let mut size = object.size.to_array();
        if three(ui, texts::SIZE, &mut size, facts.step, "") {
            let size = DVec3::from_array(size).clamp(DVec3::splat(*EDGES.start()), DVec3::splat(*EDGES.end()));
            self.change(ui.id().with("size"), ObjectBox { size, ..object.clone() }, actions);
        }
        let mut degrees = yaw_degrees(object, facts.up);
        let before = degrees;
        if one(ui, texts::ROTATION, DragValue::new(&mut degrees).speed(DEGREES_PER_POINT).suffix(texts::DEGREES)) {
            let turn = DQuat::from_axis_angle(facts.up, (degrees - before).to_radians());
            let world_from_box = (turn * object.world_from_box).normalize();
            self.change(ui.id().with("turn"), ObjectBox { world_from_box, ..object.clone() }, actions);
        }
    }

    /// Records a change by a widget that is still held.
    fn change(&mut self, widget: Id, to: ObjectBox, actions: &mut Vec<BoxAction>) {
        if self.live != Some(widget) {
            actions.push(BoxAction::Finish);
            self.live = Some(widget);
        }
        actions.push(BoxAction::Change(to));
    }

    /// The file named in the field; `None` if the field is empty.
    pub(super) fn file(&self) -> Option<PathBuf> {
        self.file.path()
    }

    /// Sets the field to the file that the boxes were saved to.
    pub(super) fn saved_to(&mut self, file: &Path) {
        self.file.give(file);
    }
}

/// The hint for the user's next action.
fn hint(facts: &BoxFacts<'_>) -> String {
    let [drawn, found] = facts.list.counts();
    let counts = texts::box_counts(drawn, found);
    if facts.searched.is_some() {
        return if facts.other_sizes { texts::SEARCHING_SIZES } else { texts::SEARCHING }.into();
    }
    match (facts.list.chosen_box().map(|listed| listed.origin), found) {
        (None, 0) if drawn == 0 => texts::HINT_NO_BOX.into(),
        (None, _) => format!("{counts}. {}", texts::HINT_BOXES),
        (Some(Origin::Drawn), 0) => texts::HINT_DRAWN.into(),
        (Some(_), _) => format!("{counts}. {}", texts::HINT_FOUND),
    }
}

fn handles(ui: &mut Ui, mode: GizmoMode, actions: &mut Vec<BoxAction>) {
    ui.horizontal(|ui| {
        ui.label(texts::HANDLES);
        for (label, wanted) in [
            (texts::MOVE, GizmoMode::Move),
            (texts::ROTATE, GizmoMode::Turn),
            (texts::SCALE, GizmoMode::Scale),
            (texts::DOTS_ONLY, GizmoMode::Off),
        ] {
            if ui.selectable_label(mode == wanted, label).clicked() {
                actions.push(BoxAction::Mode(wanted));
            }
        }
    });
}

/// The button that starts a search, or the running search's progress; and its settings.
fn search(ui: &mut Ui, facts: &BoxFacts<'_>, actions: &mut Vec<BoxAction>) {
    ui.horizontal(|ui| match facts.searched {
        Some(part) => {
            ui.add(egui::ProgressBar::new(part).desired_width(140.0).show_percentage());
            pushes(ui, true, texts::CANCEL, BoxAction::CancelSearch, actions);
        }
        None => pushes(ui, facts.list.chosen().is_some(), texts::FIND_REST, BoxAction::Find, actions),
    });
    let mut other_sizes = facts.other_sizes;
    let switch = egui::Checkbox::new(&mut other_sizes, texts::OTHER_SIZES);
    if ui.add_enabled(facts.searched.is_none(), switch).on_hover_text(texts::OTHER_SIZES_TIP).changed() {
        actions.push(BoxAction::OtherSizes(other_sizes));
    }
}

/// One row per box: a click selects it, the cross removes it.
fn rows(ui: &mut Ui, list: &BoxList, actions: &mut Vec<BoxAction>) {
    let [drawn, found] = list.counts();
    ui.label(texts::box_counts(drawn, found));
    egui::ScrollArea::vertical().max_height(LIST_HEIGHT).auto_shrink([false, true]).show(ui, |ui| {
        for (k, listed) in list.boxes().iter().enumerate() {
            ui.horizontal(|ui| {
                if ui.small_button(icon::X).on_hover_text(texts::REMOVE_BOX_TIP).clicked() {
                    actions.push(BoxAction::Remove(k));
                }
                let like = match listed.origin {
                    Origin::Drawn => None,
                    Origin::LikeBox(id) => Some(id),
                };
                let words = texts::box_row(listed.object.id, listed.object.category.as_deref(), like);
                let words = egui::RichText::new(words).color(colour_of(listed.origin));
                if ui.selectable_label(list.chosen() == Some(k), words).clicked() {
                    actions.push(BoxAction::Choose(k));
                }
            });
        }
    });
}

/// A button that appends an action.
fn pushes(ui: &mut Ui, enabled: bool, label: &str, action: BoxAction, actions: &mut Vec<BoxAction>) {
    if ui.add_enabled(enabled, egui::Button::new(label)).clicked() {
        actions.push(action);
    }
}

/// Turn of the box's first axis about the vertical, degrees.
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

/// Draws all boxes, and the handles of the selected one; `hot` is the part that is dragged or under the pointer. The
/// camera's pixels are interface points.
pub(super) fn paint_boxes(
    ctx: &Context,
    list: &BoxList,
    camera: &Camera,
    handles: Option<&BoxHandles>,
    hot: Option<BoxPart>,
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
