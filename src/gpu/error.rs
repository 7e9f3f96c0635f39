//! Errors of the Vulkan layer, one line each, naming the object at fault and what to do.

use ash::vk;

/// What can go wrong between us and the Vulkan device.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No Vulkan loader library.
    #[error("cannot load Vulkan ({0}); install the Vulkan loader (libvulkan1) and a driver, or run tools/setup")]
    NoLoader(String),
    /// No device, or none that matches the choice.
    #[error("no Vulkan device {wanted}; found: {found}")]
    NoDevice {
        /// What was asked for.
        wanted: String,
        /// Names of the devices there are.
        found: String,
    },
    /// The device lacks something this program needs.
    #[error("device {device} lacks {feature}, which this program needs; choose another device with --device")]
    MissingFeature {
        /// Device name.
        device: String,
        /// The feature, extension or limit.
        feature: String,
    },
    /// A Vulkan call failed.
    #[error("{what}: Vulkan returned {result}")]
    Vulkan {
        /// The object or call.
        what: String,
        /// Vulkan's code.
        result: vk::Result,
    },
    /// A buffer larger than one storage binding may be.
    #[error(
        "buffer {name} needs {bytes} bytes, but this device binds at most {limit} (maxStorageBufferRange); \
         render fewer Gaussians or a smaller image, or use a device with a larger limit"
    )]
    BufferTooLarge {
        /// Buffer name.
        name: String,
        /// Bytes asked for.
        bytes: u64,
        /// The device's limit.
        limit: u64,
    },
    /// Device memory is exhausted.
    #[error("out of device memory for {name} ({bytes} bytes): {reason}; render fewer Gaussians or a smaller image")]
    OutOfMemory {
        /// Buffer name.
        name: String,
        /// Bytes asked for.
        bytes: u64,
        /// The allocator's words.
        reason: String,
    },
    /// A kernel that uses more storage buffers than the device lets a stage use.
    #[error(
        "kernel {kernel} uses {needed} storage buffers, but {device} has at most {limit} \
         (maxPerStageDescriptorStorageBuffers); choose another device with --device"
    )]
    TooManyBindings {
        /// Kernel stem.
        kernel: String,
        /// Storage buffers it uses.
        needed: u32,
        /// The device's limit.
        limit: u32,
        /// Device name.
        device: String,
    },
    /// A lock of the caller's did not do its part.
    #[error("the caller's queue lock returned without running what it was given")]
    QueueLock,
    /// Something was recorded that this device cannot run.
    #[error("recording {pass}: {reason}")]
    Recording {
        /// Stem of the pass, or the command.
        pass: String,
        /// What is wrong.
        reason: String,
    },
    /// The device was lost.
    #[error("the device was lost; what was begun last: {last_pass}")]
    DeviceLost {
        /// Stem of the pass, or what the host was doing.
        last_pass: String,
    },
    /// A spec constant that the shader does not declare, or the like.
    #[error("kernel {kernel}: {reason}")]
    Kernel {
        /// Kernel stem.
        kernel: String,
        /// What is wrong.
        reason: String,
    },
    /// The start-up self-test found a wrong result.
    #[error("self-test of {what} failed on {device} with subgroup size {subgroup_size}: {reason}")]
    SelfTest {
        /// What was tested.
        what: String,
        /// Device name.
        device: String,
        /// Subgroup size of the variant.
        subgroup_size: u32,
        /// The difference found.
        reason: String,
    },
}

impl GpuError {
    /// Wraps a Vulkan result code with the name of the object or call; a lost device is one wherever it shows.
    pub fn vulkan(what: &str) -> impl FnOnce(vk::Result) -> GpuError {
        move |result| match result {
            vk::Result::ERROR_DEVICE_LOST => GpuError::DeviceLost { last_pass: what.into() },
            result => GpuError::Vulkan { what: what.into(), result },
        }
    }

    /// The device has no room for what was asked of it, but goes on.
    pub fn is_out_of_memory(&self) -> bool {
        matches!(self, Self::OutOfMemory { .. } | Self::BufferTooLarge { .. })
    }

    /// The device, or the surface of a window, is gone for good.
    pub fn is_lost(&self) -> bool {
        let surface = vk::Result::ERROR_SURFACE_LOST_KHR;
        matches!(self, Self::DeviceLost { .. }) || matches!(self, Self::Vulkan { result, .. } if *result == surface)
    }
}
