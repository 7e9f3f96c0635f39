//! Start-up test of scan and sort on the current device.

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types::DispatchArgs;
use crate::gpu::staging::{download, upload, write};
use crate::gpu::{Buffer, Gpu, GpuError, Recorder};
use crate::kernels::{Primitives, Variant};

use super::scan::ScanScratch;
use super::sort::{DigitTables, Sort, SortBuffers, record_sort};

/// Blocks of keys that are filled; one more holds the rest. Their histograms are scanned, and take more than two scan blocks:
/// with fewer keys no scan would carry the sum of one block to the next.
const FULL_BLOCKS: u32 = 2 * BLOCK_SIZE / RADIX_SIZE;
const TEST_LEN: u32 = FULL_BLOCKS * BLOCK_SIZE + 77;
const _: () = assert!(
    TEST_LEN.div_ceil(BLOCK_SIZE) * RADIX_SIZE > 2 * BLOCK_SIZE && !TEST_LEN.is_multiple_of(BLOCK_SIZE),
    "the scan's block sums and a partly filled block are part of the test"
);

/// Sorts known pairs, which also runs the scan, and compares with the host.
///
/// # Errors
/// `GpuError::SelfTest` with the first difference.
pub fn self_test(gpu: &Arc<Gpu>, primitives: &Primitives, variant: &Variant) -> Result<(), GpuError> {
    // A multiplicative hash to 11 bits: every digit value, and enough equal keys to detect an unstable sort.
    let keys: Vec<u32> = (0..TEST_LEN).map(|i| i.wrapping_mul(2_654_435_761) >> 21).collect();
    let values: Vec<u32> = (0..TEST_LEN).collect();
    let (got_keys, got_values) = sort_on_device(gpu, primitives, &keys, &values, 2)?;
    let mut want = values;
    want.sort_by_key(|&i| keys[i as usize]);
    let wrong = (0..want.len()).find(|&i| got_values[i] != want[i] || got_keys[i] != keys[want[i] as usize]);
    wrong.map_or(Ok(()), |i| {
        Err(GpuError::SelfTest {
            what: "scan and sort".into(),
            device: gpu.caps().name.clone(),
            subgroup_size: variant.subgroup_size,
            reason: format!("pair {i} should hold value {} and holds {}", want[i], got_values[i]),
        })
    })
}

/// Sorts pairs on the device by `passes` digits of 8 bits, outside any frame.
pub fn sort_on_device(
    gpu: &Arc<Gpu>,
    primitives: &Primitives,
    keys: &[u32],
    values: &[u32],
    passes: u32,
) -> Result<(Vec<u32>, Vec<u32>), GpuError> {
    let n = keys.len() as u32;
    let blocks = n.div_ceil(BLOCK_SIZE);
    let histogram_len = (blocks * RADIX_SIZE) as usize;
    let mut counters = vec![0; COUNTER_COUNT as usize];
    counters[COUNTER_VISIBLE as usize] = n;
    let mut args = vec![DispatchArgs::default(); (FAMILY_COUNT * ARGS_PER_COUNT) as usize];
    let family = FAMILY_VISIBLE * ARGS_PER_COUNT;
    args[(family + ARGS_BLOCKS) as usize] = DispatchArgs { x: blocks, y: 1, z: 1 };
    args[(family + ARGS_HISTOGRAM) as usize] =
        DispatchArgs { x: (blocks * RADIX_SIZE).div_ceil(BLOCK_SIZE), y: 1, z: 1 };
    let mut scratch = ScanScratch {
        block_sums: Buffer::new(gpu, "block_sums", histogram_len.div_ceil(BLOCK_SIZE as usize))?,
        counters: upload(gpu, "counters", &counters)?,
        args: upload(gpu, "args", &args)?,
    };
    let mut buffers = SortBuffers::new(gpu, "sort", keys.len())?;
    write(gpu, &mut buffers.keys, keys)?;
    write(gpu, &mut buffers.values, values)?;
    let mut tables = DigitTables::new(gpu, histogram_len)?;
    let mut recorder = Recorder::new(gpu)?;
    let sort = Sort { count_slot: COUNTER_VISIBLE, family: FAMILY_VISIBLE, passes };
    record_sort(&mut recorder, primitives, &mut scratch, &mut tables, sort, &mut buffers)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    Ok((download(gpu, &buffers.keys, keys.len())?, download(gpu, &buffers.values, values.len())?))
}
