//! A training run: its start, its steps, and the files that it leaves.

mod end;
mod room;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use instgs_eval::EvalReport;
use instgs_io::{Fingerprint, RunFolder, View, atomic_write, checkpoint};
use instgs_vk::gpu::Gpu;
use instgs_vk::kernels::Variant;
use instgs_vk::optim::{Adam, ExposureStep};
use instgs_vk::render::{RenderError, Renderer};
use instgs_vk::scene::InstancedScene;

use super::config::TrainConfig;
use super::device_state::DeviceState;
use super::error::TrainError;
use super::event_log::EventLog;
use super::events::{Event, EventSink};
use super::facts::{MemoryUse, StageTime, TrainFacts};
use super::interrupt::Interrupt;
use super::log_and_observer::LogAndObserver;
use super::log_state::{LogState, Room};
use super::observer::TrainObserver;
use super::resumed_log::{Past, open_log};
use super::run_files::RunFiles;
use super::same_data;
use super::start::{Loaded, Start, TrainData, load_all};
use super::state_file::to_checkpoint;
use super::step_runner::{LearnEvery, StepOutcome, StepPlan, StepRunner, StepTimes};
use super::strategy::{McmcStep, Strategy};
use super::view_order::ViewOrder;
use super::view_pictures::{background_at, evaluate_test_views, train_options};
use super::views::TrainViews;
use end::Course;

/// Steps between two events that report the loss.
const REPORT_EVERY: u64 = 10;

/// A training job. With the method `instgs` it is the joint phase: the run folder holds the scene that it starts from
/// ([`RunFolder::initial_scene`]).
#[derive(Clone, Debug)]
pub struct TrainJob {
    /// Folder of the data set.
    pub data: PathBuf,
    /// Run folder to write.
    pub out: PathBuf,
    /// Configuration of the run.
    pub config: TrainConfig,
    /// Text for `config.toml`, if it is not that of `config`: the configuration of a run that contains this one.
    pub config_file: Option<String>,
    /// Whether to resume from the newest checkpoint of the run folder, if there is one.
    pub resume: bool,
    /// Whether to resume although photos, masks or cameras are not those of the checkpoint.
    pub accept_changed_data: bool,
}

impl TrainJob {
    /// The files of the run folder.
    pub fn folder(&self) -> RunFolder {
        RunFolder::new(&self.out)
    }
}

/// Result of a run, besides its files.
pub struct Trained {
    /// The trained scene, without non-finite Gaussians and without those that belong to no instance.
    pub scene: InstancedScene,
    /// Number of non-finite Gaussians that were dropped.
    pub dropped_non_finite: usize,
    /// Number of Gaussians dropped because no instance shows them.
    pub pruned: usize,
    /// True if the run was stopped before the last step: then there is neither an evaluation nor `trained.json`.
    pub interrupted: bool,
    /// Times, counts, sizes and quality of the run.
    pub facts: TrainFacts,
}

/// One run in progress.
struct Run<'a> {
    gpu: &'a Arc<Gpu>,
    job: &'a TrainJob,
    extent: f64,
    views: TrainViews,
    test: &'a [View],
    print: Fingerprint,
    runner: StepRunner,
    state: DeviceState,
    order: ViewOrder,
    strategy: Strategy,
    times: StepTimes,
    clock: Clock,
    /// What the log has of an earlier process.
    past: Past,
    /// The step of the checkpoint that was read or written last.
    kept_at: Option<u64>,
    /// What memory was used for before the buffers of steps made room, if they have.
    used_before: Vec<MemoryUse>,
    files: &'a RunFiles,
}

/// What a run begins with.
struct Begin<'a> {
    data: &'a TrainData,
    variant: Variant,
    start: Start,
    views: TrainViews,
    past: Past,
}

/// Why a checkpoint is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Saving {
    /// All is done that follows the step.
    Whole,
    /// The densification after the step is still to be done.
    DensificationDue,
    /// What follows the step failed.
    Failed,
}

/// Wall time of the steps alone, without evaluations and checkpoints.
struct Clock {
    started: Instant,
    elsewhere: f64,
    /// Finished steps and seconds at the last report.
    reported: (u64, f64),
    /// View and loss of each step since the last report.
    losses: Vec<(usize, f64)>,
}

impl Clock {
    fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64() - self.elsewhere
    }
}

/// Trains, and leaves `config.toml`, `events.jsonl`, `checkpoints/`, `scene.instgs`, of a plain cloud
/// `point_cloud.ply`, `cameras.json`, and last `trained.json` in the run folder, which is created if necessary. `observer`
/// receives all messages; `interrupt` is checked between steps.
///
/// # Errors
/// Damaged or missing input; a device that fails or is too small: then the state before the step is saved first.
pub fn train(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    interrupt: &Interrupt,
    observer: &mut dyn TrainObserver,
) -> Result<Trained, TrainError> {
    gpu.reset_memory_peak();
    gpu.set_memory_budget(match job.config.device_memory_mb {
        0 => u64::MAX,
        mb => u64::from(mb) << 20,
    });
    let load = Instant::now();
    let phase = TrainJob { config: job.config.own_phase(), ..job.clone() };
    let files = RunFiles::new(job.folder(), config_text(job)?);
    let (Loaded { data, variant, start, views }, log, past) = load_for(gpu, &files, &phase, observer)?;
    let (job, first_step) = (&phase, start.step);
    let mut sink = LogAndObserver { log, observer };
    let mut run = Run::new(gpu, job, &files, Begin { data: &data, variant, start, views, past })?;
    let mut stages = vec![StageTime::since("load", load)];
    run.clock.reported.0 = first_step;
    run.announce(&mut sink, first_step, &data)?;
    run.catch_up(&mut sink)?;
    (run.clock.started, run.clock.elsewhere) = (Instant::now(), 0.0);
    let done = run.steps(&mut sink, interrupt, first_step)?;
    let seconds = run.clock.seconds();
    stages.push(StageTime { name: "train".into(), seconds });
    run.end(&mut sink, &data, Course { first_step, done, seconds }, stages)
}

/// The text of `config.toml`.
fn config_text(job: &TrainJob) -> Result<String, TrainError> {
    job.config_file.clone().map_or_else(|| Ok(job.config.to_toml()?), Ok)
}

/// Writes the first `files`, loads everything that the training of `phase` needs, and opens its log. If that fails
/// the folder keeps the configuration that it had.
fn load_for(
    gpu: &Arc<Gpu>,
    files: &RunFiles,
    phase: &TrainJob,
    observer: &mut dyn TrainObserver,
) -> Result<(Loaded, EventLog, Past), TrainError> {
    let path = phase.folder().config();
    let before = std::fs::read(&path).ok();
    // Written before pictures are read, which may take minutes, so that a run killed then can be resumed.
    files.write()?;
    let loaded = load_all(gpu, phase, observer);
    let opened = loaded.and_then(|loaded| {
        let (log, past) = open_log(phase, loaded.start.step, loaded.start.due, observer)?;
        Ok((loaded, log, past))
    });
    if opened.is_err() {
        // Nothing began: remove the file, or restore that of the run that was there. If this fails as well, the first
        // error is the one to report.
        let _ = match before {
            None => std::fs::remove_file(&path).ok(),
            Some(bytes) => atomic_write(&path, |out| out.write_all(&bytes)).ok(),
        };
    }
    opened
}

fn evaluated(step: u64, report: &EvalReport) -> Event {
    let mean = report.mean;
    Event::Evaluated { step, views: report.views.len() as u64, psnr: mean.psnr, ssim: mean.ssim, lpips: mean.lpips }
}

impl<'a> Run<'a> {
    fn new(gpu: &'a Arc<Gpu>, job: &'a TrainJob, files: &'a RunFiles, begin: Begin<'a>) -> Result<Self, TrainError> {
        let Begin { data, variant, start, views, past } = begin;
        let kept_at = (start.step > 0).then_some(start.step);
        let config = &job.config;
        let mut runner = StepRunner::new(gpu, variant, views.largest_px(), true)?;
        let LogState { losses, room } = start.log;
        if let Some(room) = room.filter(|room| room.largest_px == views.largest_px()) {
            runner.set_intersections(room.intersections);
        }
        let mut state = start.state;
        state.exposures = start.exposures.upload(gpu, config, &runner, &data.train, views.largest_px())?;
        Ok(Self {
            strategy: Strategy::new(gpu, runner.frame(), config.sh_degree)?,
            gpu,
            job,
            extent: data.extent,
            order: ViewOrder::new(config.seed, views.len()),
            views,
            test: &data.test,
            print: data.print.clone(),
            runner,
            state,
            times: StepTimes::default(),
            clock: Clock { started: Instant::now(), elsewhere: 0.0, reported: (0, 0.0), losses },
            past,
            kept_at,
            used_before: Vec::new(),
            files,
        })
    }

    fn announce(&self, sink: &mut dyn EventSink, step: u64, data: &TrainData) -> Result<(), TrainError> {
        sink.event(&Event::Started {
            step,
            steps: self.job.config.steps,
            resumed: step > 0,
            method: self.job.config.method.name().into(),
            device: self.gpu.caps().name.clone(),
            gaussians: self.state.source_count() as u64,
            views: data.train.len() as u64,
            test_views: data.test.len() as u64,
        })?;
        Ok(())
    }

    /// Runs the steps from `first` to the last one; returns the number of finished steps.
    fn steps(&mut self, sink: &mut dyn EventSink, interrupt: &Interrupt, first: u64) -> Result<u64, TrainError> {
        let config = &self.job.config;
        let mut done = first;
        while done < config.steps {
            if done == 0 || config.sh_degree_at(done) != config.sh_degree_at(done - 1) {
                sink.event(&Event::ShDegree { step: done, degree: config.sh_degree_at(done) })?;
            }
            let plan = self.plan(done)?;
            let outcome = self.runner.submit(&mut self.state, &mut self.views, plan);
            self.collected(outcome, sink)?;
            done += 1;
            let stop = interrupt.requested();
            if self.pauses_after(done) || stop {
                self.drain(sink)?;
                self.between_steps(done, sink, stop)?;
            }
            if stop {
                break;
            }
        }
        self.drain(sink)?;
        self.times = self.runner.take_times();
        Ok(done)
    }

    /// Derives everything about a step from its index.
    fn plan(&mut self, step: u64) -> Result<StepPlan, TrainError> {
        let config = &self.job.config;
        let view = self.order.view_at(step).ok_or(TrainError::NoViews)?;
        let rates = &config.rates;
        let step_rates = config.rates_at(step, self.extent);
        let adam = Adam { beta1: rates.beta1, beta2: rates.beta2, epsilon: rates.eps, step: step + 1 };
        // Every photo has one step in each round over all of them.
        let rounds = step / self.views.len() as u64;
        let exposure_step = |rate| ExposureStep { adam: Adam { step: rounds + 1, ..adam }, rate };
        Ok(StepPlan {
            step,
            view,
            options: train_options(config, background_at(config, step)),
            mcmc: McmcStep::new(config, &step_rates),
            rates: step_rates,
            sh_degree: config.sh_degree_at(step),
            lambda_dssim: config.lambda_dssim as f32,
            adam,
            learn_every: LearnEvery { sh_offsets: config.offsets.sh_every, instances: config.joint.instances_every },
            exposure: config.exposure_rate_at(step).map(exposure_step),
        })
    }

    /// True if there is work between this step and the next, for which the device must be idle.
    fn pauses_after(&self, done: u64) -> bool {
        let config = &self.job.config;
        config.densifies_at(done)
            || config.resets_opacity_at(done)
            || config.checkpoints_at(done)
            || config.evaluates_at(done) && done < config.steps
    }

    /// Does and logs what an earlier process did not get to after the step that this one goes on from.
    fn catch_up(&mut self, sink: &mut dyn EventSink) -> Result<(), TrainError> {
        let past = self.past;
        if past.due {
            return self.between_steps(past.step, sink, false);
        }
        past.missing_checkpoint(self.job).iter().try_for_each(|event| sink.event(event))?;
        if past.misses_evaluation(&self.job.config) { self.evaluate_after(past.step, sink) } else { Ok(()) }
    }

    /// Does the work after `done` finished steps; with `stop`, no step follows.
    fn between_steps(&mut self, done: u64, sink: &mut dyn EventSink, stop: bool) -> Result<(), TrainError> {
        let config = &self.job.config;
        self.densify(done, sink)?;
        let pause = Instant::now();
        if config.checkpoints_at(done) || stop {
            self.files.restore()?.iter().try_for_each(|text| sink.warn(text))?;
            sink.flush()?;
            let path = self.save_checkpoint(done, Saving::Whole)?;
            sink.event(&Event::Checkpoint { step: done, path })?;
        }
        if config.evaluates_at(done) && done < config.steps {
            self.evaluate_after(done, sink)?;
        }
        self.clock.elsewhere += pause.elapsed().as_secs_f64();
        Ok(())
    }

    /// Evaluates the test views, if there are any, after `done` finished steps that others follow.
    fn evaluate_after(&mut self, done: u64, sink: &mut dyn EventSink) -> Result<(), TrainError> {
        if self.test.is_empty() {
            return Ok(());
        }
        match self.with_room(done, |run| run.evaluate()) {
            Ok(report) => Ok(sink.event(&evaluated(done, &report))?),
            Err(error) => Err(self.given_up(done, error, sink)),
        }
    }

    /// Writes a checkpoint after `done` finished steps.
    fn save_checkpoint(&mut self, done: u64, saving: Saving) -> Result<PathBuf, TrainError> {
        let folder = self.job.folder().checkpoints();
        let is_due = saving == Saving::DensificationDue;
        let mut state = self.with_room(done, |run| to_checkpoint(run.gpu, &mut run.state, done, is_due))?;
        same_data::put(&self.print, &mut state.metadata);
        // Room that a failed step asked for may be more than the device has.
        let (intersections, largest_px) = (self.runner.frame().intersections(), self.views.largest_px());
        let room = (saving != Saving::Failed).then_some(Room { intersections, largest_px });
        LogState { losses: self.clock.losses.clone(), room }.put(&mut state);
        let path = checkpoint::save(&folder, &state)?;
        self.kept_at = Some(done);
        checkpoint::prune(&folder, checkpoint::KEEP)?;
        Ok(path)
    }

    /// Collects all steps in flight.
    fn drain(&mut self, sink: &mut dyn EventSink) -> Result<(), TrainError> {
        while self.runner.is_busy() {
            let outcome = self.runner.collect(&mut self.state, &mut self.views);
            self.collected(outcome, sink)?;
        }
        Ok(())
    }

    /// Reports a step; after a failure, saves the state before it.
    fn collected(
        &mut self,
        outcome: Result<Option<StepOutcome>, TrainError>,
        sink: &mut dyn EventSink,
    ) -> Result<(), TrainError> {
        match outcome {
            Ok(None) => Ok(()),
            Ok(Some(outcome)) => self.report(&outcome, sink),
            Err(error) => {
                let settled = self.runner.settle();
                // The log has them, too; a log that cannot be written is not the first thing to tell.
                let _ = settled.outcomes.iter().try_for_each(|outcome| self.report(outcome, sink));
                Err(self.given_up(settled.steps, error, sink))
            }
        }
    }

    /// Saves the state after `step` steps, unless a checkpoint has it, and returns the error with the step and the checkpoint.
    fn given_up(&mut self, step: u64, error: TrainError, sink: &mut dyn EventSink) -> TrainError {
        let there = self.job.folder().checkpoints().join(checkpoint::file_name(step));
        let saved = sink.flush().ok().and_then(|()| match self.kept_at == Some(step) && there.is_file() {
            // It also knows the room that its steps needed.
            true => Some(there),
            false => self.save_checkpoint(step, Saving::Failed).ok(),
        });
        let remedy = self.remedy(&error);
        TrainError::Step { step, error: Box::new(error), remedy, saved }
    }

    fn report(&mut self, outcome: &StepOutcome, sink: &mut dyn EventSink) -> Result<(), TrainError> {
        let step = outcome.step + 1;
        self.views.take_given_way().iter().try_for_each(|text| sink.warn(text))?;
        for grown_to in self.runner.take_grown() {
            let what = "(splat, tile) pairs".into();
            sink.event(&Event::Overflow { step: outcome.step, what, grown_to: u64::from(grown_to) })?;
        }
        let lambda = self.job.config.lambda_dssim;
        let loss = (1.0 - lambda) * outcome.l1 + lambda * (1.0 - outcome.ssim);
        let view = self.order.view_at(outcome.step).unwrap_or_default();
        self.clock.losses.push((view, loss));
        if !step.is_multiple_of(REPORT_EVERY) && step != self.job.config.steps {
            return Ok(());
        }
        let losses = std::mem::take(&mut self.clock.losses);
        let finite = losses.iter().filter(|(_, loss)| loss.is_finite());
        let seconds = self.clock.seconds();
        let (last_step, last_seconds) = std::mem::replace(&mut self.clock.reported, (step, seconds));
        sink.event(&Event::Step {
            step,
            loss,
            mean_loss: Some(losses.iter().map(|(_, loss)| loss).sum::<f64>() / losses.len() as f64),
            view_losses: finite.map(|&(view, loss)| (view as u32, loss as f32)).collect(),
            l1: outcome.l1,
            ssim: outcome.ssim,
            psnr: -10.0 * outcome.mse.max(1e-10).log10(),
            gaussians: self.state.source_count() as u64,
            steps_per_second: (step - last_step) as f64 / (seconds - last_seconds).max(1e-9),
            seconds,
        })?;
        Ok(())
    }

    /// Clones, splits, prunes, and resets opacities if the schedule says so.
    fn densify(&mut self, done: u64, sink: &mut dyn EventSink) -> Result<(), TrainError> {
        let config = &self.job.config;
        // A densification that has begun cannot be repeated, so photos give way before it.
        let densifies = self.strategy.densifies(&self.state, config, done, self.extent);
        while densifies && self.memory_is_tight() && self.views.give_way(done)? {}
        // Arrays are replaced one at a time: if memory runs out midway the state is lost, so it is saved first.
        let mut saved = if densifies && self.memory_is_tight() {
            sink.flush()?;
            Some(self.save_checkpoint(done, Saving::DensificationDue)?)
        } else {
            None
        };
        let outcome = match self.strategy.after_step(&mut self.state, config, done, self.extent) {
            Ok(outcome) => outcome,
            Err(error) => {
                // Of settings that would leave nothing: nothing has changed, and others can go on from here.
                if saved.is_none() && matches!(error, RenderError::Option { .. }) {
                    saved = sink.flush().ok().and_then(|()| self.save_checkpoint(done, Saving::DensificationDue).ok());
                }
                let error: TrainError = error.into();
                return Err(TrainError::Step {
                    step: done,
                    remedy: self.remedy(&error),
                    error: Box::new(error),
                    saved,
                });
            }
        };
        let Some(outcome) = outcome else { return Ok(()) };
        if config.densifies_at(done) {
            sink.event(&Event::Densified {
                step: done,
                cloned: u64::from(outcome.cloned + outcome.added),
                split: u64::from(outcome.split),
                pruned: u64::from(outcome.pruned),
                own: u64::from(outcome.own),
                relocated: u64::from(outcome.relocated),
                gaussians: u64::from(outcome.gaussians),
            })?;
        }
        if outcome.device_full && !std::mem::replace(&mut self.past.device_full, true) {
            sink.event(&Event::DeviceFull { step: done, gaussians: u64::from(outcome.gaussians) })?;
        }
        if outcome.opacity_reset {
            sink.event(&Event::OpacityReset { step: done, to: config.densify.opacity_reset_to })?;
        }
        Ok(())
    }

    /// Renders the test views in their current state and compares them with their photos.
    fn evaluate(&mut self) -> Result<EvalReport, TrainError> {
        let mut renderer = Renderer::new(self.gpu)?;
        evaluate_test_views(&mut renderer, &self.state.scene, self.test, &self.job.config, &mut |_| Ok(()))
    }
}
