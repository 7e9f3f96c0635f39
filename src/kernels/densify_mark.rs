//! Says for every Gaussian whether it stays, and whether it may grow: first pass of the strategy `densify`.
//!
//! - Reads the parameters (by Gaussian; all SH bands, to see whether they are numbers) and `screen_statistics`.
//! - Writes `keys` (bits of the mean screen gradient, inverted: the radix sort ascends) and `values` (the index) for the
//!   sort, `counts` (1 if it stays without growth), `gains` (how many more with growth) and `growths` (`GROWTH_*`).
//! - Gone are: what is not finite; opacity below the limit; with limits for large ones, what is wider than
//!   `radius_max_px` on screen or has a scale above `log_scale_max`. The copy of a clone and the children of a split
//!   Gaussian have not been on screen, and children are measured by their own scale.
//! - Grid: one thread per Gaussian. Bytes per Gaussian: 56 + 12 (degree + 1)^2 read, 20 written.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::densify_mark::{Bindings, DensifyMark, Params};
