//! Finds each tile's run: one thread per intersection (indirect). See `glsl/tile_ranges.comp`.

pub use crate::gpu::interface::tile_ranges::{Bindings, Params, TileRanges};
