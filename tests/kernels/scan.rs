//! The three scan kernels against the twin, at lengths around the block and work-group sizes.

use std::sync::Arc;

use instgs_reference::scan::exclusive_scan;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::{download, upload};
use instgs_vk::gpu::{Buffer, Gpu, Grid, PipelineCache, Recorder};
use instgs_vk::kernels::Variant;
use instgs_vk::kernels::pipelines::ScanPipelines;
use instgs_vk::math::rng::Rng;
use instgs_vk::render::scan::{Blocks, ScanInput, ScanScratch, plain, record_scan};

use crate::common::gpu::{assert_silent, gpu};

/// Offsets, limited total, unlimited total and the arguments of the family, as the device computes them.
fn device_scan(
    gpu: &Arc<Gpu>,
    pipelines: &ScanPipelines,
    values: &[u32],
    indices: Option<&[u32]>,
    begin: u32,
    capacity: u32,
) -> (Vec<u32>, u32, u32, Vec<[u32; 3]>) {
    let n = indices.map_or(values.len(), <[u32]>::len);
    let mut counters = vec![0; COUNTER_COUNT as usize];
    counters[COUNTER_VISIBLE as usize] = n as u32;
    counters[COUNTER_SLAB_BEGIN as usize] = begin;
    let mut scratch = ScanScratch {
        block_sums: Buffer::new(gpu, "block_sums", n.div_ceil(BLOCK_SIZE as usize)).unwrap(),
        counters: upload(gpu, "counters", &counters).unwrap(),
        args: Buffer::new(gpu, "args", (FAMILY_COUNT * ARGS_PER_COUNT) as usize).unwrap(),
    };
    let values = upload(gpu, "values", values).unwrap();
    let indices = indices.map(|i| upload(gpu, "indices", i).unwrap());
    let mut offsets = Buffer::new(gpu, "offsets", n).unwrap();
    let mut scan = plain(COUNTER_VISIBLE);
    scan.begin_slot = COUNTER_SLAB_BEGIN;
    scan.total_slot = COUNTER_WORK_ITEMS;
    scan.needed_slot = COUNTER_WORK_ITEMS_NEEDED;
    scan.capacity = capacity;
    scan.family = FAMILY_VISIBLE;
    let input = ScanInput { values: &values, indices: indices.as_ref() };
    let mut recorder = Recorder::new(gpu).unwrap();
    let blocks = Blocks::Direct(Grid::threads(n as u32, BLOCK_SIZE));
    record_scan(&mut recorder, pipelines, &mut scratch, blocks, scan, input, &mut offsets).unwrap();
    let ticket = recorder.submit().unwrap();
    recorder.wait(ticket).unwrap();
    let counters = download(gpu, &scratch.counters, COUNTER_COUNT as usize).unwrap();
    let args = download(gpu, &scratch.args, scratch.args.len()).unwrap();
    let family = (FAMILY_VISIBLE * ARGS_PER_COUNT) as usize;
    let args = args[family..family + ARGS_PER_COUNT as usize].iter().map(|a| [a.x, a.y, a.z]).collect();
    let mut offsets = download(gpu, &offsets, n).unwrap();
    offsets.truncate(n);
    (offsets, counters[COUNTER_WORK_ITEMS as usize], counters[COUNTER_WORK_ITEMS_NEEDED as usize], args)
}

fn pipelines(gpu: &Arc<Gpu>) -> ScanPipelines {
    let cache = PipelineCache::new(gpu, None).unwrap();
    ScanPipelines::new(gpu, &cache, &Variant::for_device(gpu.caps())).unwrap()
}

#[test]
fn offsets_and_totals_equal_the_twin() {
    let Some(gpu) = gpu() else { return };
    let pipelines = pipelines(&gpu);
    let mut rng = Rng::new(11);
    for n in [1, 2, 7, 255, 256, 257, 2047, 2048, 2049, 40_000, 600_000] {
        let values: Vec<u32> = (0..n).map(|_| rng.index(50) as u32).collect();
        let (offsets, total, needed, _) = device_scan(&gpu, &pipelines, &values, None, 0, u32::MAX);
        let (want, want_total) = exclusive_scan(&values);
        assert_eq!((total, needed), (want_total, want_total), "length {n}");
        assert!(offsets == want, "length {n}");
    }
    assert_silent(&gpu);
}

#[test]
fn gathered_scans_begin_where_told() {
    let Some(gpu) = gpu() else { return };
    let pipelines = pipelines(&gpu);
    let mut rng = Rng::new(12);
    let values: Vec<u32> = (0..5000).map(|_| rng.index(9) as u32).collect();
    let mut indices: Vec<u32> = (0..5000).collect();
    rng.shuffle(&mut indices);
    for begin in [0, 1, 2047, 2048, 4999, 5000] {
        let (offsets, total, ..) = device_scan(&gpu, &pipelines, &values, Some(&indices), begin, u32::MAX);
        let counted = indices.iter().enumerate().map(|(i, &v)| if i < begin as usize { 0 } else { values[v as usize] });
        let (want, want_total) = exclusive_scan(&counted.collect::<Vec<_>>());
        assert!(total == want_total && offsets == want, "begin {begin}");
    }
    assert_silent(&gpu);
}

#[test]
fn sums_saturate_and_totals_are_limited() {
    let Some(gpu) = gpu() else { return };
    let pipelines = pipelines(&gpu);
    let values = vec![0x0100_0000; 5000];
    let (offsets, total, needed, args) = device_scan(&gpu, &pipelines, &values, None, 0, 70_000 * 2048);
    let (want, want_total) = exclusive_scan(&values);
    assert_eq!(want_total, u32::MAX, "the twin saturates");
    assert!(offsets == want && needed == u32::MAX && total == 70_000 * 2048);
    let workgroup = Variant::for_device(gpu.caps()).workgroup_size;
    let fold = |groups: u32| [groups.min(65535), groups.div_ceil(65535), 1];
    assert_eq!(args[ARGS_ITEMS as usize], fold(total));
    assert_eq!(args[ARGS_THREADS as usize], fold(total.div_ceil(workgroup)));
    assert_eq!(args[ARGS_BLOCKS as usize], fold(70_000));
    assert_silent(&gpu);
}
