//! Ends the forward half of a training step: raises the sticky overflow flag, and records loss and counts.
//!
//! - Reads `counters`, `ssim_sums`, `error_sums`; reads and writes `status`; writes one entry of `step_records`, a ring
//!   that the host reads some steps later.
//! - Grid: one work-group. Sums have a fixed order: thread by thread, then over threads.
//! - A step overflows if candidates, work items or intersections did not fit. From then on `adam` and
//!   `gather_gradients` do nothing, in this and all later steps, until the host has enlarged the buffers and reset the
//!   flag; it then submits the same steps again.
//!
//! Twin: `reference::train_status`. Test: `tests/kernels/train_status.rs`.

pub use crate::gpu::interface::train_status::{Bindings, Params, TrainStatus};
