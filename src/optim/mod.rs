//! Adam on the device, with one set of moments per parameter buffer.

pub mod adam;
pub mod poses;

pub use adam::{Adam, AdamBuffers, MomentBuffer, ValueGroups, zero_moments};
pub use poses::{POSE_VALUES, PoseBuffers};
