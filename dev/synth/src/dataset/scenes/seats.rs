//! The stand of an open-air theatre: rows of seats on curved steps, of which some are folded up, worn or of another cloth.

use std::f64::consts::PI;

use glam::DVec3;

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, plaster, srgb};
use super::super::mesh::MeshBuilder;
use super::super::models::props;
use super::super::models::seat::{SeatLook, folded, frame, unfolded};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring, Sweep};
use instgs_vk::math::rng::Rng;

/// Distance of seats along a row, and of rows, metres.
const PITCH: (f64, f64) = (0.58, 0.95);
/// Height of a step, metres.
const RISE: f64 = 0.28;
/// Radius of the first row, whose centre is the origin; the stage is there. Metres.
const FIRST_RADIUS: f64 = 20.0;
const CLOTH: [u32; 4] = [0x8E2430, 0x8E2430, 0x9A3A34, 0x2E4E6E];

pub(super) fn build(seed: u64, count: u32) -> Scene {
    stand(seed, count, false)
}

/// The same from close by: few seats fit into a photo.
pub(super) fn build_sparse(seed: u64, count: u32) -> Scene {
    stand(seed, count, true)
}

fn stand(seed: u64, count: u32, sparse: bool) -> Scene {
    let mut rng = Rng::new(seed).fork(7);
    let mut builder = SceneBuilder::new();
    let columns = (f64::from(count) * 1.5).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let [frame, down, up] = [frame(), unfolded(), folded()].map(|mesh| builder.mesh(mesh));
    for i in 0..count {
        let (column, row) = (i % columns, i / columns);
        let radius = FIRST_RADIUS + PITCH.1 * f64::from(row);
        let turn = PITCH.0 * (f64::from(column) - 0.5 * f64::from(columns - 1)) / radius;
        let at = DVec3::new(radius * turn.cos(), radius * turn.sin(), RISE * f64::from(row));
        let cushion = if rng.chance(0.3) { up } else { down };
        let look = SeatLook {
            cloth: srgb(CLOTH[rng.index(CLOTH.len())]) * rng.range(0.8, 1.2) as f32,
            number: 1 + i % 99,
            seed: rng.index(1000) as u32,
        };
        // Seats face the stage at the origin.
        builder.object("seat", vec![frame, cushion], placed(at, turn + PI, 1.0), look);
    }
    let last = FIRST_RADIUS + PITCH.1 * f64::from(rows - 1);
    let half_turn = 0.5 * PITCH.0 * f64::from(columns) / FIRST_RADIUS;
    steps(&mut builder, rows, half_turn + 0.12);
    let ground = builder.mesh(props::ground(60.0));
    builder.prop(ground, placed(DVec3::Z * -0.02, 0.0, 1.0), |spot: &Spot| plaster(spot, srgb(0x8A8478), 203));
    let (width, depth) = (PITCH.0 * f64::from(columns), last - FIRST_RADIUS);
    let middle = DVec3::new(0.5 * (FIRST_RADIUS + last), 0.0, 0.5 * RISE * f64::from(rows) + 0.4);
    let reach = width.max(depth);
    let ring = |distance: f64, height: f64| Ring { distance: reach * distance, height: middle.z + reach * height };
    let rings = vec![ring(0.7, 0.55), ring(0.95, 0.75), ring(0.6, 0.9), ring(0.85, 0.5), ring(0.45, 0.8)];
    let look = DVec3::new(0.8, 0.0, -1.2);
    let sweep = sparse.then(|| Sweep {
        corner: DVec3::new(FIRST_RADIUS - look.x - 0.95, -0.54 * width, 1.65),
        along: DVec3::Y * 1.08 * width,
        across: DVec3::new(depth, 0.0, RISE * f64::from(rows)),
        // Test views are every eighth: with one more line they do not all begin one.
        lines: rows.div_ceil(2) + 1,
        look,
    });
    let rig = Rig { target: middle, stray: 0.2 * reach, rings, azimuths: (PI, 2.6), sweep };
    builder.finish(Daylight::afternoon(150.0, 50.0), rig, 0.012 * reach as f32, 2.4 * reach as f32)
}

/// Curved steps of concrete, `half_turn` radians to each side, and a wall behind the last one.
fn steps(builder: &mut SceneBuilder, rows: u32, half_turn: f64) {
    let mut b = MeshBuilder::new();
    let at = |radius: f64, turn: f64, z: f64| DVec3::new(radius * turn.cos(), radius * turn.sin(), z);
    let turn = |u: f64| half_turn * (2.0 * u - 1.0);
    for row in 0..=rows {
        let (inner, z) = (FIRST_RADIUS - 0.45 + PITCH.1 * f64::from(row), RISE * f64::from(row));
        let outer = inner + if row == rows { 2.0 } else { PITCH.1 };
        b.patch((32, 1), |u, v| at(inner + (outer - inner) * v, turn(u), z), |_, _| true);
        b.patch((32, 1), |u, v| at(inner, turn(u), z - RISE * v), |_, _| true);
        for side in [-half_turn, half_turn] {
            b.patch((1, 1), |u, v| at(inner + (outer - inner) * u, side, z * v), |_, _| true);
        }
    }
    let behind = FIRST_RADIUS + 1.55 + PITCH.1 * f64::from(rows);
    let base = RISE * f64::from(rows);
    b.patch((48, 1), |u, v| at(behind, 2.2 * turn(u), base + 3.0 * v - base * 2.0 * (1.0 - v)), |_, _| true);
    let mesh = builder.mesh(b);
    builder.prop(mesh, placed(DVec3::ZERO, 0.0, 1.0), |spot: &Spot| {
        let mut surface: Surface = plaster(spot, srgb(0xA8A298), 201);
        surface.albedo *= 0.9;
        surface
    });
}
