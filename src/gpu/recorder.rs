//! Records dispatches into one command buffer; barriers follow from the bindings. `dispatch` adds kernels, `transfers` fills and copies.

use std::mem;
use std::sync::Arc;

use ash::vk;

use super::barrier::{Access, Barrier, HazardTracker};
use super::buffer::{Buffer, BufferMemory};
use super::context::Gpu;
use super::descriptors::DescriptorSets;
use super::error::GpuError;
use super::faults::Fate;
use super::profiler::Profiler;
use super::timeline::{Ticket, Timeline};

/// Passes that the crash marker can name; later ones share the last slot's name.
const MAX_MARKERS: usize = 1024;

/// What was begun last, where no marker says so.
const NOT_MARKED: &str = "unknown, which a run with validation (INSTGS_VALIDATION=1) writes down";

/// The submission that must finish before a recorder starts again.
#[derive(Clone, Copy)]
pub(super) enum Submitted {
    /// A submission of this recorder.
    Own(Ticket),
    /// A submission of the caller's; the ticket is of the recorder's own timeline.
    Callers(Ticket),
}

/// One reusable command buffer, or commands in one of the caller's.
///
/// A recorder keeps the buffers that its commands use until these have been executed, whatever becomes of the [`Buffer`]s.
pub struct Recorder {
    pub(super) gpu: Arc<Gpu>,
    pool: vk::CommandPool,
    /// The command buffer of the pool.
    pub(super) own: vk::CommandBuffer,
    /// The command buffer in use: `own`, or one of the caller's.
    pub(super) commands: vk::CommandBuffer,
    pub(super) descriptors: DescriptorSets,
    hazards: HazardTracker,
    pub(super) profiler: Option<Profiler>,
    /// Slot i is set before pass i begins, if the device is opened for debugging: a fill before each dispatch could make
    /// a GPU wait. After a device loss the last set slot names the culprit, or a pass soon after it: these fills are not
    /// ordered against the dispatches.
    markers: Buffer<u32>,
    marked: Vec<&'static str>,
    pub(super) recording: bool,
    /// Number of the recording; unique per device.
    number: u64,
    /// Buffers that commands of this recording use, each once. Those of a recording in a command buffer of the caller's
    /// stay until it has finished.
    pub(super) kept: Vec<Arc<BufferMemory>>,
    /// Accesses of the coming command; a field to reuse its memory.
    pub(super) accesses: Vec<(vk::Buffer, Access)>,
    pub(super) submitted: Option<Submitted>,
    /// Timeline that submissions of the caller's signal.
    pub(super) callers: Option<Timeline>,
}

impl Recorder {
    /// A recorder without timestamps.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let markers = Buffer::for_readback(gpu, "crash markers", MAX_MARKERS)?;
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.queue_family());
        // SAFETY: a valid family; destroyed in drop.
        let pool = unsafe { gpu.device.create_command_pool(&info, None) }.map_err(GpuError::vulkan("command pool"))?;
        let mut recorder = Self {
            gpu: gpu.clone(),
            pool,
            own: vk::CommandBuffer::null(),
            commands: vk::CommandBuffer::null(),
            descriptors: DescriptorSets::default(),
            hazards: HazardTracker::default(),
            profiler: None,
            markers,
            marked: Vec::new(),
            recording: false,
            number: 0,
            kept: Vec::new(),
            accesses: Vec::new(),
            submitted: None,
            callers: None,
        };
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool is valid; the buffer is freed with it.
        let buffers =
            unsafe { gpu.device.allocate_command_buffers(&info) }.map_err(GpuError::vulkan("command buffer"))?;
        recorder.own = buffers[0];
        Ok(recorder)
    }

    /// A recorder that times every pass, if the queue has timestamps.
    pub fn with_profiler(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let mut recorder = Self::new(gpu)?;
        recorder.profiler = if gpu.timestamp_bits > 0 { Some(Profiler::new(gpu)?) } else { None };
        Ok(recorder)
    }

    /// The device that it records for.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Starts the command buffer unless it is recording already, after the previous submission has finished. All other
    /// commands call this themselves.
    pub fn begin(&mut self) -> Result<(), GpuError> {
        if self.recording {
            return Ok(());
        }
        match self.submitted {
            None => {}
            Some(Submitted::Own(ticket)) => self.wait(ticket)?,
            Some(Submitted::Callers(_)) => return Err(self.refuse("a picture", "the one before is not over")),
        }
        self.start()?;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the previous submission has finished, so nothing uses the pool.
        unsafe {
            let device = &self.gpu.device;
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(GpuError::vulkan("command pool"))?;
            device.begin_command_buffer(self.own, &info).map_err(GpuError::vulkan("command buffer"))?;
        }
        self.open(self.own);
        Ok(())
    }

    /// Resets pools, markers and timestamps for the next recording. The previous submission must have finished.
    pub(super) fn start(&mut self) -> Result<(), GpuError> {
        self.submitted = None;
        self.kept.clear();
        // SAFETY: no submission uses the sets any more.
        unsafe { self.descriptors.reset(&self.gpu.device) }?;
        self.marked.clear();
        if let Some(markers) = self.markers.mapped_mut() {
            markers.fill(0);
        }
        if let Some(profiler) = &mut self.profiler {
            profiler.reset();
        }
        Ok(())
    }

    /// Directs commands to `commands`, which is in the recording state.
    pub(super) fn open(&mut self, commands: vk::CommandBuffer) {
        self.commands = commands;
        self.recording = true;
        self.number = self.gpu.next_recording();
        self.kept.push(self.markers.inner().clone());
        // Earlier submissions come first in the queue, but their writes must still be made visible to this one.
        self.barrier(Barrier {
            src_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
            src_access: vk::AccessFlags2::MEMORY_WRITE,
            dst_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
            dst_access: vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE,
        });
    }

    /// Ends the recording; no more commands follow.
    pub(super) fn close(&mut self) {
        self.recording = false;
        self.hazards = HazardTracker::default();
    }

    /// Keeps a buffer that a command of this recording uses until the submission has finished.
    pub(super) fn keep(&mut self, buffer: &Arc<BufferMemory>, pass: &str) -> Result<(), GpuError> {
        if !buffer.is_of(&self.gpu) {
            return Err(self.refuse(pass, &format!("buffer {} is of another device", buffer.name())));
        }
        if !buffer.is_kept_by(self.number) {
            self.kept.push(buffer.clone());
        }
        Ok(())
    }

    pub(super) fn refuse(&self, pass: &str, reason: &str) -> GpuError {
        GpuError::Recording { pass: pass.into(), reason: reason.into() }
    }

    /// Records the barrier that a command with `self.accesses` needs, if any.
    pub(super) fn order(&mut self) {
        if let Some(barrier) = self.hazards.next(&self.accesses) {
            self.barrier(barrier);
        }
    }

    /// Starts a pass of commands that are recorded by hand. Pass the returned timer to [`Recorder::end_by_hand`]. Does
    /// nothing if no recording has been started.
    pub fn begin_by_hand(&mut self, name: &'static str) -> Option<u32> {
        if !self.recording {
            return None;
        }
        self.mark(name);
        self.profiler.as_mut().and_then(|profiler| profiler.begin(self.commands, name))
    }

    /// Ends a pass of commands recorded by hand, if it is one of the current recording.
    pub fn end_by_hand(&mut self, timer: Option<u32>) {
        if let Some(profiler) = self.profiler.as_mut().filter(|_| self.recording) {
            profiler.end(self.commands, timer);
        }
    }

    /// Ends the command buffer and submits it.
    pub fn submit(&mut self) -> Result<Ticket, GpuError> {
        // SAFETY: there are no semaphores.
        unsafe { self.submit_between(None, None) }
    }

    /// The same as [`Recorder::submit`]; copies wait for a binary semaphore, and another one is signalled at the end.
    ///
    /// # Safety
    /// The semaphores are of this device. The first one is or will be signalled and nothing else waits for it; the
    /// second one is unsignalled. Both live until the submission has finished, as does everything that commands
    /// recorded by hand use; these commands are valid.
    pub unsafe fn submit_between(
        &mut self,
        copies_after: Option<vk::Semaphore>,
        signalled: Option<vk::Semaphore>,
    ) -> Result<Ticket, GpuError> {
        self.begin()?;
        if self.commands != self.own {
            return Err(self.refuse("a picture", "the command buffer is the caller's"));
        }
        self.barrier(FOR_THE_HOST);
        self.close();
        let ended = self.end_and_submit(copies_after, signalled);
        if ended.is_err() {
            // A rejected submission uses nothing.
            self.abandon();
        }
        ended
    }

    fn end_and_submit(
        &mut self,
        copies_after: Option<vk::Semaphore>,
        signalled: Option<vk::Semaphore>,
    ) -> Result<Ticket, GpuError> {
        // SAFETY: the command buffer is recording.
        unsafe { self.gpu.device.end_command_buffer(self.own) }.map_err(GpuError::vulkan("command buffer"))?;
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.own)];
        let whole = |semaphore| {
            vk::SemaphoreSubmitInfo::default().semaphore(semaphore).stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let waits = [whole(copies_after.unwrap_or_default()).stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)];
        let waits = &waits[..usize::from(copies_after.is_some())];
        let timeline = &self.gpu.timeline;
        let accepted = self.gpu.with_queue(|queue| {
            let fate = self.gpu.fate_of_submission();
            if fate == Fate::Refused {
                timeline.lose();
                return Err(vk::Result::ERROR_DEVICE_LOST);
            }
            let ticket = timeline.next();
            let own = timeline.semaphore()?;
            let signals = [whole(own).value(ticket.0), whole(signalled.unwrap_or_default())];
            let info = [vk::SubmitInfo2::default()
                .wait_semaphore_infos(waits)
                .command_buffer_infos(&commands)
                .signal_semaphore_infos(&signals[..1 + usize::from(signalled.is_some())])];
            // SAFETY: the queue is locked; the command buffer is complete; the arrays live through the call; the caller
            // guarantees the semaphores.
            unsafe { self.gpu.device.queue_submit2(queue, &info, vk::Fence::null()) }?;
            timeline.submitted(ticket);
            if fate == Fate::Dies {
                timeline.lose();
            }
            Ok::<_, vk::Result>(ticket)
        });
        let ticket = accepted?.map_err(|result| self.explain(result))?;
        self.kept.iter().for_each(|buffer| buffer.submitted(ticket));
        let room = Vec::with_capacity(self.kept.len());
        self.gpu.keep_until(ticket, mem::replace(&mut self.kept, room));
        self.submitted = Some(Submitted::Own(ticket));
        Ok(ticket)
    }

    /// Discards the commands since the last submission and releases their buffers; the next command starts a new
    /// recording. Call this when recording failed midway: the next submission would run the part that was recorded.
    pub fn abandon(&mut self) {
        if !matches!(self.submitted, Some(Submitted::Callers(_))) {
            self.kept.clear();
        }
        if let Some(profiler) = &mut self.profiler {
            profiler.forget();
        }
        self.close();
    }

    /// Waits for a submission of this recorder; a lost device is an error that, with validation, names the last pass begun.
    pub fn wait(&self, ticket: Ticket) -> Result<(), GpuError> {
        self.gpu.wait_for(ticket).map_err(|result| self.explain(result))
    }

    /// Waits for the last submission of this recorder, if there is one.
    pub fn wait_for_last(&self) -> Result<(), GpuError> {
        match self.submitted {
            Some(Submitted::Own(ticket)) => self.wait(ticket),
            _ => Ok(()),
        }
    }

    /// Names and milliseconds of the passes of the last submission, in order; call after `wait`. Empty without a
    /// profiler, and while the next recording is under way.
    pub fn passes_ms(&self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        self.profiler.as_ref().filter(|_| !self.recording).map_or(Ok(Vec::new()), Profiler::read)
    }

    pub(super) fn explain(&self, result: vk::Result) -> GpuError {
        if result != vk::Result::ERROR_DEVICE_LOST {
            return GpuError::Vulkan { what: "submission".into(), result };
        }
        GpuError::DeviceLost { last_pass: self.last_pass_begun().unwrap_or(NOT_MARKED).into() }
    }

    /// The last pass of the current or last submission whose crash marker is set; `None` without validation.
    pub fn last_pass_begun(&self) -> Option<&'static str> {
        let set = self.markers.mapped()?.chunks_exact(4).take_while(|slot| slot.iter().any(|&b| b != 0)).count();
        self.marked.get(set.checked_sub(1)?).copied()
    }

    pub(super) fn mark(&mut self, name: &'static str) {
        if self.gpu.is_debugged() && self.marked.len() < MAX_MARKERS {
            let offset = 4 * self.marked.len() as u64;
            // SAFETY: recording; the slot lies in the buffer, and each slot is written once per submission.
            unsafe { self.gpu.device.cmd_fill_buffer(self.commands, self.markers.handle(), offset, 4, 1) };
            self.marked.push(name);
        }
    }

    pub(super) fn barrier(&self, barrier: Barrier) {
        let memory = [vk::MemoryBarrier2 {
            src_stage_mask: barrier.src_stage,
            src_access_mask: barrier.src_access,
            dst_stage_mask: barrier.dst_stage,
            dst_access_mask: barrier.dst_access,
            ..Default::default()
        }];
        let info = vk::DependencyInfo::default().memory_barriers(&memory);
        // SAFETY: the command buffer is recording and the array lives through the call.
        unsafe { self.gpu.device.cmd_pipeline_barrier2(self.commands, &info) };
    }
}

/// Makes device writes visible to the host after the wait.
pub(super) const FOR_THE_HOST: Barrier = Barrier {
    src_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
    src_access: vk::AccessFlags2::MEMORY_WRITE,
    dst_stage: vk::PipelineStageFlags2::HOST,
    dst_access: vk::AccessFlags2::HOST_READ,
};

impl Drop for Recorder {
    fn drop(&mut self) {
        let over = match (self.submitted, &self.callers) {
            (Some(Submitted::Own(ticket)), _) => {
                matches!(self.gpu.wait_for(ticket), Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST))
            }
            (Some(Submitted::Callers(ticket)), Some(callers)) => callers.is_over(ticket),
            _ => true,
        };
        if !over {
            // The device may still use all of it, and a submission of the caller's cannot be waited for: it may never
            // come. The kept buffers keep the device alive.
            mem::forget(mem::take(&mut self.kept));
            mem::forget((self.profiler.take(), self.callers.take(), self.gpu.clone()));
            return;
        }
        // Before the device, of which `self.gpu` may hold the last reference.
        drop(self.callers.take());
        // SAFETY: the device has finished everything recorded here.
        unsafe {
            self.descriptors.destroy(&self.gpu.device);
            self.gpu.device.destroy_command_pool(self.pool, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::GpuOptions;

    fn gpu() -> Option<Arc<Gpu>> {
        match Gpu::open(&GpuOptions { validation: true, ..Default::default() }) {
            Ok(gpu) => Some(gpu),
            Err(_) if std::env::var("INSTGS_SKIP_GPU").as_deref() == Ok("1") => None,
            Err(error) => panic!("{error} (set INSTGS_SKIP_GPU=1 to skip GPU tests)"),
        }
    }

    /// A buffer may be dropped at any time: its memory is freed when no recording or submission uses it any more.
    #[test]
    fn what_is_recorded_outlives_its_buffer() {
        let Some(gpu) = gpu() else { return };
        let mut recorder = Recorder::new(&gpu).unwrap();
        let without = gpu.memory_usage().0;
        let fill = |recorder: &mut Recorder| {
            let mut buffer = Buffer::<u32>::new(&gpu, "dropped", 1 << 20).unwrap();
            recorder.fill(&mut buffer, 1).unwrap();
            recorder.fill(&mut buffer, 2).unwrap();
        };
        for _ in 0..2 {
            fill(&mut recorder);
            assert!(gpu.memory_usage().0 > without, "the recording keeps it");
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            assert_eq!(gpu.memory_usage().0, without, "nothing keeps it after the submission");
        }
        fill(&mut recorder);
        recorder.abandon();
        assert_eq!(gpu.memory_usage().0, without, "nothing keeps it after recording was abandoned");
        fill(&mut recorder);
        let mut other = Recorder::new(&gpu).unwrap();
        fill(&mut other);
        other.submit().unwrap();
        drop((recorder, other));
        assert!(gpu.memory_usage().0 < without, "with the recorders, what they kept and their markers go");
        let messages = gpu.validation_messages().take();
        assert!(messages.is_empty(), "{messages:?}");
        assert_eq!(Arc::strong_count(&gpu), 1, "no submission keeps the device");
    }

    #[test]
    fn buffers_of_another_device_are_refused() {
        let (Some(gpu), Some(other)) = (gpu(), gpu()) else { return };
        let mut buffer = Buffer::<u32>::new(&other, "foreign", 1).unwrap();
        let mut recorder = Recorder::new(&gpu).unwrap();
        let refused = recorder.fill(&mut buffer, 1);
        assert!(matches!(refused, Err(GpuError::Recording { .. })), "{refused:?}");
    }

    /// The tests' check for silence can fail: a write after a write without a barrier is reported.
    #[test]
    fn synchronization_validation_sees_a_planted_hazard() {
        let Some(gpu) = gpu() else { return };
        let mut buffer = Buffer::<u32>::new(&gpu, "planted", 64).unwrap();
        let mut recorder = Recorder::new(&gpu).unwrap();
        for forget in [false, true] {
            recorder.fill(&mut buffer, 1).unwrap();
            if forget {
                recorder.hazards = HazardTracker::default();
            }
            recorder.fill(&mut buffer, 2).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            let messages = gpu.validation_messages().take();
            assert_eq!(messages.iter().any(|m| m.contains("SYNC-HAZARD-WRITE")), forget, "{messages:?}");
        }
    }
}
