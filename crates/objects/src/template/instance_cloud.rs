//! The Gaussians of the cloud that each instance owns.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::common_pose::TemplateFromWorld;
use super::error::TemplateError;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, PosedGroup};

/// Instances with fewer Gaussians in the cloud are not usable: they take no part in the merge and get zero offsets.
pub const MIN_INSTANCE_GAUSSIANS: usize = 8;

/// One instance's Gaussians, with their positions in the template's frame.
pub(super) struct InstanceCloud {
    /// The inverse of the instance's pose.
    pub template_from_world: TemplateFromWorld,
    /// Indices into the cloud, ascending, of finite Gaussians only.
    pub indices: Vec<u32>,
    /// Means of these Gaussians, template frame.
    pub means: Vec<[f32; 3]>,
    /// Number of Gaussians of this instance that were dropped because a parameter is not finite.
    pub non_finite: usize,
}

impl InstanceCloud {
    pub(super) fn new(cloud: &Gaussians, labelled: &[u32], world_from_template: &Similarity) -> Self {
        let template_from_world = TemplateFromWorld::new(world_from_template);
        let (mut indices, mut means) = (Vec::new(), Vec::new());
        for &i in labelled {
            let mean = template_from_world.mean(cloud.means[i as usize]);
            if cloud.is_finite(i as usize) && mean.iter().all(|v| v.is_finite()) {
                indices.push(i);
                means.push(mean);
            }
        }
        Self { template_from_world, non_finite: labelled.len() - indices.len(), indices, means }
    }

    /// Number of finite Gaussians.
    pub(super) fn len(&self) -> usize {
        self.indices.len()
    }

    /// Whether there are at least [`MIN_INSTANCE_GAUSSIANS`].
    pub(super) fn is_usable(&self) -> bool {
        self.len() >= MIN_INSTANCE_GAUSSIANS
    }
}

/// The Gaussians of each group's instances, and the group of each Gaussian.
pub(super) struct Owners {
    /// `[group][instance]`: indices of the Gaussians with the instance's label, ascending.
    labelled: Vec<Vec<Vec<u32>>>,
    /// By Gaussian: index of its group; `None` if it is in no group.
    pub group_of_gaussian: Vec<Option<u32>>,
}

impl Owners {
    /// Evaluates one label per Gaussian.
    ///
    /// # Errors
    /// An instance id that is 0 or listed twice.
    pub(super) fn new(instance_of_gaussian: &[u32], groups: &[PosedGroup]) -> Result<Self, TemplateError> {
        let mut place_of_id = BTreeMap::new();
        for (g, group) in groups.iter().enumerate() {
            for (k, instance) in group.instances.iter().enumerate() {
                let (template_id, id) = (group.template_id, instance.id);
                let repeated = place_of_id.insert(id, (g, k)).is_some();
                if repeated || id == 0 {
                    let reason = if repeated { "is listed twice" } else { "means background" };
                    return Err(TemplateError::InstanceId { template_id, id, reason });
                }
            }
        }
        let mut labelled: Vec<Vec<Vec<u32>>> = groups.iter().map(|g| vec![Vec::new(); g.instances.len()]).collect();
        let mut group_of_gaussian = vec![None; instance_of_gaussian.len()];
        for (i, id) in instance_of_gaussian.iter().enumerate().filter(|(_, id)| **id != 0) {
            if let Some(&(g, k)) = place_of_id.get(id) {
                labelled[g][k].push(i as u32);
                group_of_gaussian[i] = Some(g as u32);
            }
        }
        Ok(Self { labelled, group_of_gaussian })
    }

    /// The Gaussians of each instance of group `g`, in order.
    pub(super) fn instances(&self, cloud: &Gaussians, g: usize, group: &PosedGroup) -> Vec<InstanceCloud> {
        let posed = self.labelled[g].par_iter().zip(&group.instances);
        posed.map(|(labelled, instance)| InstanceCloud::new(cloud, labelled, &instance.world_from_template)).collect()
    }
}
