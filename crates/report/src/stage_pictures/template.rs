//! Pictures of single templates: after merging, and after the joint phase.

use std::f64::consts::PI;

use super::framing::{carried_around, close_up, means, middle, portrait, up_or_guess};
use super::overlay::TILE_PX;
use super::painter::{Painter, rgb8};
use crate::Rgb8;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::RenderError;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

/// Upper bound of the templates shown, as hardly anyone looks at more.
const TEMPLATES: usize = 12;

/// Pictures of every template, or the first twelve, of `scene` without the offsets of any instance, at the pose of its
/// first instance: from the camera that shows it best, and from behind. Cameras are chosen for `framed`, the merged
/// scene, so that two states of a scene are shown alike. A template without Gaussians or instances has no pictures.
///
/// # Errors
/// The device fails or is too small.
pub(super) fn pictures(
    painter: &mut Painter,
    scene: &InstancedScene,
    framed: &InstancedScene,
    cameras: &[Camera],
) -> Result<Vec<Vec<Rgb8>>, RenderError> {
    let mut all = Vec::with_capacity(scene.template_ranges.len());
    for template in 0..scene.template_ranges.len().min(TEMPLATES) {
        let sides = placed(framed, template).and_then(|(own, pose)| sides(cameras, &own, &pose));
        let pictures = match (placed(scene, template), sides) {
            (Some((own, pose)), Some(sides)) => painter.pictures(own, pose, &sides)?.iter().map(rgb8).collect(),
            _ => Vec::new(),
        };
        all.push(pictures);
    }
    Ok(all)
}

/// A template's Gaussians without view-dependent colour, as for objects, and the pose of its first instance.
fn placed(scene: &InstancedScene, template: usize) -> Option<(Gaussians, Similarity)> {
    let range = scene.template_ranges.get(template)?;
    let mut own = Gaussians::with_capacity(0, range.count as usize);
    (range.first..range.first + range.count).for_each(|i| own.push_from(&scene.templates, i as usize));
    let instance = scene.instances.iter().find(|instance| instance.template as usize == template)?;
    (!own.is_empty()).then_some((own, instance.world_from_template))
}

fn sides(cameras: &[Camera], own: &Gaussians, pose: &Similarity) -> Option<[Camera; 2]> {
    let points: Vec<_> = means(own).into_iter().map(|p| pose.transform_point(p)).collect();
    let front = portrait(cameras, &points, TILE_PX)?;
    let behind = carried_around(&front, middle(&points), up_or_guess(cameras), PI);
    let behind = close_up(&behind, &points, TILE_PX);
    Some([front, behind])
}
