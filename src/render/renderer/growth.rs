//! How far buffers grow, by the counters of a frame that they were too small for.

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;
use crate::gpu::{Buffer, GpuError};

use super::super::error::RenderError;
use super::super::frame_buffers::FrameBuffers;
use super::super::image_frames::Needs;
use super::super::layers::LayerNeeds;
use super::super::plan::{Capacities, FramePlan, PAIR_BYTES, SLOT_BYTES, grown};
use super::super::render_options::RenderOptions;
use super::{Counters, Renderer, check_fits, longest_list};

/// Largest intersection buffer that is grown to: 2^26 pairs take 1 GiB; beyond that, slabs.
const MOST_INTERSECTIONS: u64 = 1 << 26;

/// What buffers needed after a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Growth {
    /// Nothing.
    Fits,
    /// They will be larger: the frame must be redone.
    Grown,
    /// There are more visible chunks than a buffer can have.
    Beyond {
        /// The most that it can have.
        most: u32,
    },
}

impl Renderer {
    /// Enlarges buffers, of capacities `have`, that the frame overflowed, up to `most_work_items`.
    ///
    /// # Errors
    /// More candidates than the device can hold.
    pub(super) fn grow(
        &mut self,
        chunk_pairs: u64,
        have: Capacities,
        counters: &Counters,
        most_work_items: u32,
    ) -> Result<Growth, RenderError> {
        let candidates = counters[COUNTER_CANDIDATES_NEEDED as usize];
        let work_items = counters[COUNTER_WORK_ITEMS_NEEDED as usize];
        let most_candidates = (self.gpu.caps().max_storage_bytes / size_of::<types::WorkItem>() as u64) as u32;
        if candidates > have.candidates {
            check_fits("chunks of visible instances", candidates, most_candidates)?;
            self.capacities.candidates = grown(candidates, most_candidates);
            return Ok(Growth::Grown);
        }
        if work_items > have.work_items {
            if work_items > most_work_items {
                return Ok(Growth::Beyond { most: most_work_items });
            }
            // Never more than the scene has, so that a plain cloud is not over-allocated.
            let pairs = u32::try_from(chunk_pairs).unwrap_or(u32::MAX);
            self.capacities.work_items = grown(work_items, most_work_items).min(pairs.max(work_items));
            return Ok(Growth::Grown);
        }
        Ok(Growth::Fits)
    }

    /// The largest number of visible chunks whose splats a buffer can hold, at most `max_chunks`.
    fn most_work_items(&self, max_chunks: Option<u32>) -> u32 {
        let most_slots = (self.gpu.caps().max_storage_bytes / size_of::<types::Splat>() as u64).min(1 << 31) as u32;
        (most_slots / self.variant.workgroup_size).min(max_chunks.unwrap_or(u32::MAX))
    }

    /// The same for a frame with these options: if memory may divide it, also the largest number that there was memory for.
    pub(super) fn most_work_items_of(&self, options: &RenderOptions) -> u32 {
        let of_memory = if options.divide_for_memory { self.most_chunks } else { u32::MAX };
        self.most_work_items(options.max_chunks).min(of_memory)
    }

    /// The buffers of a frame that memory may divide. Since such frames fill what memory there is, fails if there is none left
    /// for the picture's way to the host.
    pub(super) fn divisible_buffers(&self, plan: FramePlan) -> Result<FrameBuffers, GpuError> {
        let frame = FrameBuffers::new(&self.gpu, plan)?;
        drop(Buffer::<[f32; 4]>::for_readback(&self.gpu, "readback", plan.pixels() as usize)?);
        Ok(frame)
    }

    /// Halves what takes most of `plan`, for which there is no memory; false if nothing is left to halve. Fewer intersections
    /// lead to more depth slabs, down to those of one splat, and fewer chunks, if the frame is `divisible`, to depth ranges.
    pub(super) fn make_do_with_less(&mut self, plan: &FramePlan, divisible: bool) -> bool {
        let Capacities { intersections, work_items, .. } = plan.capacities;
        let halves_pairs = intersections > plan.tile_count();
        let halves_chunks = divisible && work_items > 1;
        let pairs_take_more = u64::from(intersections) * PAIR_BYTES > u64::from(plan.slots) * SLOT_BYTES;
        if halves_chunks && (!halves_pairs || !pairs_take_more) {
            self.most_chunks = work_items / 2;
        } else if halves_pairs {
            self.most_intersections = intersections / 2;
        }
        halves_pairs || halves_chunks
    }

    /// Enlarges the buffers that an earlier frame overflowed, for frames that are recorded from now on.
    ///
    /// # Errors
    /// Larger buffers do not help: the frame takes more than one depth slab.
    pub(in super::super) fn grow_for_next(&mut self, counters: &Counters, needs: Needs) -> Result<(), RenderError> {
        let before = self.capacities;
        let layers = LayerNeeds::of_frame(counters);
        let largest = |of: fn(&LayerNeeds) -> u32| layers.iter().map(of).max().unwrap_or(0);
        let mut counters = *counters;
        counters[COUNTER_WORK_ITEMS_NEEDED as usize] = largest(|layer| layer.work_items);
        let most_work_items = self.most_work_items(needs.max_chunks);
        let growth = self.grow(needs.chunk_pairs, needs.have, &counters, most_work_items)?;
        if let Growth::Beyond { most } = growth {
            check_fits("visible chunks", counters[COUNTER_WORK_ITEMS_NEEDED as usize], most)?;
        }
        if growth == Growth::Grown {
            // A later frame may have raised the capacities already.
            self.capacities.candidates = self.capacities.candidates.max(before.candidates);
            self.capacities.work_items = self.capacities.work_items.max(before.work_items);
            return Ok(());
        }
        let most_splats = longest_list(&self.gpu, &self.variant);
        check_fits("splats of a picture in one depth slab", largest(|layer| layer.visible), most_splats)?;
        let needed = largest(|layer| layer.intersections);
        let most = self.most_intersections_of_device();
        let allowed = most.min(self.most_intersections).min(needs.max_intersections.unwrap_or(u32::MAX));
        check_fits(
            "(splat, tile) pairs of a picture in one depth slab",
            needed,
            allowed.max(needs.have.intersections),
        )?;
        self.capacities.intersections = self.capacities.intersections.max(grown(needed, most));
        Ok(())
    }

    /// The largest number of (splat, tile) pairs that buffers grow to.
    pub(super) fn most_intersections_of_device(&self) -> u32 {
        (self.gpu.caps().max_storage_bytes / 4).min(MOST_INTERSECTIONS) as u32
    }
}
