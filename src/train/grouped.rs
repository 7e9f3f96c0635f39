//! Which objects are alike, and where each stands: from the configuration's groups.json, or by registering the objects that
//! the masks show.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use crate::gpu::Gpu;
use crate::io::{read_groups, write_groups};
use crate::register::{InstanceRegistration, RegisterInput, RegisterOptions, RenderCheck, register};
use crate::scene::{InstancedScene, PosedGroup};

use super::config::TrainConfig;
use super::error::TrainError;
use super::report::Stage;
use super::segmented::{Segmented, stage};
use super::trainer::{TrainJob, eval_options};

/// The groups, in the run folder.
pub(super) const GROUPS: &str = "groups.json";

/// What is alike.
pub struct Grouped {
    /// The groups; none if no two objects are alike.
    pub groups: Vec<PosedGroup>,
    /// What became of every object; empty if the groups were given.
    pub registration: Vec<InstanceRegistration>,
    /// Wall time of the registration.
    pub stages: Vec<Stage>,
}

/// The groups of the configuration, or those that registration finds. The run folder gets a `groups.json` either way.
///
/// # Errors
/// A groups.json that is missing or damaged, or a device that fails.
pub(super) fn grouped(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    cloud: &InstancedScene,
    segmented: &Segmented,
) -> Result<Grouped, TrainError> {
    let grouped = if job.config.groups.is_empty() {
        registered(gpu, &job.config, cloud, segmented)?
    } else {
        let groups = read_groups(Path::new(&job.config.groups))?;
        Grouped { groups, registration: Vec::new(), stages: Vec::new() }
    };
    write_groups(&job.out.join(GROUPS), &grouped.groups)?;
    Ok(grouped)
}

/// Registers the objects of a segmented cloud; scales are free if the configuration refines them.
///
/// # Errors
/// A device that fails, or a cloud beyond it.
pub fn registered(
    gpu: &Arc<Gpu>,
    config: &TrainConfig,
    cloud: &InstancedScene,
    segmented: &Segmented,
) -> Result<Grouped, TrainError> {
    let started = Instant::now();
    let objects = segmented.consensus.objects.iter();
    let categories: BTreeMap<u32, String> = objects.filter_map(|o| Some((o.id, o.category.clone()?))).collect();
    let (gaussians, labels, cameras) = (&cloud.background, segmented.labels.as_slice(), &segmented.cameras);
    let input = RegisterInput { cloud: gaussians, instance_of_gaussian: labels, categories: &categories, cameras };
    // Of the Gaussians, not of photos: ids of masks need not be those of objects.
    let mut check = RenderCheck::new(gpu, (gaussians, labels), cameras, eval_options(config), None)?;
    let options =
        RegisterOptions { allow_scale: config.joint.refine_scales, seed: config.seed, ..RegisterOptions::default() };
    let found = register(&input, Some(&mut check), &options)?;
    Ok(Grouped { groups: found.groups, registration: found.instances, stages: vec![stage("register", started)] })
}

/// What the user should know of the objects, one line each.
pub fn warnings(registration: &[InstanceRegistration]) -> impl Iterator<Item = String> + '_ {
    use crate::register::Verdict::{Accepted, Ambiguous, Reference, Rejected, Symmetric};
    registration.iter().filter_map(|object| {
        let name = object.name.as_deref().unwrap_or("object");
        let (id, note) = (object.instance, &object.note);
        match object.verdict {
            Reference | Accepted | Symmetric => None,
            Ambiguous => Some(format!("{name} {id}: its pose is in doubt: {note}")),
            Rejected => Some(format!("{name} {id} stays in the background: {note}")),
        }
    })
}
