//! Groups of objects that are alike, with the pose of each: from groups.json, or by registering the masks' objects.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::register::{InstanceRegistration, RegisterInput, RegisterOptions, RenderCheck, Verdict, polished, register};
use instgs_io::json::{read_json, write_json};
use instgs_io::{IoError, RunFolder, read_groups, remove_if_there, write_groups};
use instgs_vk::gpu::Gpu;
use instgs_vk::scene::{InstancedScene, PosedGroup};

use super::config::RunConfig;
use super::error::PipelineError;
use super::job::PipelineJob;
use super::label_gaussians::CloudLabels;
use super::observer::Observer;
use super::run::joint_has_begun;
use super::stage_kinds::Stage;
use instgs_train::eval_options;
use instgs_train::facts::StageTime;

/// Groups of objects that are alike, with the pose of each.
pub struct ObjectGroups {
    /// The groups; empty if no two objects are alike.
    pub groups: Vec<PosedGroup>,
    /// Registration of each object; empty if the groups were given.
    pub registration: Vec<InstanceRegistration>,
    /// Wall time of the registration.
    pub stages: Vec<StageTime>,
}

/// The groups of the configuration, with refined poses unless it forbids that, or the groups that registration finds.
/// Writes `groups.json` to the run folder in both cases, unless its joint phase has begun: that goes on from the one there.
///
/// # Errors
/// A groups.json that is missing or damaged, or a device that fails.
pub fn find_groups(
    gpu: &Arc<Gpu>,
    job: &PipelineJob,
    cloud: &InstancedScene,
    segmented: &CloudLabels,
    observer: &mut dyn Observer,
) -> Result<ObjectGroups, PipelineError> {
    let found = if let Some(path) = &job.config.pipeline.groups {
        let groups = read_groups(path)?;
        if job.config.train.joint.refine_poses {
            refine_given_groups(&job.config, cloud, segmented, &groups, observer)?
        } else {
            ObjectGroups { groups, registration: Vec::new(), stages: Vec::new() }
        }
    } else {
        register_objects(gpu, &job.config, cloud, segmented, observer)?
    };
    if !joint_has_begun(&job.folder()) {
        write_groups(&job.folder().groups(), &found.groups)?;
    }
    Ok(found)
}

/// How the objects of a run were registered; beside `groups.json`.
#[derive(Serialize, Deserialize)]
struct Registered {
    objects: Vec<InstanceRegistration>,
    stages: Vec<StageTime>,
}

/// The groups that a whole run which resumes has found before, as they stand in `groups.json`; `None` if they are to be found.
/// Given groups are read again.
///
/// # Errors
/// A file of the run folder that is damaged.
pub(super) fn kept_groups(job: &PipelineJob) -> Result<Option<ObjectGroups>, IoError> {
    let (folder, is_given) = (job.folder(), job.config.pipeline.groups.is_some());
    let path = folder.registration();
    if !job.resume || is_given || !path.is_file() || !folder.groups().is_file() {
        return Ok(None);
    }
    let Registered { objects: registration, stages } = read_json(&path)?;
    Ok(Some(ObjectGroups { groups: read_groups(&folder.groups())?, registration, stages }))
}

/// Has a run that resumes keep groups that [`find_groups`] has written: with this file they count as found.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn keep_groups(job: &PipelineJob, found: &ObjectGroups) -> Result<(), IoError> {
    let registered = Registered { objects: found.registration.clone(), stages: found.stages.clone() };
    write_json(&job.folder().registration(), &registered)
}

/// Has a run that resumes find its groups again.
///
/// # Errors
/// A file that cannot be removed.
pub(super) fn forget_groups(folder: &RunFolder) -> Result<(), IoError> {
    remove_if_there(&folder.registration())
}

/// Refines the poses of given groups on the cloud's objects; scales are free if the configuration refines them.
fn refine_given_groups(
    config: &RunConfig,
    cloud: &InstancedScene,
    segmented: &CloudLabels,
    groups: &[PosedGroup],
    observer: &mut dyn Observer,
) -> Result<ObjectGroups, PipelineError> {
    let clock = Stage::RefinePoses.begin(observer)?;
    let (labels, cameras, none) = (segmented.labels.as_slice(), &segmented.cameras, BTreeMap::new());
    let input = RegisterInput { cloud: &cloud.background, instance_of_gaussian: labels, categories: &none, cameras };
    let options = RegisterOptions {
        allow_scale: config.train.joint.refine_scales,
        seed: config.train.seed,
        ..RegisterOptions::default()
    };
    let groups = polished(&input, groups, &options)?;
    Ok(ObjectGroups { groups, registration: Vec::new(), stages: vec![clock.end(observer)?] })
}

/// Registers the objects of a labelled cloud; scales are free if the configuration refines them.
///
/// # Errors
/// A device that fails, or a cloud too large for it.
pub fn register_objects(
    gpu: &Arc<Gpu>,
    config: &RunConfig,
    cloud: &InstancedScene,
    segmented: &CloudLabels,
    observer: &mut dyn Observer,
) -> Result<ObjectGroups, PipelineError> {
    let clock = Stage::Register.begin(observer)?;
    let objects = segmented.consensus.objects.iter();
    let categories: BTreeMap<u32, String> = objects.filter_map(|o| Some((o.id, o.category.clone()?))).collect();
    let (gaussians, labels, cameras) = (&cloud.background, segmented.labels.as_slice(), &segmented.cameras);
    let input = RegisterInput { cloud: gaussians, instance_of_gaussian: labels, categories: &categories, cameras };
    // Renders the Gaussians, not photos: mask ids need not be ids of objects.
    let mut check = RenderCheck::new(gpu, gaussians, labels, cameras, eval_options(&config.train), None)?;
    let options = RegisterOptions {
        allow_scale: config.train.joint.refine_scales,
        seed: config.train.seed,
        ..RegisterOptions::default()
    };
    let found = register(&input, Some(&mut check), &options)?;
    Ok(ObjectGroups { groups: found.groups, registration: found.instances, stages: vec![clock.end(observer)?] })
}

/// Warnings about the objects: a line for each that is left out, and one line for all of a group and name whose poses
/// are in more than slight doubt. The joint phase refines poses, so these are only a reason to look.
pub fn warnings(registration: &[InstanceRegistration]) -> impl Iterator<Item = String> + '_ {
    let name = |object: &InstanceRegistration| object.name.clone().unwrap_or_else(|| "object".into());
    let mut doubts: BTreeMap<(Option<u32>, String), Vec<&InstanceRegistration>> = BTreeMap::new();
    let mut left_out = Vec::new();
    for object in registration {
        match object.verdict {
            Verdict::Reference | Verdict::Accepted | Verdict::Symmetric => (),
            Verdict::Ambiguous if object.slight => (),
            Verdict::Ambiguous => doubts.entry((object.group, name(object))).or_default().push(object),
            Verdict::Rejected => {
                left_out.push(format!("{} {} stays in the background: {}", name(object), object.instance, object.note));
            }
        }
    }
    doubts.into_iter().map(|((_, name), objects)| doubt(&name, &objects)).chain(left_out)
}

/// Names the objects of a group whose poses are in doubt.
fn doubt(name: &str, objects: &[&InstanceRegistration]) -> String {
    if let [object] = objects {
        return format!("{name} {}: its pose is in doubt: {}", object.instance, object.note);
    }
    let ids: Vec<String> = objects.iter().map(|object| object.instance.to_string()).collect();
    let ids = ids.join(", ");
    format!(
        "{name} {ids}: their poses are in doubt, or not known well; the joint phase refines them, the report shows them"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubts_of_a_group_are_one_line() {
        let object = |instance: u32, group: Option<u32>, verdict: Verdict| InstanceRegistration {
            instance,
            group,
            name: (instance < 9).then(|| "chair".into()),
            gaussians: 100,
            inliers: 0.9,
            rmse: 0.0,
            relative_rmse: 0.0,
            photometric: None,
            uncertainty: None,
            accepted: verdict.is_accepted(),
            verdict,
            slight: instance == 6,
            note: format!("note {instance}"),
        };
        let all = [
            object(1, Some(0), Verdict::Reference),
            object(2, Some(0), Verdict::Ambiguous),
            object(3, None, Verdict::Rejected),
            object(4, Some(0), Verdict::Ambiguous),
            object(5, Some(1), Verdict::Ambiguous),
            object(6, Some(0), Verdict::Ambiguous),
            object(9, Some(2), Verdict::Symmetric),
            object(10, None, Verdict::Rejected),
        ];
        let want = [
            "chair 2, 4: their poses are in doubt, or not known well; the joint phase refines them, the report shows them",
            "chair 5: its pose is in doubt: note 5",
            "chair 3 stays in the background: note 3",
            "object 10 stays in the background: note 10",
        ];
        assert_eq!(warnings(&all).collect::<Vec<_>>(), want);
    }
}
