//! Draws a living Gaussian for every dead and every new one, with probability proportional to its weight.
//!
//! - Reads `weights`, their exclusive scan `before` (by a binary search per draw) and `counters[COUNTER_WEIGHTS]`; random
//!   bits are a hash of (seed, steps done, index).
//! - Writes `origins`; counts in `copies` and `COUNTER_RELOCATED` (integer atomics: the order does not matter). If all
//!   are dead, every Gaussian stays what it is.
//! - Grid: one thread per Gaussian afterwards.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_pick::{Bindings, McmcPick, Params};
