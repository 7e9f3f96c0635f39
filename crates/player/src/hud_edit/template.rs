//! Fields for the base colour, and tools that change a template and with it all of its instances.

use egui::{Button, DragValue, Id, Slider, Ui};
use glam::DVec3;

use super::{Action, EditFacts, EditPanel, selector};
use crate::texts;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Keep};

/// Initial radius of the brush, relative to the template's size.
const BRUSH_PART: f64 = 0.03;

/// Grey level of the colour button for a shift of zero.
const MIDDLE: f32 = 128.0;

/// A shift of base colours, in units of colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shift {
    rgb: [f32; 3],
    /// The part of the shift that is a completed undo step.
    done: [f32; 3],
    whole_template: bool,
}

impl Shift {
    #[cfg(test)]
    pub(super) fn red(&self) -> f32 {
        self.rgb[0]
    }

    /// Marks the shift in progress as completed.
    pub(super) fn finish(&mut self) {
        self.done = self.rgb;
    }

    /// The shift in progress was reverted.
    pub(super) fn cancel(&mut self) {
        self.rgb = self.done;
    }
}

/// State of a crop in progress.
pub(super) struct CropFields {
    /// Id of the crop's widgets.
    pub(super) id: Id,
    template: u32,
    /// Bounding box of the template before the crop.
    bounds: [DVec3; 2],
    corners: [DVec3; 2],
    keep: Keep,
}

impl EditPanel {
    /// Fields that shift base colours.
    pub(super) fn recolour(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, first: usize, actions: &mut Vec<Action>) {
        let template = facts.scene.instances[first].template;
        let shift = &mut self.shift;
        let shown = shift.rgb.map(|v| (MIDDLE + 255.0 * v).round() as u8);
        let mut colour = shown;
        let changed = ui.horizontal(|ui| {
            ui.label(texts::SHIFT);
            let mut changed = ui.color_edit_button_srgb(&mut colour).changed();
            // A channel that stays keeps what the button cannot show: further digits, and shifts beyond black and white.
            for ((value, now), was) in shift.rgb.iter_mut().zip(colour).zip(shown) {
                if now != was {
                    *value = (f32::from(now) - MIDDLE) / 255.0;
                }
            }
            for value in &mut shift.rgb {
                changed |= ui.add(DragValue::new(value).speed(0.005).range(-1.0..=1.0).max_decimals(3)).changed();
            }
            changed
        });
        ui.checkbox(&mut shift.whole_template, texts::all_of_template(template));
        if changed.inner {
            let which = selector(facts, shift.whole_template.then_some(template));
            // The edits of a drag start from the shift that was completed before it.
            let rgb = [0, 1, 2].map(|k| shift.rgb[k] - shift.done[k]);
            self.change(ui.id().with("shift"), Edit::Recolour { which, rgb }, actions);
        }
    }

    /// Tools that remove Gaussians from the template: a box and a brush.
    pub(super) fn crop_and_brush(
        &mut self,
        ui: &mut Ui,
        facts: &EditFacts<'_>,
        first: usize,
        actions: &mut Vec<Action>,
    ) {
        let template = facts.scene.instances[first].template;
        let Some(bounds) = bounds(facts.scene, template) else {
            ui.label(texts::empty_template(template));
            return;
        };
        ui.label(texts::changes_all_of(template));
        // The object may have another template since.
        match self.crop.take().filter(|crop| crop.template == template) {
            None => {
                if ui.button(texts::CROP).clicked() {
                    let id = ui.id().with("crop");
                    self.crop = Some(CropFields { id, template, bounds, corners: bounds, keep: Keep::Inside });
                }
            }
            Some(crop) => self.crop = self.go_on_cropping(ui, crop, facts.editor.has_live_failed(), actions),
        }
        ui.separator();
        let size = bounds[0].distance(bounds[1]);
        if self.brush.radius <= 0.0 {
            self.brush.radius = BRUSH_PART * size;
        }
        ui.checkbox(&mut self.brush.on, texts::ERASE);
        ui.horizontal(|ui| {
            ui.label(texts::RADIUS);
            let least = 1e-6 * size.max(1e-6);
            let radius = DragValue::new(&mut self.brush.radius).speed(2e-3 * size).range(least..=10.0 * size);
            ui.add(radius.max_decimals(4));
        });
    }

    /// The sliders of a crop; `None` once it is applied or cancelled.
    /// With `failed` the last one was not possible, and there is nothing to apply.
    fn go_on_cropping(
        &mut self,
        ui: &mut Ui,
        mut crop: CropFields,
        failed: bool,
        actions: &mut Vec<Action>,
    ) -> Option<CropFields> {
        let mut changed = false;
        let [low, high] = &mut crop.corners;
        for (axis, name) in [texts::X, texts::Y, texts::Z].into_iter().enumerate() {
            let range = crop.bounds[0][axis]..=crop.bounds[1][axis];
            let mut slider = |value: &mut f64, end: &str| {
                ui.add(Slider::new(value, range.clone()).text(format!("{name} {end}"))).changed()
            };
            if slider(&mut low[axis], texts::FROM) {
                high[axis] = high[axis].max(low[axis]);
                changed = true;
            }
            if slider(&mut high[axis], texts::TO) {
                low[axis] = low[axis].min(high[axis]);
                changed = true;
            }
        }
        ui.horizontal(|ui| {
            changed |= ui.selectable_value(&mut crop.keep, Keep::Inside, texts::KEEP_INSIDE).changed();
            changed |= ui.selectable_value(&mut crop.keep, Keep::Outside, texts::REMOVE_INSIDE).changed();
        });
        if changed {
            let CropFields { id, template, corners, keep, .. } = crop;
            self.change(id, Edit::Crop { template, corners, keep }, actions);
        }
        let done = ui.horizontal(|ui| {
            let applies = ui.add_enabled(!failed, Button::new(texts::APPLY)).clicked();
            let action = match (applies, ui.button(texts::CANCEL).clicked()) {
                (true, _) => Action::Finish,
                (_, true) => Action::Cancel,
                _ => return false,
            };
            // A change that another widget started is not ended here.
            if self.live == Some(crop.id) {
                actions.push(action);
                self.live = None;
            }
            true
        });
        (!done.inner).then_some(crop)
    }
}

/// The corners of the box around a template's means, in its frame; `None` without Gaussians.
fn bounds(scene: &InstancedScene, template: u32) -> Option<[DVec3; 2]> {
    let range = scene.template_ranges[template as usize];
    let means = &scene.templates.means[range.first as usize..(range.first + range.count) as usize];
    let grow = |[low, high]: [DVec3; 2], mean: DVec3| [low.min(mean), high.max(mean)];
    means.iter().map(|&mean| widened(mean)).map(|mean| [mean; 2]).reduce(|a, b| grow(a, b[0]))
}
