//! The Gaussian at the surface of every pixel: whose splat brings the transmittance below one half. For picking, for lines
//! around what is chosen, and for views of instances, templates and offsets; only pictures that need it pay for it.
//!
//! It replays `tile_blend` without colours, and ends where all pixels of a block have their surface.
//!
//! - Reads per 8x8 block: 40 bytes a splat and 4 a list entry, as far as it gets; after the first depth slab, the pixels'
//!   state.
//! - Writes `surfaces`, 8 bytes a pixel: the instance and the index in its template. Before the last slab, the slot and the
//!   transmittance so far, which the next slab goes on from.
//! - Grid: one subgroup per 8x8 block of every tile.
//! - The background's own instance is one more than the last; of a level of detail, its `owner` is written.
//!
//! Twin: `reference::tile_surface`. Test: `tests/kernels/tile_surface.rs`.

pub use crate::gpu::interface::tile_surface::{Bindings, Params, TileSurface};
