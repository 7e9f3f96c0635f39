//! Materials of surfaces.

use std::sync::Arc;

use glam::Vec3;

use super::noise::{fractal, smooth_step};
use crate::shading;

/// A point whose material is evaluated, in the object's frame.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Tag of the triangle; see [`super::mesh::MeshBuilder::part`].
    pub part: u8,
    /// Position in the object's frame.
    pub position: Vec3,
    /// Smooth unit normal in the object's frame.
    pub normal: Vec3,
    /// Size of a pixel there, in the object's unit, for antialiasing.
    pub footprint: f32,
}

/// Material at a point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// Linear diffuse reflectance, rgb.
    pub albedo: Vec3,
    /// Reflectance of a clear coat at normal incidence; 0 = matt.
    pub coat: f32,
    /// Share of the sun that passes through from behind, as in leaves and cloth.
    pub through: f32,
}

impl Surface {
    /// A matt surface, without coat.
    pub fn matt(albedo: Vec3) -> Self {
        Self { albedo, coat: 0.0, through: 0.0 }
    }

    /// A surface with a clear coat.
    pub fn coated(albedo: Vec3, coat: f32) -> Self {
        Self { albedo, coat, through: 0.0 }
    }

    /// A thin, translucent surface.
    pub fn thin(albedo: Vec3, through: f32) -> Self {
        Self { albedo, coat: 0.0, through }
    }
}

/// Material of every point of an object; a pure function of its arguments.
pub trait Look: Send + Sync {
    /// The material at a point.
    fn surface(&self, spot: &Spot) -> Surface;
}

impl<F: Fn(&Spot) -> Surface + Send + Sync> Look for F {
    fn surface(&self, spot: &Spot) -> Surface {
        self(spot)
    }
}

/// Interpolates between two looks.
pub struct Between {
    /// The looks at shares 0 and 1.
    pub looks: [Arc<dyn Look>; 2],
    /// Share of the second look, 0..=1.
    pub share: f32,
}

impl Look for Between {
    fn surface(&self, spot: &Spot) -> Surface {
        let [a, b] = [&self.looks[0], &self.looks[1]].map(|look| look.surface(spot));
        let mix = |a: f32, b: f32| a + (b - a) * self.share;
        Surface {
            albedo: a.albedo.lerp(b.albedo, self.share),
            coat: mix(a.coat, b.coat),
            through: mix(a.through, b.through),
        }
    }
}

/// An sRGB colour 0xRRGGBB as linear albedo.
pub fn srgb(rgb: u32) -> Vec3 {
    shading::albedo(rgb).as_vec3()
}

/// Wood with its grain along the unit vector `along` in the object's frame; `tone` is its mean colour, linear.
pub fn wood(spot: &Spot, along: Vec3, tone: Vec3, seed: u32) -> Surface {
    let p = spot.position;
    let (x, y) = along.any_orthonormal_pair();
    // Grain: noise stretched sixteenfold along the fibre.
    let grain_at = Vec3::new(p.dot(x), p.dot(y), p.dot(along) / 16.0);
    let grain = fractal(grain_at, 0.03, 3, spot.footprint, seed);
    let rings = fractal(grain_at, 0.12, 2, spot.footprint, seed + 17);
    let value = 1.0 + 0.45 * grain + 0.35 * rings;
    Surface::coated(tone * value.max(0.2) * Vec3::new(1.0, 0.97 + 0.04 * rings, 0.93 + 0.08 * rings), 0.025)
}

/// Rough plaster or stone of the colour `tone` with stains.
pub fn plaster(spot: &Spot, tone: Vec3, seed: u32) -> Surface {
    let stains = fractal(spot.position, 1.6, 5, spot.footprint, seed);
    let grain = fractal(spot.position, 0.09, 3, spot.footprint, seed + 5);
    Surface::matt(tone * (1.0 + 0.18 * stains + 0.14 * grain))
}

/// Interpolates from `a` to `b`; `t` is clamped to 0..=1.
pub fn blend(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a.lerp(b, t.clamp(0.0, 1.0))
}

/// Albedo of grass: patches of two greens, and fine blades.
pub fn grass(spot: &Spot, seed: u32) -> Vec3 {
    let p = Vec3::new(spot.position.x, spot.position.y, 0.0);
    let patches = fractal(p, 5.0, 4, spot.footprint, seed);
    let blades = fractal(p, 0.22, 4, spot.footprint, seed + 3);
    let dry = smooth_step(0.05, 0.45, fractal(p, 2.2, 4, spot.footprint, seed + 9));
    let green = blend(srgb(0x4B6B27), srgb(0x6F8B3A), 0.5 + patches);
    blend(green, srgb(0xA39A5A), 0.55 * dry) * (1.0 + 0.9 * blades)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_stay_plausible() {
        for i in 0..500 {
            let position = Vec3::new(i as f32 * 0.31, i as f32 * 0.17, i as f32 * -0.11);
            let spot = Spot { part: 0, position, normal: Vec3::Z, footprint: 0.002 };
            let surfaces = [wood(&spot, Vec3::Z, Vec3::splat(0.3), 1), plaster(&spot, Vec3::splat(0.5), 2)];
            for albedo in surfaces.map(|s| s.albedo).into_iter().chain([grass(&spot, 3)]) {
                assert!(albedo.min_element() >= 0.0 && albedo.max_element() < 0.95, "{albedo}");
            }
        }
        assert!(srgb(0xFFFFFF).min_element() > 0.999);
    }
}
