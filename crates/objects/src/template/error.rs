//! Errors of building an instanced scene.

use instgs_vk::math::similarity::SimilarityError;

/// What is wrong with the input of [`build`](super::build); the text is one line for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TemplateError {
    /// An array of the cloud does not have the length that its means require.
    #[error("the cloud has {len} {array} but its means need {want}")]
    Cloud {
        /// Name of the array in the cloud.
        array: &'static str,
        /// Actual length of the array.
        len: usize,
        /// Length that the means require.
        want: usize,
    },
    /// The number of labels is not the number of Gaussians.
    #[error("{labels} labels for {gaussians} Gaussians: there must be one each")]
    LabelCount {
        /// Number of labels given.
        labels: usize,
        /// Number of Gaussians of the cloud.
        gaussians: usize,
    },
    /// A group lists no instances.
    #[error("group {template_id} has no instance; leave it out")]
    EmptyGroup {
        /// The group's `template_id`.
        template_id: u32,
    },
    /// Two groups have the same template id.
    #[error("two groups have template_id {template_id}; merge or renumber them")]
    RepeatedTemplate {
        /// The id that both have.
        template_id: u32,
    },
    /// An instance id is 0, which means background, or is listed twice.
    #[error("group {template_id}: instance id {id} {reason}")]
    InstanceId {
        /// The group's `template_id`.
        template_id: u32,
        /// The faulty instance id.
        id: u32,
        /// What is wrong with the id.
        reason: &'static str,
    },
    /// A pose is not a similarity.
    #[error("group {template_id}, instance {id}: world_from_template {reason}")]
    Pose {
        /// The group's `template_id`.
        template_id: u32,
        /// Mask id of the instance.
        id: u32,
        /// Why it is no similarity.
        reason: SimilarityError,
    },
    /// An option is out of range.
    #[error("{option} is {value}, but must be {want}")]
    Option {
        /// Name of the option that is out of range.
        option: &'static str,
        /// Value that was given.
        value: f64,
        /// Values that are allowed.
        want: &'static str,
    },
    /// More Gaussians or offset records than 32-bit indices count.
    #[error("{count} {what}: at most 4294967294 can be indexed; use fewer Gaussians (count_factor) or instances")]
    TooMany {
        /// Name of what is counted.
        what: &'static str,
        /// How many there would be.
        count: u64,
    },
}
