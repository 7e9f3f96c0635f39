//! Device memory through gpu-allocator, with running totals.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};

use super::error::GpuError;

/// The allocator and its totals. Dropping it frees all device memory, so it must be dropped before the device.
pub(crate) struct Memory {
    allocator: Mutex<Allocator>,
    current_bytes: AtomicU64,
    peak_bytes: AtomicU64,
    budget_bytes: AtomicU64,
}

impl Memory {
    pub(crate) fn new(
        instance: &ash::Instance,
        device: &ash::Device,
        physical: vk::PhysicalDevice,
    ) -> Result<Self, GpuError> {
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        });
        let allocator = allocator.map_err(|e| GpuError::OutOfMemory {
            name: "the allocator".into(),
            bytes: 0,
            reason: e.to_string(),
        })?;
        Ok(Self {
            allocator: Mutex::new(allocator),
            current_bytes: AtomicU64::new(0),
            peak_bytes: AtomicU64::new(0),
            budget_bytes: AtomicU64::new(u64::MAX),
        })
    }

    pub(crate) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
    ) -> Result<Allocation, GpuError> {
        let fail = |reason: String| GpuError::OutOfMemory { name: name.into(), bytes: requirements.size, reason };
        let (used, budget) = (self.current_bytes.load(Ordering::Relaxed), self.budget_bytes.load(Ordering::Relaxed));
        if used.saturating_add(requirements.size) > budget {
            return Err(fail(format!("{used} bytes are in use and the budget is {budget}")));
        }
        let mut allocator = self.allocator.lock().map_err(|_| fail("the allocator is poisoned".into()))?;
        let allocation = allocator
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location,
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| fail(e.to_string()))?;
        let now = self.current_bytes.fetch_add(allocation.size(), Ordering::Relaxed) + allocation.size();
        self.peak_bytes.fetch_max(now, Ordering::Relaxed);
        Ok(allocation)
    }

    pub(crate) fn free(&self, allocation: Allocation) {
        self.current_bytes.fetch_sub(allocation.size(), Ordering::Relaxed);
        if let Ok(mut allocator) = self.allocator.lock() {
            // Freeing fails only for an allocation of another allocator, which cannot occur here.
            let _ = allocator.free(allocation);
        }
    }

    /// Bytes allocated now, and the peak since the last `reset_peak`.
    pub(crate) fn usage(&self) -> (u64, u64) {
        (self.current_bytes.load(Ordering::Relaxed), self.peak_bytes.load(Ordering::Relaxed))
    }

    /// Makes allocations that would exceed a total of `bytes` fail from now on.
    pub(crate) fn set_budget(&self, bytes: u64) {
        self.budget_bytes.store(bytes, Ordering::Relaxed);
    }

    /// Largest total of allocations, bytes; `u64::MAX` if no budget was set.
    pub(crate) fn budget(&self) -> u64 {
        self.budget_bytes.load(Ordering::Relaxed)
    }

    /// Makes the current total the new peak.
    pub(crate) fn reset_peak(&self) {
        self.peak_bytes.store(self.current_bytes.load(Ordering::Relaxed), Ordering::Relaxed);
    }
}
