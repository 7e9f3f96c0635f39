//! Report of registration, one entry per object.

use serde::{Deserialize, Serialize};

use super::spread::PoseUncertainty;

/// Result of registration for one object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The object that the others of its group are registered to.
    Reference,
    /// In a group, with a pose that is certain.
    Accepted,
    /// In a group; the object is symmetric, and any of several poses is right.
    Symmetric,
    /// In a group, but another pose is about as likely, or its fit is worse than usual in the group, or its pose is
    /// uncertain.
    Ambiguous,
    /// Not in a group: the object stays in the background.
    Rejected,
}

impl Verdict {
    /// Name of the verdict in files: one lower-case word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Accepted => "accepted",
            Self::Symmetric => "symmetric",
            Self::Ambiguous => "ambiguous",
            Self::Rejected => "rejected",
        }
    }

    /// Whether the object is in a group.
    pub fn is_accepted(self) -> bool {
        self != Self::Rejected
    }
}

/// Report of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceRegistration {
    /// Mask id of the object.
    pub instance: u32,
    /// The `template_id` of its group; `None` without a group.
    pub group: Option<u32>,
    /// Name of its category, if any.
    pub name: Option<String>,
    /// Number of Gaussians of its surface.
    pub gaussians: usize,
    /// Part of its surface that agrees with the reference's, 0..=1; 0 if it was not registered.
    pub inliers: f64,
    /// Root mean square distance of that part from the reference's surface, scene units.
    pub rmse: f64,
    /// `rmse` as a part of the object's size.
    pub relative_rmse: f64,
    /// Mean absolute colour difference in pictures, 0..=1; `None` if pictures were not compared.
    pub photometric: Option<f64>,
    /// Standard deviations of its pose relative to the reference; `None` if it was not registered.
    #[serde(default)]
    pub uncertainty: Option<PoseUncertainty>,
    /// Whether the object is in a group.
    pub accepted: bool,
    /// Result of registration.
    pub verdict: Verdict,
    /// Whether an ambiguous pose is only slightly uncertain, by at most one degree and 1 % of the size; the joint phase
    /// refines such a pose.
    #[serde(default)]
    pub slight: bool,
    /// Reason of the verdict, one line for the user.
    pub note: String,
}
