//! Options for building templates.

use serde::{Deserialize, Serialize};

use super::error::TemplateError;
use instgs_vk::math::halves::Halves;
use instgs_vk::scene::gaussians::sh_coefficients;

/// Instances that a template's Gaussians are taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TemplateSource {
    /// All instances, in the common pose: they complete each other where one was not fully seen.
    #[default]
    Merge,
    /// The group's first usable instance alone, the reference.
    Single,
    /// The usable instance with the most Gaussians alone.
    Max,
}

/// How the template's Gaussians are drawn from the merged cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// One at random from each of N equal runs of a Morton curve: octree voxels get Gaussians in proportion to their
    /// share.
    #[default]
    Voxel,
    /// Farthest points within long runs of that curve: even spacing, but strays and large Gaussians are preferred.
    Farthest,
    /// A uniform random subset of the Gaussians.
    Random,
}

/// Which parameters of a drawn Gaussian a template keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// All parameters. Scales fit, since they were trained at about the template's density.
    #[default]
    All,
    /// Position and base colour, as in the paper. The rest is reset: a sphere with the root mean square distance to the
    /// three nearest as standard deviation, opacity 0.1, SH of degree 1 and above 0.
    PositionAndColour,
}

/// Initial values of offsets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OffsetInit {
    /// The difference from a template Gaussian to its match in the instance.
    #[default]
    Difference,
    /// Zero: every instance starts equal to the template.
    Zero,
}

/// What becomes of an instance's Gaussians that no Gaussian of the template stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unmatched {
    /// They are left out: the template stands for all of the instance.
    #[default]
    Drop,
    /// They become the instance's own. Only where offsets start from differences, since those say what is matched.
    Own,
}

/// What two template Gaussians begin as that stand for the same Gaussian of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Doubles {
    /// Its halves, as densification makes them: training then has two where two of the same would learn the same for long.
    Halves(Halves),
    /// Both as it is, of a lower opacity: together they look exactly as it does.
    Alike,
}

impl Default for Doubles {
    fn default() -> Self {
        Self::Halves(Halves::default())
    }
}

/// Parameters that have offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffsetKinds {
    /// Means of Gaussians, template frame.
    pub position: bool,
    /// SH coefficient 0, the base colour.
    pub sh_dc: bool,
    /// Opacity logits of Gaussians.
    pub opacity: bool,
    /// SH coefficients above 0 up to this degree, or up to the template's; 0 = none. 36 bytes per record for degree 1, 96 for
    /// 2, 180 for 3.
    pub sh_degree: u32,
    /// Log scales and quaternions; 28 bytes per record.
    pub covariance: bool,
}

impl OffsetKinds {
    /// Number of SH coefficients above 0 that have offsets, for templates of an SH degree.
    pub fn rest_coefficients(&self, of_template: u32) -> usize {
        sh_coefficients(self.sh_degree.min(of_template)) - 1
    }

    /// Whether any parameter has offsets.
    pub fn any(&self) -> bool {
        self.position || self.sh_dc || self.opacity || self.sh_degree > 0 || self.covariance
    }
}

impl Default for OffsetKinds {
    /// The paper's choice: position, base colour, opacity.
    fn default() -> Self {
        Self { position: true, sh_dc: true, opacity: true, sh_degree: 0, covariance: false }
    }
}

/// Options of [`build`](super::build).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemplateOptions {
    /// Instances that the template's Gaussians are taken from.
    pub source: TemplateSource,
    /// How Gaussians are drawn from these.
    pub sampling: Sampling,
    /// Which parameters of a drawn Gaussian are kept.
    pub keep: Keep,
    /// Initial values of offsets.
    pub offsets: OffsetInit,
    /// What becomes of an instance's Gaussians without a match.
    pub unmatched: Unmatched,
    /// What stands for the same Gaussian of an instance; without offsets of position and shape, or if they start from zero,
    /// [`Doubles::Alike`].
    pub doubles: Doubles,
    /// Parameters that have offsets; those of the others stay zero or, for the ablations, empty.
    pub kinds: OffsetKinds,
    /// Number of template Gaussians relative to the mean of the instances, above 0. A template never has more than its
    /// source.
    pub count_factor: f64,
    /// Rounds of replacing template Gaussians by the mean of their matches; 0 = as drawn.
    pub settle_rounds: u32,
    /// Largest match distance ([`GroupReport::match_distance`](super::GroupReport::match_distance)) of a group that
    /// becomes a template; `None` = no limit.
    pub worst_match: Option<f64>,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for TemplateOptions {
    fn default() -> Self {
        Self {
            source: TemplateSource::default(),
            sampling: Sampling::default(),
            keep: Keep::default(),
            offsets: OffsetInit::default(),
            unmatched: Unmatched::default(),
            doubles: Doubles::default(),
            kinds: OffsetKinds::default(),
            count_factor: 1.0,
            settle_rounds: 2,
            worst_match: None,
            seed: 0,
        }
    }
}

impl TemplateOptions {
    /// What stands for the same Gaussian of an instance: halves only where offsets say what each instance's are.
    pub(super) fn doubles(&self) -> Doubles {
        let said = self.kinds.position && self.kinds.covariance && self.keep == Keep::All;
        if said && self.offsets == OffsetInit::Difference { self.doubles } else { Doubles::Alike }
    }

    /// Checks that all options are in range.
    pub(super) fn validate(&self) -> Result<(), TemplateError> {
        if self.count_factor.is_finite() && self.count_factor > 0.0 {
            return Ok(());
        }
        let want = "a finite number above 0";
        Err(TemplateError::Option { option: "count_factor", value: self.count_factor, want })
    }
}
