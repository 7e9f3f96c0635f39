//! Daylight: a sun with an angular size, and a sky gradient above hazy ground.

use glam::Vec3;

use super::noise::{fractal, smooth_step};

/// Light of a scene. Radiances are linear and relative to the picture's white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Daylight {
    /// Unit vector to the centre of the sun.
    pub to_sun: Vec3,
    /// Direct light on a white surface that faces the sun.
    pub sun: Vec3,
    /// Tangent of the sun's half angle: larger values give softer shadows.
    pub sun_radius: f32,
    /// Radiance of the sky at the zenith.
    pub zenith: Vec3,
    /// Radiance of the sky at the horizon.
    pub horizon: Vec3,
    /// Radiance of the ground beyond the scene.
    pub ground: Vec3,
    /// Light on surfaces that a bounced ray hits, besides the sun.
    pub ambient: Vec3,
    /// Factor on all light before encoding.
    pub exposure: f32,
}

impl Daylight {
    /// A clear afternoon with the sun at the given azimuth and elevation, degrees.
    pub fn afternoon(azimuth_deg: f32, elevation_deg: f32) -> Self {
        let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = elevation_deg.to_radians().sin_cos();
        Self {
            to_sun: Vec3::new(cos_a * cos_e, sin_a * cos_e, sin_e),
            sun: Vec3::new(1.55, 1.36, 1.08),
            // The real value is 0.0047; a thin haze makes shadows that splats can represent.
            sun_radius: 0.02,
            zenith: Vec3::new(0.22, 0.38, 0.72),
            horizon: Vec3::new(0.74, 0.82, 0.92),
            ground: Vec3::new(0.30, 0.29, 0.25),
            ambient: Vec3::new(0.20, 0.23, 0.27),
            exposure: 1.0,
        }
    }

    /// Radiance from the unit direction `d`, without the sun's disc.
    pub fn sky(&self, d: Vec3) -> Vec3 {
        let up = d.z.max(0.0);
        let clear = self.horizon.lerp(self.zenith, 1.0 - (1.0 - up).powi(3));
        // Thin clouds on a plane above, faded towards the horizon.
        let cloud = if up > 0.02 {
            fractal(Vec3::new(d.x / (up + 0.15), d.y / (up + 0.15), 0.0), 1.1, 4, 0.02, 77)
        } else {
            0.0
        };
        let white = smooth_step(0.02, 0.5, cloud) * smooth_step(0.02, 0.3, up);
        let clear = clear.lerp(Vec3::splat(0.92), 0.6 * white);
        let glow = d.dot(self.to_sun).max(0.0).powi(24);
        let above = clear + self.sun * (0.12 * glow);
        self.ground.lerp(above, smooth_step(-0.05, 0.01, d.z))
    }

    /// Cosine-weighted mean of the open sky and ground for a surface with this normal: between a roof's and a
    /// downward-facing ceiling's.
    pub fn open_sky(&self, normal: Vec3) -> Vec3 {
        let roof = self.horizon.lerp(self.zenith, 0.75);
        self.ground.lerp(roof, 0.5 + 0.5 * normal.z)
    }

    /// Radiance that a clear coat reflects from the unit direction `d`: a sky with a soft horizon, and the sun as a
    /// broad lobe.
    pub fn mirrored(&self, d: Vec3, sun_seen: f32) -> Vec3 {
        let above = self.horizon.lerp(self.zenith, smooth_step(0.05, 0.8, d.z));
        let around = (self.ground * 0.5).lerp(above, smooth_step(-0.15, 0.12, d.z));
        around + self.sun * (6.0 * sun_seen * d.dot(self.to_sun).max(0.0).powi(90))
    }

    /// Unit vector to the point (x, y) of the sun's disc, given as a unit disc.
    pub fn sun_direction(&self, x: f32, y: f32) -> Vec3 {
        let (a, b) = self.to_sun.any_orthonormal_pair();
        (self.to_sun + (a * x + b * y) * self.sun_radius).normalize()
    }
}

/// Maps the unit square to the unit disc, preserving area.
pub fn disc(u: f32, v: f32) -> (f32, f32) {
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    (u.sqrt() * cos, u.sqrt() * sin)
}

/// Maps the unit square to cosine-distributed directions around the unit vector `normal`.
pub fn cosine_direction(normal: Vec3, u: f32, v: f32) -> Vec3 {
    let (x, y) = disc(u, v);
    let (a, b) = normal.any_orthonormal_pair();
    (a * x + b * y + normal * (1.0 - u).max(0.0).sqrt()).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_unit_vectors_about_their_axis() {
        let day = Daylight::afternoon(30.0, 50.0);
        assert!((day.to_sun.length() - 1.0).abs() < 1e-6);
        let mut mean = 0.0;
        for i in 0..1024 {
            let (u, v) = ((i % 32) as f32 / 32.0 + 0.01, (i / 32) as f32 / 32.0);
            let d = cosine_direction(Vec3::new(0.6, 0.0, 0.8), u, v);
            assert!((d.length() - 1.0).abs() < 1e-5);
            mean += d.dot(Vec3::new(0.6, 0.0, 0.8)) / 1024.0;
            assert!(day.sun_direction(disc(u, v).0, disc(u, v).1).dot(day.to_sun) > 0.999);
        }
        // The mean cosine of the cosine distribution.
        assert!((mean - 2.0 / 3.0).abs() < 0.02, "{mean}");
        assert!(day.sky(Vec3::Z).z > day.sky(Vec3::Z).x && day.sky(-Vec3::Z) == day.ground);
    }
}
