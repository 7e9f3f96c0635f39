//! A shelf of a shop: cartons, bottles and cans side by side, three groups in which only the labels differ.

use std::f64::consts::FRAC_PI_2;

use glam::{DVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::models::goods::{KINDS, Label, bottle, can, carton, palette};
use super::super::models::props;
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring, Sweep};
use instgs_vk::math::rng::Rng;

/// Distance of boards, metres.
const STOREY: f64 = 0.38;
/// Height of the lowest board, metres.
const LOWEST: f64 = 0.25;
/// Thickness of a board, metres.
const BOARD: f64 = 0.025;
/// Depth of the boards, metres.
const DEPTH: f64 = 0.34;

pub(super) fn build(seed: u64, count: u32) -> Scene {
    shelf(seed, count, false)
}

/// The same from close by: few packages fit into a photo.
pub(super) fn build_sparse(seed: u64, count: u32) -> Scene {
    shelf(seed, count, true)
}

fn shelf(seed: u64, count: u32, sparse: bool) -> Scene {
    let mut rng = Rng::new(seed).fork(8);
    let mut builder = SceneBuilder::new();
    // A quarter of the packages on each board: runs of one kind, as in a shop.
    let boards = 4u32;
    let shapes = [carton(), bottle(), can()].map(|mesh| builder.mesh(mesh));
    let mut placements: Vec<(usize, f64, u32)> = Vec::new();
    let mut width: f64 = 0.0;
    for board in 0..boards {
        let on_board = count / boards + u32::from(board < count % boards);
        let mut x = 0.0;
        for i in 0..on_board {
            let kind = ((i * 3 / on_board + board) % 3) as usize;
            placements.push((kind, x + 0.5 * KINDS[kind].1, board));
            x += KINDS[kind].1;
        }
        width = width.max(x);
    }
    for kind in 0..3 {
        for &(_, x, board) in placements.iter().filter(|(of, ..)| *of == kind) {
            let (name, _, place) = KINDS[kind];
            let height = LOWEST + STOREY * f64::from(board) + BOARD;
            let depth = -0.5 * DEPTH + [0.06, 0.065, 0.065][kind] + rng.range(0.0, 0.025);
            let at = DVec3::new(x - 0.5 * width + rng.range(-0.006, 0.006), depth, height);
            let paper = rng.index(8);
            let label = Label {
                place,
                body: [palette(paper + 1), srgb(0x3E6A3A), srgb(0xB8B8BC)][kind],
                lid: palette(rng.index(8)),
                paper: palette(paper),
                print: palette(paper + 1 + rng.index(7)),
                number: rng.index(100) as u32,
                pattern: rng.index(3) as u32,
            };
            builder.object(name, vec![shapes[kind]], placed(at, rng.range(-0.12, 0.12), 1.0), label);
        }
    }
    let top = LOWEST + STOREY * f64::from(boards) + BOARD;
    rack(&mut builder, width, top, boards);
    let middle = DVec3::new(0.0, -0.1, 0.5 * (LOWEST + top));
    let reach = width.max(top);
    let ring = |distance: f64, height: f64| Ring { distance: reach * distance, height: top * height };
    let rings = vec![ring(0.75, 0.55), ring(0.9, 0.85), ring(0.65, 0.4), ring(0.8, 1.1), ring(0.7, 0.7)];
    let look = DVec3::new(0.0, 0.46, -0.05);
    let sweep = sparse.then(|| Sweep {
        corner: DVec3::new(-0.5 * width, -0.5 * DEPTH - look.y, LOWEST + 0.1),
        along: DVec3::X * width,
        across: DVec3::Z * (top - LOWEST),
        // Test views are every eighth: with one more line than boards they do not all begin one.
        lines: boards + 1,
        look,
    });
    let rig = Rig { target: middle, stray: 0.16 * reach, rings, azimuths: (-FRAC_PI_2, 1.7), sweep };
    let light = Daylight {
        ambient: Vec3::splat(0.25),
        sun: Vec3::new(1.25, 1.2, 1.1),
        sun_radius: 0.08,
        ..Daylight::afternoon(-70.0, 48.0)
    };
    builder.finish(light, rig, 0.011 * reach as f32, 2.2 * reach as f32)
}

/// Boards, sides and back of the rack, a floor, and a wall behind.
fn rack(builder: &mut SceneBuilder, width: f64, top: f64, boards: u32) {
    let mut b = MeshBuilder::new();
    let half = 0.5 * width + 0.02;
    for board in 0..=boards {
        let z = LOWEST + STOREY * f64::from(board) + 0.5 * BOARD;
        b.block(DVec3::new(0.0, 0.0, z), DVec3::new(half, 0.5 * DEPTH, 0.5 * BOARD), 0.003);
    }
    for side in [-1.0, 1.0] {
        b.block(
            DVec3::new(side * (half + 0.015), 0.0, 0.5 * top),
            DVec3::new(0.015, 0.5 * DEPTH + 0.01, 0.5 * top),
            0.004,
        );
    }
    b.part = 1;
    b.block(DVec3::new(0.0, 0.5 * DEPTH, 0.5 * top), DVec3::new(half, 0.008, 0.5 * top), 0.0);
    let mesh = builder.mesh(b);
    builder.prop(mesh, placed(DVec3::ZERO, 0.0, 1.0), |spot: &Spot| match spot.part {
        0 => wood(spot, Vec3::X, srgb(0xC8B490), 301),
        _ => Surface::matt(srgb(0xB4B0A8)),
    });
    let mut wall = MeshBuilder::new();
    let reach = 6.0 * width.max(top);
    let corner = DVec3::new(-reach, 0.5 * DEPTH + 0.05, 0.0);
    wall.card(corner, DVec3::X * 2.0 * reach, DVec3::Z * reach, -DVec3::Y);
    let wall = builder.mesh(wall);
    builder.prop(wall, placed(DVec3::ZERO, 0.0, 1.0), |_: &Spot| Surface::matt(srgb(0xD8D2C4)));
    let floor = builder.mesh(props::ground(reach));
    builder.prop(floor, placed(DVec3::ZERO, 0.0, 1.0), |_: &Spot| Surface::matt(srgb(0x9A948A)));
}
