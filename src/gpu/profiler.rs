//! GPU timestamps around passes.

use std::sync::Arc;

use ash::vk;

use super::context::Gpu;
use super::error::GpuError;

/// Passes per command buffer that can be timed; a frame has about 60 dispatches.
const MAX_PASSES: u32 = 1024;

/// Two timestamps per pass of one command buffer.
pub(crate) struct Profiler {
    gpu: Arc<Gpu>,
    pool: vk::QueryPool,
    names: Vec<&'static str>,
}

impl Profiler {
    pub(crate) fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2 * MAX_PASSES);
        // SAFETY: a valid create-info; destroyed in drop.
        let pool = unsafe { gpu.device.create_query_pool(&info, None) }.map_err(GpuError::vulkan("timestamps"))?;
        let mut profiler = Self { gpu: gpu.clone(), pool, names: Vec::new() };
        profiler.reset();
        Ok(profiler)
    }

    /// Resets all queries. The device must have finished the command buffer.
    pub(crate) fn reset(&mut self) {
        self.names.clear();
        // SAFETY: hostQueryReset is enabled and the queries are not in use.
        unsafe { self.gpu.device.reset_query_pool(self.pool, 0, 2 * MAX_PASSES) };
    }

    /// Drops the passes of a command buffer that is not submitted.
    pub(crate) fn forget(&mut self) {
        self.names.clear();
    }

    /// Writes the first timestamp of a pass; `None` if there is no room.
    pub(crate) fn begin(&mut self, commands: vk::CommandBuffer, name: &'static str) -> Option<u32> {
        let index = self.names.len() as u32;
        if index >= MAX_PASSES {
            return None;
        }
        self.names.push(name);
        self.stamp(commands, 2 * index);
        Some(index)
    }

    /// Writes the second timestamp of a pass.
    pub(crate) fn end(&mut self, commands: vk::CommandBuffer, index: Option<u32>) {
        if let Some(index) = index {
            self.stamp(commands, 2 * index + 1);
        }
    }

    fn stamp(&self, commands: vk::CommandBuffer, query: u32) {
        // SAFETY: the command buffer is recording; each query is written once after its reset.
        unsafe {
            self.gpu.device.cmd_write_timestamp2(commands, vk::PipelineStageFlags2::ALL_COMMANDS, self.pool, query);
        }
    }

    /// Pass names and milliseconds in order, after the command buffer has finished.
    pub(crate) fn read(&self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        let mut ticks = vec![0u64; 2 * self.names.len()];
        if !ticks.is_empty() {
            let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
            // SAFETY: `ticks` has room for the queries asked for, all of which were written.
            unsafe { self.gpu.device.get_query_pool_results(self.pool, 0, &mut ticks, flags) }
                .map_err(GpuError::vulkan("timestamps"))?;
        }
        let ns = f64::from(self.gpu.caps().timestamp_period_ns);
        let mask = u64::MAX >> (64 - self.gpu.timestamp_bits.clamp(1, 64));
        let milliseconds = |i: usize| (ticks[2 * i + 1].wrapping_sub(ticks[2 * i]) & mask) as f64 * ns * 1e-6;
        Ok(self.names.iter().enumerate().map(|(i, name)| (*name, milliseconds(i))).collect())
    }
}

impl Drop for Profiler {
    fn drop(&mut self) {
        // SAFETY: the recorder that owns this has waited for the submission that writes the queries.
        unsafe { self.gpu.device.destroy_query_pool(self.pool, None) };
    }
}
