//! Moving, rotating and scaling instances.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use crate::math::sh::widened;
use crate::math::similarity::Similarity;
use crate::scene::edit::{EditOutcome, EditReason, Selector, Turn, checked};
use crate::scene::instanced_scene::{Instance, InstancedScene};

/// The centre of every template, in its frame: the mean of its Gaussians' means, or the origin if it has none.
pub fn template_centres(scene: &InstancedScene) -> Vec<DVec3> {
    (0..scene.template_ranges.len()).map(|template| template_centre(scene, template)).collect()
}

/// The centre of one template, in its frame; see [`template_centres`].
fn template_centre(scene: &InstancedScene, template: usize) -> DVec3 {
    let range = scene.template_ranges[template];
    let means = &scene.templates.means[range.first as usize..(range.first + range.count) as usize];
    let sum: DVec3 = means.iter().map(|&mean| widened(mean)).sum();
    if means.is_empty() { DVec3::ZERO } else { sum / means.len() as f64 }
}

/// The centres of some instances in the world: those of their templates, transformed. Only these templates are read.
///
/// # Panics
/// If an index is out of range.
pub fn instance_centres(scene: &InstancedScene, instances: impl IntoIterator<Item = usize>) -> Vec<DVec3> {
    let mut centres = BTreeMap::new();
    let mut centre = |k: usize| {
        let Instance { template, world_from_template, .. } = &scene.instances[k];
        let centre = centres.entry(*template).or_insert_with(|| template_centre(scene, *template as usize));
        world_from_template.transform_point(*centre)
    };
    instances.into_iter().map(&mut centre).collect()
}

/// The transform, translated by a world-space vector; the linear part stays identical to the bit.
pub(super) fn moved(placement: Similarity, by: DVec3) -> Similarity {
    Similarity::from_parts(placement.linear(), 1.0, placement.translation() + by)
}

/// The transform followed by a linear map about the image of `centre`, a point of the template's frame.
pub(super) fn mapped_about(placement: Similarity, centre: DVec3, map: DMat3) -> Similarity {
    let centre_world = placement.transform_point(centre);
    let linear = map * placement.linear();
    Similarity::from_parts(linear, 1.0, centre_world - linear * centre)
}

/// The rotation matrix of a turn; the error says why it has none.
pub(super) fn rotation_of(turn: Turn) -> Result<DMat3, EditReason> {
    let axis = turn.axis.try_normalize().ok_or_else(|| EditReason::value("the axis has no direction"))?;
    if !turn.angle.is_finite() {
        return Err(EditReason::value("the angle is not finite"));
    }
    Ok(DMat3::from_axis_angle(axis, turn.angle))
}

/// Replaces the transforms of the selected instances if all new ones are valid.
fn place(
    scene: &mut InstancedScene,
    which: &Selector,
    place_one: impl Fn(Similarity, DVec3) -> Similarity,
) -> Result<EditOutcome, EditReason> {
    let changed = which.resolve(scene)?;
    let mut centres = BTreeMap::new();
    let place_one = |&k: &usize| {
        let instance = &scene.instances[k];
        let centre =
            centres.entry(instance.template).or_insert_with(|| template_centre(scene, instance.template as usize));
        checked(place_one(instance.world_from_template, *centre), k)
    };
    let placements = changed.iter().map(place_one).collect::<Result<Vec<_>, _>>()?;
    for (&k, placement) in changed.iter().zip(placements) {
        scene.instances[k].world_from_template = placement;
    }
    Ok(EditOutcome { changed, ..EditOutcome::default() })
}

pub(super) fn move_by(scene: &mut InstancedScene, which: &Selector, by: DVec3) -> Result<EditOutcome, EditReason> {
    place(scene, which, |placement, _| moved(placement, by))
}

pub(super) fn move_to(scene: &mut InstancedScene, which: &Selector, to: DVec3) -> Result<EditOutcome, EditReason> {
    which.resolve_one(scene)?;
    place(scene, which, |placement, centre| moved(placement, to - placement.transform_point(centre)))
}

pub(super) fn rotate(scene: &mut InstancedScene, which: &Selector, turn: Turn) -> Result<EditOutcome, EditReason> {
    let rotation = rotation_of(turn)?;
    place(scene, which, |placement, centre| mapped_about(placement, centre, rotation))
}

pub(super) fn scale(scene: &mut InstancedScene, which: &Selector, by: f64) -> Result<EditOutcome, EditReason> {
    if !(by.is_finite() && by > 0.0) {
        return Err(EditReason::value(format!("{by} is not a scale: want a number above 0")));
    }
    place(scene, which, |placement, centre| mapped_about(placement, centre, DMat3::from_diagonal(DVec3::splat(by))))
}
