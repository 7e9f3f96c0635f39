//! The values of a configuration at a given step. Pure functions, so that a resumed run gets those of an uninterrupted
//! one.
//!
//! `step` is the index of a step, from 0, and selects the values that the step uses. `done` is the number of finished
//! steps, from 1, and selects the work between two steps. After step index s, `done` is s + 1.

use super::{Background, ExposureConfig, Method, Strategy, TrainConfig};

/// Learning rates of one step by group of parameters, parameter units. A parameter with rate 0 does not change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Gaussians of the templates.
    pub template: GaussianRates,
    /// Gaussians of the background.
    pub background: GaussianRates,
    /// Offsets of instances, each in the unit of the parameter that it is added to.
    pub offsets: GaussianRates,
    /// Colour matrices of instances.
    pub color_matrices: f64,
    /// Learning rates of instance poses.
    pub poses: PoseRates,
}

/// Learning rates of Gaussians, or of offsets to them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianRates {
    /// Centres, scene or template units.
    pub means: f64,
    /// SH coefficient 0, the base colour.
    pub sh_dc: f64,
    /// The other SH coefficients.
    pub sh_rest: f64,
    /// Rate of the opacity logits.
    pub opacity: f64,
    /// Logarithms of the scales.
    pub log_scales: f64,
    /// Rate of the quaternions.
    pub quats: f64,
}

/// Learning rates of the poses of instances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseRates {
    /// Positions, template units.
    pub translation: f64,
    /// Rotation vectors, radians.
    pub rotation: f64,
    /// Logarithms of the scale factors.
    pub log_scale: f64,
}

impl PoseRates {
    /// The rates in the order in which the device keeps them.
    pub fn values(&self) -> [f64; 3] {
        [self.translation, self.rotation, self.log_scale]
    }

    /// True if no pose changes.
    pub fn are_held(&self) -> bool {
        *self == Self::default()
    }
}

impl TrainConfig {
    /// Learning rates of step index `step`; `extent` is the scene's, scene units.
    pub fn rates_at(&self, step: u64, extent: f64) -> Rates {
        if self.method == Method::Instanced {
            return self.joint_rates_at(step, extent);
        }
        let rates = &self.rates;
        let all_if_zero = |steps| if steps == 0 { self.steps } else { steps };
        let means_steps = all_if_zero(rates.means_steps);
        let factor = late_decay(rates.final_factor, rates.decay_start, step, all_if_zero(rates.decay_steps));
        let source = GaussianRates {
            means: log_linear(rates.means, rates.means_final, step, means_steps) * extent,
            sh_dc: rates.sh_dc * factor,
            sh_rest: rates.sh_rest * factor,
            opacity: rates.opacity * factor,
            log_scales: rates.log_scales * factor,
            quats: rates.quats * factor,
        };
        let (offsets, poses) = (GaussianRates::default(), PoseRates::default());
        Rates { template: source, background: source, offsets, color_matrices: 0.0, poses }
    }

    /// Learning rate of the exposures of photos at step index `step`; `None` if photos have no exposures.
    pub fn exposure_rate_at(&self, step: u64) -> Option<f64> {
        let ExposureConfig { rate, rate_final } = self.exposure;
        (rate > 0.0).then(|| log_linear(rate, rate_final, step, self.steps))
    }

    /// SH degree that step index `step` uses, 0..=`sh_degree`. The base colours of a given cloud have settled already, so it has
    /// all degrees from the start.
    pub fn sh_degree_at(&self, step: u64) -> u32 {
        if self.init_scene.is_some() {
            return self.sh_degree;
        }
        let risen = step.checked_div(self.sh_every).unwrap_or(u64::MAX);
        u32::try_from(risen).unwrap_or(u32::MAX).min(self.sh_degree)
    }

    /// True if the strategy adds, moves or removes Gaussians once `done` steps are finished. Never after the last step,
    /// as nothing would train the new ones.
    pub fn densifies_at(&self, done: u64) -> bool {
        let (densify, mcmc) = (&self.densify, &self.mcmc);
        let (start, stop, fraction, every) = match self.strategy {
            Strategy::Densify => (densify.start, densify.stop, densify.stop_fraction, densify.every),
            Strategy::Mcmc => (mcmc.start, mcmc.stop, mcmc.stop_fraction, mcmc.every),
            Strategy::None => return false,
        };
        start < done && done < self.earlier(stop, fraction) && done.is_multiple_of(every)
    }

    /// The smaller of the step `stop` and the fraction `fraction` of all steps, rounded to the nearest step.
    fn earlier(&self, stop: u64, fraction: f64) -> u64 {
        stop.min((fraction * self.steps as f64).round() as u64)
    }

    /// True if opacities are lowered once `done` steps are finished; after the densification of the same `done`, if
    /// both happen. With a white background there is one more reset when densification may start, as in INRIA's code:
    /// Gaussians that have learned to stand for the background by then can fade.
    pub fn resets_opacity_at(&self, done: u64) -> bool {
        let densify = &self.densify;
        let every = densify.opacity_reset_every;
        self.strategy == Strategy::Densify
            && every > 0
            && 0 < done
            && done < self.earlier(densify.stop, densify.stop_fraction)
            && (done.is_multiple_of(every) || self.background == Background::White && done == densify.start)
    }

    /// True if the densification at `done` also removes Gaussians that are too large on screen or in the world. Large
    /// Gaussians are needed to cover the picture until opacities have been reset for the first time. The early reset
    /// for a white background does not count, as in INRIA's code.
    pub fn prunes_large_at(&self, done: u64) -> bool {
        let every = self.densify.opacity_reset_every;
        self.densifies_at(done) && self.strategy == Strategy::Densify && every > 0 && done > every
    }

    /// True if test views are evaluated once `done` steps are finished; the last step is always evaluated.
    pub fn evaluates_at(&self, done: u64) -> bool {
        done == self.steps || self.eval_every > 0 && done > 0 && done.is_multiple_of(self.eval_every)
    }

    /// True if a checkpoint is written once `done` steps are finished; always after the last step.
    pub fn checkpoints_at(&self, done: u64) -> bool {
        done == self.steps || self.checkpoint_every > 0 && done > 0 && done.is_multiple_of(self.checkpoint_every)
    }
}

/// From `first` at step 0 to `last` from step `steps` on, by equal factors; both ends are exact. What begins at 0 stays there.
pub(super) fn log_linear(first: f64, last: f64, step: u64, steps: u64) -> f64 {
    if first == 0.0 {
        return 0.0;
    }
    if step >= steps {
        return last;
    }
    first * (last / first).powf(step as f64 / steps as f64)
}

/// 1 for the fraction `start` of the steps, then by equal factors down to `last` at step `steps`.
pub(super) fn late_decay(last: f64, start: f64, step: u64, steps: u64) -> f64 {
    let first_decaying = ((start * steps as f64).round() as u64).min(steps);
    if step < first_decaying {
        return 1.0;
    }
    log_linear(1.0, last, step.saturating_sub(first_decaying), steps - first_decaying)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{ConfigBuilder, ConfigError};

    fn with(sets: &[&str]) -> Result<TrainConfig, ConfigError> {
        sets.iter().try_fold(ConfigBuilder::new(), |builder, set| builder.set(set))?.finish()
    }

    #[test]
    fn means_decay_between_exact_ends() -> Result<(), ConfigError> {
        let config = with(&[])?;
        let means = |step| config.rates_at(step, 2.0).background.means;
        assert_eq!(means(0), 2.0 * 1.6e-4);
        assert_eq!((means(30_000), means(u64::MAX)), (2.0 * 1.6e-6, 2.0 * 1.6e-6));
        // Half way: the geometric mean.
        assert!((means(15_000) / (2.0 * 1.6e-5) - 1.0).abs() < 1e-12);
        assert!((0..30_000).step_by(1000).all(|s| means(s) > means(s + 1)));
        let short = with(&["steps=100", "rates.means_steps=0"])?;
        assert_eq!(short.rates_at(100, 1.0).background.means, 1.6e-6);
        assert!((short.rates_at(50, 1.0).background.means / 1.6e-5 - 1.0).abs() < 1e-12);
        let held = with(&["rates.means=0"])?;
        assert_eq!([7, 30_000, 40_000].map(|step| held.rates_at(step, 1.0).background.means), [0.0; 3]);
        Ok(())
    }

    #[test]
    fn other_rates_stay_unless_told_to_decay() -> Result<(), ConfigError> {
        let rates = with(&["rates.final_factor=1"])?.rates_at(29_999, 5.0).template;
        assert_eq!((rates.sh_dc, rates.sh_rest, rates.opacity), (2.5e-3, 1.25e-4, 0.025));
        assert_eq!((rates.log_scales, rates.quats), (5e-3, 1e-3));
        // A run of 7,000 steps goes through the first 7,000 of 30,000.
        let [short, long] = [with(&["steps=7000"])?, with(&[])?].map(|config| config.rates_at(7_000, 5.0));
        assert_eq!(short.template, long.template);
        assert!((short.template.quats / 1e-3 / 0.1_f64.powf(7.0 / 30.0) - 1.0).abs() < 1e-12);
        assert_eq!(with(&[])?.rates_at(40_000, 5.0).template.quats, 1e-3 * 0.1);
        let decaying = with(&["rates.final_factor=0.01", "rates.decay_steps=0", "steps=200"])?;
        assert_eq!(decaying.rates_at(0, 1.0).template.quats, 1e-3);
        assert!((decaying.rates_at(100, 1.0).template.quats / 1e-4 - 1.0).abs() < 1e-12);
        assert_eq!(decaying.rates_at(200, 1.0).template.opacity, 0.025 * 0.01);
        let late = with(&["rates.final_factor=0.01", "rates.decay_steps=200", "rates.decay_start=0.8"])?;
        let opacity = |step| late.rates_at(step, 1.0).template.opacity / 0.025;
        assert_eq!([opacity(0), opacity(160)], [1.0, 1.0]);
        assert!((opacity(180) / 0.1 - 1.0).abs() < 1e-12 && opacity(161) < 1.0);
        assert_eq!(opacity(200), 0.01);
        Ok(())
    }

    #[test]
    fn a_decay_that_begins_with_the_end_comes_after_it() -> Result<(), ConfigError> {
        // 0.8 of two steps are two.
        let late = with(&["rates.final_factor=0.01", "rates.decay_steps=2", "rates.decay_start=0.8"])?;
        let factor = |step| late.rates_at(step, 1.0).template.quats / 1e-3;
        assert_eq!([0, 1, 2, 9].map(factor), [1.0, 1.0, 0.01, 0.01]);
        Ok(())
    }

    #[test]
    fn sh_degree_rises_at_its_steps() -> Result<(), ConfigError> {
        let config = with(&[])?;
        let degrees = [0, 999, 1000, 1999, 2000, 2999, 3000, 4000, u64::MAX].map(|s| config.sh_degree_at(s));
        assert_eq!(degrees, [0, 0, 1, 1, 2, 2, 3, 3, 3]);
        assert_eq!(with(&["sh_degree=1"])?.sh_degree_at(5000), 1);
        assert_eq!(with(&["init_scene=trained.ply"])?.sh_degree_at(0), 3);
        assert_eq!(with(&["sh_every=0"])?.sh_degree_at(0), 3);
        Ok(())
    }

    /// Resets as in INRIA's code.
    const RESETS: &str = "densify.opacity_reset_every=3000";

    /// All values of `done` in 1..=steps for which `f` holds.
    fn times(config: &TrainConfig, f: impl Fn(&TrainConfig, u64) -> bool) -> Vec<u64> {
        (1..=config.steps).filter(|&done| f(config, done)).collect()
    }

    #[test]
    fn densification_lies_strictly_between_start_and_stop() -> Result<(), ConfigError> {
        let all = times(&with(&[])?, TrainConfig::densifies_at);
        assert_eq!((all.first(), all.last(), all.len()), (Some(&600), Some(&14_900), 144));
        let mcmc = times(&with(&["strategy=mcmc"])?, TrainConfig::densifies_at);
        assert_eq!((mcmc.first(), mcmc.last()), (Some(&600), Some(&24_900)));
        assert!(times(&with(&["strategy=none"])?, TrainConfig::densifies_at).is_empty());
        // A run that ends earlier does not densify after its last step.
        assert_eq!(times(&with(&["steps=800"])?, TrainConfig::densifies_at), [600, 700]);
        Ok(())
    }

    #[test]
    fn a_fraction_of_the_steps_stops_as_well() -> Result<(), ConfigError> {
        let short = ["steps=1000", "densify.start=100", "densify.stop_fraction=0.7", "densify.opacity_reset_every=100"];
        let config = with(&short)?;
        assert_eq!(times(&config, TrainConfig::densifies_at), [200, 300, 400, 500, 600]);
        assert_eq!(times(&config, TrainConfig::resets_opacity_at), [100, 200, 300, 400, 500, 600]);
        // The earlier of the two counts, and each strategy has its own.
        let both = with(&[&short[..], &["densify.stop=400"]].concat())?;
        assert_eq!(times(&both, TrainConfig::densifies_at), [200, 300]);
        assert_eq!(times(&both, TrainConfig::resets_opacity_at), [100, 200, 300]);
        let mcmc = ["strategy=mcmc", "mcmc.start=700", "mcmc.stop_fraction=0.9"];
        assert_eq!(times(&with(&[&short[..], &mcmc].concat())?, TrainConfig::densifies_at), [800]);
        // 0.7 as f64 is slightly smaller, but rounds to 700 of 1000: step 700 is excluded and 699 is included.
        let every = with(&[&short[..], &["densify.every=1"]].concat())?;
        assert_eq!(times(&every, TrainConfig::densifies_at).last(), Some(&699));
        Ok(())
    }

    /// Whatever the number of steps, from 300 to 2000, no Gaussians are added in the last 30 % (mcmc: 20 %).
    #[test]
    fn quick_fits_short_and_long_runs() -> Result<(), ConfigError> {
        for strategy in ["strategy=densify", "strategy=mcmc"] {
            for (steps, last) in [(300, [200, 200]), (500, [300, 350]), (1000, [650, 750]), (2000, [1350, 1550])] {
                let config =
                    ConfigBuilder::new().file("quick")?.set(strategy)?.set(&format!("steps={steps}"))?.finish()?;
                let all = times(&config, TrainConfig::densifies_at);
                let last = last[usize::from(strategy.ends_with("mcmc"))];
                assert_eq!((all.first(), all.last()), (Some(&150), Some(&last)), "{strategy} {steps}");
            }
        }
        Ok(())
    }

    #[test]
    fn before_white_opacities_are_reset_once_more() -> Result<(), ConfigError> {
        let resets = |more: &[&str]| {
            let config = with(&[&["steps=7000", RESETS], more].concat())?;
            Ok::<_, ConfigError>(times(&config, TrainConfig::resets_opacity_at))
        };
        assert_eq!(resets(&["background=white"])?, [500, 3000, 6000]);
        assert_eq!(resets(&["background=random"])?, [3000, 6000]);
        assert_eq!(resets(&["background=white", "densify.start=3000"])?, [3000, 6000]);
        assert_eq!(resets(&["background=white", "densify.start=0"])?, [3000, 6000]);
        for off in ["densify.opacity_reset_every=0", "strategy=mcmc", "densify.stop=500", "steps=500"] {
            assert!(resets(&["background=white", off])?.is_empty(), "{off}");
        }
        let white = with(&["background=white", RESETS])?;
        assert_eq!(times(&white, TrainConfig::prunes_large_at), times(&with(&[RESETS])?, TrainConfig::prunes_large_at));
        Ok(())
    }

    #[test]
    fn opacity_resets_and_the_pruning_that_follows() -> Result<(), ConfigError> {
        let config = with(&["steps=7000", RESETS])?;
        assert_eq!(times(&config, TrainConfig::resets_opacity_at), [3000, 6000]);
        let large = times(&config, TrainConfig::prunes_large_at);
        assert_eq!((large.first(), large.last()), (Some(&3100), Some(&6900)));
        assert_eq!(times(&with(&[RESETS])?, TrainConfig::resets_opacity_at), [3000, 6000, 9000, 12_000]);
        assert!(times(&with(&[])?, TrainConfig::resets_opacity_at).is_empty(), "off by default");
        for set in ["strategy=mcmc", "strategy=none", "densify.opacity_reset_every=0"] {
            let config = with(&[RESETS, set])?;
            assert!(times(&config, TrainConfig::resets_opacity_at).is_empty(), "{set}");
            assert!(times(&config, TrainConfig::prunes_large_at).is_empty(), "{set}");
        }
        assert!(!with(&[RESETS])?.resets_opacity_at(0));
        Ok(())
    }

    #[test]
    fn evaluation_and_checkpoints_come_with_the_last_step() -> Result<(), ConfigError> {
        let config = with(&["steps=250", "eval_every=100", "checkpoint_every=0"])?;
        assert_eq!(times(&config, TrainConfig::evaluates_at), [100, 200, 250]);
        assert_eq!(times(&config, TrainConfig::checkpoints_at), [250]);
        let config = with(&["steps=12000"])?;
        assert_eq!(times(&config, TrainConfig::evaluates_at), [12_000]);
        assert_eq!(times(&config, TrainConfig::checkpoints_at), [5000, 10_000, 12_000]);
        Ok(())
    }
}
