//! The radix sort kernels against a stable sort.

use std::sync::Arc;

use instgs_reference::radix_sort::sort_pairs;
use instgs_vk::gpu::interface::constants::{BLOCK_SIZE, RADIX_BITS};
use instgs_vk::gpu::{Gpu, PipelineCache};
use instgs_vk::kernels::{Primitives, Variant};
use instgs_vk::math::rng::Rng;
use instgs_vk::render::self_test::sort_on_device;

use crate::common::gpu::{assert_silent, gpu};

fn primitives(gpu: &Arc<Gpu>, variant: &Variant) -> Primitives {
    Primitives::new(gpu, &PipelineCache::new(gpu, None).unwrap(), variant).unwrap()
}

/// The device's own variant; many subgroups per work-group, whose cross-subgroup prefix is another path; ballots; blocks
/// sorted in shared memory.
fn variants(gpu: &Gpu) -> Vec<Variant> {
    let own = Variant::for_device(gpu.caps());
    let many = Variant { radix_workgroup_size: 8 * own.subgroup_size, ..own };
    // What larger subgroups use.
    let ballots = Variant { match_by_ballot: true, ..own };
    let staged = Variant { stage_keys: true, match_by_ballot: true, ..many };
    vec![own, Variant { stage_keys: false, ..many }, ballots, Variant { stage_keys: false, ..staged }, staged]
}

#[test]
fn sorts_are_stable_and_complete() {
    let Some(gpu) = gpu() else { return };
    let mut rng = Rng::new(5);
    for variant in variants(&gpu) {
        let primitives = primitives(&gpu, &variant);
        // The last: more blocks than a round of `radix_sort_scan` takes.
        let many_blocks = ((variant.radix_workgroup_size + 1) * BLOCK_SIZE + 1) as usize;
        for n in [1, 3, 2047, 2048, 2049, 50_000, many_blocks] {
            // Hundreds of thousands of keys take CPU drivers long: once.
            for key_bits in if n == many_blocks { vec![13] } else { vec![1, 8, 13, 32] } {
                let mask = u32::MAX >> (32 - key_bits);
                let keys: Vec<u32> = (0..n).map(|_| rng.next_u32() & mask).collect();
                let values: Vec<u32> = (0..n as u32).collect();
                let got =
                    sort_on_device(&gpu, &primitives, &keys, &values, u32::div_ceil(key_bits, RADIX_BITS)).unwrap();
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
        let primitives = primitives(&gpu, &variant);
        let values: Vec<u32> = (0..10_000).rev().collect();
        let (_, got) = sort_on_device(&gpu, &primitives, &vec![7; 10_000], &values, 4).unwrap();
        assert!(got == values, "equal keys");
        let keys = [u32::MAX, 0, u32::MAX - 1, 1, u32::MAX, 0];
        let (keys, got) = sort_on_device(&gpu, &primitives, &keys, &[0, 1, 2, 3, 4, 5], 4).unwrap();
        assert_eq!((keys, got), (vec![0, 0, 1, u32::MAX - 1, u32::MAX, u32::MAX], vec![1, 5, 3, 2, 0, 4]));
    }
    assert_silent(&gpu);
}
