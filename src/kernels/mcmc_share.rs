//! Opacity and scales of Gaussians that share a place, such that together they look like the one before.
//!
//! - With n of them, the old opacity o and the new p: `1 - (1 - p)^n = o`, and scales change by the factor
//!   `o / sum over m of C(n, m) (-1)^(m-1) p^m / sqrt(m)` (Kheradmand et al. 2024, eq. 9). n counts up to 51, as in the
//!   authors' code; p is not below the limit of death.
//! - Reads `made` (n - 1; 0 = nothing to do); updates `opacity_logits` and `log_scales`.
//! - The sum alternates; the kernel integrates an equal integral of positive values, the twin adds the paper's terms.
//! - Grid: one thread per Gaussian. 4 bytes read, 32 more where n > 1.
//!
//! Twin: `reference::mcmc`. Test: `tests/kernels/mcmc.rs`.

pub use crate::gpu::interface::mcmc_share::{Bindings, McmcShare, Params};
