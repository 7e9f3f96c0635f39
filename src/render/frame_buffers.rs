//! The buffers of one frame in flight: everything besides the scene.

use std::sync::Arc;

use crate::gpu::interface::constants::{ARGS_PER_COUNT, COUNTER_COUNT, FAMILY_COUNT, LAYER_BINS};
use crate::gpu::interface::types;
use crate::gpu::{Buffer, Gpu, GpuError};

use super::plan::FramePlan;
use super::scan::ScanScratch;
use super::sort::{DigitTables, SortBuffers};

/// Intermediate and output buffers, sized by a [`FramePlan`].
pub struct FrameBuffers {
    /// The plan that determined the sizes.
    pub plan: FramePlan,
    /// Initial counters of a frame, written by the host.
    pub counters_start: Buffer<u32>,
    /// Counters after the frame, read by the host.
    pub counters_end: Buffer<u32>,
    /// Chunks to test per instance, 0 if culled (see `cull_instances`).
    pub instance_chunks: Buffer<u32>,
    /// First candidate of each instance: exclusive scan of `instance_chunks`.
    pub candidate_offsets: Buffer<u32>,
    /// Instance and chunk of each candidate.
    pub candidates: Buffer<types::WorkItem>,
    /// 1 if the candidate may be seen.
    pub candidate_visible: Buffer<u32>,
    /// Work item of each visible candidate.
    pub work_offsets: Buffer<u32>,
    /// Visible (instance, chunk) pairs.
    pub work_items: Buffer<types::WorkItem>,
    /// Survivors per work item.
    pub survivor_counts: Buffer<u32>,
    /// First survivor of each work item in the list by depth: exclusive scan of `survivor_counts`.
    pub survivor_offsets: Buffer<u32>,
    /// Projected splats by slot.
    pub splats: Buffer<types::Splat>,
    /// Footprint of each splat, by slot.
    pub footprints: Buffer<types::Footprint>,
    /// Number of tiles of each splat, by slot.
    pub tile_counts: Buffer<u32>,
    /// Depth keys and slots, sorted by depth.
    pub depth_sort: SortBuffers,
    /// First intersection of each splat in depth order.
    pub isect_offsets: Buffer<u32>,
    /// Tile keys and slots (training: emission indices), sorted by tile.
    pub tile_sort: SortBuffers,
    /// Training: slot of each intersection before the sort; else one element.
    pub slot_from_emission: Buffer<u32>,
    /// Training: intersections of each slot before the sort; else one element.
    pub emission_ranges: Buffer<types::EmissionRange>,
    /// First and end intersection of each tile.
    pub tile_ranges: Buffer<[u32; 2]>,
    /// rgb over the background, and alpha, by pixel.
    pub colors: Buffer<[f32; 4]>,
    /// Expected view depth (in training nothing) and live transmittance, by pixel.
    pub depths: Buffer<[f32; 2]>,
    /// For frames in depth layers: chunks by depth.
    pub layer_bins: Buffer<u32>,
    /// By tile: closed tiles from this one to the right.
    pub closed_runs: Buffer<u32>,
    /// Scratch of scans and counters, shared by all passes.
    pub scratch: ScanScratch,
    /// Digit counts of both sorts.
    pub digit_tables: DigitTables,
}

impl FrameBuffers {
    /// Allocates the buffers of a plan.
    ///
    /// # Errors
    /// A buffer exceeds the device's limits; the error names it.
    pub fn new(gpu: &Arc<Gpu>, plan: FramePlan) -> Result<Self, GpuError> {
        let slots = plan.slots as usize;
        let candidates = plan.capacities.candidates as usize;
        let work_items = plan.capacities.work_items as usize;
        let instances = plan.instances as usize;
        let counters = COUNTER_COUNT as usize;
        let emissions = plan.capacities.intersections as usize;
        Ok(Self {
            plan,
            counters_start: Buffer::for_upload(gpu, "counters start", counters)?,
            counters_end: Buffer::for_readback(gpu, "counters end", counters)?,
            instance_chunks: Buffer::new(gpu, "instance_chunks", instances)?,
            candidate_offsets: Buffer::new(gpu, "candidate_offsets", instances)?,
            candidates: Buffer::new(gpu, "candidates", candidates)?,
            candidate_visible: Buffer::new(gpu, "candidate_visible", candidates)?,
            work_offsets: Buffer::new(gpu, "work_offsets", candidates)?,
            work_items: Buffer::new(gpu, "work_items", work_items)?,
            survivor_counts: Buffer::new(gpu, "survivor_counts", work_items)?,
            survivor_offsets: Buffer::new(gpu, "survivor_offsets", work_items)?,
            splats: Buffer::new(gpu, "splats", slots)?,
            footprints: Buffer::new(gpu, "footprints", slots)?,
            tile_counts: Buffer::new(gpu, "tile_counts", slots)?,
            depth_sort: SortBuffers::new(gpu, "depth sort", slots)?,
            isect_offsets: Buffer::new(gpu, "isect_offsets", slots)?,
            tile_sort: SortBuffers::new(gpu, "tile sort", plan.capacities.intersections as usize)?,
            slot_from_emission: Buffer::new(gpu, "slot_from_emission", if plan.training { emissions } else { 1 })?,
            emission_ranges: Buffer::new(gpu, "emission_ranges", if plan.training { slots } else { 1 })?,
            tile_ranges: Buffer::new(gpu, "tile_ranges", plan.tile_count() as usize)?,
            colors: Buffer::new(gpu, "colors", plan.pixels() as usize)?,
            depths: Buffer::new(gpu, "depths", plan.pixels() as usize)?,
            layer_bins: Buffer::new(gpu, "layer_bins", if plan.layered { LAYER_BINS as usize } else { 1 })?,
            closed_runs: Buffer::new(gpu, "closed_runs", if plan.layered { plan.tile_count() as usize } else { 1 })?,
            scratch: ScanScratch {
                block_sums: Buffer::new(gpu, "block_sums", plan.block_sums_len() as usize)?,
                counters: Buffer::new(gpu, "counters", counters)?,
                args: Buffer::new(gpu, "indirect args", (FAMILY_COUNT * ARGS_PER_COUNT) as usize)?,
            },
            digit_tables: DigitTables::new(gpu, plan.histogram_len() as usize)?,
        })
    }
}
