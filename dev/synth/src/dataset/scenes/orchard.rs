//! An orchard: one tree in many sizes and rotations, its fruit in many colours.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, blend, grass, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::models::tree::{TreeLook, tree};
use super::super::noise::{fractal, smooth_step};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring};
use instgs_vk::math::rng::Rng;

/// Spacing of rows, and of trees in a row, metres.
const PITCH: f64 = 4.3;
/// Leaves per cluster: enough to break up the clusters' outlines.
const LEAVES: usize = 150;
const FRUIT: [u32; 6] = [0xC4241C, 0xE8B422, 0xE67A1E, 0x8A1C3A, 0xC8D048, 0xE04A34];

pub(super) fn build(seed: u64, count: u32) -> Scene {
    let mut rng = Rng::new(seed).fork(3);
    let mut builder = SceneBuilder::new();
    let shape = builder.mesh(tree(7, LEAVES));
    let columns = f64::from(count).sqrt().ceil() as u32;
    let rows = count.div_ceil(columns);
    let middle = |n: u32| 0.5 * f64::from(n - 1);
    for i in 0..count {
        let cell = DVec2::new(f64::from(i % columns) - middle(columns), f64::from(i / columns) - middle(rows));
        let at = cell * PITCH + DVec2::new(rng.range(-0.5, 0.5), rng.range(-0.5, 0.5));
        let place = placed(at.extend(0.0), rng.range(-PI, PI), rng.range(0.7, 1.3));
        let leaf = blend(srgb(0x5E8230), srgb(0x7D9440), rng.uniform() as f32);
        let fruit = srgb(FRUIT[i as usize % FRUIT.len()]);
        builder.object("tree", vec![shape], place, TreeLook { leaf, fruit, seed: 40 });
    }
    let extent = PITCH * 0.5 * f64::from(columns.max(rows)) + 1.0;
    surroundings(&mut builder, &mut rng, extent);
    let ring = |distance: f64, height: f64| Ring { distance: extent * distance + 3.0, height };
    let rings =
        vec![ring(0.9, 1.9), ring(1.05, 4.2), ring(0.8, 0.9 * extent), ring(1.15, 3.0), ring(0.55, 1.25 * extent)];
    let rig = Rig { target: DVec3::Z * 1.3, stray: 0.15 * extent, rings, azimuths: (0.0, TAU), sweep: None };
    builder.finish(Daylight::afternoon(-35.0, 38.0), rig, 0.013 * extent as f32, (1.3 * extent + 4.0) as f32)
}

fn surroundings(builder: &mut SceneBuilder, rng: &mut Rng, extent: f64) {
    let ground = builder.mesh(super::super::models::props::ground(12.0 * extent + 40.0));
    builder.prop(ground, placed(DVec3::ZERO, 0.0, 1.0), meadow);
    let crate_mesh = builder.mesh(fruit_crate());
    for _ in 0..5 {
        let at = DVec2::from_angle(rng.range(0.0, TAU)) * (extent * rng.range(0.2, 0.95));
        builder.prop(crate_mesh, placed(at.extend(0.0), rng.range(0.0, TAU), 1.0), crate_look);
    }
    let ladder = builder.mesh(ladder());
    builder.prop(ladder, placed(DVec3::new(0.5 * PITCH, 0.42 * PITCH, 0.0), 0.7, 1.0), crate_look);
    let panel = builder.mesh(fence_panel());
    let panels = ((2.0 * PI * (extent + 5.5)) / 3.0).round().max(8.0) as u32;
    for i in 0..panels {
        let turn = TAU * f64::from(i) / f64::from(panels);
        let at = DVec2::from_angle(turn) * (extent + 5.5);
        if i % 11 != 4 {
            builder.prop(panel, placed(at.extend(0.0), turn + 0.5 * PI, 1.0), crate_look);
        }
    }
    let hedge = builder.mesh(hedge());
    for i in 0..9 {
        let turn = TAU * (f64::from(i) + 0.5 * rng.uniform()) / 9.0;
        let at = DVec2::from_angle(turn) * (extent + rng.range(8.5, 12.0));
        let look = TreeLook { leaf: srgb(0x4F6E2C), fruit: Vec3::ZERO, seed: 50 + i };
        builder.prop(hedge, placed(at.extend(0.0), rng.range(0.0, TAU), rng.range(0.8, 1.5)), look);
    }
}

/// Grass, worn to earth in lanes between the rows.
fn meadow(spot: &Spot) -> Surface {
    let p = spot.position;
    let lane = (p.y / PITCH as f32 + 0.5).rem_euclid(1.0) - 0.5;
    let wander = fractal(p, 3.0, 4, spot.footprint, 61);
    let earth = smooth_step(0.36, 0.46, lane.abs() + 0.22 * wander);
    let soil = srgb(0x8A7350) * (1.0 + 0.5 * fractal(p, 0.35, 5, spot.footprint, 62));
    Surface::matt(blend(grass(spot, 60), soil, 0.8 * earth))
}

fn fruit_crate() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    for side in [-1.0, 1.0] {
        for z in [0.06, 0.17, 0.28] {
            b.block(DVec3::new(0.0, 0.24 * side, z), DVec3::new(0.36, 0.012, 0.045), 0.005);
            b.block(DVec3::new(0.35 * side, 0.0, z), DVec3::new(0.012, 0.24, 0.045), 0.005);
        }
    }
    b.block(DVec3::Z * 0.02, DVec3::new(0.35, 0.23, 0.01), 0.004);
    b.part = 1;
    for i in 0..28 {
        let at =
            DVec3::new(0.09 * f64::from(i % 7) - 0.27, 0.11 * f64::from(i / 7) - 0.165, 0.26 + 0.02 * f64::from(i % 3));
        b.ellipsoid(at, glam::DMat3::IDENTITY, DVec3::splat(0.055), (7, 10));
    }
    b
}

fn ladder() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    for side in [-1.0, 1.0] {
        b.limb(DVec3::new(-0.5, 0.3 * side, 0.0), DVec3::new(0.2, 0.16 * side, 2.5), (0.03, 0.025), 8);
        b.limb(DVec3::new(0.75, 0.2 * side, 0.0), DVec3::new(0.2, 0.1 * side, 2.45), (0.025, 0.025), 8);
    }
    for i in 1..8 {
        let t = f64::from(i) / 8.0;
        let (x, y, z) = (-0.5 + 0.7 * t, 0.3 - 0.14 * t, 2.5 * t);
        b.limb(DVec3::new(x, -y, z), DVec3::new(x, y, z), (0.016, 0.016), 8);
    }
    b
}

fn fence_panel() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.block(DVec3::new(-1.5, 0.0, 0.6), DVec3::new(0.06, 0.06, 0.62), 0.02);
    for z in [0.4, 0.85] {
        b.limb(DVec3::new(-1.5, 0.0, z), DVec3::new(1.5, 0.0, z + 0.03), (0.045, 0.04), 8);
    }
    b
}

/// A hedge: a row of bushes along x.
fn hedge() -> MeshBuilder {
    let mut rng = Rng::new(71);
    let mut b = MeshBuilder::new();
    b.part = 1;
    for i in 0..7 {
        let at = DVec3::new(0.9 * (f64::from(i) - 3.0), rng.range(-0.3, 0.3), rng.range(0.6, 0.9));
        let half = DVec3::new(rng.range(0.8, 1.1), rng.range(0.7, 1.0), rng.range(0.8, 1.2));
        b.ellipsoid(at, glam::DMat3::IDENTITY, half, (14, 22));
    }
    b
}

fn crate_look(spot: &Spot) -> Surface {
    if spot.part == 1 { Surface::coated(srgb(0xC4301C), 0.04) } else { wood(spot, Vec3::X, srgb(0xA68A62), 64) }
}
