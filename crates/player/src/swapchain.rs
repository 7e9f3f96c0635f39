//! Presentation in a window: the surface, its images, and how an image is filled and presented.
//!
//! A frame comes as a buffer of packed pixels (kernel `present`) and is copied into the image, so that images only need
//! to be usable as a transfer destination and colour attachment. The overlay is drawn on top.

use std::sync::Arc;

use ash::{khr, vk};
use raw_window_handle::{RawDisplayHandle, RawWindowHandle};

use instgs_vk::gpu::{Buffer, Gpu, GpuError, Recorder};

use crate::ui_painter::{UiFrame, UiPainter};

/// Name of the pass that draws the overlay, in profiles.
pub const UI_PASS: &str = "interface";

/// When a new frame replaces the one on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PresentMode {
    /// At vertical blank, in order: no tearing, never faster than the screen.
    #[default]
    Fifo,
    /// At vertical blank, the newest frame: no tearing, and frames are drawn as fast as possible.
    Mailbox,
    /// Immediately, which may tear.
    Immediate,
}

impl PresentMode {
    /// All modes, in the order in which they are offered.
    pub const ALL: [Self; 3] = [Self::Fifo, Self::Mailbox, Self::Immediate];

    const fn vulkan(self) -> vk::PresentModeKHR {
        match self {
            Self::Fifo => vk::PresentModeKHR::FIFO,
            Self::Mailbox => vk::PresentModeKHR::MAILBOX,
            Self::Immediate => vk::PresentModeKHR::IMMEDIATE,
        }
    }
}

/// What an image is filled with: buffers of one u32 per pixel, row by row from the top, bytes in the target's order.
#[derive(Clone, Copy)]
pub struct Pixels<'a> {
    /// The pixels of the whole image.
    pub all: &'a Buffer<u32>,
    /// Other pixels of the whole image, and the column up to which they are shown instead.
    pub left: Option<(&'a Buffer<u32>, u32)>,
}

/// The swapchain of a window. Must be dropped before the window.
pub struct Swapchain {
    gpu: Arc<Gpu>,
    surface_calls: khr::surface::Instance,
    surface: vk::SurfaceKHR,
    calls: khr::swapchain::Device,
    handle: vk::SwapchainKHR,
    format: vk::SurfaceFormatKHR,
    images: Vec<SwapImage>,
    size_px: [u32; 2],
    mode: PresentMode,
    /// True if images can be copied to the host.
    readable: bool,
    /// Where the next image goes, for [`Swapchain::take_captured`].
    capture: Option<Buffer<u32>>,
    /// Semaphores that an image's acquisition signals: one more than images, used in turn.
    free: Vec<vk::Semaphore>,
    next_free: usize,
}

struct SwapImage {
    image: vk::Image,
    view: vk::ImageView,
    /// Signalled when the frame is complete. One per image, since the presentation of an image is over when it is
    /// acquired again.
    complete: vk::Semaphore,
}

/// An acquired image that may be filled.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    index: u32,
    free: vk::Semaphore,
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// True if a pixel's bytes are blue, green, red, alpha instead of red first.
    pub blue_first: bool,
}

impl Swapchain {
    /// Creates a swapchain for a window of `size_px`. A mode that the window does not support becomes FIFO, which is
    /// always supported.
    ///
    /// # Errors
    /// The device cannot present to this window, or there is no format with 8 bits per colour.
    ///
    /// # Safety
    /// The handles must be of an existing display and window, the display the one that `gpu` was opened for, and the
    /// window must outlive the swapchain.
    pub unsafe fn new(
        gpu: &Arc<Gpu>,
        display: RawDisplayHandle,
        window: RawWindowHandle,
        size_px: [u32; 2],
        mode: PresentMode,
    ) -> Result<Self, GpuError> {
        // SAFETY: the caller guarantees valid handles; the extensions of this display are enabled.
        let surface = unsafe { ash_window::create_surface(gpu.raw_entry(), gpu.raw_instance(), display, window, None) }
            .map_err(GpuError::vulkan("surface of the window"))?;
        let surface_calls = khr::surface::Instance::new(gpu.raw_entry(), gpu.raw_instance());
        let mut swapchain = Self {
            gpu: gpu.clone(),
            surface_calls,
            surface,
            calls: khr::swapchain::Device::new(gpu.raw_instance(), gpu.raw_device()),
            handle: vk::SwapchainKHR::null(),
            format: vk::SurfaceFormatKHR::default(),
            images: Vec::new(),
            size_px,
            mode,
            readable: false,
            capture: None,
            free: Vec::new(),
            next_free: 0,
        };
        // SAFETY: the queue family and the surface are valid.
        let presents = unsafe {
            swapchain.surface_calls.get_physical_device_surface_support(
                gpu.raw_physical_device(),
                gpu.queue_family(),
                surface,
            )
        };
        if !presents.map_err(GpuError::vulkan("surface support"))? {
            let feature = "pictures in windows of this display".into();
            return Err(GpuError::MissingFeature { device: gpu.caps().name.clone(), feature });
        }
        swapchain.format = swapchain.choose_format()?;
        swapchain.resize(size_px)?;
        Ok(swapchain)
    }

    /// Vulkan format of the images.
    pub(crate) fn image_format(&self) -> vk::Format {
        self.format.format
    }

    /// Width and height of the images, pixels; zeros while the window is minimised.
    pub fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The present mode in use: FIFO if the window does not support the requested one.
    pub fn mode(&self) -> PresentMode {
        self.mode
    }

    /// Requests another present mode; see [`Swapchain::mode`] for the result.
    pub fn set_mode(&mut self, mode: PresentMode) -> Result<(), GpuError> {
        self.mode = mode;
        self.resize(self.size_px)
    }

    /// Recreates the images for a window of `size_px`, or of the size that the window system dictates.
    pub fn resize(&mut self, size_px: [u32; 2]) -> Result<(), GpuError> {
        self.wait_idle()?;
        // SAFETY: device and surface are valid.
        let abilities = unsafe {
            self.surface_calls.get_physical_device_surface_capabilities(self.gpu.raw_physical_device(), self.surface)
        };
        let abilities = abilities.map_err(GpuError::vulkan("surface"))?;
        let insisted = abilities.current_extent;
        self.size_px = if insisted.width == u32::MAX { size_px } else { [insisted.width, insisted.height] };
        let old = std::mem::replace(&mut self.handle, vk::SwapchainKHR::null());
        self.destroy_images();
        let created =
            if self.size_px.contains(&0) { Ok(vk::SwapchainKHR::null()) } else { self.create(&abilities, old) };
        if old != vk::SwapchainKHR::null() {
            // SAFETY: the device is idle and nothing refers to the old images any more.
            unsafe { self.calls.destroy_swapchain(old, None) };
        }
        self.handle = created?;
        self.create_images()
    }

    /// Acquires an image to fill; `None` if the window is minimised or out of date, in which case [`Swapchain::resize`]
    /// must come first.
    pub fn acquire(&mut self) -> Result<Option<Target>, GpuError> {
        if self.handle == vk::SwapchainKHR::null() {
            return Ok(None);
        }
        let free = self.free[self.next_free];
        // SAFETY: the semaphore is unsignalled: with one semaphore more than images, used in turn, this one's last wait
        // is over.
        match unsafe { self.calls.acquire_next_image(self.handle, u64::MAX, free, vk::Fence::null()) } {
            Ok((index, _)) => {
                self.next_free = (self.next_free + 1) % self.free.len();
                Ok(Some(Target { index, free, size_px: self.size_px, blue_first: is_blue_first(self.format.format) }))
            }
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(None),
            Err(result) => Err(GpuError::vulkan("acquiring an image")(result)),
        }
    }

    /// Fills an image with pixels, draws the overlay on top, submits everything that `recorder` holds, and presents the image.
    /// False if the window has changed, so that [`Swapchain::resize`] should come before the next frame.
    ///
    /// # Panics
    /// If a buffer of pixels has fewer elements than the image has pixels.
    pub fn present(
        &mut self,
        recorder: &mut Recorder,
        target: Target,
        pixels: Pixels<'_>,
        ui: Option<(&mut UiPainter, &UiFrame)>,
    ) -> Result<bool, GpuError> {
        let image = &self.images[target.index as usize];
        let width = target.size_px[0];
        let middle = pixels.left.map_or(0, |(_, middle)| middle.min(width));
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        let commands = recorder.raw_copy(pixels.all)?;
        self.move_to(commands, image.image, vk::ImageLayout::UNDEFINED, layout);
        self.fill(commands, image.image, pixels.all, (target.size_px, middle..width));
        if let Some((left, _)) = pixels.left {
            recorder.raw_copy(left)?;
            self.fill(commands, image.image, left, (target.size_px, 0..middle));
        }
        let mut drawn = layout;
        if let Some((painter, frame)) = ui {
            drawn = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
            self.move_to(commands, image.image, layout, drawn);
            let timer = recorder.begin_by_hand(UI_PASS);
            painter.record(commands, image.view, target.size_px, frame)?;
            recorder.end_by_hand(timer);
        }
        if let Some(capture) = &self.capture {
            let source = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
            self.move_to(commands, image.image, std::mem::replace(&mut drawn, source), source);
            self.copy_out(commands, image.image, capture, target.size_px);
        }
        self.move_to(commands, image.image, drawn, vk::ImageLayout::PRESENT_SRC_KHR);
        // SAFETY: the image was acquired with `free`, which will be signalled; only the image's presentation waits for
        // `complete`, and that was over when the image was acquired; images and semaphores are destroyed when the
        // device is idle.
        unsafe { recorder.submit_between(Some(target.free), Some(image.complete)) }?;
        self.show(target)
    }

    /// Records the copy of some columns of pixels, a range, into an image of `size_px`.
    fn fill(
        &self,
        commands: vk::CommandBuffer,
        image: vk::Image,
        pixels: &Buffer<u32>,
        ([width, height], columns): ([u32; 2], std::ops::Range<u32>),
    ) {
        assert!(pixels.len() as u64 >= u64::from(width) * u64::from(height), "too few pixels");
        if columns.is_empty() {
            return;
        }
        let region = [vk::BufferImageCopy::default()
            .buffer_offset(4 * u64::from(columns.start))
            .buffer_row_length(width)
            .image_subresource(colours())
            .image_offset(vk::Offset3D { x: columns.start as i32, y: 0, z: 0 })
            .image_extent(vk::Extent3D { width: columns.end - columns.start, height, depth: 1 })];
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // SAFETY: recording; the buffer holds all pixels (asserted), the image is in this layout, and barriers precede.
        unsafe { self.gpu.raw_device().cmd_copy_buffer_to_image(commands, pixels.handle(), image, layout, &region) };
    }

    /// Prepares to read the next image that is presented; see [`Swapchain::take_captured`].
    ///
    /// # Errors
    /// The window's images cannot be read, or there is no memory for a copy.
    pub fn capture_next(&mut self) -> Result<(), GpuError> {
        if !self.readable {
            let feature = "reading the images of a window".into();
            return Err(GpuError::MissingFeature { device: self.gpu.caps().name.clone(), feature });
        }
        let [width, height] = self.size_px;
        self.capture = Some(Buffer::for_readback(&self.gpu, "capture", width as usize * height as usize)?);
        Ok(())
    }

    /// The pixels of the image that was presented after [`Swapchain::capture_next`]: red, green and blue bytes, row by row from
    /// the top. None if there was none, or the window's size has changed since. Waits for the device.
    pub fn take_captured(&mut self) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(capture) = self.capture.take() else { return Ok(None) };
        self.gpu.wait_all()?;
        let blue_first = is_blue_first(self.format.format);
        let rgb = |pixel: &u32| {
            let [a, b, c, _] = pixel.to_le_bytes();
            if blue_first { [c, b, a] } else { [a, b, c] }
        };
        let count = self.size_px[0] as usize * self.size_px[1] as usize;
        let fits = capture.len() == count;
        Ok(fits.then(|| capture.read_all_mapped(count).iter().flat_map(rgb).collect()))
    }

    /// Records the copy of an image of `size_px` into memory that the host can read.
    fn copy_out(
        &self,
        commands: vk::CommandBuffer,
        image: vk::Image,
        capture: &Buffer<u32>,
        [width, height]: [u32; 2],
    ) {
        if capture.len() as u64 != u64::from(width) * u64::from(height) {
            return;
        }
        let region = [vk::BufferImageCopy::default().image_subresource(colours()).image_extent(vk::Extent3D {
            width,
            height,
            depth: 1,
        })];
        let to_host = [vk::MemoryBarrier2::default()
            .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER)
            .src_access_mask(vk::AccessFlags2::TRANSFER_WRITE)
            .dst_stage_mask(vk::PipelineStageFlags2::HOST)
            .dst_access_mask(vk::AccessFlags2::HOST_READ)];
        let info = vk::DependencyInfo::default().memory_barriers(&to_host);
        let (device, layout) = (self.gpu.raw_device(), vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
        // SAFETY: recording; the buffer has a place for each pixel (checked) and lives until the device is done
        // (`take_captured` waits; else it is dropped with the idle swapchain); the image is in this layout.
        unsafe {
            device.cmd_copy_image_to_buffer(commands, image, layout, capture.handle(), &region);
            device.cmd_pipeline_barrier2(commands, &info);
        }
    }

    fn show(&self, target: Target) -> Result<bool, GpuError> {
        let complete = [self.images[target.index as usize].complete];
        let (handles, indices) = ([self.handle], [target.index]);
        let info =
            vk::PresentInfoKHR::default().wait_semaphores(&complete).swapchains(&handles).image_indices(&indices);
        // SAFETY: the queue is locked; the image was acquired, and the preceding submission signals `complete`.
        match self.gpu.with_queue(|queue| unsafe { self.calls.queue_present(queue, &info) })? {
            Ok(suboptimal) => Ok(!suboptimal),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(false),
            Err(result) => Err(GpuError::vulkan("showing an image")(result)),
        }
    }

    /// Records a barrier between two uses of an image.
    fn move_to(&self, commands: vk::CommandBuffer, image: vk::Image, from: vk::ImageLayout, to: vk::ImageLayout) {
        let ((src_stage, src_access), (dst_stage, dst_access)) = (use_in(from), use_in(to));
        let barrier = [vk::ImageMemoryBarrier2::default()
            .src_stage_mask(src_stage)
            .src_access_mask(src_access)
            .dst_stage_mask(dst_stage)
            .dst_access_mask(dst_access)
            .old_layout(from)
            .new_layout(to)
            .image(image)
            .subresource_range(whole_image())];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barrier);
        // SAFETY: the command buffer is recording and the array lives through the call.
        unsafe { self.gpu.raw_device().cmd_pipeline_barrier2(commands, &info) };
    }

    /// Selects a format with 8 bits per colour that stores values unchanged: frames hold sRGB values already, which the
    /// device must not encode again.
    fn choose_format(&self) -> Result<vk::SurfaceFormatKHR, GpuError> {
        // SAFETY: device and surface are valid.
        let formats = unsafe {
            self.surface_calls.get_physical_device_surface_formats(self.gpu.raw_physical_device(), self.surface)
        };
        let formats = formats.map_err(GpuError::vulkan("surface formats"))?;
        let wanted = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM, vk::Format::A8B8G8R8_UNORM_PACK32];
        let srgb = |f: &&vk::SurfaceFormatKHR| f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR;
        let found = wanted.iter().find_map(|&want| formats.iter().filter(srgb).find(|f| f.format == want));
        found.copied().ok_or_else(|| GpuError::MissingFeature {
            device: self.gpu.caps().name.clone(),
            feature: "a window format with 8 bits per colour (R8G8B8A8 or B8G8R8A8)".into(),
        })
    }

    fn create(
        &mut self,
        abilities: &vk::SurfaceCapabilitiesKHR,
        old: vk::SwapchainKHR,
    ) -> Result<vk::SwapchainKHR, GpuError> {
        // SAFETY: device and surface are valid.
        let modes = unsafe {
            self.surface_calls.get_physical_device_surface_present_modes(self.gpu.raw_physical_device(), self.surface)
        };
        let modes = modes.map_err(GpuError::vulkan("present modes"))?;
        if !modes.contains(&self.mode.vulkan()) {
            self.mode = PresentMode::Fifo;
        }
        // One image to draw into while one is presented and one waits.
        let most = if abilities.max_image_count == 0 { u32::MAX } else { abilities.max_image_count };
        let [width, height] = self.size_px;
        let mut usage = vk::ImageUsageFlags::TRANSFER_DST | vk::ImageUsageFlags::COLOR_ATTACHMENT;
        self.readable = abilities.supported_usage_flags.contains(vk::ImageUsageFlags::TRANSFER_SRC);
        if self.readable {
            usage |= vk::ImageUsageFlags::TRANSFER_SRC;
        }
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let alpha = if abilities.supported_composite_alpha.contains(opaque) {
            opaque
        } else {
            vk::CompositeAlphaFlagsKHR::INHERIT
        };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface)
            .min_image_count((abilities.min_image_count + 1).min(most))
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(vk::Extent2D { width, height })
            .image_array_layers(1)
            .image_usage(usage)
            .pre_transform(abilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(self.mode.vulkan())
            .clipped(true)
            .old_swapchain(old);
        // SAFETY: a valid create-info; the old swapchain is of the same surface.
        unsafe { self.calls.create_swapchain(&info, None) }.map_err(GpuError::vulkan("images of the window"))
    }

    fn create_images(&mut self) -> Result<(), GpuError> {
        if self.handle == vk::SwapchainKHR::null() {
            return Ok(());
        }
        let device = self.gpu.raw_device();
        // SAFETY: the swapchain is valid.
        let images = unsafe { self.calls.get_swapchain_images(self.handle) };
        let images = images.map_err(GpuError::vulkan("images of the window"))?;
        // SAFETY: valid create-infos; everything is destroyed by `destroy_images`.
        let semaphore = || unsafe { device.create_semaphore(&vk::SemaphoreCreateInfo::default(), None) };
        for image in images {
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(self.format.format)
                .subresource_range(whole_image());
            // SAFETY: a valid create-info; the view is destroyed by `destroy_images`.
            let view =
                unsafe { device.create_image_view(&info, None) }.map_err(GpuError::vulkan("view of an image"))?;
            let mut swap_image = SwapImage { image, view, complete: vk::Semaphore::null() };
            let complete = semaphore();
            swap_image.complete = complete.as_ref().copied().unwrap_or_default();
            self.images.push(swap_image);
            complete.map_err(GpuError::vulkan("semaphore"))?;
        }
        for _ in 0..=self.images.len() {
            self.free.push(semaphore().map_err(GpuError::vulkan("semaphore"))?);
        }
        self.next_free = 0;
        Ok(())
    }

    /// Waits until the device is idle, presentation included.
    fn wait_idle(&self) -> Result<(), GpuError> {
        // SAFETY: the queue is locked, and the device of a window has no other.
        self.gpu
            .with_queue(|_| unsafe { self.gpu.raw_device().device_wait_idle() })?
            .map_err(GpuError::vulkan("waiting for the window"))
    }

    /// Destroys the images' views and semaphores. The device must be idle.
    fn destroy_images(&mut self) {
        let device = self.gpu.raw_device();
        // SAFETY: the device is idle or lost, and each object is destroyed once; null handles are ignored.
        unsafe {
            for image in self.images.drain(..) {
                device.destroy_image_view(image.view, None);
                device.destroy_semaphore(image.complete, None);
            }
            self.free.drain(..).for_each(|semaphore| device.destroy_semaphore(semaphore, None));
        }
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // A lost device returns an error here; destruction is then allowed as well.
        let _ = self.wait_idle();
        self.destroy_images();
        // SAFETY: nothing uses images or surface any more; children are destroyed before parents.
        unsafe {
            if self.handle != vk::SwapchainKHR::null() {
                self.calls.destroy_swapchain(self.handle, None);
            }
            self.surface_calls.destroy_surface(self.surface, None);
        }
    }
}

fn is_blue_first(format: vk::Format) -> bool {
    format == vk::Format::B8G8R8A8_UNORM
}

fn colours() -> vk::ImageSubresourceLayers {
    vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1)
}

fn whole_image() -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).level_count(1).layer_count(1)
}

/// Pipeline stage and access of an image in a layout. The first use of an acquired image waits for its semaphore at the
/// transfer viewer.
fn use_in(layout: vk::ImageLayout) -> (vk::PipelineStageFlags2, vk::AccessFlags2) {
    match layout {
        vk::ImageLayout::UNDEFINED => (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::NONE),
        vk::ImageLayout::TRANSFER_DST_OPTIMAL => {
            (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_WRITE)
        }
        vk::ImageLayout::TRANSFER_SRC_OPTIMAL => {
            (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_READ)
        }
        vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL => (
            vk::PipelineStageFlags2::COLOR_ATTACHMENT_OUTPUT,
            vk::AccessFlags2::COLOR_ATTACHMENT_READ | vk::AccessFlags2::COLOR_ATTACHMENT_WRITE,
        ),
        _ => (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE),
    }
}
