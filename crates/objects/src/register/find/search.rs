//! Exhaustive search over rotations about the up axis and translations for poses that put the object on occupied cells.

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::TAU;

use glam::{DMat3, DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::field::Field;
use super::select::Selected;
use super::{FindError, FindOptions, Steps};
use crate::register::pose::Pose;
use crate::register::sample::BASE;
use crate::register::surface::Surface;
use instgs_vk::math::rng::Rng;

/// Number of rotations about the up axis, 15 degrees apart: half a step moves the farthest points of an object by less
/// than a neighbouring cell reaches.
pub(super) const TURNS: usize = 24;
/// Ratio of successive sizes: half a step moves the farthest points by as much.
const SCALE_STEP: f64 = 1.15;
/// Edge of the occupancy grid's cells, base voxels.
const CELL_VOXELS: f64 = 3.0;
/// Early termination: after this many points of the object the mean occupancy must be at least this; most poses end
/// after the first few points.
const LOOKED_UP: [(usize, f32); 3] = [(10, 0.3), (32, 0.45), (200, 0.5)];
/// Points of the object, each of which is put on each point of the scene. A pose at which two thirds of the object are
/// present is missed once in 80 times, not counting its neighbours.
const ANCHORS: usize = 4;
/// Candidates nearer than this part of the object's size are one place.
const SAME_PLACE: f64 = 0.12;
/// Two candidates at one place are one if their rotations differ by less than this, radians (40 degrees).
const SAME_TURN: f64 = 0.7;
/// Largest number of candidates at one place.
const TURNS_PER_PLACE: usize = 3;
/// Largest number of candidates that are compared in both directions, per size.
const MOST_JUDGED: usize = 3000;
/// Largest number of candidates that go on to refinement.
const MOST_KEPT: usize = 240;
/// Number of progress steps of the search.
pub(super) const STEPS: usize = TURNS + 1;
/// Stream of the random order of points ("find" in ASCII), derived from the seed.
const STREAM: u64 = 0x6669_6e64;

/// A candidate pose of a repetition.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Maps the object to the scene, local frame of the selected object.
    pub pose: Pose,
    /// Agreement of object and scene, 0..=1.
    pub score: f64,
}

/// The best candidates, best first; the selected object itself is among them.
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
    let scales: Vec<f64> = scales(options.min_scale).collect();
    let mut found = vec![Vec::new(); scales.len()];
    for turn in 0..TURNS {
        let rotation = DMat3::from_axis_angle(selected.up, TAU * turn as f64 / TURNS as f64);
        for (found, scale) in found.iter_mut().zip(&scales) {
            found.extend(of_turn(&field, &scene, &points, rotation, *scale));
        }
        steps.advance()?;
    }
    // Size by size: small sizes fit everywhere, which only the reverse comparison reveals.
    let same = SAME_PLACE * surface.size;
    let of_scale = |all: Vec<Place>| judged(selected, &scene, distinct(all, same, MOST_JUDGED));
    let judged = found.into_iter().flat_map(of_scale).collect();
    steps.advance()?;
    Ok(distinct(judged, same, MOST_KEPT))
}

/// Sizes that are tried, relative to the selected object.
pub(super) fn scales(least: f64) -> impl Iterator<Item = f64> {
    let steps = (least.ln().abs() / SCALE_STEP.ln()).round() as i32;
    (-steps..=steps).map(|k| SCALE_STEP.powi(k))
}

/// The best candidate in each cell of translations, for one rotation and size.
fn of_turn(field: &Field, scene: &[DVec3], points: &[DVec3], rotation: DMat3, scale: f64) -> Vec<Place> {
    let looked_up = points.iter().take(LOOKED_UP[LOOKED_UP.len() - 1].0);
    let turned: Vec<DVec3> = looked_up.map(|p| rotation * *p * scale).collect();
    let cells: Vec<Vec3> = turned.iter().map(|p| (*p / field.cell()).as_vec3()).collect();
    let place = |translation: DVec3| {
        let score = f64::from(average(field, &cells, field.in_cells(translation))?);
        Some(Place { pose: Pose { rotation, scale, translation }, score })
    };
    let anchors = &turned[..ANCHORS.min(turned.len())];
    let of_point = |q: &DVec3| -> Vec<Place> { anchors.iter().filter_map(|anchor| place(*q - *anchor)).collect() };
    let all: Vec<Place> = scene.par_iter().flat_map_iter(of_point).collect();
    let mut best: BTreeMap<[i64; 3], Place> = BTreeMap::new();
    for new in all {
        let key = (new.pose.translation / field.cell()).round().to_array().map(|c| c as i64);
        let old = best.entry(key).or_insert(new);
        if new.score > old.score {
            *old = new;
        }
    }
    best.into_values().collect()
}

/// Mean occupancy at the points after a shift, all in cells; `None` as soon as it is too low.
fn average(field: &Field, points: &[Vec3], shift: Vec3) -> Option<f32> {
    let (mut sum, mut count) = (0.0, 0);
    for (end, least) in LOOKED_UP {
        let end = end.min(points.len());
        sum += points[count..end].iter().map(|p| field.at(*p + shift)).sum::<f32>();
        count = end;
        if sum < least * count as f32 {
            return None;
        }
    }
    Some(sum / count as f32)
}

/// The best `most` candidates, without those that repeat a better one.
pub(super) fn distinct(mut all: Vec<Place>, same: f64, most: usize) -> Vec<Place> {
    all.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut out: Vec<Place> = Vec::new();
    let mut kept: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for new in all {
        let cell = (new.pose.translation / same).floor().as_ivec3();
        let around = (0..27).filter_map(|k| kept.get(&(cell + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1)));
        let (mut like, mut turns) = (false, 0);
        for old in around.flatten().map(|i| &out[*i].pose) {
            if old.translation.distance(new.pose.translation) < same {
                turns += 1;
                like |= old.angle_to(&new.pose) < SAME_TURN;
            }
        }
        if !like && turns < TURNS_PER_PLACE {
            kept.entry(cell).or_default().push(out.len());
            out.push(new);
            if out.len() == most {
                break;
            }
        }
    }
    out
}

/// Candidates with both directions in their score: the part of the object that is found, times the part of the points
/// in its box that the object explains.
fn judged(selected: &Selected, scene: &[DVec3], places: Vec<Place>) -> Vec<Place> {
    let surface = &selected.surface;
    let own = Field::new(&surface.levels[BASE].positions, CELL_VOXELS * surface.voxel());
    let reach = 0.5 * selected.domain.size.length();
    let judge = |place: Place| {
        let pose = place.pose;
        let middle = pose.apply(selected.domain.center);
        let near = scene.iter().filter(|q| q.distance_squared(middle) < (reach * pose.scale).powi(2));
        let inside: Vec<DVec3> = near.map(|q| pose.apply_inverse(*q)).filter(|p| selected.holds(*p)).collect();
        let explained = inside.iter().map(|p| f64::from(own.at(own.in_cells(*p)))).sum::<f64>();
        Place { score: place.score * explained / inside.len().max(1) as f64, ..place }
    };
    places.into_par_iter().map(judge).collect()
}
