//! Two objects with nothing in common but their group: no shared template fits both.

use std::f64::consts::TAU;

use glam::DVec3;

use super::super::light::Daylight;
use super::super::look::srgb;
use super::super::models::{car, furniture};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring};
use super::cars::surroundings;
use crate::livery::Livery;
use instgs_vk::math::rng::Rng;

/// Radius of the disc that contains both, metres.
const EXTENT: f64 = 5.2;

pub(super) fn build(seed: u64, _count: u32) -> Scene {
    let mut rng = Rng::new(seed).fork(5);
    let mut builder = SceneBuilder::new();
    let body = builder.mesh(car::body());
    let wing = builder.mesh(car::wing(0.0));
    let livery = Livery { roundels: false, ..Livery::drawn(rng.index(12), &mut rng) };
    let look = car::CarLook { livery, number: 7 };
    builder.object("object", vec![body, wing], placed(DVec3::new(-1.4, -1.2, 0.0), rng.range(-0.6, 0.2), 1.0), look);
    let chair = builder.mesh(furniture::chair());
    let cushion = builder.mesh(furniture::cushion());
    let look = furniture::WoodLook { tone: srgb(0xA8743E), cloth: srgb(0x2E6E8E), seed: 3 };
    // A giant's chair, 2.2 m high: about as large in the pictures as the car.
    builder.object("object", vec![chair, cushion], placed(DVec3::new(1.7, 2.0, 0.0), rng.range(-2.2, -1.4), 2.3), look);
    surroundings(&mut builder, &mut rng, EXTENT);
    let ring = |distance: f64, height: f64| Ring { distance: EXTENT * distance, height: EXTENT * height };
    let rings = vec![ring(1.35, 0.25), ring(1.2, 0.55), ring(1.5, 0.4), ring(1.25, 0.85), ring(0.95, 1.05)];
    let rig = Rig { target: DVec3::Z * 0.6, stray: 0.5, rings, azimuths: (0.0, TAU), sweep: None };
    builder.finish(Daylight::afternoon(-52.0, 42.0), rig, 0.07, 2.2 * EXTENT as f32)
}
