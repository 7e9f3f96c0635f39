//! Report of templates, with a measure of how well the instances of a group agree.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::instance_cloud::InstanceCloud;
use super::template_cloud::{median, radius};
use instgs_vk::math::nearest::PointSet;

/// Part of the largest distances that a mean leaves out: stray Gaussians, and parts that only one instance has.
const TRIMMED: f64 = 0.1;
/// Match distance above which instances are probably different objects or posed wrongly.
pub const POOR_MATCH: f64 = 0.1;
/// Match distance above which a registered group is left out: it gains nothing and shows ghosts.
pub const HOPELESS_MATCH: f64 = 0.15;

/// One instance of a group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceReport {
    /// Id of the instance in the masks.
    pub id: u32,
    /// Number of its finite Gaussians in the cloud.
    pub gaussians: usize,
    /// Number of its Gaussians that were dropped because a parameter is not finite.
    pub non_finite: usize,
    /// Whether it has enough Gaussians ([`MIN_INSTANCE_GAUSSIANS`](super::MIN_INSTANCE_GAUSSIANS)); otherwise it is shown as the
    /// template, without offsets.
    pub is_usable: bool,
    /// Number of template Gaussians without a near match in it, which start nearly transparent.
    pub lacking: usize,
    /// Number of its Gaussians without a match that became its own.
    #[serde(default)]
    pub own: usize,
    /// Distance from the largest instance, as in [`GroupReport::match_distance`]; `None` if it is not usable.
    pub match_distance: Option<f64>,
}

/// One group of `groups.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupReport {
    /// Id of the group in `groups.json`.
    pub template_id: u32,
    /// Name of the kind of object, if given.
    pub name: Option<String>,
    /// Index of its template in the scene; `None` if no instance has enough Gaussians or the match is worse than the
    /// options allow. Then the group's Gaussians stay in the background.
    pub template: Option<u32>,
    /// Reports of its instances, in the group's order.
    pub instances: Vec<InstanceReport>,
    /// Minimum, mean and maximum number of Gaussians of the usable instances; 0 if there are none.
    pub gaussians_per_instance: (usize, f64, usize),
    /// Number of Gaussians of the template.
    pub template_gaussians: usize,
    /// How badly the instances agree in the common pose, 0 or more: the median over the usable instances of their
    /// distances from the largest one. A distance is the mean from each Gaussian of one to the nearest of the other, in
    /// both directions and without the largest tenth, less the spacing within the largest instance, divided by the
    /// object's radius. 0 for a single instance.
    pub match_distance: f64,
}

impl GroupReport {
    /// Whether the instances are probably unlike or posed wrongly, so that one template hardly fits them.
    pub fn is_poor_match(&self) -> bool {
        self.match_distance > POOR_MATCH
    }

    /// Reason why the group has no template, for the user; `None` if it has one.
    pub fn left_out(&self) -> Option<String> {
        let usable = self.instances.iter().any(|i| i.is_usable);
        let why = || {
            if !usable {
                return "no instance has enough Gaussians; it stays in the background".to_owned();
            }
            format!(
                "its objects are not alike, or posed wrongly (match distance {:.3}, good below {POOR_MATCH:.2}); it stays in \
                 the background, unless groups.json is given (--groups)",
                self.match_distance
            )
        };
        self.template.is_none().then(why)
    }

    /// Whether only one instance is usable: the template is a copy of it, and sharing gains nothing.
    pub fn is_single(&self) -> bool {
        self.instances.iter().filter(|i| i.is_usable).count() == 1
    }
}

/// Minimum, mean and maximum number of Gaussians of the usable instances.
pub(super) fn counts(instances: &[InstanceCloud]) -> (usize, f64, usize) {
    let counts: Vec<usize> = instances.iter().filter(|o| o.is_usable()).map(InstanceCloud::len).collect();
    let mean = counts.iter().sum::<usize>() as f64 / counts.len().max(1) as f64;
    (counts.iter().copied().min().unwrap_or(0), mean, counts.iter().copied().max().unwrap_or(0))
}

/// Distance of each instance from the largest one; `None` for those that are not usable.
pub(super) fn match_distances(instances: &[InstanceCloud]) -> Vec<Option<f64>> {
    let largest = instances.iter().map(InstanceCloud::len).max();
    let Some(reference) = instances.iter().find(|own| Some(own.len()) == largest) else { return Vec::new() };
    let set = PointSet::new(&reference.means);
    let apart = |p: &[f32; 3]| set.mean_squared_distance_to_others(*p, 1).sqrt();
    let spacing = trimmed_mean(reference.means.iter().map(apart).collect());
    let radius = radius(&reference.means);
    let distance = |own: &InstanceCloud| {
        let own_set = PointSet::new(&own.means);
        let there = trimmed_mean(own.means.iter().map(|&p| set.distance(p)).collect());
        let back = trimmed_mean(reference.means.iter().map(|&p| own_set.distance(p)).collect());
        let beyond = (0.5 * (there + back) - spacing).max(0.0);
        // Objects without extent are alike unless they are apart.
        if beyond > 0.0 { (beyond / radius).min(f64::MAX) } else { 0.0 }
    };
    instances.par_iter().map(|own| own.is_usable().then(|| distance(own))).collect()
}

/// Median of the instances' distances without the smallest, the largest instance's own 0.
pub(super) fn group_match_distance(instances: &[Option<f64>]) -> f64 {
    let mut usable: Vec<f64> = instances.iter().flatten().copied().collect();
    usable.sort_unstable_by(f64::total_cmp);
    median(usable.split_off(usable.len().min(1)))
}

fn trimmed_mean(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let kept = ((1.0 - TRIMMED) * values.len() as f64).ceil() as usize;
    values[..kept].iter().sum::<f64>() / kept.max(1) as f64
}
