//! Records a stable radix sort of (u32 key, u32 value) pairs, least significant digit first.

use std::sync::Arc;

use crate::gpu::interface::constants::{ARGS_BLOCKS, ARGS_PER_COUNT, RADIX_BITS, RADIX_SIZE};
use crate::gpu::{Buffer, Gpu, GpuError, Grid, Recorder};
use crate::kernels::pipelines::Primitives;
use crate::kernels::{radix_sort_count, radix_sort_scan, radix_sort_scatter};

use super::scan::ScanScratch;

/// Keys and values, with a second pair of buffers that the sort alternates with.
pub struct SortBuffers {
    /// Keys of the pairs: input before, sorted after.
    pub keys: Buffer<u32>,
    /// Values of the pairs.
    pub values: Buffer<u32>,
    other_keys: Buffer<u32>,
    other_values: Buffer<u32>,
}

impl SortBuffers {
    /// Allocates buffers for `len` pairs.
    pub fn new(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Ok(Self {
            keys: Buffer::new(gpu, &format!("{name} keys"), len)?,
            values: Buffer::new(gpu, &format!("{name} values"), len)?,
            other_keys: Buffer::new(gpu, &format!("{name} keys, other half"), len)?,
            other_values: Buffer::new(gpu, &format!("{name} values, other half"), len)?,
        })
    }
}

/// Scratch of a sort.
pub struct DigitTables {
    /// `RADIX_SIZE` numbers per block of `BLOCK_SIZE` pairs, digit by digit: counts, then those of earlier blocks.
    histogram: Buffer<u32>,
    /// Pairs by digit.
    totals: Buffer<u32>,
}

impl DigitTables {
    /// Tables with a histogram of `len` counts; see `FramePlan::histogram_len`.
    pub fn new(gpu: &Arc<Gpu>, len: usize) -> Result<Self, GpuError> {
        let histogram = Buffer::new(gpu, "histogram", len)?;
        Ok(Self { histogram, totals: Buffer::new(gpu, "digit_totals", RADIX_SIZE as usize)? })
    }
}

/// Number of pairs and of digits of a sort.
#[derive(Clone, Copy, Debug)]
pub struct Sort {
    /// Counter that holds the number of pairs.
    pub count_slot: u32,
    /// Family of indirect arguments derived from that counter.
    pub family: u32,
    /// Number of 8-bit digits to sort by.
    pub passes: u32,
}

/// Records the sort; afterwards `buffers.keys` and `.values` hold the result.
pub fn record_sort(
    recorder: &mut Recorder,
    primitives: &Primitives,
    scratch: &mut ScanScratch,
    tables: &mut DigitTables,
    sort: Sort,
    buffers: &mut SortBuffers,
) -> Result<(), GpuError> {
    let DigitTables { histogram, totals: digit_totals } = tables;
    let args = |kind: u32| (sort.family * ARGS_PER_COUNT + kind) as usize;
    for pass in 0..sort.passes {
        let shift = pass * RADIX_BITS;
        let count = radix_sort_count::Bindings { keys: &buffers.keys, counters: &scratch.counters, histogram };
        let params = radix_sort_count::Params { count_slot: sort.count_slot, shift };
        recorder.dispatch_indirect(&primitives.sort.count, &scratch.args, args(ARGS_BLOCKS), &params, count)?;
        let scan = radix_sort_scan::Bindings { counters: &scratch.counters, histogram, digit_totals };
        let params = radix_sort_scan::Params { count_slot: sort.count_slot };
        recorder.dispatch(&primitives.sort.scan, Grid::groups(RADIX_SIZE), &params, scan)?;
        let scatter = radix_sort_scatter::Bindings {
            keys_in: &buffers.keys,
            values_in: &buffers.values,
            counters: &scratch.counters,
            earlier_blocks: histogram,
            keys_out: &mut buffers.other_keys,
            values_out: &mut buffers.other_values,
            digit_totals,
        };
        let params = radix_sort_scatter::Params { count_slot: sort.count_slot, shift };
        recorder.dispatch_indirect(&primitives.sort.scatter, &scratch.args, args(ARGS_BLOCKS), &params, scatter)?;
        std::mem::swap(&mut buffers.keys, &mut buffers.other_keys);
        std::mem::swap(&mut buffers.values, &mut buffers.other_values);
    }
    Ok(())
}
