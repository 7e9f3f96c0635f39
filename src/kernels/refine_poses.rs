//! One step of Adam on the places of instances.
//!
//! - The seven values of an instance are a step in the template's frame: A' = A e^s exp(w×), t' = t + A v for shift v,
//!   rotation vector w, logarithm of scale s. They start from 0 at every step, so no parametrisation can degenerate.
//! - Reads `pose_gradients`, reads and writes 7 moments and the transform (and the scale derived from it) of each instance.
//!   A is made a rotation times a scale again at every step.
//! - Grid: one thread per instance besides the background. Does nothing after an overflow (see `train_status`).
//!
//! Twin: `reference::poses`. Test: `tests/kernels/poses.rs`.

pub use crate::gpu::interface::refine_poses::{Bindings, Params, RefinePoses};
