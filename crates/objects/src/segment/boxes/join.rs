//! Finds which boxes in different photos show the same object, where they have no ids.
//!
//! Two boxes of one object define a ball: the rays through their centres meet at its centre, and both give it about the
//! same radius. A ball is right if many other views have a box of its size at its place. The balls with most support
//! become objects in order of their score, and each removes its boxes from those after it. The cloud is not needed, and
//! boxes may overlap in the pictures, since their centres and sizes differ.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use glam::DVec3;
use rayon::prelude::*;

use instgs_vk::scene::Camera;

use super::placed::{PlacedBox, PlacedBoxes};

/// Largest distance between the rays of two boxes, as a part of the smaller radius.
const MEETING: f64 = 0.35;
/// Rays at a smaller angle do not locate a ball: the squared sine of 10 degrees.
const LEAST_SQUARED_SINE: f64 = 0.03;
/// Largest ratio of the two radii that a pair of boxes gives: cars are twice as long as wide.
const RADIUS_FACTOR: f64 = 2.0;
/// A ball matches a box if its centre is at most this part of the box's half size from the box's centre: occlusion
/// shifts a box, but at half the size the next box's edge is as near.
const MIDDLE_PART: f64 = 0.45;
/// A box is at least this part of its ball's size: an occluder can hide the rest of the object.
const LEAST_SIZE: f64 = 0.4;
/// Least number of views with a box of an object, since any two boxes define a ball, ...
const MIN_VIEWS: usize = 3;
/// ... and their least part of the views with the ball's centre in their picture. Balls by chance reach a seventh.
const MIN_VIEW_PART: f64 = 0.3;
/// A ball whose centre is nearer to an object's centre than this part of the object's radius is that object again, from
/// boxes cut by occluders. A vase on a table is farther from the table's centre.
const SAME_PLACE: f64 = 0.5;
/// Balls tried at most, evenly sampled: a thousand objects with twenty balls each.
const MAX_BALLS: usize = 20_000;
/// Pairs of boxes tried at most, evenly sampled.
const MAX_PAIRS: usize = 2_000_000;
/// Scores are integers in this unit, so that their order is exact.
const SCORE_ONE: f64 = 1e6;

/// Result of joining boxes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Joined {
    /// Number of objects; their ids start at the first free one.
    pub(super) objects: usize,
    /// Boxes that belong to no object.
    pub(super) left: usize,
}

/// Gives boxes without an object ids from `first_id` on, one per object found. Boxes of different categories belong to
/// different objects, and an object has at most one box per view. Ids beyond 65535 are left at 0; the caller checks
/// [`Joined::objects`].
pub(super) fn join(placed: &mut PlacedBoxes, first_id: u32) -> Joined {
    let mut by_category: BTreeMap<Option<String>, Vec<Sighting>> = BTreeMap::new();
    for (view, (camera, boxes)) in placed.cameras.iter().zip(&placed.by_view).enumerate() {
        for (rank, found) in boxes.iter().enumerate().filter(|(_, b)| b.object == 0) {
            by_category.entry(found.category.clone()).or_default().push(Sighting::new([view, rank], camera, found));
        }
    }
    let mut out = Joined::default();
    for sightings in by_category.values() {
        let objects = objects_of(sightings, &placed.cameras);
        out.left += sightings.len() - objects.iter().map(Vec::len).sum::<usize>();
        for boxes in objects {
            let id = u16::try_from(first_id as usize + out.objects).unwrap_or(0);
            out.objects += 1;
            for i in boxes {
                let [view, rank] = sightings[i].place;
                placed.by_view[view][rank].object = id;
            }
        }
    }
    out
}

/// A box as a ray through its centre.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    /// Index of the view, and of the box in the view's list.
    place: [usize; 2],
    middle_px: [f64; 2],
    half_px: [f64; 2],
    /// Half of the longer edge over the focal length: the radius at depth 1.
    radius: f64,
    /// Position of the camera, world frame.
    eye: DVec3,
    /// Direction through the box's centre, a unit vector of the world.
    ray: DVec3,
    /// Whether the picture's border cuts the box, so that its centre is wrong.
    is_cut: bool,
}

impl Sighting {
    fn new(place: [usize; 2], camera: &Camera, found: &PlacedBox) -> Self {
        let [left, top, right, bottom] = found.bounds_px;
        let middle_px = [0.5 * (left + right), 0.5 * (top + bottom)];
        let half_px = [0.5 * (right - left), 0.5 * (bottom - top)];
        let direction = DVec3::new((middle_px[0] - camera.cx) / camera.fx, (middle_px[1] - camera.cy) / camera.fy, 1.0);
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        Self {
            place,
            middle_px,
            half_px,
            radius: (half_px[0] / camera.fx).max(half_px[1] / camera.fy),
            eye: camera.position_world(),
            ray: (camera.rotation().transpose() * direction).normalize_or_zero(),
            is_cut: left < 1.0 || top < 1.0 || right > width - 1.0 || bottom > height - 1.0,
        }
    }

    /// Distance of the ball's centre from the box's, relative to the half size; `None` if ball and box do not match.
    fn misfit(&self, ball: &Ball, camera: &Camera) -> Option<f64> {
        let [x, y] = camera.pixel_of(ball.middle)?;
        let off =
            ((x - self.middle_px[0]) / self.half_px[0]).abs().max(((y - self.middle_px[1]) / self.half_px[1]).abs());
        let size = self.radius * camera.view_from_point(ball.middle).z / ball.radius;
        (off < MIDDLE_PART && (LEAST_SIZE..RADIUS_FACTOR).contains(&size)).then_some(off)
    }
}

/// A place where an object may be: centre and radius in world units.
#[derive(Clone, Copy, Debug)]
struct Ball {
    middle: DVec3,
    radius: f64,
}

/// The ball of two boxes of different views, if they define one.
fn ball_of([a, b]: [&Sighting; 2], cameras: &[Camera]) -> Option<Ball> {
    if a.place[0] == b.place[0] || a.is_cut || b.is_cut {
        return None;
    }
    let (between, cosine) = (a.eye - b.eye, a.ray.dot(b.ray));
    let squared_sine = 1.0 - cosine * cosine;
    let (along_a, along_b) = (a.ray.dot(between), b.ray.dot(between));
    let [s, t] = [cosine * along_b - along_a, along_b - cosine * along_a].map(|v| v / squared_sine);
    // Parallel rays give NaN, which fails the comparison.
    if !(squared_sine > LEAST_SQUARED_SINE && s > 0.0 && t > 0.0) {
        return None;
    }
    let (p, q) = (a.eye + a.ray * s, b.eye + b.ray * t);
    let middle = 0.5 * (p + q);
    let [radius_a, radius_b] = [a, b].map(|of| of.radius * cameras[of.place[0]].view_from_point(middle).z);
    let (least, most) = (radius_a.min(radius_b), radius_a.max(radius_b));
    let meets = least > 0.0 && most < RADIUS_FACTOR * least && (p - q).length() < MEETING * least;
    meets.then_some(Ball { middle, radius: 0.5 * (radius_a + radius_b) })
}

/// Balls of all pairs of boxes, evenly sampled down to [`MAX_BALLS`].
fn balls(sightings: &[Sighting], cameras: &[Camera]) -> Vec<Ball> {
    let count = sightings.len();
    let stride = (count * count.saturating_sub(1) / 2).div_ceil(MAX_PAIRS).max(1);
    let of_first = |i: usize| {
        // The start differs from box to box, so that no partner is always skipped.
        let partners = (i + 1 + i % stride..count).step_by(stride);
        partners.filter_map(|j| ball_of([&sightings[i], &sightings[j]], cameras)).collect::<Vec<Ball>>()
    };
    let all: Vec<Ball> = (0..count).into_par_iter().flat_map_iter(of_first).collect();
    let stride = all.len().div_ceil(MAX_BALLS).max(1);
    all.into_iter().step_by(stride).collect()
}

/// The best box around a ball in each view: view index to (misfit, box index).
type Around = BTreeMap<usize, (f64, usize)>;

/// Boxes, and which of them are still without an object.
struct Joining<'a> {
    sightings: &'a [Sighting],
    cameras: &'a [Camera],
    /// Views with a box, ascending.
    views: Vec<usize>,
    /// By box: false once an object has it.
    is_free: Vec<bool>,
}

impl<'a> Joining<'a> {
    fn new(sightings: &'a [Sighting], cameras: &'a [Camera]) -> Self {
        let mut views: Vec<usize> = sightings.iter().map(|s| s.place[0]).collect();
        views.dedup();
        Self { sightings, cameras, views, is_free: vec![true; sightings.len()] }
    }

    /// Free boxes around a ball, the best one of each view.
    fn around(&self, ball: &Ball) -> Around {
        let mut best = Around::new();
        for (i, sighting) in self.sightings.iter().enumerate().filter(|(i, _)| self.is_free[*i]) {
            let Some(misfit) = sighting.misfit(ball, &self.cameras[sighting.place[0]]) else { continue };
            let entry = best.entry(sighting.place[0]).or_insert((misfit, i));
            *entry = if misfit < entry.0 { (misfit, i) } else { *entry };
        }
        best
    }

    /// Whether enough of the views that should show a ball have a box around it.
    fn are_enough(&self, around: &Around, ball: &Ball) -> bool {
        let has_place = |view: &&usize| {
            let camera = &self.cameras[**view];
            camera.pixel_of(ball.middle).is_some_and(|at| camera.has_pixel(at))
        };
        around.len() as f64 >= MIN_VIEW_PART * self.views.iter().filter(has_place).count() as f64
    }

    /// Assigns boxes to an object and returns their indices.
    fn take(&mut self, around: &Around) -> Vec<usize> {
        let own: Vec<usize> = around.values().map(|&(_, i)| i).collect();
        own.iter().for_each(|&i| self.is_free[i] = false);
        own
    }
}

/// Score of a ball: the sum over its boxes of 1 - misfit, in units of 1 / [`SCORE_ONE`].
fn score(around: &Around) -> u64 {
    around.values().map(|(misfit, _)| (SCORE_ONE * (1.0 - misfit)) as u64).sum()
}

/// The boxes of every object, as indices; at most one per view.
fn objects_of(sightings: &[Sighting], cameras: &[Camera]) -> Vec<Vec<usize>> {
    let balls = balls(sightings, cameras);
    let mut joining = Joining::new(sightings, cameras);
    let first = (0..balls.len()).into_par_iter().map(|ball| (score(&joining.around(&balls[ball])), Reverse(ball)));
    let mut queue: BinaryHeap<(u64, Reverse<usize>)> = first.collect::<Vec<_>>().into();
    let mut out = Vec::new();
    let mut taken: Vec<Ball> = Vec::new();
    // Scores only fall as boxes are taken, so a popped score that is still valid is the best (lazy evaluation).
    while let Some((known, Reverse(index))) = queue.pop() {
        let ball = balls[index];
        let around = joining.around(&ball);
        let now = score(&around);
        if around.len() < MIN_VIEWS {
            continue;
        }
        if now < known {
            queue.push((now, Reverse(index)));
            continue;
        }
        let is_known = taken.iter().any(|known| known.middle.distance(ball.middle) < SAME_PLACE * known.radius);
        if !is_known && joining.are_enough(&around, &ball) {
            taken.push(ball);
            out.push(joining.take(&around));
        }
    }
    out
}
