//! Blends tiles: one subgroup per 8x8 block of pixels. See `glsl/tile_blend.comp`.

pub use crate::gpu::interface::tile_blend::{Bindings, Params, TileBlend};
