//! Is the selected object a part of a wall? Then its pattern of colours tells what is like it.

use glam::{DMat3, DVec3, Vec3};

use super::picture::{Frame, Picture, Pixel, Splat};
use super::select::{Selected, half_extent};
use crate::math::eigen::symmetric_eigen;
use crate::register::normals::covariance;
use crate::scene::{Camera, ObjectBox};

/// Pixels of a pattern along the root of its area, to look at it closely.
pub(super) const PIXELS: f64 = 20.0;
/// The pattern is the box with this much of its surroundings, in roots of its area: the edge of a frame needs both sides.
const MARGIN: f64 = 0.05;
/// A wall's normal is at least 45 degrees from the vertical: the cosine. (A car is flat seen from above.)
const LEVEL: f64 = 0.7;
/// A wall goes on this far around what is in it, in roots of its area: at least this part of three of the four sides is
/// there, no more than so much before or behind the middle of what is in the box. Of windows in trained clouds the third best
/// side has 0.76 and more (the fourth may be where the wall ends), of chairs, vases and trees 0.27 at most.
const RING: f64 = 0.25;
const SIDES: usize = 3;
const SIDE_PART: f64 = 0.5;
const SAME_LEVEL: f32 = 0.2;
/// The middle 80 % of what is in the box are within this depth, roots of its area: of windows within 0.07 to 0.21, of cars
/// 0.25 to 0.31, chairs 0.28 to 0.44, trees 0.41 to 0.49.
const MOST_RELIEF: f32 = 0.25;
/// What part of the box's surroundings the wall's normal is fitted to: so many times the box. Beyond this angle to the
/// box's thinnest edge, radians (25 degrees), it is not the wall's.
const FITTED: f64 = 1.5;
const MOST_OFF: f64 = 0.44;
/// The layer that is looked at is this part of the box's depth, and at least this one of its width: a shallow box must not
/// cut off what trained walls depart from their plane.
const DEEPER: f64 = 1.2;
const LEAST_DEPTH: f64 = 0.5;
/// What is this much nearer or farther than in the pattern, roots of its area, is something else.
pub(super) const SAME_DEPTH: f64 = 0.15;
/// Where patterns differ by this variance of their own a pixel counts half.
const HALF_VARIANCE: f32 = 0.3;

/// Where the selected object's pattern is seen from; `None` if it is not part of a wall: an upright surface that goes on,
/// at the same depth, around what is in the box.
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

/// Straight before the object, looking at what is in the box; `None` if that is from above or below.
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

/// How alike a pattern and a part of a picture are, at most 1: the correlation of their colours after the mean of each is
/// taken off, so that shade does not matter, times the part of the pattern that is there. `at` is the part's first pixel.
/// What is not about as deep as in the pattern, by more than `tolerance`, is not there.
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
    // One colour all over, or nothing, is like nothing.
    if product > 1e-6 * sum { sum / all * (pq - mean_p.dot(mean_q) / sum) / product } else { 0.0 }
}

/// What patterns of one size have in common: their mean, in which pixels where they differ count less.
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
        Pixel { color, depth: patterns[0].pixels[i].depth, weight: HALF_VARIANCE / (variance + HALF_VARIANCE) }
    };
    Picture { size: patterns[0].size, pixels: (0..even[0].len()).map(pixel).collect() }
}

/// Colours with their mean taken off, and of variance 1.
fn evened(picture: &Picture) -> Vec<Pixel> {
    let sum: f32 = picture.pixels.iter().map(|p| p.weight).sum();
    let mean = picture.pixels.iter().map(|p| p.weight * p.color).sum::<Vec3>() / sum;
    let squares = picture.pixels.iter().map(|p| p.weight * p.color.distance_squared(mean)).sum::<f32>();
    let spread = (squares / sum).sqrt().max(f32::MIN_POSITIVE);
    picture.pixels.iter().map(|p| Pixel { color: (p.color - mean) / spread, ..*p }).collect()
}
