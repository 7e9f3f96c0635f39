//! A theatre seat with a cushion that folds up.

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::super::look::{Look, Spot, Surface, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::noise::{band, fractal, smooth_step};
use super::car::number_ink;

// Tags of the triangles.
const METAL: u8 = 0;
const CLOTH: u8 = 1;
const ARM: u8 = 2;
const PLATE: u8 = 3;

/// Lean of the back, radians.
const LEAN: f64 = 0.22;

/// The seat without its cushion; it faces +x, 0.95 m high and 0.54 m wide.
pub fn frame() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let leaning = DMat3::from_rotation_y(-LEAN);
    b.part = METAL;
    for side in [1.0, -1.0] {
        b.block(DVec3::new(-0.05, 0.24 * side, 0.24), DVec3::new(0.035, 0.018, 0.24), 0.01);
        b.block(DVec3::new(-0.03, 0.24 * side, 0.015), DVec3::new(0.16, 0.03, 0.015), 0.01);
    }
    b.part = ARM;
    for side in [1.0, -1.0] {
        b.block(DVec3::new(0.0, 0.25 * side, 0.62), DVec3::new(0.2, 0.028, 0.02), 0.018);
        b.block(DVec3::new(-0.12, 0.25 * side, 0.54), DVec3::new(0.04, 0.018, 0.08), 0.01);
    }
    b.part = CLOTH;
    b.rounded_box(DVec3::new(-0.24, 0.0, 0.70), leaning, DVec3::new(0.04, 0.225, 0.25), 0.038);
    b.part = METAL;
    b.rounded_box(DVec3::new(-0.29, 0.0, 0.69), leaning, DVec3::new(0.012, 0.22, 0.24), 0.01);
    b.part = PLATE;
    b.rounded_box(DVec3::new(-0.181, 0.0, 0.88), leaning, DVec3::new(0.004, 0.05, 0.03), 0.002);
    b
}

/// The cushion as one sits on it.
pub fn unfolded() -> MeshBuilder {
    cushion(DVec3::new(0.03, 0.0, 0.44), 0.08)
}

/// The cushion folded up against the back.
pub fn folded() -> MeshBuilder {
    cushion(DVec3::new(-0.10, 0.0, 0.62), -1.25)
}

fn cushion(centre: DVec3, turn: f64) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = CLOTH;
    b.rounded_box(centre, DMat3::from_rotation_y(turn), DVec3::new(0.21, 0.215, 0.05), 0.045);
    b
}

/// Cloth, wear and number of a seat.
#[derive(Clone, Copy, Debug)]
pub struct SeatLook {
    /// Colour of the cloth, linear.
    pub cloth: Vec3,
    /// Number on the plate, 0..=99.
    pub number: u32,
    /// Seed of the pattern of worn cloth.
    pub seed: u32,
}

impl Look for SeatLook {
    fn surface(&self, spot: &Spot) -> Surface {
        let p = spot.position;
        match spot.part {
            CLOTH => {
                let worn = smooth_step(0.15, 0.5, fractal(p, 0.25, 3, spot.footprint, self.seed));
                let seams = band(p.y.abs(), 0.11, 0.006, spot.footprint);
                let weave = 1.0 + 0.2 * fractal(p, 0.02, 2, spot.footprint, 5);
                Surface::matt(self.cloth.lerp(Vec3::splat(0.4), 0.35 * worn) * weave * (1.0 - 0.5 * seams))
            }
            ARM => wood(spot, Vec3::X, srgb(0x6A4426), 40),
            PLATE => {
                let at = Vec2::new(p.y, p.z - 0.88) / 0.034;
                let ink = number_ink(at, self.number, spot.footprint / 0.034);
                Surface::coated(srgb(0xE0D8B0) * (1.0 - 0.9 * ink), 0.04)
            }
            _ => Surface::coated(srgb(0x35383C), 0.04),
        }
    }
}
