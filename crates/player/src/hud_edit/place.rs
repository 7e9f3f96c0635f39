//! Fields for poses: absolute for one selected instance, relative for several.

use egui::{DragValue, Ui};
use glam::{DMat3, DQuat, DVec3, EulerRot};

use super::{Action, EditFacts, EditPanel};
use crate::texts;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::edit::{Edit, Selector, Turn, instance_centres};

/// Degrees per point of dragging a number.
const DEGREES_PER_POINT: f64 = 0.5;
/// Relative change of the scale per point of dragging a number.
const SCALE_PER_POINT: f64 = 0.005;
/// Range of scales that can be typed: safe in f32 for any scene.
const SCALES: std::ops::RangeInclusive<f64> = 1e-4..=1e4;

/// The relative motion of several instances while a number is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Relative {
    /// Translation in world units.
    by: [f64; 3],
    /// Rotation about the vertical, degrees.
    yaw: f64,
    scale: f64,
}

impl Default for Relative {
    fn default() -> Self {
        Self { by: [0.0; 3], yaw: 0.0, scale: 1.0 }
    }
}

impl EditPanel {
    /// Position of the centre, rotation and scale of one instance.
    pub(super) fn place_of_one(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, k: usize, actions: &mut Vec<Action>) {
        let now = facts.scene.instances[k].world_from_template;
        let which = Selector::Index(k);
        let mut at = instance_centres(facts.scene, [k])[0].to_array();
        let id = ui.id().with("position");
        if three(ui, texts::POSITION, &mut at, facts.step, "") {
            self.change(id, Edit::MoveTo { which: which.clone(), to: DVec3::from_array(at) }, actions);
        }
        // Edits of a drag start from the scene as it was before the drag.
        let live = self.live;
        let begin = |id| if live == Some(id) { facts.editor.place_before(facts.scene, k) } else { now };
        let id = ui.id().with("rotation");
        let mut degrees = euler_degrees(&now);
        if three(ui, texts::ROTATION, &mut degrees, DEGREES_PER_POINT, texts::DEGREES) {
            let turn = turn_between(&begin(id), degrees);
            self.change(id, Edit::Rotate { which: which.clone(), turn }, actions);
        }
        let id = ui.id().with("scale");
        let mut scale = now.scale();
        let speed = SCALE_PER_POINT * scale;
        // A scene may contain scales outside of the range that can be typed.
        let value = DragValue::new(&mut scale).speed(speed).range(SCALES).clamp_existing_to_range(false);
        if one(ui, texts::SCALE, value) {
            let by = scale / begin(id).scale();
            self.change(id, Edit::Scale { which, by }, actions);
        }
    }

    /// Fields for the relative motion of several instances, each about its own centre.
    pub(super) fn place_of_several(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, actions: &mut Vec<Action>) {
        let Some(which) = facts.editor.selector() else { return };
        let mut to = self.relative;
        let none = Relative::default();
        if three(ui, texts::MOVE_BY, &mut to.by, facts.step, "") {
            self.relative = Relative { by: to.by, ..none };
            let by = DVec3::from_array(to.by);
            self.change(ui.id().with("move by"), Edit::MoveBy { which: which.clone(), by }, actions);
        }
        if one(ui, texts::ROTATE_BY, DragValue::new(&mut to.yaw).speed(DEGREES_PER_POINT).suffix(texts::DEGREES)) {
            self.relative = Relative { yaw: to.yaw, ..none };
            let turn = Turn { axis: facts.up, angle: to.yaw.to_radians() };
            self.change(ui.id().with("turn by"), Edit::Rotate { which: which.clone(), turn }, actions);
        }
        if one(ui, texts::SCALE_BY, DragValue::new(&mut to.scale).speed(SCALE_PER_POINT).range(SCALES)) {
            self.relative = Relative { scale: to.scale, ..none };
            self.change(ui.id().with("scale by"), Edit::Scale { which, by: to.scale }, actions);
        }
    }
}

/// A row of three numbers; true if one of them changed.
pub(crate) fn three(ui: &mut Ui, label: &str, values: &mut [f64; 3], speed: f64, suffix: &str) -> bool {
    ui.horizontal(|ui| {
        ui.label(label);
        values.iter_mut().fold(false, |changed, value| {
            ui.add(DragValue::new(value).speed(speed).max_decimals(3).suffix(suffix)).changed() | changed
        })
    })
    .inner
}

/// A row with one number; true if it changed.
pub(crate) fn one(ui: &mut Ui, label: &str, value: DragValue<'_>) -> bool {
    ui.horizontal(|ui| {
        ui.label(label);
        ui.add(value.max_decimals(4)).changed()
    })
    .inner
}

/// Euler angles in degrees: rotations about x, y and z, each in the frame rotated by those before it.
fn euler_degrees(place: &Similarity) -> [f64; 3] {
    let (x, y, z) = DQuat::from_mat3(&place.rotation()).to_euler(EulerRot::XYZ);
    // A rounding error of f32 would show as "-0.0".
    [x, y, z].map(|angle| (1e6 * angle.to_degrees()).round() / 1e6 + 0.0)
}

/// The rotation from a pose's present angles to the given ones.
fn turn_between(from: &Similarity, degrees: [f64; 3]) -> Turn {
    let [x, y, z] = degrees.map(f64::to_radians);
    let to = DMat3::from_euler(EulerRot::XYZ, x, y, z);
    let (axis, angle) = DQuat::from_mat3(&(to * from.rotation().transpose())).to_axis_angle();
    Turn { axis, angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;
    use instgs_vk::scene::edit::apply;

    #[test]
    fn typed_angles_are_those_that_are_read_back() {
        let mut scene = sample_scene();
        for degrees in [[10.0, 20.0, 30.0], [-170.0, 80.0, 5.0], [0.0, -60.0, 179.0], [0.0; 3], [0.0; 3]] {
            let turn = turn_between(&scene.instances[0].world_from_template, degrees);
            let scale = scene.instances[0].world_from_template.scale();
            apply(&mut scene, &Edit::Rotate { which: Selector::Index(0), turn }).unwrap();
            let got = euler_degrees(&scene.instances[0].world_from_template);
            assert!((0..3).all(|k| (got[k] - degrees[k]).abs() < 1e-3), "{got:?} {degrees:?}");
            assert!((scene.instances[0].world_from_template.scale() - scale).abs() < 1e-5);
        }
    }
}
