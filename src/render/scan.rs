//! Records the three passes of a device-wide exclusive scan.

use std::sync::Arc;

use crate::gpu::interface::constants::{ARGS_BLOCKS, ARGS_PER_COUNT, BLOCK_SIZE, COUNTER_COUNT, FAMILY_COUNT};
use crate::gpu::interface::types;
use crate::gpu::staging::upload;
use crate::gpu::{Buffer, Gpu, GpuError, Grid, Recorder};
use crate::kernels::pipelines::ScanPipelines;
use crate::kernels::{scan_downsweep, scan_reduce, scan_spine};

/// Buffers that the scans of a frame share.
pub struct ScanScratch {
    /// One sum per block; long enough for the longest scan.
    pub block_sums: Buffer<u32>,
    /// Device-side counts, `COUNTER_*`.
    pub counters: Buffer<u32>,
    /// Indirect arguments, `FAMILY_*` times `ARGS_PER_COUNT`.
    pub args: Buffer<types::DispatchArgs>,
}

impl ScanScratch {
    /// Scratch for lists of `count` elements outside any frame: counter `count_slot` is `count`, the others are zero, and of
    /// the arguments only `ARGS_BLOCKS` of `family` is set.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn for_list(gpu: &Arc<Gpu>, count_slot: u32, family: u32, count: u32) -> Result<Self, GpuError> {
        let mut counters = [0; COUNTER_COUNT as usize];
        counters[count_slot as usize] = count;
        let blocks = count.div_ceil(BLOCK_SIZE);
        let Grid { x, y } = Grid::groups(blocks);
        let mut args = vec![types::DispatchArgs::default(); (FAMILY_COUNT * ARGS_PER_COUNT) as usize];
        args[(family * ARGS_PER_COUNT + ARGS_BLOCKS) as usize] = types::DispatchArgs { x, y, z: 1 };
        Ok(Self {
            block_sums: Buffer::new(gpu, "block_sums", blocks as usize)?,
            counters: upload(gpu, "counters", &counters)?,
            args: upload(gpu, "args", &args)?,
        })
    }
}

/// Source of the number of work-groups of a scan.
#[derive(Clone, Copy, Debug)]
pub enum Blocks {
    /// The grid, if the host knows the number of elements.
    Direct(Grid),
    /// Index into the indirect arguments.
    Indirect(u32),
}

/// The values of a scan and their order.
#[derive(Clone, Copy)]
pub struct ScanInput<'a> {
    /// The values that are summed.
    pub values: &'a Buffer<u32>,
    /// Their order: element i of the scan is `values[indices[i]]`. `None` = as they lie in the buffer.
    pub indices: Option<&'a Buffer<u32>>,
}

impl<'a> ScanInput<'a> {
    /// `values` in the order of the buffer.
    pub fn in_order(values: &'a Buffer<u32>) -> Self {
        Self { values, indices: None }
    }
}

/// A scan over `counters[count_slot]` elements that writes no totals.
pub fn plain(count_slot: u32) -> types::Scan {
    types::Scan {
        count_slot,
        begin_slot: COUNTER_COUNT,
        total_slot: COUNTER_COUNT,
        needed_slot: COUNTER_COUNT,
        capacity: u32::MAX,
        family: FAMILY_COUNT,
    }
}

/// Records `offsets[i] = sum of values[0..i]`, or of `values[indices[0..i]]`. Sums saturate.
pub fn record_scan(
    recorder: &mut Recorder,
    pipelines: &ScanPipelines,
    scratch: &mut ScanScratch,
    blocks: Blocks,
    scan: types::Scan,
    input: ScanInput<'_>,
    offsets: &mut Buffer<u32>,
) -> Result<(), GpuError> {
    let ScanInput { values, indices: gather } = input;
    let indices = gather.unwrap_or(values);
    let ScanScratch { block_sums, counters, args } = scratch;
    let (reduce, downsweep) = match gather {
        Some(_) => (&pipelines.reduce_gather, &pipelines.downsweep_gather),
        None => (&pipelines.reduce, &pipelines.downsweep),
    };
    let params = scan_reduce::Params { scan };
    let bindings = scan_reduce::Bindings { values, indices, counters, block_sums };
    match blocks {
        Blocks::Direct(grid) => recorder.dispatch(reduce, grid, &params, bindings)?,
        Blocks::Indirect(set) => recorder.dispatch_indirect(reduce, args, set as usize, &params, bindings)?,
    }
    let spine = scan_spine::Bindings { block_sums, counters, args };
    recorder.dispatch(&pipelines.spine, Grid::groups(1), &scan_spine::Params { scan }, spine)?;
    let params = scan_downsweep::Params { scan };
    let bindings = scan_downsweep::Bindings { values, indices, counters, block_sums, offsets };
    match blocks {
        Blocks::Direct(grid) => recorder.dispatch(downsweep, grid, &params, bindings),
        Blocks::Indirect(set) => recorder.dispatch_indirect(downsweep, args, set as usize, &params, bindings),
    }
}
