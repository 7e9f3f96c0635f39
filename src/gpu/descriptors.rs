//! Descriptor sets of one recording, out of pools that are reused from recording to recording.

use ash::vk;

use super::error::GpuError;
use super::interface::MOST_BINDINGS;

/// Descriptor sets per pool; a frame uses about 60.
const SETS_PER_POOL: u32 = 128;
/// Storage buffers of all sets of a pool, each set being of the kernel with the most bindings.
const POOL_BUFFERS: u32 = SETS_PER_POOL * MOST_BINDINGS as u32;

/// Pools of descriptor sets, filled one after the other. All calls are with the same device.
#[derive(Default)]
pub(super) struct DescriptorSets {
    pools: Vec<vk::DescriptorPool>,
    /// Number of sets taken, over all pools in order.
    used: usize,
}

impl DescriptorSets {
    /// A set of the layout of one kernel, valid until the next reset.
    pub(super) fn allocate(
        &mut self,
        device: &ash::Device,
        layout: vk::DescriptorSetLayout,
    ) -> Result<vk::DescriptorSet, GpuError> {
        let pool = self.used / SETS_PER_POOL as usize;
        if pool == self.pools.len() {
            self.pools.push(create_pool(device)?);
        }
        let layouts = [layout];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pools[pool]).set_layouts(&layouts);
        // SAFETY: the pool has room for SETS_PER_POOL sets of up to MOST_BINDINGS buffers, which no kernel exceeds.
        let sets = unsafe { device.allocate_descriptor_sets(&info) }.map_err(GpuError::vulkan("descriptor set"))?;
        self.used += 1;
        Ok(sets[0])
    }

    /// Takes all sets back.
    ///
    /// # Safety
    /// No submission uses them any more.
    pub(super) unsafe fn reset(&mut self, device: &ash::Device) -> Result<(), GpuError> {
        for &pool in &self.pools {
            // SAFETY: the caller's promise.
            unsafe { device.reset_descriptor_pool(pool, vk::DescriptorPoolResetFlags::empty()) }
                .map_err(GpuError::vulkan("descriptor pool"))?;
        }
        self.used = 0;
        Ok(())
    }

    /// Destroys the pools with their sets.
    ///
    /// # Safety
    /// No submission uses the sets any more.
    pub(super) unsafe fn destroy(&mut self, device: &ash::Device) {
        for pool in self.pools.drain(..) {
            // SAFETY: the caller's promise; the pool is of this device.
            unsafe { device.destroy_descriptor_pool(pool, None) };
        }
        self.used = 0;
    }
}

fn create_pool(device: &ash::Device) -> Result<vk::DescriptorPool, GpuError> {
    let sizes = [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: POOL_BUFFERS }];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS_PER_POOL).pool_sizes(&sizes);
    // SAFETY: the sizes live through the call.
    unsafe { device.create_descriptor_pool(&info, None) }.map_err(GpuError::vulkan("descriptor pool"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The allocation of sets relies on this.
    #[test]
    fn a_pool_has_room_for_its_sets_of_any_kernel() {
        let most = crate::gpu::interface::ALL_SHADERS.iter().map(|shader| shader.bindings.len()).max();
        assert!(POOL_BUFFERS as usize >= SETS_PER_POOL as usize * most.unwrap());
    }
}
