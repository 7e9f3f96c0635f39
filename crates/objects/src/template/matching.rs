//! Matches each template Gaussian to one of an instance's Gaussians in the cloud.

use glam::DVec3;
use rayon::prelude::*;

use super::instance_cloud::InstanceCloud;
use super::offsets::{LACKING_LOGIT, clamped_logit};
use super::options::Doubles;
use super::template_cloud::TemplateCloud;
use instgs_vk::math::covariance::{logit, rotation_from_quat, sigmoid};
use instgs_vk::math::halves::Halves;
use instgs_vk::math::log_covariance::Shape;
use instgs_vk::math::nearest::{Neighbour, PointSet};
use instgs_vk::math::sh::widened;
use instgs_vk::scene::Gaussians;

/// Number of nearest Gaussians of the instance that a template Gaussian may be matched to.
const CANDIDATES: usize = 16;
/// Cost of a difference in size: a Gaussian larger by the factor e in area counts as this many squared spacings farther
/// away. The less an offset has to change, the fewer steps it takes, and shapes may have none.
const AREA_WEIGHT: f64 = 3.0;

/// The instance's Gaussian that a template Gaussian is matched to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    /// Index among the instance's Gaussians.
    pub own: u32,
    /// Squared distance, template units.
    pub squared_distance: f64,
    /// Cost of the match: the squared distance plus the penalty for different sizes.
    cost: f64,
    /// Number of template Gaussians with the same match, at least 1.
    sharing: u32,
    /// Of two with the same match, the half that this one stands for; `None` if it stands for all of it, or shares its opacity.
    half: Option<Half>,
}

/// A half of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Half {
    /// 1 = the one ahead along the longest axis, -1 = the other.
    side: f64,
    /// How it and the other one differ from the whole.
    like: Halves,
}

/// What a template Gaussian stands for in an instance, in the template's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Counterpart {
    pub mean: [f32; 3],
    pub shape: Shape,
    /// Clamped to the range that training can change.
    pub opacity_logit: f32,
}

impl Match {
    /// Whether the match is near enough for template Gaussian `i`; otherwise the instance lacks that Gaussian.
    pub(super) fn is_near(&self, template: &TemplateCloud, i: usize) -> bool {
        self.squared_distance.sqrt() <= template.reach(i)
    }

    /// The instance's Gaussian that it stands for, or its part of it.
    pub(super) fn counterpart(&self, cloud: &Gaussians, own: &InstanceCloud) -> Counterpart {
        let source = own.indices[self.own as usize] as usize;
        let (mean, shape) = (own.means[self.own as usize], own.template_from_world.shape(cloud, source));
        let alone = clamped_logit(cloud.opacity_logits[source]);
        let Some(Half { side, like }) = self.half else {
            return Counterpart { mean, shape, opacity_logit: self.opacity_logit(alone) };
        };
        let (k, axis) = longest_axis(&shape);
        let sigma = shape.log_scales[k].exp();
        let mut log_scales = shape.log_scales;
        log_scales[k] -= like.shrink.ln();
        let away = axis * (side * like.distance() * sigma);
        let opacity = like.opacity * sigmoid(f64::from(alone));
        Counterpart {
            mean: (widened(mean) + away).as_vec3().to_array(),
            shape: Shape { log_scales, ..shape },
            opacity_logit: clamped_logit(not_too_faint(logit(opacity) as f32, alone)),
        }
    }

    /// Logit of the opacity at which the template Gaussians that share a match cover together what it covers alone: 1 -
    /// (1 - alpha)^(1 / sharing), as for the copies of 3DGS-MCMC (Kheradmand et al. 2024, eq. 9). Clamped to the range
    /// that training can change.
    fn opacity_logit(&self, alone: f32) -> f32 {
        if self.sharing <= 1 {
            return alone;
        }
        let transmitted = 1.0 - sigmoid(f64::from(alone));
        let shared = logit(1.0 - transmitted.powf(1.0 / f64::from(self.sharing))) as f32;
        clamped_logit(not_too_faint(shared, alone))
    }
}

/// Not fainter than hidden Gaussians, unless it was before (`alone`): it would never come back.
fn not_too_faint(logit: f32, alone: f32) -> f32 {
    logit.max(LACKING_LOGIT.min(alone))
}

/// Index and direction of the longest axis.
fn longest_axis(shape: &Shape) -> (usize, DVec3) {
    let logs = &shape.log_scales;
    let k = (1..3).fold(0, |k, other| if logs[other] > logs[k] { other } else { k });
    (k, rotation_from_quat(shape.quat).col(k))
}

/// A match for every template Gaussian. Pairs are accepted in order of cost, and an instance's Gaussian takes part in at most
/// `ceil(N / own)` of them; a template Gaussian left without a match gets its cheapest one. The instance must have
/// Gaussians.
pub(super) fn match_template(
    template: &TemplateCloud,
    cloud: &Gaussians,
    own: &InstanceCloud,
    doubles: Doubles,
) -> Vec<Match> {
    let candidates = candidates(template, cloud, own);
    let mut pairs: Vec<(u32, Match)> =
        candidates.iter().enumerate().flat_map(|(i, near)| near.iter().map(move |&m| (i as u32, m))).collect();
    pairs.par_sort_unstable_by(|(i, a), (j, b)| a.cost.total_cmp(&b.cost).then(i.cmp(j)).then(a.own.cmp(&b.own)));
    let mut room = vec![candidates.len().div_ceil(own.len().max(1)); own.len()];
    let mut matches: Vec<Option<Match>> = vec![None; candidates.len()];
    for (i, pair) in pairs {
        let (place, room) = (&mut matches[i as usize], &mut room[pair.own as usize]);
        if place.is_none() && *room > 0 {
            *room -= 1;
            *place = Some(pair);
        }
    }
    let mut matches: Vec<Match> =
        matches.into_iter().zip(candidates).map(|(matched, near)| matched.unwrap_or(near[0])).collect();
    let mut sharing = vec![0u32; own.len()];
    for (_, matched) in matches.iter().enumerate().filter(|(i, m)| m.is_near(template, *i)) {
        sharing[matched.own as usize] += 1;
    }
    matches.iter_mut().for_each(|matched| matched.sharing = sharing[matched.own as usize].max(1));
    if let Doubles::Halves(like) = doubles {
        take_sides(&mut matches, template, cloud, own, like);
    }
    matches
}

/// Gives each of two template Gaussians with the same match its half: that on whose side it lies.
fn take_sides(matches: &mut [Match], template: &TemplateCloud, cloud: &Gaussians, own: &InstanceCloud, like: Halves) {
    let mut first_of: Vec<Option<usize>> = vec![None; own.len()];
    for i in 0..matches.len() {
        let j = matches[i].own as usize;
        if matches[i].sharing != 2 || !matches[i].is_near(template, i) {
            continue;
        }
        let Some(first) = first_of[j].replace(i) else { continue };
        let (_, axis) = longest_axis(&own.template_from_world.shape(cloud, own.indices[j] as usize));
        let along = |i: usize| widened(template.gaussians.means[i]).dot(axis);
        let side = if along(i) > along(first) { 1.0 } else { -1.0 };
        (matches[i].half, matches[first].half) = (Some(Half { side, like }), Some(Half { side: -side, like }));
    }
}

/// For each template Gaussian, its nearest Gaussians of the instance in order of cost.
fn candidates(template: &TemplateCloud, cloud: &Gaussians, own: &InstanceCloud) -> Vec<Vec<Match>> {
    let set = PointSet::new(&own.means);
    let frame = &own.template_from_world;
    let own_log_area = |j: u32| log_area(frame.log_scales(cloud.log_scales[own.indices[j as usize] as usize]));
    let own_log_areas: Vec<f64> = (0..own.len() as u32).into_par_iter().map(own_log_area).collect();
    let weight = AREA_WEIGHT * template.median_spacing * template.median_spacing;
    let gaussians = &template.gaussians;
    let near = |(i, &mean): (usize, &[f32; 3])| {
        let template_log_area = log_area(gaussians.log_scales[i]);
        let matched = |n: Neighbour| {
            let larger = own_log_areas[n.index as usize] - template_log_area;
            let cost = n.squared_distance + weight * larger * larger;
            Match { own: n.index, squared_distance: n.squared_distance, cost, sharing: 1, half: None }
        };
        let mut near: Vec<Match> = set.nearest(mean, CANDIDATES).into_iter().map(matched).collect();
        near.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        near
    };
    gaussians.means.par_iter().enumerate().map(near).collect()
}

/// Logarithm of the product of the two larger standard deviations.
fn log_area(log_scales: [f32; 3]) -> f64 {
    let [x, y, z] = log_scales.map(f64::from);
    x + y + z - x.min(y).min(z)
}
