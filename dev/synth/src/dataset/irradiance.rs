//! Irradiance cache: sky light and one bounce are computed at points spread over the surfaces that the views see, with
//! many rays each, and interpolated for pixels. So pictures have no noise from indirect light, and a surface looks the
//! same in all views.

use std::f32::consts::TAU;

use glam::{IVec3, Vec3, Vec4};
use rayon::prelude::*;

use super::bvh::{Bounds, Ray};
use super::light::{cosine_direction, disc};
use super::noise::hash;
use super::scene_builder::Scene;
use super::world::{Point, World};
use instgs_vk::math::rng::Rng;

/// Rays per point, as strata of the angle to the normal times strata of the angle around it.
const STRATA: (usize, usize) = (8, 12);
/// Radius in which points are interpolated, in spacings: about a dozen points.
const REACH: f32 = 2.3;
/// Points whose normals differ by more (cosine) belong to another surface.
const LEAST_COSINE: f32 = 0.7;
/// Largest distance of an interpolated point from the tangent plane, in radii.
const PLANE_SHARE: f32 = 0.45;
/// A lower sum of weights means that no point is nearby.
const LEAST_WEIGHT: f32 = 1e-4;
/// Strata of the rays for a place without points nearby.
const FALLBACK_STRATA: (usize, usize) = (6, 10);

/// A point with its indirect light.
#[derive(Clone, Copy, Debug)]
pub struct Lit {
    /// The point on a surface.
    pub point: Point,
    /// Light without the direct sun, relative to that of a white surface under a white sky.
    pub light: Vec3,
}

/// Points with indirect light, and a grid for finding them.
pub struct Irradiance {
    lit: Vec<Lit>,
    /// Positions and normals alone: most points that are tested are too far away.
    places: Vec<(Vec3, Vec3)>,
    grid: Grid,
    reach: f32,
    seed: u64,
}

impl Irradiance {
    /// Computes the light of points that are the scene's `light_spacing` apart.
    pub fn light(scene: &Scene, points: Vec<Point>, seed: u64) -> Self {
        let at = |(i, point): (usize, Point)| {
            let mut rng = Rng::new(seed).fork(i as u64);
            Lit { point, light: gathered(&scene.world, &point, STRATA, &mut rng) }
        };
        let lit: Vec<Lit> = points.into_par_iter().enumerate().map(at).collect();
        let reach = REACH * scene.light_spacing;
        let positions: Vec<Vec3> = lit.iter().map(|l| l.point.position).collect();
        let places = lit.iter().map(|l| (l.point.position, l.point.normal)).collect();
        Self { grid: Grid::new(&positions, reach), lit, places, reach, seed }
    }

    /// All points with their light.
    pub fn points(&self) -> &[Lit] {
        &self.lit
    }

    /// Indirect light at a point of a surface, interpolated.
    pub fn at(&self, scene: &Scene, point: &Point) -> Vec3 {
        let core = scene.core_share(point.position);
        let beyond = || scene.world.light.open_sky(point.normal);
        match core {
            0.0 => beyond(),
            1.0 => self.inside(&scene.world, point),
            _ => beyond().lerp(self.inside(&scene.world, point), core),
        }
    }

    fn inside(&self, world: &World, point: &Point) -> Vec3 {
        // Points of the same surface, and points of any surface with a similar normal, for thin parts without points of
        // their own.
        let (mut own, mut any) = (Vec4::ZERO, Vec4::ZERO);
        for &near in self.grid.near(point.position) {
            let (position, normal) = self.places[near as usize];
            let apart = position - point.position;
            let distance = apart.length_squared() / (self.reach * self.reach);
            let cosine = normal.dot(point.normal);
            if distance >= 1.0 || cosine <= 0.0 {
                continue;
            }
            let weight = (1.0 - distance).powi(2);
            let light = self.lit[near as usize].light.extend(1.0);
            any += light * (weight * cosine);
            let plane = apart.dot(point.normal).abs() / self.reach;
            // Leaves have no common plane.
            let off_plane = if point.surface.through > 0.0 { 0.0 } else { plane / PLANE_SHARE };
            own += light * (weight * (cosine - LEAST_COSINE + 0.02).max(0.0) * (1.0 - off_plane).max(0.0));
        }
        if let Some(found) = [own, any].into_iter().find(|sum| sum.w > LEAST_WEIGHT) {
            return found.truncate() / found.w;
        }
        // Directions depend on a cell of a millimetre, so that a place has the same light in every view.
        let cell = (point.position * 1024.0).round().as_ivec3();
        let mut rng = Rng::new(self.seed ^ u64::from(hash(cell, 1)));
        gathered(world, point, FALLBACK_STRATA, &mut rng)
    }
}

/// Cosine-weighted mean radiance from the half space above a point, with one bounce.
fn gathered(world: &World, point: &Point, strata: (usize, usize), rng: &mut Rng) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for i in 0..strata.0 * strata.1 {
        let u = ((i / strata.1) as f32 + rng.uniform() as f32) / strata.0 as f32;
        let v = ((i % strata.1) as f32 + rng.uniform() as f32) / strata.1 as f32;
        let sun = disc(rng.uniform() as f32, rng.uniform() as f32);
        let direction = cosine_direction(point.normal, u, v);
        let ray = Ray::new(point.lifted(direction), direction);
        sum += match world.closest(&ray) {
            None => world.light.sky(direction),
            Some(hit) => {
                // The footprint of a ray's share of the half space.
                let met = world.point(&ray, &hit, (TAU / (strata.0 * strata.1) as f32).sqrt());
                met.surface.albedo * (world.light.sun * world.sun_on(&met, sun) + world.light.ambient)
            }
        };
    }
    sum / (strata.0 * strata.1) as f32
}

/// Selects points, in order, that are `spacing` apart from all selected before with a similar normal.
pub fn spread(points: impl IntoIterator<Item = Point>, spacing: f32) -> Vec<Point> {
    let mut cells: std::collections::HashMap<IVec3, Vec<(Vec3, Vec3)>> = std::collections::HashMap::new();
    let cell_of = |p: Vec3| (p / spacing).floor().as_ivec3();
    let mut out = Vec::new();
    for point in points {
        let (low, high) = (cell_of(point.position - spacing), cell_of(point.position + spacing));
        let crowded = |&(position, normal): &(Vec3, Vec3)| {
            position.distance_squared(point.position) < spacing * spacing && normal.dot(point.normal) > 0.8
        };
        let taken = (low.x..=high.x)
            .flat_map(|x| (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| IVec3::new(x, y, z))))
            .any(|cell| cells.get(&cell).is_some_and(|near| near.iter().any(crowded)));
        if !taken {
            cells.entry(cell_of(point.position)).or_default().push((point.position, point.normal));
            out.push(point);
        }
    }
    out
}

/// For each cell, the points within reach of any position in it.
struct Grid {
    cell: f32,
    /// Hash table with open addressing: cell and its range of `members`; an empty range marks a free slot.
    slots: Vec<(IVec3, u32, u32)>,
    members: Vec<u32>,
}

impl Grid {
    fn new(positions: &[Vec3], reach: f32) -> Self {
        let cell_of = |p: Vec3| (p / reach).floor().as_ivec3();
        let mut pairs: Vec<([i32; 3], u32)> = Vec::new();
        for (i, &p) in positions.iter().enumerate() {
            let middle = cell_of(p);
            for offset in 0..27 {
                let cell = middle + IVec3::new(offset % 3 - 1, offset / 3 % 3 - 1, offset / 9 - 1);
                let low = cell.as_vec3() * reach;
                let bounds = Bounds { low, high: low + reach };
                if p.clamp(bounds.low, bounds.high).distance_squared(p) < reach * reach {
                    pairs.push((cell.to_array(), i as u32));
                }
            }
        }
        pairs.par_sort_unstable();
        let cells = pairs.chunk_by(|a, b| a.0 == b.0).count();
        let mut out = Self { cell: reach, slots: Vec::new(), members: pairs.iter().map(|p| p.1).collect() };
        out.slots.resize((2 * cells).next_power_of_two(), (IVec3::ZERO, 0, 0));
        let mut begin = 0;
        for run in pairs.chunk_by(|a, b| a.0 == b.0) {
            let end = begin + run.len() as u32;
            let cell = IVec3::from_array(run[0].0);
            let slot = out.slot_of(cell);
            out.slots[slot] = (cell, begin, end);
            begin = end;
        }
        out
    }

    /// Slot of a cell, or the free slot where it would go; at most half of the slots are taken.
    fn slot_of(&self, cell: IVec3) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = hash(cell, 0) as usize & mask;
        while self.slots[slot].1 != self.slots[slot].2 && self.slots[slot].0 != cell {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn near(&self, p: Vec3) -> &[u32] {
        let (_, begin, end) = self.slots[self.slot_of((p / self.cell).floor().as_ivec3())];
        &self.members[begin as usize..end as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_finds_all_points_within_reach() {
        let mut rng = Rng::new(9);
        let positions: Vec<Vec3> = (0..3000).map(|_| (rng.unit_vector() * rng.uniform() * 5.0).as_vec3()).collect();
        let grid = Grid::new(&positions, 0.7);
        for _ in 0..300 {
            let p = (rng.unit_vector() * rng.uniform() * 6.0).as_vec3();
            let found = grid.near(p);
            for (i, q) in positions.iter().enumerate() {
                assert!(q.distance(p) >= 0.7 || found.contains(&(i as u32)));
            }
        }
        assert!(Grid::new(&[], 1.0).near(Vec3::ONE).is_empty());
    }
}
