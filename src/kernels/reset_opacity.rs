//! Lowers opacity logits to a limit and zeroes their moments: INRIA's opacity reset.
//!
//! - Grid: one thread per Gaussian. 4 bytes read, 12 written.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::reset_opacity::{Bindings, Params, ResetOpacity};
