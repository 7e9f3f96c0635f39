//! Packs a picture into the pixels of a window: 8 bits per colour, in the byte order of the window, scaled between the
//! centres of pixels if the sizes differ.
//!
//! - Reads by pixel of the picture, for the view that is shown: `colors`, `depths`, `tile_ranges`, `marks`, or `surfaces` and
//!   what they point into. If something is chosen, also `surfaces` of the pixel and its 24 neighbours.
//! - Reads `counters`: a picture that a buffer was too small for, or that a depth slab is missing of, is not shown.
//! - Writes `pixels`, by pixel of the window.
//! - Grid: one thread per pixel of the window. Bytes per pixel at equal sizes: 16 (depth: 8) read, 4 written.
//!
//! - SHOW, OUTLINE and SCALED are constants: a driver without jumps around code that is not needed (lavapipe) did the outline's
//!   125 reads for every pixel, which took half as long as blending.
//!
//! Twin: `reference::present`. Test: `tests/kernels/present.rs`.

pub use crate::gpu::interface::present::{Bindings, Params, Present};
