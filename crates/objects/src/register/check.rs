//! Comparison of poses by pictures, for those that geometry cannot tell apart.

use super::error::RegisterError;
use instgs_vk::math::similarity::Similarity;

/// How well pictures of a target agree with the reference's Gaussians moved onto it; lower is better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Mean absolute difference of colours, 0..=1, where both objects are visible, after a gain and a bias per channel.
    pub photometric: f64,
    /// One minus the overlap of the outlines: 1 - intersection / union, 0..=1. Independent of colour.
    pub silhouette: f64,
}

/// Compares poses by pictures; [`RenderCheck`](super::RenderCheck) implements it with the renderer.
pub trait PoseCheck {
    /// Agreement of each of some poses, all from the same views. A pose is a map of the world that moves the object
    /// `reference` onto the object `target`; both are mask ids. `None` if no view shows the target.
    ///
    /// # Errors
    /// Errors of the device, or of reading photos.
    fn check(
        &mut self,
        reference: u32,
        target: u32,
        target_from_reference: &[Similarity],
    ) -> Result<Option<Vec<Agreement>>, RegisterError>;
}
