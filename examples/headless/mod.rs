//! A small Vulkan program without a window, in place of yours: a device, an image that the host can read, a command buffer.

use std::error::Error;
use std::ffi::CStr;

use ash::{Device, Entry, Instance, vk};
use instgs_vk::gpu::{ImageTarget, RawDevice, Signal};

/// Device and image. The instance is somebody else's.
pub(crate) struct Headless {
    pub(crate) raw: RawDevice,
    pub(crate) target: ImageTarget,
    pub(crate) commands: vk::CommandBuffer,
    memory: vk::DeviceMemory,
    pool: vk::CommandPool,
}

impl Headless {
    /// A device with what the renderer requires, and an image in linear tiling in host-visible memory.
    ///
    /// # Safety
    /// `physical` is of `instance`, which is for Vulkan 1.3 and outlives this.
    pub(crate) unsafe fn new(
        entry: &Entry,
        instance: &Instance,
        physical: vk::PhysicalDevice,
        size_px: [u32; 2],
        format: vk::Format,
    ) -> Result<Self, Box<dyn Error>> {
        // SAFETY: the handles are of one another, and every pointer lives through its call.
        unsafe {
            let families = instance.get_physical_device_queue_family_properties(physical);
            let computes = |f: &vk::QueueFamilyProperties| f.queue_flags.contains(vk::QueueFlags::COMPUTE);
            let queue_family = families.iter().position(computes).ok_or("no queue for compute")? as u32;
            let mut features = RawDevice::required_features();
            let extensions = RawDevice::required_extensions(instance, physical)?;
            let names: Vec<_> = extensions.into_iter().map(CStr::as_ptr).collect();
            let queues =
                [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&[1.0])];
            let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
            let info = info.push_next(&mut features.v12).push_next(&mut features.v13);
            let device = instance.create_device(physical, &info, None)?;
            let queue = device.get_device_queue(queue_family, 0);

            let (image, memory) = image(instance, physical, &device, size_px, format)?;
            let info = vk::CommandPoolCreateInfo::default().queue_family_index(queue_family);
            let pool = device.create_command_pool(&info, None)?;
            let info = vk::CommandBufferAllocateInfo::default().command_pool(pool).command_buffer_count(1);
            let commands = device.allocate_command_buffers(&info)?[0];
            // The layout in which the host may read.
            let target = ImageTarget { image, format, size_px, layout_after: vk::ImageLayout::GENERAL };
            let (entry, instance) = (entry.clone(), instance.clone());
            let raw = RawDevice { entry, instance, physical, device, queue, queue_family, queue_lock: None };
            Ok(Self { raw, target, commands, memory, pool })
        }
    }

    /// Starts the command buffer anew.
    ///
    /// # Safety
    /// The device is done with it.
    pub(crate) unsafe fn begin(&self) -> Result<vk::CommandBuffer, vk::Result> {
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the caller's promise.
        unsafe {
            self.raw.device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())?;
            self.raw.device.begin_command_buffer(self.commands, &info)?;
        }
        Ok(self.commands)
    }

    /// Ends the command buffer and submits it.
    ///
    /// # Safety
    /// It is being recorded, and nobody else uses the queue.
    pub(crate) unsafe fn submit(&self, signal: Signal) -> Result<(), vk::Result> {
        let commands = [vk::CommandBufferSubmitInfo::default().command_buffer(self.commands)];
        let signals = [vk::SemaphoreSubmitInfo::default()
            .semaphore(signal.semaphore)
            .value(signal.value)
            .stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)];
        let submit = [vk::SubmitInfo2::default().command_buffer_infos(&commands).signal_semaphore_infos(&signals)];
        // SAFETY: the caller's promise; the arrays live through the call.
        unsafe {
            self.raw.device.end_command_buffer(self.commands)?;
            self.raw.device.queue_submit2(self.raw.queue, &submit, vk::Fence::null())
        }
    }

    /// The image's bytes, four per pixel, row by row.
    ///
    /// # Safety
    /// A picture has been written to the image, and the device is done with it.
    pub(crate) unsafe fn bytes(&self) -> Result<Vec<u8>, vk::Result> {
        let device = &self.raw.device;
        let [width, height] = self.target.size_px.map(|side| side as usize);
        let part = vk::ImageSubresource::default().aspect_mask(vk::ImageAspectFlags::COLOR);
        // SAFETY: a linear image; the memory is host-visible, and the rows lie in it.
        unsafe {
            let layout = device.get_image_subresource_layout(self.target.image, part);
            let all = device.map_memory(self.memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())?;
            let first = all.cast::<u8>().add(layout.offset as usize);
            let row = |y: usize| std::slice::from_raw_parts(first.add(y * layout.row_pitch as usize), 4 * width);
            let bytes = (0..height).flat_map(row).copied().collect();
            device.unmap_memory(self.memory);
            Ok(bytes)
        }
    }

    /// Destroys image and device.
    ///
    /// # Safety
    /// Whatever else was made from the device is gone, and the device is idle.
    pub(crate) unsafe fn destroy(self) {
        // SAFETY: the caller's promise; each object is destroyed once.
        unsafe {
            self.raw.device.destroy_command_pool(self.pool, None);
            self.raw.device.destroy_image(self.target.image, None);
            self.raw.device.free_memory(self.memory, None);
            self.raw.device.destroy_device(None);
        }
    }
}

/// An image in linear tiling, and its memory.
///
/// # Safety
/// The handles are of one another.
unsafe fn image(
    instance: &Instance,
    physical: vk::PhysicalDevice,
    device: &Device,
    [width, height]: [u32; 2],
    format: vk::Format,
) -> Result<(vk::Image, vk::DeviceMemory), Box<dyn Error>> {
    let info = vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(format)
        .extent(vk::Extent3D { width, height, depth: 1 })
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::LINEAR)
        .usage(vk::ImageUsageFlags::TRANSFER_DST);
    // SAFETY: the caller's promise; every pointer lives through its call.
    unsafe {
        let image = device.create_image(&info, None)?;
        let needs = device.get_image_memory_requirements(image);
        let host = vk::MemoryPropertyFlags::HOST_VISIBLE | vk::MemoryPropertyFlags::HOST_COHERENT;
        let types = instance.get_physical_device_memory_properties(physical).memory_types;
        let fits = |&k: &usize| needs.memory_type_bits >> k & 1 == 1 && types[k].property_flags.contains(host);
        let memory_type = (0..types.len()).find(fits).ok_or("no host-visible memory for the image")? as u32;
        let info = vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(memory_type);
        let memory = device.allocate_memory(&info, None)?;
        device.bind_image_memory(image, memory, 0)?;
        Ok((image, memory))
    }
}
