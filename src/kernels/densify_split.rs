//! Shrinks the children of split Gaussians and places them at random inside the Gaussian they come from.
//!
//! - Reads `origins`, `made` and `quats`; updates `means` and `log_scales` of children, which hold the parent's before.
//! - The place is `mean + R diag(scale) n` with standard normals n from a hash of (seed, steps done, old index, number of
//!   the child): see `reference::random`.
//! - Grid: one thread per new Gaussian. Bytes: 4 read per Gaussian, 68 more per child.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::densify_split::{Bindings, DensifySplit, Params};
