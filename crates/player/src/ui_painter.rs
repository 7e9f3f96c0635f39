//! Draws egui's user interface over a frame.

use std::sync::Arc;

use ash::vk;
use egui_ash_renderer::{DynamicRendering, Options, Renderer, RendererError};

use instgs_vk::gpu::{Gpu, GpuError};

use crate::swapchain::Swapchain;

/// Sets of meshes, used in turn: one that is recorded while the device may still draw the other.
const IN_FLIGHT: usize = 2;

/// egui's output of one frame.
#[derive(Default)]
pub struct UiFrame {
    /// Textures to upload before drawing and to free after it.
    pub textures: egui::TexturesDelta,
    /// Triangle meshes with their clip rectangles.
    pub primitives: Vec<egui::ClippedPrimitive>,
    /// Window pixels per interface point.
    pub pixels_per_point: f32,
}

/// Pipeline, textures and meshes of the interface.
pub struct UiPainter {
    gpu: Arc<Gpu>,
    renderer: Option<Renderer>,
    pool: vk::CommandPool,
    /// Textures that the last frame used and the next one does not.
    to_free: Vec<egui::TextureId>,
}

impl UiPainter {
    /// Creates the pipeline for images in the swapchain's format.
    pub fn new(gpu: &Arc<Gpu>, swapchain: &Swapchain) -> Result<Self, GpuError> {
        let info = vk::CommandPoolCreateInfo::default().queue_family_index(gpu.queue_family());
        // SAFETY: a valid queue family; the pool is destroyed in drop.
        let pool =
            unsafe { gpu.raw_device().create_command_pool(&info, None) }.map_err(GpuError::vulkan("command pool"))?;
        let mut painter = Self { gpu: gpu.clone(), renderer: None, pool, to_free: Vec::new() };
        let format =
            DynamicRendering { color_attachment_format: swapchain.image_format(), depth_attachment_format: None };
        let options = Options { in_flight_frames: IN_FLIGHT, ..Options::default() };
        let renderer = Renderer::with_default_allocator(
            gpu.raw_instance(),
            gpu.raw_physical_device(),
            gpu.raw_device().clone(),
            format,
            options,
        );
        painter.renderer = Some(renderer.map_err(explain)?);
        Ok(painter)
    }

    /// Uploads the textures of a frame, and frees those that earlier frames no longer use. Both are rare, and wait for
    /// the device, which may still be drawing the last frame.
    pub fn prepare(&mut self, frame: &UiFrame) -> Result<(), GpuError> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        if self.to_free.is_empty() && frame.textures.set.is_empty() && frame.textures.free.is_empty() {
            return Ok(());
        }
        self.gpu.wait_all()?;
        renderer.free_textures(&std::mem::take(&mut self.to_free)).map_err(explain)?;
        if !frame.textures.set.is_empty() {
            let set = |queue| renderer.set_textures(queue, self.pool, &frame.textures.set);
            self.gpu.with_queue(set)?.map_err(explain)?;
        }
        self.to_free.extend(&frame.textures.free);
        Ok(())
    }

    /// Records the interface onto an image that is a colour attachment. The frame before the previous one must be
    /// complete, since its meshes are reused.
    pub(crate) fn record(
        &mut self,
        commands: vk::CommandBuffer,
        view: vk::ImageView,
        [width, height]: [u32; 2],
        frame: &UiFrame,
    ) -> Result<(), GpuError> {
        let Some(renderer) = &mut self.renderer else { return Ok(()) };
        let extent = vk::Extent2D { width, height };
        let attachment = [vk::RenderingAttachmentInfo::default()
            .image_view(view)
            .image_layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
            .load_op(vk::AttachmentLoadOp::LOAD)
            .store_op(vk::AttachmentStoreOp::STORE)];
        let info = vk::RenderingInfo::default()
            .render_area(vk::Rect2D { extent, ..Default::default() })
            .layer_count(1)
            .color_attachments(&attachment);
        // SAFETY: recording; the view is of an image in this layout, and the array lives through the call.
        unsafe { self.gpu.raw_device().cmd_begin_rendering(commands, &info) };
        let drawn = renderer.cmd_draw(commands, extent, frame.pixels_per_point, &frame.primitives);
        // SAFETY: rendering was begun above.
        unsafe { self.gpu.raw_device().cmd_end_rendering(commands) };
        drawn.map_err(explain)
    }
}

impl Drop for UiPainter {
    fn drop(&mut self) {
        let _ = self.gpu.wait_all();
        drop(self.renderer.take());
        // SAFETY: the device is done with everything of the pool.
        unsafe { self.gpu.raw_device().destroy_command_pool(self.pool, None) };
    }
}

fn explain(error: RendererError) -> GpuError {
    match error {
        RendererError::Vulkan(vk::Result::ERROR_DEVICE_LOST) => {
            GpuError::DeviceLost { last_pass: "user interface".into() }
        }
        RendererError::Vulkan(result) => GpuError::Vulkan { what: "user interface".into(), result },
        other => GpuError::Kernel { kernel: "user interface".into(), reason: other.to_string() },
    }
}
