//! A window of a house: frame, panes, sill; blinds and flower boxes as differences. Frame: x along the wall, -y
//! outwards, z up, origin at the centre of the opening in the wall's outer face.

use glam::{DMat3, DVec3, Vec3};

use super::super::look::{Look, Spot, Surface, blend, srgb};
use super::super::mesh::MeshBuilder;
use super::super::noise::{fractal, grid_line, smooth_step};
use instgs_vk::math::rng::Rng;

/// Half width and half height of the opening, metres.
pub const HALF: (f64, f64) = (0.55, 0.8);

// Tags of the triangles.
const FRAME: u8 = 0;
const PANE: u8 = 1;
const SILL: u8 = 2;
const BLIND: u8 = 3;
const BOX: u8 = 4;
const LEAF: u8 = 5;
const BLOSSOM: u8 = 6;

/// A window with frame, panes and sill.
pub fn window() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let (w, h) = HALF;
    b.part = PANE;
    b.card(DVec3::new(-w, 0.13, -h), DVec3::X * 2.0 * w, DVec3::Z * 2.0 * h, -DVec3::Y);
    b.part = FRAME;
    for side in [-1.0, 1.0] {
        b.block(DVec3::new(side * (w - 0.035), 0.10, 0.0), DVec3::new(0.04, 0.04, h), 0.01);
        b.block(DVec3::new(0.0, 0.10, side * (h - 0.035)), DVec3::new(w, 0.04, 0.04), 0.01);
        // A surround that stands out from the wall.
        b.block(DVec3::new(side * (w + 0.06), -0.01, 0.0), DVec3::new(0.06, 0.035, h + 0.02), 0.012);
    }
    b.block(DVec3::new(0.0, 0.10, 0.0), DVec3::new(0.028, 0.035, h), 0.008);
    b.block(DVec3::new(0.0, 0.10, 0.30), DVec3::new(w, 0.03, 0.022), 0.008);
    b.part = SILL;
    b.block(DVec3::new(0.0, -0.05, -h - 0.03), DVec3::new(w + 0.16, 0.12, 0.035), 0.012);
    b.block(DVec3::new(0.0, -0.02, h + 0.09), DVec3::new(w + 0.16, 0.06, 0.08), 0.015);
    b
}

/// A blind that covers this part of the opening from above, 0..=1.
pub fn blind(part: f64) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.part = BLIND;
    let (w, h) = HALF;
    b.block(DVec3::new(0.0, 0.035, h - part * h), DVec3::new(w - 0.03, 0.012, part * h), 0.006);
    b
}

/// A box of flowers on the sill.
pub fn flower_box() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let mut rng = Rng::new(5);
    let (w, h) = HALF;
    b.part = BOX;
    b.block(DVec3::new(0.0, -0.13, -h + 0.08), DVec3::new(w - 0.04, 0.085, 0.08), 0.012);
    for i in 0..22 {
        let along = (w - 0.08) * (f64::from(i) / 10.5 - 1.0);
        let at = DVec3::new(along, -0.13 + rng.range(-0.07, 0.05), -h + 0.19 + rng.range(-0.02, 0.06));
        b.part = LEAF;
        b.ellipsoid(at, DMat3::IDENTITY, DVec3::splat(0.062), (7, 10));
        b.part = BLOSSOM;
        for _ in 0..3 {
            let out = (rng.unit_vector() + DVec3::new(0.0, -0.5, 0.6)).normalize_or(DVec3::Z);
            b.ellipsoid(at + out * 0.06, DMat3::IDENTITY, DVec3::splat(0.024), (5, 8));
        }
    }
    b
}

/// Colours of one window, linear.
#[derive(Clone, Copy, Debug)]
pub struct WindowLook {
    /// Colour of the curtains behind the panes.
    pub curtain: Vec3,
    /// Half width of the gap between the curtains, metres.
    pub gap: f32,
    /// Colour of the flowers.
    pub blossom: Vec3,
    /// Colour of the blind.
    pub blind: Vec3,
}

impl Look for WindowLook {
    fn surface(&self, spot: &Spot) -> Surface {
        let p = spot.position;
        match spot.part {
            PANE => {
                let folds = 0.75 + 0.25 * (p.x * 42.0).sin();
                let drawn = smooth_step(-0.02, 0.02, p.x.abs() - self.gap - 0.08 * (0.8 - p.z));
                let room = blend(srgb(0x1B1E22), srgb(0x3A3732), smooth_step(-0.8, 0.2, p.z));
                Surface::coated(blend(room, self.curtain * folds * 0.62, drawn), 0.09)
            }
            SILL => Surface::matt(srgb(0xB9B2A4) * (1.0 + 0.3 * fractal(p, 0.1, 3, spot.footprint, 6))),
            BLIND => {
                let slat = grid_line(p.z, 0.05, 0.012, spot.footprint);
                Surface::matt(self.blind * (1.0 - 0.5 * slat))
            }
            BOX => Surface::matt(srgb(0x9A5A3C) * (1.0 + 0.3 * fractal(p, 0.15, 3, spot.footprint, 7))),
            LEAF => Surface::matt(srgb(0x4E7A30) * (1.0 + 0.9 * fractal(p, 0.05, 2, spot.footprint, 8))),
            BLOSSOM => Surface::matt(self.blossom),
            _ => Surface::coated(srgb(0xECEAE2), 0.03),
        }
    }
}
