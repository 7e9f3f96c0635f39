//! Fixed-point opacities of living Gaussians, for exact draws: first pass of a relocation.
//!
//! - Reads all parameters (by Gaussian; SH to see whether they are numbers). Writes `weights` (0 for dead ones: opacity up
//!   to the limit, or not finite) and zeros to `copies`.
//! - Grid: one thread per Gaussian. Bytes per Gaussian: 44 + 12 (degree + 1)^2 read, 8 written.
//! - The host picks `one` so that the sum fits 32 bits: opacities are multiples of 2^-20 up to 4096 Gaussians, of
//!   2^-12 for a million.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_weigh::{Bindings, McmcWeigh, Params};
