//! The flat Gaussians that close a surface of surfels.

use glam::{DMat3, DVec3};
use instgs_synth::surface::Surfel;
use instgs_vk::math::covariance::{logit, quat_from_rotation};
use instgs_vk::scene::Gaussians;

/// Standard deviation of a disc along the surface per `spacing`. Dart throwing leaves neighbours 1 to 1.6 spacings
/// apart, so discs of this size overlap at one deviation and the surface is closed.
const DEVIATION_PER_SPACING: f64 = 0.80;
/// Deviation across the surface per deviation along it.
const FLATNESS: f64 = 0.12;

/// Appends a flat Gaussian tangent to the surface at `surfel`.
pub(crate) fn push_disc(cloud: &mut Gaussians, surfel: &Surfel, opacity: f64, sh: &[DVec3]) {
    let (a, b) = surfel.normal.any_orthonormal_pair();
    let along = DEVIATION_PER_SPACING * surfel.spacing;
    let deviations = DVec3::new(along, along, FLATNESS * along);
    push_gaussian(cloud, surfel.position, DMat3::from_cols(a, b, surfel.normal), deviations, opacity, sh);
}

/// Appends a Gaussian with standard deviations along the columns of `axes`, a rotation.
pub(crate) fn push_gaussian(
    cloud: &mut Gaussians,
    mean: DVec3,
    axes: DMat3,
    deviations: DVec3,
    opacity: f64,
    sh: &[DVec3],
) {
    debug_assert!((axes.determinant() - 1.0).abs() < 1e-6, "axes are no rotation: {axes}");
    cloud.means.push(mean.as_vec3().to_array());
    cloud.quats.push(quat_from_rotation(axes).map(|c| c as f32));
    cloud.log_scales.push([deviations.x.ln() as f32, deviations.y.ln() as f32, deviations.z.ln() as f32]);
    cloud.opacity_logits.push(logit(opacity) as f32);
    for c in 0..cloud.sh_coefficients() {
        cloud.sh.push(sh.get(c).copied().unwrap_or(DVec3::ZERO).as_vec3().to_array());
    }
}
