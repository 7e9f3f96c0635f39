//! The tool bar: icons with their keys as tool tips, and the frame rate.

use std::f32::consts::TAU;

use egui::{Align2, Context, Frame, RichText, Sense, Shape, Stroke, Ui, Vec2};
use egui_phosphor::regular as icon;

use super::{Facts, GAP, OpenPanels};
use crate::actions::{Action, Panel};
use crate::gizmo::GizmoMode;
use crate::texts;

/// Size of the icons, points.
const ICON: f32 = 18.0;
/// Width of the bar of progress, points.
const PROGRESS: f32 = 220.0;
/// The spinner's arc, two thirds of a circle, has so many parts of this angle, radians.
const ARCS: u8 = 16;
const ARC: f32 = TAU / 24.0;

/// Lays out the bar.
pub(super) fn lay_out(ctx: &Context, facts: &Facts<'_>, panels: &mut OpenPanels, actions: &mut Vec<Action>) {
    let tools = egui::Area::new("tools".into()).anchor(Align2::LEFT_TOP, [GAP, GAP]).show(ctx, |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                ui.spacing_mut().item_spacing.x = 2.0;
                tools(ui, facts, panels, actions);
            });
        });
    });
    let taken = tools.response.rect;
    egui::Area::new("rate".into()).anchor(Align2::RIGHT_TOP, [-GAP, GAP]).show(ctx, |ui| {
        let text = rate(facts);
        // Beside the tools only where it does not cover them.
        if taken.right() + 160.0 < ctx.content_rect().right() {
            Frame::popup(ui.style()).show(ui, |ui| ui.add(egui::Label::new(text).extend()));
        }
    });
}

fn tools(ui: &mut Ui, facts: &Facts<'_>, panels: &mut OpenPanels, actions: &mut Vec<Action>) {
    let [undo, redo] = facts.editor.steps();
    let mut button = |ui: &mut Ui, enabled: bool, on: bool, icon: &str, tip: &str, action: Action| {
        let button = egui::Button::selectable(on, RichText::new(icon).size(ICON));
        let response = ui.add_enabled(enabled, button).on_hover_text(tip);
        response.widget_info(|| egui::WidgetInfo::selected(egui::WidgetType::Button, enabled, on, tip));
        if response.clicked() {
            actions.push(action);
        }
    };
    let panel = Action::TogglePanel;
    button(ui, true, panels.open, icon::FOLDER_OPEN, texts::OPEN_TIP, panel(Panel::Open));
    // Boxes have their own file and history, which only keys reach.
    button(ui, facts.work.is_none() && !facts.boxes, false, icon::FLOPPY_DISK, texts::SAVE_TIP, Action::Save);
    button(ui, true, panels.save_as, icon::EXPORT, texts::SAVE_AS_TIP, panel(Panel::SaveAs));
    ui.separator();
    let undoes = !facts.boxes && (undo > 0 || facts.editor.is_live());
    button(ui, undoes, false, icon::ARROW_U_UP_LEFT, texts::UNDO_TIP, Action::Undo);
    button(ui, redo > 0 && !facts.boxes, false, icon::ARROW_U_UP_RIGHT, texts::REDO_TIP, Action::Redo);
    ui.separator();
    for (mode, icon, tip) in [
        (GizmoMode::Off, icon::CURSOR, texts::SELECT_TIP),
        (GizmoMode::Move, icon::ARROWS_OUT_CARDINAL, texts::MOVE_TIP),
        (GizmoMode::Turn, icon::ARROWS_CLOCKWISE, texts::ROTATE_TIP),
        (GizmoMode::Scale, icon::ARROWS_OUT, texts::SCALE_TIP),
    ] {
        button(ui, !facts.boxes, facts.mode == mode && !facts.boxes, icon, tip, Action::Mode(mode));
    }
    let chosen = !facts.editor.chosen().is_empty();
    button(ui, chosen, false, icon::CROSSHAIR, texts::FRAME_TIP, Action::Frame);
    button(ui, true, facts.split, icon::SQUARE_SPLIT_HORIZONTAL, texts::SPLIT_TIP, Action::Split);
    button(ui, true, facts.boxes, icon::BOUNDING_BOX, texts::BOXES_TIP, Action::Boxes);
    ui.separator();
    for (which, icon, tip) in [
        (Panel::Scene, icon::LIST_BULLETS, texts::SCENE_TIP),
        (Panel::Properties, icon::SLIDERS_HORIZONTAL, texts::PROPERTIES_TIP),
        (Panel::View, icon::EYE, texts::VIEW_TIP),
        (Panel::Cameras, icon::CAMERA, texts::CAMERAS_TIP),
        (Panel::History, icon::CLOCK_COUNTER_CLOCKWISE, texts::HISTORY_TIP),
        (Panel::Statistics, icon::CHART_BAR, texts::STATISTICS_TIP),
        (Panel::Help, icon::QUESTION, texts::HELP_TIP),
    ] {
        let on = *panels.flag(which);
        button(ui, true, on, icon, tip, panel(which));
    }
}

/// The frame rate, or that nothing moves.
fn rate(facts: &Facts<'_>) -> String {
    let rate = facts.clock.rate();
    rate.map_or_else(|| texts::STILL.into(), |rate| texts::frame_rate(1e3 / rate.median_ms, facts.scale.powi(2)))
}

/// The work that runs beside the picture: its name, its progress, and a button that cancels it.
pub(super) fn work(ctx: &Context, name: &str, progress: Option<f32>, actions: &mut Vec<Action>) {
    egui::Area::new("work".into()).anchor(Align2::CENTER_BOTTOM, [0.0, -52.0]).show(ctx, |ui| {
        Frame::popup(ui.style()).show(ui, |ui| {
            ui.horizontal(|ui| {
                match progress {
                    Some(part) => drop(ui.add(egui::ProgressBar::new(part).desired_width(PROGRESS).text(name))),
                    None => {
                        spinner(ui);
                        ui.label(name);
                    }
                }
                if ui.button(texts::CANCEL).clicked() {
                    actions.push(Action::CancelWork);
                }
            });
        });
    });
}

/// An arc that turns with the time of the frames, which come as often as the work is looked at: egui's own spinner asks for one
/// frame right after another.
fn spinner(ui: &mut Ui) {
    let (rect, _) = ui.allocate_exact_size(Vec2::splat(ui.spacing().interact_size.y), Sense::hover());
    let start = (ui.input(|input| input.time) % 1.0) as f32 * TAU;
    let point = |k: u8| rect.center() + (rect.width() / 2.0 - 2.0) * Vec2::angled(start + f32::from(k) * ARC);
    let colour = ui.visuals().strong_text_color();
    ui.painter().add(Shape::line((0..=ARCS).map(point).collect(), Stroke::new(3.0, colour)));
}
