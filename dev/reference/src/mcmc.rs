//! Twin of the `mcmc_*` kernels (Kheradmand et al. 2024): relocation, growth, noise, regularisation.

use instgs_vk::math::covariance::{covariance, sigmoid};
use instgs_vk::scene::Gaussians;

use super::densify::is_finite;
use super::random::{RANDOM_NOISE, RANDOM_PICK, Stream};

/// Upper limit on Gaussians that share a position, as in the authors' code.
const SHARERS_MAX: u32 = 51;

/// Fixed-point opacities, `one` for opacity 1; 0 for dead Gaussians: opacity up to `opacity_min`, or not finite.
pub fn weights(cloud: &Gaussians, one: u32, opacity_min: f64) -> Vec<u32> {
    let weight = |i: usize| {
        let opacity = sigmoid(f64::from(cloud.opacity_logits[i]));
        let weight = (f64::from(one) * opacity).round() as u32;
        if is_finite(cloud, i) && opacity > opacity_min { weight.clamp(1, one) } else { 0 }
    };
    (0..cloud.len()).map(weight).collect()
}

/// For each of `after` Gaussians, its own index or, if it is dead or new, the index of the one it relocates to.
/// `weights` must not sum to 0.
pub fn origins(weights: &[u32], after: usize, seed: u64, time: u32) -> Vec<usize> {
    let ends: Vec<u64> = weights
        .iter()
        .scan(0, |sum, &w| {
            *sum += u64::from(w);
            Some(*sum)
        })
        .collect();
    let total = ends.last().copied().unwrap_or(0);
    let draw = |j: usize| {
        let bits = Stream { seed, time, purpose: RANDOM_PICK, index: j as u32 }.bits(0);
        let place = (u64::from(bits) * total) >> 32;
        // The first Gaussian whose cumulative weight exceeds the drawn value.
        ends.partition_point(|&end| end <= place)
    };
    (0..after).map(|j| if weights.get(j).is_some_and(|&w| w > 0) { j } else { draw(j) }).collect()
}

/// Opacity of each of `n` Gaussians that share a position, and the factor on their scales: the paper's Eq. 9, term by
/// term.
pub fn share(opacity: f64, n: u32) -> (f64, f64) {
    let n = n.min(SHARERS_MAX);
    let p = 1.0 - (1.0 - opacity).powf(1.0 / f64::from(n));
    let mut sum = 0.0;
    for i in 1..=n {
        // Binomial coefficients C(i - 1, k), by k.
        let mut binomial = 1.0;
        for k in 0..i {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            sum += sign * binomial * p.powi(k as i32 + 1) / f64::from(k + 1).sqrt();
            binomial *= f64::from(i - 1 - k) / f64::from(k + 1);
        }
    }
    (p, opacity / sum)
}

/// Noise on the centre of Gaussian `i` at step index `step`; `strength` is the learning rate times the noise factor.
pub fn noise(cloud: &Gaussians, i: usize, strength: f64, seed: u64, step: u32) -> [f64; 3] {
    let normals = Stream { seed, time: step, purpose: RANDOM_NOISE, index: i as u32 }.normals(0);
    let scales = glam::DVec3::from_array(cloud.log_scales[i].map(f64::from));
    let gate = sigmoid(100.0 * (1.0 - sigmoid(f64::from(cloud.opacity_logits[i])) - 0.995));
    let moved = covariance(cloud.quats[i].map(f64::from), scales) * glam::DVec3::from_array(normals);
    (strength * gate * moved).to_array()
}

/// Gradients of `opacity_weight` mean(opacity) + `scale_weight` mean(scale) with respect to the logit and log scales of
/// Gaussian `i`.
pub fn regularisation(cloud: &Gaussians, i: usize, opacity_weight: f64, scale_weight: f64) -> (f64, [f64; 3]) {
    let count = cloud.len() as f64;
    let opacity = sigmoid(f64::from(cloud.opacity_logits[i]));
    let by_log_scales = cloud.log_scales[i].map(|s| scale_weight / (3.0 * count) * f64::from(s).exp());
    (opacity_weight / count * opacity * (1.0 - opacity), by_log_scales)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One Gaussian alone does not change; n together are as opaque as the original.
    #[test]
    fn sharers_look_like_the_one_before() {
        for opacity in [0.006, 0.3, 0.9, 0.999] {
            let (p, factor) = share(opacity, 1);
            assert!((p - opacity).abs() < 1e-15 && (factor - 1.0).abs() < 1e-12);
            for n in [2, 7, 51] {
                let (p, factor) = share(opacity, n);
                assert!((1.0 - (1.0 - p).powi(n as i32) - opacity).abs() < 1e-12, "{opacity} {n}");
                assert!(factor < 1.0 + 1e-12 && factor > 0.3, "{opacity} {n}: {factor}");
            }
            assert_eq!(share(opacity, 51), share(opacity, 400));
        }
        // By hand: p = 0.5, sum = p + (p - p^2 / sqrt 2).
        let (p, factor) = share(0.75, 2);
        assert!((p - 0.5).abs() < 1e-15 && (factor - 0.75 / (1.0 - 0.25 / 2f64.sqrt())).abs() < 1e-12);
    }

    #[test]
    fn draws_follow_the_weights() {
        let weights = [0, 10, 0, 30, 60, 0];
        let n = 100_000;
        let origins = origins(&weights, 6 + n, 3, 600);
        assert_eq!((origins[1], origins[3], origins[4]), (1, 3, 4));
        for (i, &w) in weights.iter().enumerate() {
            let p = f64::from(w) / 100.0;
            let drawn = origins[6..].iter().filter(|&&o| o == i).count() as f64 / n as f64;
            // Within four standard errors.
            assert!((drawn - p).abs() <= 4.0 * (p * (1.0 - p) / n as f64).sqrt(), "{i}: {drawn} for {p}");
        }
    }
}
