//! Slab planning against the twin, walking whole scenes slab by slab.

use instgs_reference::plan_slab as twin;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::interface::types::DispatchArgs;
use instgs_vk::gpu::staging::{download, upload};
use instgs_vk::gpu::{Buffer, Grid, PipelineCache, Recorder};
use instgs_vk::kernels::{Pipelines, Purpose, SceneTraits, Variant, plan_slab};
use instgs_vk::math::rng::Rng;

use crate::common::gpu::{assert_silent, gpu};

#[test]
fn slabs_are_the_longest_that_fit() {
    let Some(gpu) = gpu() else { return };
    let cache = PipelineCache::new(&gpu, None).unwrap();
    let pipelines =
        Pipelines::new(&gpu, &cache, Variant::for_device(gpu.caps()), SceneTraits::plain(0), Purpose::Whole).unwrap();
    let mut rng = Rng::new(9);
    for (n, capacity, max_splats) in [(1, 5, 9), (500, 40, 1000), (500, 200, 7), (300, u32::MAX, u32::MAX), (0, 5, 5)] {
        let counts: Vec<u32> = (0..n).map(|_| 1 + rng.index(5) as u32).collect();
        let mut begin = 0;
        loop {
            // What the scan from `begin` leaves: zeros before, then running sums.
            let counted = counts.iter().enumerate().map(|(i, &c)| if i < begin { 0 } else { c });
            let (offsets, total) = instgs_reference::scan::exclusive_scan(&counted.collect::<Vec<_>>());
            let mut counters = vec![0; COUNTER_COUNT as usize];
            counters[COUNTER_VISIBLE as usize] = n as u32;
            counters[COUNTER_SLAB_BEGIN as usize] = begin as u32;
            counters[COUNTER_INTERSECTIONS as usize] = total;
            let mut counters = upload(&gpu, "counters", &counters).unwrap();
            let mut args = Buffer::<DispatchArgs>::new(&gpu, "args", (FAMILY_COUNT * ARGS_PER_COUNT) as usize).unwrap();
            let isect_offsets = upload(&gpu, "isect_offsets", &offsets).unwrap();
            let mut recorder = Recorder::new(&gpu).unwrap();
            let bindings =
                plan_slab::Bindings { isect_offsets: &isect_offsets, counters: &mut counters, args: &mut args };
            let params = plan_slab::Params { capacity, max_splats };
            recorder.dispatch(&pipelines.plan_slab, Grid::groups(1), &params, bindings).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            // What a lost device would be reported with.
            assert_eq!(recorder.last_pass_begun(), Some("plan_slab"));
            let got = download(&gpu, &counters, COUNTER_COUNT as usize).unwrap();
            let end = got[COUNTER_SLAB_END as usize] as usize;
            let want = twin::plan_slab(&counts, begin, capacity, max_splats as usize);
            assert_eq!((end, got[COUNTER_SLAB_INTERSECTIONS as usize]), want, "{n} splats from {begin}");
            if end >= n {
                break;
            }
            assert!(end > begin, "a slab takes at least one splat");
            begin = end;
        }
    }
    assert_silent(&gpu);
}
