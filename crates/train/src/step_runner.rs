//! Submits training steps, a few ahead of the device, and repeats steps whose buffers were too small.
//!
//! A step that overflows a buffer sets a flag on the device that turns this and every later step into a no-op. The host
//! finds the flag when it collects the step, enlarges the buffers, clears the flag and submits the same steps again:
//! the result does not depend on the capacities of buffers.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use instgs_vk::gpu::interface::constants::{LOG_STEPS, STATUS_COUNT};
use instgs_vk::gpu::interface::types::StepRecord;
use instgs_vk::gpu::staging::write;
use instgs_vk::gpu::{Buffer, Gpu, Recorder, Ticket};
use instgs_vk::kernels::{McmcStepPipelines, Variant};
use instgs_vk::optim::{Adam, ExposedView, ExposureStep};
use instgs_vk::render::{
    GradientStep, LossInputs, RenderError, RenderOptions, StepLog, TrainFrame, TrainView, WantedGradients,
};
use instgs_vk::scene::Parameter;

use super::config::Rates;
use super::device_state::DeviceState;
use super::error::TrainError;
use super::strategy::McmcStep;
use super::views::TrainViews;

/// Steps submitted and not yet collected. Two keep the device busy while the host records the next.
const IN_FLIGHT: usize = 2;

/// Steps in which parameters learn that need not learn in each: those whose index is a multiple of these numbers, at least 1.
#[derive(Clone, Copy, Debug)]
pub struct LearnEvery {
    /// For offsets of SH coefficients above 0.
    pub sh_offsets: u64,
    /// For poses and colour matrices of instances.
    pub instances: u64,
}

impl LearnEvery {
    /// All learn in each step.
    pub const STEP: Self = Self { sh_offsets: 1, instances: 1 };
}

/// Everything besides parameters that a step depends on, derived from its index, so that it can be repeated.
#[derive(Clone, Debug)]
pub struct StepPlan {
    /// Index of the step, from 0.
    pub step: u64,
    /// Index of the training picture.
    pub view: usize,
    /// Rendering options, the background of this step included.
    pub options: RenderOptions,
    /// Learning rates of the step.
    pub rates: Rates,
    /// SH degree that the step uses.
    pub sh_degree: u32,
    /// Weight of 1 - SSIM in the loss.
    pub lambda_dssim: f32,
    /// Adam's constants, with the step counted from 1.
    pub adam: Adam,
    /// In which steps the parameters learn that do not in each.
    pub learn_every: LearnEvery,
    /// Step of the exposure of the picture, if photos have exposures.
    pub exposure: Option<ExposureStep>,
    /// Noise and regularisers that the strategy `mcmc` adds.
    pub mcmc: Option<McmcStep>,
}

impl StepPlan {
    /// Adam's constants for a parameter; `None` if it does not learn in this step.
    pub fn adam_of(&self, parameter: Parameter) -> Option<Adam> {
        match parameter {
            Parameter::OffsetShRest => self.adam_every(self.learn_every.sh_offsets),
            Parameter::ColorFromTemplate => self.adam_of_instances(),
            _ => Some(self.adam),
        }
    }

    /// The same for the poses and colour matrices of instances.
    pub fn adam_of_instances(&self) -> Option<Adam> {
        let held = self.rates.poses.are_held() && self.rates.color_matrices == 0.0;
        self.adam_every(self.learn_every.instances).filter(|_| !held)
    }

    fn adam_every(&self, every: u64) -> Option<Adam> {
        // Of steps in which it learns, this is so many from 1.
        self.step.is_multiple_of(every).then(|| Adam { step: (self.adam.step - 1) / every + 1, ..self.adam })
    }
}

/// Errors and counts of a finished step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepOutcome {
    /// Index of the step, from 0.
    pub step: u64,
    /// Mean absolute error.
    pub l1: f64,
    /// Mean structural similarity.
    pub ssim: f64,
    /// Mean squared error of the picture.
    pub mse: f64,
    /// Number of splats drawn.
    pub visible: u32,
    /// Number of (splat, tile) pairs.
    pub intersections: u32,
}

/// Host and device time of the steps since the last report.
#[derive(Clone, Debug, Default)]
pub struct StepTimes {
    /// Wall time of the host's own work: preparing, recording, submitting, reading records.
    pub host: Duration,
    /// Wall time within `submit`: the host's own work and all waiting.
    pub total: Duration,
    /// Number of steps collected.
    pub steps: u64,
    /// Milliseconds per kernel, summed over these steps.
    pub passes_ms: BTreeMap<&'static str, f64>,
}

struct InFlight {
    plan: StepPlan,
    ticket: Ticket,
    slot: usize,
}

/// Runs steps on a [`DeviceState`].
pub struct StepRunner {
    gpu: Arc<Gpu>,
    frame: TrainFrame,
    mcmc: McmcStepPipelines,
    log: StepLog,
    recorders: Vec<Recorder>,
    in_flight: VecDeque<InFlight>,
    next_slot: usize,
    largest_px: [u32; 2],
    times: StepTimes,
    /// New capacities of buffers that were enlarged and not yet reported.
    grown: Vec<u32>,
    /// Number of finished steps in the state on the device, as far as collected.
    finished: u64,
    /// The outcome of a step that was collected just before a failure.
    untold: Option<StepOutcome>,
}

/// What is left after a failure.
#[derive(Debug)]
pub struct Settled {
    /// Number of finished steps in the state on the device.
    pub steps: u64,
    /// Those of them whose outcome nobody was told, in order.
    pub outcomes: Vec<StepOutcome>,
}

impl StepRunner {
    /// A runner for pictures of at most `largest_px` (width, height); `profile` measures the time of every pass.
    pub fn new(gpu: &Arc<Gpu>, variant: Variant, largest_px: [u32; 2], profile: bool) -> Result<Self, RenderError> {
        let recorder = |_| if profile { Recorder::with_profiler(gpu) } else { Recorder::new(gpu) };
        let frame = TrainFrame::sound(gpu, variant)?;
        Ok(Self {
            gpu: gpu.clone(),
            mcmc: McmcStepPipelines::new(gpu, frame.pipeline_cache(), frame.variant())?,
            frame,
            log: StepLog::new(gpu, IN_FLIGHT)?,
            recorders: (0..IN_FLIGHT).map(recorder).collect::<Result<_, _>>()?,
            in_flight: VecDeque::new(),
            next_slot: 0,
            largest_px,
            times: StepTimes::default(),
            grown: Vec::new(),
            finished: 0,
            untold: None,
        })
    }

    /// The passes of a step and their buffers.
    pub fn frame(&self) -> &TrainFrame {
        &self.frame
    }

    /// Frees the buffers of a step; the next one makes them anew. No step may be in flight.
    pub fn release(&mut self) {
        debug_assert!(!self.is_busy());
        self.frame.release();
    }

    /// Sets the initial capacity for intersections; the result of training does not depend on it.
    pub fn set_intersections(&mut self, intersections: u32) {
        self.frame.set_intersections(intersections);
    }

    /// Invocations per work-group, which is also the size of chunks.
    pub fn chunk_size(&self) -> u32 {
        self.frame.variant().workgroup_size
    }

    /// Returns the times since the last call.
    pub fn take_times(&mut self) -> StepTimes {
        std::mem::take(&mut self.times)
    }

    /// Intersection capacities that buffers were enlarged to since the last call.
    pub fn take_grown(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.grown)
    }

    /// Submits a step, after collecting the oldest one if enough are in flight. Outcomes come in the order of steps.
    ///
    /// # Errors
    /// The device failed, or the step needs more than it can hold.
    pub fn submit(
        &mut self,
        state: &mut DeviceState,
        views: &mut TrainViews,
        plan: StepPlan,
    ) -> Result<Option<StepOutcome>, TrainError> {
        if self.in_flight.is_empty() {
            self.finished = plan.step;
        }
        let start = Instant::now();
        let outcome = if self.in_flight.len() >= IN_FLIGHT { self.collect(state, views)? } else { None };
        if let Err(error) = self.record(state, views, plan) {
            self.untold = outcome;
            return Err(error);
        }
        self.times.total += start.elapsed();
        Ok(outcome)
    }

    /// True if steps are in flight.
    pub fn is_busy(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// After a failure: waits for the device and discards the steps in flight; returns what is left. Steps after an overflow
    /// have changed nothing.
    pub fn settle(&mut self) -> Settled {
        // A lost device has no state; the next call that uses it returns the error.
        let _ = self.gpu.wait_all();
        let mut outcomes: Vec<StepOutcome> = self.untold.take().into_iter().collect();
        for flight in self.in_flight.drain(..) {
            let record = read_record(&self.log.readback[flight.slot], flight.plan.step);
            if u64::from(record.step) != flight.plan.step & 0xFFFF_FFFF || record.overflowed != 0 {
                break;
            }
            self.finished = flight.plan.step + 1;
            outcomes.push(outcome(flight.plan.step, &record));
        }
        Settled { steps: self.finished, outcomes }
    }

    /// The outcome of the oldest step that has not been collected; `None` if there is none.
    pub fn collect(
        &mut self,
        state: &mut DeviceState,
        views: &mut TrainViews,
    ) -> Result<Option<StepOutcome>, TrainError> {
        loop {
            let Some(oldest) = self.in_flight.front() else { return Ok(None) };
            let (slot, step) = (oldest.slot, oldest.plan.step);
            self.recorders[slot].wait(oldest.ticket)?;
            let record = read_record(&self.log.readback[slot], step);
            if self.frame.grow(&record)? {
                self.redo(state, views)?;
                continue;
            }
            let start = Instant::now();
            for (pass, ms) in self.recorders[slot].passes_ms()? {
                *self.times.passes_ms.entry(pass).or_default() += ms;
            }
            // lavapipe reads timestamps under the lock too: see `record_in`.
            self.times.host += if self.gpu.caps().is_llvmpipe { Duration::ZERO } else { start.elapsed() };
            self.times.steps += 1;
            self.finished = step + 1;
            self.in_flight.pop_front();
            return Ok(Some(outcome(step, &record)));
        }
    }

    /// After an overflow of the oldest step: enlarges the buffers and submits the same steps in the same order.
    fn redo(&mut self, state: &mut DeviceState, views: &mut TrainViews) -> Result<(), TrainError> {
        self.gpu.wait_all()?;
        self.grown.push(self.frame.intersections());
        write(&self.gpu, &mut self.log.status, &[0; STATUS_COUNT as usize])?;
        let plans: Vec<StepPlan> = self.in_flight.drain(..).map(|flight| flight.plan).collect();
        plans.into_iter().try_for_each(|plan| self.record(state, views, plan))
    }

    fn record(&mut self, state: &mut DeviceState, views: &mut TrainViews, plan: StepPlan) -> Result<(), TrainError> {
        let slot = self.next_slot;
        let ticket = loop {
            let error = match self.record_in(state, views, &plan, slot) {
                Ok(ticket) => break ticket,
                Err(error) => error,
            };
            self.recorders[slot].abandon();
            // Photos can be streamed, and Gaussians and the buffers of a step cannot.
            if error.missing_bytes().is_none() || !views.give_way(plan.step)? {
                return Err(error);
            }
        };
        self.next_slot = (slot + 1) % IN_FLIGHT;
        self.in_flight.push_back(InFlight { plan, ticket, slot });
        Ok(())
    }

    fn record_in(
        &mut self,
        state: &mut DeviceState,
        views: &mut TrainViews,
        plan: &StepPlan,
        slot: usize,
    ) -> Result<Ticket, TrainError> {
        views.prepare(plan.view)?;
        let start = Instant::now();
        let step = plan.step as u32;
        self.frame.prepare(&state.scene, self.largest_px, plan.sh_degree, !plan.rates.poses.are_held())?;
        let begin = Instant::now();
        self.recorders[slot].begin()?;
        // lavapipe resets timestamps under a lock that the submission in progress holds: that is waiting for the device.
        let waited = if self.gpu.caps().is_llvmpipe { begin.elapsed() } else { Duration::ZERO };
        let recorder = &mut self.recorders[slot];
        let view = views.record(plan.view, recorder)?;
        let train_view = TrainView { camera: &view.camera, options: plan.options };
        self.frame.record_forward(recorder, &state.scene, &train_view)?;
        let size_px = [view.camera.width, view.camera.height];
        let exposed_view = ExposedView { view: plan.view, size_px, background: plan.options.background };
        let mut exposures = state.exposures.as_mut().zip(plan.exposure);
        if let (Some((exposures, _)), Some((frame, _))) = (&mut exposures, self.frame.buffers()) {
            exposures.record_apply(recorder, exposed_view, &frame.colors)?;
        }
        let exposed = exposures.as_ref().map(|(exposures, _)| exposures.exposed());
        let loss = LossInputs { targets: &view.targets, lambda_dssim: plan.lambda_dssim, exposed };
        self.frame.record_loss(recorder, &state.scene, &train_view, loss, &mut self.log, step)?;
        if let (Some((exposures, exposure)), Some((frame, backward))) = (exposures, self.frame.buffers_mut()) {
            exposures.record_backward(recorder, exposed_view, &frame.colors, &mut backward.cotangents)?;
            exposures.record_adam(recorder, exposed_view, exposure, &self.log.status)?;
            // At the end of every round over all photos.
            if (plan.step + 1).is_multiple_of(exposures.views() as u64) {
                exposures.record_recentre(recorder, &self.log.status)?;
            }
        }
        let (scene, gradients) = (&state.scene, &mut state.gradients);
        let wanted = WantedGradients {
            sh_offsets: plan.adam_of(Parameter::OffsetShRest).is_some(),
            instances: plan.adam_of_instances().is_some(),
        };
        let backward = GradientStep { tables: &state.tables, view: &train_view, log: &self.log, wanted };
        self.frame.record_gradients(recorder, scene, backward, gradients)?;
        let workgroup_size = self.frame.variant().workgroup_size;
        if let Some(extra) = &plan.mcmc {
            extra.record_regularisation(recorder, &self.mcmc, workgroup_size, &self.log, state)?;
        }
        state.record_adam(recorder, self.frame.backward_pipelines(), workgroup_size, &self.log, plan)?;
        if let Some(extra) = &plan.mcmc {
            extra.record_noise(recorder, &self.mcmc, workgroup_size, &self.log, state, step)?;
        }
        let readback = &mut self.log.readback[slot];
        let bytes = readback.bytes();
        recorder.copy(&self.log.records, readback, bytes)?;
        let ticket = recorder.submit()?;
        views.submitted(plan.view);
        self.times.host += start.elapsed() - waited;
        Ok(ticket)
    }
}

fn read_record(ring: &Buffer<StepRecord>, step: u64) -> StepRecord {
    ring.read_mapped((step as u32 % LOG_STEPS) as usize)
}

fn outcome(step: u64, record: &StepRecord) -> StepOutcome {
    StepOutcome {
        step,
        l1: f64::from(record.l1),
        ssim: f64::from(record.ssim),
        mse: f64::from(record.mse),
        visible: record.visible,
        intersections: record.intersections,
    }
}
