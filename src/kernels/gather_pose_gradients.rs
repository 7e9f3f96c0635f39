//! Sums the gradients by the places of instances.
//!
//! - Reads, per instance, the work items of its chunks that were not culled (as `gather_gradients`), and there one record
//!   of 28 bytes per subgroup of `preprocess_instance_expand_backward`.
//! - Writes `pose_gradients`, 28 bytes per instance; 0 for one that is out of sight.
//! - Grid: one work-group per instance besides the background. Threads sum records of their own, one thread sums the
//!   threads: the order is always the same.
//!
//! Twin: `reference::poses`. Test: `tests/kernels/poses.rs`.

pub use crate::gpu::interface::gather_pose_gradients::{Bindings, GatherPoseGradients, Params};
