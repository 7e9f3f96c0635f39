//! Frames that end in images of a caller with its own renderer: they are recorded into the caller's command buffer, and
//! the host never waits.
//!
//! As with [`Ahead`](super::Ahead), a frame must fit the buffers as they are, in one depth slab. Whether it did is
//! known when it has finished: [`ImageFrames::poll`] returns that, and enlarges the buffers for the next frame if it
//! did not.

use std::collections::VecDeque;

use crate::gpu::{ImageTarget, Recorder, Signal, vk};
use crate::scene::Camera;

use super::ahead::{Arrived, arrived_of};
use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::extra_passes::ExtraPasses;
use super::frame_slot::FrameSlot;
use super::instance_table::RecordedChanges;
use super::plan::Capacities;
use super::presenter::{Presenter, ShownPicture};
use super::render_options::RenderOptions;
use super::renderer::{Renderer, purpose_of};
use super::show::Show;

/// Frames in flight to images of the caller's. Used with one [`Renderer`].
///
/// Dropping this frees what the device has finished; what it may still use is leaked, so wait for the device first.
pub struct ImageFrames {
    presenter: Presenter,
    free: Vec<FrameSlot>,
    /// Frames in flight, oldest first.
    pending: VecDeque<Pending>,
}

/// A frame in flight and its limits.
struct Pending {
    slot: FrameSlot,
    needs: Needs,
    /// Rows of the scene's instance table that it writes.
    changes: RecordedChanges,
}

/// Determines whether a frame was complete, and how large buffers may become if it was not.
#[derive(Clone, Copy)]
pub(super) struct Needs {
    /// Capacities of the frame's buffers.
    pub(super) have: Capacities,
    /// (instance, chunk) pairs of the frame's scene.
    pub(super) chunk_pairs: u64,
    /// Value of [`RenderOptions::max_chunks`].
    pub(super) max_chunks: Option<u32>,
    /// Value of [`RenderOptions::max_intersections`].
    pub(super) max_intersections: Option<u32>,
}

impl ImageFrames {
    /// Creates slots for at most `frames_in_flight` (1 or more) frames, none in flight.
    pub fn new(renderer: &Renderer, frames_in_flight: usize) -> Result<Self, RenderError> {
        let gpu = renderer.gpu();
        let slot = || FrameSlot::new(gpu, Recorder::for_callers(gpu)?);
        let free = (0..frames_in_flight.max(1)).map(|_| slot()).collect::<Result<_, _>>()?;
        Ok(Self { presenter: Presenter::new(gpu, renderer)?, free, pending: VecDeque::new() })
    }

    /// The outcome of the oldest frame; `None` if it has not finished, or there is none. Never waits. Every frame is
    /// reported once, in the order of recording, and then makes room for another one.
    ///
    /// [`Arrived::Incomplete`]: a buffer was too small. The image then holds the last picture of its size that was complete,
    /// or black. The buffers have been enlarged for pictures that are recorded from now on. That can happen three times in a
    /// row for a new view, since a list whose length depends on an incomplete one is not known yet;
    /// [`Renderer::render`] of the view finds all sizes at once, by waiting.
    ///
    /// # Errors
    /// The device is lost; or the picture was incomplete and larger buffers do not help
    /// ([`RenderError::TooMany`]): it needs more than the device or `max_intersections` allows in one depth slab.
    pub fn poll(&mut self, renderer: &mut Renderer) -> Result<Option<Arrived>, RenderError> {
        match self.pending.front() {
            Some(oldest) if oldest.slot.recorder.callers_over()? => self.take_oldest(renderer),
            _ => Ok(None),
        }
    }

    /// The same as [`ImageFrames::poll`], but waits for the oldest frame. Its command buffer must have been submitted,
    /// else this waits for ever. `None` if no frame is in flight.
    ///
    /// # Errors
    /// The same errors as [`ImageFrames::poll`].
    pub fn wait(&mut self, renderer: &mut Renderer) -> Result<Option<Arrived>, RenderError> {
        if let Some(oldest) = self.pending.front() {
            oldest.slot.recorder.wait_for_callers()?;
        }
        self.take_oldest(renderer)
    }

    fn take_oldest(&mut self, renderer: &mut Renderer) -> Result<Option<Arrived>, RenderError> {
        let Some(Pending { mut slot, needs, .. }) = self.pending.pop_front() else { return Ok(None) };
        let counters = slot.counters();
        // What the frame used may be dropped already; larger buffers may need its memory.
        slot.recorder.release_callers();
        self.free.push(slot);
        let arrived = arrived_of(&counters, needs.have);
        if arrived == Arrived::Incomplete {
            renderer.grow_for_next(&counters, needs)?;
        }
        Ok(Some(arrived))
    }

    /// Number of frames in flight.
    pub fn pending_len(&self) -> usize {
        self.pending.len()
    }

    /// Discards the frame that was recorded last: [`ImageFrames::poll`] does not report it.
    ///
    /// # Errors
    /// A new semaphore could not be created; nothing is discarded then.
    ///
    /// # Safety
    /// The command buffer that it was recorded into has not been submitted since and never will be.
    pub unsafe fn forget_last(&mut self) -> Result<(), RenderError> {
        let Some(mut last) = self.pending.pop_back() else { return Ok(()) };
        // SAFETY: guaranteed by the caller.
        match unsafe { last.slot.recorder.forget_callers() } {
            Ok(()) => {
                self.free.push(last.slot);
                self.presenter.forget_pixels();
                last.changes.restore();
                Ok(())
            }
            Err(error) => {
                self.pending.push_back(last);
                Err(error.into())
            }
        }
    }
}

impl Renderer {
    /// Records a whole picture into a command buffer of the caller's, up to and including its copy into an image, and returns
    /// what the submission of the command buffer must signal. Neither submits nor waits, unless buffers have to be
    /// made and memory is short.
    ///
    /// The commands are dispatches, copies, fills and barriers. They start with a barrier that makes everything that comes
    /// before them in the queue visible to them, and end with one that makes the image visible to everything that comes
    /// after. The image may be in any layout, loses what it held, and is left in `target.layout_after`. Of the command
    /// buffer's state, the compute bind point (pipeline, descriptor set 0, push constants) is left changed. The picture is of
    /// the scene as it is when the commands are executed; colours are blended over `options.background`, and alpha is 1.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`]; [`RenderError::Busy`] if `frames` has no free slot; an image format
    /// that [`ImageTarget::format`] does not allow. After any error the command buffer holds part of the commands:
    /// reset it, and do not submit it.
    ///
    /// # Safety
    /// - `commands` is a primary command buffer of the device and of a pool of the [`Gpu`](crate::gpu::Gpu)'s queue family, is
    ///   being recorded, and is not within a render pass.
    /// - `target` is as [`ImageTarget`] says, and its image lives until the submission is over.
    /// - The command buffer is submitted at most once, to the queue of the `Gpu`, and that submission signals the returned
    ///   [`Signal`] at stage `ALL_COMMANDS`. Command buffers with pictures of one renderer are submitted in the order in which
    ///   they were recorded. If it is not submitted, [`ImageFrames::forget_last`] says so.
    /// - After instances were moved or hidden since the recording, the command buffer is submitted before this renderer submits
    ///   a picture of the scene by itself, which would write the newer rows first.
    pub unsafe fn record_into_image(
        &mut self,
        frames: &mut ImageFrames,
        commands: vk::CommandBuffer,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        target: &ImageTarget,
    ) -> Result<Signal, RenderError> {
        let blue_first = target.blue_first()?;
        if frames.free.is_empty() {
            return Err(RenderError::Busy { pending: frames.pending.len() });
        }
        let purpose = purpose_of(&ExtraPasses::default(), options);
        // One submission, which nobody divides.
        let options = &RenderOptions { divide_for_memory: false, ..*options };
        self.prepare(purpose, scene, camera, options)?;
        let Some(mut slot) = frames.free.pop() else { return Err(RenderError::Busy { pending: 0 }) };
        // SAFETY: guaranteed by the caller.
        let recorded = unsafe { slot.recorder.begin_in(commands) }.map_err(RenderError::from).and_then(|()| {
            let (inputs, frame) = self.passes(purpose, scene, camera, options);
            let have = slot.record(&inputs, frame, &mut ExtraPasses::default())?;
            let picture = ShownPicture { renderer: self, scene, surfaces: None, marks: None };
            let presenter = &mut frames.presenter;
            presenter.record(&mut slot.recorder, Show::Color, picture, target.size_px, blue_first)?;
            // SAFETY: guaranteed by the caller.
            unsafe { slot.recorder.copy_to_image(presenter.pixels(), target) }?;
            Ok((slot.recorder.end_in()?, have))
        });
        self.note_drawn(recorded.is_ok());
        match recorded {
            Ok((signal, have)) => {
                let RenderOptions { max_chunks, max_intersections, .. } = *options;
                let needs = Needs { have, chunk_pairs: scene.chunk_pairs, max_chunks, max_intersections };
                frames.pending.push_back(Pending { slot, needs, changes: scene.take_changes() });
                Ok(signal)
            }
            Err(error) => {
                slot.recorder.abandon();
                frames.free.push(slot);
                frames.presenter.forget_pixels();
                Err(error)
            }
        }
    }
}
