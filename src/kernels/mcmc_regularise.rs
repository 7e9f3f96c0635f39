//! Adds the gradients of two terms of the loss, mean opacity and mean scale, between backward pass and Adam.
//!
//! - Reads log scales, logits and the status; updates their gradients. Does nothing after an overflow.
//! - Grid: one thread per Gaussian. 32 bytes read, 16 written.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_regularise::{Bindings, McmcRegularise, Params};
