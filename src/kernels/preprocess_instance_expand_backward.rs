//! Backward pass of `preprocess_instance_expand`: from moments on the screen to gradients in the template's frame.
//!
//! - Reads, per survivor: its `isect_moments` (36 bytes for each tile and block, a contiguous run), splat, footprint, mean, rotation,
//!   scales, offsets, SH bands 1-3 (they turn with the view direction, which depends on the mean).
//! - Writes `source_gradients` (72 bytes), at work item times work-group size plus index in the chunk, which
//!   `gather_gradients` finds without a search; the rest of the buffer must hold zeros. Writes the gradients of the
//!   offsets, whose only owner is this thread.
//! - With POSES, writes the gradient by the instance's place, summed over each subgroup: 28 bytes per subgroup of a work
//!   item, but for the background.
//! - Grid: one work-group per work item, indirect; threads beyond the survivors idle.
//! - Exact derivatives of the forward pass: conic by -P G P, antialias compensation with its floor, the slope clamp (no
//!   gradient to x where clamped; z keeps its own), the colour clamp at 0, SH direction into the mean.
//! - Gradients by shape stay gradients by the template's covariance here, 6 numbers: their sum over instances is turned
//!   into quaternion and scales once.
//!
//! Twin: `reference::preprocess_instance_expand_backward`. Test: `tests/kernels/preprocess_instance_expand_backward.rs`.

pub use crate::gpu::interface::preprocess_instance_expand_backward::{
    Bindings, Params, PreprocessInstanceExpandBackward,
};
