//! Draws the handles of the selection as lines over the view.

use egui::{Color32, Pos2, Stroke};

use super::gizmo::{Gizmo, Handle, HandleLine};

/// Width of lines, points.
const WIDTH: f32 = 2.0;
/// Width of the line under the pointer, points.
const HOT_WIDTH: f32 = 3.5;
/// Colour of the shadow behind each line, which keeps it visible on any background.
const SHADOW: Color32 = Color32::from_black_alpha(140);
/// Colour of the line under the pointer.
pub(super) const HOT: Color32 = Color32::from_rgb(255, 230, 80);

/// Draws the handles; `hot` is the one that is dragged or under the pointer.
pub(super) fn paint_gizmo(ctx: &egui::Context, gizmo: Option<&Gizmo>, hot: Option<Handle>) {
    let Some(gizmo) = gizmo else { return };
    paint_lines(ctx, gizmo.lines(), hot);
}

/// Draws the lines of handles, the hot one last.
pub(super) fn paint_lines(ctx: &egui::Context, mut lines: Vec<HandleLine>, hot: Option<Handle>) {
    lines.sort_by_key(|line| Some(line.handle) == hot);
    for HandleLine { handle, points_px } in lines {
        let is_hot = Some(handle) == hot;
        let (colour, width) = if is_hot { (HOT, HOT_WIDTH) } else { (colour_of(handle), WIDTH) };
        line(ctx, &points_px, Stroke::new(width, colour));
    }
}

/// Draws a polyline (interface points) with a shadow, so that it is visible on any background.
pub(super) fn line(ctx: &egui::Context, places: &[[f64; 2]], stroke: Stroke) {
    let painter = ctx.layer_painter(egui::LayerId::background());
    let points: Vec<Pos2> = places.iter().map(|&[x, y]| egui::pos2(x as f32, y as f32)).collect();
    painter.line(points.clone(), Stroke::new(stroke.width + 2.0, SHADOW));
    painter.line(points, stroke);
}

/// Draws the circle of a brush; centre and radius in window pixels.
pub(super) fn paint_brush(ctx: &egui::Context, brush: Option<([f64; 2], f64)>) {
    let Some(([x, y], radius)) = brush else { return };
    let per_point = ctx.pixels_per_point();
    let painter = ctx.layer_painter(egui::LayerId::background());
    let centre = egui::pos2(x as f32 / per_point, y as f32 / per_point);
    for stroke in [Stroke::new(WIDTH + 2.0, SHADOW), Stroke::new(WIDTH, HOT)] {
        painter.circle_stroke(centre, radius as f32 / per_point, stroke);
    }
}

/// Red, green and blue for x, y and z, the usual convention.
fn colour_of(handle: Handle) -> Color32 {
    match handle {
        Handle::Arrow(0) | Handle::Ring(0) => Color32::from_rgb(235, 70, 70),
        Handle::Arrow(1) | Handle::Ring(1) => Color32::from_rgb(90, 205, 90),
        Handle::Arrow(_) | Handle::Ring(_) => Color32::from_rgb(90, 140, 255),
        Handle::Square | Handle::Circle => Color32::from_gray(240),
    }
}
