//! `made[j] = copies[origins[j]]`: how many others share the place of a Gaussian after a relocation.
//!
//! - Grid: one thread per Gaussian afterwards. 8 bytes read, 4 written.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_gather_copies::{Bindings, McmcGatherCopies, Params};
