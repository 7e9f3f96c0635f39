//! Records a stable radix sort of (u32 key, u32 value) pairs, least significant digit first.

use std::sync::Arc;

use crate::gpu::interface::constants::{ARGS_BLOCKS, ARGS_HISTOGRAM, ARGS_PER_COUNT, RADIX_BITS};
use crate::gpu::{Buffer, Gpu, GpuError, Recorder};
use crate::kernels::pipelines::Primitives;
use crate::kernels::{radix_sort_count, radix_sort_scatter};

use super::scan::{Blocks, ScanInput, ScanScratch, plain, record_scan};

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

/// Scratch of a sort: digit counts, `RADIX_SIZE` per block of `BLOCK_SIZE` pairs, digit by digit.
pub struct DigitTables {
    histogram: Buffer<u32>,
    offsets: Buffer<u32>,
}

impl DigitTables {
    /// Tables of `len` counts; see `FramePlan::histogram_len`.
    pub fn new(gpu: &Arc<Gpu>, len: usize) -> Result<Self, GpuError> {
        let (histogram, offsets) = (Buffer::new(gpu, "histogram", len)?, Buffer::new(gpu, "digit_offsets", len)?);
        Ok(Self { histogram, offsets })
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
    let DigitTables { histogram, offsets: digit_offsets } = tables;
    let args = |kind: u32| (sort.family * ARGS_PER_COUNT + kind) as usize;
    for pass in 0..sort.passes {
        let shift = pass * RADIX_BITS;
        let count = radix_sort_count::Bindings { keys: &buffers.keys, counters: &scratch.counters, histogram };
        let params = radix_sort_count::Params { count_slot: sort.count_slot, shift };
        recorder.dispatch_indirect(&primitives.sort.count, &scratch.args, args(ARGS_BLOCKS), &params, count)?;
        let mut scan = plain(sort.count_slot);
        scan.histogram = 1;
        let blocks = Blocks::Indirect(args(ARGS_HISTOGRAM) as u32);
        record_scan(recorder, &primitives.scan, scratch, blocks, scan, ScanInput::in_order(histogram), digit_offsets)?;
        let scatter = radix_sort_scatter::Bindings {
            keys_in: &buffers.keys,
            values_in: &buffers.values,
            counters: &scratch.counters,
            digit_offsets,
            keys_out: &mut buffers.other_keys,
            values_out: &mut buffers.other_values,
        };
        let params = radix_sort_scatter::Params { count_slot: sort.count_slot, shift };
        recorder.dispatch_indirect(&primitives.sort.scatter, &scratch.args, args(ARGS_BLOCKS), &params, scatter)?;
        std::mem::swap(&mut buffers.keys, &mut buffers.other_keys);
        std::mem::swap(&mut buffers.values, &mut buffers.other_values);
    }
    Ok(())
}
