//! Lets the Gaussians with the largest mean screen gradients grow, up to the cap.
//!
//! - Reads `order` (Gaussians by descending gradient, ties by index), `gains` and their exclusive scan in that order, and
//!   `counters[COUNTER_KEPT]`. A Gaussian grows if it and all before it fit.
//! - Updates `counts` (how many the Gaussian becomes) and `growths`; adds to `COUNTER_CLONED` and `COUNTER_SPLIT`
//!   (integer atomics: the order does not matter).
//! - Grid: one thread per place in the order. Bytes per Gaussian: 20 read, 8 written.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::densify_select::{Bindings, DensifySelect, Params};
