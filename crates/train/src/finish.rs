//! Trains a scene through the rounding of `--pack small`: what the file holds is to look like the photos.
//!
//! Each step rounds the scene as its file will, lets a training step move the rounded values, and moves those that are not
//! rounded by as much (the straight-through estimator of Bengio et al. 2013). They thus learn which way to be rounded, together
//! with all others.
//!
//! Centres, shapes, opacities and base colours of clouds are predicted from the Gaussian before, so that what they can be rounded
//! to changes with it. After half of the steps all values are set to what they are rounded to; these stay so from then on, and the
//! others go on from there.
//!
//! A value between two that it can be rounded to goes back and forth, and is on the wrong side in the end as often as not. So the
//! scene gets the means over the last steps of either half, but for shapes.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use instgs_io::IoError;
use instgs_io::small::{Sensitivity, SmallOptions, SmallPlan};
use instgs_vk::gpu::Gpu;
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::kernels::Variant;
use instgs_vk::optim::Adam;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::offset_runs::sources_of_records;
use instgs_vk::scene::{InstancedScene, Parameter, ParameterSet};

use super::config::{GaussianRates, PoseRates, Rates, TrainConfig};
use super::device_state::DeviceState;
use super::error::TrainError;
use super::finish_shapes::{Moved, are_shapes};
use super::memory::picture_budget;
use super::start::{TrainData, read_data};
use super::step_runner::{LearnEvery, StepPlan, StepRunner};
use super::view_order::ViewOrder;
use super::view_pictures::{background_at, train_options};
use super::views::{TrainViews, ViewsPlan};

/// Closeness of pictures, dB, at which a scene is rounded so little that nothing is lost: rotations get the axes of the file.
const EXACT_PSNR_DB: f64 = 110.0;
/// Part of the steps after which what is predicted from neighbours stays.
const HELD_FROM: f64 = 0.5;
/// Part of either half of the steps after which values are averaged.
const AVERAGED_FROM: f64 = 0.5;
/// The rates at the first step, for pictures of [`RATES_PSNR_DB`]: 0.3 of those of the preset `default`, of SH above 0 more, whose
/// steps of rounding are the coarsest, and of centres less, which are where they belong; those of centres times the scene extent.
/// Measured on lot_1 (test views), 420 steps, without them 33.99 dB: a third of these 34.19, these 34.21, three times these 34.22
/// with 1 % more bytes; on what tests/kernels/finish.rs measures, a third is as good and three times is harmful.
const RATES: GaussianRates =
    GaussianRates { means: 5e-6, sh_dc: 7.5e-4, sh_rest: 1.5e-4, opacity: 7.5e-3, log_scales: 1.5e-3, quats: 3e-4 };
/// Other closenesses have rates in proportion to their steps of rounding, which double for every 6 dB less.
const RATES_PSNR_DB: f64 = 46.0;
/// Largest factor of that: where steps are so coarse, Adam's noise would be what is learned.
const MOST_COARSE: f64 = 2.0;
/// Factor that the rates fall by from the first to the last step, log-linearly.
const FINAL_FACTOR: f64 = 0.1;
/// Weight of 1 - SSIM in the loss, and Adam's constants: those of the preset `default`.
const LAMBDA_DSSIM: f32 = 0.2;
const ADAM: Adam = Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-15, step: 1 };
/// Seed of the order of photos.
const SEED: u64 = 0;

/// A scene that is to be trained through its rounding, and how.
#[derive(Clone, Copy, Debug)]
pub struct FinishJob<'a> {
    /// The scene as it was trained.
    pub scene: &'a InstancedScene,
    /// How much its pictures change with each parameter.
    pub sensitivity: &'a Sensitivity,
    /// PSNR that pictures of the packed scene have beside those of this one, dB, as in [`SmallOptions`].
    pub picture_psnr_db: f64,
    /// The data set with the photos.
    pub data: &'a Path,
    /// The configuration of the scene's training: it says what photos show (their width, masks of pixels, the
    /// colour behind all splats); the near plane and the pixel filter are the scene's. Steps and rates are not taken from it.
    pub config: &'a TrainConfig,
    /// The file that is to be written; only used in messages.
    pub to: &'a Path,
    /// Number of training steps, each on one photo.
    pub steps: u64,
}

/// A scene, and how its file rounds it.
#[derive(Debug)]
pub struct Finished {
    /// The scene before it is rounded.
    pub scene: InstancedScene,
    /// The rounding.
    pub plan: SmallPlan,
    /// What there is to say about the data set, one line each.
    pub warnings: Vec<String>,
}

/// Trains a scene through its rounding. `on_step` is called after each step; `E` is the caller's error type, with which it can stop
/// the training.
///
/// # Errors
/// The photos cannot be read, or there are none, or they have exposures; instances share offsets or Gaussians of their own; the
/// sensitivity is of another scene; the device fails or is too small; or what `on_step` returns.
pub fn finish<E: From<TrainError>>(
    gpu: &Arc<Gpu>,
    job: &FinishJob<'_>,
    mut on_step: impl FnMut() -> Result<(), E>,
) -> Result<Finished, E> {
    check(job).map_err(TrainError::from)?;
    let plan_at = |picture_psnr_db| {
        let options = SmallOptions { sensitivity: job.sensitivity, picture_psnr_db };
        SmallPlan::new(job.scene, &options, job.to)
    };
    let plan = plan_at(job.picture_psnr_db).map_err(TrainError::from)?;
    let exact = plan_at(EXACT_PSNR_DB).map_err(TrainError::from)?;
    let mut scene = exact.rounded(job.scene, job.to).map_err(TrainError::from)?;
    let data = read_data(job.data, job.config, false)?;
    let mut steps = Steps::new(gpu, &scene, &data, job.config)?;
    let (record_sources, _) = sources_of_records(&scene.offset_runs(), scene.offsets.len());
    let coarseness = 10f64.powf((RATES_PSNR_DB - job.picture_psnr_db) / 20.0).min(MOST_COARSE);
    let held_from = (HELD_FROM * job.steps as f64) as u64;
    let averaged_from = |first: u64, end: u64| first + (AVERAGED_FROM * (end - first) as f64) as u64;
    let averaged = [averaged_from(0, held_from)..held_from, averaged_from(held_from, job.steps)..job.steps];
    let mut sums = Sums::default();
    let rows = scene.parameter_rows();
    for step in 0..job.steps {
        if step == held_from {
            std::mem::take(&mut sums).write_means(&mut scene);
        }
        let rounded = plan.rounded(&scene, job.to).map_err(TrainError::from)?;
        if step == held_from {
            scene.clone_from(&rounded);
        }
        let schedule = Schedule {
            factor: coarseness * FINAL_FACTOR.powf(step as f64 / job.steps as f64),
            held: step >= held_from,
        };
        let at_step = |error| TrainError::Step { step, error: Box::new(error), remedy: None, saved: None };
        let moved = steps.run(step, &rounded, &schedule).map_err(at_step)?;
        let mut after = rounded.clone();
        for (parameter, values) in moved.iter().filter(|(_, values)| !values.is_empty()) {
            after.set_parameter(parameter, rows[parameter], values);
            if !are_shapes(&scene, parameter) {
                let (mut sums, before) = (scene.parameter(parameter).into_owned(), rounded.parameter(parameter));
                let moves = values.iter().zip(before.iter()).map(|(after, before)| after - before);
                sums.iter_mut().zip(moves).for_each(|(sum, by)| *sum += by);
                scene.set_parameter(parameter, rows[parameter], &sums);
            }
        }
        Moved { scene: &mut scene, rounded: &rounded, after: &after, record_sources: &record_sources }.add();
        if averaged.iter().any(|steps| steps.contains(&step)) {
            sums.add(&scene);
        }
        on_step()?;
    }
    sums.write_means(&mut scene);
    Ok(Finished { scene, plan, warnings: data.warnings })
}

/// Refuses what cannot be finished.
fn check(job: &FinishJob<'_>) -> Result<(), IoError> {
    let refused = |what: &str, advice: &str| Err(IoError::new(job.to, format!("cannot write: {what}")).advise(advice));
    if job.config.exposure.rate > 0.0 {
        return refused(
            "the photos have exposures, which the scene would learn",
            "write it without finishing it, which is for scenes trained without exposure.rate",
        );
    }
    let mut firsts: Vec<u32> = job.scene.instances.iter().filter_map(|instance| instance.first_offset).collect();
    let offsets = firsts.len();
    firsts.sort_unstable();
    firsts.dedup();
    if firsts.len() < offsets || matches!(job.scene.with_packed_own(), Cow::Owned(_)) {
        return refused(
            "instances share offsets or Gaussians of their own, as duplicates do, or some belong to none",
            "finish it before it is edited, or write it without finishing it",
        );
    }
    Ok(())
}

/// Sums of a scene's parameters over steps, but for shapes.
#[derive(Default)]
struct Sums {
    of: Vec<(Parameter, Vec<f64>)>,
    steps: u64,
}

impl Sums {
    fn add(&mut self, scene: &InstancedScene) {
        if self.steps == 0 {
            let summed = Parameter::ALL.into_iter().filter(|&parameter| !are_shapes(scene, parameter));
            self.of = summed.map(|parameter| (parameter, vec![0.0; scene.parameter(parameter).len()])).collect();
        }
        for (parameter, sums) in &mut self.of {
            let values = scene.parameter(*parameter);
            sums.iter_mut().zip(values.iter()).for_each(|(sum, &value)| *sum += f64::from(value));
        }
        self.steps += 1;
    }

    /// Sets the parameters of the scene to their means; without steps, leaves it as it is.
    fn write_means(&self, scene: &mut InstancedScene) {
        let rows = scene.parameter_rows();
        for (parameter, sums) in self.of.iter().filter(|(_, sums)| !sums.is_empty()) {
            let means: Vec<f32> = sums.iter().map(|sum| (sum / self.steps as f64) as f32).collect();
            scene.set_parameter(*parameter, rows[*parameter], &means);
        }
    }
}

/// The rates of a step.
struct Schedule {
    /// The factor of all rates.
    factor: f64,
    /// Whether what is predicted from neighbours stays as it is.
    held: bool,
}

impl Schedule {
    fn rates(&self, extent: f64) -> Rates {
        let GaussianRates { means, sh_dc, sh_rest, opacity, log_scales, quats } = RATES;
        // Only SH coefficients above 0 are never predicted.
        let of = |factor_of_predicted: f64| GaussianRates {
            means: factor_of_predicted * means * extent,
            sh_dc: factor_of_predicted * sh_dc,
            sh_rest: self.factor * sh_rest,
            opacity: factor_of_predicted * opacity,
            log_scales: factor_of_predicted * log_scales,
            quats: factor_of_predicted * quats,
        };
        let clouds = of(if self.held { 0.0 } else { self.factor });
        Rates {
            template: clouds,
            background: clouds,
            offsets: of(self.factor),
            color_matrices: 0.0,
            poses: PoseRates::default(),
        }
    }
}

/// Training steps on rounded scenes.
struct Steps {
    gpu: Arc<Gpu>,
    runner: StepRunner,
    state: DeviceState,
    views: TrainViews,
    order: ViewOrder,
    options: RenderOptions,
    config: TrainConfig,
    sh_degree: u32,
    /// Scene units.
    extent: f64,
}

impl Steps {
    /// Loads the training photos, and makes room for scenes with as many rows as this one.
    fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, data: &TrainData, config: &TrainConfig) -> Result<Self, TrainError> {
        let budget_bytes = picture_budget(config, gpu.device_heap_bytes());
        let width = (config.width > 0).then_some(config.width);
        let views = ViewsPlan { views: &data.train, width, budget_bytes, seed: SEED, first_step: 0 };
        let views = TrainViews::load(gpu, &views, &mut || Ok(()))?;
        let runner = StepRunner::new(gpu, Variant::for_training(gpu.caps()), views.largest_px(), false)?;
        Ok(Self {
            gpu: gpu.clone(),
            state: DeviceState::new(gpu, scene, runner.chunk_size())?,
            runner,
            order: ViewOrder::new(SEED, views.len()),
            views,
            // The near plane and the filter are the scene's, as its sensitivity was measured with them and its file keeps them.
            options: RenderOptions { near: scene.near_plane.0, ..train_options(config, [0.0; 3]) }
                .filtered(scene.pixel_filter),
            config: config.clone(),
            sh_degree: scene.sh_degree(),
            extent: data.extent,
        })
    }

    /// A step on a scene; returns the numbers of its parameters afterwards.
    fn run(
        &mut self,
        step: u64,
        scene: &InstancedScene,
        schedule: &Schedule,
    ) -> Result<ParameterSet<Vec<f32>>, TrainError> {
        for (parameter, buffer) in self.state.scene.parameters.scalars_mut() {
            let values = scene.parameter(parameter);
            if !values.is_empty() {
                write(&self.gpu, buffer, &values)?;
            }
        }
        let plan = StepPlan {
            step,
            view: self.order.view_at(step).ok_or(TrainError::NoViews)?,
            options: RenderOptions { background: background_at(&self.config, step), ..self.options },
            rates: schedule.rates(self.extent),
            sh_degree: self.sh_degree,
            lambda_dssim: LAMBDA_DSSIM,
            adam: Adam { step: step + 1, ..ADAM },
            learn_every: LearnEvery::STEP,
            exposure: None,
            mcmc: None,
        };
        self.runner.submit(&mut self.state, &mut self.views, plan)?;
        while self.runner.collect(&mut self.state, &mut self.views)?.is_some() {}
        let buffers = self.state.scene.parameters.scalars();
        let after = ParameterSet::try_from_fn(|parameter| {
            download(&self.gpu, buffers[parameter], scene.parameter(parameter).len())
        })?;
        Ok(after)
    }
}
