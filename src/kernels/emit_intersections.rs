//! Writes one (tile, slot) pair per tile that a splat of the slab touches, in depth order (DESIGN section 3, pass 5).
//!
//! - Reads `slot_from_order` and `isect_offsets` (by place in depth order), `footprints` and `tile_counts` (by slot),
//!   and `counters` for the slab's begin and end.
//! - Writes `tile_keys` (row-major tile index) and `slot_from_isect`, both by intersection,
//!   `0..COUNTER_SLAB_INTERSECTIONS`.
//! - Grid: one thread per splat of the slab, indirect (`FAMILY_SLAB_SPLATS`, `ARGS_THREADS`).
//! - Bytes per splat: 40 read (slot 4, offset 4, count 4, footprint 28); 8 written per intersection.
//! - Guarantees: pairs are in depth order, within a splat by ascending tile, so the stable sort by tile leaves every
//!   tile's list in depth order. Tiles are found by the functions that counted them (`tile_rows` and `tile_columns` in
//!   `glsl/include/splat.glsl`, `precise`) on the same stored bits; a thread writes exactly the counted number of pairs
//!   and never past `capacity`. If the two ever differed, the remaining pairs would get a tile outside the image, which
//!   `tile_ranges` skips.
//! - A tile row takes the columns whose rectangle of pixel centres meets the ellipse alpha >= 1/255: tighter than the
//!   bounding box, and never short of a pixel that the splat reaches.
//!
//! Twin: `reference::emit_intersections`; which tiles a splat hits: `reference::preprocess_instance_expand::tiles_hit`.
//! Test: `tests/kernels/intersections.rs`.

pub use crate::gpu::interface::emit_intersections::{Bindings, EmitIntersections, Params};
