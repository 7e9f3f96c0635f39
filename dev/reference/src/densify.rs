//! Twin of `source_use`, `densify_mark`, `densify_select`, `densify_place`, `densify_place_offsets`, `densify_split`,
//! `move_gaussians`, `reset_opacity` and `decay_opacity`, on plain lists.

use instgs_vk::math::covariance::rotation_from_quat;
use instgs_vk::scene::{Gaussians, InstancedScene};

use super::random::{RANDOM_SPLIT, Stream};

/// Thresholds of densification and pruning, in plain units.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Mean screen-space gradient from which on a Gaussian is cloned or split.
    pub gradient_threshold: f64,
    /// Gaussians of a larger scale are split instead of cloned, scene units.
    pub split_above: f64,
    /// Number of children of a split Gaussian.
    pub split_count: u32,
    /// The children's scales are the parent's divided by this.
    pub split_shrink: f64,
    /// Gaussians of lower opacity are pruned.
    pub opacity_min: f64,
    /// Gaussians of a larger scale are pruned, scene units.
    pub scale_max: f64,
    /// Gaussians of a larger screen radius are pruned, px.
    pub radius_max_px: f64,
    /// Upper limit on the number of expanded Gaussians afterwards.
    pub max_expanded: u32,
    /// Random seed of the run.
    pub seed: u64,
    /// Number of steps done.
    pub time: u32,
}

/// Origin of a Gaussian after densification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Made {
    /// The Gaussian existed before.
    Kept,
    /// The new copy of a cloned Gaussian.
    Copy,
    /// A child of a split Gaussian, by number from 0.
    Child(u32),
}

/// How one Gaussian grows: by a clone or by a split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Growth {
    Clone,
    Split,
}

/// The Gaussians after densification, each with the old one it comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Densified {
    /// Index of the old Gaussian and origin, by new Gaussian.
    pub origins: Vec<(usize, Made)>,
    /// Number of cloned Gaussians.
    pub cloned: u32,
    /// Number of split Gaussians.
    pub split: u32,
}

/// How much a source Gaussian is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceUse {
    /// Number of instances that have it.
    pub instances: u32,
    /// Its largest opacity logit in any of them.
    pub highest_logit: f32,
    /// Largest scale of any of them.
    pub world_scale: f64,
}

/// The use of each Gaussian of a plain cloud.
pub fn use_of_cloud(cloud: &Gaussians) -> Vec<SourceUse> {
    let used = |&highest_logit: &f32| SourceUse { instances: 1, highest_logit, world_scale: 1.0 };
    cloud.opacity_logits.iter().map(used).collect()
}

/// The use of each source Gaussian of a scene in which every one belongs to a template or the background.
pub fn use_of_sources(scene: &InstancedScene) -> Vec<SourceUse> {
    let unused = SourceUse { instances: 0, highest_logit: f32::NEG_INFINITY, world_scale: 0.0 };
    let mut out = vec![unused; scene.templates.len()];
    for instance in &scene.instances {
        let range = scene.template_ranges[instance.template as usize];
        for local in 0..range.count {
            let source = (range.first + local) as usize;
            let own = instance.first_offset.map_or(0.0, |first| scene.offsets.opacity_logits[(first + local) as usize]);
            out[source].instances += 1;
            out[source].world_scale = out[source].world_scale.max(instance.world_from_template.scale());
            let logit = scene.templates.opacity_logits[source] + own;
            if logit.is_finite() {
                out[source].highest_logit = out[source].highest_logit.max(logit);
            }
        }
    }
    out.extend(use_of_cloud(&scene.background));
    out
}

/// True if all parameters of Gaussian `i` are finite.
pub fn is_finite(cloud: &Gaussians, i: usize) -> bool {
    let mut values = cloud.means[i].iter().chain(&cloud.quats[i]).chain(&cloud.log_scales[i]);
    values.all(|v| v.is_finite())
        && cloud.opacity_logits[i].is_finite()
        && cloud.sh_of(i).iter().flatten().all(|v| v.is_finite())
}

/// Number of Gaussians (0 or 1) that remain without growth; and the growth the Gaussian qualifies for, with the number
/// that remain after it.
fn fate(
    cloud: &Gaussians,
    used: SourceUse,
    statistics: [f32; 3],
    i: usize,
    limits: &Limits,
) -> (u32, Option<(Growth, u32)>) {
    let opacity = 1.0 / (1.0 + (-f64::from(used.highest_logit)).exp());
    if !is_finite(cloud, i) || opacity < limits.opacity_min {
        return (0, None);
    }
    let scale = cloud.log_scales[i].map(|s| f64::from(s).exp()).into_iter().fold(0.0, f64::max) * used.world_scale;
    let kept = u32::from(scale <= limits.scale_max && f64::from(statistics[2]) <= limits.radius_max_px);
    if !statistics[0].is_finite() || mean_gradient(statistics) < limits.gradient_threshold {
        return (kept, None);
    }
    if scale > limits.split_above {
        let fits = scale / limits.split_shrink <= limits.scale_max;
        return (kept, fits.then_some((Growth::Split, limits.split_count)));
    }
    (kept, (scale <= limits.scale_max).then_some((Growth::Clone, kept + 1)))
}

fn mean_gradient([sum, views, _]: [f32; 3]) -> f64 {
    f64::from(sum) / f64::from(views).max(1.0)
}

/// Densifies a plain cloud. `statistics` are those that the device accumulates per Gaussian.
pub fn densify(cloud: &Gaussians, statistics: &[[f32; 3]], limits: &Limits) -> Densified {
    densify_sources(cloud, &use_of_cloud(cloud), statistics, limits)
}

/// Densifies the source Gaussians of a scene: those of its templates, then those of its background.
pub fn densify_sources(cloud: &Gaussians, uses: &[SourceUse], statistics: &[[f32; 3]], limits: &Limits) -> Densified {
    let fates: Vec<_> = (0..cloud.len()).map(|i| fate(cloud, uses[i], statistics[i], i, limits)).collect();
    let mut total: u32 = fates.iter().zip(uses).map(|((kept, _), used)| kept * used.instances).sum();
    let mut order: Vec<usize> = (0..cloud.len()).filter(|&i| fates[i].1.is_some()).collect();
    // The sort is stable, so that the index breaks ties.
    order.sort_by(|&a, &b| mean_gradient(statistics[b]).total_cmp(&mean_gradient(statistics[a])));
    let mut grows = vec![false; cloud.len()];
    for i in order {
        let (kept, growth) = fates[i];
        total += uses[i].instances * growth.map_or(0, |(_, becomes)| becomes - kept);
        if total > limits.max_expanded {
            break;
        }
        grows[i] = true;
    }
    let mut out = Densified::default();
    for (i, (kept, growth)) in fates.into_iter().enumerate() {
        match growth.filter(|_| grows[i]) {
            Some((Growth::Split, children)) => {
                out.split += 1;
                out.origins.extend((0..children).map(|k| (i, Made::Child(k))));
            }
            Some((Growth::Clone, becomes)) => {
                out.cloned += 1;
                out.origins.extend((1..becomes).map(|_| (i, Made::Kept)));
                out.origins.push((i, Made::Copy));
            }
            None => out.origins.extend((0..kept).map(|_| (i, Made::Kept))),
        }
    }
    out
}

/// Mean and log scales of a new Gaussian.
pub fn shape(cloud: &Gaussians, (i, made): (usize, Made), limits: &Limits) -> ([f64; 3], [f64; 3]) {
    let (mean, log_scales) = (cloud.means[i].map(f64::from), cloud.log_scales[i].map(f64::from));
    let Made::Child(k) = made else { return (mean, log_scales) };
    let stream = Stream { seed: limits.seed, time: limits.time, purpose: RANDOM_SPLIT, index: i as u32 };
    let normals = stream.normals(k);
    let local = glam::DVec3::from_array(std::array::from_fn(|a| log_scales[a].exp() * normals[a]));
    let place = glam::DVec3::from_array(mean) + rotation_from_quat(cloud.quats[i].map(f64::from)) * local;
    (place.to_array(), log_scales.map(|s| s - limits.split_shrink.ln()))
}

/// Opacity logits after a reset to at most `opacity`.
pub fn reset_opacity(logits: &[f32], opacity: f64) -> Vec<f64> {
    let limit = (opacity / (1.0 - opacity)).ln();
    logits.iter().map(|&l| f64::from(l).min(limit)).collect()
}

/// Opacity logits after every opacity was lowered by `decay`, down to `floor`.
pub fn decay_opacity(logits: &[f32], decay: f64, floor: f64) -> Vec<f64> {
    let lowered = |&logit: &f32| {
        let opacity = 1.0 / (1.0 + (-f64::from(logit)).exp());
        let lowered = (opacity - decay).max(floor);
        if lowered < opacity { (lowered / (1.0 - lowered)).ln() } else { f64::from(logit) }
    };
    logits.iter().map(lowered).collect()
}
