//! Between the two phases: from a plain cloud, masks and posed groups to the instanced scene that the joint phase
//! starts from. Each stage leaves a file in the run folder, and is not done again while that file is there.

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::gpu::Gpu;
use crate::io::{IoError, atomic_write, load_scene, read_bytes, write_scene_file};
use crate::register::InstanceRegistration;
use crate::segment::{ConsensusReport, LabelProgress};
use crate::template::{GroupReport, build};

use super::error::TrainError;
use super::grouped::{self, Grouped, grouped};
use super::report::Stage;
use super::segmented::segmented;
use super::start::INITIAL_SCENE;
use super::trainer::TrainJob;

/// The plain cloud, in the run folder.
pub const CLOUD: &str = "point_cloud.ply";
/// What this stage found, in the run folder.
const REPORT: &str = "prepared.json";

/// What became of the groups.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// One entry per group.
    pub groups: Vec<GroupReport>,
    /// What became of every object; empty if the groups were given.
    #[serde(default)]
    pub registration: Vec<InstanceRegistration>,
    /// Wall time of the parts.
    pub stages: Vec<Stage>,
    /// Gaussians of the cloud that belong to no object.
    pub background: u64,
    /// Gaussians of the cloud that were left out because the pictures hardly show them.
    #[serde(default)]
    pub hardly_seen: u64,
    /// How the objects were found in the masks.
    #[serde(default)]
    pub consensus: ConsensusReport,
}

impl Prepared {
    /// What the user should know, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut out: Vec<String> = self.consensus.warning().into_iter().collect();
        out.extend(grouped::warnings(&self.registration));
        for group in &self.groups {
            let name = group.name.clone().unwrap_or_else(|| format!("group {}", group.template_id));
            if group.template.is_none() {
                out.push(format!("{name}: no instance has enough Gaussians; it stays in the background"));
                continue;
            }
            if group.is_poor_match() {
                let distance = group.match_distance;
                out.push(format!(
                    "{name}: its objects are not alike, or posed wrongly (match distance {distance:.3}, good below \
                     {:.2}): expect ghosts",
                    crate::template::POOR_MATCH
                ));
            }
            if group.is_single() {
                out.push(format!("{name}: only one of its objects has Gaussians; sharing gains nothing"));
            }
            for instance in group.instances.iter().filter(|i| !i.is_usable) {
                let (id, own) = (instance.id, instance.gaussians);
                out.push(format!("{name}: object {id} has only {own} Gaussians; it is shown as the template"));
            }
        }
        out
    }
}

/// Makes `initial.instgs` in the run folder from `point_cloud.ply` there and the masks of the configuration, and its groups
/// if it has any. `progress` is told of views done and in all.
///
/// # Errors
/// Groups or masks that are missing or damaged, or a cloud beyond the device.
pub fn prepare(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    progress: &mut dyn FnMut(LabelProgress),
) -> Result<Prepared, TrainError> {
    let report_path = job.out.join(REPORT);
    let initial = job.out.join(INITIAL_SCENE);
    if job.resume && initial.is_file() && report_path.is_file() {
        let bytes = read_bytes(&report_path)?;
        return serde_json::from_slice(&bytes).map_err(|e| IoError::new(&report_path, e.to_string()).into());
    }
    let cloud = load_scene(&job.out.join(CLOUD))?.scene;
    let segmented = segmented(gpu, job, &cloud, progress)?;
    let Grouped { groups, registration, stages: registering } = grouped(gpu, job, &cloud, &segmented)?;
    let merging = Instant::now();
    let is_kept = segmented.well_seen(job.config.joint.prune_weight);
    let kept = cloud.background.filtered(|i| is_kept[i]);
    let labels: Vec<u32> =
        segmented.labels.iter().zip(&is_kept).filter(|(_, kept)| **kept).map(|(&id, _)| id).collect();
    let mut built = build(&kept, &labels, &groups, &job.config.template_options())?;
    if built.scene.instances.is_empty() {
        let what = "none of the groups has an object with Gaussians; check that masks and groups have the same ids";
        return Err(TrainError::Other(what.into()));
    }
    built.scene.antialias = job.config.antialias;
    built.scene.source = "instgs-vk: merged, not yet trained".into();
    write_scene_file(&initial, &built.scene)?;
    let mut stages = segmented.stages;
    stages.extend(registering);
    stages.push(Stage { name: "merge".into(), seconds: merging.elapsed().as_secs_f64() });
    let background = built.scene.background.len() as u64;
    let hardly_seen = (cloud.background.len() - kept.len()) as u64;
    let consensus = segmented.consensus;
    let prepared = Prepared { groups: built.report, registration, stages, background, hardly_seen, consensus };
    let text = serde_json::to_vec_pretty(&prepared).map_err(|e| IoError::new(&report_path, e.to_string()))?;
    atomic_write(&report_path, |out| out.write_all(&text))?;
    Ok(prepared)
}
