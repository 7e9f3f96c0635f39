//! Chooses the next depth slab: the longest run of splats, from where the last slab ended, whose intersections fit the
//! buffer (DESIGN section 3, Rules: depth slabs).
//!
//! The offset of splat e is the number of intersections of splats `begin..e`. They ascend, so the end is found by
//! bisection: the largest e whose offset is at most `capacity`, then at most `begin + max_splats`.
//!
//! - Reads `isect_offsets` (by place in depth order, counted from the slab's begin) and `counters`.
//! - Writes `COUNTER_SLAB_END`, `COUNTER_SLAB_INTERSECTIONS`, and the indirect arguments of `FAMILY_SLAB_SPLATS` and
//!   `FAMILY_INTERSECTIONS`.
//! - Grid: one work-group, of which one thread works.
//! - Bytes: 4 read per step, about log2(visible) steps if not all fits; 8 written to counters, 96 to arguments.
//! - Guarantees: `FramePlan` makes `capacity` at least the number of tiles, so a slab takes at least one splat and the
//!   slabs end. Every splat is in exactly one slab. Offsets saturate at 2^32 - 1, which is more than any capacity: a
//!   count that overflows reads as "does not fit", never as a small number.
//! - `max_splats` keeps each tile's list within a driver's loop limit: 15/16 of the limit times the subgroup size where
//!   there is one (lavapipe: 65535 iterations), since `tile_blend` takes one iteration per subgroup of splats; else
//!   2^32 - 1.
//!
//! Twin: `reference::plan_slab`. Tests: `tests/kernels/plan_slab.rs`, `overflow.rs`.

pub use crate::gpu::interface::plan_slab::{Bindings, Params, PlanSlab};
