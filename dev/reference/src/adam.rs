//! Twin of pass `adam`: one step of Adam (Kingma and Ba 2015, Algorithm 1).
//!
//! m = b1 m + (1 - b1) g, v = b2 v + (1 - b2) g^2, x -= rate m' / (sqrt(v') + eps) with m' = m / (1 - b1^t) and v' = v
//! / (1 - b2^t), t = 1 for the first step. eps is added outside the square root.

/// The constants of Adam, the same for all steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamOptions {
    /// Decay of the first moment, 0..1.
    pub beta1: f64,
    /// Decay of the second moment, 0..1.
    pub beta2: f64,
    /// Added to the square root of the second moment, in units of the gradient.
    pub epsilon: f64,
}

impl Default for AdamOptions {
    /// The values of 3DGS: 0.9, 0.999, 1e-15.
    fn default() -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-15 }
    }
}

/// Parameters with their moments; all arrays have the same length, and moments are 0 before the first step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AdamState {
    /// The values that are optimised.
    pub parameters: Vec<f64>,
    /// Decaying mean of the gradients, without bias correction.
    pub first_moments: Vec<f64>,
    /// Decaying mean of the squared gradients, without bias correction.
    pub second_moments: Vec<f64>,
}

impl AdamState {
    /// The state before the first step.
    pub fn new(parameters: Vec<f64>) -> Self {
        let zeros = vec![0.0; parameters.len()];
        Self { parameters, first_moments: zeros.clone(), second_moments: zeros }
    }
}

/// Gradients from this magnitude on, and NaN, count as 0: their squares would stay in the moments for good.
pub const GRADIENT_LIMIT: f64 = 1e15;

/// One step of Adam. `step` counts from 1; the first `split` parameters use the first of the `rates`, the others the
/// second, in units of the parameters.
pub fn adam_step(
    options: &AdamOptions,
    state: &mut AdamState,
    gradients: &[f64],
    step: u64,
    (rates, split): ([f64; 2], usize),
) {
    assert_eq!(gradients.len(), state.parameters.len(), "one gradient per parameter");
    let AdamOptions { beta1, beta2, epsilon } = *options;
    let bias = |beta: f64| 1.0 - beta.powf(step as f64);
    for (i, &g) in gradients.iter().enumerate() {
        let g = if g.abs() < GRADIENT_LIMIT { g } else { 0.0 };
        let m = beta1 * state.first_moments[i] + (1.0 - beta1) * g;
        let v = beta2 * state.second_moments[i] + (1.0 - beta2) * g * g;
        let rate = rates[usize::from(i >= split)];
        state.parameters[i] -= rate * (m / bias(beta1)) / ((v / bias(beta2)).sqrt() + epsilon);
        (state.first_moments[i], state.second_moments[i]) = (m, v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// The moments written out as sums over all steps instead of recursively; `bias_step` replaces t in the bias
    /// correction, so that a wrong t can be planted.
    fn written_out(options: &AdamOptions, gradients: &[f64], rates: &[f64], bias_step: impl Fn(usize) -> f64) -> f64 {
        let decaying = |beta: f64, t: usize, power: i32| -> f64 {
            let sum: f64 = (0..t).map(|i| beta.powf((t - 1 - i) as f64) * gradients[i].powi(power)).sum();
            (1.0 - beta) * sum / (1.0 - beta.powf(bias_step(t)))
        };
        (1..=gradients.len()).fold(1.5, |x, t| {
            let (m, v) = (decaying(options.beta1, t, 1), decaying(options.beta2, t, 2));
            x - rates[t - 1] * m / (v.sqrt() + options.epsilon)
        })
    }

    /// Steps agree with the sums written out. Measured over 40 steps: 2.2e-16.
    #[test]
    fn steps_agree_with_the_sums_written_out() {
        let mut rng = Rng::new(8);
        for options in [AdamOptions::default(), AdamOptions { beta1: 0.5, beta2: 0.9, epsilon: 0.1 }] {
            let gradients: Vec<f64> = (0..40).map(|_| rng.normal()).collect();
            let rates: Vec<f64> = (0..40).map(|_| rng.range(0.001, 0.1)).collect();
            let mut state = AdamState::new(vec![1.5]);
            for (i, (&g, &rate)) in gradients.iter().zip(&rates).enumerate() {
                adam_step(&options, &mut state, &[g], i as u64 + 1, ([rate, 0.0], 1));
            }
            let want = written_out(&options, &gradients, &rates, |t| t as f64);
            let error = (state.parameters[0] - want).abs();
            assert!(error < 1e-12, "{error:e}");
            let late = written_out(&options, &gradients, &rates, |t| t as f64 + 1.0);
            assert!((state.parameters[0] - late).abs() > 1e-3, "a step count that is off by one is not seen");
        }
    }

    /// A first gradient of any size moves a parameter by the rate; a gradient of 0 does not move it (no 0 / 0).
    #[test]
    fn the_first_step_is_the_rate() {
        let mut state = AdamState::new(vec![0.0; 4]);
        adam_step(&AdamOptions::default(), &mut state, &[1e-6, -3.0, 1e6, 0.0], 1, ([0.01, 0.02], 2));
        for (got, want) in state.parameters.iter().zip([-0.01, 0.01, -0.02, 0.0]) {
            assert!((got - want).abs() < 1e-10, "{got}");
        }
    }
}
