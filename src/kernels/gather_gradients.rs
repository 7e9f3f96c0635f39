//! Sums the gradients of all instances of a template and turns them into gradients by its parameters.
//!
//! - Reads, per chunk of source Gaussians, its template's instances in order; for each the work item of that chunk, if it
//!   was not culled (`instance_chunks`, `candidate_offsets`, `candidate_visible`, `work_offsets`), and there 72 bytes per
//!   Gaussian. Background Gaussians have one instance.
//! - Writes gradients by mean, quaternion (not normalised), log scales, logit and the active SH bands: 44 + 12 (degree + 1)^2
//!   bytes; adds to `screen_statistics` (what densification decides by).
//! - If the scene has offsets of shape or of SH bands above 0 (ablations), writes their gradients, and those by shape are
//!   made per instance; records that are not drawn must hold zeros before.
//! - Grid: one work-group per chunk. The order of the sum is that of the instances: no atomics.
//! - Does nothing after an overflow (see `train_status`).
//!
//! Twin: `reference::gather_gradients`. Test: `tests/kernels/gather_gradients.rs`.

pub use crate::gpu::interface::gather_gradients::{Bindings, GatherGradients, Params};
