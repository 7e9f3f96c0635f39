//! Kept cameras as thumbnails, and frames drawn into files.

use egui::{DragValue, TextureHandle, Ui};

use super::{Facts, WIDTH};
use crate::actions::{Action, Take};
use crate::texts;

/// Height of a thumbnail, points.
const HEIGHT: f32 = 54.0;
/// Largest side of a picture, pixels.
const MOST_PX: u32 = 16_384;

/// State of the panel.
pub(crate) struct CameraPanel {
    /// By kept camera, its picture; none for cameras of an earlier session.
    pub(crate) thumbnails: Vec<Option<TextureHandle>>,
    size_px: [u32; 2],
    frames: u32,
}

impl Default for CameraPanel {
    fn default() -> Self {
        Self { thumbnails: Vec::new(), size_px: [1920, 1080], frames: 120 }
    }
}

impl CameraPanel {
    /// Lays out the panel.
    pub(super) fn lay_out(&mut self, ui: &mut Ui, facts: &Facts<'_>, actions: &mut Vec<Action>) {
        ui.set_min_width(WIDTH);
        self.thumbnails.resize(facts.kept.len(), None);
        ui.horizontal(|ui| {
            if ui.button(texts::KEEP_CAMERA).clicked() {
                actions.push(Action::KeepCamera);
            }
            if ui.button(texts::FIRST_VIEW).clicked() {
                actions.push(Action::FirstView);
            }
        });
        if facts.kept.is_empty() {
            ui.label(texts::NO_CAMERAS);
        }
        ui.horizontal_wrapped(|ui| {
            for (k, camera) in facts.kept.iter().enumerate() {
                let response = match &self.thumbnails[k] {
                    Some(picture) => {
                        let size = picture.size_vec2() * (HEIGHT / picture.size_vec2().y.max(1.0));
                        ui.add(egui::Button::image(egui::Image::new((picture.id(), size))))
                    }
                    None => ui.button(format!("{} {}", k + 1, camera.name)),
                };
                if response.clicked() {
                    actions.push(Action::ShowKept(k));
                }
                response.context_menu(|ui| {
                    if ui.button(texts::REMOVE).clicked() {
                        actions.push(Action::RemoveKept(k));
                        ui.close();
                    }
                });
            }
        });
        ui.separator();
        ui.horizontal(|ui| {
            ui.label(texts::PICTURE);
            let [width, height] = &mut self.size_px;
            ui.add(DragValue::new(width).range(1..=MOST_PX));
            ui.label(texts::BY);
            ui.add(DragValue::new(height).range(1..=MOST_PX).suffix(texts::PX));
            ui.label(texts::FRAMES);
            ui.add(DragValue::new(&mut self.frames).range(2..=100_000));
        });
        let mut draw = |take: Take, frames: u32| {
            actions.push(Action::Draw { take, size_px: self.size_px, frames });
        };
        let free = facts.work.is_none();
        ui.horizontal(|ui| {
            if ui.add_enabled(free, egui::Button::new(texts::SAVE_PICTURE)).clicked() {
                draw(Take::Still, 1);
            }
            if ui.add_enabled(free, egui::Button::new(texts::TURNTABLE)).clicked() {
                draw(Take::Turntable, self.frames);
            }
            let path = free && facts.kept.len() > 1;
            if ui.add_enabled(path, egui::Button::new(texts::ALONG_CAMERAS)).clicked() {
                draw(Take::AlongKept, self.frames);
            }
        });
    }
}
