//! A car park with racing cars: the same body, but different colours, numbers, wings and roof racks.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};

use super::super::light::Daylight;
use super::super::look::{Spot, Surface, grass, srgb};
use super::super::models::{car, props, tree};
use super::super::noise::{band, fractal, smooth_step};
use super::super::scene_builder::{Scene, SceneBuilder, placed};
use super::super::views::{Rig, Ring};
use crate::livery::{Livery, Wing};
use instgs_vk::math::rng::Rng;

/// Radius of the two discs that a car consists of, and their distance from its centre, metres.
const DISC: (f64, f64) = (1.45, 1.15);

pub(super) fn build(seed: u64, count: u32) -> Scene {
    let mut rng = Rng::new(seed).fork(1);
    let mut builder = SceneBuilder::new();
    let (places, extent) = parked(&mut rng, count as usize);
    let body = builder.mesh(car::body());
    let wings = [car::wing(0.0), car::wing(0.13)].map(|wing| builder.mesh(wing));
    let rack = builder.mesh(car::roof_rack());
    for (i, &(at, yaw)) in places.iter().enumerate() {
        let livery = Livery { roundels: false, ..Livery::drawn(i, &mut rng) };
        let mut meshes = vec![body];
        match livery.wing {
            Wing::Removed => {}
            Wing::Raised(by) => meshes.push(wings[usize::from(by > 0.0)]),
        }
        if i % 4 == 2 {
            meshes.push(rack);
        }
        let number = 1 + (rng.index(12) as u32 + 13 * i as u32) % 99;
        builder.object("car", meshes, placed(at.extend(0.0), yaw, 1.0), car::CarLook { livery, number });
    }
    surroundings(&mut builder, &mut rng, extent);
    let ring = |distance: f64, height: f64| Ring { distance: extent * distance, height: extent * height };
    let rings = vec![ring(1.28, 0.20), ring(1.15, 0.48), ring(1.5, 0.34), ring(1.3, 0.75), ring(0.95, 0.95)];
    let rig = Rig { target: DVec3::Z * 0.4, stray: 0.14 * extent, rings, azimuths: (0.0, TAU), sweep: None };
    builder.finish(Daylight::afternoon(-52.0, 42.0), rig, 0.011 * extent as f32, 2.2 * extent as f32)
}

/// Places (centre, yaw) of cars that do not touch, and the radius of the disc that contains them.
fn parked(rng: &mut Rng, count: usize) -> (Vec<(DVec2, f64)>, f64) {
    let discs = |(at, yaw): (DVec2, f64)| [1.0, -1.0].map(|side| at + DVec2::from_angle(yaw) * (side * DISC.1));
    let mut extent = 2.55 * (count as f64).sqrt() + 0.6;
    let mut places: Vec<(DVec2, f64)> = Vec::new();
    while places.len() < count {
        let middle = DVec2::from_angle(rng.range(0.0, TAU)) * (extent * rng.uniform().sqrt());
        let new = (middle, rng.range(-PI, PI));
        let free =
            |old: &(DVec2, f64)| discs(*old).iter().all(|a| discs(new).iter().all(|b| a.distance(*b) > 2.0 * DISC.0));
        if places.iter().all(free) {
            places.push(new);
        } else {
            // A full park grows until all cars have a place.
            extent *= 1.0005;
        }
    }
    (places, extent + 2.3)
}

pub(super) fn surroundings(builder: &mut SceneBuilder, rng: &mut Rng, extent: f64) {
    let ground = builder.mesh(props::ground(12.0 * extent));
    builder.prop(ground, placed(DVec3::ZERO, 0.0, 1.0), Park { extent: extent as f32 });
    let around = |turn: f64, distance: f64| (DVec2::from_angle(turn) * distance * extent).extend(0.0);
    let cone = builder.mesh(props::cone());
    for i in 0..6 {
        let turn = TAU * (f64::from(i) + rng.uniform() * 0.6) / 6.0;
        builder.prop(cone, placed(around(turn, rng.range(1.0, 1.06)), turn, 1.0), props::cone_look);
    }
    let stack = builder.mesh(props::tyre_stack(4));
    for turn in [0.5, 0.56, 2.7, 4.4] {
        builder.prop(stack, placed(around(turn, 1.04), turn, 1.0), props::tyre_look);
    }
    let barrier = builder.mesh(props::barrier(3.4));
    for i in 0..14 {
        let turn = TAU * (f64::from(i) + 0.5) / 14.0;
        if i % 5 != 3 {
            let place = placed(around(turn, 1.75), turn + 0.5 * PI, 1.0);
            builder.prop(barrier, place, props::barrier_look);
        }
    }
    let lamp = builder.mesh(props::lamp_post());
    for turn in [1.1, 3.9] {
        builder.prop(lamp, placed(around(turn, 1.9), turn + PI, 1.0), props::lamp_look);
    }
    let shape = builder.mesh(tree::tree(11, 130));
    for i in 0..7 {
        let turn = TAU * (f64::from(i) + 0.7 * rng.uniform()) / 7.0;
        let place = placed(around(turn, rng.range(2.1, 2.5)), turn, rng.range(1.5, 2.3));
        let look = tree::TreeLook { leaf: srgb(0x5C7C2E), fruit: srgb(0x5C7C2E), seed: i };
        builder.prop(shape, place, look);
    }
}

/// Asphalt with the lines of a car park, a kerb, and grass around.
struct Park {
    extent: f32,
}

impl super::super::look::Look for Park {
    fn surface(&self, spot: &Spot) -> Surface {
        let p = spot.position;
        let from_middle = p.truncate().length();
        let edge = 1.95 * self.extent + 0.8 * fractal(p, 4.0, 3, spot.footprint, 4);
        let green = smooth_step(-0.15, 0.15, from_middle - edge);
        if green >= 1.0 {
            return Surface::matt(grass(spot, 6));
        }
        let asphalt = props::asphalt(spot);
        let worn = 0.85 - 0.6 * smooth_step(0.0, 0.5, fractal(p, 0.7, 4, spot.footprint, 44));
        let painted = asphalt.lerp(Vec3::splat(0.62), worn * self.lines(p, spot.footprint));
        Surface::matt(painted.lerp(grass(spot, 6), green))
    }
}

impl Park {
    /// Paint of bays of 5.2 m by 2.7 m on both sides of a lane, 0..=1.
    fn lines(&self, p: Vec3, footprint: f32) -> f32 {
        let reach = 1.35 * self.extent;
        if p.x.abs() > reach || p.y.abs() > reach {
            return 0.0;
        }
        let row = p.y.rem_euclid(8.7);
        let cross = (p.x / 2.7 - (p.x / 2.7).round()) * 2.7;
        let bay = if row < 5.2 { band(cross, 0.0, 0.05, footprint) } else { 0.0 };
        bay.max(band(row, 0.05, 0.05, footprint))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parked_cars_do_not_touch() {
        for count in [2, 8, 64] {
            let (places, extent) = parked(&mut Rng::new(1), count);
            assert_eq!(places.len(), count);
            for (i, a) in places.iter().enumerate() {
                assert!(a.0.length() + 2.3 <= extent + 1e-9);
                assert!(places[..i].iter().all(|b| a.0.distance(b.0) > 1.9));
            }
            assert!(extent < 4.5 * (count as f64).sqrt() + 4.0, "{count} {extent}");
        }
    }
}
