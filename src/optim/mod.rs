//! Adam on the device, with one set of moments per parameter buffer; the poses of instances and the exposures of photos.

pub mod adam;
pub mod exposures;
pub mod poses;

pub use adam::{Adam, AdamBuffers, MomentBuffer, ValueGroups, zero_moments};
pub use exposures::{ExposedView, Exposure, ExposureStep, Exposures, NO_EXPOSURE};
pub use poses::{POSE_VALUES, PoseBuffers};
