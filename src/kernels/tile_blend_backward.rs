//! Backward pass of the blend: replays each tile front to back and sums what its pixels say about each splat.
//!
//! One subgroup owns an 8x8 block, as in `tile_blend`, and walks the same list by the same rules. A pixel keeps T and
//! the sum over the splats still to come of weight times value, where value = (colour, 1) . g with g the cotangent by rgb and
//! by alpha minus background. With it dL/dalpha = T value - rest / (1 - alpha), without divisions of T.
//!
//! - Reads `splats` (40 bytes), `emission_from_isect` and `slot_from_emission` (8) per list entry; `colors` and
//!   `cotangents` (32 bytes a pixel).
//! - Writes `isect_moments`: 36 bytes per list entry and 8x8 block of its tile, at the emission index: entries of one splat
//!   are neighbours there, and each has one writer. No atomics, so the result is the same bits each time. Entries behind
//!   the end of all pixels get zeros.
//! - Grid: one subgroup per 8x8 block.
//! - Sums over lanes: with `TRANSPOSE`, `SUBGROUP_SIZE` splats at once in log2 steps: of two splats, lanes without the
//!   step's bit keep the first and get the partner's share of it, the others the second. At the end lane j holds
//!   splat j. Without, a butterfly for each splat.
//!
//! Twin: `reference::tile_blend_backward`. Test: `tests/kernels/tile_blend_backward.rs`.

pub use crate::gpu::interface::tile_blend_backward::{Bindings, Params, TileBlendBackward};
