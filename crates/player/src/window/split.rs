//! The scene as it was opened, left of a line that can be dragged, and as it is now, right of it.

use egui::{Align2, Color32, CursorIcon, FontId, LayerId, Stroke};

use super::Live;
use crate::error::PlayerError;
use crate::hud_gizmo::{HOT, line};
use crate::scene_viewer::SceneViewer;
use crate::swapchain::Target;
use crate::texts;
use instgs_vk::gpu::Buffer;

/// The line is grabbed from this far, points.
const REACH: f64 = 6.0;
/// The line stays this far from the window's edges, as a part of its width.
const LEAST: f64 = 0.02;
/// Distance of the names from the line and from the tool bar's lower edge, points.
const BESIDE: f32 = 8.0;
const BELOW: f32 = 52.0;

/// The scene as it was opened, on the device, and the line.
pub(super) struct Split {
    viewer: SceneViewer,
    /// Place of the line as a part of the window's width.
    at: f64,
    width_px: f64,
    per_point: f64,
    held: bool,
    /// What stands at the left side.
    name: &'static str,
}

impl Split {
    fn is_near(&self, [x, _]: [f64; 2]) -> bool {
        (x - self.at * self.width_px).abs() <= REACH * self.per_point
    }

    /// The left button is pressed; true if it grabs the line.
    pub(super) fn grab(&mut self, at_px: [f64; 2]) -> bool {
        self.held = self.is_near(at_px);
        self.held
    }

    /// True while the line is dragged.
    pub(super) fn is_held(&self) -> bool {
        self.held
    }

    /// Moves the line if it is held; true if so.
    pub(super) fn follow(&mut self, [x, _]: [f64; 2]) -> bool {
        if self.held {
            self.at = (x / self.width_px.max(1.0)).clamp(LEAST, 1.0 - LEAST);
        }
        self.held
    }

    /// Ends the drag of the line; true if it was held.
    pub(super) fn let_go(&mut self) -> bool {
        std::mem::take(&mut self.held)
    }

    /// The pixels of the scene as it was opened, and the column up to which they are shown.
    pub(super) fn pixels(&self, [width, _]: [u32; 2]) -> (&Buffer<u32>, u32) {
        (self.viewer.pixels(), (self.at * f64::from(width)).round() as u32)
    }

    /// Draws the line and the names of its sides.
    pub(super) fn paint(&self, ctx: &egui::Context, pointer_px: [f64; 2]) {
        let x = self.at * self.width_px / self.per_point;
        let bottom = f64::from(ctx.content_rect().bottom());
        let near = self.held || (self.is_near(pointer_px) && !ctx.is_pointer_over_area());
        let colour = if near { HOT } else { Color32::WHITE };
        line(ctx, &[[x, 0.0], [x, bottom]], Stroke::new(2.0, colour));
        if near {
            ctx.set_cursor_icon(CursorIcon::ResizeHorizontal);
        }
        let painter = ctx.layer_painter(LayerId::background());
        let sides = [(-BESIDE, Align2::RIGHT_TOP, self.name), (BESIDE, Align2::LEFT_TOP, texts::NOW)];
        for (beside, align, name) in sides {
            let at = egui::pos2(x as f32 + beside, BELOW);
            painter.text(at + egui::vec2(1.0, 1.0), align, name, FontId::proportional(14.0), Color32::BLACK);
            painter.text(at, align, name, FontId::proportional(14.0), Color32::WHITE);
        }
    }
}

impl Live {
    /// Shows or hides the scene as it was opened.
    pub(super) fn toggle_split(&mut self) -> Result<(), PlayerError> {
        // A drag that went on would count twice: looking up the scene as it was opened completes the change in progress.
        self.let_go()?;
        if self.split.take().is_some() {
            return Ok(());
        }
        if self.session.viewer.is_in_pages() {
            self.hud.message = Some(texts::IN_PAGES.into());
            return Ok(());
        }
        let opened = self.session.viewer.first_state();
        let is_first = !self.session.viewer.editor().has_forgotten();
        let name = if is_first { texts::AS_OPENED } else { texts::OLDEST_STATE };
        let options = self.session.viewer.options;
        match SceneViewer::new(&self.session.gpu, opened, options) {
            Ok(viewer) => {
                let (width_px, per_point) = (f64::from(self.screen.swapchain.size_px()[0]), self.screen.per_point());
                self.split = Some(Split { viewer, at: 0.5, width_px, per_point, held: false, name });
            }
            Err(error) if error.is_too_much() => self.end_split(&error),
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn end_split(&mut self, error: &PlayerError) {
        self.split = None;
        self.hud.message = Some(format!("{}: {error}", texts::NO_SPLIT));
    }

    /// Draws the scene as it was opened with the camera of the present frame of `size_px`, for the window of a target. Where the
    /// device has no room for both scenes, the comparison ends.
    pub(super) fn draw_opened(&mut self, size_px: [u32; 2], target: Target) -> Result<(), PlayerError> {
        let per_point = self.screen.per_point();
        let Some(split) = &mut self.split else { return Ok(()) };
        (split.width_px, split.per_point) = (f64::from(target.size_px[0]), per_point);
        split.viewer.options = self.session.viewer.options;
        let camera = self.camera.navigator.camera(size_px);
        let drawn = split.viewer.draw(&camera).and_then(|()| {
            let (recorder, _) = split.viewer.record_pixels(target.size_px, target.blue_first)?;
            recorder.submit()?;
            Ok(())
        });
        // Nobody reads the times of these frames.
        drop(split.viewer.take_arrived());
        match drawn {
            Err(error) if error.is_too_much() => self.end_split(&error),
            drawn => return drawn,
        }
        Ok(())
    }
}
