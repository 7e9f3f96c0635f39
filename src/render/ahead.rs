//! Frames in flight: the host prepares a frame while the device draws the one before. For steady display, where no
//! frame is read before it is shown.
//!
//! A frame that is submitted this way must fit the buffers as they are, in one depth slab. Whether it did is known when
//! it arrives; until then kernel `present` checks this itself and keeps the pixels of the previous frame.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::timeline::Ticket;
use crate::gpu::{Gpu, Recorder};
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::extra_passes::ExtraPasses;
use super::frame_slot::FrameSlot;
use super::frame_stats::FrameStats;
use super::layers::LayerNeeds;
use super::plan::Capacities;
use super::render_options::RenderOptions;
use super::renderer::{Counters, Renderer, purpose_of};

/// Largest number of frames in flight: one that the device draws and one that the host prepares. More would only add
/// latency.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// The frames in flight of one [`Renderer`].
pub struct Ahead {
    free: Vec<FrameSlot>,
    /// Frames in flight, oldest first.
    pending: VecDeque<(FrameSlot, Ticket, Capacities)>,
}

/// The outcome of a frame that has finished.
#[derive(Clone, Debug, PartialEq)]
pub enum Arrived {
    /// The frame is as [`Renderer::render`] would have drawn it.
    Complete(FrameStats),
    /// A buffer was too small, or the frame takes several slabs: draw it with [`Renderer::render`], which handles both.
    /// With [`ImageFrames`](super::ImageFrames), record it again.
    Incomplete,
}

impl Ahead {
    /// Creates the slots of all frames, none in flight; every pass is timed.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        let slot = || FrameSlot::new(gpu, Recorder::with_profiler(gpu)?);
        let free = (0..FRAMES_IN_FLIGHT).map(|_| slot()).collect::<Result<_, _>>()?;
        Ok(Self { free, pending: VecDeque::new() })
    }

    /// True if a frame must arrive before the next one is submitted.
    pub fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// Number of frames in flight.
    pub fn pending_len(&self) -> usize {
        self.pending.len()
    }

    /// Waits for the oldest frame; `None` if none is in flight.
    pub fn arrive(&mut self) -> Result<Option<Arrived>, RenderError> {
        let Some((slot, ticket, capacities)) = self.pending.pop_front() else { return Ok(None) };
        slot.recorder.wait(ticket)?;
        let mut arrived = arrived_of(&slot.counters(), capacities);
        if let Arrived::Complete(stats) = &mut arrived {
            stats.passes_ms = slot.recorder.passes_ms()?;
        }
        self.free.push(slot);
        Ok(Some(arrived))
    }
}

/// The outcome of a frame by its final counters, given the `capacities` of its buffers.
pub(super) fn arrived_of(counters: &Counters, capacities: Capacities) -> Arrived {
    let count = |slot: u32| u64::from(counters[slot as usize]);
    let complete = count(COUNTER_CANDIDATES_NEEDED) <= u64::from(capacities.candidates)
        && count(COUNTER_WORK_ITEMS_NEEDED) <= u64::from(capacities.work_items)
        && count(COUNTER_SLAB_END) >= count(COUNTER_VISIBLE)
        && count(COUNTER_INCOMPLETE) == 0;
    if !complete {
        return Arrived::Incomplete;
    }
    let layers = LayerNeeds::of_frame(counters);
    let sum = |of: fn(&LayerNeeds) -> u32| layers.iter().map(|layer| u64::from(of(layer))).sum();
    Arrived::Complete(FrameStats {
        work_items: sum(|layer| layer.work_items),
        visible: sum(|layer| layer.visible),
        intersections: sum(|layer| layer.intersections),
        slabs: layers.len() as u32,
        layers: layers.len() as u32,
        in_ranges: false,
        redone: 0,
        passes_ms: Vec::new(),
    })
}

impl Renderer {
    /// Submits a frame without waiting for it; [`Ahead::arrive`] returns its outcome. Later submissions see the picture
    /// as after [`Renderer::render_with`].
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    ///
    /// # Panics
    /// If `ahead` is full.
    pub fn submit_ahead(
        &mut self,
        ahead: &mut Ahead,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        extra: ExtraPasses<'_>,
    ) -> Result<(), RenderError> {
        assert!(!ahead.is_full(), "a picture arrives before the next is submitted");
        let purpose = purpose_of(&extra, options);
        // One submission, which nobody divides.
        let options = &RenderOptions { divide_for_memory: false, ..*options };
        self.prepare(purpose, scene, camera, options)?;
        let Some(mut slot) = ahead.free.pop() else { return Ok(()) };
        let submitted = self.submit_slot(&mut slot, scene, camera, options, extra);
        self.note_drawn(submitted.is_ok());
        match submitted {
            Ok((ticket, capacities)) => ahead.pending.push_back((slot, ticket, capacities)),
            Err(error) => {
                slot.recorder.abandon();
                ahead.free.push(slot);
                return Err(error);
            }
        }
        Ok(())
    }

    fn submit_slot(
        &mut self,
        slot: &mut FrameSlot,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        mut extra: ExtraPasses<'_>,
    ) -> Result<(Ticket, Capacities), RenderError> {
        let purpose = purpose_of(&extra, options);
        self.prepare_extra(&mut extra)?;
        let (inputs, frame) = self.passes(purpose, scene, camera, options);
        let capacities = slot.record(&inputs, frame, &mut extra)?;
        let ticket = slot.recorder.submit()?;
        scene.changes_submitted();
        Ok((ticket, capacities))
    }
}
