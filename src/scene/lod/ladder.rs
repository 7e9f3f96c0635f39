//! Selects the levels of a cloud: the cell sizes, and the Gaussians that are merged.

use std::collections::HashMap;

use glam::DVec3;

use crate::math::sh::widened;
use crate::scene::Gaussians;

/// The finest cells tried are this many octaves below the size of the cloud: about 10^9 cells, more than Gaussians.
const OCTAVES: i32 = 10;
/// Cell sizes per octave. With 1, cells are on average 0.7 times as wide as allowed, and far fewer splats are saved
/// (2,300 instead of 9,000 on `orchard` at 27 m and an error of 2 pixels). More than 1 / `FADE_OCTAVES` (4) would let a
/// third level overlap a cross-fade.
const STEPS: i32 = 2;
/// A level keeps at most this part of the previous level's Gaussians; otherwise it is not worth its memory and
/// cross-fade.
const MOST_KEPT: f64 = 0.7;
/// Levels of fewer Gaussians save no measurable time: a work-group is not full.
const FEWEST: usize = 16;

/// One level of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rung {
    /// Side of its grid cells, units of the cloud.
    pub(super) cell: f32,
    /// The Gaussians merged into each new one, by index in the cloud; ordered by the first of each, which ascends.
    pub(super) members: Vec<Vec<u32>>,
}

/// The levels of a cloud, the finest first, without the cloud itself.
pub(super) fn ladder(cloud: &Gaussians) -> Vec<Rung> {
    let mut rungs = Vec::new();
    let size = size_of_cloud(cloud);
    if !(size.is_finite() && size > 0.0) {
        return rungs;
    }
    let top = size.log2().ceil() as i32;
    let mut count = cloud.len();
    for step in STEPS * (top - OCTAVES)..=STEPS * top {
        if count < FEWEST {
            break;
        }
        let cell = (f64::from(step) / f64::from(STEPS)).exp2();
        let members = merged_by(cloud, cell);
        if members.len() as f64 <= MOST_KEPT * count as f64 {
            count = members.len();
            rungs.push(Rung { cell: cell as f32, members });
        }
    }
    rungs
}

/// The longest side of the box around the finite means; negative infinity without any.
fn size_of_cloud(cloud: &Gaussians) -> f64 {
    let finite = cloud.means.iter().map(|&m| widened(m)).filter(|m| m.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)));
    (high - low).max_element()
}

/// The grid cell of a Gaussian, or its own key if it is larger than a cell or not finite.
#[derive(PartialEq, Eq, Hash)]
enum Key {
    Shared([i64; 3]),
    Own(u32),
}

fn merged_by(cloud: &Gaussians, cell: f64) -> Vec<Vec<u32>> {
    let mut places: HashMap<Key, usize> = HashMap::new();
    let mut out: Vec<Vec<u32>> = Vec::new();
    for i in 0..cloud.len() {
        let place = *places.entry(key(cloud, i, cell)).or_insert(out.len());
        match out.get_mut(place) {
            Some(members) => members.push(i as u32),
            None => out.push(vec![i as u32]),
        }
    }
    out
}

fn key(cloud: &Gaussians, i: usize, cell: f64) -> Key {
    let largest = cloud.log_scales[i].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    // A Gaussian larger than a cell is visible by itself, and has few neighbours in its cell anyway.
    if f64::from(largest).exp() > cell || !cloud.is_finite(i) {
        return Key::Own(i as u32);
    }
    Key::Shared((widened(cloud.means[i]) / cell).floor().to_array().map(|v| v as i64))
}
