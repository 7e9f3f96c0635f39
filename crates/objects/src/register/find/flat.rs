//! Parts of walls: searches planes in parallel projection for the colour pattern of the selected object.

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
use instgs_vk::scene::{Camera, ObjectBox};

/// Pixels of the coarse search are larger by this factor.
const COARSER: f64 = 2.0;
/// Positions along the edge of a tile, coarse pixels: about three patterns.
const TILE: usize = 32;
/// Tiles with fewer Gaussians are empty.
const FEWEST: usize = 12;
/// Search radius in square roots of the pattern's area.
const FARTHEST: f64 = 75.0;
/// Least likeness in the coarse search of a position that is refined.
const FIRST_LEAST: f32 = 0.3;
/// Least part of the pattern that must be visible in the coarse search.
const LEAST_THERE: f32 = 0.5;
/// Positions nearer than this, in square roots of the pattern's area, are one.
const SAME_PLACE: f64 = 0.3;
/// Largest number of positions that are refined.
const MOST_CLOSE: usize = 400;
/// Largest shifts in the two rounds of refinement, pixels: first a little more than a coarse pixel, then less.
const SHIFTS: [usize; 2] = [3, 2];
/// Largest turn in one round of refinement, radians (30 degrees): two steps of the coarse search.
const MOST_TURN: f64 = 0.52;
/// Depths give the orientation of a plane; colours hardly do, since 15 degrees narrow a pattern by only 3 %. A position
/// is turned along the depths unless the likeness falls by more than this.
const TURNED: f32 = 0.05;
/// Rounds of averaging the matches to a common pattern.
const ROUNDS: usize = 3;
/// A position with more than this part of its area on a better one is a duplicate.
const TAKEN: f64 = 0.35;
/// Number of progress steps of the search in walls.
pub(super) const STEPS: usize = TURNS + 1;

/// A refined position with its picture and likeness.
struct Candidate {
    pose: Pose,
    patch: Picture,
    score: f32,
}

/// Input of the search in walls.
pub(super) struct Wall<'a> {
    pub selected: &'a Selected,
    /// The whole cloud, local frame of the selected object.
    pub splats: &'a [Splat],
    /// Frame in which the selected object is seen straight on.
    pub frame: &'a Frame,
    pub cameras: &'a [Camera],
}

/// Finds the repetitions of the pattern seen in `wall.frame`.
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
            let reason = format!("its colours match by only {:.0} %", 100.0 * score);
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

/// Refines positions, and compares them with the common pattern of those that match.
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
        // Details that differ between repetitions may have misled the first refinement.
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

/// Indices of the candidates that do not overlap the selected object or a better one, best first.
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

/// The part of a frame's area that it shares with another frame in about the same plane, 0..=1.
fn overlap(frame: &Frame, other: &Frame) -> f64 {
    let away = frame.axes.transpose() * (other.middle - frame.middle);
    let [width, height] = frame.extent();
    let part = |off: f64, of: f64| (1.0 - off.abs() / of).max(0.0);
    if away.z.abs() < 0.5 * width.min(height) { part(away.x, width) * part(away.y, height) } else { 0.0 }
}

/// Positions with roughly the same pattern, best first.
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

/// Positions for one rotation and scale: on planes half a layer apart, tile by tile.
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

/// Positions in a tile with a higher likeness than all eight neighbours.
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

/// Refines a position: shifts it to the highest likeness, then moves and turns it to the depths there.
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
        // Sub-pixel position from the vertex of a parabola.
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

/// How much nearer to the viewer a picture is than the pattern on average, scene units, and how much that grows per
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

/// Square root of a frame's area, scene units.
fn root(frame: &Frame) -> f64 {
    let [width, height] = frame.extent();
    (width * height).sqrt()
}

/// Summed-area table of a picture's weights.
struct Sums {
    width: usize,
    /// Sum of the weights below and left of each corner.
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
