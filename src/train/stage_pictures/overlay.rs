//! Registered objects laid on the reference of their group, so that a wrong pose is seen.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use super::colors::Colors;
use super::framing::{carried_around, close_up, means, middle, portrait, up_or_guess};
use super::labels::tinted;
use super::painter::{GROUND, Painter, rgb8};
use crate::math::similarity::Similarity;
use crate::render::{Picture, RenderError};
use crate::scene::{Camera, Gaussians, PosedGroup, PosedInstance};
use crate::train::report::{GroupOverlay, OverlayTile, Rgb8};

/// Size of a picture of one object, pixels: three beside each other are half as wide as the page.
pub(super) const TILE_PX: (u32, u32) = (240, 180);
/// The reference's grey: objects' colours stand out against it.
const REFERENCE_GREY: [u8; 3] = [185; 3];

/// The objects of a labelled cloud.
pub struct Objects<'a> {
    cloud: &'a Gaussians,
    cameras: &'a [Camera],
    colors: &'a Colors,
    /// Finite Gaussians by object.
    indices: BTreeMap<u32, Vec<u32>>,
}

impl<'a> Objects<'a> {
    /// Of a plain cloud with an object per Gaussian (0 = none), and the training views.
    pub fn new(cloud: &'a Gaussians, labels: &[u32], cameras: &'a [Camera], colors: &'a Colors) -> Self {
        let mut indices: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (i, &id) in labels.iter().enumerate().take(cloud.len()) {
            if id != 0 && cloud.is_finite(i) {
                indices.entry(id).or_default().push(i as u32);
            }
        }
        Self { cloud, cameras, colors, indices }
    }

    /// Number of Gaussians of an object.
    pub(super) fn len(&self, id: u32) -> usize {
        self.indices.get(&id).map_or(0, Vec::len)
    }

    /// Ids of objects that have Gaussians, ascending.
    pub(super) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.indices.keys().copied()
    }

    /// An object's Gaussians, without view-dependent colour: a turned object is looked at from where no photo was taken.
    pub(super) fn gaussians(&self, id: u32) -> Gaussians {
        let indices = self.indices.get(&id).map(Vec::as_slice).unwrap_or_default();
        let mut out = Gaussians::with_capacity(0, indices.len());
        indices.iter().for_each(|&i| out.push_from(self.cloud, i as usize));
        out
    }
}

/// Pictures of the `shown` instances of a group (indices, in the order of the page), each brought to the place of instance
/// `reference`: as itself, and in its colour over the grey reference, from the camera that shows the reference best and from
/// a quarter turn beside it.
///
/// # Errors
/// The device's.
pub fn group_overlay(
    painter: &mut Painter,
    objects: &Objects<'_>,
    group: &PosedGroup,
    (reference, shown): (usize, &[usize]),
) -> Result<GroupOverlay, RenderError> {
    let name = group.name.clone().unwrap_or_else(|| format!("group {}", group.template_id));
    let mut out = GroupOverlay { name, left_out: group.instances.len() - shown.len(), tiles: Vec::new() };
    let standard = &group.instances[reference];
    let own = objects.gaussians(standard.id);
    let Some(cameras) = cameras(objects, &own) else { return Ok(out) };
    let grey = painter.pictures(&tinted(&own, REFERENCE_GREY), Similarity::IDENTITY, &cameras)?;
    for instance in shown.iter().map(|&i| &group.instances[i]) {
        let color = objects.colors.of(instance.id).unwrap_or_default();
        let own = objects.gaussians(instance.id);
        let pose = reference_from_instance(standard, instance);
        let mut tile = OverlayTile { id: instance.id, color, ..OverlayTile::default() };
        if !own.is_empty() {
            tile.own = painter.pictures(&own, pose, &cameras[..1])?.first().map(rgb8);
        }
        if !own.is_empty() && instance.id != standard.id {
            let laid = painter.pictures(&tinted(&own, color), pose, &cameras)?;
            tile.over = grey.iter().zip(&laid).map(|(under, over)| laid_over(under, over)).collect();
            tile.overlap = Some(overlap(&grey, &laid));
        }
        out.tiles.push(tile);
    }
    Ok(out)
}

/// Objects that are in no group, as they are.
///
/// # Errors
/// The device's.
pub(super) fn portraits(
    painter: &mut Painter,
    objects: &Objects<'_>,
    ids: &[u32],
) -> Result<Vec<OverlayTile>, RenderError> {
    let mut tiles = Vec::with_capacity(ids.len());
    for &id in ids {
        let own = objects.gaussians(id);
        let camera = portrait(objects.cameras, &means(&own), TILE_PX);
        let own = match camera {
            Some(camera) => painter.pictures(&own, Similarity::IDENTITY, &[camera])?.first().map(rgb8),
            None => None,
        };
        tiles.push(OverlayTile { id, color: objects.colors.of(id).unwrap_or_default(), own, ..OverlayTile::default() });
    }
    Ok(tiles)
}

/// The camera that shows an object best, and one a quarter turn beside it; `None` without Gaussians.
fn cameras(objects: &Objects<'_>, own: &Gaussians) -> Option<[Camera; 2]> {
    let points = means(own);
    let front = portrait(objects.cameras, &points, TILE_PX)?;
    let beside = carried_around(&front, middle(&points), up_or_guess(objects.cameras), FRAC_PI_2);
    let beside = close_up(&beside, &points, TILE_PX);
    Some([front, beside])
}

/// From an instance's place in the world to that of the reference.
fn reference_from_instance(reference: &PosedInstance, instance: &PosedInstance) -> Similarity {
    let (to, from) = (&reference.world_from_template, &instance.world_from_template);
    if to == from {
        return Similarity::IDENTITY;
    }
    let rotation = to.rotation() * from.rotation().transpose();
    let scale = to.scale() / from.scale();
    Similarity::from_parts(rotation, scale, to.translation() - scale * (rotation * from.translation()))
}

/// Both at once: where both are, half of each; where only one is, that one.
fn laid_over(under: &Picture, over: &Picture) -> Rgb8 {
    let pixel = |(a, b): (&[f32; 4], &[f32; 4])| {
        let part = a[3] + b[3];
        let cover = a[3].max(b[3]);
        // Colours come with the ground behind them; what is left is the objects' own, times their alpha.
        let own = |c: usize| a[c] - (1.0 - a[3]) * GROUND + b[c] - (1.0 - b[3]) * GROUND;
        [0, 1, 2].map(|c| if part > 0.0 { own(c) / part * cover + (1.0 - cover) * GROUND } else { GROUND })
    };
    let colors = under.colors.iter().zip(&over.colors).map(pixel);
    let pixels = colors.flatten().map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    Rgb8 { width: under.width, height: under.height, pixels }
}

/// How far outlines agree over all pictures: intersection by union of their alphas, 0..=1.
fn overlap(under: &[Picture], over: &[Picture]) -> f64 {
    let alphas = |pictures: &[Picture]| -> Vec<f64> {
        pictures.iter().flat_map(|p| p.colors.iter().map(|c| f64::from(c[3]))).collect()
    };
    let (a, b) = (alphas(under), alphas(over));
    let both: f64 = a.iter().zip(&b).map(|(a, b)| a.min(*b)).sum();
    let either: f64 = a.iter().zip(&b).map(|(a, b)| a.max(*b)).sum();
    if either > 0.0 { both / either } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    fn picture(colors: Vec<[f32; 4]>) -> Picture {
        Picture { width: colors.len() as u32, height: 1, depths: vec![0.0; colors.len()], colors }
    }

    #[test]
    fn both_are_mixed_and_one_alone_is_itself() {
        let (ground, red, blue) = ([GROUND, GROUND, GROUND, 0.0], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]);
        let (under, over) = (picture(vec![red, red, ground, ground]), picture(vec![blue, ground, blue, ground]));
        let out = laid_over(&under, &over);
        let level = (GROUND * 255.0).round() as u8;
        assert_eq!(out.pixels, [128, 0, 128, 255, 0, 0, 0, 0, 255, level, level, level]);
        let third = overlap(&[under], &[over]);
        assert!((third - 1.0 / 3.0).abs() < 1e-12, "{third}");
        assert_eq!(overlap(&[], &[]), 0.0);
    }

    #[test]
    fn poses_bring_instances_to_the_reference() {
        let pose = |angle: f64, scale: f64, x: f64| {
            Similarity::from_parts(DMat3::from_rotation_y(angle), scale, DVec3::new(x, 2.0, -x))
        };
        let at = |id, world_from_template| PosedInstance { id, world_from_template };
        let (reference, instance) = (at(1, pose(0.3, 1.0, 4.0)), at(2, pose(2.0, 1.5, -3.0)));
        let p = DVec3::new(0.2, -0.4, 0.9);
        let moved = reference_from_instance(&reference, &instance)
            .transform_point(instance.world_from_template.transform_point(p));
        assert!((moved - reference.world_from_template.transform_point(p)).length() < 1e-5, "{moved}");
        assert_eq!(reference_from_instance(&reference, &reference), Similarity::IDENTITY);
    }
}
