//! Baked shadows of a car on itself, from a voxel grid.

use std::collections::{HashMap, HashSet};
use std::f64::consts::PI;

use glam::DVec3;

use instgs_synth::surface::Surfel;

/// Side of a voxel, metres.
const VOXEL: f64 = 0.07;
/// Rays start this far above the surface, so that it does not shade itself.
const RAY_START: f64 = 0.15;
/// Rays end here, metres.
const RAY_END: f64 = 2.2;

/// Which voxels hold surfels.
pub(crate) struct VoxelGrid {
    occupied: HashSet<[i32; 3]>,
}

impl VoxelGrid {
    /// From the positions of surfels.
    pub(crate) fn new(positions: impl Iterator<Item = DVec3>) -> Self {
        Self { occupied: positions.map(Self::voxel).collect() }
    }

    fn voxel(p: DVec3) -> [i32; 3] {
        (p / VOXEL).floor().as_ivec3().to_array()
    }

    /// True if nothing lies between the surfel and the far end of a ray along `dir`; false for rays into the ground.
    pub(crate) fn sees(&self, from: &Surfel, dir: DVec3) -> bool {
        let start = from.position + from.normal * RAY_START;
        let steps = ((RAY_END - RAY_START) / (0.8 * VOXEL)) as usize;
        (0..steps).all(|i| !self.occupied.contains(&Self::voxel(start + dir * (i as f64 * 0.8 * VOXEL))))
    }

    /// Cosine-weighted share of the upper half space that the surfel sees, 0..=1, among evenly spread directions.
    pub(crate) fn openness(&self, from: &Surfel) -> f64 {
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
pub(crate) struct Smoother {
    neighbours: Vec<Vec<u32>>,
}

impl Smoother {
    /// Neighbours are nearer than `radius`.
    pub(crate) fn new(surfels: &[Surfel], radius: f64) -> Self {
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
    pub(crate) fn smoothed(&self, values: &[f64]) -> Vec<f64> {
        let mean = |list: &Vec<u32>| list.iter().map(|&i| values[i as usize]).sum::<f64>() / list.len() as f64;
        self.neighbours.iter().map(mean).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roof_shades_what_is_below_it() {
        let plate = |z: f64| {
            (0..40 * 40).map(move |i| DVec3::new(f64::from(i % 40), f64::from(i / 40), 0.0) * 0.05 + DVec3::Z * z)
        };
        let grid = VoxelGrid::new(plate(1.0));
        let below = Surfel { position: DVec3::new(1.0, 1.0, 0.0), normal: DVec3::Z, spacing: 0.05 };
        let above = Surfel { position: DVec3::new(1.0, 1.0, 1.04), ..below };
        assert!(!grid.sees(&below, DVec3::Z) && grid.sees(&above, DVec3::Z));
        assert!(grid.openness(&below) < 0.7 && grid.openness(&above) == 1.0);
    }
}
