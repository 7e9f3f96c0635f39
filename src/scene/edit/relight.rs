//! Relighting: an instance takes the colour matrix of the instances around it.

use crate::scene::edit::placement::instance_centres;
use crate::scene::edit::{EditOutcome, EditReason, Selector};
use crate::scene::instanced_scene::{ColorMatrix, InstancedScene};

/// Number of neighbours whose matrices are averaged.
const NEIGHBOURS: usize = 3;

/// Gives each instance the mean colour matrix of the nearest instances of its template that are not selected, weighted by the
/// inverse of their distance.
pub(super) fn relight(scene: &mut InstancedScene, which: &Selector) -> Result<EditOutcome, EditReason> {
    let chosen = which.resolve(scene)?;
    if scene.color_from_template.is_empty() {
        return Err(EditReason::value(
            "the scene has no colour matrices: training with colours per instance makes them",
        ));
    }
    let centres = instance_centres(scene, 0..scene.instances.len());
    let mut matrices = Vec::new();
    for &k in &chosen {
        let template = scene.instances[k].template;
        let is_neighbour = |j: &usize| scene.instances[*j].template == template && chosen.binary_search(j).is_err();
        let mut near: Vec<(f64, usize)> =
            (0..centres.len()).filter(is_neighbour).map(|j| (centres[j].distance(centres[k]), j)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBOURS);
        if near.is_empty() {
            return Err(EditReason::value(format!("template {template} has no other instance to take light from")));
        }
        matrices.push(mean_matrix(scene, &near));
    }
    for (&k, matrix) in chosen.iter().zip(matrices) {
        scene.color_from_template[k] = matrix;
    }
    Ok(EditOutcome { changed: chosen, ..EditOutcome::default() })
}

/// The mean of the matrices of instances, each with its distance, world units.
fn mean_matrix(scene: &InstancedScene, near: &[(f64, usize)]) -> ColorMatrix {
    let nearest = near[0].0;
    // Relative to the nearest, so that no weight overflows; one at the same place decides alone.
    let weight = |distance: f64| if distance > 0.0 { nearest / distance } else { 1.0 };
    let weights: Vec<f64> = near.iter().map(|(distance, _)| weight(*distance)).collect();
    let total: f64 = weights.iter().sum();
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let value = |&(_, j): &(f64, usize)| f64::from(scene.color_from_template[j][row][column]);
            let sum: f64 = near.iter().zip(&weights).map(|(one, weight)| weight * value(one)).sum();
            (sum / total) as f32
        })
    })
}
