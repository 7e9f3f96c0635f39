//! What every Gaussian adds to the pixels of every mask of a view: `A[i, m] = sum over pixels with mask m of alpha_i T_i`,
//! the derivative of those pixels' colours by the Gaussian's colour, for all masks at once (paper, Eq. 2-3).
//!
//! It replays `tile_blend` for the pixels of one *unit*: an 8x8 block and one of the mask ids in it. Most blocks have one
//! or two ids. A unit has one entry for each element of its tile's list, and each entry has one writer: no atomics, no
//! table that could be full. The host lists the units (`render::contributions`) and adds up the entries of a Gaussian.
//!
//! - Reads per unit: 40 bytes a splat, 28 of its footprint and 4 a list entry; ids and, after the first depth slab,
//!   transmittances of its pixels.
//! - Writes `contributions`: 8 bytes an entry, the source Gaussian and its sum; (0, 0) behind the end of all pixels.
//! - Grid: one subgroup per unit.
//! - Sums are fixed point, 2^-24 of a pixel: an entry is below 64 * 2^24 = 2^30, and the least weight that is blended,
//!   1e-4 / 255, is 6 units, so a Gaussian that is drawn never sums to 0. Integers add up to the same in any order:
//!   tile size, subgroup size, depth slabs and batches change nothing as long as alpha and T have the same bits.
//! - For plain clouds, where a Gaussian's index in its template is its index in the pool of sources.
//!
//! Twin: `reference::mask_contribution`. Test: `tests/kernels/mask_contribution.rs`.

pub use crate::gpu::interface::mask_contribution::{Bindings, MaskContribution, Params};
