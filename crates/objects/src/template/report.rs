//! What became of each group, and how well its instances agree.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::own::OwnGaussians;
use super::template_cloud::{median, radius};
use crate::math::nearest::PointSet;

/// The share of largest distances that is left out of a mean: stray Gaussians, and what one of two views did not see.
const TRIMMED: f64 = 0.1;
/// Above this a group's instances are probably different objects, or posed wrongly. See the module's measurements.
pub const POOR_MATCH: f64 = 0.1;
/// Above this a group that was found is no group: it gains nothing and shows ghosts. Vases of room18, whose poses are wrong:
/// 0.20 to 0.22; left out, the scene has 32.34 instead of 32.26 dB. The largest of 40 groups that helped: 0.114.
pub const HOPELESS_MATCH: f64 = 0.15;

/// One instance of a group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InstanceReport {
    /// Its id in the masks.
    pub id: u32,
    /// Its own Gaussians in the cloud, those that are not finite left out.
    pub gaussians: usize,
    /// Its Gaussians that were left out because a parameter is not finite.
    pub non_finite: usize,
    /// It has enough Gaussians ([`MIN_OWN_GAUSSIANS`](super::MIN_OWN_GAUSSIANS)). Otherwise it is shown as the template,
    /// without differences.
    pub is_usable: bool,
    /// Template Gaussians that it has nothing near of; they start nearly transparent.
    pub lacking: usize,
    /// How far it is from the largest instance, as [`GroupReport::match_distance`]; `None` if it is not usable.
    pub match_distance: Option<f64>,
}

/// One group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroupReport {
    /// As in `groups.json`.
    pub template_id: u32,
    /// What the objects are.
    pub name: Option<String>,
    /// Which template of the scene it became; `None` if no instance has enough Gaussians, or if the match is worse than the
    /// options allow: the group is left out, and its Gaussians stay in the background.
    pub template: Option<u32>,
    /// In the group's order.
    pub instances: Vec<InstanceReport>,
    /// Fewest, mean and most own Gaussians of the usable instances; 0 if there are none.
    pub gaussians_per_instance: (usize, f64, usize),
    /// Gaussians of the template.
    pub template_gaussians: usize,
    /// How badly the instances agree in the common pose, 0 or more: the median of the other usable instances' distances
    /// from the largest. A distance is the mean of that from each Gaussian of one to the nearest of the other, both ways,
    /// without the largest tenth, beyond the spacing of the largest instance's own, per radius of the object. 0 for a
    /// single instance.
    pub match_distance: f64,
}

impl GroupReport {
    /// The instances are probably not alike, or posed wrongly: one template will hardly serve them.
    pub fn is_poor_match(&self) -> bool {
        self.match_distance > POOR_MATCH
    }

    /// Why it has no template; `None` if it has one.
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

    /// Only one instance is usable: the template is a copy of it, and sharing gains nothing.
    pub fn is_single(&self) -> bool {
        self.instances.iter().filter(|i| i.is_usable).count() == 1
    }
}

/// Fewest, mean, most.
pub(super) fn counts(instances: &[OwnGaussians]) -> (usize, f64, usize) {
    let counts: Vec<usize> = instances.iter().filter(|o| o.is_usable()).map(OwnGaussians::len).collect();
    let mean = counts.iter().sum::<usize>() as f64 / counts.len().max(1) as f64;
    (counts.iter().copied().min().unwrap_or(0), mean, counts.iter().copied().max().unwrap_or(0))
}

/// Per instance its distance from the largest one, `None` for those that are not usable.
pub(super) fn match_distances(instances: &[OwnGaussians]) -> Vec<Option<f64>> {
    let largest = instances.iter().map(OwnGaussians::len).max();
    let Some(reference) = instances.iter().find(|own| Some(own.len()) == largest) else { return Vec::new() };
    let set = PointSet::new(&reference.means);
    let apart = |p: &[f32; 3]| set.mean_squared_distance_to_others(*p, 1).sqrt();
    let spacing = trimmed_mean(reference.means.iter().map(apart).collect());
    let radius = radius(&reference.means);
    let distance = |own: &OwnGaussians| {
        let own_set = PointSet::new(&own.means);
        let there = trimmed_mean(own.means.iter().map(|&p| set.distance(p)).collect());
        let back = trimmed_mean(reference.means.iter().map(|&p| own_set.distance(p)).collect());
        let beyond = (0.5 * (there + back) - spacing).max(0.0);
        // Objects of no extent are all alike, unless they are apart.
        if beyond > 0.0 { (beyond / radius).min(f64::MAX) } else { 0.0 }
    };
    instances.par_iter().map(|own| own.is_usable().then(|| distance(own))).collect()
}

/// The group's figure from its instances': the median without the largest instance, which is at 0.
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
