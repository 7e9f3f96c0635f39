//! What pictures say of poses that geometry cannot tell apart.

use super::error::RegisterError;
use crate::math::similarity::Similarity;

/// How pictures of a target agree with the reference's Gaussians moved onto it; lower is better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Mean absolute difference of colours (0..1) where both show, after a gain and a bias per channel.
    pub photometric: f64,
    /// One minus the overlap of the outlines: 1 - intersection / union, 0..=1. Knows nothing of colours.
    pub silhouette: f64,
}

/// Compares poses by pictures; [`RenderCheck`](super::RenderCheck) does it with the rasteriser.
pub trait PoseCheck {
    /// The agreement for each of some poses, from the same views. A pose maps the reference's place in the world to the target's; both are
    /// mask ids. `None` if no view shows the target.
    ///
    /// # Errors
    /// What the device or the pictures' files say.
    fn check(
        &mut self,
        reference: u32,
        target: u32,
        target_from_reference: &[Similarity],
    ) -> Result<Option<Vec<Agreement>>, RegisterError>;
}
