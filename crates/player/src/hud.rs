//! The overlay: frame times, counts, memory, and the settings that can be changed while the scene is shown.

use crate::swapchain::PresentMode;
use instgs_vk::math::digits::grouped;
use instgs_vk::render::{FrameStats, Show};

use super::clock::FrameClock;
use super::navigation::Navigator;
use super::scene_viewer::PixelTimes;
use super::views;

/// Keyboard and mouse bindings, for the help at the bottom.
const KEYS: [(&str, &str); 20] = [
    ("left drag", "orbit; with Shift or the middle button: pan"),
    ("right drag", "look around"),
    ("W A S D, E Q", "fly; up and down; Shift: five times as fast; [ ]: slower, faster"),
    ("wheel", "zoom in or out at the pointer"),
    ("double click", "orbit around that point"),
    ("R, Page Up/Down", "back to the first view; step through the data set's cameras"),
    ("C, V", "keep this camera; step through the kept cameras"),
    ("1 to 9", "colour, coverage, depth, instances, templates, tile load, offsets, points, ellipses"),
    ("click", "select an object; Shift: add or remove one; G: all of the same template"),
    ("M T X N", "handles to move, rotate, scale; no handles; Esc: cancel the drag"),
    ("arrows, Home End", "move it horizontally; up and down; Shift: a tenth as far"),
    (", .  + -", "rotate it; larger, smaller"),
    ("Ctrl+D, Delete", "duplicate it; delete it"),
    ("Ctrl+H, Ctrl+Shift+H", "hide it (it stays in the scene); show and select everything hidden"),
    ("Ctrl+Z, Ctrl+Y, Ctrl+S", "undo, redo, save"),
    ("B", "boxes: click an object to draw one, drag dots to resize it; Shift+click or Delete removes it"),
    ("F, O, Ctrl+S", "boxes: find all objects like the selected one; other sizes too; save boxes.json"),
    ("P", "record a camera path; P again stops and saves it"),
    ("F12", "save a screenshot as PNG"),
    ("F11, H, Esc", "full screen; show or hide this overlay; quit"),
];

/// Default of the frame-time limit once it is switched on, milliseconds: 60 frames per second.
const USUAL_BUDGET_MS: f64 = 16.0;

/// What the overlay displays.
pub(super) struct Facts<'a> {
    pub(super) scene: &'a str,
    pub(super) device: &'a str,
    pub(super) size_px: [u32; 2],
    pub(super) clock: &'a FrameClock,
    pub(super) stats: &'a FrameStats,
    pub(super) pixel_times: PixelTimes,
    /// Number of stored and of expanded Gaussians.
    pub(super) gaussians: [u64; 2],
    /// Memory in bytes, with the name of each kind.
    pub(super) bytes: [(&'static str, u64); 7],
    /// Indices of the selected instances. The field below is the number of instances.
    pub(super) chosen: Vec<usize>,
    pub(super) instances: usize,
    /// Number of changes that can be undone and redone.
    pub(super) steps: [usize; 2],
    /// Current scale of the width and height of frames while the view changes.
    pub(super) scale: f64,
}

/// The settings that the overlay can change.
pub(super) struct Settings<'a> {
    pub(super) navigator: &'a mut Navigator,
    pub(super) show: &'a mut Show,
    pub(super) mode: &'a mut PresentMode,
    /// Device time in milliseconds that a frame may take while the view changes; `None` = no limit.
    pub(super) budget_ms: &'a mut Option<f64>,
    /// Screen-space error in pixels that levels of detail may make; 0 = full detail.
    pub(super) lod_error_px: &'a mut f32,
    /// True if the tool for boxes is active.
    pub(super) boxes: &'a mut bool,
}

/// State of the overlay itself.
#[derive(Default)]
pub(super) struct Hud {
    /// True if the panel is shown.
    pub(super) visible: bool,
    /// A notice that is shown until the next key: a file that was written, or an error.
    pub(super) message: Option<String>,
}

impl Hud {
    /// Lays out the overlay for one frame.
    pub(super) fn lay_out(&self, ctx: &egui::Context, facts: Facts<'_>, settings: Settings<'_>) {
        if let Some(message) = &self.message {
            // Each text gets its own id: egui would reuse the width of the previous text.
            let id = egui::Id::new(("message", message));
            egui::Area::new(id).anchor(egui::Align2::CENTER_BOTTOM, [0.0, -12.0]).show(ctx, |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| ui.label(message));
            });
        }
        if !self.visible {
            return;
        }
        egui::Window::new(facts.scene).resizable(false).default_pos([8.0, 8.0]).show(ctx, |ui| {
            rate(ui, &facts);
            counts(ui, &facts);
            chosen(ui, &facts);
            set(ui, settings, facts.stats.slabs);
            ui.collapsing("Passes", |ui| passes(ui, &facts));
            ui.collapsing("Keys", keys);
        });
    }
}

fn rate(ui: &mut egui::Ui, facts: &Facts<'_>) {
    let [width, height] = facts.size_px;
    ui.label(format!("{}, {width}x{height}", facts.device));
    match facts.clock.rate() {
        Some(rate) => {
            let fps = 1e3 / rate.median_ms;
            ui.label(format!("{fps:.1} FPS ({:.2} ms; slowest 1 %: {:.2} ms)", rate.median_ms, rate.slow_ms));
        }
        None => {
            ui.label("idle");
        }
    }
    if facts.scale < 1.0 {
        ui.colored_label(
            ui.visuals().warn_fg_color,
            format!("while moving: {:.0} % of the pixels", 100.0 * facts.scale.powi(2)),
        );
    }
    graph(ui, &facts.clock.times_ms().collect::<Vec<f64>>());
}

/// Draws the frame times as a line graph that starts at 0.
fn graph(ui: &mut egui::Ui, times_ms: &[f64]) {
    let (rect, _) = ui.allocate_exact_size([240.0, 36.0].into(), egui::Sense::hover());
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let most = times_ms.iter().copied().fold(1e-3, f64::max);
    let place = |(k, ms): (usize, &f64)| {
        let part = k as f32 / times_ms.len().max(2) as f32;
        egui::pos2(rect.left() + part * rect.width(), rect.bottom() - (ms / most) as f32 * (rect.height() - 2.0))
    };
    let points: Vec<egui::Pos2> = times_ms.iter().enumerate().map(place).collect();
    painter.line(points, egui::Stroke::new(1.0, ui.visuals().selection.bg_fill));
}

fn counts(ui: &mut egui::Ui, facts: &Facts<'_>) {
    let stats = facts.stats;
    egui::Grid::new("counts").num_columns(2).show(ui, |ui| {
        let mut row = |name: &str, value: String| {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        };
        row("Gaussians stored", grouped(facts.gaussians[0]));
        row("expanded", grouped(facts.gaussians[1]));
        row("visible", grouped(stats.visible));
        row("intersections", grouped(stats.intersections));
        for (kind, bytes) in facts.bytes {
            row(&format!("bytes: {kind}"), grouped(bytes));
        }
    });
}

fn chosen(ui: &mut egui::Ui, facts: &Facts<'_>) {
    let what = match facts.chosen.as_slice() {
        [] => "nothing selected".into(),
        [one] => format!("instance {one} selected"),
        several => format!("{} selected", several.len()),
    };
    let [undo, redo] = facts.steps;
    ui.label(format!("{} instances, {what}; {undo} to undo, {redo} to redo", grouped(facts.instances as u64)));
}

fn set(ui: &mut egui::Ui, settings: Settings<'_>, slabs: u32) {
    let Settings { navigator, show, mode, budget_ms, lod_error_px, boxes } = settings;
    ui.checkbox(boxes, "boxes: mark an object, find the rest (B)");
    let mut degrees = navigator.fov_y().to_degrees();
    if ui.add(egui::Slider::new(&mut degrees, 5.0..=150.0).text("field of view")).changed() {
        navigator.set_fov_y(degrees.to_radians());
    }
    let words = |px: f64, _| if px > 0.0 { format!("{px:.1} px") } else { "off".into() };
    let slider = egui::Slider::new(lod_error_px, 0.0..=8.0).step_by(0.5).custom_formatter(words);
    ui.add(slider.text("level-of-detail error"));
    views::choose(ui, show, navigator.distance(), slabs);
    let mut limited = budget_ms.is_some();
    ui.horizontal(|ui| {
        ui.checkbox(&mut limited, "lower resolution in motion above");
        let mut ms = budget_ms.unwrap_or(USUAL_BUDGET_MS);
        ui.add_enabled(limited, egui::DragValue::new(&mut ms).range(1.0..=1000.0).suffix(" ms"));
        *budget_ms = limited.then_some(ms);
    });
    ui.horizontal(|ui| {
        for value in PresentMode::ALL {
            ui.selectable_value(mode, value, value.name());
        }
    });
}

fn passes(ui: &mut egui::Ui, facts: &Facts<'_>) {
    let sums = facts.stats.ms_by_pass();
    let all: f64 = sums.iter().map(|(_, ms)| ms).sum();
    egui::Grid::new("passes").num_columns(2).striped(true).show(ui, |ui| {
        let mut row = |name: &str, ms: f64| {
            ui.label(name);
            ui.label(format!("{ms:.3} ms"));
            ui.end_row();
        };
        sums.iter().for_each(|&(name, ms)| row(name, ms));
        row("all scene passes", all);
        let PixelTimes { present_ms, ui_ms } = facts.pixel_times;
        for (name, ms) in [("present", present_ms), ("interface", ui_ms)] {
            ms.into_iter().for_each(|ms| row(name, ms));
        }
    });
}

fn keys(ui: &mut egui::Ui) {
    egui::Grid::new("keys").num_columns(2).show(ui, |ui| {
        for (key, what) in KEYS {
            ui.strong(key);
            ui.label(what);
            ui.end_row();
        }
    });
}
