//! Props: cones, tyres, lamp posts, barriers, ground.

use glam::{DVec3, Vec3};

use super::super::look::{Spot, Surface, plaster, srgb};
use super::super::mesh::MeshBuilder;
use super::super::noise::{band, fractal, smooth_step};

/// A traffic cone, 0.55 m high.
pub fn cone() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.block(DVec3::Z * 0.02, DVec3::new(0.19, 0.19, 0.02), 0.015);
    b.lathe(DVec3::ZERO, DVec3::Z, &[(0.14, 0.04), (0.035, 0.54), (0.02, 0.56), (0.0, 0.56)], 24, false);
    b
}

/// Orange with white bands.
pub fn cone_look(spot: &Spot) -> Surface {
    let z = spot.position.z;
    let white = band(z, 0.24, 0.05, spot.footprint) + band(z, 0.42, 0.035, spot.footprint);
    Surface::coated(srgb(0xE8501A).lerp(srgb(0xF2F0EA), white.min(1.0)), 0.02)
}

/// A stack of `count` tyres.
pub fn tyre_stack(count: u32) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    for i in 0..count {
        b.part = (i % 2) as u8;
        b.torus(DVec3::Z * (0.11 + 0.2 * f64::from(i)), DVec3::Z, (0.24, 0.115), (32, 14));
    }
    b
}

/// Alternating red and white paint.
pub fn tyre_look(spot: &Spot) -> Surface {
    let paint = if spot.part == 0 { srgb(0xC8261E) } else { srgb(0xE4E0D8) };
    let worn = fractal(spot.position, 0.2, 4, spot.footprint, 8);
    Surface::matt(paint.lerp(srgb(0x2A2A2C), smooth_step(0.1, 0.5, worn)))
}

/// A lamp post, 5 m high, with its arm towards +x.
pub fn lamp_post() -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.lathe(DVec3::ZERO, DVec3::Z, &[(0.14, 0.0), (0.14, 0.25), (0.07, 0.35), (0.05, 4.8), (0.0, 4.85)], 16, true);
    b.limb(DVec3::Z * 4.75, DVec3::new(1.1, 0.0, 4.95), (0.04, 0.03), 10);
    b.part = 1;
    b.block(DVec3::new(1.2, 0.0, 4.93), DVec3::new(0.28, 0.11, 0.05), 0.04);
    b
}

/// Grey-green metal and a light head.
pub fn lamp_look(spot: &Spot) -> Surface {
    Surface::coated(if spot.part == 0 { srgb(0x55605C) } else { srgb(0xD8D8D0) }, 0.04)
}

/// A concrete barrier along x, `length` metres long.
pub fn barrier(length: f64) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    let section =
        [(-0.3, 0.0), (-0.3, 0.08), (-0.17, 0.28), (-0.09, 0.82), (0.09, 0.82), (0.17, 0.28), (0.3, 0.08), (0.3, 0.0)];
    for pair in section.windows(2) {
        let at = |x: f64, p: (f64, f64)| DVec3::new(x, p.0, p.1);
        let normal = DVec3::new(0.0, pair[0].1 - pair[1].1, pair[1].0 - pair[0].0).normalize_or(DVec3::Z);
        let half = 0.5 * length;
        b.card(at(-half, pair[0]), DVec3::X * length, at(-half, pair[1]) - at(-half, pair[0]), normal);
        for x in [-half, half] {
            let end = DVec3::X * x.signum();
            b.triangle([at(x, pair[0]), at(x, pair[1]), at(x, (0.0, 0.0))], [end; 3]);
        }
    }
    b
}

/// Concrete with red and white paint along the top.
pub fn barrier_look(spot: &Spot) -> Surface {
    let mut surface = plaster(spot, srgb(0xB4AFA6), 21);
    if spot.position.z > 0.55 {
        let red = (spot.position.x / 1.2).rem_euclid(2.0) < 1.0;
        let worn = smooth_step(0.25, 0.5, fractal(spot.position, 0.3, 4, spot.footprint, 5));
        surface.albedo = srgb(if red { 0xB8322A } else { 0xDEDAD0 }).lerp(surface.albedo, worn);
    }
    surface
}

/// A level square of ground around the origin, `half` metres to each side.
pub fn ground(half: f64) -> MeshBuilder {
    let mut b = MeshBuilder::new();
    b.card(DVec3::new(-half, -half, 0.0), DVec3::X * 2.0 * half, DVec3::Y * 2.0 * half, DVec3::Z);
    b
}

/// Albedo of asphalt: grains, stains, patches of newer tar, cracks.
pub fn asphalt(spot: &Spot) -> Vec3 {
    let p = Vec3::new(spot.position.x, spot.position.y, 0.0);
    let stains = fractal(p, 3.5, 5, spot.footprint, 31);
    let grain = fractal(p, 0.06, 3, spot.footprint, 32);
    let vein = fractal(p, 2.6, 4, spot.footprint, 33).abs();
    let crack = 1.0 - smooth_step(0.004, 0.004 + 0.01f32.max(0.4 * spot.footprint), vein);
    let newer = smooth_step(0.18, 0.22, fractal(p, 6.0, 2, spot.footprint, 34));
    srgb(0x77767A) * (1.0 + 0.45 * stains + 0.5 * grain) * (1.0 - 0.45 * crack) * (1.0 - 0.25 * newer)
}
