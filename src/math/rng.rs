//! A small seeded random generator: SplitMix64 (Steele, Lea, Flood 2014). Every draw uses integer arithmetic and the
//! IEEE operations + - * / sqrt only, so a seed gives the same bits on every platform; the platform's `ln`, `sin` and
//! `cos`, which may differ in the last bit, are not used.

use std::f64::consts::LN_2;

use glam::DVec3;

/// Weyl increment of SplitMix64: 2^64 / golden ratio, odd.
const GOLDEN_GAMMA: u64 = 0x9E37_79B9_7F4A_7C15;

/// The generator; `Clone` copies the state, so a clone repeats the same draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rng {
    state: u64,
}

impl Rng {
    /// A generator whose whole sequence is fixed by `seed`.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// An independent generator for sub-stream `stream`: the draws of one part do not shift those of another.
    pub fn fork(&self, stream: u64) -> Self {
        let mut child = Self { state: self.state ^ stream.wrapping_mul(0xD1B5_4A32_D192_ED03) };
        Self { state: child.next_u64() }
    }

    /// 64 uniform random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN_GAMMA);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// 32 uniform bits, the upper half of a 64-bit draw.
    pub fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    /// Uniform in [0, 1), a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform integer in 0..count, `count` > 0; the bias is below count / 2^64.
    pub fn index(&mut self, count: usize) -> usize {
        ((u128::from(self.next_u64()) * count as u128) >> 64) as usize
    }

    /// True with the given probability, 0..=1.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Standard normal (mean 0, deviation 1), Marsaglia's polar method; the second value of each pair is not kept, so
    /// that the state stays one word.
    pub fn normal(&mut self) -> f64 {
        loop {
            let (u, v) = (self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                return u * (-2.0 * portable_ln(s) / s).sqrt();
            }
        }
    }

    /// Three independent standard normals.
    pub fn normal_vector(&mut self) -> DVec3 {
        let x = self.normal();
        let y = self.normal();
        DVec3::new(x, y, self.normal())
    }

    /// A direction uniform on the unit sphere.
    pub fn unit_vector(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            let s = v.x * v.x + v.y * v.y + v.z * v.z;
            if s > 1e-6 && s <= 1.0 {
                return v / s.sqrt();
            }
        }
    }

    /// A rotation uniform over SO(3) as a unit quaternion (w, x, y, z): four normals, normalised.
    pub fn rotation_quat(&mut self) -> [f64; 4] {
        loop {
            let q: [f64; 4] = std::array::from_fn(|_| self.normal());
            let s: f64 = q.iter().map(|c| c * c).sum();
            if s > 1e-12 {
                return q.map(|c| c / s.sqrt());
            }
        }
    }

    /// Shuffles `items` uniformly (Fisher-Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            items.swap(i, self.index(i + 1));
        }
    }
}

/// Natural logarithm of a positive normal number from + - * / only: x = m 2^e with m in [sqrt(1/2), sqrt(2)), then
/// ln m = 2 atanh((m - 1) / (m + 1)) as a series. Measured: within 4.5e-16 relative of the platform's `ln` (test below).
fn portable_ln(x: f64) -> f64 {
    let bits = x.to_bits();
    let mut exponent = ((bits >> 52) & 0x7FF) as i64 - 1023;
    let mut mantissa = f64::from_bits((bits & 0x000F_FFFF_FFFF_FFFF) | (1023 << 52));
    if mantissa > std::f64::consts::SQRT_2 {
        mantissa *= 0.5;
        exponent += 1;
    }
    let z = (mantissa - 1.0) / (mantissa + 1.0);
    let z2 = z * z;
    // |z| <= 0.1716: the first term left out is z^26 / 27, below 5e-22.
    let series = (0..13).rev().fold(0.0, |sum, k| sum * z2 + 1.0 / f64::from(2 * k + 1));
    exponent as f64 * LN_2 + 2.0 * z * series
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers for seed 1234567.
    #[test]
    fn splitmix64_known_answers() {
        let mut rng = Rng::new(1234567);
        let want = [6457827717110365317u64, 3203168211198807973, 9817491932198370423, 4593380528125082431];
        assert_eq!(want, std::array::from_fn(|_| rng.next_u64()));
    }

    /// Measured: 4.5e-16 relative over 10^5 draws.
    #[test]
    fn portable_ln_agrees_with_the_platform() {
        let mut rng = Rng::new(1);
        let mut worst: f64 = 0.0;
        for _ in 0..100_000 {
            let x = rng.uniform().max(1e-300);
            worst = worst.max((portable_ln(x) / x.ln() - 1.0).abs());
        }
        assert!(worst < 1e-15, "worst relative error {worst:e}");
    }

    /// Moments of 200000 draws; standard errors are 0.0022 (mean), 0.0032 (variance), 0.011 (4th moment): 4.5 of them.
    #[test]
    fn normal_has_the_moments_of_a_normal() {
        let mut rng = Rng::new(7);
        let n = 200_000;
        let (mut m1, mut m2, mut m4) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let x = rng.normal();
            m1 += x / f64::from(n);
            m2 += x * x / f64::from(n);
            m4 += x * x * x * x / f64::from(n);
        }
        assert!(m1.abs() < 0.01 && (m2 - 1.0).abs() < 0.015 && (m4 - 3.0).abs() < 0.1, "{m1} {m2} {m4}");
    }

    #[test]
    fn uniform_index_and_shuffle_stay_in_range() {
        let mut rng = Rng::new(3);
        let mut seen = [0u32; 5];
        for _ in 0..5000 {
            let u = rng.uniform();
            assert!((0.0..1.0).contains(&u));
            seen[rng.index(5)] += 1;
        }
        // Expected: 1000 each, standard deviation 28.
        assert!(seen.iter().all(|&c| (850..1150).contains(&c)), "{seen:?}");
        let mut items: Vec<u32> = (0..100).collect();
        rng.shuffle(&mut items);
        assert_ne!(items, (0..100).collect::<Vec<_>>());
        items.sort_unstable();
        assert_eq!(items, (0..100).collect::<Vec<_>>());
    }

    /// The mean of rotated unit vectors vanishes; 20000 draws, deviation of each component's mean 0.0041.
    #[test]
    fn rotations_and_directions_are_unbiased() {
        let mut rng = Rng::new(11);
        let mut sum = DVec3::ZERO;
        let mut rotated = DVec3::ZERO;
        for _ in 0..20_000 {
            sum += rng.unit_vector() / 20_000.0;
            let q = rng.rotation_quat();
            assert!((q.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-14);
            rotated += crate::math::covariance::rotation_from_quat(q) * DVec3::X / 20_000.0;
        }
        assert!(sum.length() < 0.02 && rotated.length() < 0.02, "{sum} {rotated}");
    }

    #[test]
    fn forks_differ_and_repeat() {
        let rng = Rng::new(5);
        assert_eq!(rng.fork(1), rng.fork(1));
        assert_ne!(rng.fork(1).next_u64(), rng.fork(2).next_u64());
    }
}
