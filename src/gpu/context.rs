//! Instance, device, queue: everything that lives as long as the program's use of the device.

use std::ffi::{CStr, CString};
use std::sync::{Arc, Mutex};

use ash::{ext, khr, vk};
use raw_window_handle::RawDisplayHandle;

use super::caps::DeviceCaps;
use super::error::GpuError;
use super::interface::ALL_SHADERS;
use super::memory::Memory;
use super::pipeline::PipelineStore;
use super::timeline::{SubmissionCounts, Ticket, Timeline};
use super::validation::ValidationMessages;

/// Which device to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first discrete device, else integrated, virtual, CPU.
    #[default]
    Best,
    /// Position in the list that `instgs-vk info` prints.
    Index(usize),
    /// Part of the device's name, case-insensitive.
    Name(String),
}

impl std::str::FromStr for DeviceChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Name(text.into()), Self::Index))
    }
}

/// How to open the device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Which device.
    pub device: DeviceChoice,
    /// Load the validation layers with synchronization validation; an error if they are not installed.
    pub validation: bool,
    /// The display whose windows the device is to draw into; without one it draws into buffers only.
    pub display: Option<RawDisplayHandle>,
    /// Behave as a device whose bindings have at most this many bytes would, to see what becomes of large scenes there.
    pub most_binding_bytes: Option<u64>,
}

/// The open device. Shared by everything that allocates or submits.
pub struct Gpu {
    pub(crate) device: ash::Device,
    pub(crate) queue: Mutex<vk::Queue>,
    pub(crate) queue_family: u32,
    /// Bits of a timestamp that count; 0 = the queue has none.
    pub(crate) timestamp_bits: u32,
    pub(crate) memory: Memory,
    pub(crate) timeline: Timeline,
    pub(super) pipelines: PipelineStore,
    pub(crate) debug_names: Option<ext::debug_utils::Device>,
    caps: DeviceCaps,
    pub(super) instance: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: ValidationMessages,
    pub(super) physical: vk::PhysicalDevice,
    /// Keeps the loader library loaded.
    #[cfg_attr(not(feature = "player"), allow(dead_code, reason = "only windows ask it for anything"))]
    pub(super) entry: ash::Entry,
}

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

impl Gpu {
    /// Opens a device.
    ///
    /// # Errors
    /// No loader, no matching device, a missing feature, or no validation layer where it was asked for.
    pub fn open(options: &GpuOptions) -> Result<Arc<Self>, GpuError> {
        let messages = ValidationMessages::default();
        let (entry, instance) = create_instance(options, &messages)?;
        let messenger = options.validation.then(|| create_messenger(&entry, &instance, &messages)).transpose()?;
        let (physical, mut caps) = choose_device(&instance, &options.device)?;
        caps.max_storage_bytes = caps.max_storage_bytes.min(options.most_binding_bytes.unwrap_or(u64::MAX));
        let (device, queue_family, timestamp_bits) =
            create_device(&instance, physical, &caps, options.display.is_some())?;
        // SAFETY: the family was requested with one queue at device creation.
        let queue = unsafe { device.get_device_queue(queue_family, 0) };
        let debug_names = options.validation.then(|| ext::debug_utils::Device::new(&instance, &device));
        let memory = Memory::new(&instance, &device, physical)?;
        let timeline = Timeline::new(&device)?;
        Ok(Arc::new(Self {
            device,
            queue: Mutex::new(queue),
            queue_family,
            timestamp_bits,
            memory,
            timeline,
            pipelines: PipelineStore::default(),
            debug_names,
            caps,
            instance,
            messenger,
            messages,
            physical,
            entry,
        }))
    }

    /// What all devices of this machine offer, in the order of `DeviceChoice::Index`.
    pub fn list() -> Result<Vec<DeviceCaps>, GpuError> {
        let (_entry, instance) = create_instance(&GpuOptions::default(), &ValidationMessages::default())?;
        let devices = enumerate(&instance);
        // SAFETY: nothing was created from the instance.
        unsafe { instance.destroy_instance(None) };
        Ok(devices?.into_iter().map(|(_, caps)| caps).collect())
    }

    /// Limits and features.
    pub fn caps(&self) -> &DeviceCaps {
        &self.caps
    }

    /// Messages of the validation layers so far (empty unless opened with validation).
    pub fn validation_messages(&self) -> &ValidationMessages {
        &self.messages
    }

    /// Device memory in bytes: allocated now, and the peak since the last `reset_memory_peak`.
    pub fn memory_usage(&self) -> (u64, u64) {
        self.memory.usage()
    }

    /// Starts a new peak measurement.
    pub fn reset_memory_peak(&self) {
        self.memory.reset_peak();
    }

    /// Limits what may be allocated in all, bytes; what is there already counts. `u64::MAX` = no limit but the device's.
    pub fn set_memory_budget(&self, bytes: u64) {
        self.memory.set_budget(bytes);
    }

    /// The smaller of the limit that was set and the largest device-local heap, bytes.
    pub fn memory_budget(&self) -> u64 {
        self.memory.budget().min(self.device_heap_bytes())
    }

    /// Bytes of the largest device-local heap.
    pub fn device_heap_bytes(&self) -> u64 {
        // SAFETY: `physical` belongs to `instance`.
        let properties = unsafe { self.instance.get_physical_device_memory_properties(self.physical) };
        let heaps = &properties.memory_heaps[..properties.memory_heap_count as usize];
        heaps.iter().filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL)).map(|h| h.size).max().unwrap_or(0)
    }

    /// Submissions and host waits since the device was opened.
    pub fn submission_counts(&self) -> SubmissionCounts {
        self.timeline.counts()
    }

    /// Blocks until a submission has finished.
    pub fn wait(&self, ticket: Ticket) -> Result<(), GpuError> {
        self.timeline.wait(&self.device, ticket).map_err(GpuError::vulkan("waiting for the device"))
    }

    /// Blocks until everything submitted has finished.
    pub fn wait_all(&self) -> Result<(), GpuError> {
        self.wait(self.timeline.last())
    }

    /// Names a Vulkan object for debuggers and validation messages.
    pub(crate) fn set_name<H: vk::Handle>(&self, object: H, name: &str) {
        let (Some(debug), Ok(name)) = (&self.debug_names, CString::new(name)) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the object was created from this device. A failure to name it is of no consequence.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // SAFETY: buffers, pipelines and recorders hold an Arc of self, so none is left; the device is idle after the
        // wait (or lost, when destruction is allowed too). Each object is destroyed once, children before parents.
        unsafe {
            let _ = self.device.device_wait_idle();
            self.pipelines.destroy(&self.device);
            self.device.destroy_semaphore(self.timeline.semaphore, None);
            self.memory.destroy();
            self.device.destroy_device(None);
            if let Some((debug, messenger)) = &self.messenger {
                debug.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

fn create_instance(
    options: &GpuOptions,
    messages: &ValidationMessages,
) -> Result<(ash::Entry, ash::Instance), GpuError> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers; it is kept loaded for the life of `Entry`.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| GpuError::NoLoader(e.to_string()))?;
    let app = vk::ApplicationInfo::default().application_name(c"instgs-vk").api_version(vk::API_VERSION_1_3);
    let layers = [VALIDATION_LAYER.as_ptr()];
    let mut extensions = match options.display {
        Some(display) => ash_window::enumerate_required_extensions(display)
            .map_err(GpuError::vulkan("extensions for windows of this display"))?
            .to_vec(),
        None => Vec::new(),
    };
    if options.validation {
        extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    // Without it, loaders hide devices that lack corners of Vulkan, as MoltenVK's do; nothing here needs those.
    // SAFETY: the entry is loaded.
    let offered = unsafe { entry.enumerate_instance_extension_properties(None) };
    let offered = offered.map_err(GpuError::vulkan("listing instance extensions"))?;
    let portable = has_extension(&offered, khr::portability_enumeration::NAME);
    if portable {
        extensions.push(khr::portability_enumeration::NAME.as_ptr());
    }
    let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
    let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
    let mut messenger = messages.messenger_info();
    let mut info = vk::InstanceCreateInfo::default().application_info(&app).enabled_extension_names(&extensions);
    if portable {
        info = info.flags(vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR);
    }
    if options.validation {
        info = info.enabled_layer_names(&layers).push_next(&mut features).push_next(&mut messenger);
    }
    // SAFETY: all pointers in `info` live through the call.
    let instance = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
        vk::Result::ERROR_LAYER_NOT_PRESENT => GpuError::MissingFeature {
            device: "Vulkan loader".into(),
            feature: "the validation layer VK_LAYER_KHRONOS_validation (package vulkan-validationlayers)".into(),
        },
        vk::Result::ERROR_EXTENSION_NOT_PRESENT if options.display.is_some() => GpuError::MissingFeature {
            device: "Vulkan loader".into(),
            feature: "the extensions that show pictures in a window of this display".into(),
        },
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => GpuError::NoDevice {
            wanted: "with any driver (install one, for instance mesa-vulkan-drivers)".into(),
            found: "none".into(),
        },
        result => GpuError::Vulkan { what: "instance".into(), result },
    })?;
    Ok((entry, instance))
}

fn create_messenger(
    entry: &ash::Entry,
    instance: &ash::Instance,
    messages: &ValidationMessages,
) -> Result<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT), GpuError> {
    let debug = ext::debug_utils::Instance::new(entry, instance);
    // SAFETY: the extension is enabled, and `Gpu` keeps `messages` alive until it destroys the messenger.
    let messenger = unsafe { debug.create_debug_utils_messenger(&messages.messenger_info(), None) }
        .map_err(GpuError::vulkan("debug messenger"))?;
    Ok((debug, messenger))
}

fn enumerate(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceCaps)>, GpuError> {
    // SAFETY: the instance is valid.
    let devices = unsafe { instance.enumerate_physical_devices() }.map_err(GpuError::vulkan("listing devices"))?;
    let supported = devices.into_iter().filter(|&device| {
        // SAFETY: the device comes from this instance.
        let version = unsafe { instance.get_physical_device_properties(device) }.api_version;
        vk::api_version_major(version) > 1 || vk::api_version_minor(version) >= 3
    });
    Ok(supported.map(|device| (device, DeviceCaps::read(instance, device))).collect())
}

fn choose_device(
    instance: &ash::Instance,
    choice: &DeviceChoice,
) -> Result<(vk::PhysicalDevice, DeviceCaps), GpuError> {
    let devices = enumerate(instance)?;
    let names: Vec<String> = devices.iter().map(|(_, caps)| caps.name.clone()).collect();
    let rank = |caps: &DeviceCaps| match caps.device_type {
        "discrete" => 0,
        "integrated" => 1,
        "virtual" => 2,
        _ => 3,
    };
    let (wanted, found) = match choice {
        DeviceChoice::Best => ("with Vulkan 1.3".to_string(), devices.into_iter().min_by_key(|(_, caps)| rank(caps))),
        DeviceChoice::Index(index) => (format!("number {index}"), devices.into_iter().nth(*index)),
        DeviceChoice::Name(part) => {
            let part_lower = part.to_lowercase();
            let found = devices.into_iter().find(|(_, caps)| caps.name.to_lowercase().contains(&part_lower));
            (format!("named {part}"), found)
        }
    };
    found.ok_or_else(|| GpuError::NoDevice {
        wanted,
        found: if names.is_empty() { "none with Vulkan 1.3".into() } else { names.join(", ") },
    })
}

fn create_device(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    caps: &DeviceCaps,
    shows: bool,
) -> Result<(ash::Device, u32, u32), GpuError> {
    check_features(instance, physical, caps)?;
    if shows {
        check_shows(instance, physical, caps)?;
    }
    // SAFETY: `physical` comes from `instance`.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    // The user interface is drawn by a graphics pipeline.
    let graphics = if shows { vk::QueueFlags::GRAPHICS } else { vk::QueueFlags::empty() };
    let family = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE | graphics));
    let timestamp_bits = family.map_or(0, |f| families[f].timestamp_valid_bits);
    let family = family
        .ok_or_else(|| GpuError::MissingFeature { device: caps.name.clone(), feature: "a compute queue".into() })?
        as u32;
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
    let mut v12 = vk::PhysicalDeviceVulkan12Features::default()
        .timeline_semaphore(true)
        .scalar_block_layout(true)
        .host_query_reset(true);
    let mut v13 = vk::PhysicalDeviceVulkan13Features::default()
        .synchronization2(true)
        .maintenance4(true)
        .subgroup_size_control(true)
        .compute_full_subgroups(true)
        .dynamic_rendering(shows);
    let mut extensions = Vec::new();
    if shows {
        extensions.push(khr::swapchain::NAME.as_ptr());
    }
    // A device that offers it must have it enabled.
    if has_extension(&device_extensions(instance, physical)?, khr::portability_subset::NAME) {
        extensions.push(khr::portability_subset::NAME.as_ptr());
    }
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .push_next(&mut v12)
        .push_next(&mut v13);
    // SAFETY: features were checked, pointers live through the call.
    let device = unsafe { instance.create_device(physical, &info, None) }.map_err(GpuError::vulkan("device"))?;
    Ok((device, family, timestamp_bits))
}

fn device_extensions(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
) -> Result<Vec<vk::ExtensionProperties>, GpuError> {
    // SAFETY: `physical` comes from `instance`.
    let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
    extensions.map_err(GpuError::vulkan("listing device extensions"))
}

fn has_extension(offered: &[vk::ExtensionProperties], name: &CStr) -> bool {
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

/// Fails with the name of the first required feature that is missing.
fn check_features(instance: &ash::Instance, physical: vk::PhysicalDevice, caps: &DeviceCaps) -> Result<(), GpuError> {
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
    let most_bindings = ALL_SHADERS.iter().map(|shader| shader.bindings.len()).max().unwrap_or(0);
    let storage_buffers = format!("{most_bindings} storage buffers in one kernel");
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
        (u32::from(caps.max_storage_buffers as usize >= most_bindings), storage_buffers.as_str()),
        (u32::from(!caps.subgroup_sizes().is_empty()), "a subgroup size of 4, 8, 16, 32 or 64"),
    ] {
        if present == 0 {
            return Err(GpuError::MissingFeature { device: caps.name.clone(), feature: feature.into() });
        }
    }
    Ok(())
}
