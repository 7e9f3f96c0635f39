//! Why no instanced scene could be built.

use crate::math::similarity::SimilarityError;

/// What is wrong with the input of [`build`](super::build); one line for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TemplateError {
    /// An array of the cloud has another length than its means call for.
    #[error("the cloud has {len} {array} where {want} fit its means")]
    Cloud {
        /// Which array.
        array: &'static str,
        /// Its length.
        len: usize,
        /// The length that fits.
        want: usize,
    },
    /// There must be one label per Gaussian.
    #[error("{labels} labels for {gaussians} Gaussians: there must be one each")]
    LabelCount {
        /// Labels given.
        labels: usize,
        /// Gaussians of the cloud.
        gaussians: usize,
    },
    /// A group lists no instance.
    #[error("group {template_id} has no instance; leave it out")]
    EmptyGroup {
        /// The group's `template_id`.
        template_id: u32,
    },
    /// Two groups share a template id.
    #[error("two groups have template_id {template_id}; join them or number them anew")]
    RepeatedTemplate {
        /// The id.
        template_id: u32,
    },
    /// An instance id is 0, which means background, or is listed twice.
    #[error("group {template_id}: instance id {id} {reason}")]
    InstanceId {
        /// The group's `template_id`.
        template_id: u32,
        /// The id.
        id: u32,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// A pose is no similarity.
    #[error("group {template_id}, instance {id}: world_from_template {reason}")]
    Pose {
        /// The group's `template_id`.
        template_id: u32,
        /// The instance's mask id.
        id: u32,
        /// Why not.
        reason: SimilarityError,
    },
    /// An option is out of range.
    #[error("{option} is {value}, but must be {want}")]
    Option {
        /// Which option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        want: &'static str,
    },
    /// More Gaussians or offset records than 32-bit indices count.
    #[error("{count} {what}: at most 4294967294 can be indexed; use fewer Gaussians (count_factor) or instances")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        count: u64,
    },
}
