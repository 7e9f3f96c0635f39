//! Finds each tile's run in the intersections sorted by tile (DESIGN section 3, pass 6).
//!
//! - Reads `tile_keys` (by sorted intersection) and `counters`.
//! - Writes `tile_ranges` (by tile): first intersection and one past the last.
//! - Grid: one thread per intersection, indirect (`FAMILY_INTERSECTIONS`, `ARGS_THREADS`).
//! - Bytes per intersection: 12 read (a key and its two neighbours, which the cache mostly holds); per tile that has
//!   any, 8 written.
//! - Guarantees: the first intersection of a run writes the start and the last one the end, so every word has one
//!   writer. Tiles without intersections keep the zeros that the buffer is filled with before, an empty run. Keys
//!   outside the image (see `emit_intersections`) are skipped.
//!
//! Twin: `reference::tile_ranges`. Test: `tests/kernels/intersections.rs` (the runs against the sorted keys).

pub use crate::gpu::interface::tile_ranges::{Bindings, Params, TileRanges};
