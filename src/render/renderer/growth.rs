//! How far buffers grow, by the counters of a frame that they were too small for.

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;

use super::super::error::RenderError;
use super::super::image_frames::Needs;
use super::super::layers::LayerNeeds;
use super::super::plan::{Capacities, grown};
use super::{Counters, Renderer, check_fits, max_slab_splats};

/// Largest intersection buffer that is grown to: 2^26 pairs take 1 GiB (16 bytes each); beyond that, slabs.
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
    /// Enlarges buffers, of capacities `have`, that the frame overflowed. `max_chunks` is that of the options.
    ///
    /// # Errors
    /// More candidates than the device can hold.
    pub(super) fn grow(
        &mut self,
        chunk_pairs: u64,
        have: Capacities,
        counters: &Counters,
        max_chunks: Option<u32>,
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
            let most = self.most_work_items(max_chunks);
            if work_items > most {
                return Ok(Growth::Beyond { most });
            }
            // Never more than the scene has, so that a plain cloud is not over-allocated.
            let pairs = u32::try_from(chunk_pairs).unwrap_or(u32::MAX);
            self.capacities.work_items = grown(work_items, most).min(pairs.max(work_items));
            return Ok(Growth::Grown);
        }
        Ok(Growth::Fits)
    }

    /// The largest number of visible chunks whose splats a buffer can hold.
    pub(super) fn most_work_items(&self, max_chunks: Option<u32>) -> u32 {
        let most_slots = (self.gpu.caps().max_storage_bytes / size_of::<types::Splat>() as u64).min(1 << 31) as u32;
        (most_slots / self.variant.workgroup_size).min(max_chunks.unwrap_or(u32::MAX))
    }

    /// Enlarges the buffers that an earlier frame overflowed, for frames that are recorded from now on.
    ///
    /// # Errors
    /// Larger buffers do not help: the frame takes more than one depth slab.
    pub(in super::super) fn grow_for_next(&mut self, counters: &Counters, needs: Needs) -> Result<(), RenderError> {
        let before = self.capacities;
        let layers = LayerNeeds::of_frame(counters);
        let most = |of: fn(&LayerNeeds) -> u32| layers.iter().map(of).max().unwrap_or(0);
        let mut counters = *counters;
        counters[COUNTER_WORK_ITEMS_NEEDED as usize] = most(|layer| layer.work_items);
        let growth = self.grow(needs.chunk_pairs, needs.have, &counters, needs.max_chunks)?;
        if let Growth::Beyond { most } = growth {
            check_fits("visible chunks", counters[COUNTER_WORK_ITEMS_NEEDED as usize], most)?;
        }
        if growth == Growth::Grown {
            // A later frame may have raised the capacities already.
            self.capacities.candidates = self.capacities.candidates.max(before.candidates);
            self.capacities.work_items = self.capacities.work_items.max(before.work_items);
            return Ok(());
        }
        let most_splats = max_slab_splats(&self.gpu, &self.variant);
        check_fits("splats of a picture in one depth slab", most(|layer| layer.visible), most_splats)?;
        let needed = most(|layer| layer.intersections);
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
