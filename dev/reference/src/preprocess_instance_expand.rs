//! Twin of pass `preprocess_instance_expand`: one pair (instance, Gaussian) -> one screen-space splat, in f64.
//!
//! Equations: InstGS Eq. 6 for the world-frame Gaussian; EWA splatting (Zwicker et al. 2001, Eq. 31; 3DGS Eq. 5) cov_2d
//! = J W cov_world W^T J^T with J the Jacobian of the pinhole projection at the centre. J's slopes x/z and y/z are
//! clamped to slightly beyond the image (`view::SLOPE_MARGIN`); dilation and compensation follow `RenderOptions`.

use glam::{DMat3, DVec2, DVec3};

use crate::view::View;
use instgs_vk::math::covariance::{covariance, sigmoid};
use instgs_vk::math::sh::{eval_sh_f64, widened};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::{ColorMatrix, InstancedScene, SourceRange};
use instgs_vk::scene::offsets::Offsets;

/// Contributions with a smaller alpha are skipped.
pub const ALPHA_MIN: f64 = 1.0 / 255.0;

/// Floor of det / det' in the antialias compensation: 0.005^2.
pub const COMPENSATION_FLOOR: f64 = 2.5e-5;

/// One Gaussian of one instance before its transform, offsets applied, in f64. A background Gaussian has the identity.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceGaussian {
    /// Position in flat order: instances in file order, each in template order and then its own, then the background.
    pub flat_index: u32,
    /// The instance's index; the number of instances for the background.
    pub instance: u32,
    /// Position in its template, after all of them for an instance's own Gaussians, or in the background.
    pub local_index: u32,
    /// Centre with its offset, p + d, template frame, scene units.
    pub mean_template: DVec3,
    /// Quaternion (w, x, y, z) of any length.
    pub quat: [f64; 4],
    /// Natural logarithms of the standard deviations.
    pub log_scales: DVec3,
    /// Opacity logit with its offset.
    pub opacity_logit: f64,
    /// SH coefficients `[C][rgb]`, C = (sh_degree + 1)^2, offsets added.
    pub sh: Vec<DVec3>,
    /// Degree of `sh`, 0..=3.
    pub sh_degree: u32,
    /// The instance's transform.
    pub world_from_template: Similarity,
    /// Rows of the instance's colour matrix (M | b), if it has one.
    pub color_from_template: Option<[[f64; 4]; 3]>,
}

/// A splat on the screen, as blending needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct ProjectedSplat {
    /// Flat index of the source Gaussian.
    pub flat_index: u32,
    /// View-space z of the centre, scene units.
    pub depth: f64,
    /// The values that `depth` is computed from: transform and p + d. Splats that agree here have the same depth on any
    /// device.
    pub depth_origin: (Similarity, DVec3),
    /// Sum of the absolute terms of `depth`: its rounding error in f32 is a few times 6e-8 of this.
    pub depth_terms: f64,
    /// Centre on the screen, px.
    pub mean_px: DVec2,
    /// (a, b, c) of the inverse of the dilated covariance, px^-2: sigma = (a dx^2 + c dy^2) / 2 + b dx dy.
    pub conic: [f64; 3],
    /// Opacity after the sigmoid and the antialias compensation.
    pub opacity: f64,
    /// Colour max(0, SH + 0.5).
    pub color: DVec3,
    /// Limit of the exponent, ln(255 opacity): alpha >= 1/255 exactly where sigma <= tau_ln.
    pub tau_ln: f64,
    /// Diagonal (xx, yy) of the dilated covariance, px^2.
    pub variance_px: DVec2,
    /// Half the size of the tight box around the region alpha >= 1/255 (SnugBox), px: sqrt(2 tau_ln cov_xx), and the
    /// same for yy.
    pub half_extent_px: DVec2,
}

/// Thresholds that decide whether a splat is drawn at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CullLimits {
    /// Drawn if depth > near, scene units.
    pub near: f64,
    /// Drawn if opacity is at least this.
    pub opacity_min: f64,
}

impl CullLimits {
    /// The limits that the renderer uses.
    pub fn exact(view: &View) -> Self {
        Self { near: view.options.near, opacity_min: ALPHA_MIN }
    }
}

impl ProjectedSplat {
    /// The exponent sigma at a point of the image, no unit.
    pub fn sigma_at(&self, point_px: DVec2) -> f64 {
        let d = point_px - self.mean_px;
        0.5 * (self.conic[0] * d.x * d.x + self.conic[2] * d.y * d.y) + self.conic[1] * d.x * d.y
    }

    /// opacity * exp(-sigma), before the clamp to 0.99; 0 where sigma < 0 (rounding of a degenerate conic).
    pub fn alpha_at(&self, point_px: DVec2) -> f64 {
        let sigma = self.sigma_at(point_px);
        if sigma >= 0.0 { self.opacity * (-sigma).exp() } else { 0.0 }
    }

    /// Range of pixels `[x0, x1, y0, y1]`, ends exclusive, that holds every pixel centre of the image with sigma <=
    /// tau_ln + `extra_tau`, with one pixel of margin on every side.
    pub fn pixel_box(&self, width: u32, height: u32, extra_tau: f64) -> [u32; 4] {
        let half = half_extent_px(self.tau_ln + extra_tau, self.variance_px) + 1.0;
        let size = DVec2::new(f64::from(width), f64::from(height));
        let first = (self.mean_px - half - 0.5).ceil().clamp(DVec2::ZERO, size);
        let end = (self.mean_px + half + 0.5).floor().clamp(DVec2::ZERO, size);
        [first.x as u32, end.x as u32, first.y as u32, end.y as u32]
    }
}

/// Half the size of the box around the ellipse sigma <= tau: sqrt(2 tau variance) per axis; 0 for tau <= 0.
pub fn half_extent_px(tau: f64, variance_px: DVec2) -> DVec2 {
    let squared = 2.0 * tau.max(0.0) * variance_px;
    DVec2::new(squared.x.sqrt(), squared.y.sqrt())
}

/// The centre of pixel (x, y), px.
pub fn pixel_center(x: u32, y: u32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// All Gaussians of a valid scene as sources, in flat order.
pub fn sources(scene: &InstancedScene) -> Vec<SourceGaussian> {
    let mut out = Vec::new();
    for (k, instance) in scene.instances.iter().enumerate() {
        let range = scene.template_ranges[instance.template as usize];
        let offsets = instance.first_offset.map(|first| (&scene.offsets, first));
        let first = out.len();
        push_sources(&mut out, (&scene.templates, range), offsets, instance.world_from_template, k as u32);
        let color_from_template = scene.color_matrix(k).map(widened_rows);
        out[first..].iter_mut().for_each(|source| source.color_from_template = color_from_template);
        let first = out.len();
        push_sources(&mut out, (&scene.own, scene.own_range(k)), None, instance.world_from_template, k as u32);
        out[first..].iter_mut().for_each(|source| source.local_index += range.count);
    }
    let range = SourceRange { first: 0, count: scene.background.len() as u32 };
    push_sources(&mut out, (&scene.background, range), None, Similarity::IDENTITY, scene.instances.len() as u32);
    out
}

/// A colour matrix in f64.
pub(super) fn widened_rows(rows: &ColorMatrix) -> [[f64; 4]; 3] {
    rows.map(|row| row.map(f64::from))
}

/// Appends the Gaussians of one instance: a range of a cloud, with a run of offsets if it has any.
pub(super) fn push_sources(
    out: &mut Vec<SourceGaussian>,
    (cloud, range): (&Gaussians, SourceRange),
    offsets: Option<(&Offsets, u32)>,
    world_from_template: Similarity,
    instance: u32,
) {
    for local in 0..range.count {
        let mut source = source_of(cloud, (range.first + local) as usize, world_from_template);
        if let Some((offsets, first)) = offsets {
            let o = (first + local) as usize;
            source.mean_template += widened(offsets.means[o]);
            source.sh[0] += widened(offsets.sh_dc[o]);
            source.opacity_logit += f64::from(offsets.opacity_logits[o]);
            add_rare_offsets(&mut source, offsets, o);
        }
        out.push(SourceGaussian { flat_index: out.len() as u32, instance, local_index: local, ..source });
    }
}

/// Adds the ablation offsets, of SH coefficients above 0 and of shape, if the scene has them.
fn add_rare_offsets(source: &mut SourceGaussian, offsets: &Offsets, record: usize) {
    for (sh, &offset) in source.sh[1..].iter_mut().zip(offsets.rest_of(record)) {
        *sh += widened(offset);
    }
    source.log_scales += offsets.log_scales.get(record).map_or(DVec3::ZERO, |&offset| widened(offset));
    for (q, &offset) in source.quat.iter_mut().zip(offsets.quats.get(record).into_iter().flatten()) {
        *q += f64::from(offset);
    }
}

/// Gaussian `i` of a cloud; its indices are filled in later.
fn source_of(cloud: &Gaussians, i: usize, world_from_template: Similarity) -> SourceGaussian {
    SourceGaussian {
        flat_index: 0,
        instance: 0,
        local_index: 0,
        mean_template: widened(cloud.means[i]),
        quat: cloud.quats[i].map(f64::from),
        log_scales: widened(cloud.log_scales[i]),
        opacity_logit: f64::from(cloud.opacity_logits[i]),
        sh: cloud.sh_of(i).iter().map(|&c| widened(c)).collect(),
        sh_degree: cloud.sh_degree,
        world_from_template,
        color_from_template: None,
    }
}

/// Centre in the world (Eq. 6), scene units: A (p + d) + t.
pub fn mean_world(source: &SourceGaussian) -> DVec3 {
    source.world_from_template.transform_point(source.mean_template)
}

/// Covariance in the world (Eq. 6): A cov_t A^T.
pub fn covariance_world(source: &SourceGaussian) -> DMat3 {
    let a = source.world_from_template.linear();
    a * covariance(source.quat, source.log_scales) * a.transpose()
}

/// The two rows of the Jacobian of (fx x/z, fy y/z) at a view-space point, with x/z and y/z clamped to the view's
/// slope limits.
pub fn projection_jacobian(view: &View, mean_view: DVec3) -> [DVec3; 2] {
    let z = mean_view.z;
    let slope = (mean_view.truncate() / z).max(view.slope_min).min(view.slope_max);
    let focal = view.focal_px;
    [DVec3::new(focal.x / z, 0.0, -focal.x * slope.x / z), DVec3::new(0.0, focal.y / z, -focal.y * slope.y / z)]
}

/// The 2D covariance before dilation, px^2: (xx, xy, yy).
pub fn covariance_px(view: &View, mean_view: DVec3, cov_world: DMat3) -> [f64; 3] {
    let cov_view = view.view_from_world * cov_world * view.view_from_world.transpose();
    let [jx, jy] = projection_jacobian(view, mean_view);
    [jx.dot(cov_view * jx), jx.dot(cov_view * jy), jy.dot(cov_view * jy)]
}

/// Colour of a Gaussian: max(0, SH + 0.5), evaluated in the view direction rotated to the template frame by R^T.
pub fn color(view: &View, source: &SourceGaussian, mean_world: DVec3) -> DVec3 {
    let raw = raw_color(view, source, mean_world);
    // `max` would turn NaN into 0. Minus infinity is kept too, so that `project` rejects the Gaussian.
    DVec3::from_array(raw.to_array().map(|c| if c < 0.0 && fits_device(c) { 0.0 } else { c }))
}

/// The colour SH + 0.5, before the clamp at 0.
pub fn raw_color(view: &View, source: &SourceGaussian, mean_world: DVec3) -> DVec3 {
    let color = template_color(view, source, mean_world);
    let Some(rows) = source.color_from_template else { return color };
    DVec3::from_array(rows.map(|[r, g, b, shift]| DVec3::new(r, g, b).dot(color) + shift))
}

/// SH + 0.5, before the colour matrix.
pub fn template_color(view: &View, source: &SourceGaussian, mean_world: DVec3) -> DVec3 {
    let dir_world = (mean_world - view.camera_world).normalize();
    let dir_template = source.world_from_template.rotation().transpose() * dir_world;
    eval_sh_f64(source.sh_degree, &source.sh, dir_template) + 0.5
}

/// Gaussians with a colour from this value on are not drawn: gradients of all that is blended with them would overflow.
pub const COLOR_LIMIT: f64 = 1e15;

/// True if the value is finite after rounding to f32, as on the device.
fn fits_device(v: f64) -> bool {
    (v as f32).is_finite()
}

/// Projects one Gaussian; `None` if it is culled. It is drawn only if all of these hold (so that NaN fails): depth >
/// near, opacity >= opacity_min, det' > 0, and world covariance, 2D covariance, det', conic, centre and colour are
/// finite in f32, the precision of the device.
pub fn project(view: &View, source: &SourceGaussian, limits: &CullLimits) -> Option<ProjectedSplat> {
    let mean_world = mean_world(source);
    let mean_view = view.view_from_world * mean_world + view.world_origin_view;
    let depth = mean_view.z;
    let in_front = depth > limits.near;
    if !in_front {
        return None;
    }
    let cov_world = covariance_world(source);
    let [xx, xy, yy] = covariance_px(view, mean_view, cov_world);
    let (dxx, dyy) = (xx + view.options.dilation, yy + view.options.dilation);
    let det = dxx * dyy - xy * xy;
    let conic = [dyy / det, -xy / det, dxx / det];
    let mean_px = view.focal_px * mean_view.truncate() / depth + view.principal_px;

    let compensation =
        if view.options.antialias { ((xx * yy - xy * xy) / det).max(COMPENSATION_FLOOR).sqrt() } else { 1.0 };
    let opacity = sigmoid(source.opacity_logit) * compensation;
    let color = color(view, source, mean_world);

    let finite = cov_world.to_cols_array().into_iter().all(fits_device)
        && [dxx, xy, dyy, det, depth, mean_px.x, mean_px.y]
            .into_iter()
            .chain(conic)
            .chain(color.to_array())
            .all(fits_device);
    if !(finite && color.max_element() < COLOR_LIMIT && det as f32 > 0.0 && opacity >= limits.opacity_min) {
        return None;
    }
    let tau_ln = (255.0 * opacity).ln();
    let variance_px = DVec2::new(dxx, dyy);
    Some(ProjectedSplat {
        flat_index: source.flat_index,
        depth,
        depth_origin: (source.world_from_template, source.mean_template),
        depth_terms: depth_terms(view, source),
        mean_px,
        conic,
        opacity,
        color,
        tau_ln,
        variance_px,
        half_extent_px: half_extent_px(tau_ln, variance_px),
    })
}

/// Sum of the absolute values of all terms in the view-space depth of a Gaussian's centre.
fn depth_terms(view: &View, source: &SourceGaussian) -> f64 {
    let placement = &source.world_from_template;
    let world = placement.linear().abs() * source.mean_template.abs() + placement.translation().abs();
    (view.view_from_world.abs() * world + view.world_origin_view.abs()).z
}

/// The row-major indices (tile_y * tiles_x + tile_x, ascending) of the tiles with at least one pixel centre of the
/// image where alpha >= 1/255. `tile_size` in px; border tiles are clipped to the image.
pub fn tiles_hit(splat: &ProjectedSplat, tile_size: u32, width: u32, height: u32) -> Vec<u32> {
    let tiles_x = width.div_ceil(tile_size);
    let [x0, x1, y0, y1] = splat.pixel_box(width, height, 0.0);
    let mut hit = vec![false; (tiles_x * height.div_ceil(tile_size)) as usize];
    for y in y0..y1 {
        for x in x0..x1 {
            if splat.alpha_at(pixel_center(x, y)) >= ALPHA_MIN {
                hit[(y / tile_size * tiles_x + x / tile_size) as usize] = true;
            }
        }
    }
    (0..hit.len() as u32).filter(|&tile| hit[tile as usize]).collect()
}

#[cfg(test)]
#[path = "preprocess_instance_expand_tests.rs"]
mod tests;
