//! Pictures that are on their way: the host prepares the next one while the device draws. For steady display, where nobody
//! looks at a picture before it is shown.
//!
//! A picture that is submitted so must be right with the buffers as they are, in one depth slab. Whether it was is known
//! when it arrives; until then kernel `present` looks for itself and keeps the pixels of the picture before.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::timeline::Ticket;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::extra_passes::ExtraPasses;
use super::forward::{counters_of, record_slab, record_visibility, write_counters};
use super::plan::Capacities;
use super::renderer::{Counters, FrameStats, RenderOptions, Renderer};

/// Pictures on their way at most: one that the device draws and one that the host prepares. More would only make what one
/// sees older.
pub const FRAMES_IN_FLIGHT: usize = 2;

/// Pictures on their way.
pub struct Ahead {
    free: Vec<Slot>,
    /// Oldest first.
    pending: VecDeque<(Slot, Ticket, Capacities)>,
}

/// What a picture needs for itself: what the device reads at its start and the host at its end.
struct Slot {
    recorder: Recorder,
    counters_start: Buffer<u32>,
    counters_end: Buffer<u32>,
}

/// A picture whose drawing is over.
#[derive(Clone, Debug, PartialEq)]
pub enum Arrived {
    /// It is as [`Renderer::render`] would have drawn it.
    Complete(FrameStats),
    /// A buffer was too small, or it takes several slabs: it has to be drawn by [`Renderer::render`], which sees to that, or,
    /// for [`ImageFrames`](super::ImageFrames), recorded anew.
    Incomplete,
}

impl Ahead {
    /// With none on its way; every pass is timed.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        let slot = || -> Result<Slot, RenderError> {
            Ok(Slot {
                recorder: Recorder::with_profiler(gpu)?,
                counters_start: Buffer::for_upload(gpu, "counters start", COUNTER_COUNT as usize)?,
                counters_end: Buffer::for_readback(gpu, "counters end", COUNTER_COUNT as usize)?,
            })
        };
        let free = (0..FRAMES_IN_FLIGHT).map(|_| slot()).collect::<Result<_, _>>()?;
        Ok(Self { free, pending: VecDeque::new() })
    }

    /// True if one must arrive before the next is submitted.
    pub fn is_full(&self) -> bool {
        self.free.is_empty()
    }

    /// How many are on their way.
    pub fn pending_len(&self) -> usize {
        self.pending.len()
    }

    /// Waits for the oldest; `None` if none is on its way.
    pub fn arrive(&mut self) -> Result<Option<Arrived>, RenderError> {
        let Some((slot, ticket, capacities)) = self.pending.pop_front() else { return Ok(None) };
        slot.recorder.wait(ticket)?;
        let mut arrived = arrived_of(&counters_of(&slot.counters_end), capacities);
        if let Arrived::Complete(stats) = &mut arrived {
            stats.passes_ms = slot.recorder.passes_ms()?;
        }
        self.free.push(slot);
        Ok(Some(arrived))
    }
}

/// What the counters after a picture say of it, whose buffers had room for `capacities`.
pub(super) fn arrived_of(counters: &Counters, capacities: Capacities) -> Arrived {
    let count = |slot: u32| u64::from(counters[slot as usize]);
    let complete = count(COUNTER_CANDIDATES_NEEDED) <= u64::from(capacities.candidates)
        && count(COUNTER_WORK_ITEMS_NEEDED) <= u64::from(capacities.work_items)
        && count(COUNTER_SLAB_END) >= count(COUNTER_VISIBLE);
    if !complete {
        return Arrived::Incomplete;
    }
    Arrived::Complete(FrameStats {
        work_items: count(COUNTER_WORK_ITEMS),
        visible: count(COUNTER_VISIBLE),
        intersections: count(COUNTER_SLAB_INTERSECTIONS),
        slabs: 1,
        redone: 0,
        passes_ms: Vec::new(),
    })
}

impl Renderer {
    /// Submits a picture without waiting for it; [`Ahead::arrive`] tells what became of it. Submissions that follow see the
    /// picture as after [`Renderer::render_with`].
    ///
    /// # Errors
    /// As [`Renderer::render`].
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
        self.prepare(scene, camera, options)?;
        let Some(mut slot) = ahead.free.pop() else { return Ok(()) };
        match self.submit_slot(&mut slot, scene, camera, options, extra) {
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
        slot: &mut Slot,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        mut extra: ExtraPasses<'_>,
    ) -> Result<(Ticket, Capacities), RenderError> {
        self.prepare_extra(&mut extra)?;
        let (inputs, frame) = self.passes(scene, camera, options);
        let mut counters = [0; COUNTER_COUNT as usize];
        counters[COUNTER_INSTANCES as usize] = scene.instance_count;
        write_counters(&mut slot.counters_start, &counters);
        let bytes = slot.counters_start.bytes();
        slot.recorder.copy(&slot.counters_start, &mut frame.scratch.counters, bytes)?;
        record_visibility(&mut slot.recorder, &inputs, frame)?;
        record_slab(&mut slot.recorder, &inputs, frame)?;
        extra.record(&mut slot.recorder, &inputs, frame)?;
        slot.recorder.copy(&frame.scratch.counters, &mut slot.counters_end, bytes)?;
        let ticket = slot.recorder.submit()?;
        scene.changes_submitted();
        Ok((ticket, frame.plan.capacities))
    }
}
