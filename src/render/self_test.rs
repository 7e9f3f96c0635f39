//! Start-up test of scan and sort on the current device.

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::staging::{download, upload, write};
use crate::gpu::{Buffer, Gpu, GpuError, Recorder};
use crate::kernels::{Primitives, Variant};

use super::error::RenderError;
use super::scan::{Blocks, ScanInput, ScanScratch, plain, record_scan};
use super::sort::{DigitTables, Sort, SortBuffers, record_sort};

/// Several blocks, of which the last is partly filled: the scan carries sums from one to the next.
const TEST_LEN: u32 = 16 * BLOCK_SIZE + 77;

/// What `make` makes of a variant, or, if that fails the self-test, of the first of the others that passes it.
///
/// # Errors
/// Those of `make`; if all fail the test, the first one's.
pub(super) fn first_sound<V, T>(
    preferred: V,
    others: impl IntoIterator<Item = V>,
    mut make: impl FnMut(V) -> Result<T, RenderError>,
) -> Result<T, RenderError> {
    let fails_the_test =
        |result: &Result<T, RenderError>| matches!(result, Err(RenderError::Gpu(GpuError::SelfTest { .. })));
    let first = make(preferred);
    if !fails_the_test(&first) {
        return first;
    }
    others.into_iter().map(make).find(|result| !fails_the_test(result)).unwrap_or(first)
}

/// Scans and sorts known numbers, and compares with the host.
///
/// # Errors
/// `GpuError::SelfTest` with the first difference.
pub fn self_test(gpu: &Arc<Gpu>, primitives: &Primitives, variant: &Variant) -> Result<(), GpuError> {
    let failed = |what: &str, reason: String| GpuError::SelfTest {
        what: what.into(),
        device: gpu.caps().name.clone(),
        subgroup_size: variant.subgroup_size,
        reason,
    };
    // A multiplicative hash to 11 bits: every digit value, and enough equal keys to detect an unstable sort.
    let keys: Vec<u32> = (0..TEST_LEN).map(|i| i.wrapping_mul(2_654_435_761) >> 21).collect();
    let values: Vec<u32> = (0..TEST_LEN).collect();
    let sums = scan_on_device(gpu, primitives, &keys)?;
    let mut want = 0;
    for (i, (&sum, key)) in sums.iter().zip(&keys).enumerate() {
        if sum != want {
            return Err(failed("scan", format!("sum {i} should be {want} and is {sum}")));
        }
        want += key;
    }
    let (got_keys, got_values) = sort_on_device(gpu, primitives, &keys, &values, 2)?;
    let mut want = values;
    want.sort_by_key(|&i| keys[i as usize]);
    let wrong = (0..want.len()).find(|&i| got_values[i] != want[i] || got_keys[i] != keys[want[i] as usize]);
    wrong.map_or(Ok(()), |i| {
        Err(failed("sort", format!("pair {i} should hold value {} and holds {}", want[i], got_values[i])))
    })
}

/// The sums of all numbers before each.
fn scan_on_device(gpu: &Arc<Gpu>, primitives: &Primitives, values: &[u32]) -> Result<Vec<u32>, GpuError> {
    let mut scratch = ScanScratch::for_list(gpu, COUNTER_VISIBLE, FAMILY_VISIBLE, values.len() as u32)?;
    let (values, mut sums) = (upload(gpu, "values", values)?, Buffer::new(gpu, "sums", values.len())?);
    let mut recorder = Recorder::new(gpu)?;
    let blocks = Blocks::Indirect(FAMILY_VISIBLE * ARGS_PER_COUNT + ARGS_BLOCKS);
    let (scan, input) = (plain(COUNTER_VISIBLE), ScanInput::in_order(&values));
    record_scan(&mut recorder, &primitives.scan, &mut scratch, blocks, scan, input, &mut sums)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    download(gpu, &sums, sums.len())
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
    let mut scratch = ScanScratch::for_list(gpu, COUNTER_VISIBLE, FAMILY_VISIBLE, n)?;
    let mut buffers = SortBuffers::new(gpu, "sort", keys.len())?;
    write(gpu, &mut buffers.keys, keys)?;
    write(gpu, &mut buffers.values, values)?;
    let mut tables = DigitTables::new(gpu, (n.div_ceil(BLOCK_SIZE) * RADIX_SIZE) as usize)?;
    let mut recorder = Recorder::new(gpu)?;
    let sort = Sort { count_slot: COUNTER_VISIBLE, family: FAMILY_VISIBLE, passes };
    record_sort(&mut recorder, primitives, &mut scratch, &mut tables, sort, &mut buffers)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    Ok((download(gpu, &buffers.keys, keys.len())?, download(gpu, &buffers.values, values.len())?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sizes that are tried, and what comes of them: `fails` says how a size fails.
    fn tried(others: &[u32], fails: impl Fn(u32) -> Option<GpuError>) -> (Vec<u32>, Result<u32, RenderError>) {
        let mut sizes = Vec::new();
        let made = first_sound(32, others.iter().copied(), |size| {
            sizes.push(size);
            fails(size).map_or(Ok(size), |error| Err(error.into()))
        });
        (sizes, made)
    }

    fn unsound(subgroup_size: u32) -> GpuError {
        GpuError::SelfTest { what: "scan".into(), device: "a GPU".into(), subgroup_size, reason: String::new() }
    }

    #[test]
    fn the_first_size_that_passes_is_taken() {
        let (sizes, made) = tried(&[8, 16, 64], |size| (size != 16).then(|| unsound(size)));
        assert_eq!((sizes, made.ok()), (vec![32, 8, 16], Some(16)));
        let (sizes, made) = tried(&[8], |_| None);
        assert_eq!((sizes, made.ok()), (vec![32], Some(32)));
        // The one that was wanted is named; other errors end the search.
        let (sizes, made) = tried(&[8, 16], |size| Some(unsound(size)));
        assert!(sizes == [32, 8, 16] && made.is_err_and(|e| e.to_string().contains("subgroup size 32")));
        let (sizes, made) =
            tried(&[8, 16], |size| Some(if size == 8 { GpuError::Tuning("x".into()) } else { unsound(size) }));
        assert!(sizes == [32, 8] && made.is_err_and(|e| e.to_string().contains('x')));
    }
}
