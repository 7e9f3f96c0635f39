//! Registered objects drawn over the reference of their group, so that a wrong pose can be seen.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use super::colors::Colors;
use super::framing::{carried_around, close_up, means, middle, portrait, up_or_guess};
use super::labels::tinted;
use super::painter::{GROUND, Painter, rgb8};
use crate::{GroupOverlay, OverlayTile, Rgb8};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{Picture, RenderError};
use instgs_vk::scene::{Camera, Gaussians, PosedGroup, PosedInstance};

/// Size of a picture of one object, pixels: three side by side are half as wide as the page.
pub(super) const TILE_PX: (u32, u32) = (240, 180);
/// Grey of the reference, on which objects' colours stand out.
const REFERENCE_GREY: [u8; 3] = [150; 3];
/// Alpha of the reference at its outline.
const OUTLINE_ALPHA: f32 = 0.5;
/// Colour of the outline, 0..=1: darker than any object's shade.
const OUTLINE: [f32; 3] = [0.08; 3];
/// Opacity of the reference over the object: only its dark and light parts show.
const SHINES_THROUGH: f32 = 0.25;

/// The objects of a labelled cloud.
pub struct Objects<'a> {
    cloud: &'a Gaussians,
    cameras: &'a [Camera],
    colors: &'a Colors,
    /// Finite Gaussians by object.
    indices: BTreeMap<u32, Vec<u32>>,
}

impl<'a> Objects<'a> {
    /// Objects of a plain cloud with a label per Gaussian (0 = none), and the training views' cameras.
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

    /// Ids of objects that have Gaussians, in ascending order.
    pub(super) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.indices.keys().copied()
    }

    /// An object's Gaussians without view-dependent colour: a rotated object is seen from directions without photos.
    pub(super) fn gaussians(&self, id: u32) -> Gaussians {
        let indices = self.indices.get(&id).map(Vec::as_slice).unwrap_or_default();
        let mut out = Gaussians::with_capacity(0, indices.len());
        indices.iter().for_each(|&i| out.push_from(self.cloud, i as usize));
        out
    }
}

/// Pictures of the `shown` instances of a group (indices, in the order of the page), each moved to the pose of instance
/// `reference`: in its own colours, and in its object colour over the grey reference, from the camera that shows the
/// reference best and from a quarter turn beside it. The reference itself is shown in grey there.
///
/// # Errors
/// The device fails or is too small.
pub fn group_overlay(
    painter: &mut Painter,
    objects: &Objects<'_>,
    group: &PosedGroup,
    reference: usize,
    shown: &[usize],
) -> Result<GroupOverlay, RenderError> {
    let bare = |&i: &usize| {
        let id = group.instances[i].id;
        OverlayTile { id, color: objects.colors.of(id).unwrap_or_default(), ..OverlayTile::default() }
    };
    let mut out = GroupOverlay {
        name: group_name(group.template_id, group.name.as_ref()),
        tiles: shown.iter().map(bare).collect(),
        left_out: group.instances.len() - shown.len(),
    };
    let standard = &group.instances[reference];
    let own = objects.gaussians(standard.id);
    let Some(cameras) = cameras(objects, &own) else { return Ok(out) };
    let grey = painter.pictures(tinted(&own, REFERENCE_GREY), Similarity::IDENTITY, &cameras)?;
    for (tile, &i) in out.tiles.iter_mut().zip(shown) {
        let own = objects.gaussians(tile.id);
        if own.is_empty() {
            continue;
        }
        let pose = reference_from_instance(standard, &group.instances[i]);
        tile.own = painter.pictures(own.clone(), pose, &cameras[..1])?.first().map(rgb8);
        if i == reference {
            tile.over = grey.iter().map(rgb8).collect();
            continue;
        }
        let laid = painter.pictures(tinted(&own, tile.color), pose, &cameras)?;
        tile.over = grey.iter().zip(&laid).map(|(under, over)| laid_over(under, over)).collect();
        tile.overlap = Some(overlap(&grey, &laid));
    }
    Ok(out)
}

/// Name of a group on the page; several groups may have the same category.
pub(super) fn group_name(template_id: u32, name: Option<&String>) -> String {
    name.map_or_else(|| format!("group {template_id}"), |name| format!("{name}, group {template_id}"))
}

/// Pictures of objects that are in no group.
///
/// # Errors
/// The device fails or is too small.
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
            Some(camera) => painter.pictures(own, Similarity::IDENTITY, &[camera])?.first().map(rgb8),
            None => None,
        };
        tiles.push(OverlayTile { id, color: objects.colors.of(id).unwrap_or_default(), own, ..OverlayTile::default() });
    }
    Ok(tiles)
}

/// The camera that shows an object best, and a camera a quarter turn beside it; `None` without Gaussians.
fn cameras(objects: &Objects<'_>, own: &Gaussians) -> Option<[Camera; 2]> {
    let points = means(own);
    let front = portrait(objects.cameras, &points, TILE_PX)?;
    let beside = carried_around(&front, middle(&points), up_or_guess(objects.cameras), FRAC_PI_2);
    let beside = close_up(&beside, &points, TILE_PX);
    Some([front, beside])
}

/// The transform from an instance's pose in the world to that of the reference.
fn reference_from_instance(reference: &PosedInstance, instance: &PosedInstance) -> Similarity {
    let (to, from) = (&reference.world_from_template, &instance.world_from_template);
    if to == from {
        return Similarity::IDENTITY;
    }
    let rotation = to.rotation() * from.rotation().transpose();
    let scale = to.scale() / from.scale();
    Similarity::from_parts(rotation, scale, to.translation() - scale * (rotation * from.translation()))
}

/// The object in its colour, with a little of the reference showing through and the reference's outline on top. Grey
/// parts are not covered by the object; colour outside of the outline belongs to the object alone.
fn laid_over(under: &Picture, over: &Picture) -> Rgb8 {
    let (width, height) = (under.width as usize, under.height as usize);
    let is_in = |x: usize, y: usize| under.colors[y * width + x][3] > OUTLINE_ALPHA;
    let is_edge = |x: usize, y: usize| {
        is_in(x, y) && !(x > 0 && x + 1 < width && y > 0 && y + 1 < height && beside(x, y).all(|(u, v)| is_in(u, v)))
    };
    let mut pixels = Vec::with_capacity(3 * under.colors.len());
    for (i, (under, over)) in under.colors.iter().zip(&over.colors).enumerate() {
        // A picture's colour already contains the background.
        let mixed = [0, 1, 2].map(|c| over[c] + (1.0 - over[3]) * (under[c] - GROUND));
        let through = SHINES_THROUGH * over[3] * under[3];
        let color = [0, 1, 2].map(|c| mixed[c] + through * (under[c] - mixed[c]));
        let color = if is_edge(i % width, i / width) { OUTLINE } else { color };
        pixels.extend(color.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8));
    }
    Rgb8 { width: under.width, height: under.height, pixels }
}

/// The up to four neighbours of a pixel.
fn beside(x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].into_iter()
}

/// Agreement of the outlines over all pictures: intersection over union of the alphas, 0..=1.
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

    #[test]
    fn the_object_covers_the_reference_whose_outline_stays() {
        let (ground, grey, red) = ([GROUND, GROUND, GROUND, 0.0], [0.5, 0.5, 0.5, 1.0], [1.0, 0.0, 0.0, 1.0]);
        // The reference fills five columns; the object fills three of them, and three more.
        let filled = |color, first: usize, last: usize| {
            let row: Vec<_> = (0..9).map(|x| if (first..last).contains(&x) { color } else { ground }).collect();
            Picture { width: 9, height: 5, colors: row.repeat(5), depths: vec![0.0; 45] }
        };
        let out = laid_over(&filled(grey, 1, 6), &filled(red, 3, 9));
        let pixel = |x: usize| [0, 1, 2].map(|c| out.pixels[3 * (2 * 9 + x) + c]);
        let bytes = |color: [f32; 3]| color.map(|c| (255.0 * c).round() as u8);
        assert_eq!([pixel(0), pixel(1), pixel(2)], [bytes([GROUND; 3]), bytes(OUTLINE), bytes([0.5; 3])]);
        assert_eq!(pixel(4), bytes([0.875, 0.125, 0.125]), "a quarter of the reference shines through");
        assert_eq!([pixel(5), pixel(6)], [bytes(OUTLINE), [255, 0, 0]], "beyond the outline it is itself");
        let third = overlap(&[filled(grey, 1, 6)], &[filled(red, 3, 9)]);
        assert!((third - 3.0 / 8.0).abs() < 1e-12, "{third}");
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
