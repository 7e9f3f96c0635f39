//! A fruit tree: trunk, boughs, foliage in clusters with single leaves, and fruit.

use glam::{DMat3, DVec3, Vec3};

use super::super::look::{Look, Spot, Surface, blend, srgb};
use super::super::mesh::MeshBuilder;
use super::super::noise::fractal;
use instgs_vk::math::rng::Rng;

// Tags of the triangles.
const BARK: u8 = 0;
const LEAF: u8 = 1;
const FRUIT: u8 = 2;

/// Height of the crown's centre, metres.
const CROWN_HEIGHT: f64 = 2.35;

/// A tree about 3.6 m high; all trees of a seed are the same.
pub fn tree(seed: u64, leaves_per_cluster: usize) -> MeshBuilder {
    let mut rng = Rng::new(seed);
    let mut b = MeshBuilder::new();
    b.part = BARK;
    let fork = DVec3::new(0.06, -0.03, 1.25);
    b.lathe(DVec3::ZERO, DVec3::Z, &[(0.24, 0.0), (0.15, 0.18), (0.12, 0.6)], 14, true);
    b.limb(DVec3::Z * 0.55, fork, (0.122, 0.10), 14);
    let crown = DVec3::Z * CROWN_HEIGHT;
    let clusters: Vec<(DVec3, f64)> = (0..15)
        .map(|i| {
            let turn = std::f64::consts::TAU * (f64::from(i) * 0.618_034).fract();
            let height = [-0.5, -0.1, 0.3, 0.75][i as usize % 4] + rng.range(-0.15, 0.15);
            let reach = (1.15 - 0.75 * height.abs()) * rng.range(0.75, 1.1);
            (crown + DVec3::new(reach * turn.cos(), reach * turn.sin(), height), rng.range(0.42, 0.62))
        })
        .chain([(crown, 0.75), (crown + DVec3::Z * 0.75, 0.5)])
        .collect();
    for &(middle, _) in &clusters {
        b.part = BARK;
        let elbow = fork.lerp(middle, 0.55) + DVec3::Z * 0.06;
        b.limb(fork, elbow, (0.055, 0.035), 7);
        b.limb(elbow, middle, (0.035, 0.015), 6);
    }
    for &(middle, radius) in &clusters {
        foliage(&mut b, &mut rng, middle, radius, leaves_per_cluster);
    }
    b
}

fn foliage(b: &mut MeshBuilder, rng: &mut Rng, middle: DVec3, radius: f64, leaves: usize) {
    b.part = LEAF;
    let half = radius * DVec3::new(rng.range(0.66, 0.8), rng.range(0.66, 0.8), rng.range(0.5, 0.62));
    let seed = rng.next_u32();
    let lumpy = |u: f64, v: f64| {
        let (sin, cos) = (std::f64::consts::PI * (u - 0.5)).sin_cos();
        let turn = std::f64::consts::TAU * v;
        let out = DVec3::new(cos * turn.cos(), cos * turn.sin(), sin);
        middle + out * half * (1.0 + 0.35 * f64::from(fractal(out.as_vec3(), 0.7, 3, 0.0, seed)))
    };
    b.patch((14, 22), lumpy, |_, _| true);
    for leaf in 0..leaves {
        let out = rng.unit_vector();
        let at = middle + out * radius * rng.range(0.62, 1.0) * DVec3::new(1.0, 1.0, 0.82);
        let normal = (out + 0.6 * (at - DVec3::Z * CROWN_HEIGHT)).normalize();
        // Leaves lie roughly along the surface, each with its own tilt.
        let tilted = (normal + 0.7 * rng.unit_vector()).normalize_or(normal);
        let (x, y) = tilted.any_orthonormal_pair();
        let turn = DMat3::from_axis_angle(tilted, rng.range(0.0, std::f64::consts::TAU));
        let (length, width) = (turn * x * rng.range(0.05, 0.085), turn * y * rng.range(0.032, 0.048));
        b.triangle([at - length, at - width, at + length], [normal; 3]);
        b.triangle([at - length, at + length, at + width], [normal; 3]);
        if leaf % 28 == 0 {
            b.part = FRUIT;
            b.ellipsoid(middle + out * radius * 0.98, DMat3::IDENTITY, DVec3::splat(0.062), (8, 12));
            b.part = LEAF;
        }
    }
}

/// Colours of one tree, linear.
#[derive(Clone, Copy, Debug)]
pub struct TreeLook {
    /// Colour of leaves in the light.
    pub leaf: Vec3,
    /// Colour of the fruit.
    pub fruit: Vec3,
    /// Seed of the blotches.
    pub seed: u32,
}

impl Look for TreeLook {
    fn surface(&self, spot: &Spot) -> Surface {
        match spot.part {
            BARK => {
                let p = spot.position * Vec3::new(1.0, 1.0, 0.2);
                let grain = fractal(p, 0.06, 3, spot.footprint, 3);
                Surface::matt(srgb(0x7A6450) * (1.0 + 0.8 * grain))
            }
            FRUIT => Surface::coated(self.fruit, 0.04),
            _ => {
                let blotch = fractal(spot.position, 0.5, 2, spot.footprint, self.seed);
                let single = fractal(spot.position, 0.11, 2, spot.footprint, self.seed + 1);
                let tone =
                    blend(self.leaf * 0.72, self.leaf * Vec3::new(1.35, 1.25, 1.0), 0.5 + 0.9 * blotch + 0.7 * single);
                Surface::thin(tone, 0.35)
            }
        }
    }
}
