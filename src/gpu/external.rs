//! Rendering into images and command buffers of the caller's.

use std::sync::Arc;

use ash::vk;

use super::buffer::Buffer;
use super::context::Gpu;
use super::error::GpuError;
use super::recorder::{FOR_THE_HOST, Recorder, Submitted};
use super::timeline::Timeline;

/// The timeline semaphore that the caller's submission must signal when it is done, and its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "the submission must signal it"]
pub struct Signal {
    /// A timeline semaphore of the device.
    pub semaphore: vk::Semaphore,
    /// The value that the submission sets the semaphore to.
    pub value: u64,
}

/// An image of the caller's as the target of a picture: its colour aspect, mip level 0, array layer 0.
#[derive(Clone, Copy, Debug)]
pub struct ImageTarget {
    /// The image: usage `TRANSFER_DST`, one sample per pixel, owned by the family of the [`Gpu`]'s queue (or shared).
    pub image: vk::Image,
    /// `R8G8B8A8_UNORM`, `B8G8R8A8_UNORM`, or one of the two with `_SRGB`. Colours are stored unchanged in the encoding
    /// of the training images (sRGB), so a sampler decodes an `_SRGB` image and does not decode a `_UNORM` one.
    pub format: vk::Format,
    /// Width and height of the image, pixels. The picture is scaled if the camera has another size.
    pub size_px: [u32; 2],
    /// The layout that the image is left in. The layout before does not matter: the contents are discarded.
    pub layout_after: vk::ImageLayout,
}

impl ImageTarget {
    /// True if blue comes first in memory.
    ///
    /// # Errors
    /// The format is not one of those of [`ImageTarget::format`], or the image has no pixels.
    pub(crate) fn blue_first(&self) -> Result<bool, GpuError> {
        let refuse = |reason: String| Err(GpuError::Recording { pass: "an image".into(), reason });
        if self.size_px.contains(&0) {
            return refuse("the image has no pixels".into());
        }
        match self.format {
            vk::Format::R8G8B8A8_UNORM | vk::Format::R8G8B8A8_SRGB => Ok(false),
            vk::Format::B8G8R8A8_UNORM | vk::Format::B8G8R8A8_SRGB => Ok(true),
            other => refuse(format!("format {other:?} is none of R8G8B8A8 and B8G8R8A8, UNORM and SRGB")),
        }
    }
}

impl Recorder {
    /// Creates a recorder for [`Recorder::begin_in`].
    pub(crate) fn for_callers(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let mut recorder = Self::new(gpu)?;
        recorder.callers = Some(Timeline::with_semaphore(&gpu.device)?);
        Ok(recorder)
    }

    /// Starts recording into a command buffer of the caller's, up to [`Recorder::end_in`]. Never waits.
    ///
    /// # Errors
    /// The previous recording has not finished, or was begun and neither ended nor abandoned.
    ///
    /// # Safety
    /// The command buffer is of this device and of a family that does compute and transfers, is being recorded outside of
    /// a render pass, and stays so up to the end. If anything fails before that, it is not submitted.
    pub(crate) unsafe fn begin_in(&mut self, commands: vk::CommandBuffer) -> Result<(), GpuError> {
        if self.recording || self.callers.is_none() || !self.callers_over()? {
            return Err(self.refuse("a picture", "the one before is not over"));
        }
        self.start()?;
        self.open(commands);
        Ok(())
    }

    /// Ends the recording that [`Recorder::begin_in`] started. Returns what the caller's submission must signal.
    pub(crate) fn end_in(&mut self) -> Result<Signal, GpuError> {
        let Some(callers) = self.callers.as_ref().filter(|_| self.recording && self.commands != self.own) else {
            return Err(self.refuse("a picture", "it was not begun"));
        };
        let semaphore = callers.semaphore().map_err(GpuError::vulkan("timeline semaphore"))?;
        let ticket = callers.next();
        callers.submitted(ticket);
        let signal = Signal { semaphore, value: ticket.0 };
        self.barrier(FOR_THE_HOST);
        self.submitted = Some(Submitted::Callers(ticket));
        self.close();
        Ok(signal)
    }

    /// True if every recording into a command buffer of the caller's has finished.
    ///
    /// # Errors
    /// The device is lost.
    pub(crate) fn callers_over(&self) -> Result<bool, GpuError> {
        let (Some(Submitted::Callers(ticket)), Some(callers)) = (self.submitted, &self.callers) else {
            return Ok(true);
        };
        if callers.is_lost() {
            return Err(self.explain(vk::Result::ERROR_DEVICE_LOST));
        }
        Ok(callers.is_over(ticket))
    }

    /// Waits for the recording in a command buffer of the caller's, which must have been submitted.
    pub(crate) fn wait_for_callers(&self) -> Result<(), GpuError> {
        match (self.submitted, &self.callers) {
            (Some(Submitted::Callers(ticket)), Some(callers)) => callers.wait(ticket).map_err(|e| self.explain(e)),
            _ => Ok(()),
        }
    }

    /// Releases the buffers of a recording in a command buffer of the caller's, if it has finished.
    pub(crate) fn release_callers(&mut self) {
        if let (Some(Submitted::Callers(ticket)), Some(callers)) = (self.submitted, &self.callers)
            && callers.is_over(ticket)
        {
            self.kept.clear();
            self.submitted = None;
        }
    }

    /// Releases the buffers of a recording in a command buffer of the caller's.
    ///
    /// # Safety
    /// The recording has not been submitted and never will be, or has finished.
    pub(crate) unsafe fn forget_callers(&mut self) -> Result<(), GpuError> {
        if let Some(Submitted::Callers(_)) = self.submitted {
            // The skipped value must not be signalled later: a new semaphore starts again.
            self.callers = Some(Timeline::with_semaphore(&self.gpu.device)?);
            self.submitted = None;
        }
        self.abandon();
        Ok(())
    }

    /// Copies packed pixels into an image: one u32 each, row by row from the top. Later commands in the queue see them.
    ///
    /// # Errors
    /// The buffer has fewer pixels than the image.
    ///
    /// # Safety
    /// The image fulfils what [`ImageTarget`] requires, and lives until the submission has finished.
    pub(crate) unsafe fn copy_to_image(&mut self, pixels: &Buffer<u32>, target: &ImageTarget) -> Result<(), GpuError> {
        let [width, height] = target.size_px;
        if (pixels.len() as u64) < u64::from(width) * u64::from(height) {
            return Err(self.refuse("an image", "there are fewer pixels than it has"));
        }
        let commands = self.raw_copy(pixels)?;
        let filled = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        // Earlier uses of the image are covered by the barrier at the start of the recording.
        let (copies, writes) = (vk::PipelineStageFlags2::ALL_TRANSFER, vk::AccessFlags2::TRANSFER_WRITE);
        let before = vk::ImageMemoryBarrier2::default()
            .src_stage_mask(copies)
            .dst_stage_mask(copies)
            .dst_access_mask(writes)
            .old_layout(vk::ImageLayout::UNDEFINED)
            .new_layout(filled);
        let after = vk::ImageMemoryBarrier2::default()
            .src_stage_mask(copies)
            .src_access_mask(writes)
            .dst_stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
            .dst_access_mask(vk::AccessFlags2::MEMORY_READ | vk::AccessFlags2::MEMORY_WRITE)
            .old_layout(filled)
            .new_layout(target.layout_after);
        self.image_barrier(target.image, before);
        let layers = vk::ImageSubresourceLayers::default().aspect_mask(vk::ImageAspectFlags::COLOR).layer_count(1);
        let extent = vk::Extent3D { width, height, depth: 1 };
        let regions = [vk::BufferImageCopy::default().image_subresource(layers).image_extent(extent)];
        // SAFETY: recording; the buffer is kept and holds all pixels (checked), the image is in this layout, and barriers
        // precede.
        unsafe {
            self.gpu.device.cmd_copy_buffer_to_image(commands, pixels.handle(), target.image, filled, &regions);
        }
        self.image_barrier(target.image, after);
        Ok(())
    }

    fn image_barrier(&self, image: vk::Image, barrier: vk::ImageMemoryBarrier2<'_>) {
        let range =
            vk::ImageSubresourceRange::default().aspect_mask(vk::ImageAspectFlags::COLOR).level_count(1).layer_count(1);
        let barriers = [barrier
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(range)];
        let info = vk::DependencyInfo::default().image_memory_barriers(&barriers);
        // SAFETY: the command buffer is recording and the array lives through the call; `copy_to_image` vouches for the image.
        unsafe { self.gpu.device.cmd_pipeline_barrier2(self.commands, &info) };
    }
}
