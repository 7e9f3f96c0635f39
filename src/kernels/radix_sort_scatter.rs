//! Second pass of a radix sort step: moves every key and its value to their place by one digit.
//!
//! Each subgroup owns a contiguous run of its block's keys and walks it in rounds of one key per lane. A table in
//! shared memory holds the next free place per subgroup and digit; within a round, a lane's rank is the number of lower
//! lanes with the same digit (by shuffles or ballots: `Variant::match_by_ballot`).
//!
//! - Reads `keys_in` and `values_in` (by place before), `digit_offsets` (`digit * blocks + block`: the scanned
//!   histogram), `counters`.
//! - Writes `keys_out` and `values_out` (by place after).
//! - Grid: one work-group per block, indirect (`ARGS_BLOCKS` of the keys' family).
//! - Bytes per key: 8 read (12 with more than one subgroup, which count their own digits first) and 0.5 of offsets; 8
//!   written. Shared memory: 1 KiB per subgroup.
//! - Guarantees: stable: equal digits keep their order across lanes, rounds, subgroups and blocks. A permutation: every
//!   key is written once, to a place of its own. Deterministic: the atomics are integer counts in shared memory, and
//!   nothing is appended in the order of arrival.
//!
//! Twin: `reference::radix_sort`. Tests: `tests/kernels/radix_sort.rs` (lengths, key widths, equal keys, variants);
//! also the start-up self-test in `render/self_test.rs`, since some drivers miscompile some subgroup sizes.

pub use crate::gpu::interface::radix_sort_scatter::{Bindings, Params, RadixSortScatter};
