//! Is the selected object a part of a wall? Then its pattern of colours tells what is like it.

use glam::{DMat3, DVec3, Vec3};

use super::FindInput;
use super::picture::{Frame, Picture, Pixel, Splat};
use super::select::{Selected, half_extent};
use crate::math::eigen::symmetric_eigen;
use crate::register::normals::covariance;
use crate::scene::{Camera, ObjectBox};

/// Pixels of a pattern along the root of its area, to look at it closely.
pub(super) const PIXELS: f64 = 20.0;
/// The pattern is the box with this much of its surroundings, in roots of its area: the edge of a frame needs both sides.
const MARGIN: f64 = 0.05;
/// A wall goes on this far around what is in it, in roots of its area ...
const RING: f64 = 0.25;
/// What part of the box's surroundings the wall's normal is fitted to: so many times the box. Beyond this angle to the
/// box's thinnest edge, radians (25 degrees), it is not the wall's.
const FITTED: f64 = 1.5;
const MOST_OFF: f64 = 0.44;
/// The layer that is looked at is this part of the box's depth, and at least this one of its width: a shallow box must not
/// cut off what trained walls depart from their plane.
const DEEPER: f64 = 1.2;
const LEAST_DEPTH: f64 = 0.5;
/// Less than this part of a pattern being there says nothing.
const MOSTLY_THERE: f32 = 0.7;
/// Where patterns differ by this variance of their own a pixel counts half.
const HALF_VARIANCE: f32 = 0.3;

/// Where the selected object's pattern is seen from; `None` if it is not part of a wall.
pub(super) fn wall_frame(input: &FindInput<'_>, selected: &Selected, splats: &[Splat]) -> Option<Frame> {
    let frame = frame_of(selected, input.cameras);
    let root = PIXELS * frame.cell;
    let ring = (RING * PIXELS) as usize;
    let around = frame.wider(ring);
    let picture = Picture::new(splats.iter(), &around);
    let [width, height] = around.size;
    let (mut covered, mut all) = ([0; 4], [0; 4]);
    let mut depths = Vec::new();
    for (i, p) in picture.pixels.iter().enumerate() {
        let (x, y) = (i % width, i / width);
        let side = [x < ring, x >= width - ring, y < ring, y >= height - ring];
        if side == [false; 4] && p.weight > 0.0 { depths.push(p.depth); }
        for k in 0..4 { if side[k] { all[k] += 1; covered[k] += usize::from(p.weight > 0.0); } }
    }
    depths.sort_by(f32::total_cmp);
    let q = |f: f64| depths.get((f * depths.len() as f64) as usize).copied().unwrap_or(0.0);
    if std::env::var("FLAT").is_ok() {
        let part: Vec<f64> = (0..4).map(|k| covered[k] as f64 / all[k] as f64).collect();
        eprintln!("FLAT support {:?} sides {part:.2?} inside {:.2} relief90 {:.3} relief80 {:.3} thin {:.3} normal {:.2}", selected.support.is_some(), depths.len() as f64 / (frame.size[0]*frame.size[1]) as f64,
            f64::from(q(0.95) - q(0.05)) / root, f64::from(q(0.9) - q(0.1)) / root, 2.0 * half_extent(&selected.object_box, frame.axes.z_axis) / root, frame.axes.z_axis);
    }
    selected.support.is_none().then_some(frame)
}

/// Straight before the object, looking at what is in the box.
fn frame_of(selected: &Selected, cameras: &[Camera]) -> Frame {
    let object = &selected.object_box;
    let axes = DMat3::from_quat(object.world_from_box);
    let by_edge = {
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| object.size[a].total_cmp(&object.size[b]));
        order.map(|k| axes.col(k))
    };
    let wide = ObjectBox { size: object.size * FITTED, ..object.clone() };
    let wall: Vec<DVec3> = selected.ground.iter().copied().filter(|p| wide.contains(*p)).collect();
    let fitted = DVec3::from_array(symmetric_eigen(covariance(&wall))[0].1);
    let is_near = fitted.dot(by_edge[0]).abs() > MOST_OFF.cos();
    let across = if is_near { fitted } else { by_edge[0] };
    let middle = object.center;
    let eyes = cameras.iter().map(|c| (c.position_world() - selected.surface.centroid - middle).normalize_or_zero());
    let out = if eyes.sum::<DVec3>().dot(across) < 0.0 { -across } else { across };
    // Something that lies flat has no upright edge.
    let is_upright = selected.up.reject_from(out).length() > 0.5;
    let above = (if is_upright { selected.up } else { by_edge[2] }).reject_from(out).normalize();
    let axes = DMat3::from_cols(above.cross(out), above, out);
    let [width, height, depth] = [0, 1, 2].map(|k| 2.0 * half_extent(object, axes.col(k)));
    let root = (width * height).sqrt();
    let cell = root / PIXELS;
    let pixels = |length: f64| ((length + 2.0 * MARGIN * root) / cell).round().clamp(1.0, 10.0 * PIXELS) as usize;
    let half_depth = 0.5 * (DEEPER * depth).max(LEAST_DEPTH * width.min(height));
    Frame { middle, axes, cell, size: [pixels(width), pixels(height)], half_depth }
}

/// How alike a pattern and a part of a picture are, -1..=1: the correlation of their colours after the mean of each is
/// taken off, so that shade does not matter. `at` is the part's first pixel.
pub(super) fn likeness(pattern: &Picture, picture: &Picture, at: [usize; 2]) -> f32 {
    let (mut all, mut sum) = (0.0, 0.0);
    let (mut mean_p, mut mean_q) = (Vec3::ZERO, Vec3::ZERO);
    let (mut pp, mut pq, mut qq) = (0.0, 0.0, 0.0);
    for y in 0..pattern.size[1] {
        let row = &picture.pixels[(at[1] + y) * picture.size[0] + at[0]..];
        for (p, q) in pattern.pixels[y * pattern.size[0]..][..pattern.size[0]].iter().zip(row) {
            all += p.weight;
            let weight = p.weight * q.weight;
            sum += weight;
            mean_p += weight * p.color;
            mean_q += weight * q.color;
            pp += weight * p.color.length_squared();
            pq += weight * p.color.dot(q.color);
            qq += weight * q.color.length_squared();
        }
    }
    if sum <= MOSTLY_THERE * all {
        return -1.0;
    }
    let (of_p, of_q) = (pp - mean_p.length_squared() / sum, qq - mean_q.length_squared() / sum);
    let product = (of_p * of_q).sqrt();
    // One colour all over is like nothing.
    if product > 1e-6 * sum { (pq - mean_p.dot(mean_q) / sum) / product } else { -1.0 }
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
        Pixel { color, depth: 0.0, weight: HALF_VARIANCE / (variance + HALF_VARIANCE) }
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
