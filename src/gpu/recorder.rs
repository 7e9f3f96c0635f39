//! Records dispatches, fills and copies into one command buffer; barriers follow from the bindings.

use std::ops::Range;
use std::sync::Arc;

use ash::vk;

use super::barrier::{Access, Barrier, HazardTracker};
use super::buffer::Buffer;
use super::context::Gpu;
use super::error::GpuError;
use super::interface::{BindingSet as _, Kernel};
use super::pipeline::Pipeline;
use super::profiler::Profiler;
use super::timeline::Ticket;

/// Work-groups of a direct dispatch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Work-groups along x.
    pub x: u32,
    /// Work-groups along y.
    pub y: u32,
}

impl Grid {
    /// `count` work-groups, folded into two dimensions of at most 65535 (Vulkan's least upper limit);
    /// kernels flatten the index again and check it against their count.
    pub fn groups(count: u32) -> Self {
        const ROW: u32 = 65535;
        if count <= ROW { Self { x: count.max(1), y: 1 } } else { Self { x: ROW, y: count.div_ceil(ROW) } }
    }

    /// As many work-groups of `size` threads as cover `threads`.
    pub fn threads(threads: u32, size: u32) -> Self {
        Self::groups(threads.div_ceil(size))
    }
}

/// Passes that the crash marker can name; later ones share the last slot's name.
const MAX_MARKERS: usize = 1024;

/// Bytes that one update command takes at most: Vulkan's limit.
const MAX_UPDATE_BYTES: usize = 65536;

/// One reusable command buffer.
pub struct Recorder {
    gpu: Arc<Gpu>,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    descriptor_pools: Vec<vk::DescriptorPool>,
    /// Index of the pool in use and sets taken from it.
    descriptor_cursor: (usize, u32),
    hazards: HazardTracker,
    profiler: Option<Profiler>,
    /// Slot i is set before pass i begins: after a device loss the last set slot names the culprit, or a pass soon after
    /// it, since nothing orders these fills against the dispatches.
    markers: Buffer<u32>,
    marked: Vec<&'static str>,
    recording: bool,
    /// The last submission, which must be over before the command buffer is reused.
    submitted: Option<Ticket>,
}

/// Descriptor sets per pool; a frame takes about 60.
const SETS_PER_POOL: u32 = 128;
/// Storage buffers per set on average; only the largest kernels have more.
const BUFFERS_PER_SET: u32 = 20;

impl Recorder {
    /// A recorder without timestamps.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.queue_family);
        // SAFETY: a valid family; destroyed in drop.
        let pool = unsafe { gpu.device.create_command_pool(&info, None) }.map_err(GpuError::vulkan("command pool"))?;
        let mut recorder = Self {
            gpu: gpu.clone(),
            pool,
            commands: vk::CommandBuffer::null(),
            descriptor_pools: Vec::new(),
            descriptor_cursor: (0, 0),
            hazards: HazardTracker::default(),
            profiler: None,
            markers: Buffer::for_readback(gpu, "crash markers", MAX_MARKERS)?,
            marked: Vec::new(),
            recording: false,
            submitted: None,
        };
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool is valid; the buffer is freed with it.
        let buffers =
            unsafe { gpu.device.allocate_command_buffers(&info) }.map_err(GpuError::vulkan("command buffer"))?;
        recorder.commands = buffers[0];
        Ok(recorder)
    }

    /// A recorder that times every pass, if the queue has timestamps.
    pub fn with_profiler(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let mut recorder = Self::new(gpu)?;
        recorder.profiler = if gpu.timestamp_bits > 0 { Some(Profiler::new(gpu)?) } else { None };
        Ok(recorder)
    }

    /// Starts the command buffer if it has not been started, after the previous submission has finished. The other commands do
    /// it by themselves.
    pub fn begin(&mut self) -> Result<(), GpuError> {
        if self.recording {
            return Ok(());
        }
        if let Some(ticket) = self.submitted.take() {
            self.wait(ticket)?;
        }
        let device = &self.gpu.device;
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the previous submission, if any, was waited for above, so pool and sets are not in use.
        unsafe {
            device
                .reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .map_err(GpuError::vulkan("command pool"))?;
            for &pool in &self.descriptor_pools {
                device
                    .reset_descriptor_pool(pool, vk::DescriptorPoolResetFlags::empty())
                    .map_err(GpuError::vulkan("descriptor pool"))?;
            }
            device.begin_command_buffer(self.commands, &info).map_err(GpuError::vulkan("command buffer"))?;
        }
        self.descriptor_cursor = (0, 0);
        self.marked.clear();
        if let Some(markers) = self.markers.mapped_mut() {
            markers.fill(0);
        }
        if let Some(profiler) = &mut self.profiler {
            profiler.reset();
        }
        // Earlier submissions are complete for the host but their writes must still be made visible to this one.
        self.barrier(Barrier {
            src_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
            src_access: vk::AccessFlags2::MEMORY_WRITE,
            dst_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
            dst_access: vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE,
        });
        self.recording = true;
        Ok(())
    }

    /// Dispatches `grid` work-groups of a kernel.
    pub fn dispatch<K: Kernel>(
        &mut self,
        pipeline: &Pipeline<K>,
        grid: Grid,
        params: &K::Params,
        bindings: K::Bindings<'_>,
    ) -> Result<(), GpuError> {
        self.run::<K>(pipeline, params, &bindings, None, |device, commands| {
            // SAFETY: the pipeline, its sets and push constants are bound by `run`; the grid is within 65535 squared.
            unsafe { device.cmd_dispatch(commands, grid.x, grid.y, 1) };
        })
    }

    /// Dispatches a kernel with the work-group counts in element `index` of `args` (three u32 each).
    pub fn dispatch_indirect<K: Kernel, A: bytemuck::NoUninit>(
        &mut self,
        pipeline: &Pipeline<K>,
        args: (&Buffer<A>, usize),
        params: &K::Params,
        bindings: K::Bindings<'_>,
    ) -> Result<(), GpuError> {
        const { assert!(size_of::<A>() == 12, "indirect arguments are three u32") };
        let (buffer, index) = args;
        assert!(index < buffer.len(), "{}: no indirect arguments {index}", buffer.name());
        let handle = buffer.handle();
        self.run::<K>(pipeline, params, &bindings, Some(handle), |device, commands| {
            // SAFETY: as in `dispatch`; the offset lies in the buffer and is a multiple of 4.
            unsafe { device.cmd_dispatch_indirect(commands, handle, 12 * index as u64) };
        })
    }

    fn run<K: Kernel>(
        &mut self,
        pipeline: &Pipeline<K>,
        params: &K::Params,
        bindings: &K::Bindings<'_>,
        indirect: Option<vk::Buffer>,
        dispatch: impl FnOnce(&ash::Device, vk::CommandBuffer),
    ) -> Result<(), GpuError> {
        self.begin()?;
        let mut accesses = Vec::with_capacity(BUFFERS_PER_SET as usize);
        let mut bound = Vec::with_capacity(BUFFERS_PER_SET as usize);
        bindings.visit(&mut |b| {
            accesses.push((b.handle, if b.writable { Access::SHADER_WRITE } else { Access::SHADER_READ }));
            bound.push((b.binding, [vk::DescriptorBufferInfo::default().buffer(b.handle).range(vk::WHOLE_SIZE)]));
        });
        accesses.extend(indirect.map(|handle| (handle, Access::INDIRECT)));
        if let Some(barrier) = self.hazards.next(&accesses) {
            self.barrier(barrier);
        }
        let set = self.descriptor_set(pipeline.set_layout)?;
        let writes: Vec<_> = bound
            .iter()
            .map(|(binding, info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(*binding)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .collect();
        let name = K::SHADER.name;
        self.mark(name);
        let (gpu, commands) = (self.gpu.clone(), self.commands);
        let device = &gpu.device;
        let timer = self.profiler.as_mut().and_then(|p| p.begin(commands, name));
        // SAFETY: the set was just allocated with the pipeline's layout; the command buffer is recording; buffers
        // outlive the submission because their drop waits for the device.
        unsafe {
            device.update_descriptor_sets(&writes, &[]);
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline.handle);
            device.cmd_bind_descriptor_sets(commands, vk::PipelineBindPoint::COMPUTE, pipeline.layout, 0, &[set], &[]);
            if K::SHADER.push_constant_bytes > 0 {
                let bytes = bytemuck::bytes_of(params);
                device.cmd_push_constants(commands, pipeline.layout, vk::ShaderStageFlags::COMPUTE, 0, bytes);
            }
        }
        dispatch(device, commands);
        if let Some(profiler) = &mut self.profiler {
            profiler.end(commands, timer);
        }
        Ok(())
    }

    /// Fills a whole buffer with one 32-bit value.
    pub fn fill<T: bytemuck::NoUninit>(&mut self, buffer: &mut Buffer<T>, value: u32) -> Result<(), GpuError> {
        self.begin()?;
        if let Some(barrier) = self.hazards.next(&[(buffer.handle(), Access::COPY_WRITE)]) {
            self.barrier(barrier);
        }
        // SAFETY: the command buffer is recording and the buffer has transfer usage.
        unsafe { self.gpu.device.cmd_fill_buffer(self.commands, buffer.handle(), 0, vk::WHOLE_SIZE, value) };
        Ok(())
    }

    /// Copies the first `bytes` bytes.
    ///
    /// # Panics
    /// If either buffer is shorter.
    pub fn copy<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        target: &mut Buffer<T>,
        bytes: u64,
    ) -> Result<(), GpuError> {
        self.copy_to(source, (target, 0), bytes)
    }

    /// Copies the first `bytes` bytes to where element `first` of the target begins.
    ///
    /// # Panics
    /// If either buffer is shorter.
    pub fn copy_to<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        (target, first): (&mut Buffer<T>, usize),
        bytes: u64,
    ) -> Result<(), GpuError> {
        let offset = (first * size_of::<T>()) as u64;
        let fits = bytes <= source.bytes() && offset + bytes <= target.bytes();
        assert!(fits, "{} to {} from {first}: {bytes} bytes", source.name(), target.name());
        self.begin()?;
        let accesses = [(source.handle(), Access::COPY_READ), (target.handle(), Access::COPY_WRITE)];
        if let Some(barrier) = self.hazards.next(&accesses) {
            self.barrier(barrier);
        }
        let regions = [vk::BufferCopy { src_offset: 0, dst_offset: offset, size: bytes }];
        // SAFETY: recording; both buffers hold at least `bytes` bytes (asserted).
        unsafe { self.gpu.device.cmd_copy_buffer(self.commands, source.handle(), target.handle(), &regions) };
        Ok(())
    }

    /// Copies what lies in the source from element `first` on to the start of the target, as much as the target holds.
    ///
    /// # Panics
    /// If the source ends before that.
    pub fn copy_from<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        first: usize,
        target: &mut Buffer<T>,
    ) -> Result<(), GpuError> {
        let (offset, bytes) = ((first * size_of::<T>()) as u64, target.bytes());
        assert!(offset + bytes <= source.bytes(), "{}: {bytes} bytes from element {first}", source.name());
        self.begin()?;
        let accesses = [(source.handle(), Access::COPY_READ), (target.handle(), Access::COPY_WRITE)];
        if let Some(barrier) = self.hazards.next(&accesses) {
            self.barrier(barrier);
        }
        let regions = [vk::BufferCopy { src_offset: offset, dst_offset: 0, size: bytes }];
        // SAFETY: recording; the source holds the region (asserted), which is as long as the target.
        unsafe { self.gpu.device.cmd_copy_buffer(self.commands, source.handle(), target.handle(), &regions) };
        Ok(())
    }

    /// Writes these runs of `elements` to the same places of a buffer. The values travel in the command buffer: there is no
    /// staging buffer, and `elements` may change as soon as this returns. Takes the buffer shared, since a scene that is drawn
    /// is shared; barriers are those of any other write.
    ///
    /// # Panics
    /// If a run goes beyond the elements or the buffer.
    pub fn update<T: bytemuck::NoUninit>(
        &mut self,
        target: &Buffer<T>,
        elements: &[T],
        runs: &[Range<usize>],
    ) -> Result<(), GpuError> {
        const { assert!(size_of::<T>().is_multiple_of(4), "updates are of whole 32-bit words") };
        if runs.is_empty() {
            return Ok(());
        }
        self.begin()?;
        if let Some(barrier) = self.hazards.next(&[(target.handle(), Access::COPY_WRITE)]) {
            self.barrier(barrier);
        }
        for run in runs {
            assert!(run.end <= target.len(), "{}: elements {run:?} of {}", target.name(), target.len());
            let bytes: &[u8] = bytemuck::cast_slice(&elements[run.clone()]);
            let first = (run.start * size_of::<T>()) as u64;
            for (k, part) in bytes.chunks(MAX_UPDATE_BYTES).enumerate() {
                let offset = first + (k * MAX_UPDATE_BYTES) as u64;
                // SAFETY: recording; the part lies in the buffer (asserted), is at most 65536 bytes, and offset and length
                // are multiples of 4 as the element's size is.
                unsafe { self.gpu.device.cmd_update_buffer(self.commands, target.handle(), offset, part) };
            }
        }
        Ok(())
    }

    /// Starts a command that is recorded by hand and reads the whole of `source` by a copy.
    #[cfg(feature = "player")]
    pub(super) fn raw_copy<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
    ) -> Result<vk::CommandBuffer, GpuError> {
        self.begin()?;
        if let Some(barrier) = self.hazards.next(&[(source.handle(), Access::COPY_READ)]) {
            self.barrier(barrier);
        }
        Ok(self.commands)
    }

    /// Starts a pass of commands that are recorded by hand; give what comes back to [`Recorder::end_by_hand`].
    #[cfg(feature = "player")]
    pub(super) fn begin_by_hand(&mut self, name: &'static str) -> Option<u32> {
        self.mark(name);
        self.profiler.as_mut().and_then(|profiler| profiler.begin(self.commands, name))
    }

    /// Ends the pass.
    #[cfg(feature = "player")]
    pub(super) fn end_by_hand(&mut self, timer: Option<u32>) {
        if let Some(profiler) = &mut self.profiler {
            profiler.end(self.commands, timer);
        }
    }

    /// Ends the command buffer and submits it.
    pub fn submit(&mut self) -> Result<Ticket, GpuError> {
        self.submit_between(None, None)
    }

    /// As [`Recorder::submit`]; copies wait for a binary semaphore, and another one is signalled at the end.
    pub(super) fn submit_between(
        &mut self,
        copies_after: Option<vk::Semaphore>,
        signalled: Option<vk::Semaphore>,
    ) -> Result<Ticket, GpuError> {
        self.begin()?;
        // Downloads are read by the host after the wait.
        self.barrier(Barrier {
            src_stage: vk::PipelineStageFlags2::ALL_COMMANDS,
            src_access: vk::AccessFlags2::MEMORY_WRITE,
            dst_stage: vk::PipelineStageFlags2::HOST,
            dst_access: vk::AccessFlags2::HOST_READ,
        });
        self.abandon();
        // SAFETY: the command buffer is recording.
        unsafe { self.gpu.device.end_command_buffer(self.commands) }.map_err(GpuError::vulkan("command buffer"))?;
        let queue = self.gpu.queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let ticket = self.gpu.timeline.next();
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let whole = |semaphore| {
            vk::SemaphoreSubmitInfo::default().semaphore(semaphore).stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
        };
        let signals: Vec<_> =
            [whole(self.gpu.timeline.semaphore).value(ticket.0)].into_iter().chain(signalled.map(whole)).collect();
        let waits: Vec<_> =
            copies_after.map(|s| whole(s).stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)).into_iter().collect();
        let info = [vk::SubmitInfo2::default()
            .wait_semaphore_infos(&waits)
            .command_buffer_infos(&commands)
            .signal_semaphore_infos(&signals)];
        // SAFETY: the queue is locked; the command buffer is complete; the arrays live through the call.
        unsafe { self.gpu.device.queue_submit2(*queue, &info, vk::Fence::null()) }.map_err(|e| self.explain(e))?;
        self.gpu.timeline.submitted(ticket);
        self.submitted = Some(ticket);
        Ok(ticket)
    }

    /// Forgets what was recorded since the last submission; the next command starts anew. To be called when recording
    /// failed midway, before any buffer of the failed commands is reused.
    pub fn abandon(&mut self) {
        self.recording = false;
        self.hazards = HazardTracker::default();
    }

    /// Waits for a submission of this recorder; a lost device names the last pass begun.
    pub fn wait(&self, ticket: Ticket) -> Result<(), GpuError> {
        self.gpu.timeline.wait(&self.gpu.device, ticket).map_err(|result| self.explain(result))
    }

    /// Waits for the last submission of this recorder, if there is one.
    pub fn wait_for_last(&self) -> Result<(), GpuError> {
        self.submitted.map_or(Ok(()), |ticket| self.wait(ticket))
    }

    /// Milliseconds per pass of the last submission, in order; call after `wait`. Empty without a profiler.
    pub fn passes_ms(&self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        self.profiler.as_ref().map_or(Ok(Vec::new()), Profiler::read)
    }

    fn explain(&self, result: vk::Result) -> GpuError {
        if result != vk::Result::ERROR_DEVICE_LOST {
            return GpuError::Vulkan { what: "submission".into(), result };
        }
        GpuError::DeviceLost { last_pass: self.last_pass_begun().unwrap_or("none").into() }
    }

    /// The last pass of the current or last submission whose crash marker is set.
    pub fn last_pass_begun(&self) -> Option<&'static str> {
        let set = self.markers.mapped()?.chunks_exact(4).take_while(|slot| slot.iter().any(|&b| b != 0)).count();
        self.marked.get(set.checked_sub(1)?).copied()
    }

    fn mark(&mut self, name: &'static str) {
        if self.marked.len() < MAX_MARKERS {
            let offset = 4 * self.marked.len() as u64;
            // SAFETY: recording; the slot lies in the buffer, and each slot is written once per submission.
            unsafe { self.gpu.device.cmd_fill_buffer(self.commands, self.markers.handle(), offset, 4, 1) };
            self.marked.push(name);
        }
    }

    fn barrier(&self, barrier: Barrier) {
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

    fn descriptor_set(&mut self, layout: vk::DescriptorSetLayout) -> Result<vk::DescriptorSet, GpuError> {
        let (pool_index, used) = self.descriptor_cursor;
        let pool_index = if used == SETS_PER_POOL { pool_index + 1 } else { pool_index };
        let used = if used == SETS_PER_POOL { 0 } else { used };
        if pool_index == self.descriptor_pools.len() {
            self.descriptor_pools.push(create_descriptor_pool(&self.gpu)?);
        }
        self.descriptor_cursor = (pool_index, used + 1);
        let layouts = [layout];
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(self.descriptor_pools[pool_index])
            .set_layouts(&layouts);
        // SAFETY: the pool has room for SETS_PER_POOL sets of up to BUFFERS_PER_SET buffers.
        let sets = unsafe { self.gpu.device.allocate_descriptor_sets(&info) };
        Ok(sets.map_err(GpuError::vulkan("descriptor set"))?[0])
    }
}

fn create_descriptor_pool(gpu: &Gpu) -> Result<vk::DescriptorPool, GpuError> {
    let sizes = [vk::DescriptorPoolSize {
        ty: vk::DescriptorType::STORAGE_BUFFER,
        descriptor_count: SETS_PER_POOL * BUFFERS_PER_SET,
    }];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
    // SAFETY: the sizes live through the call.
    unsafe { gpu.device.create_descriptor_pool(&info, None) }.map_err(GpuError::vulkan("descriptor pool"))
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.gpu.wait_all();
        // SAFETY: the device is done with everything recorded here.
        unsafe {
            for &pool in &self.descriptor_pools {
                self.gpu.device.destroy_descriptor_pool(pool, None);
            }
            self.gpu.device.destroy_command_pool(self.pool, None);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::GpuOptions;

    /// The tests' check for silence can fail: a write after a write without a barrier is reported.
    #[test]
    fn synchronization_validation_sees_a_planted_hazard() {
        let gpu = match Gpu::open(&GpuOptions { validation: true, ..Default::default() }) {
            Ok(gpu) => gpu,
            Err(_) if std::env::var("INSTGS_SKIP_GPU").as_deref() == Ok("1") => return,
            Err(error) => panic!("{error} (set INSTGS_SKIP_GPU=1 to skip GPU tests)"),
        };
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
