//! Errors of the Vulkan layer, one line each, naming the object at fault and a remedy.

use ash::vk;

/// Vulkan's name of the largest binding.
pub const STORAGE_LIMIT: &str = "maxStorageBufferRange";
/// Vulkan's name of the largest buffer.
pub(super) const BUFFER_LIMIT: &str = "maxBufferSize or maxMemoryAllocationSize";

/// An error of the device layer or of Vulkan.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader library was not found.
    #[error("cannot load Vulkan ({0}); install the Vulkan loader (libvulkan1) and a driver, or run tools/setup")]
    NoLoader(String),
    /// No device, or none that matches the choice.
    #[error("no Vulkan device {wanted}; found: {found}")]
    NoDevice {
        /// The device that was asked for.
        wanted: String,
        /// Names of the devices that were found.
        found: String,
    },
    /// The process may use too little memory for the driver to live.
    #[error(
        "{device} needs {least_mib} MiB of address space, and this process may use {limit_mib} (ulimit -v); allow more"
    )]
    AddressSpace {
        /// Name of the device.
        device: String,
        /// What the process may use, MiB.
        limit_mib: u64,
        /// What it should be allowed at least, MiB.
        least_mib: u64,
    },
    /// The device lacks something this program needs.
    #[error("device {device} lacks {feature}, which this program needs; choose another device with --device")]
    MissingFeature {
        /// Device name as the driver gives it.
        device: String,
        /// The feature, extension or limit.
        feature: String,
    },
    /// A Vulkan call failed.
    #[error("{what}: Vulkan returned {result}")]
    Vulkan {
        /// The object or call that failed.
        what: String,
        /// Vulkan's result code.
        result: vk::Result,
    },
    /// A buffer larger than a storage binding, or a buffer at all, may be.
    #[error(
        "buffer {name} needs {bytes} bytes, but this device has a limit of {limit} ({limit_name}); \
         render fewer Gaussians or a smaller image, or use a device with a larger limit"
    )]
    BufferTooLarge {
        /// Name that the buffer was created with.
        name: String,
        /// Size of the buffer, bytes.
        bytes: u64,
        /// Largest binding of the device, or its largest buffer, bytes.
        limit: u64,
        /// Which of the two, as Vulkan calls it.
        limit_name: &'static str,
    },
    /// Device memory is exhausted.
    #[error("out of device memory for {name} ({bytes} bytes): {reason}; render fewer Gaussians or a smaller image")]
    OutOfMemory {
        /// Name that the buffer was created with.
        name: String,
        /// Size of the allocation, bytes.
        bytes: u64,
        /// Bytes by which the allocation exceeds the budget or the device's memory: `bytes`, less what is left of a budget.
        missing: u64,
        /// The budget, or the message of the allocator, and what memory is used for.
        reason: String,
    },
    /// A kernel uses more storage buffers than the device allows in one stage.
    #[error(
        "kernel {kernel} uses {needed} storage buffers, but {device} has at most {limit} \
         (maxPerStageDescriptorStorageBuffers); choose another device with --device"
    )]
    TooManyBindings {
        /// Stem of the kernel's file.
        kernel: String,
        /// Storage buffers that the kernel uses.
        needed: u32,
        /// Limit of the device on storage buffers.
        limit: u32,
        /// Device name as the driver gives it.
        device: String,
    },
    /// The caller's queue lock returned without calling its argument.
    #[error("the caller's queue lock returned without running what it was given")]
    QueueLock,
    /// A command was recorded that this device cannot run.
    #[error("recording {pass}: {reason}")]
    Recording {
        /// Stem of the pass, or name of the command.
        pass: String,
        /// Description of the problem.
        reason: String,
    },
    /// The tuning cannot be read, or does not fit the device.
    #[error("INSTGS_TUNING: {0}")]
    Tuning(String),
    /// The faults to plant cannot be read.
    #[error("{0}")]
    Faults(String),
    /// The device was lost.
    #[error("the device was lost; what was begun last: {last_pass}")]
    DeviceLost {
        /// Stem of the last pass begun, or what the host was doing.
        last_pass: String,
    },
    /// A kernel was used wrongly, such as with an undeclared spec constant.
    #[error("kernel {kernel}: {reason}")]
    Kernel {
        /// Stem of the kernel's file.
        kernel: String,
        /// Description of the problem.
        reason: String,
    },
    /// The start-up self-test found a wrong result.
    #[error(
        "self-test of {what} failed on {device} with subgroup size {subgroup_size}: {reason}; another version of the driver, or \
         another device (--device), may be right"
    )]
    SelfTest {
        /// Name of the test that failed.
        what: String,
        /// Device name as the driver gives it.
        device: String,
        /// Subgroup size of the variant.
        subgroup_size: u32,
        /// First difference from the expected result.
        reason: String,
    },
}

impl GpuError {
    /// Wraps a Vulkan result code with the name of the object or call; a lost device always becomes `DeviceLost`.
    pub fn vulkan(what: &str) -> impl FnOnce(vk::Result) -> GpuError {
        move |result| match result {
            vk::Result::ERROR_DEVICE_LOST => GpuError::DeviceLost { last_pass: what.into() },
            result => GpuError::Vulkan { what: what.into(), result },
        }
    }

    /// A buffer that should be host-visible is not.
    pub(crate) fn not_mapped(name: &str) -> Self {
        Self::OutOfMemory { name: name.into(), bytes: 0, missing: 0, reason: "no host-visible memory".into() }
    }

    /// True if an allocation failed for want of memory; the device itself can go on.
    pub fn is_out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. } | Self::BufferTooLarge { .. })
    }

    /// True if the device, or the surface of a window, is lost.
    pub fn is_lost(&self) -> bool {
        let surface = vk::Result::ERROR_SURFACE_LOST_KHR;
        matches!(self, Self::DeviceLost { .. }) || matches!(self, Self::Vulkan { result, .. } if *result == surface)
    }
}
