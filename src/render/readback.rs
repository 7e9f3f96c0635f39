//! Read-back of a picture without waiting: the copy is submitted now, and the pixels are taken when it has finished.

use std::sync::Arc;

use crate::gpu::timeline::Ticket;
use crate::gpu::{Buffer, Gpu, Recorder};

use super::error::RenderError;
use super::picture::Picture;
use super::renderer::Renderer;

/// Host-visible memory for one picture, reused for the next; several of these allow several read-backs in flight.
pub struct Readback {
    gpu: Arc<Gpu>,
    recorder: Recorder,
    colors: Buffer<[f32; 4]>,
    depths: Buffer<[f32; 2]>,
    /// Ticket of the submission, and width and height of the picture.
    pending: Option<(Ticket, [u32; 2])>,
}

impl Readback {
    /// Creates a read-back that holds no picture.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        let colors = Buffer::for_readback(gpu, "colors on the host", 1)?;
        let depths = Buffer::for_readback(gpu, "depths on the host", 1)?;
        Ok(Self { gpu: gpu.clone(), recorder: Recorder::new(gpu)?, colors, depths, pending: None })
    }

    /// True if a picture has been submitted and not taken yet.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Takes the picture if its copy has finished; `None` if it has not, or none was submitted. Never waits.
    ///
    /// # Errors
    /// The device is lost.
    pub fn poll(&mut self) -> Result<Option<Picture>, RenderError> {
        match self.pending {
            Some((ticket, _)) if self.gpu.is_over(ticket) => self.wait(),
            _ => Ok(None),
        }
    }

    /// Waits for the picture and takes it; `None` if none was submitted.
    ///
    /// # Errors
    /// The device is lost.
    pub fn wait(&mut self) -> Result<Option<Picture>, RenderError> {
        let Some((ticket, [width, height])) = self.pending else { return Ok(None) };
        self.recorder.wait(ticket)?;
        self.pending = None;
        let pixels = width as usize * height as usize;
        let depths = self.depths.read_all_mapped(pixels).into_iter().map(|d| d[0]).collect();
        Ok(Some(Picture { width, height, colors: self.colors.read_all_mapped(pixels), depths }))
    }
}

impl Renderer {
    /// Submits a copy of the last picture to the host, like [`Renderer::download`], and does not wait: rendering may go
    /// on at once. False if there is no picture yet. A picture of [`Renderer::submit_ahead`] is copied whether or not
    /// it turns out complete.
    ///
    /// # Errors
    /// [`RenderError::Busy`] if the last picture of `readback` has not been taken, or memory is exhausted.
    pub fn submit_readback(&self, readback: &mut Readback) -> Result<bool, RenderError> {
        if readback.is_pending() {
            return Err(RenderError::Busy { pending: 1 });
        }
        let Some(frame) = self.frame() else { return Ok(false) };
        if readback.colors.len() != frame.colors.len() {
            let colors = Buffer::for_readback(&readback.gpu, "colors on the host", frame.colors.len())?;
            let depths = Buffer::for_readback(&readback.gpu, "depths on the host", frame.depths.len())?;
            // Both or neither: a second attempt compares the length of one.
            (readback.colors, readback.depths) = (colors, depths);
        }
        let recorder = &mut readback.recorder;
        let copied = recorder
            .copy(&frame.colors, &mut readback.colors, frame.colors.bytes())
            .and_then(|()| recorder.copy(&frame.depths, &mut readback.depths, frame.depths.bytes()))
            .and_then(|()| recorder.submit());
        match copied {
            Ok(ticket) => readback.pending = Some((ticket, frame.plan.size_px)),
            Err(error) => {
                recorder.abandon();
                return Err(error.into());
            }
        }
        Ok(true)
    }
}
