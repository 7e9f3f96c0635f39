//! Twin of pass `preprocess_instance_expand_backward`: from the gradient of a splat to that of its Gaussian and of the
//! instance's transform.
//!
//! Each step of `project` is differentiated by the chain rule, in reverse order. Gradients of symmetric matrices are
//! symmetric: an off-diagonal entry holds half of the derivative with respect to the value that occurs twice. Where
//! `project` clamps (`ProjectionBranches`) the derivative is that of the branch taken, so it is exact.

use glam::{DMat2, DMat3, DVec2, DVec3};

use crate::preprocess_instance_expand::{
    COMPENSATION_FLOOR, SourceGaussian, covariance_px, covariance_world, mean_world, projection_jacobian, raw_color,
    template_color,
};
use crate::tile_blend_backward::SplatGradient;
use crate::view::View;
use instgs_vk::math::covariance::{covariance, normalised_quat, rotation_from_quat, sigmoid};
use instgs_vk::math::sh::{sh_basis, sh_basis_gradient};

/// Gradient of a loss with respect to one Gaussian of one instance: one field for each field of `SourceGaussian`.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceGradient {
    /// With respect to p + d: the gradient of both the template's mean and the offset's.
    pub mean_template: DVec3,
    /// With respect to the quaternion (w, x, y, z) as it is stored, not normalised.
    pub quat: [f64; 4],
    /// With respect to the logarithms of the standard deviations.
    pub log_scales: DVec3,
    /// With respect to logit + offset.
    pub opacity_logit: f64,
    /// With respect to the SH coefficients `[C][rgb]`; entry 0 is also the gradient of the offset's.
    pub sh: Vec<DVec3>,
    /// Rows of (dL/dA | dL/dt), every entry of A independent.
    pub world_from_template: [[f64; 4]; 3],
    /// Rows of (dL/dM | dL/db) of the colour matrix; that at the identity for a Gaussian without one.
    pub color_from_template: [[f64; 4]; 3],
    /// Gradient of the splat's centre, per px, passed on for densification.
    pub mean_px: DVec2,
}

/// The branches that `project` takes at its clamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProjectionBranches {
    /// Per axis: whether the Jacobian's slope is at a limit.
    pub slope_clamped: [bool; 2],
    /// Whether the antialias compensation is at its floor.
    pub compensation_floored: bool,
    /// Per channel: whether the colour is 0 because SH + 0.5 is negative.
    pub channel_clamped: [bool; 3],
}

/// The branches for a Gaussian in front of the camera.
pub fn projection_branches(view: &View, source: &SourceGaussian) -> ProjectionBranches {
    let mean_world = mean_world(source);
    let mean_view = view.view_from_world * mean_world + view.world_origin_view;
    let slope = mean_view.truncate() / mean_view.z;
    let clamped = slope.cmplt(view.slope_min) | slope.cmpgt(view.slope_max);
    let [xx, xy, yy] = covariance_px(view, mean_view, covariance_world(source));
    ProjectionBranches {
        slope_clamped: clamped.into(),
        compensation_floored: view.options.antialias
            && Determinants::new(view, [xx, xy, yy]).ratio() < COMPENSATION_FLOOR,
        channel_clamped: raw_color(view, source, mean_world).to_array().map(|c| c < 0.0),
    }
}

/// The gradient of a Gaussian that `project` draws, from that of its splat.
pub fn project_backward(view: &View, source: &SourceGaussian, gradient: &SplatGradient) -> SourceGradient {
    let branches = projection_branches(view, source);
    let (mean_world, cov_world) = (mean_world(source), covariance_world(source));
    let mean_view = view.view_from_world * mean_world + view.world_origin_view;
    let cov_px = covariance_px(view, mean_view, cov_world);
    let (d_cov_px, opacity_logit) = screen_backward(view, source, &branches, cov_px, gradient);
    let (d_cov_world, from_cov) = ewa_backward(view, &branches, mean_view, cov_world, d_cov_px);
    let d_mean_view = from_cov + center_backward(view, mean_view, gradient.mean_px);
    let color = color_backward(view, source, &branches, mean_world, gradient.color);

    // mean_world = A m + t, cov_world = A cov_t A^T.
    let a = source.world_from_template.linear();
    let d_mean_world = view.view_from_world.transpose() * d_mean_view + color.mean_world;
    let cov_template = covariance(source.quat, source.log_scales);
    let d_linear = outer(d_mean_world, source.mean_template) + 2.0 * d_cov_world * a * cov_template + color.linear;
    let (quat, log_scales) = covariance_backward(source, a.transpose() * d_cov_world * a);
    let row = |i: usize| [d_linear.row(i).x, d_linear.row(i).y, d_linear.row(i).z, d_mean_world[i]];
    SourceGradient {
        mean_template: a.transpose() * d_mean_world,
        quat,
        log_scales,
        opacity_logit,
        sh: color.sh,
        world_from_template: [row(0), row(1), row(2)],
        color_from_template: color.matrix,
        mean_px: gradient.mean_px,
    }
}

/// The outer product a b^T.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The symmetric matrix of entries (xx, xy, yy).
fn symmetric([xx, xy, yy]: [f64; 3]) -> DMat2 {
    DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy))
}

/// The adjugate, which is also the gradient of the determinant.
fn adjugate([xx, xy, yy]: [f64; 3]) -> DMat2 {
    symmetric([yy, -xy, xx])
}

/// The determinants in the antialias compensation sqrt(max(floor, det / det')).
struct Determinants {
    cov_px: [f64; 3],
    dilated_px: [f64; 3],
}

impl Determinants {
    fn new(view: &View, cov_px: [f64; 3]) -> Self {
        let [xx, xy, yy] = cov_px;
        Self { cov_px, dilated_px: [xx + view.options.dilation, xy, yy + view.options.dilation] }
    }

    /// The ratio det / det'.
    fn ratio(&self) -> f64 {
        symmetric(self.cov_px).determinant() / symmetric(self.dilated_px).determinant()
    }

    /// Gradient of `ratio` with respect to the covariance; the dilation is a constant.
    fn ratio_gradient(&self) -> DMat2 {
        (adjugate(self.cov_px) - adjugate(self.dilated_px) * self.ratio())
            * (1.0 / symmetric(self.dilated_px).determinant())
    }
}

/// dL/d cov_px and dL/d logit: through the conic Q = cov'^-1 (dL/dcov' = -Q (dL/dQ) Q) and the opacity
/// sigmoid(logit) compensation.
fn screen_backward(
    view: &View,
    source: &SourceGaussian,
    branches: &ProjectionBranches,
    cov_px: [f64; 3],
    gradient: &SplatGradient,
) -> (DMat2, f64) {
    let determinants = Determinants::new(view, cov_px);
    let conic = symmetric(determinants.dilated_px).inverse();
    let [d_a, d_b, d_c] = gradient.conic;
    let mut d_cov_px = -1.0 * (conic * symmetric([d_a, 0.5 * d_b, d_c]) * conic);
    let plain = sigmoid(source.opacity_logit);
    let mut compensation = 1.0;
    if view.options.antialias {
        compensation = determinants.ratio().max(COMPENSATION_FLOOR).sqrt();
        if !branches.compensation_floored {
            d_cov_px += determinants.ratio_gradient() * (gradient.opacity * plain / (2.0 * compensation));
        }
    }
    // 1 - sigmoid(x) = sigmoid(-x), without the cancellation.
    (d_cov_px, gradient.opacity * compensation * plain * sigmoid(-source.opacity_logit))
}

/// dL/d cov_world and dL/d mean_view: through cov_px = J W cov_world W^T J^T and J's dependence on the centre.
fn ewa_backward(
    view: &View,
    branches: &ProjectionBranches,
    mean_view: DVec3,
    cov_world: DMat3,
    d_cov_px: DMat2,
) -> (DMat3, DVec3) {
    let w = view.view_from_world;
    let [jx, jy] = projection_jacobian(view, mean_view);
    let [gxx, gxy, gyy] = [d_cov_px.x_axis.x, d_cov_px.x_axis.y, d_cov_px.y_axis.y];
    let d_cov_view = outer(jx, jx) * gxx + (outer(jx, jy) + outer(jy, jx)) * gxy + outer(jy, jy) * gyy;
    // Here dL/dJ = 2 (dL/dcov_px) J cov_view, by rows.
    let cov_view = w * cov_world * w.transpose();
    let d_jacobian = [2.0 * (cov_view * (gxx * jx + gxy * jy)), 2.0 * (cov_view * (gxy * jx + gyy * jy))];
    // Row i of J is f/z at column i and -f slope/z at z, where slope = mean_i / z unless it is clamped.
    let mut d_mean_view = DVec3::ZERO;
    let z = mean_view.z;
    for (i, (row, d_row)) in [jx, jy].into_iter().zip(d_jacobian).enumerate() {
        d_mean_view.z -= (d_row[i] * row[i] + d_row.z * row.z) / z;
        if !branches.slope_clamped[i] {
            let d_slope = -d_row.z * row[i];
            d_mean_view[i] += d_slope / z;
            d_mean_view.z -= d_slope * mean_view[i] / (z * z);
        }
    }
    (w.transpose() * d_cov_view * w, d_mean_view)
}

/// dL/d mean_view through the centre (f x/z + c), which is not clamped.
fn center_backward(view: &View, mean_view: DVec3, d_mean_px: DVec2) -> DVec3 {
    let scaled = d_mean_px * view.focal_px / mean_view.z;
    scaled.extend(-scaled.dot(mean_view.truncate()) / mean_view.z)
}

/// Gradients that follow from the colour's.
struct ColorGradient {
    sh: Vec<DVec3>,
    mean_world: DVec3,
    linear: DMat3,
    matrix: [[f64; 4]; 3],
}

/// Through colour = max(0, M rgb + b), rgb = sum basis(R^T d) sh + 0.5, d = normalize(mean_world - camera), R = A det(A)^(-1/3).
fn color_backward(
    view: &View,
    source: &SourceGaussian,
    branches: &ProjectionBranches,
    mean_world: DVec3,
    d_color: DVec3,
) -> ColorGradient {
    let d_raw = DVec3::from_array(std::array::from_fn(|c| if branches.channel_clamped[c] { 0.0 } else { d_color[c] }));
    let extended = template_color(view, source, mean_world).extend(1.0).to_array();
    let matrix = d_raw.to_array().map(|d| extended.map(|v| d * v));
    let transposed = |rows: [[f64; 4]; 3]| DMat3::from_cols_array_2d(&rows.map(|[r, g, b, _]| [r, g, b]));
    let d_raw = source.color_from_template.map_or(d_raw, |rows| transposed(rows) * d_raw);
    let from_camera = mean_world - view.camera_world;
    let dir_world = from_camera.normalize();
    let placement = source.world_from_template;
    let dir_template = placement.rotation().transpose() * dir_world;
    let basis = sh_basis(dir_template);
    let d_dir_template = source
        .sh
        .iter()
        .zip(sh_basis_gradient(dir_template))
        .fold(DVec3::ZERO, |sum, (&coefficient, slope)| sum + coefficient.dot(d_raw) * slope);
    let d_dir_world = placement.rotation() * d_dir_template;
    // dir_template_j = sum_i R_ij dir_world_i. dR = dA / s - R tr(A^-1 dA) / 3.
    let d_rotation = outer(dir_world, d_dir_template);
    let a = placement.linear();
    let along = dir_world.dot(d_dir_world);
    ColorGradient {
        sh: basis.iter().take(source.sh.len()).map(|&b| b * d_raw).collect(),
        mean_world: (d_dir_world - along * dir_world) / from_camera.length(),
        // The sum over i, j of d_rotation_ij R_ij is `along`.
        matrix,
        linear: d_rotation * (1.0 / placement.scale()) - a.inverse().transpose() * (along / 3.0),
    }
}

/// dL/d quat and dL/d log_scales from dL/d cov_t: through cov_t = M M^T, M = R(quat / |quat|) diag(exp(log_scales)).
fn covariance_backward(source: &SourceGaussian, d_cov: DMat3) -> ([f64; 4], DVec3) {
    let rotation = rotation_from_quat(source.quat);
    let scales = DVec3::from_array(source.log_scales.to_array().map(f64::exp));
    let d_m = 2.0 * d_cov * rotation * DMat3::from_diagonal(scales);
    let log_scales = DVec3::from_array(std::array::from_fn(|j| d_m.col(j).dot(rotation.col(j)) * scales[j]));
    let unit = normalised_quat(source.quat);
    let d_unit = rotation_backward(unit, d_m * DMat3::from_diagonal(scales));
    // Through the normalisation: only the component perpendicular to the quaternion, divided by its length.
    let radial: f64 = unit.iter().zip(d_unit).map(|(u, d)| u * d).sum();
    let length = source.quat.iter().map(|c| c * c).sum::<f64>().sqrt();
    (std::array::from_fn(|i| (d_unit[i] - radial * unit[i]) / length), log_scales)
}

/// dL/d(w, x, y, z) from dL/dR, for the entries of R as `rotation_from_quat` writes them.
fn rotation_backward([w, x, y, z]: [f64; 4], d_rotation: DMat3) -> [f64; 4] {
    let g = |i: usize, j: usize| d_rotation.col(j)[i];
    // The antisymmetric part is linear in w, the symmetric one is not.
    let turn = DVec3::new(g(2, 1) - g(1, 2), g(0, 2) - g(2, 0), g(1, 0) - g(0, 1));
    let (xy, xz, yz) = (g(0, 1) + g(1, 0), g(0, 2) + g(2, 0), g(1, 2) + g(2, 1));
    [
        2.0 * turn.dot(DVec3::new(x, y, z)),
        2.0 * (w * turn.x + y * xy + z * xz - 2.0 * x * (g(1, 1) + g(2, 2))),
        2.0 * (w * turn.y + x * xy + z * yz - 2.0 * y * (g(0, 0) + g(2, 2))),
        2.0 * (w * turn.z + x * xz + y * yz - 2.0 * z * (g(0, 0) + g(1, 1))),
    ]
}

#[cfg(test)]
#[path = "preprocess_instance_expand_backward_tests.rs"]
mod tests;
