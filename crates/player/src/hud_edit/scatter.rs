//! The form that scatters copies of a template on the ground around an instance.

use egui::{DragValue, Grid, Ui};
use glam::DVec3;

use super::{Action, EditFacts, EditPanel};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, Footprint, OffsetSource, Scatter, ScatterOver, Selector, footprint};

/// Largest number of copies at once: more would be a slip of the mouse. The command line has no such limit.
const MOST: usize = 10_000;
/// Initial width of the area relative to the instance's; copies are initially one instance width apart.
const AREA: f64 = 6.0;

/// State of the form's fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ScatterFields {
    count: usize,
    /// Width and depth of the area, world units.
    extent: [f64; 2],
    /// Least distance between centres, world units.
    distance: f64,
    /// Largest random rotation, degrees.
    turn: f64,
    seed: u64,
}

impl Default for ScatterFields {
    fn default() -> Self {
        Self { count: 5, extent: [1.0; 2], distance: 0.0, turn: 360.0, seed: 1 }
    }
}

impl ScatterFields {
    /// Defaults for an area around the first selected instance.
    pub(super) fn beside(facts: &EditFacts<'_>) -> Self {
        let Some(&first) = facts.editor.chosen().first() else { return Self::default() };
        let Footprint { extent, .. } = footprint(facts.scene, first, facts.up);
        Self { extent: extent.map(|side| AREA * side), distance: extent[0].max(extent[1]), ..Self::default() }
    }

    /// The edit: copies of an instance's template around it, with its offsets.
    fn edit(&self, scene: &InstancedScene, instance: usize, up: DVec3) -> Edit {
        let original = &scene.instances[instance];
        let over = ScatterOver::Plane {
            point: footprint(scene, instance, up).point,
            normal: up,
            extent: self.extent,
            min_distance: self.distance,
            turn: self.turn.to_radians(),
            seed: self.seed,
        };
        let differs = original.first_offset.is_some() || scene.own_range(instance).count > 0;
        let offsets = if differs { OffsetSource::Shared(Selector::Index(instance)) } else { OffsetSource::None };
        Edit::Scatter(Scatter { template: original.template, count: self.count, over, offsets })
    }
}

impl EditPanel {
    /// Fields and button for scattering copies around an instance.
    pub(super) fn scatter_copies(&mut self, ui: &mut Ui, facts: &EditFacts<'_>, k: usize, actions: &mut Vec<Action>) {
        let fields = &mut self.scatter;
        Grid::new("scatter").num_columns(2).show(ui, |ui| {
            let mut row = |label: &str, values: Vec<DragValue<'_>>| {
                ui.label(label);
                ui.horizontal(|ui| values.into_iter().for_each(|value| drop(ui.add(value))));
                ui.end_row();
            };
            row("copies", vec![DragValue::new(&mut fields.count).range(1..=MOST)]);
            let [width, depth] = &mut fields.extent;
            let length = |value| DragValue::new(value).speed(facts.step).range(0.0..=f64::MAX).max_decimals(3);
            row("area", vec![length(width), length(depth)]);
            row("least distance", vec![length(&mut fields.distance)]);
            row("random rotation", vec![DragValue::new(&mut fields.turn).range(0.0..=360.0).suffix("°")]);
            row("seed", vec![DragValue::new(&mut fields.seed)]);
        });
        if ui.button("scatter").clicked() {
            actions.push(Action::Edit(self.scatter.edit(facts.scene, k, facts.up)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;
    use instgs_vk::scene::edit::{apply, instance_centres};

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
}
