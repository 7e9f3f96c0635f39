//! Templates of repeated objects. Turns a trained plain cloud, a label per Gaussian and posed groups into an
//! instanced scene for joint training.
//!
//! Each instance's Gaussians are moved to the common pose (`common_pose`). The template is drawn from all of them,
//! `template.count_factor` times as many as an instance has on average (`sample`). Every template Gaussian is then
//! matched to one of each instance's own (`matching`). It becomes the mean of its matches (`settle`), and the
//! difference to a match is that instance's first offset (`offsets`). Template Gaussians with nothing near in an
//! instance start there at opacity 0.01.
//!
//! Measurements of drawing, matching and settling: `docs/notes/objects.md`.

pub mod adopt;
pub mod assemble;
mod common_pose;
pub mod error;
mod instance_cloud;
mod matching;
mod offsets;
pub mod options;
pub mod report;
mod sample;
mod settle;
mod template_cloud;

pub use adopt::{Adopted, Adopter};
pub use assemble::{Built, build};
pub use error::TemplateError;
pub use instance_cloud::MIN_INSTANCE_GAUSSIANS;
pub use options::{Doubles, Keep, OffsetInit, OffsetKinds, Sampling, TemplateOptions, TemplateSource, Unmatched};
pub use report::{GroupReport, HOPELESS_MATCH, InstanceReport, POOR_MATCH};
