//! A house with a grid of windows: the same window, but different blinds, curtains and flower boxes.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, plaster, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::models::window::{HALF, WindowLook, blind, flower_box, window};
use super::super::models::{props, tree};
use super::super::noise::{fractal, grid_line, hash_unit, smooth_step};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring};
use instgs_vk::math::rng::Rng;

/// Spacing of windows along the wall and upwards, metres.
const PITCH: (f64, f64) = (2.3, 2.9);
/// Height of the ground floor, which has a door but no windows of the grid, metres.
const GROUND_FLOOR: f64 = 3.3;
/// Depth of the house, metres.
const DEPTH: f64 = 6.0;
/// Thickness of its front wall, metres.
const WALL: f64 = 0.22;
const CURTAINS: [u32; 6] = [0xE8E2D4, 0xC8513F, 0x5F86A8, 0xE0B34C, 0x7E9C6A, 0xB58AA8];
const BLOSSOMS: [u32; 4] = [0xD8263A, 0xE86AA0, 0xF0D040, 0xE8E4F4];

/// Measures of the front wall, metres.
#[derive(Clone, Copy)]
struct Wall {
    columns: u32,
    rows: u32,
    half_width: f64,
    height: f64,
}

pub(super) fn build(seed: u64, count: u32) -> Scene {
    let mut rng = Rng::new(seed).fork(4);
    let mut builder = SceneBuilder::new();
    let columns = ((f64::from(count) * 1.6).sqrt().ceil() as u32).min(count);
    let rows = count.div_ceil(columns);
    let half_width = 0.5 * PITCH.0 * f64::from(columns) + 0.45;
    let wall = Wall { columns, rows, half_width, height: GROUND_FLOOR + PITCH.1 * f64::from(rows) + 0.35 };
    windows(&mut builder, &mut rng, wall, count);
    house(&mut builder, wall, count);
    street(&mut builder, &mut rng, wall);
    let reach = half_width.max(0.75 * wall.height);
    let ring = |distance: f64, height: f64| Ring { distance: reach * distance + 2.0, height };
    let top = wall.height;
    let rings = vec![
        ring(1.35, 0.35 * top),
        ring(1.6, 1.7),
        ring(1.15, 0.75 * top),
        ring(1.45, 1.05 * top),
        ring(1.8, 0.5 * top),
    ];
    let rig = Rig {
        target: DVec3::new(0.0, 0.0, 0.52 * top),
        stray: 0.12 * reach,
        rings,
        azimuths: (-0.5 * PI, 2.0),
        sweep: None,
    };
    builder.finish(Daylight::afternoon(-125.0, 44.0), rig, 0.0105 * reach as f32, (1.9 * reach + 4.0) as f32)
}

/// Centre of the opening at an index of the grid, on the wall's face y = 0.
fn opening(wall: Wall, place: u32) -> DVec3 {
    let (column, row) = (place % wall.columns, place / wall.columns);
    let x = PITCH.0 * (f64::from(column) - 0.5 * f64::from(wall.columns - 1));
    DVec3::new(x, 0.0, GROUND_FLOOR + PITCH.1 * (f64::from(row) + 0.5))
}

fn windows(builder: &mut SceneBuilder, rng: &mut Rng, wall: Wall, count: u32) {
    let shape = builder.mesh(window());
    let blinds = [0.22, 0.45, 0.7].map(|part| builder.mesh(blind(part)));
    let flowers = builder.mesh(flower_box());
    for place in 0..count {
        let mut meshes = vec![shape];
        if rng.chance(0.45) {
            meshes.push(blinds[rng.index(3)]);
        }
        if rng.chance(0.35) {
            meshes.push(flowers);
        }
        let look = WindowLook {
            curtain: srgb(CURTAINS[rng.index(CURTAINS.len())]),
            gap: rng.range(0.05, 0.42) as f32,
            blossom: srgb(BLOSSOMS[rng.index(BLOSSOMS.len())]),
            blind: srgb(0xC9C2B0),
        };
        builder.object("window", meshes, placed(opening(wall, place), 0.0, 1.0), look);
    }
}

/// The front with its openings, the other walls, roof, cornices, plinth and door.
fn house(builder: &mut SceneBuilder, wall: Wall, count: u32) {
    let mut b = MeshBuilder::new();
    let (w, h) = HALF;
    for place in 0..wall.columns * wall.rows {
        let middle = opening(wall, place) + DVec3::Y * 0.5 * WALL;
        let half = DVec3::new(0.5 * PITCH.0, 0.5 * WALL, 0.5 * PITCH.1);
        if place >= count {
            b.block(middle, half, 0.0);
            continue;
        }
        for side in [-1.0, 1.0] {
            let beside = 0.5 * (half.x - w);
            b.block(middle + DVec3::X * side * (w + beside), DVec3::new(beside, half.y, half.z), 0.0);
            let above = 0.5 * (half.z - h);
            b.block(middle + DVec3::Z * side * (h + above), DVec3::new(w, half.y, above), 0.0);
        }
    }
    let front = |x: f64, z0: f64, z1: f64, half: f64| {
        (DVec3::new(x, 0.5 * WALL, 0.5 * (z0 + z1)), DVec3::new(half, 0.5 * WALL, 0.5 * (z1 - z0)))
    };
    let edge = 0.5 * (wall.half_width - 0.5 * PITCH.0 * f64::from(wall.columns));
    for side in [-1.0, 1.0] {
        let (centre, half) = front(side * (wall.half_width - edge), GROUND_FLOOR, wall.height, edge);
        b.block(centre, half, 0.0);
        // Side walls of the house.
        b.block(
            DVec3::new(side * (wall.half_width - 0.1), 0.5 * DEPTH, 0.5 * wall.height),
            DVec3::new(0.1, 0.5 * DEPTH, 0.5 * wall.height),
            0.0,
        );
    }
    let (centre, half) = front(0.0, wall.height - 0.35, wall.height, wall.half_width);
    b.block(centre, half, 0.0);
    b.part = 1;
    let (centre, half) = front(0.0, 0.0, GROUND_FLOOR, wall.half_width);
    b.block(centre, half, 0.0);
    b.part = 2;
    for (z, out) in [(GROUND_FLOOR + 0.08, 0.10), (wall.height, 0.22), (wall.height + 0.16, 0.32)] {
        b.block(
            DVec3::new(0.0, 0.5 * DEPTH - 0.5 * out, z),
            DVec3::new(wall.half_width + out, 0.5 * (DEPTH + out), 0.09),
            0.03,
        );
    }
    door(&mut b);
    let mesh = builder.mesh(b);
    builder.prop(mesh, placed(DVec3::ZERO, 0.0, 1.0), masonry);
}

/// A panelled door with a frame, a canopy and two steps, which stands out from the wall.
fn door(b: &mut MeshBuilder) {
    b.part = 2;
    for side in [-1.0, 1.0] {
        b.block(DVec3::new(0.78 * side, -0.06, 1.3), DVec3::new(0.13, 0.08, 1.3), 0.02);
    }
    b.block(DVec3::new(0.0, -0.10, 2.68), DVec3::new(1.1, 0.16, 0.09), 0.03);
    b.block(DVec3::new(0.0, -0.35, 0.08), DVec3::new(1.0, 0.35, 0.08), 0.015);
    b.block(DVec3::new(0.0, -0.50, 0.04), DVec3::new(1.25, 0.50, 0.04), 0.015);
    b.part = 3;
    b.block(DVec3::new(0.0, -0.02, 1.38), DVec3::new(0.66, 0.04, 1.22), 0.01);
    for (x, z, half) in [(-0.32, 0.75, 0.38), (0.32, 0.75, 0.38), (-0.32, 1.85, 0.55), (0.32, 1.85, 0.55)] {
        b.block(DVec3::new(x, -0.06, z), DVec3::new(0.22, 0.02, half), 0.015);
    }
    b.part = 4;
    b.ellipsoid(DVec3::new(0.06, -0.10, 1.25), glam::DMat3::IDENTITY, DVec3::splat(0.045), (10, 16));
}

/// Bricks above, dressed stone below, plaster on cornices, a painted door.
fn masonry(spot: &Spot) -> Surface {
    match spot.part {
        0 => bricks(spot),
        1 => {
            let p = spot.position;
            let course = (p.z / 0.55).floor();
            let joint = grid_line(p.z, 0.55, 0.025, spot.footprint).max(grid_line(
                p.x + 0.55 * (course as i32 & 1) as f32,
                1.1,
                0.025,
                spot.footprint,
            ));
            let mut stone = plaster(spot, srgb(0xC2B59C), 81);
            stone.albedo *= 1.0 - 0.45 * joint;
            stone
        }
        2 => plaster(spot, srgb(0xD6CEBC), 82),
        3 => wood(spot, Vec3::Z, srgb(0x2F5A4C), 83),
        _ => Surface::coated(srgb(0xC8A448), 0.3),
    }
}

fn bricks(spot: &Spot) -> Surface {
    let p = spot.position;
    // Along the wall, whichever way it faces.
    let along = if spot.normal.y.abs() > 0.5 { p.x } else { p.y };
    let (length, height) = (0.25, 0.083);
    let course = (p.z / height).floor();
    let shifted = along + 0.5 * length * (course as i32 & 1) as f32;
    let joint = grid_line(p.z, height, 0.012, spot.footprint).max(grid_line(shifted, length, 0.012, spot.footprint));
    let shown = super::super::noise::resolved(length, spot.footprint);
    let tone = shown * (hash_unit(glam::IVec3::new((shifted / length).floor() as i32, course as i32, 0), 84) - 0.5);
    let weather = fractal(p, 1.8, 4, spot.footprint, 85);
    let brick = srgb(0xB0694C) * (1.0 + 0.55 * tone + 0.35 * weather);
    Surface::matt(brick.lerp(srgb(0xC9BFB0), 0.85 * joint))
}

fn street(builder: &mut SceneBuilder, rng: &mut Rng, wall: Wall) {
    let ground = builder.mesh(props::ground(150.0));
    builder.prop(ground, placed(DVec3::ZERO, 0.0, 1.0), pavement);
    let lamp = builder.mesh(props::lamp_post());
    let shape = builder.mesh(tree::tree(13, 130));
    let bench = builder.mesh(bench());
    for side in [-1.0, 1.0] {
        let x = side * (0.62 * wall.half_width);
        builder.prop(
            lamp,
            placed(DVec3::new(side * (wall.half_width + 1.2), -3.0, 0.0), -0.5 * PI, 0.9),
            props::lamp_look,
        );
        builder.prop(bench, placed(DVec3::new(x, -0.75, 0.0), 0.0, 1.0), |spot: &Spot| match spot.part {
            0 => wood(spot, Vec3::X, srgb(0x8A5A34), 86),
            _ => Surface::matt(srgb(0x2C2E30)),
        });
        for back in [2.5, 9.0] {
            let at = DVec3::new(side * (wall.half_width + rng.range(2.6, 4.5)), back + rng.range(-1.0, 1.0), 0.0);
            let look = tree::TreeLook { leaf: srgb(0x5C7C30), fruit: srgb(0x5C7C30), seed: 87 };
            builder.prop(shape, placed(at, rng.range(0.0, 6.0), rng.range(1.3, 1.9)), look);
        }
    }
}

fn bench() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    for y in [-0.18, 0.0, 0.18] {
        b.block(DVec3::new(0.0, y, 0.45), DVec3::new(0.85, 0.075, 0.02), 0.01);
    }
    for z in [0.65, 0.82] {
        b.block(DVec3::new(0.0, 0.27, z), DVec3::new(0.85, 0.02, 0.06), 0.01);
    }
    b.part = 1;
    for x in [-0.65, 0.65] {
        b.block(DVec3::new(x, 0.0, 0.215), DVec3::new(0.03, 0.24, 0.215), 0.01);
        b.block(DVec3::new(x, 0.29, 0.55), DVec3::new(0.03, 0.015, 0.33), 0.01);
    }
    b
}

/// Slabs in front of the house, then a kerb and the road.
fn pavement(spot: &Spot) -> Surface {
    let p = spot.position;
    if p.y < -4.2 {
        let dash = p.y < -7.9 && p.y > -8.05 && (p.x / 2.4).rem_euclid(2.0) < 1.0;
        let road = props::asphalt(spot);
        return Surface::matt(if dash { road.lerp(Vec3::splat(0.6), 0.75) } else { road });
    }
    let stains = fractal(p, 2.2, 5, spot.footprint, 88);
    if p.y < -4.0 {
        let joint = grid_line(p.x, 1.0, 0.02, spot.footprint);
        return Surface::matt(srgb(0xBDB8AE) * (1.0 + 0.2 * stains) * (1.0 - 0.4 * joint));
    }
    let joint = grid_line(p.x, 0.6, 0.016, spot.footprint).max(grid_line(p.y, 0.6, 0.016, spot.footprint));
    let cell = glam::IVec3::new((p.x / 0.6).round() as i32, (p.y / 0.6).round() as i32, 1);
    let tone = 0.16 * (hash_unit(cell, 89) - 0.5) * smooth_step(0.6, 0.1, spot.footprint);
    Surface::matt(srgb(0xA9A399) * (1.0 + 0.3 * stains + tone) * (1.0 - 0.4 * joint))
}
