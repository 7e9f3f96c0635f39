//! A full car park from above: rows of racing cars on both sides of the lanes, under a drone. The cars are most of what
//! there is to see.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DVec2, DVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Look, Spot, Surface, srgb};
use super::super::models::{car, props};
use super::super::noise::{band, fractal, smooth_step};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring, Sweep};
use crate::livery::{Livery, Wing};
use instgs_vk::math::rng::Rng;

/// Width and depth of a bay, metres.
const BAY: DVec2 = DVec2::new(2.7, 5.0);
/// Width of the lane between two rows that face each other, metres.
const LANE: f64 = 4.2;

pub(super) fn build(seed: u64, count: u32) -> Scene {
    lot(seed, count, None)
}

/// The same seen from low above: few cars fit into a photo.
pub(super) fn build_sparse(seed: u64, count: u32) -> Scene {
    lot(seed, count, Some((4.6, DVec3::new(0.0, 2.6, -4.6))))
}

/// `sweep` is the height of a drone that flies over the rows, and its view, metres; without it cameras stand on rings.
fn lot(seed: u64, count: u32, sweep: Option<(f64, DVec3)>) -> Scene {
    let mut rng = Rng::new(seed).fork(6);
    let mut builder = SceneBuilder::new();
    let columns = (f64::from(count) * 1.9).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let half = DVec2::new(0.5 * BAY.x * f64::from(columns), 0.5 * (near_edge(rows - 1) + BAY.y));
    let body = builder.mesh(car::body());
    let wings = [car::wing(0.0), car::wing(0.13)].map(|wing| builder.mesh(wing));
    let rack = builder.mesh(car::roof_rack());
    for i in 0..count {
        let (column, row) = (i % columns, i / columns);
        let middle = DVec2::new(BAY.x * (f64::from(column) + 0.5), near_edge(row) + 0.5 * BAY.y) - half;
        let at = middle + DVec2::new(rng.range(-0.12, 0.12), rng.range(-0.2, 0.2));
        // Cars face their lane; now and then somebody has parked backwards.
        let faces_up = row.is_multiple_of(2) == rng.chance(0.15);
        let yaw = if faces_up { FRAC_PI_2 } else { -FRAC_PI_2 } + rng.range(-0.04, 0.04);
        let livery = Livery { roundels: false, ..Livery::drawn(i as usize, &mut rng) };
        let mut meshes = vec![body];
        match livery.wing {
            Wing::Removed => {}
            Wing::Raised(by) => meshes.push(wings[usize::from(by > 0.0)]),
        }
        if i % 5 == 2 {
            meshes.push(rack);
        }
        let number = 1 + (rng.index(12) as u32 + 13 * i) % 99;
        builder.object("car", meshes, placed(at.extend(0.0), yaw, 1.0), car::CarLook { livery, number });
    }
    let extent = half.length();
    let ground = builder.mesh(props::ground(8.0 * extent));
    builder.prop(ground, placed(DVec3::ZERO, 0.0, 1.0), Ground { half: half.as_vec2() });
    let ring = |distance: f64, height: f64| Ring { distance: extent * distance, height: extent * height };
    let rings = vec![ring(0.75, 0.75), ring(0.35, 0.95), ring(0.95, 0.9), ring(0.55, 0.65), ring(0.8, 1.1)];
    let sweep = sweep.map(|(height, look)| Sweep {
        corner: (-half).extend(height) - DVec3::Y * look.y,
        along: DVec3::X * 2.0 * half.x,
        across: DVec3::Y * 2.0 * half.y,
        // One more than rows, so that test views, which are every eighth, do not all begin a line.
        lines: rows + 1,
        look,
    });
    let rig = Rig { target: DVec3::Z * 0.5, stray: 0.3 * extent, rings, azimuths: (0.0, TAU), sweep };
    builder.finish(Daylight::afternoon(-40.0, 52.0), rig, 0.011 * extent as f32, 2.2 * extent as f32)
}

/// Distance of a row's near edge from that of the first row, metres: two rows stand back to back, then comes a lane.
fn near_edge(row: u32) -> f64 {
    f64::from(row) * BAY.y + LANE * f64::from(row / 2)
}

/// Plain asphalt with the lines of the bays.
struct Ground {
    half: glam::Vec2,
}

impl Look for Ground {
    fn surface(&self, spot: &Spot) -> Surface {
        let p = spot.position;
        let stains = fractal(p, 3.0, 3, spot.footprint, 61);
        let grain = fractal(p, 0.3, 2, spot.footprint, 62);
        let asphalt = srgb(0x6E6D70) * (1.0 + 0.25 * stains + 0.08 * grain);
        let inside = smooth_step(0.4, 0.0, p.x.abs() - self.half.x) * smooth_step(1.0, 0.0, p.y.abs() - self.half.y);
        let cross = p.x + self.half.x;
        let line = band(cross - (cross / BAY.x as f32).round() * BAY.x as f32, 0.0, 0.05, spot.footprint);
        Surface::matt(asphalt.lerp(Vec3::splat(0.6), 0.7 * line * inside))
    }
}
