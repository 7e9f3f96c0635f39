//! Properties of a device, read once.

use std::ffi::CStr;

use ash::vk;

use super::tuning::Tuning;

/// Limits and features of one device that kernels and plans depend on.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct DeviceCaps {
    /// Device name as the driver gives it.
    pub name: String,
    /// Driver name and version text.
    pub driver: String,
    /// Vulkan version, for instance "1.3.230".
    pub api_version: String,
    /// Discrete, integrated, virtual, cpu or other.
    pub device_type: &'static str,
    /// Smallest subgroup size a compute pipeline can require.
    pub min_subgroup_size: u32,
    /// Largest subgroup size a compute pipeline can require.
    pub max_subgroup_size: u32,
    /// Subgroup size of a pipeline that requires none.
    pub default_subgroup_size: u32,
    /// Whether a compute pipeline may require a subgroup size at all.
    pub can_require_subgroup_size: bool,
    /// Largest number of subgroups in a work-group with a required size.
    pub max_workgroup_subgroups: u32,
    /// Largest number of invocations in a work-group.
    pub max_workgroup_invocations: u32,
    /// Work-group shared memory, bytes.
    pub shared_memory_bytes: u32,
    /// Largest storage-buffer binding, bytes; a multiple of 32.
    pub max_storage_bytes: u64,
    /// Largest buffer, bytes; a multiple of 32. Kernels see one that is larger than a binding in parts (`BufferPart`).
    pub max_buffer_bytes: u64,
    /// Largest work-group count along one dimension.
    pub max_workgroup_count: u32,
    /// Largest number of storage buffers that one kernel may use.
    pub max_storage_buffers: u32,
    /// Nanoseconds per timestamp tick.
    pub timestamp_period_ns: f32,
    /// True for GPUs of Intel's.
    pub is_intel: bool,
    /// True for llvmpipe (lavapipe), Mesa's CPU driver.
    pub is_llvmpipe: bool,
    /// Number of loop iterations after which the driver silently ends the loops of a shader invocation; `None` = no
    /// such limit. Mesa's gallivm counts down from 65535 over all loops of a function.
    pub loop_iteration_limit: Option<u32>,
    /// Numbers that replace those that are picked for the device; empty but for measurements.
    pub tuning: Tuning,
}

/// gallivm's limit (`LP_MAX_TGSI_LOOP_ITERATIONS`, still there in Mesa 22.3 for compute shaders).
const LLVMPIPE_LOOP_LIMIT: u32 = 65535;

/// PCI vendor of Intel's devices.
const INTEL_VENDOR_ID: u32 = 0x8086;

impl DeviceCaps {
    /// Reads the properties of a physical device.
    pub(crate) fn read(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Self {
        let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
        let mut v12 = vk::PhysicalDeviceVulkan12Properties::default();
        let mut v13 = vk::PhysicalDeviceVulkan13Properties::default();
        let mut properties =
            vk::PhysicalDeviceProperties2::default().push_next(&mut v11).push_next(&mut v12).push_next(&mut v13);
        // SAFETY: `physical` comes from `instance`; the chain holds only structs of Vulkan 1.3, which callers have checked.
        unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
        let core = properties.properties;
        let text = |raw: &[std::ffi::c_char]| {
            let bytes: Vec<u8> = raw.iter().map(|&c| c.cast_unsigned()).collect();
            CStr::from_bytes_until_nul(&bytes).map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
        };
        let version = core.api_version;
        // Both are at least 1 GiB. Buffers are padded to multiples of 32 bytes.
        let max_buffer_bytes = v13.max_buffer_size.min(v11.max_memory_allocation_size) / 32 * 32;
        let is_llvmpipe = v12.driver_id == vk::DriverId::MESA_LLVMPIPE;
        Self {
            name: text(&core.device_name),
            driver: format!("{} {}", text(&v12.driver_name), text(&v12.driver_info)),
            api_version: format!(
                "{}.{}.{}",
                vk::api_version_major(version),
                vk::api_version_minor(version),
                vk::api_version_patch(version)
            ),
            device_type: device_type_name(core.device_type),
            min_subgroup_size: v13.min_subgroup_size.max(1),
            max_subgroup_size: v13.max_subgroup_size.max(v11.subgroup_size),
            default_subgroup_size: v11.subgroup_size,
            can_require_subgroup_size: v13.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE),
            max_workgroup_subgroups: v13.max_compute_workgroup_subgroups,
            max_workgroup_invocations: core
                .limits
                .max_compute_work_group_invocations
                .min(core.limits.max_compute_work_group_size[0]),
            shared_memory_bytes: core.limits.max_compute_shared_memory_size,
            // What is bound whole is a buffer in an allocation, too.
            max_storage_bytes: u64::from(core.limits.max_storage_buffer_range).min(max_buffer_bytes) / 32 * 32,
            max_buffer_bytes,
            max_workgroup_count: core.limits.max_compute_work_group_count[0]
                .min(core.limits.max_compute_work_group_count[1]),
            max_storage_buffers: core.limits.max_per_stage_descriptor_storage_buffers,
            timestamp_period_ns: core.limits.timestamp_period,
            is_intel: core.vendor_id == INTEL_VENDOR_ID,
            is_llvmpipe,
            loop_iteration_limit: is_llvmpipe.then_some(LLVMPIPE_LOOP_LIMIT),
            tuning: Tuning::default(),
        }
    }

    /// The subgroup sizes among 4, 8, 16, 32, 64 that kernels can be made for: all in the range if a size can be required,
    /// else the one that the driver uses.
    pub fn subgroup_sizes(&self) -> Vec<u32> {
        let range = match self.can_require_subgroup_size {
            true => self.min_subgroup_size..=self.max_subgroup_size,
            false => self.default_subgroup_size..=self.default_subgroup_size,
        };
        [4, 8, 16, 32, 64].into_iter().filter(|s| range.contains(s)).collect()
    }
}

fn device_type_name(kind: vk::PhysicalDeviceType) -> &'static str {
    match kind {
        vk::PhysicalDeviceType::DISCRETE_GPU => "discrete",
        vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated",
        vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual",
        vk::PhysicalDeviceType::CPU => "cpu",
        _ => "other",
    }
}
