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

use super::error::TrainError;
use super::report::Stage;
use super::segmented::{Segmented, stage, training_views};
use super::trainer::{TrainJob, eval_options};

/// The groups, in the run folder.
pub(super) const GROUPS: &str = "groups.json";

/// What is alike.
pub(super) struct Grouped {
    /// The groups.
    pub(super) groups: Vec<PosedGroup>,
    /// What became of every object; empty if the groups were given.
    pub(super) registration: Vec<InstanceRegistration>,
    /// Wall time of the registration.
    pub(super) stages: Vec<Stage>,
}

/// The groups of the configuration, or those that registration finds. The run folder gets a `groups.json` either way.
///
/// # Errors
/// A groups.json that is missing or damaged, or no two objects that are alike.
pub(super) fn grouped(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    cloud: &InstancedScene,
    segmented: &Segmented,
) -> Result<Grouped, TrainError> {
    let grouped = if job.config.groups.is_empty() {
        registered(gpu, job, cloud, segmented)?
    } else {
        let groups = read_groups(Path::new(&job.config.groups))?;
        Grouped { groups, registration: Vec::new(), stages: Vec::new() }
    };
    write_groups(&job.out.join(GROUPS), &grouped.groups)?;
    Ok(grouped)
}

fn registered(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    cloud: &InstancedScene,
    segmented: &Segmented,
) -> Result<Grouped, TrainError> {
    let started = Instant::now();
    let (_, cameras) = training_views(job)?;
    let objects = segmented.consensus.objects.iter();
    let categories: BTreeMap<u32, String> = objects.filter_map(|o| Some((o.id, o.category.clone()?))).collect();
    let (gaussians, labels) = (&cloud.background, segmented.labels.as_slice());
    let input =
        RegisterInput { cloud: gaussians, instance_of_gaussian: labels, categories: &categories, cameras: &cameras };
    // Of the Gaussians, not of photos: ids of masks need not be those of objects.
    let mut check = RenderCheck::new(gpu, (gaussians, labels), &cameras, eval_options(&job.config), None)?;
    let options = RegisterOptions {
        allow_scale: job.config.joint.refine_scales,
        seed: job.config.seed,
        ..RegisterOptions::default()
    };
    let found = register(&input, Some(&mut check), &options)?;
    if found.groups.is_empty() {
        let what = "no two objects of the masks are alike, so there is nothing to share; train with --method 3dgs, or \
                    say what is alike with --groups";
        return Err(TrainError::Other(what.into()));
    }
    Ok(Grouped { groups: found.groups, registration: found.instances, stages: vec![stage("register", started)] })
}

/// What the user should know of the objects, one line each.
pub(super) fn warnings(registration: &[InstanceRegistration]) -> impl Iterator<Item = String> + '_ {
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
