//! Single splats as marks: every pixel gets the colour of the nearest splat whose mark covers it, darker towards the mark's rim.
//! For looking at Gaussians one by one; only pictures that show it pay for it.
//!
//! A mark is the ellipse of one standard deviation of the projected Gaussian, dilation included: within it the splat has at
//! least 61 % of its opacity, and ellipses of neighbours on a surface hardly overlap, whereas the whole footprint (3.3 standard
//! deviations where opaque) would hide all but the nearest. Or it is a disc of 1.5 pixels around the centre. Either ends where
//! the splat's alpha falls below a bound, so that large faint splats before the camera do not hide all else; the least bound is
//! 1/255, where the tiles' lists end.
//!
//! - Reads per 8x8 block: 40 bytes a splat and 4 a list entry, until all pixels of the block have a mark.
//! - Writes `marks`, 4 bytes a pixel, which the next slab goes on from.
//! - Grid: one subgroup per 8x8 block of every tile.
//!
//! Twin: `reference::tile_marks`. Test: `tests/kernels/tile_marks.rs`.

pub use crate::gpu::interface::tile_marks::{Bindings, Params, TileMarks};
