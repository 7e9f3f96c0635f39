//! Counts, memory and times, in units that people read.

use egui::{CollapsingHeader, Grid, Ui};

use super::{Facts, WIDTH, readable};
use crate::scene_viewer::PixelTimes;
use crate::texts;
use instgs_vk::math::digits::grouped;

/// Lays out the statistics.
pub(super) fn lay_out(ui: &mut Ui, facts: &Facts<'_>) {
    let [width, height] = facts.size_px;
    ui.set_min_width(WIDTH);
    ui.strong(facts.title);
    ui.label(texts::size_and_device([width, height], facts.device));
    if let Some(rate) = facts.clock.rate() {
        ui.label(texts::frame_times(rate.median_ms, rate.slow_ms));
    }
    graph(ui, &facts.clock.times_ms().collect::<Vec<f64>>());
    let (scene, stats) = (facts.scene, facts.stats);
    // In pages, the scene has stand-ins in place of its background.
    let of_background = |count: u64| count - scene.background.len() as u64 + facts.background_len;
    let copies = of_background(scene.expanded_len());
    let [device, of_scene] = facts.device_bytes;
    Grid::new("counts").num_columns(2).striped(true).show(ui, |ui| {
        let mut row = |name: &str, value: String| {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        };
        row(texts::INSTANCES, grouped(scene.instances.len() as u64));
        row(texts::TEMPLATES, grouped(scene.template_ranges.len() as u64));
        row(texts::STORED, grouped(of_background(scene.source_len() as u64)));
        row(texts::EXPANDED, grouped(copies));
        row(texts::DRAWN, grouped(stats.visible));
        row(texts::IN_TILES, grouped(stats.intersections));
        row(texts::FILE, readable(facts.file_bytes));
        row(texts::DEVICE_MEMORY, readable(device));
        row(texts::SCENE_MEMORY, readable(of_scene));
        if facts.scene_on_host_bytes > 0 {
            row(texts::SCENE_ON_HOST, readable(facts.scene_on_host_bytes));
        }
        row(texts::TEMPLATES, readable(scene.templates.tensor_bytes()));
        row(texts::OFFSETS, readable(scene.offsets.tensor_bytes()));
        row(texts::OWN, readable(scene.own.tensor_bytes()));
        row(texts::BACKGROUND, readable(scene.background.tensor_bytes()));
    });
    CollapsingHeader::new(texts::DEVICE_TIMES).show(ui, |ui| passes(ui, facts));
}

/// Draws the frame times as a line graph that starts at 0.
fn graph(ui: &mut Ui, times_ms: &[f64]) {
    let (rect, _) = ui.allocate_exact_size([WIDTH, 30.0].into(), egui::Sense::hover());
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

fn passes(ui: &mut Ui, facts: &Facts<'_>) {
    let sums = facts.stats.ms_by_pass();
    let all: f64 = sums.iter().map(|(_, ms)| ms).sum();
    Grid::new("passes").num_columns(2).striped(true).show(ui, |ui| {
        let mut row = |name: &str, ms: f64| {
            ui.label(name);
            ui.label(texts::milliseconds(ms));
            ui.end_row();
        };
        sums.iter().for_each(|&(name, ms)| row(name, ms));
        row(texts::ALL_PASSES, all);
        let PixelTimes { present_ms, ui_ms } = facts.pixel_times;
        for (name, ms) in [(texts::TO_SCREEN, present_ms), (texts::INTERFACE, ui_ms)] {
            ms.into_iter().for_each(|ms| row(name, ms));
        }
    });
}
