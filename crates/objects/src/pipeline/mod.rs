//! L6: from photos and masks to an instanced scene: masks ([`make_masks`], [`mask_check`]), the object of every Gaussian
//! ([`label_gaussians`]()), which objects are alike and where they stand ([`register_objects`]()), and templates with
//! instances ([`build_templates`]()). The plain cloud before and the joint phase after are [`mod@crate::train`]'s.

pub mod build_templates;
mod error;
pub mod label_gaussians;
pub mod make_masks;
pub mod mask_check;
pub mod mask_source;
pub mod prepare;
pub mod register_objects;
mod stage_kinds;

pub use build_templates::{MergedScene, build_templates};
pub use error::PipelineError;
pub use label_gaussians::{CloudLabels, label_gaussians, training_views};
pub use make_masks::{masks_from_prompt, write_masks_from_boxes};
pub use mask_check::check_masks;
pub use mask_source::{MaskSource, mask_folder};
pub use prepare::{Prepared, prepare};
pub use register_objects::{ObjectGroups, register_objects};
pub use stage_kinds::{is_preparation, makes_scene};
