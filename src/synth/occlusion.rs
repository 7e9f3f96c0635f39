//! Baked shadows: a voxel grid for a car on itself, and a map of the ground for everything that stands on it.

use std::collections::{HashMap, HashSet};
use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use crate::synth::surface::Surfel;

/// Side of a voxel, metres.
const VOXEL: f64 = 0.07;
/// Rays start this far above the surface, so that it does not shade itself.
const RAY_START: f64 = 0.15;
/// Rays end here, metres.
const RAY_END: f64 = 2.2;

/// Which voxels hold surfels.
pub struct VoxelGrid {
    occupied: HashSet<[i32; 3]>,
}

impl VoxelGrid {
    /// From the positions of surfels.
    pub fn new(positions: impl Iterator<Item = DVec3>) -> Self {
        Self { occupied: positions.map(Self::voxel).collect() }
    }

    fn voxel(p: DVec3) -> [i32; 3] {
        (p / VOXEL).floor().as_ivec3().to_array()
    }

    /// True if nothing lies between the surfel and the far end of a ray along `dir`; false for rays into the ground.
    pub fn sees(&self, from: &Surfel, dir: DVec3) -> bool {
        let start = from.position + from.normal * RAY_START;
        let steps = ((RAY_END - RAY_START) / (0.8 * VOXEL)) as usize;
        (0..steps).all(|i| !self.occupied.contains(&Self::voxel(start + dir * (i as f64 * 0.8 * VOXEL))))
    }

    /// Cosine-weighted share of the upper half space that the surfel sees, 0..=1, among evenly spread directions.
    pub fn openness(&self, from: &Surfel) -> f64 {
        const DIRECTIONS: usize = 48;
        let golden_angle = PI * (3.0 - 5f64.sqrt());
        let (mut seen, mut all) = (0.0, 0.0);
        for i in 0..DIRECTIONS {
            let z = (i as f64 + 0.5) / DIRECTIONS as f64;
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            let dir = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            let weight = (dir.dot(from.normal) + 0.35).max(0.0);
            all += weight;
            if self.sees(from, dir) {
                seen += weight;
            }
        }
        if all > 0.0 { seen / all } else { 0.0 }
    }
}

/// Averages values over neighbouring surfels that face the same way: takes the voxels' steps out of baked light.
pub struct Smoother {
    neighbours: Vec<Vec<u32>>,
}

impl Smoother {
    /// Neighbours are nearer than `radius`.
    pub fn new(surfels: &[Surfel], radius: f64) -> Self {
        let cell = |p: DVec3| (p / radius).floor().as_ivec3().to_array();
        let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (i, s) in surfels.iter().enumerate() {
            cells.entry(cell(s.position)).or_default().push(i as u32);
        }
        let around = |s: &Surfel| {
            let [x, y, z] = cell(s.position);
            let near = (0..27).filter_map(|k| cells.get(&[x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1])).flatten();
            let alike = |i: &&u32| {
                let other = &surfels[**i as usize];
                (other.position - s.position).length() < radius && other.normal.dot(s.normal) > 0.7
            };
            near.filter(alike).copied().collect()
        };
        Self { neighbours: surfels.iter().map(around).collect() }
    }

    /// The mean over each surfel's neighbours, itself included.
    pub fn smoothed(&self, values: &[f64]) -> Vec<f64> {
        let mean = |list: &Vec<u32>| list.iter().map(|&i| values[i as usize]).sum::<f64>() / list.len() as f64;
        self.neighbours.iter().map(mean).collect()
    }
}

/// A grid over the ground with a value per cell, 0 = nothing.
pub struct GroundMap {
    half_size: DVec2,
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl GroundMap {
    /// Side of a cell, metres.
    const CELL: f64 = 0.08;

    /// An empty map of |x| <= half_size.x, |y| <= half_size.y.
    pub fn new(half_size: DVec2) -> Self {
        let count = |half: f64| (2.0 * half / Self::CELL).ceil() as usize;
        let (columns, rows) = (count(half_size.x), count(half_size.y));
        Self { half_size, columns, rows, values: vec![0.0; columns * rows] }
    }

    /// Covers a disc; overlapping discs do not add up.
    pub fn cover(&mut self, centre: DVec2, radius: f64, strength: f32) {
        let low = (centre - radius + self.half_size) / Self::CELL;
        let high = (centre + radius + self.half_size) / Self::CELL;
        let clamp = |v: f64, count: usize| v.clamp(0.0, count as f64) as usize;
        for j in clamp(low.y, self.rows)..clamp(high.y.ceil(), self.rows) {
            for i in clamp(low.x, self.columns)..clamp(high.x.ceil(), self.columns) {
                let cell = DVec2::new(i as f64 + 0.5, j as f64 + 0.5) * Self::CELL - self.half_size;
                if (cell - centre).length() <= radius {
                    let value = &mut self.values[j * self.columns + i];
                    *value = value.max(strength);
                }
            }
        }
    }

    /// The map blurred with three box filters whose standard deviation together is `deviation` metres.
    pub fn blurred(mut self, deviation: f64) -> Self {
        // A box of half width h cells has variance h (h + 1) / 3; three of them have h (h + 1).
        let cells = deviation / Self::CELL;
        let half = ((cells * cells + 0.25).sqrt() - 0.5).round() as usize;
        for _ in 0..3 {
            self.values = box_filter(&self.values, self.columns, half);
            self.values = transposed(&self.values, self.columns);
            self.values = box_filter(&self.values, self.rows, half);
            self.values = transposed(&self.values, self.rows);
        }
        self
    }

    /// The value at a point, bilinear; 0 outside.
    pub fn at(&self, p: DVec2) -> f64 {
        let q = (p + self.half_size) / Self::CELL - 0.5;
        let (base, f) = (q.floor(), q - q.floor());
        let cell = |i: f64, j: f64| {
            let inside = i >= 0.0 && j >= 0.0 && i < self.columns as f64 && j < self.rows as f64;
            if inside { f64::from(self.values[j as usize * self.columns + i as usize]) } else { 0.0 }
        };
        let lower = cell(base.x, base.y) * (1.0 - f.x) + cell(base.x + 1.0, base.y) * f.x;
        let upper = cell(base.x, base.y + 1.0) * (1.0 - f.x) + cell(base.x + 1.0, base.y + 1.0) * f.x;
        lower * (1.0 - f.y) + upper * f.y
    }
}

/// Mean over 2 half + 1 neighbours in every row; beyond the ends counts as 0.
fn box_filter(values: &[f32], columns: usize, half: usize) -> Vec<f32> {
    let weight = 1.0 / (2 * half + 1) as f32;
    let mut out = Vec::with_capacity(values.len());
    for row in values.chunks(columns) {
        for i in 0..columns {
            let window = &row[i.saturating_sub(half)..(i + half + 1).min(columns)];
            out.push(window.iter().sum::<f32>() * weight);
        }
    }
    out
}

fn transposed(values: &[f32], columns: usize) -> Vec<f32> {
    let rows = values.len() / columns;
    (0..values.len()).map(|k| values[(k % rows) * columns + k / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roof_shades_what_is_below_it() {
        let plate = |z: f64| (0..40 * 40).map(move |i| DVec3::new(f64::from(i % 40), f64::from(i / 40), 0.0) * 0.05 + DVec3::Z * z);
        let grid = VoxelGrid::new(plate(1.0));
        let below = Surfel { position: DVec3::new(1.0, 1.0, 0.0), normal: DVec3::Z, spacing: 0.05 };
        let above = Surfel { position: DVec3::new(1.0, 1.0, 1.04), ..below };
        assert!(!grid.sees(&below, DVec3::Z) && grid.sees(&above, DVec3::Z));
        assert!(grid.openness(&below) < 0.7 && grid.openness(&above) == 1.0);
    }

    #[test]
    fn a_blurred_disc_keeps_its_mass_and_fades() {
        let mut map = GroundMap::new(DVec2::splat(5.0));
        map.cover(DVec2::ZERO, 1.0, 1.0);
        let before: f32 = map.values.iter().sum();
        let map = map.blurred(0.4);
        let after: f32 = map.values.iter().sum();
        assert!((before - after).abs() < 0.01 * before);
        let (middle, edge, far) = (map.at(DVec2::ZERO), map.at(DVec2::X), map.at(DVec2::X * 3.0));
        assert!(middle > 0.8 && (0.3..0.6).contains(&edge) && far < 1e-3 && map.at(DVec2::X * 9.0) == 0.0);
    }
}
