//! Packed goods: a carton, a bottle and a can, whose labels differ.

use glam::{DVec3, Vec2, Vec3};

use super::super::look::{Look, Spot, Surface, srgb};
use super::super::mesh::MeshBuilder;
use super::super::noise::{band, fractal, grid_line, smooth_step};
use super::car::number_ink;

// Tag of the triangles of lids; all others are 0.
const LID: u8 = 1;

/// A carton, 0.19 m wide and 0.28 m high; its front is at -y.
pub fn carton() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.block(DVec3::Z * 0.14, DVec3::new(0.095, 0.035, 0.14), 0.003);
    b
}

/// A bottle with a screw cap, 0.30 m high.
pub fn bottle() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let body = [(0.0, 0.0), (0.034, 0.0), (0.038, 0.01), (0.038, 0.17), (0.032, 0.2), (0.014, 0.245), (0.013, 0.27)];
    b.lathe(DVec3::ZERO, DVec3::Z, &body, 32, true);
    b.part = LID;
    b.lathe(DVec3::ZERO, DVec3::Z, &[(0.013, 0.268), (0.017, 0.268), (0.017, 0.3), (0.0, 0.3)], 24, false);
    b
}

/// A can, 0.12 m high and 0.08 m wide, with a recessed lid.
pub fn can() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let side = [(0.036, 0.0), (0.04, 0.006), (0.04, 0.114), (0.037, 0.12)];
    b.lathe(DVec3::ZERO, DVec3::Z, &side, 32, false);
    b.part = LID;
    b.lathe(DVec3::ZERO, DVec3::Z, &[(0.037, 0.12), (0.034, 0.116), (0.0, 0.116)], 32, false);
    b
}

/// Height of the label's middle and half its height, and the radius that it is wrapped around (0 = a flat front), metres.
#[derive(Clone, Copy, Debug)]
pub struct LabelPlace {
    /// Height of the middle, metres.
    pub middle: f32,
    /// Half of the height, metres.
    pub half: f32,
    /// Radius of what it is wrapped around; 0 for a flat front, metres.
    pub radius: f32,
}

/// Colours and print of one package.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    /// Where on the package the label is.
    pub place: LabelPlace,
    /// Colour of the body around the label, linear.
    pub body: Vec3,
    /// Colour of the lid, linear.
    pub lid: Vec3,
    /// Colour of the label, linear.
    pub paper: Vec3,
    /// Colour of its print, linear.
    pub print: Vec3,
    /// Number in the middle of the label, 0..=99.
    pub number: u32,
    /// Kind of pattern, 0..=2: stripes, checks, a disc.
    pub pattern: u32,
}

impl Look for Label {
    fn surface(&self, spot: &Spot) -> Surface {
        if spot.part == LID {
            return Surface::coated(self.lid, 0.06);
        }
        let (p, place) = (spot.position, self.place);
        let across = if place.radius > 0.0 { place.radius * p.x.atan2(-p.y) } else { p.x };
        let front = place.radius > 0.0 || spot.normal.y < -0.5;
        let on = band(p.z, place.middle, place.half, spot.footprint) * if front { 1.0 } else { 0.0 };
        let at = Vec2::new(across, p.z - place.middle) / place.half;
        let fine = spot.footprint / place.half;
        let inked = number_ink(1.6 * at, self.number, 1.6 * fine);
        let pattern = match self.pattern {
            0 => grid_line(at.y, 0.5, 0.14, fine),
            1 => {
                let (a, b) = (grid_line(at.x, 0.5, 0.25, fine), grid_line(at.y, 0.5, 0.25, fine));
                a + b - 2.0 * a * b
            }
            _ => 1.0 - smooth_step(-0.5 * fine - 0.01, 0.5 * fine + 0.01, at.length() - 0.85),
        };
        let printed = self.paper.lerp(self.print, 0.75 * pattern);
        let label = printed.lerp(if self.pattern == 2 { self.paper } else { Vec3::splat(0.02) }, inked);
        let cloudy = 1.0 + 0.06 * fractal(p, 0.05, 2, spot.footprint, 11);
        Surface::coated(self.body.lerp(label, on) * cloudy, 0.04)
    }
}

/// A package of the shelf: its name, the width that it needs, and where its label is.
pub const KINDS: [(&str, f64, LabelPlace); 3] = [
    ("carton", 0.23, LabelPlace { middle: 0.14, half: 0.115, radius: 0.0 }),
    ("bottle", 0.12, LabelPlace { middle: 0.095, half: 0.055, radius: 0.038 }),
    ("can", 0.12, LabelPlace { middle: 0.06, half: 0.05, radius: 0.04 }),
];

/// Colours that packages draw from.
pub const PALETTE: [u32; 8] = [0xC8342E, 0x2E5E9A, 0xE8B83A, 0x3E8A4E, 0xE8E4DA, 0x7A3E8A, 0xE07A2E, 0x3AA0A8];

/// A colour of the palette, linear.
pub fn palette(index: usize) -> Vec3 {
    srgb(PALETTE[index % PALETTE.len()])
}
