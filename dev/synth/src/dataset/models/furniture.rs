//! Chair, table and vase, with cushion and bouquet.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};

use super::super::look::{Look, Spot, Surface, srgb, wood};
use super::super::mesh::MeshBuilder;
use super::super::noise::{band, fractal, grid_line};

// Tags of the triangles.
const WOOD: u8 = 0;
const CLOTH: u8 = 1;
const UPRIGHT: u8 = 2;
const BOARD: u8 = 3;

/// Height of the table's top, metres.
pub const TABLE_HEIGHT: f64 = 0.76;

/// A wooden chair that faces +x, 0.95 m high.
pub fn chair() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = UPRIGHT;
    for side in [1.0, -1.0] {
        let (front, rear) = (DVec3::new(0.19, 0.19 * side, 0.0), DVec3::new(-0.22, 0.18 * side, 0.0));
        b.limb(front, DVec3::new(0.17, 0.175 * side, 0.44), (0.016, 0.023), 12);
        b.limb(rear, DVec3::new(-0.18, 0.175 * side, 0.46), (0.016, 0.023), 12);
        b.limb(DVec3::new(-0.18, 0.175 * side, 0.46), DVec3::new(-0.265, 0.18 * side, 0.95), (0.023, 0.015), 12);
    }
    b.part = WOOD;
    for (x, z) in [(0.18, 0.20), (-0.20, 0.16)] {
        b.limb(DVec3::new(x, -0.18, z), DVec3::new(x, 0.18, z), (0.011, 0.011), 8);
    }
    for side in [1.0, -1.0] {
        b.limb(DVec3::new(-0.20, 0.18 * side, 0.24), DVec3::new(0.18, 0.18 * side, 0.24), (0.011, 0.011), 8);
    }
    b.part = BOARD;
    b.block(DVec3::new(-0.005, 0.0, 0.445), DVec3::new(0.215, 0.22, 0.018), 0.015);
    // Curved slats between the uprights.
    for (z, half) in [(0.60, 0.022), (0.72, 0.022), (0.87, 0.05)] {
        let behind = -0.18 - 0.085 * (z - 0.46) / 0.49;
        let at = |u: f64, v: f64| {
            let turn = 2.0 * PI * v;
            let bulge = 0.035 * (PI * u).sin();
            DVec3::new(behind - bulge + 0.010 * turn.cos(), 0.18 * (2.0 * u - 1.0), z + half * turn.sin())
        };
        b.patch((12, 16), at, |_, _| true);
    }
    b
}

/// A cushion for the chair.
pub fn cushion() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = CLOTH;
    b.block(DVec3::new(0.0, 0.0, 0.49), DVec3::new(0.19, 0.19, 0.03), 0.029);
    b
}

/// A table of 1.9 m by 0.95 m, the longer side along x.
pub fn table() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = BOARD;
    b.block(DVec3::Z * (TABLE_HEIGHT - 0.02), DVec3::new(0.95, 0.475, 0.02), 0.012);
    b.block(DVec3::Z * (TABLE_HEIGHT - 0.085), DVec3::new(0.82, 0.35, 0.045), 0.005);
    b.part = UPRIGHT;
    for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        let foot = DVec3::new(0.83 * x, 0.37 * y, 0.0);
        b.limb(foot, DVec3::new(0.80 * x, 0.34 * y, TABLE_HEIGHT - 0.04), (0.025, 0.04), 16);
    }
    b
}

/// A bellied vase with two handles, 0.34 m high.
pub fn vase() -> MeshBuilder {
    let knots = [
        (0.0, 0.0),
        (0.055, 0.0),
        (0.062, 0.012),
        (0.10, 0.08),
        (0.115, 0.15),
        (0.085, 0.225),
        (0.045, 0.275),
        (0.05, 0.315),
        (0.066, 0.34),
        (0.058, 0.338),
        (0.04, 0.29),
        (0.0, 0.28),
    ];
    let mut b = MeshBuilder::new();
    b.lathe(DVec3::ZERO, DVec3::Z, &knots, 36, true);
    for side in [1.0, -1.0] {
        b.torus(DVec3::new(0.085 * side, 0.0, 0.245), DVec3::Y, (0.045, 0.009), (20, 8));
    }
    b
}

/// Twigs with blossoms for the vase.
pub fn bouquet() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    for i in 0..7 {
        let (sin, cos) = (f64::from(i) * 2.4).sin_cos();
        let reach = 0.05 + 0.02 * f64::from(i % 3);
        let top = DVec3::new(reach * 1.8 * cos, reach * 1.8 * sin, 0.47 + 0.045 * f64::from(i % 4));
        b.part = 0;
        b.limb(DVec3::new(0.01 * cos, 0.01 * sin, 0.29), top, (0.004, 0.003), 6);
        b.part = 1;
        b.ellipsoid(top, DMat3::IDENTITY, DVec3::new(0.034, 0.034, 0.026), (8, 12));
    }
    b
}

/// Look of wooden furniture with or without cloth.
#[derive(Clone, Copy, Debug)]
pub struct WoodLook {
    /// Mean colour of the wood, linear.
    pub tone: Vec3,
    /// Colour of the cloth, linear.
    pub cloth: Vec3,
    /// Seed of the wood's grain.
    pub seed: u32,
}

impl Look for WoodLook {
    fn surface(&self, spot: &Spot) -> Surface {
        match spot.part {
            CLOTH => {
                let p = spot.position;
                let weave = fractal(p, 0.012, 2, spot.footprint, 4);
                let stripe = grid_line(p.y, 0.075, 0.02, spot.footprint);
                Surface::matt(self.cloth.lerp(Vec3::splat(0.72), 0.7 * stripe) * (1.0 + 0.3 * weave))
            }
            UPRIGHT => wood(spot, Vec3::Z, self.tone, self.seed),
            BOARD => wood(spot, Vec3::X, self.tone * 1.12, self.seed + 1),
            _ => wood(spot, Vec3::Y, self.tone, self.seed + 2),
        }
    }
}

/// Look of a glazed vase with a painted band.
#[derive(Clone, Copy, Debug)]
pub struct VaseLook {
    /// Colour of the glaze, linear.
    pub glaze: Vec3,
    /// Colour of band and blossoms, linear.
    pub accent: Vec3,
}

impl Look for VaseLook {
    fn surface(&self, spot: &Spot) -> Surface {
        let p = spot.position;
        if p.z > 0.345 {
            let stem = spot.part == 0;
            return Surface::matt(if stem { srgb(0x4E6A32) } else { self.accent });
        }
        let turn = p.y.atan2(p.x) / std::f32::consts::PI;
        let wave = 0.15 + 0.018 * (turn * 8.0 * std::f32::consts::PI).sin();
        let ink = band(p.z, wave, 0.012, spot.footprint)
            + band(p.z, 0.105, 0.004, spot.footprint)
            + band(p.z, 0.195, 0.004, spot.footprint);
        let cloudy = fractal(p, 0.08, 3, spot.footprint, 9);
        Surface::coated((self.glaze * (1.0 + 0.25 * cloudy)).lerp(self.accent, ink.min(1.0)), 0.05)
    }
}
