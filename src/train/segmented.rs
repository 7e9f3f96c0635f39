//! Which Gaussian of the plain cloud belongs to which object: consensus of the views' masks, then labels. Both leave a
//! file in the run folder, and are not done again while these are there.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use crate::gpu::Gpu;
use crate::io::checkpoint::Checkpoint;
use crate::io::view_image::camera_at_width;
use crate::io::{IoError, MaskFolder, Split, View, atomic_write, read_bytes, read_views};
use crate::scene::{Camera, InstancedScene};
use crate::segment::{
    Consensus, ConsensusOptions, ConsensusReport, KEPT_BYTES, LabelOptions, LabelProgress, ViewContributions,
    consensus, label_views,
};

use super::error::TrainError;
use super::report::Stage;
use super::trainer::{TrainJob, eval_options};

/// Labels by Gaussian of the cloud, in the run folder.
pub(super) const LABELS: &str = "labels.safetensors";
/// The object of every mask, in the run folder.
pub(super) const CONSENSUS: &str = "consensus.json";
/// The tensor of labels.
pub(super) const LABEL_TENSOR: &str = "instance_of_gaussian";

/// The tensor of what Gaussians add to the pictures.
const WEIGHT_TENSOR: &str = "weight_px";

/// The objects of a cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Segmented {
    /// By Gaussian: object, 0 = none.
    pub(super) labels: Vec<u32>,
    /// By Gaussian: sum of alpha T over all pixels of all training views.
    pub(super) weights_px: Vec<f32>,
    /// How objects were found.
    pub(super) consensus: ConsensusReport,
    /// Wall time of the parts.
    pub(super) stages: Vec<Stage>,
}

impl Segmented {
    /// By Gaussian: true if its weight is at least this part of the mean.
    pub(super) fn well_seen(&self, part_of_mean: f64) -> Vec<bool> {
        let mean = self.weights_px.iter().map(|&w| f64::from(w)).sum::<f64>() / self.weights_px.len().max(1) as f64;
        self.weights_px.iter().map(|&w| f64::from(w) >= part_of_mean * mean).collect()
    }
}

/// Finds the objects of `cloud`, or reads them from the files of an earlier run if they fit. `progress` is told of
/// views done, three sweeps counted.
///
/// # Errors
/// Masks that are missing or damaged, or a cloud beyond the device.
pub(super) fn segmented(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    cloud: &InstancedScene,
    progress: &mut dyn FnMut(LabelProgress),
) -> Result<Segmented, TrainError> {
    let started = Instant::now();
    if let Some(earlier) = of_earlier_run(job, cloud.background.len())? {
        return Ok(Segmented { stages: vec![stage("segment", started)], ..earlier });
    }
    let folder = mask_folder(job)?;
    let masks = MaskFolder::open(&folder)?;
    let (views, cameras) = training_views(job)?;
    let mask_of_view = |i: usize| -> Result<_, TrainError> {
        let camera = &views[i].camera;
        let mask = masks.of_view(&camera.name)?;
        if let Some(mask) = &mask {
            masks.check_size(&camera.name, mask, camera.width, camera.height)?;
        }
        Ok(mask)
    };
    let options = label_options(job);
    let mut views =
        ViewContributions::<TrainError>::new(gpu, cloud, &cameras, mask_of_view, options.render, KEPT_BYTES)?;
    let total = 3 * views.view_count();
    let known = ConsensusOptions { seed: job.config.seed, ..ConsensusOptions::default() };
    let mut found = consensus(&mut views, &cloud.background, &masks.categories, &known, |done| {
        progress(LabelProgress { done, total });
        Ok(())
    })?;
    let consensus_stage = stage("consensus", started);
    let labelling = Instant::now();
    let labels = label_views(&mut views, &cloud.background.means, &found.table, &options, |at| {
        progress(LabelProgress { done: cameras.len() + at.done, total });
        Ok(())
    })?;
    found.report.count_gaussians(&labels.instance_of_gaussian);
    let weights_px: Vec<f32> = labels.weights_px.iter().map(|&weight| weight as f32).collect();
    write(job, &labels.instance_of_gaussian, &weights_px, &found)?;
    let stages = vec![consensus_stage, stage("segment", labelling)];
    Ok(Segmented { labels: labels.instance_of_gaussian, weights_px, consensus: found.report, stages })
}

/// The training views, and their cameras at the width that is trained at.
pub(super) fn training_views(job: &TrainJob) -> Result<(Vec<View>, Vec<Camera>), TrainError> {
    let views: Vec<View> = read_views(&job.data)?.split(Split::Train).cloned().collect();
    let width = (job.config.width > 0).then_some(job.config.width);
    let cameras = views.iter().map(|v| camera_at_width(&v.camera, width)).collect();
    Ok((views, cameras))
}

pub(super) fn stage(name: &str, since: Instant) -> Stage {
    Stage { name: name.into(), seconds: since.elapsed().as_secs_f64() }
}

fn label_options(job: &TrainJob) -> LabelOptions {
    let segment = &job.config.segment;
    let default = LabelOptions::default();
    LabelOptions {
        alpha: segment.alpha,
        unseen_neighbours: if segment.fill_unseen { default.unseen_neighbours } else { 0 },
        drop_strays: segment.drop_strays,
        render: eval_options(&job.config),
    }
}

/// The folder of the masks.
pub(super) fn mask_folder(job: &TrainJob) -> Result<PathBuf, TrainError> {
    if !job.config.masks.is_empty() {
        return Ok(PathBuf::from(&job.config.masks));
    }
    MaskFolder::default_for(&job.data).ok_or_else(|| {
        let error = IoError::new(&job.data, "has no masks");
        error.advise("put one PNG of object ids per image into masks/, or give their folder with --masks").into()
    })
}

/// What an earlier run of the same job wrote for a cloud of so many Gaussians.
fn of_earlier_run(job: &TrainJob, gaussians: usize) -> Result<Option<Segmented>, TrainError> {
    let (labels_path, consensus_path) = (job.out.join(LABELS), job.out.join(CONSENSUS));
    if !(job.resume && labels_path.is_file() && consensus_path.is_file()) {
        return Ok(None);
    }
    let mut file = Checkpoint::read(&labels_path)?;
    let labels: Vec<u32> = file.take(LABEL_TENSOR, &[], &labels_path)?;
    let weights_px: Vec<f32> = file.take(WEIGHT_TENSOR, &[], &labels_path)?;
    let bytes = read_bytes(&consensus_path)?;
    let found: Consensus = serde_json::from_slice(&bytes).map_err(|e| not_json(&consensus_path, &e))?;
    let fits = [labels.len(), weights_px.len()] == [gaussians; 2];
    Ok(fits.then_some(Segmented { labels, weights_px, consensus: found.report, stages: Vec::new() }))
}

fn write(job: &TrainJob, labels: &[u32], weights_px: &[f32], consensus: &Consensus) -> Result<(), TrainError> {
    let path = job.out.join(CONSENSUS);
    let text = serde_json::to_vec_pretty(consensus).map_err(|e| not_json(&path, &e))?;
    atomic_write(&path, |out| out.write_all(&text))?;
    let mut file = Checkpoint::default();
    file.put(LABEL_TENSOR, &[labels.len()], labels.to_vec());
    file.put(WEIGHT_TENSOR, &[weights_px.len()], weights_px.to_vec());
    Ok(file.write(&job.out.join(LABELS))?)
}

fn not_json(path: &Path, error: &serde_json::Error) -> IoError {
    IoError::new(path, error.to_string())
}
