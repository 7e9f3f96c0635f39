//! The form that scatters copies of a template on the ground around an instance.

use egui::{Button, DragValue, Grid, Id, Ui};
use glam::DVec3;

use super::{Action, EditFacts, EditPanel};
use crate::texts;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Footprint, OffsetSource, Scatter, ScatterOver, Selector, footprint};

/// Largest number of copies at once: more would be a slip of the mouse. The command line has no such limit.
const MOST: usize = 10_000;
/// Initial width of the area relative to the instance's; copies are initially one instance width apart.
const AREA: f64 = 6.0;

/// What the copies are scattered over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Over {
    /// A rectangle around the original.
    #[default]
    Area,
    /// A path of drawn points.
    Path,
    /// A polygon of drawn points.
    Polygon,
}

/// State of the form's fields.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ScatterFields {
    over: Over,
    /// Points drawn in the picture, world units.
    pub(super) points: Vec<DVec3>,
    /// True while clicks in the picture draw points.
    pub(super) draws: bool,
    /// The change that shows the copies, from the preview on until it ends.
    pub(super) preview: Option<Id>,
    /// The instance that copies are made of.
    original: usize,
    count: usize,
    /// Width and depth of the area, world units.
    extent: [f64; 2],
    /// Least distance between centres, world units.
    pub(super) distance: f64,
    /// Largest random rotation, degrees.
    turn: f64,
    seed: u64,
}

impl Default for ScatterFields {
    fn default() -> Self {
        let (over, points) = (Over::Area, Vec::new());
        let (draws, preview, original) = (false, None, 0);
        Self { over, points, draws, preview, original, count: 5, extent: [1.0; 2], distance: 0.0, turn: 360.0, seed: 1 }
    }
}

impl ScatterFields {
    /// Defaults for an area around the first selected instance.
    pub(super) fn beside(facts: &EditFacts<'_>) -> Self {
        let Some(&first) = facts.editor.chosen().first() else { return Self::default() };
        let Footprint { extent, .. } = footprint(facts.scene, first, facts.up);
        let distance = extent[0].max(extent[1]);
        Self { original: first, extent: extent.map(|side| AREA * side), distance, ..Self::default() }
    }

    /// The drawn points, and whether the last is joined to the first.
    pub(super) fn outline(&self) -> (&[DVec3], bool) {
        (&self.points, self.over == Over::Polygon && self.points.len() > 2)
    }

    /// True if there are points enough.
    fn is_ready(&self) -> bool {
        self.points.len()
            >= match self.over {
                Over::Area => 0,
                Over::Path => 2,
                Over::Polygon => 3,
            }
    }

    /// The edit: copies of an instance's template around it, with its offsets, own Gaussians and colour matrix.
    fn edit(&self, scene: &InstancedScene, instance: usize, up: DVec3) -> Edit {
        let original = &scene.instances[instance];
        let (min_distance, turn, seed) = (self.distance, self.turn.to_radians(), self.seed);
        let points = self.points.clone();
        let over = match self.over {
            Over::Area => {
                let point = footprint(scene, instance, up).point;
                ScatterOver::Plane { point, normal: up, extent: self.extent, min_distance, turn, seed }
            }
            Over::Path => ScatterOver::Path { points, up, yaw: 0.0 },
            Over::Polygon => ScatterOver::Polygon { points, up, min_distance, turn, seed },
        };
        let differs = !scene.looks_like_template(instance);
        let offsets = if differs { OffsetSource::Shared(Selector::Index(instance)) } else { OffsetSource::None };
        Edit::Scatter(Scatter { template: original.template, count: self.count, over, offsets })
    }
}

impl EditPanel {
    /// Fields and buttons for scattering copies around an instance, along a path or in a polygon.
    pub(super) fn scatter_copies(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, k: usize, actions: &mut Vec<Action>) {
        let previews = self.previews();
        let fields = &mut self.scatter;
        let before = fields.clone();
        ui.horizontal(|ui| {
            for (over, name) in
                [(Over::Area, texts::AROUND), (Over::Path, texts::PATH), (Over::Polygon, texts::POLYGON)]
            {
                ui.selectable_value(&mut fields.over, over, name);
            }
            if fields.over != Over::Area {
                ui.toggle_value(&mut fields.draws, texts::DRAW_POINTS);
            }
        });
        fields.draws &= fields.over != Over::Area;
        if fields.draws {
            ui.label(texts::CLICK_POINTS);
        }
        let over = fields.over;
        Grid::new("scatter").num_columns(2).show(ui, |ui| {
            let mut row = |label: &str, values: Vec<DragValue<'_>>| {
                ui.label(label);
                ui.horizontal(|ui| values.into_iter().for_each(|value| drop(ui.add(value))));
                ui.end_row();
            };
            row(texts::COPIES, vec![DragValue::new(&mut fields.count).range(1..=MOST)]);
            let [width, depth] = &mut fields.extent;
            let length = |value| DragValue::new(value).speed(facts.step).range(0.0..=f64::MAX).max_decimals(3);
            if over == Over::Area {
                row(texts::WIDTH_DEPTH, vec![length(width), length(depth)]);
            }
            if over != Over::Path {
                row(texts::LEAST_DISTANCE, vec![length(&mut fields.distance)]);
                row(
                    texts::RANDOM_ROTATION,
                    vec![DragValue::new(&mut fields.turn).range(0.0..=360.0).suffix(texts::DEGREES)],
                );
                row(texts::SEED, vec![DragValue::new(&mut fields.seed)]);
            }
        });
        if !previews {
            fields.original = k;
        }
        let (ready, changed) = (fields.is_ready(), *fields != before);
        let edit = || self.scatter.edit(facts.scene, self.scatter.original, facts.up);
        let (mut live, mut done) = (None, None);
        ui.horizontal(|ui| {
            if !previews && ui.add_enabled(ready, Button::new(texts::PREVIEW)).clicked() {
                live = Some(edit());
            }
            if ui.add_enabled(ready, Button::new(texts::APPLY)).clicked() {
                // What was refused is no preview: applying it says why once more.
                let shown = previews && !facts.editor.has_live_failed();
                done = Some(if shown { Action::Finish } else { Action::Edit(edit()) });
            }
            if previews && ui.button(texts::CANCEL).clicked() {
                done = Some(Action::Cancel);
            }
        });
        if previews && changed && ready {
            live = Some(edit());
        }
        if let Some(edit) = live {
            let id = ui.id().with("preview");
            self.scatter.preview = Some(id);
            self.change(id, edit, actions);
        }
        if let Some(done) = done {
            if done == Action::Cancel {
                self.scatter.points.clear();
            }
            // The points stay until the copies are there, which are then selected: they may not fit.
            (self.scatter.preview, self.scatter.draws, self.live) = (None, false, None);
            actions.push(done);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;
    use instgs_vk::scene::edit::{apply, instance_centres};
    use instgs_vk::scene::instanced_scene::SAME_COLOR;

    #[test]
    fn copies_stand_around_the_original_with_its_offsets() {
        let mut scene = sample_scene();
        let fields = ScatterFields { count: 4, extent: [3.0, 5.0], ..ScatterFields::default() };
        for (k, shared) in [(0, true), (1, false)] {
            let edit = fields.edit(&scene, k, DVec3::Z);
            let added = apply(&mut scene, &edit).unwrap().added;
            assert_eq!(added.len(), 4);
            let foot = footprint(&scene, k, DVec3::Z);
            for (&a, centre) in added.iter().zip(instance_centres(&scene, added.iter().copied())) {
                let (original, copy) = (&scene.instances[k], &scene.instances[a]);
                assert_eq!((copy.template, copy.first_offset), (original.template, original.first_offset));
                assert_eq!(copy.first_offset.is_some(), shared);
                let from = centre - foot.point;
                assert!(from.x.abs() <= 1.5 + 1e-5 && from.y.abs() <= 2.5 + 1e-5, "{from}");
            }
            scene.validate().unwrap();
        }
    }

    #[test]
    fn copies_have_the_colour_matrix_of_the_original() {
        let mut scene = sample_scene();
        let mut tinted = SAME_COLOR;
        tinted[0][3] = 0.25;
        scene.color_from_template = vec![SAME_COLOR; scene.instances.len()];
        scene.color_from_template[1] = tinted;
        assert!(scene.instances[1].first_offset.is_none());
        let fields = ScatterFields { count: 2, extent: [3.0, 5.0], ..ScatterFields::default() };
        let edit = fields.edit(&scene, 1, DVec3::Z);
        let added = apply(&mut scene, &edit).unwrap().added;
        assert!(added.len() == 2 && added.iter().all(|&k| scene.color_from_template[k] == tinted));
        scene.validate().unwrap();
    }
}
