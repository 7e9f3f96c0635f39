//! Decides whether the selected object is part of a wall, and compares colour patterns.

use glam::{DMat3, DVec3, Vec3};

use super::picture::{Frame, Picture, Pixel, Splat};
use super::select::{Selected, half_extent};
use crate::register::normals::covariance;
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::scene::{Camera, ObjectBox};

/// Pixels along the square root of a pattern's area in refinement.
pub(super) const PIXELS: f64 = 20.0;
/// Margin around the box, in square roots of its area: the edge of a frame needs both sides.
const MARGIN: f64 = 0.05;
/// A wall's normal is at least 45 degrees from the up axis: the cosine. (A car is flat when seen from above.)
const LEVEL: f64 = 0.7;
/// Width of the ring around the box in which the wall must continue, in square roots of the box's area.
const RING: f64 = 0.25;
/// Least number of the ring's four sides on which the wall continues; it may end at one of them.
const SIDES: usize = 3;
/// Least part of a side that must be covered by the wall.
const SIDE_PART: f64 = 0.5;
/// Largest depth of the wall from the median of the box's contents, in square roots of the box's area.
const SAME_LEVEL: f32 = 0.2;
/// The middle 80 % of the box's contents lie within this depth, in square roots of its area: windows do, cars, chairs
/// and trees do not.
const MOST_RELIEF: f32 = 0.25;
/// The wall's normal is fitted to Gaussians in this many times the box.
const FITTED: f64 = 1.5;
/// A normal farther than this from the box's thinnest edge, radians (25 degrees), is not the wall's.
const MOST_OFF: f64 = 0.44;
/// Depth of the layer that is drawn, as a part of the box's depth; a shallow box must not cut off trained walls, which
/// are uneven.
const DEEPER: f64 = 1.2;
/// Least depth of that layer, as a part of the smaller of the box's width and height.
const LEAST_DEPTH: f64 = 0.5;
/// Surfaces farther in depth than this from the pattern's, in square roots of its area, do not match.
pub(super) const SAME_DEPTH: f64 = 0.15;
/// Variance between patterns at which a pixel has half its weight.
const HALF_VARIANCE: f32 = 0.3;

/// Frame in which the selected object's pattern is drawn; `None` unless the object is part of a wall, an upright
/// surface that continues around the box at the same depth.
pub(super) fn wall_frame(selected: &Selected, cameras: &[Camera], splats: &[Splat]) -> Option<Frame> {
    let frame = frame_of(selected, cameras)?;
    let root = (PIXELS * frame.cell) as f32;
    let ring = (RING * PIXELS) as usize;
    let around = frame.wider(ring);
    let picture = Picture::new(splats.iter(), &around);
    let inside = picture.part([ring; 2], frame.size);
    let mut depths: Vec<f32> = inside.pixels.iter().filter(|p| p.weight > 0.0).map(|p| p.depth).collect();
    depths.sort_by(f32::total_cmp);
    let at = |part: f64| depths.get((part * depths.len() as f64) as usize);
    let (Some(near), Some(middle), Some(far)) = (at(0.1), at(0.5), at(0.9)) else { return None };
    let [width, height] = frame.size;
    let goes_on = |corner: [usize; 2], size: [usize; 2]| {
        let side = picture.part(corner, size).pixels;
        let is_level = |p: &&Pixel| p.weight > 0.0 && (p.depth - middle).abs() < SAME_LEVEL * root;
        side.iter().filter(is_level).count() as f64 > SIDE_PART * side.len() as f64
    };
    let sides = [([0, ring], [ring, height]), ([ring + width, ring], [ring, height])]
        .into_iter()
        .chain([([ring, 0], [width, ring]), ([ring, ring + height], [width, ring])]);
    let sides = sides.filter(|(corner, size)| goes_on(*corner, *size)).count();
    (sides >= SIDES && far - near < MOST_RELIEF * root).then_some(frame)
}

/// The frame straight in front of the object; `None` if that is above or below it.
fn frame_of(selected: &Selected, cameras: &[Camera]) -> Option<Frame> {
    let object = &selected.object_box;
    let axes = DMat3::from_quat(object.world_from_box);
    let thinnest = axes.col(object.size.min_position());
    let wide = ObjectBox { size: object.size * FITTED, ..object.clone() };
    let wall: Vec<DVec3> = selected.ground.iter().copied().filter(|p| wide.contains(*p)).collect();
    let fitted = DVec3::from_array(symmetric_eigen(covariance(&wall))[0].1);
    let is_near = fitted.dot(thinnest).abs() > MOST_OFF.cos();
    let across = if is_near { fitted } else { thinnest };
    if across.dot(selected.up).abs() > LEVEL {
        return None;
    }
    let middle = object.center;
    let eyes = cameras.iter().map(|c| (c.position_world() - selected.surface.centroid - middle).normalize_or_zero());
    let out = if eyes.sum::<DVec3>().dot(across) < 0.0 { -across } else { across };
    let above = selected.up.reject_from(out).normalize();
    let axes = DMat3::from_cols(above.cross(out), above, out);
    let [width, height, depth] = [0, 1, 2].map(|k| 2.0 * half_extent(object, axes.col(k)));
    let root = (width * height).sqrt();
    let cell = root / PIXELS;
    let pixels = |length: f64| ((length + 2.0 * MARGIN * root) / cell).round().clamp(1.0, 10.0 * PIXELS) as usize;
    let half_depth = 0.5 * (DEEPER * depth).max(LEAST_DEPTH * width.min(height));
    Some(Frame { middle, axes, cell, size: [pixels(width), pixels(height)], half_depth })
}

/// Likeness of a pattern and a part of a picture, at most 1: the correlation of their colours, which ignores
/// brightness, times the part of the pattern that is visible. `at` is the part's first pixel. Pixels whose depth
/// differs by more than `tolerance` count as not visible.
pub(super) fn likeness(pattern: &Picture, picture: &Picture, at: [usize; 2], tolerance: f32) -> f32 {
    let (mut all, mut sum) = (0.0, 0.0);
    let (mut mean_p, mut mean_q) = (Vec3::ZERO, Vec3::ZERO);
    let (mut pp, mut pq, mut qq) = (0.0, 0.0, 0.0);
    for y in 0..pattern.size[1] {
        let row = &picture.pixels[(at[1] + y) * picture.size[0] + at[0]..];
        for (p, q) in pattern.pixels[y * pattern.size[0]..][..pattern.size[0]].iter().zip(row) {
            all += p.weight;
            if (p.depth - q.depth).abs() > tolerance {
                continue;
            }
            let weight = p.weight * q.weight;
            sum += weight;
            mean_p += weight * p.color;
            mean_q += weight * q.color;
            pp += weight * p.color.length_squared();
            pq += weight * p.color.dot(q.color);
            qq += weight * q.color.length_squared();
        }
    }
    let (of_p, of_q) = (pp - mean_p.length_squared() / sum, qq - mean_q.length_squared() / sum);
    let product = (of_p * of_q).sqrt();
    // A uniform colour and an empty picture have a likeness of 0.
    if product > 1e-6 * sum { sum / all * (pq - mean_p.dot(mean_q) / sum) / product } else { 0.0 }
}

/// Mean of patterns of one size, with lower weights where they differ.
pub(super) fn common(patterns: &[&Picture]) -> Picture {
    let even: Vec<Vec<Pixel>> = patterns.iter().map(|p| evened(p)).collect();
    let pixel = |i: usize| {
        let there = || even.iter().map(|pixels| pixels[i]).filter(|p| p.weight > 0.0);
        let count = there().count();
        if count == 0 {
            return Pixel::default();
        }
        let color = there().map(|p| p.color).sum::<Vec3>() / count as f32;
        let variance = there().map(|p| p.color.distance_squared(color)).sum::<f32>() / count as f32;
        // Where the first shows nothing, as behind a window, its depth says nothing.
        let own = patterns[0].pixels[i];
        let depth = if own.weight > 0.0 { own.depth } else { there().map(|p| p.depth).sum::<f32>() / count as f32 };
        Pixel { color, depth, weight: HALF_VARIANCE / (variance + HALF_VARIANCE) }
    };
    Picture { size: patterns[0].size, pixels: (0..even[0].len()).map(pixel).collect() }
}

/// Colours with their mean subtracted and scaled to variance 1.
fn evened(picture: &Picture) -> Vec<Pixel> {
    let sum: f32 = picture.pixels.iter().map(|p| p.weight).sum();
    let mean = picture.pixels.iter().map(|p| p.weight * p.color).sum::<Vec3>() / sum;
    let squares = picture.pixels.iter().map(|p| p.weight * p.color.distance_squared(mean)).sum::<f32>();
    let spread = (squares / sum).sqrt().max(f32::MIN_POSITIVE);
    picture.pixels.iter().map(|p| Pixel { color: (p.color - mean) / spread, ..*p }).collect()
}
