//! What became of every object.

use serde::{Deserialize, Serialize};

use super::spread::PoseUncertainty;

/// What registration says of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The one the others of its group are registered to.
    Reference,
    /// In the group.
    Accepted,
    /// In the group; it is symmetric, and any of several poses is right.
    Symmetric,
    /// In the group, but another pose is about as likely, or it fits worse than the others of its group, or its pose is
    /// uncertain.
    Ambiguous,
    /// Not in a group: it stays in the background.
    Rejected,
}

impl Verdict {
    /// One word, as in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reference => "reference",
            Self::Accepted => "accepted",
            Self::Symmetric => "symmetric",
            Self::Ambiguous => "ambiguous",
            Self::Rejected => "rejected",
        }
    }

    /// True for objects that are in a group.
    pub fn is_accepted(self) -> bool {
        self != Self::Rejected
    }
}

/// One object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceRegistration {
    /// Mask id.
    pub instance: u32,
    /// The `template_id` of its group; `None` if it is in no group.
    pub group: Option<u32>,
    /// Its category.
    pub name: Option<String>,
    /// Gaussians of its surface.
    pub gaussians: usize,
    /// Part of its surface that lies on the reference's, 0..=1; 0 where nothing was registered.
    pub inliers: f64,
    /// Root mean square distance of that part, scene units.
    pub rmse: f64,
    /// The same as a part of the object's size.
    pub relative_rmse: f64,
    /// Mean absolute difference of colours in pictures (0..1); `None` without such a check.
    pub photometric: Option<f64>,
    /// How sure its pose against the reference is; `None` where nothing was registered.
    #[serde(default)]
    pub uncertainty: Option<PoseUncertainty>,
    /// Whether it is in a group.
    pub accepted: bool,
    /// What was decided.
    pub verdict: Verdict,
    /// In doubt for no more than this: halves of its Gaussians stand apart, by less than a degree and 1 % of its size. The
    /// joint phase refines such a pose.
    #[serde(default)]
    pub slight: bool,
    /// Why, one line.
    pub note: String,
}
