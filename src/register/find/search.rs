//! Every turn about the vertical and every place: where would most of the object's points meet something?

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::field::Field;
use super::select::Selected;
use super::{FindError, FindOptions, Steps};
use crate::math::rng::Rng;
use crate::register::pose::Pose;
use crate::register::sample::BASE;
use crate::register::surface::Surface;

/// Turns about the vertical, 15 degrees apart: between two of them the farthest points of an object move by less than
/// the field's neighbouring cells reach.
const TURNS: usize = 24;
/// Sizes are this far apart: half of it moves the farthest points by as much.
const SCALE_STEP: f64 = 1.15;
/// The field's cells, base voxels.
const CELL_VOXELS: f64 = 2.0;
/// Points of the object that are looked up, the first of them before the others, and what they must amount to.
const POINTS: usize = 256;
const FIRST: usize = 32;
const LEAST_FIRST: f32 = 0.35;
const LEAST: f32 = 0.45;
/// Points of the object each of which is laid on each of the scene. A place where two thirds of the object are found is
/// missed once in 700 times.
const ANCHORS: usize = 6;
/// Places nearer than this part of the object's size are one, unless they are turned by more than this, radians (40
/// degrees); of one place so many turns are kept.
const SAME_PLACE: f64 = 0.12;
const SAME_TURN: f64 = 0.7;
const TURNS_PER_PLACE: usize = 3;
/// Places that are judged both ways, and that are kept then.
const MOST_JUDGED: usize = 3000;
const MOST_KEPT: usize = 240;
/// Steps that the caller is told of.
pub(super) const STEPS: usize = TURNS + 1;
/// Sub-stream of the seed ("find" in ASCII).
const STREAM: u64 = 0x6669_6e64;

/// Where the object may be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// From the object to the scene, local frame.
    pub pose: Pose,
    /// Agreement, 0..=1.
    pub score: f64,
}

/// The places, best first; the selected object's own is among them.
pub(super) fn places(
    selected: &Selected,
    options: &FindOptions,
    steps: &mut Steps<'_, '_>,
) -> Result<Vec<Place>, FindError> {
    let surface = &selected.surface;
    let cell = CELL_VOXELS * surface.voxel();
    let scene = Surface::new(&selected.scene.samples(), cell).positions;
    let field = Field::new(&scene, cell);
    let mut points = surface.levels[BASE - 1].positions.clone();
    Rng::new(options.surfaces.seed).fork(STREAM).shuffle(&mut points);
    points.truncate(POINTS);
    let mut found = Vec::new();
    for turn in 0..TURNS {
        let rotation = DMat3::from_axis_angle(selected.up, TAU * turn as f64 / TURNS as f64);
        for scale in scales(options.min_scale) {
            found.extend(of_turn(&field, &scene, &points, (rotation, scale)));
        }
        steps.advance()?;
    }
    let same = SAME_PLACE * surface.size;
    let judged = judged(selected, &scene, distinct(found, same, MOST_JUDGED));
    steps.advance()?;
    Ok(distinct(judged, same, MOST_KEPT))
}

/// Sizes that are tried.
fn scales(least: f64) -> impl Iterator<Item = f64> {
    let steps = (least.ln().abs() / SCALE_STEP.ln()).round() as i32;
    (-steps..=steps).map(|k| SCALE_STEP.powi(k))
}

/// The best place of every few cells, for one turn and size.
fn of_turn(field: &Field, scene: &[DVec3], points: &[DVec3], (rotation, scale): (DMat3, f64)) -> Vec<Place> {
    let turned: Vec<DVec3> = points.iter().map(|p| rotation * *p * scale).collect();
    let anchors = &turned[..ANCHORS.min(turned.len())];
    let place = |translation: DVec3| {
        let sum = |points: &[DVec3]| points.iter().map(|p| field.at(*p + translation)).sum::<f32>();
        let (first, others) = turned.split_at(FIRST.min(turned.len()));
        let of_first = sum(first);
        if of_first < LEAST_FIRST * first.len() as f32 {
            return None;
        }
        let score = (of_first + sum(others)) / turned.len() as f32;
        let pose = Pose { rotation, scale, translation };
        (score >= LEAST).then_some(Place { pose, score: f64::from(score) })
    };
    let all: Vec<Place> =
        scene.par_iter().flat_map_iter(|q| anchors.iter().filter_map(move |anchor| place(*q - *anchor))).collect();
    let mut best: BTreeMap<[i64; 3], Place> = BTreeMap::new();
    for new in all {
        let key = (new.pose.translation / (2.0 * field.cell())).round().to_array().map(|c| c as i64);
        let old = best.entry(key).or_insert(new);
        if new.score > old.score {
            *old = new;
        }
    }
    best.into_values().collect()
}

/// The best, without those that are like a better one.
pub(super) fn distinct(mut all: Vec<Place>, same: f64, most: usize) -> Vec<Place> {
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut out: Vec<Place> = Vec::new();
    for new in all {
        let near = |old: &&Place| old.pose.translation.distance(new.pose.translation) < same;
        let (mut like, mut turns) = (false, 0);
        for old in out.iter().filter(near) {
            turns += 1;
            like |= old.pose.angle_to(&new.pose) < SAME_TURN;
        }
        if !like && turns < TURNS_PER_PLACE {
            out.push(new);
            if out.len() == most {
                break;
            }
        }
    }
    out
}

/// Places with both sides in their score: what of the object is found, times what of the scene in its box is the object.
fn judged(selected: &Selected, scene: &[DVec3], places: Vec<Place>) -> Vec<Place> {
    let surface = &selected.surface;
    let own = Field::new(&surface.levels[BASE].positions, CELL_VOXELS * surface.voxel());
    let reach = 0.5 * selected.object_box.size.length();
    let judge = |place: Place| {
        let pose = place.pose;
        let middle = pose.apply(selected.object_box.center);
        let near = scene.iter().filter(|q| q.distance_squared(middle) < (reach * pose.scale).powi(2));
        let inside: Vec<DVec3> = near.map(|q| pose.apply_inverse(*q)).filter(|p| selected.holds(*p)).collect();
        let explained = inside.iter().map(|p| f64::from(own.at(*p))).sum::<f64>() / inside.len().max(1) as f64;
        Place { score: place.score * explained, ..place }
    };
    places.into_par_iter().map(judge).collect()
}
