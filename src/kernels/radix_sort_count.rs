//! First pass of a radix sort step: how often each digit occurs in each block of `BLOCK_SIZE` keys.
//!
//! A sort goes from the least significant digit to the highest that keys can have (`render/sort.rs`); every step is
//! this kernel, a scan of the histogram, and `radix_sort_scatter`. Depth keys take 4 steps; tile keys 1 up to 255
//! tiles, 2 up to 65535, then 3.
//!
//! - Reads `keys` (by place in the list) and `counters`.
//! - Writes `histogram`, digit-major: `digit * blocks + block`. In that order its exclusive scan is, for each digit and
//!   block, where the block's first key with that digit goes.
//! - Grid: one work-group per block, indirect (`ARGS_BLOCKS` of the keys' family).
//! - Bytes per key: 4 read, 0.5 written (256 counts of 4 bytes per 2048 keys). Shared memory: 1 KiB.
//! - Guarantees: counts do not depend on order: integer atomics in shared memory, or, where one subgroup is the whole
//!   work-group, one addition per distinct digit and round, found as in `radix_sort_scatter`. Keys past the count are
//!   not read.
//! - `RADIX_BITS` = 8 and so `RADIX_SIZE` = 256 counts; `BLOCK_SIZE` = 2048 keys keep the histogram an eighth of the
//!   keys.
//!
//! Twin: `reference::radix_sort`. Tests: `tests/kernels/radix_sort.rs`; also the start-up self-test in
//! `render/self_test.rs`.

pub use crate::gpu::interface::radix_sort_count::{Bindings, Params, RadixSortCount};
