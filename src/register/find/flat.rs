//! Parts of walls: every place on every plane is looked at straight on, and what has the same pattern of colours is found.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::iter;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::decide::free_id;
use super::pattern::{SAME_DEPTH, common, likeness};
use super::picture::{Frame, Picture, Splat};
use super::refine::{LevelPoints, agreement};
use super::search::{Place, TURNS, distinct, scales};
use super::select::Selected;
use super::{FindError, FindOptions, Found, FoundObject, RejectedPlace, Steps, moved_box, world_map};
use crate::register::pose::Pose;
use crate::scene::{Camera, ObjectBox};

/// Pixels of the first look are so many times larger.
const COARSER: f64 = 2.0;
/// Places of a tile along its edge, pixels of the first look: about three patterns.
const TILE: usize = 32;
/// Tiles with fewer Gaussians show nothing.
const FEWEST: usize = 12;
/// Farther away than so many roots of the pattern's area nothing is looked at.
const FARTHEST: f64 = 75.0;
/// Places that the first look finds less alike than this are not looked at closely. True ones had at least 0.41.
const FIRST_LEAST: f32 = 0.3;
/// Where less than this part of the pattern is there the first look does not compare. True places had at least 0.8.
const LEAST_THERE: f32 = 0.5;
/// Places nearer than this part of the pattern's root are one, and so many are looked at closely.
const SAME_PLACE: f64 = 0.3;
const MOST_CLOSE: usize = 400;
/// How far a closer look may move a place, pixels: as far as the first look is coarse, and some more; then less.
const SHIFTS: [usize; 2] = [3, 2];
/// A look turns a place by at most this, radians (30 degrees): two steps of the first one.
const MOST_TURN: f64 = 0.52;
/// Depths say how a place is turned; colours hardly do, since 15 degrees narrow a pattern by 3 %: a place is turned along
/// what is there unless the colours agree less by more than this.
const TURNED: f32 = 0.05;
/// How often what is alike says anew what they have in common.
const ROUNDS: usize = 3;
/// A place of whose area more than this part is that of a better one is the same.
const TAKEN: f64 = 0.35;
/// Steps that the caller is told of.
pub(super) const STEPS: usize = TURNS + 1;

/// A place looked at closely.
struct Candidate {
    pose: Pose,
    patch: Picture,
    score: f32,
}

/// What is looked for, and where.
pub(super) struct Wall<'a> {
    pub selected: &'a Selected,
    /// The whole cloud, local frame.
    pub splats: &'a [Splat],
    /// From where the selected object is seen straight on.
    pub frame: &'a Frame,
    pub cameras: &'a [Camera],
}

/// Finds what has the pattern that is seen in the frame.
pub(super) fn found(
    wall: &Wall<'_>,
    object: &ObjectBox,
    options: &FindOptions,
    steps: &mut Steps<'_, '_>,
) -> Result<Found, FindError> {
    let Wall { selected, frame, .. } = *wall;
    let candidates = compared(wall, &places(wall, options, steps)?, options);
    steps.advance()?;
    let origin = selected.surface.centroid;
    let (mut objects, mut rejected) = (Vec::new(), Vec::new());
    for candidate in distinct_candidates(&candidates, frame).into_iter().map(|i| &candidates[i]) {
        let moved = moved_box(object, &candidate.pose, origin, free_id(object.id, objects.len()));
        let score = f64::from(candidate.score.max(0.0));
        if !is_alike(candidate, options) {
            let reason = format!("the colours agree by {:.0} %", 100.0 * score);
            rejected.push(RejectedPlace { center: moved.center, score, reason });
            continue;
        }
        let level = LevelPoints::finest(selected);
        let there = agreement(selected, level, &candidate.pose);
        objects.push(FoundObject {
            object: moved,
            world_from_selected: world_map(&candidate.pose, origin),
            inliers: there.inliers,
            explained: there.explained,
            rmse: there.rmse,
            score,
        });
    }
    let (gaussians, on_support) = (selected.surface.gaussians, selected.support.is_some());
    Ok(Found { objects, rejected, gaussians, on_support, in_wall: true, up: selected.up })
}

/// The places looked at closely, and compared with what those that are alike have in common.
fn compared(wall: &Wall<'_>, places: &[Place], options: &FindOptions) -> Vec<Candidate> {
    let own = Picture::new(wall.splats.iter(), wall.frame);
    let same_depth = (SAME_DEPTH * root(wall.frame)) as f32;
    let mut candidates: Vec<Candidate> = places.par_iter().map(|place| looked_at(wall, &own, place.pose)).collect();
    for _ in 0..ROUNDS {
        let mut alike = distinct_candidates(&candidates, wall.frame);
        alike.retain(|i| is_alike(&candidates[*i], options));
        let patches = alike.iter().map(|i| &candidates[*i].patch);
        let pattern = common(&iter::once(&own).chain(patches).collect::<Vec<_>>());
        candidates.iter_mut().for_each(|c| c.score = likeness(&pattern, &c.patch, [0, 0], same_depth));
        // What differs from one to the next may have misled the first look.
        let again: Vec<Candidate> = alike.par_iter().map(|i| looked_at(wall, &pattern, candidates[*i].pose)).collect();
        for (i, candidate) in alike.into_iter().zip(again) {
            if candidate.score + TURNED > candidates[i].score {
                candidates[i] = candidate;
            }
        }
    }
    candidates
}

fn is_alike(candidate: &Candidate, options: &FindOptions) -> bool {
    f64::from(candidate.score) >= options.min_likeness
}

/// The candidates that are not where the selected object or a better one is, best first.
fn distinct_candidates(candidates: &[Candidate], frame: &Frame) -> Vec<usize> {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| candidates[b].score.total_cmp(&candidates[a].score));
    let mut taken = vec![*frame];
    let mut out = Vec::new();
    for i in order {
        let there = frame.moved(&candidates[i].pose);
        if !taken.iter().any(|other| overlap(other, &there) > TAKEN) {
            taken.push(there);
            out.push(i);
        }
    }
    out
}

/// The part of a frame's area that another one has in common with it, if they are about in one plane.
fn overlap(frame: &Frame, other: &Frame) -> f64 {
    let away = frame.axes.transpose() * (other.middle - frame.middle);
    let [width, height] = frame.extent();
    let part = |off: f64, of: f64| (1.0 - off.abs() / of).max(0.0);
    if away.z.abs() < 0.5 * width.min(height) { part(away.x, width) * part(away.y, height) } else { 0.0 }
}

/// Places whose pattern is roughly like it, best first.
fn places(wall: &Wall<'_>, options: &FindOptions, steps: &mut Steps<'_, '_>) -> Result<Vec<Place>, FindError> {
    let Wall { selected, splats, frame, cameras } = *wall;
    let eyes: Vec<DVec3> = cameras.iter().map(|c| c.position_world() - selected.surface.centroid).collect();
    let size = frame.size.map(|pixels| (pixels as f64 / COARSER).round() as usize);
    let coarse = Frame { cell: frame.cell * COARSER, size, ..*frame };
    let pattern = Picture::new(splats.iter(), &coarse);
    let mut all = Vec::new();
    for turn in 0..TURNS {
        let rotation = DMat3::from_axis_angle(selected.up, TAU * turn as f64 / TURNS as f64);
        for scale in scales(options.min_scale) {
            let pose = Pose { rotation, scale, translation: DVec3::ZERO };
            all.extend(of_turn(splats, &pattern, &coarse, &eyes, &pose));
        }
        steps.advance()?;
    }
    Ok(distinct(all, SAME_PLACE * root(frame), MOST_CLOSE))
}

/// Those of one turn and size: on planes half a layer apart, tile by tile.
fn of_turn(splats: &[Splat], pattern: &Picture, frame: &Frame, eyes: &[DVec3], turn: &Pose) -> Vec<Place> {
    let turned = frame.moved(turn);
    let edge = TILE as f64 * turned.cell;
    let [width, height] = turned.extent();
    let far = FARTHEST * root(&turned);
    let mut tiles: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
    for (i, splat) in splats.iter().enumerate().filter(|(_, s)| s.mean.length() < far) {
        let p = turned.axes.transpose() * splat.mean;
        let span = |at: f64, reach: f64| ((at - reach) / edge).floor() as i32..=((at + reach) / edge).floor() as i32;
        let layers = [-1.0, 1.0].map(|side| p.z / turned.half_depth + side);
        for z in layers[0].ceil() as i32..=layers[1].floor() as i32 {
            for y in span(p.y, splat.reach + 0.5 * height) {
                span(p.x, splat.reach + 0.5 * width).for_each(|x| tiles.entry([x, y, z]).or_default().push(i as u32));
            }
        }
    }
    let of_tile = |(tile, inside): (&[i32; 3], &Vec<u32>)| {
        let corner =
            DVec3::new(f64::from(tile[0]) * edge, f64::from(tile[1]) * edge, f64::from(tile[2]) * turned.half_depth);
        let middle = turned.axes * (corner + 0.5 * edge * (DVec3::X + DVec3::Y));
        let is_seen = eyes.is_empty() || eyes.iter().any(|eye| turned.axes.z_axis.dot(*eye - middle) > 0.0);
        if inside.len() < FEWEST || !is_seen {
            return Vec::new();
        }
        let there = Frame { middle, size: turned.size.map(|pixels| pixels + TILE), ..turned };
        let picture = Picture::new(inside.iter().map(|i| &splats[*i as usize]), &there);
        let place = |([x, y], score): ([usize; 2], f32)| {
            let at = turned.axes * (corner + turned.cell * DVec3::new(x as f64, y as f64, 0.0));
            let translation = at - turn.rotation * frame.middle * turn.scale;
            Place { pose: Pose { translation, ..*turn }, score: f64::from(score) }
        };
        peaks(pattern, &picture).into_iter().map(place).collect::<Vec<_>>()
    };
    tiles.par_iter().flat_map_iter(of_tile).collect()
}

/// Where in a tile the pattern agrees better than one pixel aside.
fn peaks(pattern: &Picture, picture: &Picture) -> Vec<([usize; 2], f32)> {
    let there = Sums::new(picture);
    let least = LEAST_THERE * (pattern.pixels.len() as f32);
    let at = |i: usize| [i % TILE, i / TILE];
    let score = |i: usize| {
        let is_there = there.of(at(i), pattern.size) > least;
        if is_there { likeness(pattern, picture, at(i), f32::INFINITY) } else { 0.0 }
    };
    let score: Vec<f32> = (0..TILE * TILE).map(score).collect();
    let is_peak = |i: usize| {
        let near = |a: usize| a.saturating_sub(1)..(a + 2).min(TILE);
        let around = near(i / TILE).flat_map(|y| near(i % TILE).map(move |x| y * TILE + x));
        score[i] > FIRST_LEAST && around.into_iter().all(|k| score[k] <= score[i])
    };
    (0..TILE * TILE).filter(|i| is_peak(*i)).map(|i| (at(i), score[i])).collect()
}

/// Looks closely: moves a place to where the pattern agrees best, to the depth of what is there and along it.
fn looked_at(wall: &Wall<'_>, own: &Picture, pose: Pose) -> Candidate {
    let Wall { selected, splats, frame, .. } = *wall;
    let first = frame.moved(&pose).wider(SHIFTS[0]);
    let reach = first.extent()[0].hypot(first.extent()[1]) + first.half_depth;
    let near: Vec<&Splat> = splats.iter().filter(|s| s.mean.distance(first.middle) < reach + s.reach).collect();
    let candidate = |pose: Pose| {
        let mut patch = Picture::new(near.iter().copied(), &frame.moved(&pose));
        patch.pixels.iter_mut().for_each(|p| p.depth /= pose.scale as f32);
        let score = likeness(own, &patch, [0, 0], (SAME_DEPTH * root(frame)) as f32);
        Candidate { pose, patch, score }
    };
    let shifted = |mut pose: Pose, most: usize| {
        let wide = frame.moved(&pose).wider(most);
        let picture = Picture::new(near.iter().copied(), &wide);
        let shifts = (0..=2 * most).flat_map(|y| (0..=2 * most).map(move |x| [x, y]));
        let like = |at: [usize; 2]| likeness(own, &picture, at, f32::INFINITY);
        let all = shifts.map(|at| (at, like(at)));
        let (at, best) = all.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(([most; 2], 0.0));
        // Parts of a pixel: the top of a parabola.
        let part = |k: usize| {
            let beside = |by: usize| like(std::array::from_fn(|j| if j == k { at[j] + by - 1 } else { at[j] }));
            if at[k] == 0 || at[k] == 2 * most {
                return 0.0;
            }
            let (low, high) = (beside(0), beside(2));
            let bend = low - 2.0 * best + high;
            if bend < 0.0 { f64::from(0.5 * (low - high) / bend) } else { 0.0 }
        };
        let aside = [0, 1].map(|k| (at[k] as f64 - most as f64 + part(k)) * wide.cell);
        let (nearer, slope) = depths(own, &picture.part(at, frame.size), pose.scale);
        pose.translation += wide.axes * DVec3::new(aside[0], aside[1], nearer);
        (pose, (slope / wide.cell).atan())
    };
    let mut pose = pose;
    for most in SHIFTS {
        let (straight, turn) = shifted(pose, most);
        let back = DMat3::from_axis_angle(selected.up, -turn.clamp(-MOST_TURN, MOST_TURN));
        let rotation = back * straight.rotation;
        let translation = straight.apply(frame.middle) - rotation * frame.middle * straight.scale;
        let (turned, _) = shifted(Pose { rotation, translation, ..straight }, most);
        let is_worse = candidate(straight).score > candidate(turned).score + TURNED;
        pose = if is_worse { straight } else { turned };
    }
    candidate(pose)
}

/// How much nearer to who looks a picture is than the pattern on average, scene units, and how much that grows from pixel to
/// pixel to the right.
fn depths(own: &Picture, there: &Picture, scale: f64) -> (f64, f64) {
    let (mut count, mut sum, mut at, mut at_at, mut at_sum) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (i, (p, q)) in own.pixels.iter().zip(&there.pixels).enumerate().filter(|(_, (p, q))| p.weight * q.weight > 0.0)
    {
        let (x, nearer) = ((i % own.size[0]) as f64, f64::from(q.depth) - scale * f64::from(p.depth));
        count += 1.0;
        sum += nearer;
        at += x;
        at_at += x * x;
        at_sum += x * nearer;
    }
    let spread = count * at_at - at * at;
    if spread > 0.0 { (sum / count, (count * at_sum - at * sum) / spread) } else { (0.0, 0.0) }
}

/// The root of a frame's area.
fn root(frame: &Frame) -> f64 {
    let [width, height] = frame.extent();
    (width * height).sqrt()
}

/// Sums of a picture's weights, to have those of any part at once.
struct Sums {
    width: usize,
    /// Of what is below and left of a corner.
    sums: Vec<f32>,
}

impl Sums {
    fn new(picture: &Picture) -> Self {
        let width = picture.size[0] + 1;
        let mut sums = vec![0.0; width * (picture.size[1] + 1)];
        for (i, p) in picture.pixels.iter().enumerate() {
            let k = (i / picture.size[0] + 1) * width + i % picture.size[0] + 1;
            sums[k] = p.weight + sums[k - 1] + sums[k - width] - sums[k - width - 1];
        }
        Self { width, sums }
    }

    fn of(&self, [x, y]: [usize; 2], size: [usize; 2]) -> f32 {
        let corner = |x: usize, y: usize| self.sums[y * self.width + x];
        corner(x + size[0], y + size[1]) + corner(x, y) - corner(x + size[0], y) - corner(x, y + size[1])
    }
}
