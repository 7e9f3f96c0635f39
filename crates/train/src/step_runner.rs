//! Submits training steps, a few ahead of the device, and does steps again whose buffers were too small.
//!
//! A step that does not fit raises a flag on the device that turns it and every later step into a no-op. The host sees
//! the flag when it collects the step, enlarges the buffers, lowers the flag and submits the same steps again: what is
//! learned does not depend on the sizes of buffers.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use instgs_vk::gpu::interface::constants::{LOG_STEPS, STATUS_COUNT};
use instgs_vk::gpu::interface::types::StepRecord;
use instgs_vk::gpu::staging::write;
use instgs_vk::gpu::{Buffer, Gpu, Recorder, Ticket};
use instgs_vk::kernels::{McmcStepPipelines, Variant};
use instgs_vk::optim::Adam;
use instgs_vk::render::{LossInputs, RenderError, RenderOptions, StepLog, TrainFrame, TrainView};

use super::config::Rates;
use super::device_state::DeviceState;
use super::error::TrainError;
use super::strategy::McmcStep;
use super::views::TrainViews;

/// Steps submitted and not yet collected. Two keep the device busy while the host records.
const IN_FLIGHT: usize = 2;

/// All that a step depends on besides parameters: made from its number alone, so that it can be made again.
#[derive(Clone, Debug)]
pub struct StepPlan {
    /// Index of the step, from 0.
    pub step: u64,
    /// Which training picture.
    pub view: usize,
    /// Rendering options, the background of this step included.
    pub options: RenderOptions,
    /// Learning rates.
    pub rates: Rates,
    /// SH degree in use.
    pub sh_degree: u32,
    /// Weight of 1 - SSIM in the loss.
    pub lambda_dssim: f32,
    /// Adam's constants, with the step counted from 1.
    pub adam: Adam,
    /// What the strategy `mcmc` adds.
    pub mcmc: Option<McmcStep>,
}

/// What a step did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepOutcome {
    /// Index of the step.
    pub step: u64,
    /// Mean absolute error.
    pub l1: f64,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Splats drawn.
    pub visible: u32,
    /// (splat, tile) pairs.
    pub intersections: u32,
}

/// Where the time of steps goes.
#[derive(Clone, Debug, Default)]
pub struct StepTimes {
    /// Wall time of the host's own work: preparing, recording, submitting, reading records.
    pub host: Duration,
    /// Wall time within `submit`: the host's own work and all waiting.
    pub total: Duration,
    /// Steps collected.
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
    /// Buffers enlarged since the last look.
    grown: Vec<u32>,
    /// Steps that are behind the state on the device, as far as collected.
    finished: u64,
}

impl StepRunner {
    /// A runner for pictures up to `largest_px`; `profile` times every pass.
    pub fn new(gpu: &Arc<Gpu>, variant: Variant, largest_px: [u32; 2], profile: bool) -> Result<Self, RenderError> {
        let recorder = |_| if profile { Recorder::with_profiler(gpu) } else { Recorder::new(gpu) };
        let frame = TrainFrame::new(gpu, variant)?;
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
        })
    }

    /// The passes and their buffers.
    pub fn frame(&self) -> &TrainFrame {
        &self.frame
    }

    /// Sets how many intersections the buffers start with; what is learned does not depend on it.
    pub fn set_intersections(&mut self, intersections: u32) {
        self.frame.set_intersections(intersections);
    }

    /// Threads per work-group, which is also the size of chunks.
    pub fn chunk_size(&self) -> u32 {
        self.frame.variant().workgroup_size
    }

    /// Where the time went since the last call.
    pub fn take_times(&mut self) -> StepTimes {
        std::mem::take(&mut self.times)
    }

    /// Intersection capacities that buffers were enlarged to since the last call.
    pub fn take_grown(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.grown)
    }

    /// Submits a step, after collecting an earlier one if enough are on their way. Outcomes come in order of steps.
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
        self.record(state, views, plan)?;
        self.times.total += start.elapsed();
        Ok(outcome)
    }

    /// True if steps are on their way.
    pub fn is_busy(&self) -> bool {
        !self.in_flight.is_empty()
    }

    /// After a failure: waits for the device and forgets the steps on their way; returns how many steps are behind the state
    /// that is there now. Steps after one that did not fit have changed nothing.
    pub fn settle(&mut self) -> u64 {
        // A lost device has no state; whoever asks next will be told.
        let _ = self.gpu.wait_all();
        for flight in self.in_flight.drain(..) {
            let record = read_record(&self.log.readback[flight.slot], flight.plan.step);
            if u64::from(record.step) != flight.plan.step & 0xFFFF_FFFF || record.overflowed != 0 {
                break;
            }
            self.finished = flight.plan.step + 1;
        }
        self.finished
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

    /// After an overflow of the oldest step: larger buffers, then the same steps in the same order.
    fn redo(&mut self, state: &mut DeviceState, views: &mut TrainViews) -> Result<(), TrainError> {
        self.gpu.wait_all()?;
        self.grown.push(self.frame.intersections());
        write(&self.gpu, &mut self.log.status, &[0; STATUS_COUNT as usize])?;
        let plans: Vec<StepPlan> = self.in_flight.drain(..).map(|flight| flight.plan).collect();
        plans.into_iter().try_for_each(|plan| self.record(state, views, plan))
    }

    fn record(&mut self, state: &mut DeviceState, views: &mut TrainViews, plan: StepPlan) -> Result<(), TrainError> {
        let slot = self.next_slot;
        let result = self.record_in(state, views, &plan, slot);
        if result.is_err() {
            self.recorders[slot].abandon();
        }
        let ticket = result?;
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
        let view = views.get(plan.view)?;
        let start = Instant::now();
        let train_view = TrainView { camera: &view.camera, options: plan.options };
        let step = plan.step as u32;
        self.frame.prepare(&state.scene, self.largest_px, plan.sh_degree, !plan.rates.poses.are_held())?;
        let begin = Instant::now();
        self.recorders[slot].begin()?;
        // lavapipe resets timestamps under a lock that the submission in progress holds: that is waiting for the device.
        let waited = if self.gpu.caps().is_llvmpipe { begin.elapsed() } else { Duration::ZERO };
        let recorder = &mut self.recorders[slot];
        self.frame.record_forward(recorder, &state.scene, &train_view)?;
        let loss = LossInputs { targets: &view.targets, lambda_dssim: plan.lambda_dssim };
        self.frame.record_loss(recorder, &state.scene, &train_view, loss, &mut self.log, step)?;
        let (scene, gradients) = (&state.scene, &mut state.gradients);
        self.frame.record_gradients(recorder, scene, &state.tables, &train_view, &self.log, gradients)?;
        let workgroup_size = self.frame.variant().workgroup_size;
        let mcmc = (&self.mcmc, workgroup_size);
        if let Some(extra) = &plan.mcmc {
            extra.record_regularisation(recorder, mcmc, &self.log, state)?;
        }
        let adam = (self.frame.backward_pipelines(), workgroup_size);
        state.record_adam(recorder, adam, &self.log, &plan.adam, &plan.rates, plan.sh_degree)?;
        if let Some(extra) = &plan.mcmc {
            extra.record_noise(recorder, mcmc, &self.log, state, step)?;
        }
        let readback = &mut self.log.readback[slot];
        let bytes = readback.bytes();
        recorder.copy(&self.log.records, readback, bytes)?;
        let ticket = recorder.submit()?;
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
