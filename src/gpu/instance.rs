//! A Vulkan instance of this crate's own, and its devices.

use std::ffi::CStr;

use ash::{ext, khr, vk};

use super::caps::DeviceCaps;
use super::context::{DeviceChoice, GpuOptions};
use super::device::has_extension;
use super::error::GpuError;
use super::validation::ValidationMessages;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// A Vulkan instance, destroyed on drop.
pub(super) struct OwnedInstance {
    pub(super) instance: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// The list that the messenger writes to; instance and messenger hold its address.
    messages: ValidationMessages,
    /// Keeps the Vulkan loader library loaded.
    pub(super) entry: ash::Entry,
}

impl OwnedInstance {
    /// Creates an instance, with the validation layers if `options` ask for them; their messages go to `messages`.
    pub(super) fn new(options: &GpuOptions, messages: &ValidationMessages) -> Result<Self, GpuError> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers; it is kept loaded for the life of `Entry`.
        let entry = unsafe { ash::Entry::load() }.map_err(|e| GpuError::NoLoader(e.to_string()))?;
        let instance = create_instance(&entry, options, messages)?;
        let mut owned = Self { instance, messenger: None, messages: messages.clone(), entry };
        if options.validation {
            let debug = ext::debug_utils::Instance::new(&owned.entry, &owned.instance);
            // SAFETY: the extension is enabled, and `owned` keeps the messages until it has destroyed the messenger.
            let messenger = unsafe { debug.create_debug_utils_messenger(&messages.messenger_info(), None) }
                .map_err(GpuError::vulkan("debug messenger"))?;
            owned.messenger = Some((debug, messenger));
        }
        Ok(owned)
    }

    /// Messages of the validation layers.
    pub(super) fn messages(&self) -> ValidationMessages {
        self.messages.clone()
    }
}

impl Drop for OwnedInstance {
    fn drop(&mut self) {
        // SAFETY: owners drop what was made from the instance first; each object is destroyed once, children before parents.
        unsafe {
            if let Some((debug, messenger)) = &self.messenger {
                debug.destroy_debug_utils_messenger(*messenger, None);
            }
            self.instance.destroy_instance(None);
        }
    }
}

fn create_instance(
    entry: &ash::Entry,
    options: &GpuOptions,
    messages: &ValidationMessages,
) -> Result<ash::Instance, GpuError> {
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
    // Without it, loaders hide devices that lack parts of Vulkan, such as MoltenVK's; none of these parts is needed.
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
    unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
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
    })
}

/// The devices with Vulkan 1.3 or later, in the driver's order.
pub(super) fn enumerate(instance: &ash::Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceCaps)>, GpuError> {
    // SAFETY: the instance is valid.
    let devices = unsafe { instance.enumerate_physical_devices() }.map_err(GpuError::vulkan("listing devices"))?;
    let supported = devices.into_iter().filter(|&device| {
        // SAFETY: the device comes from this instance.
        let version = unsafe { instance.get_physical_device_properties(device) }.api_version;
        vk::api_version_major(version) > 1 || vk::api_version_minor(version) >= 3
    });
    Ok(supported.map(|device| (device, DeviceCaps::read(instance, device))).collect())
}

/// Selects the device that the options ask for.
pub(super) fn choose_device(
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
