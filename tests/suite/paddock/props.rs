//! What stands around the paddock: trees, lamp posts and stacks of tyres, as background Gaussians.

use glam::{DMat3, DVec2, DVec3};

use super::discs::{push_disc, push_gaussian};
use super::shading::{Light, TO_SUN, diffuse, sh_dc};
use instgs_synth::shading::albedo;
use instgs_synth::surface::{Surfel, revolved, sample, sample_box};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::gaussians::Gaussians;

/// Something that throws a shadow: a ball in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Caster {
    /// Centre, world frame.
    pub(crate) position: DVec3,
    /// Radius, scene units.
    pub(crate) radius: f64,
}

/// Collects props and what they shade.
pub(crate) struct Props<'a> {
    /// Where the Gaussians go.
    pub(crate) cloud: &'a mut Gaussians,
    /// What throws shadows.
    pub(crate) casters: &'a mut Vec<Caster>,
}

impl Props<'_> {
    fn discs(&mut self, surfels: &[Surfel], albedo: DVec3) {
        for s in surfels {
            let openness = 0.55 + 0.45 * (s.position.z / 0.5).clamp(0.0, 1.0);
            let color = diffuse(albedo, s.normal, TO_SUN, Light { openness, sun: 1.0 });
            push_disc(self.cloud, s, 0.97, &[sh_dc(color)]);
            self.casters.push(Caster { position: s.position, radius: 0.8 * s.spacing });
        }
    }

    /// A tree: a trunk and leaf clusters around a few crown balls.
    pub(crate) fn tree(&mut self, rng: &mut Rng, foot: DVec2, height: f64) {
        let base = foot.extend(0.0);
        let trunk = revolved(base, DVec3::Z, move |u| DVec2::new(0.17 - 0.08 * u, 0.5 * height * u));
        let trunk = sample(rng, 0.13, trunk);
        self.discs(&trunk, albedo(0x5C4632));
        let hue = rng.range(-0.2, 1.0);
        let leaf = albedo(0x2E5A1C).lerp(albedo(0x6E8A2A), hue.max(0.0));
        let middle = base + DVec3::Z * (0.68 * height);
        for ball in 0..7 {
            let around = rng.unit_vector() * DVec3::new(0.20, 0.20, 0.17) * height;
            let centre = if ball == 0 { middle } else { middle + around };
            let radius = height * rng.range(0.13, 0.20);
            for _ in 0..64 {
                let out = rng.unit_vector();
                let p = centre + out * (radius * rng.range(0.65, 1.05));
                let normal = (out + 0.8 * (p - middle).normalize_or(DVec3::Z)).normalize_or(DVec3::Z);
                let depth = ((p - middle).length() / (0.36 * height)).clamp(0.0, 1.0);
                let light = Light { openness: 0.35 + 0.65 * depth, sun: 0.25 + 0.75 * depth };
                let color = diffuse(leaf * rng.range(0.7, 1.35), normal, TO_SUN, light);
                let size = height * rng.range(0.020, 0.038);
                let (a, b) = rng.unit_vector().any_orthonormal_pair();
                let axes = DMat3::from_cols(a, b, a.cross(b));
                push_gaussian(self.cloud, p, axes, DVec3::new(1.3, 0.9, 0.5) * size, 0.93, &[sh_dc(color)]);
                self.casters.push(Caster { position: p, radius: 1.2 * size });
            }
        }
    }

    /// A lamp post whose arm reaches from `foot` along the unit vector `arm`.
    pub(crate) fn lamp(&mut self, rng: &mut Rng, foot: DVec2, arm: DVec2) {
        let height = 5.2;
        let steel = albedo(0x50565E);
        let plinth = sample_box(rng, 0.12, foot.extend(0.15), DMat3::IDENTITY, DVec3::new(0.14, 0.14, 0.15));
        self.discs(&plinth, albedo(0x8A8A86));
        let mut rod = |from: DVec3, to: DVec3, radius: f64| {
            let dir = (to - from).normalize();
            let (a, b) = dir.any_orthonormal_pair();
            let count = ((to - from).length() / (3.0 * radius)).ceil() as usize;
            for i in 0..=count {
                let p = from.lerp(to, i as f64 / count as f64);
                let color =
                    diffuse(steel, (TO_SUN + DVec3::Z * 0.2).normalize(), TO_SUN, Light { openness: 0.8, sun: 0.45 });
                let size = DVec3::new(0.55, 0.55, 1.8) * radius;
                push_gaussian(self.cloud, p, DMat3::from_cols(a, b, dir), size, 0.97, &[sh_dc(color)]);
                self.casters.push(Caster { position: p, radius });
            }
        };
        let (bottom, top) = (foot.extend(0.2), foot.extend(height));
        let end = top + (arm * 1.3).extend(0.12);
        rod(bottom, top, 0.07);
        rod(top, end, 0.05);
        let across = DVec2::new(-arm.y, arm.x);
        let axes = DMat3::from_cols(arm.extend(0.0), across.extend(0.0), DVec3::Z);
        let head = sample_box(rng, 0.07, end, axes, DVec3::new(0.32, 0.12, 0.05));
        let (below, above): (Vec<_>, Vec<_>) = head.into_iter().partition(|s| s.normal.z < -0.5);
        self.discs(&above, steel);
        for s in &below {
            push_disc(self.cloud, s, 0.97, &[sh_dc(DVec3::new(1.0, 0.97, 0.86))]);
        }
    }

    /// A stack of tyres, painted.
    pub(crate) fn tyre_stack(&mut self, rng: &mut Rng, foot: DVec2, color: u32) {
        for level in 0..3 {
            let centre = foot.extend(0.12 + 0.23 * f64::from(level));
            let bulge = |u: f64| {
                let angle = std::f64::consts::PI * (u - 0.5);
                DVec2::new(0.24 + 0.09 * angle.cos(), 0.115 * angle.sin())
            };
            let tyre = sample(rng, 0.085, revolved(centre, DVec3::Z, bulge));
            self.discs(&tyre, albedo(color));
        }
        let lid = revolved(foot.extend(0.69), DVec3::Z, |u| DVec2::new(0.26 * (1.0 - u), 0.0));
        let lid = sample(rng, 0.085, lid);
        self.discs(&lid, albedo(color) * 0.6);
    }
}
