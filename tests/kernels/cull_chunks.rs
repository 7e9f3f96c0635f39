//! Culling never loses a chunk that shows, and does drop what is far outside.

use std::collections::BTreeSet;

use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download;
use instgs_vk::kernels::Variant;
use instgs_vk::reference::compact::compact;
use instgs_vk::reference::cull_chunks::{CHUNK_SIZE, visible_chunks};
use instgs_vk::render::Renderer;
use instgs_vk::render::forward::read_counters;

use crate::common::gpu::{assert_silent, device_options, gpu};
use crate::common::random_scene::random_case;

#[test]
fn every_chunk_that_shows_survives() {
    let Some(gpu) = gpu() else { return };
    let variant = Variant::for_device(gpu.caps());
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut kept, mut pairs) = (0, 0);
    for seed in 0..100 {
        let case = random_case(seed);
        let scene = renderer.upload(&case.scene).unwrap();
        renderer.render(&scene, &case.camera, &device_options(&case.options)).unwrap();
        let frame = renderer.frame().unwrap();
        let counters = read_counters(frame);
        let work_items = counters[COUNTER_WORK_ITEMS as usize] as usize;
        let candidates = counters[COUNTER_CANDIDATES as usize] as usize;
        let flags = download(&gpu, &frame.candidate_visible, candidates).unwrap();
        let listed = download(&gpu, &frame.candidates, candidates).unwrap();
        let want: Vec<_> =
            compact(&flags.iter().map(|&f| f != 0).collect::<Vec<_>>()).iter().map(|&c| listed[c as usize]).collect();
        let items = download(&gpu, &frame.work_items, work_items).unwrap();
        assert!(items == want, "seed {seed}: the work list is the compacted candidates");
        let got: Vec<(u32, u32)> = items.iter().map(|w| (w.instance, w.chunk)).collect();
        assert!(got.is_sorted(), "seed {seed}: work items are in flat order");
        // The twin's chunks are of CHUNK_SIZE Gaussians; the device's of its work-group size.
        let per_chunk = CHUNK_SIZE / variant.workgroup_size;
        let got: BTreeSet<(u32, u32)> = got.into_iter().map(|(i, c)| (i, c / per_chunk)).collect();
        for item in visible_chunks(&case.scene, &case.camera, &case.options) {
            assert!(got.contains(&(item.instance, item.chunk)), "seed {seed}: {item:?} was culled");
        }
        kept += work_items as u64;
        pairs += scene.chunk_pairs;
    }
    println!("culling kept {kept} of {pairs} chunks");
    // The cameras look at one instance of several: a test that keeps nearly everything culls nothing.
    assert!(kept * 100 < pairs * 95, "kept {kept} of {pairs} chunks");
    assert_silent(&gpu);
}
