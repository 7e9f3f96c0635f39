//! The stages between the two phases: from a plain cloud, masks and posed groups to the instanced scene that the joint
//! phase starts from. Each stage leaves a file in the run folder, and is skipped while that file exists. The stages are
//! also commands of their own (`segment`, `register`, `merge`), which call the same functions.

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::register::InstanceRegistration;
use crate::segment::ConsensusReport;
use crate::template::GroupReport;
use instgs_io::json::{read_json, write_json};
use instgs_io::{IoError, remove_if_there, write_scene_file};
use instgs_vk::gpu::Gpu;

use super::build_templates::{self, build_templates};
use super::error::PipelineError;
use super::job::PipelineJob;
use super::label_gaussians::{are_of_another_cloud, label_gaussians, print_of, read_cloud};
use super::make_masks::masks_from_boxes;
use super::mask_check::without_mask_line;
use super::observer::Observer;
use super::register_objects::{self, ObjectGroups, find_groups, forget_groups, keep_groups, kept_groups};
use super::run::joint_has_begun;
use super::stage_kinds::Stage;
use instgs_train::facts::StageTime;

/// Results of the stages between the two phases.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// Report of each group.
    pub groups: Vec<GroupReport>,
    /// Registration of each object; empty if the groups were given.
    #[serde(default)]
    pub registration: Vec<InstanceRegistration>,
    /// Wall time of each stage.
    pub stages: Vec<StageTime>,
    /// Number of Gaussians of the scene's background: those of no object, and those of objects that no template shows.
    pub background: u64,
    /// Number of Gaussians of the cloud that were left out because they hardly contribute to any view.
    #[serde(default)]
    pub hardly_seen: u64,
    /// Number of views in which masks were looked up.
    #[serde(default)]
    pub views: usize,
    /// Report of the consensus that found the objects in the masks.
    #[serde(default)]
    pub consensus: ConsensusReport,
    /// Remarks on the boxes that masks were made from, one line each.
    #[serde(default)]
    pub boxes: Vec<String>,
    /// Print of the file that the groups were given by, if they were: a change is noticed by it.
    #[serde(default)]
    pub groups_print: Option<String>,
}

/// Print of the file of groups that the job names.
fn groups_print(job: &PipelineJob) -> Result<Option<String>, IoError> {
    job.config.pipeline.groups.as_deref().map(print_of).transpose()
}

/// True if the job's file of groups is the one in its own run folder.
fn are_groups_of_run(job: &PipelineJob) -> bool {
    let own = job.folder().groups().canonicalize().ok();
    job.config.pipeline.groups.as_ref().is_some_and(|given| own.is_some() && given.canonicalize().ok() == own)
}

/// Refuses given groups that are no longer those that the templates of a run were made from.
///
/// # Errors
/// The file has changed; a damaged report in the run folder.
pub(super) fn check_same_groups(job: &PipelineJob) -> Result<(), IoError> {
    let (report, groups) = (job.folder().prepared(), &job.config.pipeline.groups);
    // A file that is not there any more is not needed any more.
    let Some(path) = groups.as_ref().filter(|path| path.is_file() && report.is_file()) else { return Ok(()) };
    let Prepared { groups_print: noted, .. } = read_json(&report)?;
    // Older versions did not note it.
    if noted.is_none() || noted == groups_print(job)? {
        return Ok(());
    }
    let what = format!("has changed since the templates of {} were made from it", job.out.display());
    Err(IoError::new(path, what).advise("put the old file back, or train into another folder"))
}

impl Prepared {
    /// Warnings for the user, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut out = self.boxes.clone();
        out.extend(without_mask_line(&self.consensus.without_mask, self.views));
        out.extend(self.consensus.warning());
        out.extend(register_objects::warnings(&self.registration));
        out.extend(build_templates::warnings(&self.groups));
        out
    }
}

/// The error of a run whose joint phase is to go on with another cloud than it began with.
pub(super) fn began_with_another_cloud(run: &Path) -> IoError {
    let error = IoError::new(run, "its joint phase began with another plain cloud");
    error.advise("put that one back (--init), or train into another folder")
}

/// Makes `initial.instgs` in the run folder from `point_cloud.ply` there, the masks of the configuration, and its
/// groups if it names any. If no objects are alike, the whole scene is background. `observer` receives the stages and
/// the number of views done.
///
/// # Errors
/// Groups or masks that are missing or damaged, or a cloud too large for the device.
pub fn prepare(gpu: &Arc<Gpu>, job: &PipelineJob, observer: &mut dyn Observer) -> Result<Prepared, PipelineError> {
    let report_path = job.folder().prepared();
    let initial = job.folder().initial_scene();
    let cloud = read_cloud(&job.folder())?;
    if job.resume && initial.is_file() && report_path.is_file() {
        if !are_of_another_cloud(&job.folder()) {
            return Ok(read_json(&report_path)?);
        }
        if joint_has_begun(&job.folder()) {
            return Err(began_with_another_cloud(&job.out).into());
        }
    }
    // Templates without their report are not taken for those of the labels to come.
    remove_if_there(&report_path)?;
    // Taken before they are read; the run's own file is written anew when they are.
    let mut of_groups = groups_print(job)?;
    let boxes = masks_from_boxes(gpu, job, &cloud, observer)?;
    let labels = label_gaussians(gpu, job, &cloud, observer)?;
    let found = match kept_groups(job)? {
        Some(kept) => kept,
        None => {
            forget_groups(&job.folder())?;
            let found = find_groups(gpu, job, &cloud, &labels, observer)?;
            keep_groups(job, &found)?;
            found
        }
    };
    if are_groups_of_run(job) {
        of_groups = groups_print(job)?;
    }
    let ObjectGroups { groups, registration, stages: registering } = found;
    let clock = Stage::Merge.begin(observer)?;
    let merged = build_templates(&cloud, &labels, &groups, &job.config)?;
    write_scene_file(&initial, &merged.scene)?;
    let stages = [labels.stages, registering, vec![clock.end(observer)?]].concat();
    let prepared = Prepared {
        groups: merged.groups,
        registration,
        stages: boxes.iter().map(|made| made.stage.clone()).chain(stages).collect(),
        background: merged.scene.background.len() as u64,
        hardly_seen: merged.hardly_seen,
        views: labels.cameras.len(),
        consensus: labels.consensus,
        boxes: boxes.map(|made| made.notes).unwrap_or_default(),
        groups_print: of_groups,
    };
    write_json(&report_path, &prepared)?;
    Ok(prepared)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::config::ConfigBuilder;

    #[test]
    fn groups_that_changed_are_other_groups() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let (file, out) = (folder.path().join("given.json"), folder.path().join("run"));
        std::fs::create_dir(&out)?;
        let mut config = ConfigBuilder::new().file("instgs")?.finish()?;
        config.pipeline.groups = Some(file.clone());
        let job = PipelineJob { data: folder.path().into(), out, config, resume: true, accept_changed_data: false };
        std::fs::write(&file, "[]")?;
        check_same_groups(&job)?;
        let noted = Prepared { groups_print: groups_print(&job)?, ..Prepared::default() };
        write_json(&job.folder().prepared(), &noted)?;
        check_same_groups(&job)?;
        std::fs::write(&file, "[ ]")?;
        let error = check_same_groups(&job).err().ok_or("taken")?.to_string();
        assert!(error.contains("given.json") && error.contains("has changed"), "{error}");
        // Versions that did not note it, and files that are gone, go on.
        std::fs::remove_file(&file)?;
        check_same_groups(&job)?;
        std::fs::write(&file, "[ ]")?;
        write_json(&job.folder().prepared(), &Prepared::default())?;
        Ok(check_same_groups(&job)?)
    }
}
