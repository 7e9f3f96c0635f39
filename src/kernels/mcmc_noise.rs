//! Moves centres at random after a step: `mean += strength gate(opacity) covariance n`, n standard normals.
//!
//! - `gate` is a steep sigmoid of 1 - opacity around 0.995: what is opaque stays.
//! - Reads quaternions, log scales, logits and the status; updates `means`. 36 bytes read, 24 for the means.
//! - Random numbers are a hash of (seed, step, index), so that a step done again moves as before. Does nothing after an
//!   overflow (see `train_status`).
//! - Grid: one thread per Gaussian.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_noise::{Bindings, McmcNoise, Params};
