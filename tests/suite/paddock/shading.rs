//! Light, baked: a sky that looks the same from every side, a sun, and a clear coat that mirrors the sky.
//!
//! What depends on the view direction is baked into a template in its own frame, so it must not change when an instance
//! is turned about the vertical: the mirrored surroundings depend on height only. The sun, which has an azimuth, is
//! diffuse only and goes into each instance's colour offsets.

use std::f64::consts::PI;

use glam::DVec3;
use instgs_synth::shading::encoded;
use instgs_vk::math::sh::{SH_C0, sh_basis};

/// Unit vector to the sun, world frame.
pub(crate) const TO_SUN: DVec3 = DVec3::new(-0.48, -0.5714, 0.6656);
/// Irradiance of the open sky on a level surface, linear rgb.
const SKY: DVec3 = DVec3::new(0.50, 0.58, 0.72);
/// Irradiance of the sun on a surface that faces it, linear rgb.
const SUN: DVec3 = DVec3::new(1.38, 1.24, 1.02);
/// Light that the ground throws up, linear rgb.
const BOUNCE: DVec3 = DVec3::new(0.16, 0.15, 0.14);
/// Directions over the sphere for the projection on SH.
const DIRECTIONS: usize = 160;

/// Light that reaches a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Light {
    /// Share of the sky (and of the ground's bounce) that the point sees, 0..=1.
    pub(crate) openness: f64,
    /// Share of the sun that the point sees, 0..=1.
    pub(crate) sun: f64,
}

impl Light {
    /// Nothing in the way.
    pub(crate) const OPEN: Self = Self { openness: 1.0, sun: 1.0 };
}

/// Diffuse colour, encoded (sRGB), of a surface with this linear albedo and normal under a sun in direction `to_sun`
/// (same frame as the normal, z up).
pub(crate) fn diffuse(albedo: DVec3, normal: DVec3, to_sun: DVec3, light: Light) -> DVec3 {
    let up = 0.5 + 0.5 * normal.z;
    let sun = SUN * (normal.dot(to_sun).max(0.0) * light.sun);
    encoded(albedo * ((SKY * up + BOUNCE * (1.0 - up)) * light.openness + sun))
}

/// SH coefficient 0 of a surface that has this colour from every side.
pub(crate) fn sh_dc(color: DVec3) -> DVec3 {
    (color - 0.5) / SH_C0
}

/// What a mirror shows in the direction with this vertical component: dark ground, bright horizon, deeper sky above.
fn surroundings(z: f64) -> DVec3 {
    let smooth = |low: f64, high: f64| {
        let t = ((z - low) / (high - low)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let (ground, horizon, zenith) =
        (DVec3::new(0.10, 0.10, 0.11), DVec3::new(1.0, 0.98, 0.95), DVec3::new(0.46, 0.62, 0.88));
    ground.lerp(horizon, smooth(-0.12, 0.10)).lerp(zenith, smooth(0.12, 0.75))
}

/// SH coefficients (degree 3, to be added to the diffuse ones) of a clear coat on a surface with this normal: Schlick's
/// Fresnel term with reflectance `f0` at normal incidence, times the mirrored surroundings, times `openness`.
///
/// Only view directions in front of the surface are ever seen; behind it the function continues as its mirror image,
/// which is continuous, so that three degrees go into what is seen.
pub(crate) struct ClearCoat {
    directions: Vec<(DVec3, [f64; 16])>,
}

impl ClearCoat {
    /// Precomputes the basis over evenly spread directions (a spherical Fibonacci lattice).
    pub(crate) fn new() -> Self {
        let golden_angle = PI * (3.0 - 5f64.sqrt());
        let direction = |i: usize| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        };
        Self { directions: (0..DIRECTIONS).map(|i| (direction(i), sh_basis(direction(i)))).collect() }
    }

    /// The coefficients.
    pub(crate) fn sh(&self, normal: DVec3, f0: f64, openness: f64) -> [DVec3; 16] {
        let mut out = [DVec3::ZERO; 16];
        for (dir, basis) in &self.directions {
            let facing = dir.dot(normal);
            let seen = *dir - normal * (facing + facing.abs());
            let value = Self::value(seen, normal, f0) * (openness * 4.0 * PI / DIRECTIONS as f64);
            for (coefficient, b) in out.iter_mut().zip(basis) {
                *coefficient += value * *b;
            }
        }
        out
    }

    /// The function itself for a view direction `dir` (camera to surface) in front of the surface.
    fn value(dir: DVec3, normal: DVec3, f0: f64) -> DVec3 {
        let cosine = -dir.dot(normal);
        let fresnel = f0 + (1.0 - f0) * (1.0 - cosine).clamp(0.0, 1.0).powi(5);
        let mirrored = dir + normal * (2.0 * cosine);
        surroundings(mirrored.z) * fresnel
    }
}

impl Default for ClearCoat {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::sh::eval_sh_f64;

    #[test]
    fn the_sun_direction_is_a_unit_vector() {
        assert!((TO_SUN.length() - 1.0).abs() < 1e-3);
    }

    #[test]
    fn diffuse_colours_stay_in_range() {
        assert!(diffuse(DVec3::ONE, TO_SUN, TO_SUN, Light::OPEN).max_element() <= 1.0);
        assert!(diffuse(DVec3::ONE, DVec3::Z, DVec3::Z, Light { openness: 0.0, sun: 0.0 }).max_element() < 1e-9);
    }

    /// Three degrees catch the trend: brighter at grazing angles, and within 0.35 of the function everywhere in front.
    #[test]
    fn the_coat_is_brighter_at_grazing_angles_and_turns_with_the_view() {
        let coat = ClearCoat::new();
        let normal = DVec3::new(0.0, 0.6, 0.8);
        let sh = coat.sh(normal, 0.06, 1.0);
        let mut worst: f64 = 0.0;
        for (dir, _) in coat.directions.iter().filter(|(d, _)| d.dot(normal) < 0.0) {
            worst = worst.max((eval_sh_f64(3, &sh, *dir) - ClearCoat::value(*dir, normal, 0.06)).abs().max_element());
        }
        assert!(worst < 0.35, "{worst}");
        let front = eval_sh_f64(3, &sh, -normal).y;
        let grazing = eval_sh_f64(3, &sh, DVec3::new(1.0, 0.1, -0.1).normalize()).y;
        assert!(grazing > front + 0.1, "{front} {grazing}");
    }
}
