//! The differences between cars: colours, pattern, wing, ride height, steering. All of them become
//! per-instance offsets of the one template.

use glam::{DVec2, DVec3};

use crate::car::{AXLE_X, CarSurfel, Part, WHEEL_Y};
use crate::shading::albedo;
use instgs_vk::math::rng::Rng;

/// Layout of the two paints on a car.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// A single colour all over.
    Plain,
    /// Two stripes from nose to tail.
    Stripes,
    /// The second colour below a rising line.
    TwoTone,
    /// A broad band across nose and tail.
    Bands,
}

/// The rear wing of one car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wing {
    /// Moved up by this distance in metres (0 = as in the template).
    Raised(f64),
    /// Removed, by making its Gaussians transparent.
    Removed,
}

/// One car's appearance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Livery {
    /// Main paint, linear albedo.
    pub primary: DVec3,
    /// Second paint, linear albedo.
    pub secondary: DVec3,
    /// Colour of the wheels' rims, linear albedo.
    pub rims: DVec3,
    /// Layout of the paints.
    pub pattern: Pattern,
    /// White discs for the start number on doors and bonnet.
    pub roundels: bool,
    /// State of the rear wing.
    pub wing: Wing,
    /// Distance in metres by which everything but the wheels is raised.
    pub ride_height: f64,
    /// Angle of the front wheels in radians, left positive.
    pub steering: f64,
}

/// (main, second) paints, sRGB.
const PAINTS: [(u32, u32); 12] = [
    (0xC8141E, 0xF2F2F0),
    (0x1446A0, 0xF07818),
    (0xF4C20D, 0x16181C),
    (0x0E6B4C, 0xE8D44A),
    (0xF0F0EE, 0x1450B4),
    (0xF06A12, 0x12203C),
    (0x16181C, 0xC81E28),
    (0x78BEE6, 0xF06414),
    (0x6A1E8C, 0xE6E6E6),
    (0xB8BCC4, 0xC8141E),
    (0x0AA0A0, 0xF4F4F0),
    (0xE0387C, 0x20242C),
];

impl Livery {
    /// The template's own look: mid grey, so that offsets stay small in every direction.
    pub const TEMPLATE: Self = Self {
        primary: DVec3::splat(0.24),
        secondary: DVec3::splat(0.24),
        rims: DVec3::splat(0.30),
        pattern: Pattern::Plain,
        roundels: false,
        wing: Wing::Raised(0.0),
        ride_height: 0.0,
        steering: 0.0,
    };

    /// The livery of car number `k`: paints are used in turn, the rest is random.
    pub fn drawn(k: usize, rng: &mut Rng) -> Self {
        let (primary, secondary) = PAINTS[(k * 5 + k / PAINTS.len()) % PAINTS.len()];
        let patterns = [Pattern::Stripes, Pattern::TwoTone, Pattern::Bands, Pattern::Plain];
        let rims = [0xC8CACE, 0x30323A, 0xB89040, 0xE8E8E8];
        Self {
            primary: albedo(primary),
            secondary: albedo(secondary),
            rims: albedo(rims[rng.index(rims.len())]),
            pattern: patterns[(k + k / 4) % patterns.len()],
            roundels: rng.chance(0.6),
            wing: match rng.index(4) {
                0 => Wing::Removed,
                1 => Wing::Raised(rng.range(0.06, 0.14)),
                _ => Wing::Raised(0.0),
            },
            ride_height: rng.range(-0.02, 0.02),
            steering: rng.range(-0.25, 0.25),
        }
    }

    /// Linear albedo of a surfel.
    pub fn albedo_of(&self, s: &CarSurfel) -> DVec3 {
        match s.part {
            Part::Paint => self.paint_over(s),
            Part::Wing => self.secondary * 0.6 + DVec3::splat(0.012),
            Part::Rim => self.rims,
            Part::Glass => DVec3::new(0.010, 0.013, 0.017),
            Part::Tyre => DVec3::splat(0.016),
            Part::Carbon => DVec3::splat(0.020),
            Part::Headlight => DVec3::new(0.80, 0.86, 0.92),
            Part::Taillight => DVec3::new(0.55, 0.01, 0.015),
        }
    }

    /// The mean over the disc, so that the edges of a pattern are smooth where discs are coarse.
    fn paint_over(&self, s: &CarSurfel) -> DVec3 {
        let (a, b) = s.surfel.normal.any_orthonormal_pair();
        let reach = 0.55 * s.surfel.spacing;
        let taps = [DVec2::ZERO, DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y];
        let at = |tap: DVec2| self.paint_at(s.surfel.position + (a * tap.x + b * tap.y) * reach, s.surfel.normal);
        taps.into_iter().map(at).sum::<DVec3>() / taps.len() as f64
    }

    fn paint_at(&self, p: DVec3, normal: DVec3) -> DVec3 {
        let door = DVec2::new(p.x + 0.05, p.z - 0.52).length() < 0.20 && normal.y.abs() > 0.6;
        let bonnet = DVec2::new(p.x - 1.42, p.y).length() < 0.22 && normal.z > 0.5;
        if self.roundels && (door || bonnet) {
            // A "1" in the disc.
            let (across, along) = if door { (p.x + 0.05, p.z - 0.52) } else { (p.y, p.x - 1.42) };
            let digit = across.abs() < 0.035 && along.abs() < 0.12;
            return DVec3::splat(if digit { 0.015 } else { 0.82 });
        }
        let second = match self.pattern {
            Pattern::Plain => false,
            Pattern::Stripes => (0.07..0.25).contains(&p.y.abs()) && normal.z.abs() + normal.x.abs() > 0.5,
            Pattern::TwoTone => p.z < 0.46 - 0.10 * p.x,
            Pattern::Bands => p.x > 1.62 || (p.x < -1.45 && p.z > 0.35),
        };
        if second { self.secondary } else { self.primary }
    }

    /// Displacement of a surfel in the template frame, metres.
    pub fn displacement(&self, s: &CarSurfel) -> DVec3 {
        let p = s.surfel.position;
        let wheel = (p.x.abs() - AXLE_X).abs() < 0.37 && matches!(s.part, Part::Tyre | Part::Rim);
        let spoke_gap = s.part == Part::Carbon && s.surfel.spacing < 0.03;
        if wheel || spoke_gap {
            if p.x < 0.0 {
                return DVec3::ZERO;
            }
            let hub = DVec2::new(AXLE_X, WHEEL_Y * p.y.signum());
            let from_hub = DVec2::new(p.x, p.y) - hub;
            let turned = DVec2::from_angle(self.steering).rotate(from_hub) - from_hub;
            return turned.extend(0.0);
        }
        let raised = match self.wing {
            Wing::Raised(by) if s.part == Part::Wing => by,
            _ => 0.0,
        };
        DVec3::Z * (self.ride_height + raised)
    }

    /// True if this car does not have the surfel.
    pub fn hides(&self, s: &CarSurfel) -> bool {
        s.part == Part::Wing && self.wing == Wing::Removed
    }
}
