//! Required features and extensions, and devices that are created or supplied with them.

use std::ffi::CStr;

use ash::{khr, vk};

use super::address_space::check_address_space;
use super::caps::DeviceCaps;
use super::context::{GpuOptions, QueueLock};
use super::error::GpuError;

/// A device of the caller's for [`Gpu::from_raw`](super::Gpu::from_raw), which lists the requirements.
#[derive(Clone)]
pub struct RawDevice {
    /// The loader that the instance was created with.
    pub entry: ash::Entry,
    /// An instance for Vulkan 1.3 or later.
    pub instance: ash::Instance,
    /// The physical device that `device` was created from.
    pub physical: vk::PhysicalDevice,
    /// The device, with the required features and extensions enabled.
    pub device: ash::Device,
    /// The queue to submit to.
    pub queue: vk::Queue,
    /// Family index of the queue; the family supports compute.
    pub queue_family: u32,
    /// Guards the queue against other users; `None` if the caller serialises access by other means.
    pub queue_lock: Option<QueueLock>,
}

/// Feature structs in which exactly what this crate needs is set. Chain both into a `vk::DeviceCreateInfo`, or set the
/// same members in structs of your own.
#[derive(Clone, Copy, Debug)]
pub struct RequiredFeatures {
    /// `timelineSemaphore`, `scalarBlockLayout`, `hostQueryReset`.
    pub v12: vk::PhysicalDeviceVulkan12Features<'static>,
    /// `synchronization2`, `maintenance4`, `subgroupSizeControl`, `computeFullSubgroups`.
    pub v13: vk::PhysicalDeviceVulkan13Features<'static>,
}

impl RawDevice {
    /// The features that the device must have been created with. Nothing of Vulkan 1.0 or 1.1 is needed.
    pub fn required_features() -> RequiredFeatures {
        RequiredFeatures {
            v12: vk::PhysicalDeviceVulkan12Features::default()
                .timeline_semaphore(true)
                .scalar_block_layout(true)
                .host_query_reset(true),
            v13: vk::PhysicalDeviceVulkan13Features::default()
                .synchronization2(true)
                .maintenance4(true)
                .subgroup_size_control(true)
                .compute_full_subgroups(true),
        }
    }

    /// The device extensions that the device must have been created with: none, except `VK_KHR_portability_subset` on a
    /// device that offers it, where Vulkan itself demands it.
    ///
    /// # Errors
    /// The driver does not list its extensions.
    ///
    /// # Safety
    /// `physical` is of `instance`.
    pub unsafe fn required_extensions(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
    ) -> Result<Vec<&'static CStr>, GpuError> {
        let portable = has_extension(&device_extensions(instance, physical)?, khr::portability_subset::NAME);
        Ok(portable.then_some(khr::portability_subset::NAME).into_iter().collect())
    }
}

/// A device of this crate's own with one queue, destroyed on drop.
pub(super) struct OwnedDevice {
    pub(super) device: ash::Device,
    pub(super) queue_family: u32,
    pub(super) timestamp_bits: u32,
}

impl OwnedDevice {
    /// Creates a device with a queue for compute and, if `options` have a display to show pictures on, for graphics.
    pub(super) fn new(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        caps: &DeviceCaps,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        check_address_space(caps)?;
        check_features(instance, physical, caps)?;
        let shows = options.display.is_some();
        if shows {
            check_shows(instance, physical, caps)?;
        }
        if options.pipeline_statistics {
            check_statistics(instance, physical, caps)?;
        }
        let families = queue_family_properties(instance, physical);
        // The user interface is drawn by a graphics pipeline.
        let graphics = if shows { vk::QueueFlags::GRAPHICS } else { vk::QueueFlags::empty() };
        let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE | graphics));
        let Some(family) = family else {
            let feature = "a compute queue".into();
            return Err(GpuError::MissingFeature { device: caps.name.clone(), feature });
        };
        let (timestamp_bits, queue_family) = (families[family].timestamp_valid_bits, family as u32);
        let priorities = [1.0];
        let queues =
            [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&priorities)];
        let RequiredFeatures { mut v12, v13 } = RawDevice::required_features();
        let mut v13 = v13.dynamic_rendering(shows);
        // SAFETY: `physical` comes from `instance`.
        let mut extensions = unsafe { RawDevice::required_extensions(instance, physical) }?;
        if shows {
            extensions.push(khr::swapchain::NAME);
        }
        let mut executables =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        if options.pipeline_statistics {
            extensions.push(khr::pipeline_executable_properties::NAME);
        }
        let extensions: Vec<_> = extensions.into_iter().map(CStr::as_ptr).collect();
        let mut info = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .push_next(&mut v12)
            .push_next(&mut v13);
        if options.pipeline_statistics {
            info = info.push_next(&mut executables);
        }
        // SAFETY: features were checked, pointers live through the call.
        let device = unsafe { instance.create_device(physical, &info, None) }.map_err(GpuError::vulkan("device"))?;
        Ok(Self { device, queue_family, timestamp_bits })
    }
}

impl Drop for OwnedDevice {
    fn drop(&mut self) {
        // SAFETY: owners drop what was made from the device first; after the wait it is idle (or lost, when destruction is
        // allowed too).
        unsafe {
            let _ = self.device.device_wait_idle();
            self.device.destroy_device(None);
        }
    }
}

/// Properties of the queue families of a device.
pub(super) fn queue_family_properties(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
) -> Vec<vk::QueueFamilyProperties> {
    // SAFETY: `physical` comes from `instance`.
    unsafe { instance.get_physical_device_queue_family_properties(physical) }
}

fn device_extensions(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
) -> Result<Vec<vk::ExtensionProperties>, GpuError> {
    // SAFETY: `physical` comes from `instance`.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
    extensions.map_err(GpuError::vulkan("listing device extensions"))
}

/// True if the list of extensions contains `name`.
pub(super) fn has_extension(offered: &[vk::ExtensionProperties], name: &CStr) -> bool {
    offered.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
}

/// Fails if the device cannot show pictures in windows.
fn check_shows(instance: &ash::Instance, physical: vk::PhysicalDevice, caps: &DeviceCaps) -> Result<(), GpuError> {
    let extensions = device_extensions(instance, physical)?;
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut v13);
    // SAFETY: `physical` comes from `instance`; the chain holds a Vulkan 1.3 struct.
    unsafe { instance.get_physical_device_features2(physical, &mut features) };
    let missing = |feature: &str| Err(GpuError::MissingFeature { device: caps.name.clone(), feature: feature.into() });
    if !has_extension(&extensions, khr::swapchain::NAME) {
        return missing("VK_KHR_swapchain (pictures in windows)");
    }
    if v13.dynamic_rendering == 0 { missing("dynamicRendering") } else { Ok(()) }
}

/// Fails if the driver does not say what it makes of pipelines.
fn check_statistics(instance: &ash::Instance, physical: vk::PhysicalDevice, caps: &DeviceCaps) -> Result<(), GpuError> {
    if has_extension(&device_extensions(instance, physical)?, khr::pipeline_executable_properties::NAME) {
        return Ok(());
    }
    let feature = "VK_KHR_pipeline_executable_properties (the driver's statistics of kernels)".into();
    Err(GpuError::MissingFeature { device: caps.name.clone(), feature })
}

/// Fails with the name of the first required feature that is missing.
pub(super) fn check_features(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    caps: &DeviceCaps,
) -> Result<(), GpuError> {
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut v12).push_next(&mut v13);
    // SAFETY: `physical` comes from `instance`, the chain holds Vulkan 1.3 structs.
    unsafe { instance.get_physical_device_features2(physical, &mut features) };
    let mut v11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut v11);
    // SAFETY: as above.
    unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
    let operations = v11.subgroup_supported_operations;
    let needed_operations = vk::SubgroupFeatureFlags::BASIC
        | vk::SubgroupFeatureFlags::VOTE
        | vk::SubgroupFeatureFlags::BALLOT
        | vk::SubgroupFeatureFlags::SHUFFLE;
    for (present, feature) in [
        (v12.timeline_semaphore, "timelineSemaphore"),
        (v12.scalar_block_layout, "scalarBlockLayout"),
        (v12.host_query_reset, "hostQueryReset"),
        (v13.synchronization2, "synchronization2"),
        (v13.maintenance4, "maintenance4"),
        (v13.subgroup_size_control, "subgroupSizeControl"),
        (v13.compute_full_subgroups, "computeFullSubgroups"),
        (u32::from(operations.contains(needed_operations)), "subgroup vote, ballot and shuffle"),
        (u32::from(v11.subgroup_supported_stages.contains(vk::ShaderStageFlags::COMPUTE)), "subgroups in compute"),
        (u32::from(!caps.subgroup_sizes().is_empty()), "a subgroup size of 4, 8, 16, 32 or 64"),
    ] {
        if present == 0 {
            return Err(GpuError::MissingFeature { device: caps.name.clone(), feature: feature.into() });
        }
    }
    Ok(())
}
