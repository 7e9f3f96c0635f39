//! One step of Adam (Kingma and Ba 2015, algorithm 1) on a flat array of f32, in two groups (templates and background)
//! with a learning rate each.
//!
//! - Reads `gradients`; reads and writes `parameters` and `moments` (first and second, side by side). 28 bytes a value.
//! - Grid: one thread per four values.
//! - Bias corrections come from the host, so that a step that is done again gets the same numbers. Does nothing after an
//!   overflow (see `train_status`).
//!
//! Twin: `reference::adam`. Test: `tests/kernels/adam.rs`.

pub use crate::gpu::interface::adam::{Adam, Bindings, Params};
