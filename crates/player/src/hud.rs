//! The overlay: the tool bar with the frame rate, and panels that are shown when asked for.

mod bar;
mod cameras;
mod files;
pub(super) mod ground;
mod help;
mod history;
mod outliner;
mod statistics;
mod view;

use std::path::{Path, PathBuf};

use egui::{Align2, Context, Ui};
use glam::DVec3;

use super::actions::{Action, Panel};
use super::clock::FrameClock;
use super::editor::Editor;
use super::gizmo::GizmoMode;
use super::hud_edit::{EditFacts, EditPanel};
use super::navigation::Navigator;
use super::scene_viewer::PixelTimes;
use super::texts;
use crate::swapchain::PresentMode;
use instgs_vk::render::{FrameStats, Show};
use instgs_vk::scene::{Camera, InstancedScene};

pub(super) use cameras::CameraPanel;
pub(super) use files::FilePanel;
use outliner::Outliner;

/// Space between panels and the window's edge, points.
const GAP: f32 = 8.0;
/// Height of the tool bar with the gaps around it, points.
const BAR: f32 = 46.0;
/// Height in points that a panel's title and margins take.
const TITLE: f32 = 52.0;
/// Room for the bar that scrolls a panel.
const SCROLL_BAR: egui::Margin = egui::Margin { left: 0, right: 10, top: 0, bottom: 2 };
/// Width of the panels' contents, points.
pub(super) const WIDTH: f32 = 264.0;

/// What the overlay displays.
pub(super) struct Facts<'a> {
    /// Name of the scene's file.
    pub(super) title: &'a str,
    pub(super) device: &'a str,
    pub(super) size_px: [u32; 2],
    pub(super) clock: &'a FrameClock,
    pub(super) stats: &'a FrameStats,
    pub(super) pixel_times: PixelTimes,
    pub(super) scene: &'a InstancedScene,
    /// Number of Gaussians of the background: in pages, `scene` has stand-ins instead.
    pub(super) background_len: u64,
    pub(super) editor: &'a Editor,
    /// Size of the scene's file; memory of the device in total, and for the scene; bytes.
    pub(super) file_bytes: u64,
    pub(super) device_bytes: [u64; 2],
    /// Bytes of the scene that are in host memory.
    pub(super) scene_on_host_bytes: u64,
    /// Current scale of the width and height of frames while the view changes.
    pub(super) scale: f64,
    /// The up axis of the scene.
    pub(super) up: DVec3,
    /// World units per point of dragging a number.
    pub(super) step: f64,
    /// Displacement of a copy from its original, world units.
    pub(super) beside: DVec3,
    pub(super) mode: GizmoMode,
    /// The file that the scene is saved to.
    pub(super) file: &'a Path,
    /// The cameras that the user kept.
    pub(super) kept: &'a [Camera],
    /// Files that were opened lately, the last one first.
    pub(super) recent: &'a [PathBuf],
    /// Name and, where known, progress from 0 to 1 of the work that runs beside the picture.
    pub(super) work: Option<(String, Option<f32>)>,
    /// True while the tool for boxes is active.
    pub(super) boxes: bool,
    /// True while the scene as it was opened is shown beside the present one.
    pub(super) split: bool,
}

/// The settings that the overlay changes itself.
pub(super) struct Settings<'a> {
    pub(super) navigator: &'a mut Navigator,
    pub(super) show: &'a mut Show,
    /// Colour behind all splats.
    pub(super) background: &'a mut [f32; 3],
    pub(super) present: &'a mut PresentMode,
    /// Device time in milliseconds that a frame may take while the view changes; `None` = no limit.
    pub(super) budget_ms: &'a mut Option<f64>,
    /// Screen-space error in pixels that levels of detail may make; 0 = full detail.
    pub(super) lod_error_px: &'a mut f32,
    /// True if what the front of the scene hides is left out.
    pub(super) occlusion: &'a mut bool,
}

/// The panels that are open. Those that are only passed through are not remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(default)]
pub(super) struct OpenPanels {
    #[serde(skip)]
    pub(super) help: bool,
    pub(super) scene: bool,
    /// Shown only while something is selected, or if it was asked for without a selection.
    pub(super) properties: bool,
    pub(super) view: bool,
    pub(super) cameras: bool,
    pub(super) history: bool,
    pub(super) statistics: bool,
    #[serde(skip)]
    pub(super) open: bool,
    #[serde(skip)]
    pub(super) save_as: bool,
}

impl Default for OpenPanels {
    fn default() -> Self {
        Self {
            help: false,
            scene: false,
            properties: true,
            view: false,
            cameras: false,
            history: false,
            statistics: false,
            open: false,
            save_as: false,
        }
    }
}

impl OpenPanels {
    /// Whether a panel is open.
    pub(super) fn flag(&mut self, panel: Panel) -> &mut bool {
        match panel {
            Panel::Help => &mut self.help,
            Panel::Scene => &mut self.scene,
            Panel::Properties => &mut self.properties,
            Panel::View => &mut self.view,
            Panel::Cameras => &mut self.cameras,
            Panel::History => &mut self.history,
            Panel::Statistics => &mut self.statistics,
            Panel::Open => &mut self.open,
            Panel::SaveAs => &mut self.save_as,
        }
    }

    /// Closes the panel that covers most of the picture, or a file panel; false if none of them is open.
    pub(super) fn close_one(&mut self) -> bool {
        let open = [Panel::Open, Panel::SaveAs, Panel::Help].into_iter().find(|&panel| *self.flag(panel));
        open.is_some_and(|panel| std::mem::replace(self.flag(panel), false))
    }
}

/// State of the overlay itself.
#[derive(Default)]
pub(super) struct Hud {
    /// True if the tool bar and the panels are shown.
    pub(super) visible: bool,
    /// A notice that is shown until the next key: a file that was written, or an error.
    pub(super) message: Option<String>,
    pub(super) panels: OpenPanels,
    /// True if the ground grid is drawn; below, the axes.
    pub(super) grid: bool,
    pub(super) axes: bool,
    pub(super) edit: EditPanel,
    pub(super) files: FilePanel,
    pub(super) cameras: CameraPanel,
    outliner: Outliner,
}

impl Hud {
    /// The overlay of a window that opens; without panels if it is not `visible`.
    pub(super) fn new(visible: bool) -> Self {
        Self { visible, axes: true, ..Self::default() }
    }

    /// Another scene is opened: what was typed and unfolded belongs to the old one.
    pub(super) fn forget_scene(&mut self) {
        self.outliner = Outliner::default();
    }

    /// Lays out the overlay for one frame and returns the user's actions.
    pub(super) fn lay_out(&mut self, ctx: &Context, facts: &Facts<'_>, settings: Settings<'_>) -> Vec<Action> {
        let mut actions = Vec::new();
        if let Some(message) = &self.message {
            // Each text gets its own id: egui would reuse the width of the previous text.
            let id = egui::Id::new(("message", message));
            egui::Area::new(id).anchor(Align2::CENTER_BOTTOM, [0.0, -12.0]).show(ctx, |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| ui.label(message));
            });
        }
        if let Some((name, progress)) = &facts.work {
            bar::work(ctx, name, *progress, &mut actions);
        }
        if !self.visible {
            return actions;
        }
        bar::lay_out(ctx, facts, &mut self.panels, &mut actions);
        let Self { panels, grid, axes, edit, files, cameras, outliner, .. } = self;
        let here = |pivot: Align2| Place::of(ctx, pivot);
        panel(ctx, texts::SCENE, here(Align2::LEFT_TOP), &mut panels.scene, |ui| {
            outliner.lay_out(ui, facts, &mut actions);
        });
        panel(ctx, texts::STATISTICS, here(Align2::LEFT_BOTTOM), &mut panels.statistics, |ui| {
            statistics::lay_out(ui, facts);
        });
        panel(ctx, texts::HISTORY, here(Align2::CENTER_TOP), &mut panels.history, |ui| {
            history::lay_out(ui, facts, &mut actions);
        });
        panel(ctx, texts::VIEW, here(Align2::RIGHT_BOTTOM), &mut panels.view, |ui| {
            view::lay_out(ui, facts, settings, [grid, axes], &mut actions);
        });
        panel(ctx, texts::CAMERAS, here(Align2::CENTER_BOTTOM), &mut panels.cameras, |ui| {
            cameras.lay_out(ui, facts, &mut actions);
        });
        panel(ctx, texts::HELP, here(Align2::CENTER_CENTER), &mut panels.help, help::lay_out);
        files.lay_out(ctx, facts, panels, &mut actions);
        let of_chosen = !facts.editor.chosen().is_empty() || edit.is_busy();
        if panels.properties && of_chosen && !facts.boxes {
            let facts = EditFacts {
                scene: facts.scene,
                editor: facts.editor,
                up: facts.up,
                step: facts.step,
                beside: facts.beside,
                mode: facts.mode,
            };
            let mut open = true;
            panel(ctx, texts::PROPERTIES, here(Align2::RIGHT_TOP), &mut open, |ui| {
                edit.lay_out(ui, &facts, &mut actions);
            });
            panels.properties = open;
            edit.settle(ctx, &mut actions);
        }
        actions
    }
}

/// Where a panel is at first, and how high its contents may be.
struct Place {
    pivot: Align2,
    at: egui::Pos2,
    height: f32,
}

impl Place {
    /// The place at an edge or corner of the window, below the tool bar.
    fn of(ctx: &Context, pivot: Align2) -> Self {
        let mut room = ctx.content_rect().shrink(GAP);
        room.min.y += BAR - GAP;
        Self { pivot, at: pivot.pos_in_rect(&room), height: (room.height() - TITLE).max(60.0) }
    }
}

/// The part of the window that the tool bar leaves to panels.
fn below_the_bar(ctx: &Context) -> egui::Rect {
    let mut rect = ctx.content_rect();
    rect.min.y = (rect.min.y + BAR).min(rect.max.y);
    rect
}

/// A panel that can be closed and moved; what does not fit the window's height is scrolled.
fn panel(ctx: &Context, title: &str, place: Place, open: &mut bool, contents: impl FnOnce(&mut Ui)) {
    egui::Window::new(title)
        .open(open)
        .pivot(place.pivot)
        .default_pos(place.at)
        .default_width(WIDTH)
        // Else egui scrolls what is higher than its own default, however high the window is.
        .default_height(place.height)
        .constrain_to(below_the_bar(ctx))
        .resizable(false)
        .show(ctx, |ui| {
            egui::ScrollArea::vertical().max_height(place.height).show(ui, |ui| {
                // The bar that scrolls lies over the right edge.
                egui::Frame::new().inner_margin(SCROLL_BAR).show(ui, contents);
            });
        });
}

/// A number of bytes as people read it, with powers of 1000 as file managers have it: "4.8 MB".
pub(super) fn readable(bytes: u64) -> String {
    let mut value = bytes as f64;
    let mut unit = 0;
    // What would be shown as 1000 is 1 of the next unit.
    while value >= 999.5 && unit + 1 < texts::BYTES.len() {
        value /= 1000.0;
        unit += 1;
    }
    let decimals = usize::from(unit > 0 && value < 99.95);
    format!("{value:.decimals$} {}", texts::BYTES[unit])
}

#[cfg(test)]
mod tests;
