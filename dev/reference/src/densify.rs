//! Twin of `source_use`, `densify_cost`, `densify_retire`, `densify_own_need`, `densify_mark`, `densify_select`, `densify_own_select`, `densify_place`,
//! `densify_place_own`, `densify_place_offsets`, `densify_own`, `densify_split`, `densify_split_offsets`, `move_gaussians`,
//! `reset_opacity` and `decay_opacity`, on plain lists.

use glam::{DMat3, DVec3};
use instgs_vk::math::covariance::rotation_from_quat;
use instgs_vk::math::sh::{SH_C0, widened};
use instgs_vk::scene::{Gaussians, Instance, InstancedScene};

use super::random::{RANDOM_SPLIT, Stream};

/// Thresholds of densification and pruning, in plain units.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Mean screen-space gradient from which on a Gaussian is cloned or split.
    pub gradient_threshold: f64,
    /// Whether children divide the longest axis of their parent instead of being drawn inside it.
    pub halves: bool,
    /// Gaussians of a larger scale are split instead of cloned, scene units.
    pub split_above: f64,
    /// Number of children of a split Gaussian.
    pub split_count: u32,
    /// The children's scales are the parent's divided by this; with `halves` only the longest.
    pub split_shrink: f64,
    /// The children's opacities are the parent's times this.
    pub child_opacity: f64,
    /// Gaussians of lower opacity are pruned.
    pub opacity_min: f64,
    /// Gaussians of a larger scale are pruned, scene units.
    pub scale_max: f64,
    /// Gaussians of a larger screen radius are pruned, px.
    pub radius_max_px: f64,
    /// Upper limit on the number of expanded Gaussians afterwards.
    pub max_expanded: u32,
    /// Largest part of the instances that grow alone.
    pub own_share: f64,
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

/// How one Gaussian grows: by a clone or by a split, or in some of its instances alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Growth {
    Clone,
    Split,
    Own,
}

/// The Gaussians after densification, each with the old one it comes from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Densified {
    /// Index of the old Gaussian and origin, by new Gaussian; those that instances get for their own left out.
    pub origins: Vec<(usize, Made)>,
    /// By instance, what it gets for its own.
    pub own: Vec<Vec<OwnGaussian>>,
    /// Number of cloned Gaussians.
    pub cloned: u32,
    /// Number of split Gaussians.
    pub split: u32,
}

/// A Gaussian that an instance gets for its own.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnGaussian {
    /// Index of the source Gaussian of its template.
    pub source: usize,
    /// What it is made as: a copy, or the child whose number is the instance's index.
    pub made: Made,
}

/// The instances of a source Gaussian that call for growth alone, and their mean screen gradient.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnNeed {
    /// Indices of the instances, ascending.
    pub instances: Vec<usize>,
    /// Their mean screen gradient.
    pub gradient: f64,
}

/// What instances call for, by source Gaussian. `records` has, by offset record, the sum of screen gradients and the number of
/// views that show the Gaussian.
pub fn own_needs(scene: &InstancedScene, records: &[[f32; 2]], limits: &Limits) -> Vec<OwnNeed> {
    let mut out = vec![OwnNeed::default(); scene.source_len()];
    for (template, range) in scene.template_ranges.iter().enumerate() {
        let users: Vec<usize> =
            (0..scene.instances.len()).filter(|&k| scene.instances[k].template as usize == template).collect();
        for local in 0..range.count {
            let record = |k: &usize| scene.instances[*k].first_offset.map(|first| records[(first + local) as usize]);
            let needs = |k: &usize| {
                let Some([sum, views]) = record(k) else { return false };
                sum.is_finite() && views > 0.0 && f64::from(sum) >= limits.gradient_threshold * f64::from(views)
            };
            let instances: Vec<usize> = users.iter().copied().filter(needs).collect();
            if users.len() < 2 || instances.len() as f64 > limits.own_share * users.len() as f64 {
                continue;
            }
            let [sum, views] =
                [0, 1].map(|c| instances.iter().filter_map(record).map(|r| f64::from(r[c])).sum::<f64>());
            out[(range.first + local) as usize] = OwnNeed { gradient: sum / views.max(1.0), instances };
        }
    }
    out
}

/// A Gaussian in the frame of a template.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenGaussian {
    /// Centre, template units.
    pub mean: DVec3,
    /// Quaternion (w, x, y, z) of any length.
    pub quat: [f64; 4],
    /// Natural logarithms of the standard deviations.
    pub log_scales: DVec3,
    /// Logit of the opacity.
    pub opacity_logit: f64,
    /// SH coefficients `[C][rgb]`.
    pub sh: Vec<DVec3>,
}

/// What instance `k` has of Gaussian `local` of its template, offsets and colour matrix included.
pub fn seen_gaussian(scene: &InstancedScene, k: usize, local: u32) -> SeenGaussian {
    let instance = &scene.instances[k];
    let i = (scene.template_ranges[instance.template as usize].first + local) as usize;
    let (t, o) = (&scene.templates, &scene.offsets);
    let record = instance.first_offset.map(|first| (first + local) as usize);
    let offset = |values: &[[f32; 3]]| record.and_then(|m| values.get(m)).map_or(DVec3::ZERO, |&d| widened(d));
    let mean = widened(t.means[i]) + offset(&o.means);
    let log_scales = widened(t.log_scales[i]) + offset(&o.log_scales);
    let d_quat = record.and_then(|m| o.quats.get(m)).copied().unwrap_or_default();
    let quat = std::array::from_fn(|c| f64::from(t.quats[i][c]) + f64::from(d_quat[c]));
    let opacity_logit = f64::from(t.opacity_logits[i]) + record.map_or(0.0, |m| f64::from(o.opacity_logits[m]));
    let mut sh: Vec<DVec3> = t.sh_of(i).iter().map(|&c| widened(c)).collect();
    sh[0] += offset(&o.sh_dc);
    let rest = record.map_or(&[][..], |m| o.rest_of(m));
    sh[1..].iter_mut().zip(rest).for_each(|(sh, &d)| *sh += widened(d));
    if let Some(rows) = scene.color_matrix(k) {
        let rows = rows.map(|row| row.map(f64::from));
        let linear = DMat3::from_cols_array_2d(&rows.map(|[r, g, b, _]| [r, g, b])).transpose();
        sh.iter_mut().for_each(|c| *c = linear * *c);
        let constant = linear * DVec3::splat(0.5) + DVec3::from_array(rows.map(|row| row[3])) - 0.5;
        sh[0] += constant / SH_C0;
    }
    SeenGaussian { mean, quat, log_scales, opacity_logit, sh }
}

/// What an instance gets of a Gaussian that it has: the Gaussian itself, or a smaller one within it.
pub fn own_of(seen: SeenGaussian, own: &OwnGaussian, limits: &Limits) -> SeenGaussian {
    let Made::Child(k) = own.made else { return seen };
    let place = child_place(own.source, k, seen.log_scales, limits);
    SeenGaussian {
        mean: seen.mean + rotation_from_quat(seen.quat) * (seen.log_scales.exp() * place),
        log_scales: child_log_scales(seen.log_scales, limits),
        opacity_logit: child_logit(seen.opacity_logit, limits),
        ..seen
    }
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

/// Adam's second moments of opacity logits: of source Gaussians and of offset records.
#[derive(Clone, Debug)]
pub struct LogitMoments {
    /// By source Gaussian.
    pub sources: Vec<f32>,
    /// By offset record.
    pub records: Vec<f32>,
}

/// What the loss feels of the opacity of each source Gaussian, summed over its instances: the mean square of the gradient by the
/// logit, as if the opacity could move freely.
pub fn felt_of_sources(scene: &InstancedScene, moments: &LogitMoments) -> Vec<f64> {
    let felt = |square: f32, logit: f32| {
        let transparency = (1.0 / (1.0 + f64::from(logit.min(20.0)).exp())).max(1e-3);
        f64::from(square) / (transparency * transparency)
    };
    let mut out = vec![0.0; scene.templates.len()];
    for (template, range) in scene.template_ranges.iter().enumerate() {
        let users: Vec<&Instance> =
            scene.instances.iter().filter(|instance| instance.template as usize == template).collect();
        for local in 0..range.count {
            let source = (range.first + local) as usize;
            let logit = scene.templates.opacity_logits[source];
            let shared = moments.sources[source] / users.len().max(1) as f32;
            let of_user = |user: &&Instance| {
                let Some(first) = user.first_offset else { return felt(shared, logit) };
                let record = (first + local) as usize;
                let moment = moments.records[record];
                felt(if moment > 0.0 { moment } else { shared }, logit + scene.offsets.opacity_logits[record])
            };
            out[source] = if users.is_empty() { felt(shared, logit) } else { users.iter().map(of_user).sum() };
        }
    }
    let alone = scene.own.opacity_logits.iter().chain(&scene.background.opacity_logits);
    out.extend(alone.zip(&moments.sources[scene.templates.len()..]).map(|(&logit, &moment)| felt(moment, logit)));
    out
}

/// What the loss would feel without a source Gaussian, for each of its instances: `felt` (see [`felt_of_sources`]) over the views
/// that show it. `steps` is the number of steps that the statistics are of; their second number is that of the views, summed over
/// instances.
pub fn removal_cost(felt: f64, statistics: &[f32; 3], source: &SourceUse, steps: f64) -> f64 {
    let used = f64::from(source.instances.max(1));
    let share = (f64::from(statistics[1]) / (steps * used)).clamp(0.02, 1.0);
    felt / (share * used)
}

/// Which source Gaussians leave so that `goal` expanded ones are free: those of the least cost, ties by index.
pub fn retired(costs: &[f64], uses: &[SourceUse], goal: u32) -> Vec<bool> {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
    let mut out = vec![false; costs.len()];
    let mut freed = 0;
    for i in order {
        if freed >= goal {
            break;
        }
        out[i] = true;
        freed += uses[i].instances;
    }
    out
}

/// The use of each Gaussian of a plain cloud.
pub fn use_of_cloud(cloud: &Gaussians) -> Vec<SourceUse> {
    let used = |&highest_logit: &f32| SourceUse { instances: 1, highest_logit, world_scale: 1.0 };
    cloud.opacity_logits.iter().map(used).collect()
}

/// The use of each source Gaussian of a scene in which every one belongs to a template, an instance or the background.
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
    let mut of_own = use_of_cloud(&scene.own);
    for (k, instance) in scene.instances.iter().enumerate() {
        of_own[scene.own_range(k).indices()].iter_mut().for_each(|used| {
            used.world_scale = instance.world_from_template.scale();
        });
    }
    out.extend(of_own);
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
    need: &OwnNeed,
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
    if kept == 1 && !need.instances.is_empty() {
        return (1, Some((Growth::Own, 1)));
    }
    if !statistics[0].is_finite() || mean_gradient(statistics) < limits.gradient_threshold {
        return (kept, None);
    }
    if scale > limits.split_above {
        let children = child_log_scales(widened(cloud.log_scales[i]), limits);
        let fits = children.max_element().exp() * used.world_scale <= limits.scale_max;
        return (kept, fits.then_some((Growth::Split, limits.split_count)));
    }
    (kept, (scale <= limits.scale_max).then_some((Growth::Clone, kept + 1)))
}

fn mean_gradient([sum, views, _]: [f32; 3]) -> f64 {
    f64::from(sum) / f64::from(views).max(1.0)
}

/// Densifies a plain cloud. `statistics` are those that the device accumulates per Gaussian.
pub fn densify(cloud: &Gaussians, statistics: &[[f32; 3]], limits: &Limits) -> Densified {
    densify_sources(cloud, &use_of_cloud(cloud), &vec![OwnNeed::default(); cloud.len()], statistics, limits)
}

/// Densifies the source Gaussians of a scene: those of its templates, instances' own, then those of its background.
pub fn densify_sources(
    cloud: &Gaussians,
    uses: &[SourceUse],
    needs: &[OwnNeed],
    statistics: &[[f32; 3]],
    limits: &Limits,
) -> Densified {
    let fates: Vec<_> = (0..cloud.len()).map(|i| fate(cloud, uses[i], &needs[i], statistics[i], i, limits)).collect();
    let mut total: u32 = fates.iter().zip(uses).map(|((kept, _), used)| kept * used.instances).sum();
    let mut order: Vec<usize> = (0..cloud.len()).filter(|&i| fates[i].1.is_some()).collect();
    // The sort is stable, so that the index breaks ties.
    let gradient = |i: usize| match fates[i].1 {
        Some((Growth::Own, _)) => needs[i].gradient,
        _ => mean_gradient(statistics[i]),
    };
    order.sort_by(|&a, &b| gradient(b).total_cmp(&gradient(a)));
    let mut grows = vec![false; cloud.len()];
    for i in order {
        let (kept, growth) = fates[i];
        total += match growth {
            Some((Growth::Own, _)) => needs[i].instances.len() as u32,
            _ => uses[i].instances * growth.map_or(0, |(_, becomes)| becomes - kept),
        };
        if total > limits.max_expanded {
            break;
        }
        grows[i] = true;
    }
    let instances = needs.iter().flat_map(|need| need.instances.last()).max().map_or(0, |last| last + 1);
    let mut out = Densified { own: vec![Vec::new(); instances], ..Densified::default() };
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
            Some((Growth::Own, _)) => {
                out.origins.push((i, Made::Kept));
                let scale = cloud.log_scales[i].map(|s| f64::from(s).exp()).into_iter().fold(0.0, f64::max);
                let splits = scale * uses[i].world_scale > limits.split_above;
                for &k in &needs[i].instances {
                    let made = if splits { Made::Child(k as u32) } else { Made::Copy };
                    out.own[k].push(OwnGaussian { source: i, made });
                }
            }
            None => out.origins.extend((0..kept).map(|_| (i, Made::Kept))),
        }
    }
    out
}

/// The longest axis; of equal ones the first.
fn longest_axis(log_scales: DVec3) -> usize {
    (1..3).fold(0, |longest, a| if log_scales[a] > log_scales[longest] { a } else { longest })
}

/// Log scales of a child of a Gaussian that has `log_scales`.
fn child_log_scales(mut log_scales: DVec3, limits: &Limits) -> DVec3 {
    let shrink = limits.split_shrink.ln();
    if limits.halves {
        let axis = longest_axis(log_scales);
        log_scales[axis] -= shrink;
        return log_scales;
    }
    log_scales - shrink
}

/// Where child `k` of Gaussian `i` lies from its parent's centre, standard deviations along the parent's axes.
fn child_place(i: usize, k: u32, log_scales: DVec3, limits: &Limits) -> DVec3 {
    if limits.halves {
        let mut place = DVec3::ZERO;
        let distance = (1.0 - limits.split_shrink.powi(-2)).sqrt();
        place[longest_axis(log_scales)] = if k.is_multiple_of(2) { distance } else { -distance };
        return place;
    }
    let stream = Stream { seed: limits.seed, time: limits.time, purpose: RANDOM_SPLIT, index: i as u32 };
    DVec3::from_array(stream.normals(k))
}

/// Opacity logit of a child of a Gaussian that has `logit`.
fn child_logit(logit: f64, limits: &Limits) -> f64 {
    let opacity = limits.child_opacity / (1.0 + (-logit).exp());
    if limits.child_opacity < 1.0 { (opacity / (1.0 - opacity)).ln() } else { logit }
}

/// Opacity logit of a new Gaussian.
pub fn opacity_logit(cloud: &Gaussians, (i, made): (usize, Made), limits: &Limits) -> f64 {
    let logit = f64::from(cloud.opacity_logits[i]);
    if matches!(made, Made::Child(_)) { child_logit(logit, limits) } else { logit }
}

/// Mean and log scales of a new Gaussian.
pub fn shape(cloud: &Gaussians, (i, made): (usize, Made), limits: &Limits) -> ([f64; 3], [f64; 3]) {
    let (mean, log_scales) = (cloud.means[i].map(f64::from), cloud.log_scales[i].map(f64::from));
    let Made::Child(k) = made else { return (mean, log_scales) };
    let scales = DVec3::from_array(log_scales);
    let local = scales.exp() * child_place(i, k, scales, limits);
    let place = DVec3::from_array(mean) + rotation_from_quat(cloud.quats[i].map(f64::from)) * local;
    (place.to_array(), child_log_scales(scales, limits).to_array())
}

/// What an offset record has of a new Gaussian, besides what it inherits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewOffsets {
    /// Offset of the mean, template units.
    pub mean: DVec3,
    /// Offset of the opacity logit.
    pub opacity_logit: f64,
}

/// The offsets that instance `k`, which has some, gets for a new Gaussian of its template: children divide what the instance
/// shows of their parent, at the place among its standard deviations that the template's have among the template's.
pub fn new_offsets(scene: &InstancedScene, k: usize, (i, made): (usize, Made), limits: &Limits) -> NewOffsets {
    let templates = &scene.templates;
    let first = scene.template_ranges[scene.instances[k].template as usize].first;
    let mut seen = seen_gaussian(scene, k, i as u32 - first);
    if let Made::Child(child) = made {
        let place = child_place(i, child, widened(templates.log_scales[i]), limits);
        seen.mean += rotation_from_quat(seen.quat) * (seen.log_scales.exp() * place);
        seen.opacity_logit = child_logit(seen.opacity_logit, limits);
    }
    let (mean, _) = shape(templates, (i, made), limits);
    NewOffsets {
        mean: seen.mean - DVec3::from_array(mean),
        opacity_logit: seen.opacity_logit - opacity_logit(templates, (i, made), limits),
    }
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
