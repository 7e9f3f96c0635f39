//! First offsets of an instance: the differences of its Gaussians in the cloud from the template's.

use super::instance_cloud::InstanceCloud;
use super::matching::{Match, match_template};
use super::options::{Keep, OffsetInit, TemplateOptions};
use super::template_cloud::TemplateCloud;
use instgs_vk::math::log_covariance::{Shape, log_covariance, nearest_shape};
use instgs_vk::scene::{Gaussians, Offsets};

/// Opacity logits are clamped to plus and minus this, opacities of 0.0009 to 0.9991. A renderer blends an alpha above
/// 0.99 as 0.99 and skips one below 1/255 = sigmoid(-5.5); training would hardly return from farther out.
const MAX_LOGIT: f32 = 7.0;
/// Logit of a template Gaussian that an instance lacks: opacity 0.01 is hardly visible, but above 1/255, so that the
/// Gaussian has a gradient.
pub(super) const LACKING_LOGIT: f32 = -4.6;

/// What an instance has in common with its template.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Common {
    /// Number of template Gaussians that the instance lacks.
    pub lacking: usize,
    /// By Gaussian of the instance, whether a template Gaussian stands for it; empty if instance and template were not compared.
    pub matched: Vec<bool>,
}

/// Appends one instance's records, one per template Gaussian; returns what was compared.
pub(super) fn push_offsets(
    template: &TemplateCloud,
    cloud: &Gaussians,
    own: &InstanceCloud,
    options: &TemplateOptions,
    out: &mut Offsets,
) -> Common {
    let first = out.len();
    push_zeros(template, options, out);
    if options.offsets == OffsetInit::Zero {
        return Common::default();
    }
    let mut common = Common { lacking: 0, matched: vec![false; own.len()] };
    if !own.is_usable() {
        return common;
    }
    let matches = match_template(template, cloud, own, options.doubles());
    for (i, matched) in matches.iter().enumerate() {
        let record = Record { template: &template.gaussians, i, out, index: first + i, options };
        if matched.is_near(template, i) {
            record.set_difference(cloud, own, matched);
            common.matched[matched.own as usize] = true;
        } else {
            record.hide();
            common.lacking += 1;
        }
    }
    common
}

fn push_zeros(template: &TemplateCloud, options: &TemplateOptions, out: &mut Offsets) {
    let len = out.len() + template.gaussians.len();
    out.means.resize(len, [0.0; 3]);
    out.sh_dc.resize(len, [0.0; 3]);
    out.opacity_logits.resize(len, 0.0);
    out.sh_rest.resize(len * options.kinds.rest_coefficients(template.gaussians.sh_degree), [0.0; 3]);
    if options.kinds.covariance {
        out.log_scales.resize(len, [0.0; 3]);
        out.quats.resize(len, [0.0; 4]);
    }
}

/// One offset record and its template Gaussian.
struct Record<'a> {
    template: &'a Gaussians,
    i: usize,
    out: &'a mut Offsets,
    index: usize,
    options: &'a TemplateOptions,
}

impl Record<'_> {
    /// Sets the record of a Gaussian that the instance lacks.
    fn hide(self) {
        if self.options.kinds.opacity {
            let logit = self.template.opacity_logits[self.i];
            self.out.opacity_logits[self.index] = LACKING_LOGIT.min(logit) - logit;
        }
    }

    /// Sets the record to the difference from the matched Gaussian, for those parameters that the template keeps.
    fn set_difference(self, cloud: &Gaussians, own: &InstanceCloud, matched: &Match) {
        let shown = matched.counterpart(cloud, own);
        let (template, i, out, index) = (self.template, self.i, self.out, self.index);
        let kinds = self.options.kinds;
        let source = own.indices[matched.own as usize] as usize;
        if kinds.position {
            out.means[index] = difference(shown.mean, template.means[i]);
        }
        if kinds.sh_dc {
            out.sh_dc[index] = difference(cloud.sh_of(source)[0], template.sh_of(i)[0]);
        }
        if self.options.keep == Keep::PositionAndColour {
            return;
        }
        if kinds.opacity {
            out.opacity_logits[index] = shown.opacity_logit - template.opacity_logits[i];
        }
        let frame = &own.template_from_world;
        let rest = kinds.rest_coefficients(template.sh_degree);
        if rest > 0 {
            let own_sh = frame.sh(cloud.sh_of(source));
            for c in 0..rest {
                out.sh_rest[index * rest + c] = difference(own_sh[c + 1], template.sh_of(i)[c + 1]);
            }
        }
        if kinds.covariance {
            let shape = shape_by_axes_of(template.quats[i], &shown.shape);
            out.log_scales[index] = difference(shape.log_scales.map(|v| v as f32), template.log_scales[i]);
            out.quats[index] = difference(shape.quat.map(|v| v as f32), template.quats[i]);
        }
    }
}

/// An opacity logit clamped to the range that training can change.
pub(super) fn clamped_logit(logit: f32) -> f32 {
    logit.clamp(-MAX_LOGIT, MAX_LOGIT)
}

fn difference<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// The same ellipsoid with its axes in the order and direction of those of a template's Gaussian, whose quaternion gives the length of
/// its own. Gradients of the template sum those of all instances, which only then belong to the same axis.
fn shape_by_axes_of(template_quat: [f32; 4], shape: &Shape) -> Shape {
    let near = template_quat.map(f64::from);
    let length = near.iter().map(|v| v * v).sum::<f64>().sqrt();
    let mut along = nearest_shape(&log_covariance(shape), near);
    along.quat = along.quat.map(|v| v * length);
    along
}
