//! How templates are made.

use serde::{Deserialize, Serialize};

use super::error::TemplateError;

/// Which Gaussians a template is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TemplateSource {
    /// All instances' Gaussians in the common pose: what one view of the object lacks, another has.
    #[default]
    Merge,
    /// The reference instance's alone: the group's first (the first that has Gaussians).
    Single,
    /// Those of the instance with the most Gaussians alone.
    Max,
}

/// How the template's Gaussians are drawn from its source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// One, at random, of each of N runs of a Morton curve: of each octree voxel as many as its share of the cloud.
    #[default]
    Voxel,
    /// Farthest points within long runs of that curve: even spacing, but strays and large Gaussians are preferred.
    Farthest,
    /// Any, with equal probability.
    Random,
}

/// What a template keeps of a Gaussian that was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// Everything. The scales were trained for about the density that the template has, so they fit.
    #[default]
    All,
    /// Position and base colour, as in the paper. The rest starts anew: round, as large as the root mean square
    /// distance to the three nearest, opacity 0.1, SH of degree 1 and above 0.
    PositionAndColour,
}

/// What offsets start from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OffsetInit {
    /// The difference from the template's Gaussian to its match among the instance's own.
    #[default]
    Difference,
    /// Zero: every instance starts as the template.
    Zero,
}

/// Which parameters differ between instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffsetKinds {
    /// Means.
    pub position: bool,
    /// SH coefficient 0.
    pub sh_dc: bool,
    /// Opacity logits.
    pub opacity: bool,
    /// SH coefficients 1 and above. For ablations; costs 180 bytes per record at degree 3.
    pub sh_rest: bool,
    /// Log scales and quaternions. For ablations; costs 28 bytes per record.
    pub covariance: bool,
}

impl OffsetKinds {
    /// False if instances have nothing of their own but their place.
    pub fn any(&self) -> bool {
        self.position || self.sh_dc || self.opacity || self.sh_rest || self.covariance
    }
}

impl Default for OffsetKinds {
    /// The paper's: position, base colour, opacity.
    fn default() -> Self {
        Self { position: true, sh_dc: true, opacity: true, sh_rest: false, covariance: false }
    }
}

/// Options of [`build`](super::build).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemplateOptions {
    /// Which Gaussians a template is made of.
    pub source: TemplateSource,
    /// How they are drawn.
    pub sampling: Sampling,
    /// What is kept of each.
    pub keep: Keep,
    /// What offsets start from.
    pub offsets: OffsetInit,
    /// Which parameters get offsets; the others' stay zero or, for the ablations, empty.
    pub kinds: OffsetKinds,
    /// Template Gaussians per mean number of Gaussians of an instance, above 0. A template never has more than its
    /// source.
    pub count_factor: f64,
    /// How often a merged template is made the mean of what it stands for in the instances; 0 = it stays as drawn.
    pub settle_rounds: u32,
    /// A group whose match distance ([`GroupReport::match_distance`](super::GroupReport::match_distance)) is above this
    /// stays in the background; `None` = all become templates.
    pub worst_match: Option<f64>,
    /// Seed of what is drawn.
    pub seed: u64,
}

impl Default for TemplateOptions {
    fn default() -> Self {
        Self {
            source: TemplateSource::default(),
            sampling: Sampling::default(),
            keep: Keep::default(),
            offsets: OffsetInit::default(),
            kinds: OffsetKinds::default(),
            count_factor: 1.0,
            settle_rounds: 2,
            worst_match: None,
            seed: 0,
        }
    }
}

impl TemplateOptions {
    /// Checks the ranges.
    pub(super) fn validate(&self) -> Result<(), TemplateError> {
        if self.count_factor.is_finite() && self.count_factor > 0.0 {
            return Ok(());
        }
        let want = "a finite number above 0";
        Err(TemplateError::Option { option: "count_factor", value: self.count_factor, want })
    }
}
