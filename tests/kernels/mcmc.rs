//! The strategy `mcmc` on the device against the twin: draws exactly, shared opacities and scales to rounding.

use std::sync::Arc;

use instgs_reference::densify::is_finite;
use instgs_reference::mcmc::{noise, origins, regularisation, share, weights};
use instgs_train::config::TrainConfig;
use instgs_train::strategy::{DensifyOutcome, McmcStep};
use instgs_vk::gpu::staging::{download, upload, write};
use instgs_vk::gpu::{Gpu, PipelineCache, Recorder};
use instgs_vk::kernels::{McmcStepPipelines, Variant};
use instgs_vk::math::rng::Rng;
use instgs_vk::render::StepLog;

use crate::common::gpu::{assert_silent, gpu, trigonometric_error};
use crate::densify::{After, Case, MOST_SIGMAS, bits, config, download_state, random_case, strategy, upload_case};

const DONE: u64 = 200;

/// Weight of opacity 1 for `count` Gaussians, as the strategy picks it.
fn one(count: usize) -> u32 {
    (1 << 20).min(u32::MAX / count as u32)
}

/// A case whose opacities are near multiples of the weights' step, so that rounding cannot decide; a third is dead, and
/// one in twenty not finite.
pub(crate) fn case(seed: u64, count: usize, sh_degree: u32) -> Case {
    let mut case = random_case(seed, count, sh_degree);
    let mut rng = Rng::new(seed);
    let one = f64::from(one(count));
    let coefficients = case.cloud.sh_coefficients();
    for i in 0..count {
        let opacity = if i % 3 == 1 { rng.range(0.0005, 0.0045) } else { rng.range(0.006, 0.99) };
        let weight = (opacity * one).round();
        case.cloud.opacity_logits[i] = (weight / (one - weight)).ln() as f32;
        if i % 20 == 7 {
            case.cloud.sh[i * coefficients][0] = f32::NAN;
        }
    }
    case
}

pub(crate) fn mcmc_config(sets: &[&str]) -> TrainConfig {
    config(&[&["strategy=mcmc", "mcmc.start=100"], sets].concat())
}

pub(crate) fn run(gpu: &Arc<Gpu>, case: &Case, config: &TrainConfig) -> (DensifyOutcome, After) {
    let mut state = upload_case(gpu, case);
    let outcome = strategy(gpu, case.cloud.sh_degree).after_step(&mut state, config, DONE, 4.0).unwrap().unwrap();
    (outcome, download_state(gpu, &mut state))
}

/// Fails unless the device's state is the twin's; the largest errors of logits and log scales.
fn check(case: &Case, config: &TrainConfig, after: usize, got: &After) -> [f64; 2] {
    let (old, new) = (&case.cloud, &got.cloud);
    let weights = weights(old, one(old.len()), config.mcmc.opacity_min);
    let origins = origins(&weights, after, config.seed, DONE as u32);
    let mut copies = vec![0u32; old.len()];
    origins.iter().enumerate().filter(|&(j, &i)| i != j).for_each(|(_, &i)| copies[i] += 1);
    assert_eq!(new.len(), after);
    let mut worst = [0.0f64; 2];
    for (j, &i) in origins.iter().enumerate() {
        assert!(is_finite(new, j));
        assert_eq!(bits(&[new.means[j]]), bits(&[old.means[i]]), "{j} from {i}");
        assert_eq!(bits(&[new.quats[j]]), bits(&[old.quats[i]]), "{j} from {i}");
        assert_eq!(bits(new.sh_of(j)), bits(old.sh_of(i)), "{j} from {i}");
        let opacity = 1.0 / (1.0 + (-f64::from(old.opacity_logits[i])).exp());
        let (p, factor) = share(opacity, copies[i] + 1);
        let p = p.max(config.mcmc.opacity_min);
        let logit_error = (f64::from(new.opacity_logits[j]) - (p / (1.0 - p)).ln()).abs();
        worst[0] = worst[0].max(logit_error);
        for a in 0..3 {
            let error = f64::from(new.log_scales[j][a]) - f64::from(old.log_scales[i][a]) - factor.ln();
            worst[1] = worst[1].max(error.abs());
        }
        for (new, old) in got.moments.iter().zip(&case.moments) {
            let width = new.len() / after;
            let (new, old) = (&new[j * width..(j + 1) * width], &old[i * width..(i + 1) * width]);
            assert!(if copies[i] == 0 { new == old } else { new.iter().all(|m| *m == [0.0; 2]) }, "moments of {j}");
        }
    }
    // Measured on lavapipe: 4.1e-6 and 3.7e-6.
    assert!(worst[0] < 2e-5 && worst[1] < 2e-5, "{worst:?}");
    worst
}

/// Sizes around work-groups and blocks, all SH degrees, with growth, without, and up to a cap.
#[test]
fn relocation_and_growth_are_the_twins() {
    let Some(gpu) = gpu() else { return };
    let mut worst = [0.0f64; 2];
    for (seed, (count, sh_degree)) in [(2, 0), (9, 1), (257, 2), (2049, 3), (3900, 0)].into_iter().enumerate() {
        let case = case(seed as u64, count, sh_degree);
        let dead = weights(&case.cloud, one(count), 0.005).iter().filter(|&&w| w == 0).count();
        let cap = format!("max_gaussians={}", count + 1);
        for (sets, after) in [
            (&[][..], (1.05 * count as f64) as usize),
            (&["mcmc.growth=1"], count),
            (&["mcmc.growth=4"], 4 * count),
            (&["mcmc.growth=3", &cap], count + 1),
        ] {
            let config = mcmc_config(sets);
            let (outcome, got) = run(&gpu, &case, &config);
            let want = DensifyOutcome {
                relocated: dead as u32,
                added: (after - count) as u32,
                gaussians: after as u32,
                ..Default::default()
            };
            assert_eq!(outcome, want);
            let errors = check(&case, &config, after, &got);
            worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
            assert!(run(&gpu, &case, &config).1 == got, "repeated");
        }
    }
    println!("largest error of logits {:.2e}, of log scales {:.2e}", worst[0], worst[1]);
    assert_silent(&gpu);
}

/// From faint to opaque, 2 to 200 copies: one living Gaussian, the others join it.
#[test]
fn opacities_and_scales_of_many_sharers() {
    let Some(gpu) = gpu() else { return };
    let mut worst = [0.0f64; 2];
    for copies in [1, 2, 3, 5, 13, 50, 200] {
        for logit in [-5.0, -3.0, -1.0, 0.0, 2.0, 5.0, 9.0] {
            let mut case = random_case(3, copies + 1, 0);
            case.cloud.opacity_logits.fill(-8.0);
            case.cloud.opacity_logits[copies / 2] = logit;
            let config = mcmc_config(&["mcmc.growth=1", "mcmc.opacity_min=0.001"]);
            let errors = check(&case, &config, copies + 1, &run(&gpu, &case, &config).1);
            worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
        }
    }
    println!("largest error of logits {:.2e}, of log scales {:.2e}", worst[0], worst[1]);
    assert_silent(&gpu);
}

/// Joins are as frequent as opacities are large: sums over tenths of the opacities, within four standard errors.
#[test]
fn joins_are_proportional_to_opacity() {
    let Some(gpu) = gpu() else { return };
    let (count, growth) = (4000, 10);
    let mut case = random_case(77, count, 0);
    case.cloud.means.iter_mut().enumerate().for_each(|(i, m)| m[0] = i as f32);
    let mut rng = Rng::new(1);
    let opacities: Vec<f64> = (0..count).map(|_| rng.range(0.01, 0.99)).collect();
    case.cloud.opacity_logits = opacities.iter().map(|o| (o / (1.0 - o)).ln() as f32).collect();
    let (_, got) = run(&gpu, &case, &mcmc_config(&["mcmc.growth=10"]));
    let draws = (growth - 1) * count;
    let total: f64 = opacities.iter().sum();
    for tenth in 0..10 {
        let inside = |i: usize| (opacities[i] * 10.0) as usize == tenth;
        let p = (0..count).filter(|&i| inside(i)).map(|i| opacities[i]).sum::<f64>() / total;
        let drawn = got.cloud.means[count..].iter().filter(|m| inside(m[0] as usize)).count() as f64 / draws as f64;
        assert!((drawn - p).abs() < 4.0 * (p * (1.0 - p) / draws as f64).sqrt(), "tenth {tenth}: {drawn} for {p}");
    }
    assert_silent(&gpu);
}

/// The error says why, and the state is as before.
#[test]
fn all_dead_is_an_error_that_changes_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(5, 300, 1);
    case.cloud.opacity_logits.fill(-6.0);
    let mut state = upload_case(&gpu, &case);
    let error = strategy(&gpu, 1).after_step(&mut state, &mcmc_config(&[]), DONE, 4.0).unwrap_err().to_string();
    assert!(error.contains("all 300 Gaussians") && error.contains("mcmc.opacity_min = 0.005"), "{error}");
    let after = download_state(&gpu, &mut state);
    assert!(after.cloud == case.cloud && after.statistics == case.statistics);
    assert!(after.moments.iter().zip(&case.moments).all(|(a, b)| a == b));
    assert_silent(&gpu);
}

/// Noise and regularisers against the twin; neither does anything after an overflow.
#[test]
fn extras_of_a_step_are_the_twins() {
    let Some(gpu) = gpu() else { return };
    let variant = Variant::for_training(gpu.caps());
    let pipelines = McmcStepPipelines::new(&gpu, &PipelineCache::new(&gpu, None).unwrap(), &variant).unwrap();
    let case = random_case(21, 3001, 1);
    let cloud = &case.cloud;
    let extra = McmcStep { seed: 1 << 33 | 5, noise: 80.0, opacity_weight: 0.3, scale_weight: 0.7 };
    let mut log = StepLog::new(&gpu, 1).unwrap();
    let (mut noise_error, mut moved) = (0.0f64, 0);
    for overflow in [0u32, 1] {
        write(&gpu, &mut log.status, &[overflow]).unwrap();
        let mut state = upload_case(&gpu, &case);
        state.gradients.parameters.opacity_logits = upload(&gpu, "g", &vec![0.25; cloud.len()]).unwrap();
        state.gradients.parameters.log_scales = upload(&gpu, "g", &vec![[0.5; 3]; cloud.len()]).unwrap();
        let mut recorder = Recorder::new(&gpu).unwrap();
        let size = variant.workgroup_size;
        extra.record_regularisation(&mut recorder, &pipelines, size, &log, &mut state).unwrap();
        extra.record_noise(&mut recorder, &pipelines, size, &log, &mut state, 17).unwrap();
        let ticket = recorder.submit().unwrap();
        recorder.wait(ticket).unwrap();
        let by_logit = download(&gpu, &state.gradients.parameters.opacity_logits, cloud.len()).unwrap();
        let by_scales = download(&gpu, &state.gradients.parameters.log_scales, cloud.len()).unwrap();
        let after = download_state(&gpu, &mut state).cloud;
        if overflow != 0 {
            assert!(after == *cloud && by_logit.iter().all(|&g| g == 0.25) && by_scales.iter().all(|&g| g == [0.5; 3]));
            continue;
        }
        for i in 0..cloud.len() {
            let (want_logit, want_scales) = regularisation(cloud, i, 0.3, 0.7);
            // Sums of order 1 in f32.
            assert!((f64::from(by_logit[i]) - 0.25 - want_logit).abs() < 1e-7);
            let want = noise(cloud, i, 80.0, extra.seed, 17);
            let length = glam::DVec3::from_array(want).length();
            moved += u32::from(length > 1e-3);
            for a in 0..3 {
                assert!((f64::from(by_scales[i][a]) - 0.5 - want_scales[a]).abs() < 1e-7);
                let error = (f64::from(after.means[i][a]) - f64::from(cloud.means[i][a]) - want[a]).abs();
                noise_error = noise_error.max(error / length.max(0.1));
            }
        }
    }
    println!("{moved} moved; noise within {noise_error:.2e} of its length or of 0.1");
    let allowed = 1e-4 + MOST_SIGMAS * trigonometric_error(&gpu);
    assert!(moved > 100 && noise_error < allowed, "{moved} {noise_error:.2e}");
    assert_silent(&gpu);
}
