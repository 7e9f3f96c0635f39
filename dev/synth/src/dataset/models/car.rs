//! The racing car of [`crate::car`] as a mesh: one body, wings of two heights, a roof rack, and liveries.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3, Vec2};

use super::super::look::{Look, Spot, Surface};
use super::super::mesh::MeshBuilder;
use super::super::noise::band;
use crate::car::{
    ARCH_RADIUS, AXLE_X, CarSurfel, Part, TYRE, WHEEL_RADIUS, WHEEL_Y, body_point, cabin_part, cabin_point, ends,
    has_skin, skin_part, skin_point, tail_part,
};
use crate::livery::Livery;
use crate::surface::Surfel;

// Tags of the triangles.
const SKIN: u8 = 0;
const TAIL: u8 = 1;
const CABIN: u8 = 2;
const TYRES: u8 = 3;
const RIMS: u8 = 4;
const CARBON: u8 = 5;
const WING: u8 = 6;
const PAINTED: u8 = 7;
const RACK: u8 = 8;

/// The parts that all cars have in common.
pub fn body() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let as_surfel = |position: DVec3, normal: DVec3| Surfel { position, normal, spacing: 0.0 };
    b.part = SKIN;
    b.patch((72, 200), skin_point, |p, n| has_skin(&as_surfel(p, n)));
    let (rear, front) = ends();
    b.patch((48, 6), |u, v| body_point(front, TAU * u, 1.0 - v), |_, _| true);
    b.part = TAIL;
    b.patch((48, 6), |u, v| body_point(rear, TAU * u, v), |_, _| true);
    b.part = CABIN;
    b.patch((40, 64), cabin_point, |_, _| true);
    b.part = CARBON;
    b.block(DVec3::new(-0.1, 0.0, 0.16), DVec3::new(2.1, 0.78, 0.02), 0.01);
    b.block(DVec3::new(2.06, 0.0, 0.115), DVec3::new(0.27, 0.74, 0.015), 0.01);
    b.block(DVec3::new(-2.20, 0.0, 0.26), DVec3::new(0.16, 0.78, 0.02), 0.01);
    for side in [1.0, -1.0] {
        b.part = CARBON;
        b.block(DVec3::new(0.0, 0.87 * side, 0.135), DVec3::new(0.92, 0.05, 0.02), 0.015);
        b.block(DVec3::new(0.52, 0.72 * side, 0.88), DVec3::new(0.02, 0.08, 0.012), 0.01);
        b.part = PAINTED;
        b.block(DVec3::new(0.52, 0.86 * side, 0.93), DVec3::new(0.05, 0.09, 0.045), 0.03);
        wheel(&mut b, DVec3::new(AXLE_X, WHEEL_Y * side, WHEEL_RADIUS));
        wheel(&mut b, DVec3::new(-AXLE_X, WHEEL_Y * side, WHEEL_RADIUS));
    }
    b
}

fn wheel(b: &mut MeshBuilder, hub: DVec3) {
    let outward = DVec3::Y * hub.y.signum();
    b.part = TYRES;
    b.lathe(hub, outward, &TYRE, 40, true);
    b.part = RIMS;
    b.lathe(hub, outward, &[(0.218, 0.095), (0.15, 0.065), (0.06, 0.075), (0.0, 0.08)], 32, true);
    b.part = CARBON;
    // The back of the wheel arch.
    b.lathe(hub, outward, &[(ARCH_RADIUS + 0.02, -0.02), (ARCH_RADIUS + 0.02, -0.17), (0.0, -0.17)], 32, false);
}

/// The rear wing, `raised` metres above its normal position.
pub fn wing(raised: f64) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = WING;
    let up = DVec3::Z * raised;
    b.rounded_box(DVec3::new(-2.12, 0.0, 1.19) + up, DMat3::from_rotation_y(0.16), DVec3::new(0.19, 0.92, 0.02), 0.015);
    for side in [1.0, -1.0] {
        let plate = DVec3::new(-2.12, 0.93 * side, 1.14);
        b.block(plate + up, DVec3::new(0.23, 0.012, 0.13), 0.01);
        let strut = DVec3::new(-2.02, 0.34 * side, 1.02 + 0.5 * raised);
        b.rounded_box(strut, DMat3::from_rotation_y(-0.30), DVec3::new(0.07, 0.016, 0.17 + 0.5 * raised), 0.012);
    }
    b
}

/// A rack on the roof with a bag on it.
pub fn roof_rack() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = RACK;
    for side in [1.0, -1.0] {
        b.limb(DVec3::new(-0.95, 0.42 * side, 1.24), DVec3::new(0.12, 0.42 * side, 1.24), (0.02, 0.02), 10);
        for x in [-0.85, 0.02] {
            b.limb(DVec3::new(x, 0.42 * side, 1.0), DVec3::new(x, 0.42 * side, 1.24), (0.018, 0.018), 8);
        }
    }
    for x in [-0.85, -0.42, 0.02] {
        b.limb(DVec3::new(x, -0.46, 1.245), DVec3::new(x, 0.46, 1.245), (0.018, 0.018), 8);
    }
    b.part = PAINTED;
    b.block(DVec3::new(-0.42, 0.0, 1.35), DVec3::new(0.46, 0.30, 0.09), 0.07);
    b
}

/// Paint and start number of one car.
pub struct CarLook {
    /// Colours and pattern of the paint.
    pub livery: Livery,
    /// Start number, 0..=99.
    pub number: u32,
}

impl Look for CarLook {
    fn surface(&self, spot: &Spot) -> Surface {
        let surfel = Surfel {
            position: spot.position.as_dvec3(),
            normal: spot.normal.as_dvec3(),
            spacing: f64::from(spot.footprint),
        };
        let part = match spot.part {
            SKIN => skin_part(&surfel),
            TAIL => tail_part(&surfel),
            CABIN => cabin_part(&surfel),
            TYRES => Part::Tyre,
            RIMS if is_spoke(spot) => Part::Rim,
            WING => Part::Wing,
            PAINTED => Part::Paint,
            _ => Part::Carbon,
        };
        if part == Part::Paint
            && spot.part == SKIN
            && let Some(sign) = self.roundel(spot)
        {
            return Surface::coated(sign, 0.045);
        }
        let albedo = self.livery.albedo_of(&CarSurfel { surfel, part }).as_vec3();
        match part {
            Part::Tyre => Surface::matt(albedo * 1.6),
            Part::Carbon => Surface::coated(albedo * 1.3, 0.02),
            Part::Glass => Surface::coated(albedo, 0.08),
            _ => Surface::coated(albedo, 0.045),
        }
    }
}

impl CarLook {
    /// Colour of the white discs with the number on doors and bonnet; `None` outside of them.
    fn roundel(&self, spot: &Spot) -> Option<glam::Vec3> {
        let p = spot.position;
        let (at, radius) = match () {
            () if spot.normal.y.abs() > 0.6 => (Vec2::new(-(p.x + 0.05) * p.y.signum(), p.z - 0.53), 0.20),
            () if spot.normal.z > 0.5 && p.x > 1.1 => (Vec2::new(p.y, p.x - 1.42), 0.22),
            () => return None,
        };
        if at.length() >= radius {
            return None;
        }
        let ink = number_ink(at / radius, self.number, spot.footprint / radius);
        Some(glam::Vec3::splat(0.80 + (0.015 - 0.80) * ink))
    }
}

/// Whether a point is on one of the five broad spokes, the rim or the hub.
fn is_spoke(spot: &Spot) -> bool {
    let p = spot.position.as_dvec3();
    let from_hub = DVec2::new(p.x - AXLE_X * p.x.signum(), p.z - WHEEL_RADIUS);
    let spoke = (from_hub.y.atan2(from_hub.x) * 5.0 / TAU).rem_euclid(1.0);
    spoke < 0.45 || !(0.055..=0.195).contains(&from_hub.length())
}

/// Segments a to g of the digits 0 to 9, as bits.
const SEGMENTS: [u8; 10] = [0x3F, 0x06, 0x5B, 0x4F, 0x66, 0x6D, 0x7D, 0x07, 0x7F, 0x6F];

/// Ink of one or two seven-segment digits in the unit disc, 0..=1.
pub fn number_ink(at: Vec2, number: u32, footprint: f32) -> f32 {
    let two = number >= 10;
    let digit = |value: u32, middle: f32| digit_ink(at - Vec2::new(middle, 0.0), value % 10, footprint);
    if two { digit(number / 10, -0.36).max(digit(number, 0.36)) } else { digit(number, 0.0) }
}

fn digit_ink(at: Vec2, digit: u32, footprint: f32) -> f32 {
    const HALF: Vec2 = Vec2::new(0.22, 0.48);
    const STROKE: f32 = 0.085;
    let bar =
        |centre: Vec2, half: Vec2| band(at.x, centre.x, half.x, footprint) * band(at.y, centre.y, half.y, footprint);
    let level = |y: f32| bar(Vec2::new(0.0, y), Vec2::new(HALF.x + STROKE, STROKE));
    let side = |x: f32, y: f32| bar(Vec2::new(x, y), Vec2::new(STROKE, 0.5 * HALF.y + STROKE));
    let (w, h) = (HALF.x, 0.5 * HALF.y);
    let strokes = [level(HALF.y), side(w, h), side(w, -h), level(-HALF.y), side(-w, -h), side(-w, h), level(0.0)];
    let lit = SEGMENTS[digit as usize];
    strokes.iter().enumerate().filter(|(i, _)| lit >> i & 1 == 1).fold(0.0, |ink, (_, s)| ink.max(*s))
}
