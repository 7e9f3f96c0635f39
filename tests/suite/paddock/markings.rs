//! What is painted on the asphalt, as a colour per point and a distance to the nearest painted edge.

use glam::{DVec2, DVec3};

use super::ground::{BAY_PITCH, BAY_Y, BAYS};
use instgs_synth::shading::albedo;

/// A painted line.
struct Line {
    from: DVec2,
    to: DVec2,
    half_width: f64,
    color: DVec3,
}

/// All paint on the asphalt.
pub(crate) struct Markings {
    lines: Vec<Line>,
}

const RING_RADIUS: f64 = 3.7;
const RING_HALF_WIDTH: f64 = 0.11;
/// Side of a square of the chequered lines.
const SQUARE: f64 = 0.42;
/// Chequered lines: first x, columns and rows of squares.
const CHEQUERS: [f64; 2] = [-17.0, 15.74];
const CHEQUER_COLUMNS: f64 = 3.0;
const CHEQUER_ROWS: f64 = 20.0;
/// Width over which paint fades into asphalt.
const FADE: f64 = 0.06;

impl Markings {
    /// Bays, a dashed middle line.
    pub(crate) fn new() -> Self {
        let (white, yellow) = (albedo(0xE8E8E2), albedo(0xE8B818));
        let row_half = 0.5 * BAY_PITCH * BAYS as f64;
        let mut lines = Vec::new();
        for k in 0..=BAYS {
            let x = -row_half + BAY_PITCH * k as f64;
            for side in [1.0, -1.0] {
                let (from, to) = (DVec2::new(x, side * BAY_Y.0), DVec2::new(x, side * BAY_Y.1));
                lines.push(Line { from, to, half_width: 0.075, color: white });
            }
        }
        for k in 0..12 {
            let x = -15.6 + 2.6 * f64::from(k);
            if x + 0.6 < -RING_RADIUS - 0.8 || x - 0.6 > RING_RADIUS + 0.8 {
                let (from, to) = (DVec2::new(x - 0.6, 0.0), DVec2::new(x + 0.6, 0.0));
                lines.push(Line { from, to, half_width: 0.07, color: yellow });
            }
        }
        Self { lines }
    }

    /// Distance to the nearest paint and its colour; negative inside.
    fn nearest(&self, p: DVec2) -> (f64, DVec3) {
        let ring = (p.length() - RING_RADIUS).abs() - RING_HALF_WIDTH;
        let mut best = (ring, albedo(0xE8B818));
        for line in &self.lines {
            let along = line.to - line.from;
            let t = ((p - line.from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            let distance = (p - line.from - along * t).length() - line.half_width;
            if distance < best.0 {
                best = (distance, line.color);
            }
        }
        for first_x in CHEQUERS {
            let q = (p - DVec2::new(first_x, -0.5 * CHEQUER_ROWS * SQUARE)) / SQUARE;
            let size = DVec2::new(CHEQUER_COLUMNS, CHEQUER_ROWS);
            let outside = (q - q.clamp(DVec2::ZERO, size)).length() * SQUARE;
            let distance = if outside > 0.0 { outside } else { -FADE };
            if distance < best.0 {
                let cell = q.floor();
                let dark = (cell.x + cell.y).rem_euclid(2.0) < 1.0;
                best = (distance, albedo(if dark { 0x18181A } else { 0xE8E8E2 }));
            }
        }
        best
    }

    /// True on paint and close to it: where small Gaussians are needed.
    pub(crate) fn near(&self, p: DVec2) -> bool {
        self.nearest(p).0 < 0.05
    }

    /// Albedo of the ground whose bare albedo is `bare`.
    pub(crate) fn over(&self, bare: DVec3, p: DVec2) -> DVec3 {
        let (distance, color) = self.nearest(p);
        bare.lerp(color, (0.5 - distance / FADE).clamp(0.0, 1.0))
    }
}

impl Default for Markings {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paint_is_where_it_should_be() {
        let (markings, bare) = (Markings::new(), DVec3::splat(0.1));
        assert_eq!(markings.over(bare, DVec2::ZERO), bare);
        assert!(markings.over(bare, DVec2::new(RING_RADIUS, 0.0)).x > 0.5);
        assert!(markings.over(bare, DVec2::new(0.0, 7.0)).x > 0.5 && markings.near(DVec2::new(0.1, 7.0)));
        let square = |k: f64| markings.over(bare, DVec2::new(CHEQUERS[0] + 0.2, SQUARE * (k + 0.5)));
        assert!((square(0.0).x > 0.5) != (square(1.0).x > 0.5));
    }
}
