//! From photos and masks to an instanced scene. [`Pipeline::run`] runs all stages and reports to one [`Observer`]: the
//! plain cloud ([`instgs_train::train`]), masks ([`masks_from_prompt`], [`check_masks`]), the object of every Gaussian
//! ([`mod@label_gaussians`]), groups of objects that are alike with their poses ([`mod@register_objects`]), templates
//! with instances ([`mod@build_templates`]), and the joint phase. Each stage is also a function of its own.

mod before;
pub mod build_templates;
pub mod config;
mod error;
mod forecast;
mod job;
pub mod label_gaussians;
mod made_masks;
mod make_masks;
mod mask_check;
mod mask_source;
mod observer;
pub mod prepare;
pub mod register_objects;
mod run;
mod stage_kinds;

pub use build_templates::{MergedScene, build_templates};
pub use error::PipelineError;
pub use forecast::{Forecast, GroupForecast, MaskForecast, ObjectForecast, StartForecast, forecast};
pub use job::PipelineJob;
pub use label_gaussians::{CloudLabels, label_gaussians, training_views, write_cloud};
pub use make_masks::{masks_from_prompt, write_masks_from_boxes};
pub use mask_check::check_masks;
pub use mask_source::{MaskSource, mask_folder};
pub use observer::{Message, Observer, Phase};
pub use prepare::{Prepared, prepare};
pub use register_objects::{ObjectGroups, find_groups, register_objects};
pub use run::{Finished, ObjectPhases, Pipeline, check_same_method, check_same_stages, joint_has_begun};
pub use stage_kinds::{Stage, is_preparation, makes_scene};
