//! Device memory through gpu-allocator, with running totals.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme, Allocator, AllocatorCreateDesc};

use super::error::GpuError;

/// What a buffer's memory is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MemoryUse {
    /// The device alone reads and writes it.
    Device,
    /// The host writes it, the device reads it.
    Upload,
    /// The device writes it, the host reads it.
    Readback,
    /// As `Device`, but it is host memory, which kernels read over the bus, and does not count against the budget.
    DeviceOnHost,
}

impl MemoryUse {
    fn location(self) -> MemoryLocation {
        match self {
            Self::Device => MemoryLocation::GpuOnly,
            Self::Upload => MemoryLocation::CpuToGpu,
            // That of read-backs is never device memory; that of uploads may be.
            Self::Readback | Self::DeviceOnHost => MemoryLocation::GpuToCpu,
        }
    }

    fn counts(self) -> bool {
        self != Self::DeviceOnHost
    }
}

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
            missing: 0,
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
        memory_use: MemoryUse,
    ) -> Result<Allocation, GpuError> {
        let bytes = requirements.size;
        let fail = |missing: u64, reason: String| GpuError::OutOfMemory { name: name.into(), bytes, missing, reason };
        let mut allocator = self.allocator.lock().map_err(|_| fail(0, "the allocator is poisoned".into()))?;
        let (used, budget) = (self.current_bytes.load(Ordering::Relaxed), self.budget_bytes.load(Ordering::Relaxed));
        let needed = used.saturating_add(bytes);
        if memory_use.counts() && needed > budget {
            let reason = format!("the budget is {}, and {}", readable(budget), uses(&allocator, used));
            return Err(fail(needed - budget, reason));
        }
        let allocation = allocator
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location: memory_use.location(),
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(|e| e.to_string());
        let allocation = allocation.map_err(|e| fail(bytes, format!("{e}, and {}", uses(&allocator, used))))?;
        if memory_use.counts() {
            let now = self.current_bytes.fetch_add(allocation.size(), Ordering::Relaxed) + allocation.size();
            self.peak_bytes.fetch_max(now, Ordering::Relaxed);
        }
        Ok(allocation)
    }

    /// Frees an allocation that was made for the same use.
    pub(crate) fn free(&self, allocation: Allocation, memory_use: MemoryUse) {
        if memory_use.counts() {
            self.current_bytes.fetch_sub(allocation.size(), Ordering::Relaxed);
        }
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

/// Number of uses that an error names.
const NAMED: usize = 4;

/// What memory is used for, the largest uses first.
fn uses(allocator: &Allocator, used: u64) -> String {
    let live = allocator.generate_report().allocations;
    described(used, live.iter().map(|allocation| (allocation.name.as_str(), allocation.size)))
}

/// The text of [`uses`], of names and bytes of all allocations.
fn described<'a>(used: u64, allocations: impl Iterator<Item = (&'a str, u64)>) -> String {
    let mut by_name: BTreeMap<&str, (u64, usize)> = BTreeMap::new();
    for (name, bytes) in allocations {
        let (total, count) = by_name.entry(name).or_default();
        *total += bytes;
        *count += 1;
    }
    let mut largest: Vec<_> = by_name.into_iter().collect();
    largest.sort_by_key(|(_, (bytes, _))| std::cmp::Reverse(*bytes));
    let one = |(name, (bytes, count)): &(&str, (u64, usize))| {
        let times = if *count > 1 { format!("{count} times ") } else { String::new() };
        format!("{times}{name}: {}", readable(*bytes))
    };
    let named: Vec<String> = largest.iter().take(NAMED).map(one).collect();
    let more = largest.len().saturating_sub(NAMED);
    match (named.is_empty(), more) {
        (true, _) => "nothing is in use".into(),
        (false, 0) => format!("{} are in use ({})", readable(used), named.join("; ")),
        (false, _) => format!("{} are in use ({}; {more} smaller uses)", readable(used), named.join("; ")),
    }
}

fn readable(bytes: u64) -> String {
    let (unit, name) = if bytes < 1 << 20 { (1 << 10, "KiB") } else { (1 << 20, "MiB") };
    format!("{:.1} {name}", bytes as f64 / f64::from(unit))
}

#[cfg(test)]
mod tests {
    use super::described;

    #[test]
    fn the_largest_uses_are_named() {
        let mib = |n: u64| n << 20;
        let two = [("pictures", mib(1)), ("keys", mib(5)), ("pictures", mib(6))];
        assert_eq!(
            described(mib(12), two.into_iter()),
            "12.0 MiB are in use (2 times pictures: 7.0 MiB; keys: 5.0 MiB)"
        );
        let many = ["a", "b", "c", "d", "e", "f"].into_iter().zip((1..=6).map(mib));
        let text = described(mib(21), many);
        assert_eq!(text, "21.0 MiB are in use (f: 6.0 MiB; e: 5.0 MiB; d: 4.0 MiB; c: 3.0 MiB; 2 smaller uses)");
        assert_eq!(described(512, [("moments, all", 512)].into_iter()), "0.5 KiB are in use (moments, all: 0.5 KiB)");
        assert_eq!(described(0, [].into_iter()), "nothing is in use");
    }
}
