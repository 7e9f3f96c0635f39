//! A dining hall: chairs, tables and vases, three groups; a wooden floor, walls, and sun through the windows.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, IVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, plaster, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::models::furniture::{TABLE_HEIGHT, VaseLook, WoodLook, bouquet, chair, cushion, table, vase};
use super::super::models::props;
use super::super::noise::{fractal, grid_line, hash_unit};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring};
use instgs_vk::math::rng::Rng;

/// Spacing of tables along and across, metres.
const PITCH: DVec2 = DVec2::new(3.6, 3.4);
/// Height of the ceiling, metres.
const HEIGHT: f64 = 3.9;
const WALL: f64 = 0.25;
/// Windows: half width, height of sill and head, and spacing, metres.
const OPENING: (f64, f64, f64, f64) = (0.8, 0.75, 3.2, 2.5);
const CLOTH: [u32; 4] = [0x2E6E8E, 0xB8483A, 0x6E8A4A, 0xD2A23C];
const TONES: [u32; 3] = [0xA8743E, 0x8A5A32, 0xB98A52];
const GLAZE: [(u32, u32); 4] = [(0x2F5E8C, 0xF2EEE0), (0xC46A32, 0x2A2A30), (0xE6DFCC, 0x2F5E8C), (0x4E7A5C, 0xE8C050)];

pub(super) fn build(seed: u64, count: u32) -> Scene {
    let mut rng = Rng::new(seed).fork(2);
    let mut builder = SceneBuilder::new();
    // Two vases and six chairs per table, as far as the number of objects allows.
    let tables = ((count + 4) / 9).max(1);
    let chairs = count - 3 * tables;
    let columns = f64::from(tables).sqrt().ceil() as u32;
    let rows = tables.div_ceil(columns);
    let middle = |n: u32| 0.5 * f64::from(n - 1);
    let spots: Vec<(DVec2, f64)> = (0..tables)
        .map(|i| {
            let cell = DVec2::new(f64::from(i % columns) - middle(columns), f64::from(i / columns) - middle(rows));
            (cell * PITCH + DVec2::new(rng.range(-0.2, 0.2), rng.range(-0.15, 0.15)), rng.range(-0.12, 0.12))
        })
        .collect();
    furnish(&mut builder, &mut rng, &spots, chairs);
    let half = 0.5 * PITCH.x * f64::from(columns).max(f64::from(rows)) + 1.5;
    room(&mut builder, half);
    let ring = |inset: f64, height: f64| Ring { distance: half - inset, height };
    let rings = vec![ring(0.75, 1.7), ring(1.1, 2.6), ring(0.6, 3.2), ring(1.6, 2.2), ring(0.9, 2.9)];
    let rig = Rig { target: DVec3::Z * 0.55, stray: 0.35, rings, azimuths: (0.0, TAU), sweep: None };
    let light = Daylight {
        ambient: Vec3::new(0.26, 0.24, 0.21),
        sun: Vec3::new(2.3, 1.95, 1.5),
        exposure: 2.7,
        sun_radius: 0.012,
        ..Daylight::afternoon(-52.0, 33.0)
    };
    builder.finish(light, rig, 0.013 * half as f32, 3.0 * half as f32)
}

fn furnish(builder: &mut SceneBuilder, rng: &mut Rng, tables: &[(DVec2, f64)], chairs: u32) {
    let [chair, cushion, table, vase, bouquet] =
        [chair(), cushion(), table(), vase(), bouquet()].map(|m| builder.mesh(m));
    let on = |(at, yaw): (DVec2, f64), offset: DVec2| at + DVec2::from_angle(yaw).rotate(offset);
    for i in 0..chairs as usize {
        let seat = i / tables.len();
        let (at, yaw) = tables[i % tables.len()];
        // Two on each long side, one at each end; further chairs stand farther out.
        let (offset, facing) = [
            (DVec2::new(0.45, 0.72), -0.5 * PI),
            (DVec2::new(-0.45, -0.72), 0.5 * PI),
            (DVec2::new(1.22, 0.0), PI),
            (DVec2::new(-0.45, 0.72), -0.5 * PI),
            (DVec2::new(0.45, -0.72), 0.5 * PI),
            (DVec2::new(-1.22, 0.0), 0.0),
        ][seat % 6];
        let away = 1.0 + 0.45 * (seat / 6) as f64 + rng.range(-0.03, 0.14);
        let place = placed(on((at, yaw), offset * away).extend(0.0), yaw + facing + rng.range(-0.45, 0.45), 1.0);
        let meshes = if i % 3 == 1 { vec![chair] } else { vec![chair, cushion] };
        let look = WoodLook { tone: srgb(TONES[rng.index(3)]), cloth: srgb(CLOTH[i % 4]), seed: 100 };
        builder.object("chair", meshes, place, look);
    }
    for (i, &(at, yaw)) in tables.iter().enumerate() {
        let look = WoodLook { tone: srgb([0x9A6A3A, 0x7A4E2E][i % 2]), cloth: Vec3::ZERO, seed: 110 };
        builder.object("table", vec![table], placed(at.extend(0.0), yaw, 1.0), look);
    }
    for i in 0..2 * tables.len() {
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let offset = DVec2::new(0.42 * side + rng.range(-0.08, 0.08), rng.range(-0.12, 0.12));
        let place = placed(on(tables[i / 2], offset).extend(TABLE_HEIGHT), rng.range(0.0, TAU), 1.0);
        let (glaze, accent) = GLAZE[i % GLAZE.len()];
        let meshes = if i % 4 == 1 { vec![vase] } else { vec![vase, bouquet] };
        builder.object("vase", meshes, place, VaseLook { glaze: srgb(glaze), accent: srgb(accent) });
    }
}

// Tags of the room's triangles.
const PLASTER: u8 = 0;
const PANEL: u8 = 1;
const FRAME: u8 = 2;
const CEILING: u8 = 3;
const BEAM: u8 = 4;

fn room(builder: &mut SceneBuilder, half: f64) {
    let ground = builder.mesh(props::ground(80.0));
    let outside = |spot: &Spot| Surface::matt(super::super::look::grass(spot, 120));
    builder.prop(ground, placed(DVec3::Z * -0.25, 0.0, 1.0), outside);
    let floor = builder.mesh(props::ground(half + WALL));
    builder.prop(floor, placed(DVec3::ZERO, 0.0, 1.0), planks);
    let mut b = MeshBuilder::new();
    for side in 0..4 {
        wall(&mut b, half, side, side == 0 || side == 3);
    }
    b.part = CEILING;
    b.block(DVec3::Z * (HEIGHT + 0.1), DVec3::new(half + WALL, half + WALL, 0.1), 0.0);
    b.part = BEAM;
    let beams = (half / 1.1).round() as i32;
    for i in -beams..=beams {
        let x = f64::from(i) * half / (f64::from(beams) + 0.5);
        b.block(DVec3::new(x, 0.0, HEIGHT - 0.12), DVec3::new(0.09, half, 0.12), 0.01);
    }
    let mesh = builder.mesh(b);
    builder.prop(mesh, placed(DVec3::ZERO, 0.0, 1.0), walls);
    furnish_walls(builder, half);
}

/// One wall; `side` counts quarter turns from +x. Windows, if any, stand in a row.
fn wall(b: &mut MeshBuilder, half: f64, side: u32, windows: bool) {
    let axes = glam::DMat3::from_rotation_z(0.5 * PI * f64::from(side));
    // x points outwards, y along the wall.
    let slab = |b: &mut MeshBuilder, along: (f64, f64), up: (f64, f64), depth: (f64, f64)| {
        let mid = |r: (f64, f64)| 0.5 * (r.0 + r.1);
        let reach = |r: (f64, f64)| 0.5 * (r.1 - r.0);
        let centre = axes * DVec3::new(half + mid(depth), mid(along), mid(up));
        b.rounded_box(centre, axes, DVec3::new(reach(depth), reach(along), reach(up)), 0.004);
    };
    let (opening, sill, head, pitch) = OPENING;
    let count = if windows { ((2.0 * half - 1.0) / pitch).floor() as i32 } else { 0 };
    let thick = (0.0, WALL);
    b.part = PLASTER;
    let mut begin = -half - WALL;
    for i in 0..count {
        let middle = pitch * (f64::from(i) - 0.5 * f64::from(count - 1));
        let (left, right) = (middle - opening, middle + opening);
        slab(b, (begin, left), (0.0, HEIGHT), thick);
        slab(b, (left, right), (0.0, sill), thick);
        slab(b, (left, right), (head, HEIGHT), thick);
        b.part = FRAME;
        slab(b, (left - 0.05, right + 0.05), (sill - 0.04, sill + 0.02), (-0.12, WALL));
        for x in [left + 0.03, middle, right - 0.03] {
            slab(b, (x - 0.03, x + 0.03), (sill, head), (0.08, 0.14));
        }
        for z in [sill + 0.04, sill + 1.65, head - 0.03] {
            slab(b, (left, right), (z - 0.03, z + 0.03), (0.085, 0.135));
        }
        b.part = PLASTER;
        begin = right;
    }
    slab(b, (begin, half + WALL), (0.0, HEIGHT), thick);
    b.part = PANEL;
    slab(b, (-half, half), (0.0, 0.12), (-0.025, 0.0));
    if !windows {
        slab(b, (-half, half), (0.12, 0.95), (-0.012, 0.0));
        slab(b, (-half, half), (0.93, 0.98), (-0.035, 0.0));
    }
}

/// Pictures, a sideboard, and potted plants in the corners.
fn furnish_walls(builder: &mut SceneBuilder, half: f64) {
    let mut frame = MeshBuilder::new();
    frame.block(DVec3::ZERO, DVec3::new(0.02, 0.62, 0.44), 0.01);
    frame.part = 1;
    frame.card(DVec3::new(0.021, -0.55, -0.37), DVec3::Y * 1.1, DVec3::Z * 0.74, DVec3::X);
    let frame = builder.mesh(frame);
    for (i, along) in [-0.55, 0.0, 0.55].into_iter().enumerate() {
        let on_west = DVec3::new(-half + 0.022, along * half, 1.9);
        builder.prop(frame, placed(on_west, 0.0, 1.0), Painting { seed: 130 + i as u32 });
        let on_north = DVec3::new(along * half, half - 0.022, 1.95);
        builder.prop(frame, placed(on_north, -0.5 * PI, 1.0), Painting { seed: 140 + i as u32 });
    }
    let mut board = MeshBuilder::new();
    board.block(DVec3::Z * 0.48, DVec3::new(0.24, 0.95, 0.4), 0.012);
    board.block(DVec3::Z * 0.9, DVec3::new(0.27, 1.0, 0.02), 0.01);
    for y in [-0.64, 0.0, 0.64] {
        board.block(DVec3::new(0.25, y, 0.48), DVec3::new(0.012, 0.29, 0.34), 0.01);
    }
    let board = builder.mesh(board);
    let look = WoodLook { tone: srgb(0x6E4428), cloth: Vec3::ZERO, seed: 150 };
    builder.prop(board, placed(DVec3::new(-half + 0.3, 0.28 * half, 0.0), 0.0, 1.0), look);
    let mut pot = MeshBuilder::new();
    pot.lathe(DVec3::ZERO, DVec3::Z, &[(0.0, 0.0), (0.17, 0.0), (0.24, 0.42), (0.21, 0.42), (0.0, 0.38)], 28, false);
    pot.part = 1;
    for i in 0..16 {
        let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
        let reach = 0.12 + 0.02 * f64::from(i % 6);
        let at = DVec3::new(reach * cos, reach * sin, 0.6 + 0.05 * f64::from(i));
        let lean = glam::DMat3::from_rotation_z(f64::from(i) * 2.4) * glam::DMat3::from_rotation_y(0.6);
        pot.ellipsoid(at, lean, DVec3::new(0.22, 0.09, 0.025), (10, 14));
    }
    let pot = builder.mesh(pot);
    let potted = |spot: &Spot| match spot.part {
        0 => Surface::coated(srgb(0xB8663E), 0.03),
        _ => Surface::coated(srgb(0x3E6A34) * (1.0 + 0.5 * fractal(spot.position, 0.1, 2, spot.footprint, 151)), 0.03),
    };
    for (x, y) in [(-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)] {
        builder.prop(pot, placed(DVec3::new((half - 0.5) * x, (half - 0.5) * y, 0.0), x + y, 1.0), potted);
    }
}

fn walls(spot: &Spot) -> Surface {
    match spot.part {
        PANEL => wood(spot, Vec3::Z, srgb(0x7E5636), 121),
        FRAME => Surface::coated(srgb(0xE4E0D6), 0.03),
        CEILING => plaster(spot, srgb(0xE8E2D4), 122),
        BEAM => wood(spot, Vec3::Y, srgb(0x6A4A30), 123),
        _ => plaster(spot, srgb(0xDDCBA8), 124),
    }
}

/// Boards 14 cm wide and 2.2 m long, each with its own tone.
fn planks(spot: &Spot) -> Surface {
    let p = spot.position;
    let (width, length) = (0.14, 2.2);
    let row = (p.y / width).floor();
    let shifted = p.x + length * hash_unit(IVec3::new(row as i32, 0, 0), 125);
    let board = IVec3::new((shifted / length).floor() as i32, row as i32, 1);
    let tone = 1.0 + 0.45 * (hash_unit(board, 126) - 0.5) * super::super::noise::resolved(width, spot.footprint);
    let joint = grid_line(p.y, width, 0.005, spot.footprint).max(grid_line(shifted, length, 0.005, spot.footprint));
    let moved = Spot { position: p + Vec3::splat(hash_unit(board, 127) * 9.0), ..*spot };
    let grain = wood(&moved, Vec3::X, srgb(0xB48656), 128);
    Surface::coated(grain.albedo * tone * (1.0 - 0.6 * joint), 0.03)
}

/// A landscape in oil: bands of colour with wandering edges.
struct Painting {
    seed: u32,
}

impl super::super::look::Look for Painting {
    fn surface(&self, spot: &Spot) -> Surface {
        if spot.part == 0 {
            return Surface::coated(srgb(0x5A3C22), 0.04);
        }
        let p = spot.position;
        let edge = |height: f32, size: f32, seed: u32| {
            p.z < height + 0.22 * fractal(Vec3::new(p.y, 0.0, 0.0), size, 4, spot.footprint, self.seed + seed)
        };
        let pick = |colors: [u32; 3]| srgb(colors[self.seed as usize % 3]);
        let base = match () {
            () if edge(-0.18, 0.5, 1) => pick([0x4C6234, 0x8A6A3A, 0x35506A]),
            () if edge(0.0, 0.35, 2) => pick([0x6E8A50, 0xB0804A, 0x5E7E8A]),
            () if edge(0.12, 0.6, 3) => pick([0x7E90A0, 0x8E6A6A, 0x8AA0A8]),
            () => pick([0xC8D4DC, 0xE8C890, 0xE0D8C4]),
        };
        Surface::coated(base * (1.0 + 0.35 * fractal(p, 0.07, 3, spot.footprint, self.seed + 4)), 0.03)
    }
}
