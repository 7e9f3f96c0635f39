//! Lines over the picture that help to find one's way: a grid on the ground, the axes, and drawn points.

use egui::{Align2, Color32, Context, FontId, LayerId, Pos2, Stroke};
use glam::DVec3;

use crate::hud_gizmo::{HOT, line};
use crate::texts;
use instgs_vk::scene::Camera;

/// Lines of the grid to each side of its middle.
const LINES: i32 = 10;
/// Pieces of a line, so that one that passes the camera is drawn where it is visible.
const PIECES: i32 = 20;
const GRID: Color32 = Color32::from_rgba_premultiplied(90, 90, 90, 110);
/// Red, green and blue for x, y and z, the usual convention.
const AXES: [(&str, DVec3, Color32); 3] = [
    (texts::X, DVec3::X, Color32::from_rgb(235, 70, 70)),
    (texts::Y, DVec3::Y, Color32::from_rgb(90, 205, 90)),
    (texts::Z, DVec3::Z, Color32::from_rgb(90, 140, 255)),
];
/// Length of the axes, and distance of their origin from the window's corner, points.
const LENGTH: f64 = 34.0;
const FROM_CORNER: f32 = 56.0;

/// Draws a grid through a point; `camera` is in interface points, `distance` that to the target, world units.
pub(crate) fn grid(ctx: &Context, camera: &Camera, middle: DVec3, up: DVec3, distance: f64) {
    // The largest power of ten that gives several lines.
    let step = 10f64.powf((distance / 3.0).log10().floor());
    let side = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    let along = (side - side.dot(up) * up).normalize();
    let across = up.cross(along);
    let painter = ctx.layer_painter(LayerId::background());
    let at = |a: f64, b: f64| {
        let [x, y] = camera.pixel_of(middle + step * (a * along + b * across))?;
        Some(egui::pos2(x as f32, y as f32))
    };
    let extent = f64::from(LINES);
    for k in -LINES..=LINES {
        for turned in [false, true] {
            let point = |piece: i32| {
                let t = extent * (2.0 * f64::from(piece) / f64::from(PIECES) - 1.0);
                if turned { at(t, f64::from(k)) } else { at(f64::from(k), t) }
            };
            for piece in 0..PIECES {
                if let (Some(a), Some(b)) = (point(piece), point(piece + 1)) {
                    painter.line_segment([a, b], Stroke::new(1.0, GRID));
                }
            }
        }
    }
}

/// Draws the directions of the world's axes in the lower left corner.
pub(crate) fn axes(ctx: &Context, camera: &Camera) {
    let painter = ctx.layer_painter(LayerId::background());
    let corner = ctx.content_rect().left_bottom() + egui::vec2(FROM_CORNER, -FROM_CORNER);
    for (name, axis, colour) in AXES {
        let direction = camera.rotation() * axis;
        let tip: Pos2 = corner + egui::vec2((LENGTH * direction.x) as f32, (LENGTH * direction.y) as f32);
        painter.line_segment([corner, tip], Stroke::new(2.5, colour));
        painter.text(tip, Align2::CENTER_CENTER, name, FontId::proportional(13.0), Color32::WHITE);
    }
}

/// Draws points and the lines between them; `closed` joins the last to the first.
pub(crate) fn outline(ctx: &Context, camera: &Camera, points: &[DVec3], closed: bool) {
    let places: Vec<[f64; 2]> = points.iter().filter_map(|&point| camera.pixel_of(point)).collect();
    let painter = ctx.layer_painter(LayerId::background());
    for &[x, y] in &places {
        painter.circle_filled(egui::pos2(x as f32, y as f32), 4.0, HOT);
    }
    let ring = closed.then(|| places.first().copied()).flatten();
    let places: Vec<[f64; 2]> = places.iter().copied().chain(ring).collect();
    if places.len() > 1 {
        line(ctx, &places, Stroke::new(2.0, HOT));
    }
}
