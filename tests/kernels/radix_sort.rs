//! The radix sort kernels against a stable sort.

use std::sync::Arc;

use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::interface::types::DispatchArgs;
use instgs_vk::gpu::staging::{download, upload, write};
use instgs_vk::gpu::{Buffer, Gpu, PipelineCache, Recorder};
use instgs_vk::kernels::Variant;
use instgs_vk::kernels::pipelines::{ScanPipelines, SortPipelines};
use instgs_vk::math::rng::Rng;
use instgs_vk::reference::radix_sort::sort_pairs;
use instgs_vk::render::scan::ScanScratch;
use instgs_vk::render::sort::{Sort, SortBuffers, record_sort};

use crate::common::gpu::{assert_silent, gpu};

fn device_sort(gpu: &Arc<Gpu>, variant: &Variant, keys: &[u32], values: &[u32], passes: u32) -> (Vec<u32>, Vec<u32>) {
    let cache = PipelineCache::new(gpu, None).unwrap();
    let scan = ScanPipelines::new(gpu, &cache, variant).unwrap();
    let sort = SortPipelines::new(gpu, &cache, variant).unwrap();
    let n = keys.len();
    let blocks = n.div_ceil(BLOCK_SIZE as usize);
    let histogram_len = blocks.max(1) * RADIX_SIZE as usize;
    let mut counters = vec![0; COUNTER_COUNT as usize];
    counters[COUNTER_VISIBLE as usize] = n as u32;
    let mut args = vec![DispatchArgs::default(); (FAMILY_COUNT * ARGS_PER_COUNT) as usize];
    let family = (FAMILY_VISIBLE * ARGS_PER_COUNT) as usize;
    let groups = |x: usize| DispatchArgs { x: x as u32, y: 1, z: 1 };
    args[family + ARGS_BLOCKS as usize] = groups(blocks);
    args[family + ARGS_HISTOGRAM as usize] = groups((blocks * RADIX_SIZE as usize).div_ceil(BLOCK_SIZE as usize));
    let mut scratch = ScanScratch {
        block_sums: Buffer::new(gpu, "block_sums", histogram_len.div_ceil(BLOCK_SIZE as usize)).unwrap(),
        counters: upload(gpu, "counters", &counters).unwrap(),
        args: upload(gpu, "args", &args).unwrap(),
    };
    let mut buffers = SortBuffers::new(gpu, "test", n).unwrap();
    write(gpu, &mut buffers.keys, keys).unwrap();
    write(gpu, &mut buffers.values, values).unwrap();
    let mut histogram = Buffer::new(gpu, "histogram", histogram_len).unwrap();
    let mut digit_offsets = Buffer::new(gpu, "digit_offsets", histogram_len).unwrap();
    let mut recorder = Recorder::new(gpu).unwrap();
    let what = Sort { count_slot: COUNTER_VISIBLE, family: FAMILY_VISIBLE, passes };
    let tables = (&mut histogram, &mut digit_offsets);
    record_sort(&mut recorder, (&scan, &sort), &mut scratch, tables, what, &mut buffers).unwrap();
    let ticket = recorder.submit().unwrap();
    recorder.wait(ticket).unwrap();
    (download(gpu, &buffers.keys, n).unwrap(), download(gpu, &buffers.values, n).unwrap())
}

/// The device's own variant, and one with many subgroups per work-group, whose cross-subgroup prefix is another path.
fn variants(gpu: &Gpu) -> Vec<Variant> {
    let own = Variant::for_device(gpu.caps());
    let many = Variant { radix_workgroup_size: 8 * own.subgroup_size, ..own };
    vec![own, many]
}

#[test]
fn sorts_are_stable_and_complete() {
    let Some(gpu) = gpu() else { return };
    let mut rng = Rng::new(5);
    for variant in variants(&gpu) {
        for n in [1, 3, 2047, 2048, 2049, 50_000] {
            for key_bits in [1, 8, 13, 32] {
                let mask = u32::MAX >> (32 - key_bits);
                let keys: Vec<u32> = (0..n).map(|_| rng.next_u32() & mask).collect();
                let values: Vec<u32> = (0..n as u32).collect();
                let got = device_sort(&gpu, &variant, &keys, &values, u32::div_ceil(key_bits, RADIX_BITS));
                assert!(got == sort_pairs(&keys, &values), "{n} keys of {key_bits} bits, {variant:?}");
            }
        }
    }
    assert_silent(&gpu);
}

#[test]
fn equal_keys_keep_their_order_and_extremes_their_place() {
    let Some(gpu) = gpu() else { return };
    for variant in variants(&gpu) {
        let values: Vec<u32> = (0..10_000).rev().collect();
        let (_, got) = device_sort(&gpu, &variant, &vec![7; 10_000], &values, 4);
        assert!(got == values, "equal keys");
        let keys = [u32::MAX, 0, u32::MAX - 1, 1, u32::MAX, 0];
        let (keys, got) = device_sort(&gpu, &variant, &keys, &[0, 1, 2, 3, 4, 5], 4);
        assert_eq!((keys, got), (vec![0, 0, 1, u32::MAX - 1, u32::MAX, u32::MAX], vec![1, 5, 3, 2, 0, 4]));
    }
    assert_silent(&gpu);
}
