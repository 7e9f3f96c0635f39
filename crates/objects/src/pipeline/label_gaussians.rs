//! Labels the Gaussians of a plain cloud with their objects: consensus of the views' masks, then labels. The results
//! are files in a folder: the cloud with the configuration, `cameras.json`, `consensus.json` and `labels.safetensors`.
//! The later stages need nothing else.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;

use crate::segment::{
    Consensus, ConsensusOptions, ConsensusReport, KEPT_BYTES, LabelOptions, LabelProgress, ViewContributions,
    consensus, label_views,
};
use instgs_io::checkpoint::Checkpoint;
use instgs_io::fingerprint::FilePrint;
use instgs_io::json::{read_json, write_json};
use instgs_io::{
    IoError, MaskFolder, RunFolder, Split, View, atomic_write, load_scene, read_cameras, write_cameras, write_ply,
};
use instgs_train::{cameras_at_training_size, read_dataset};
use instgs_vk::gpu::Gpu;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene, PosedGroup};

use super::error::PipelineError;
use super::job::PipelineJob;
use super::mask_check::views_without_mask;
use super::mask_source::{MaskSource, mask_folder};
use super::observer::{Message, Observer};
use super::register_objects::forget_groups;
use super::stage_kinds::Stage;
use instgs_train::eval_options;
use instgs_train::facts::StageTime;

/// Name of the tensor of labels.
pub const LABEL_TENSOR: &str = "instance_of_gaussian";
/// Name of the tensor of contributions to the training views.
const WEIGHT_TENSOR: &str = "weight_px";
/// Name of the tensor of numbers of views.
const VIEWS_TENSOR: &str = "views_seen";
/// Name of the metadata with the length and the hash of the cloud's file. Versions before it was there wrote none.
const CLOUD_PRINT: &str = "cloud";

/// The labels of a cloud, and what they were computed from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudLabels {
    /// The object of each Gaussian, 0 = none.
    pub labels: Vec<u32>,
    /// For each Gaussian, its contribution: the sum of alpha times transmittance over all pixels of all training views.
    pub weights_px: Vec<f32>,
    /// For each Gaussian, the number of training views with a contribution.
    pub views_seen: Vec<u32>,
    /// Report of the consensus that found the objects.
    pub consensus: ConsensusReport,
    /// The training views' cameras, at the size that is trained at.
    pub cameras: Vec<Camera>,
    /// Wall time of each stage.
    pub stages: Vec<StageTime>,
}

impl CloudLabels {
    /// For each Gaussian, at `means`: true if its contribution per view that shows it is at least this fraction of the
    /// mean of its kind, or if its centre is in the frame of no view. Contributions are taken per view, because a
    /// Gaussian that only a few pictures show, at their borders, may be essential in other pictures. Gaussians outside
    /// of all frames are kept, as a camera between the others may see them. A kind is an object's group, or the
    /// background: compared with walls and a floor, thin chairs would lose their Gaussians.
    pub fn well_seen(&self, means: &[[f32; 3]], groups: &[PosedGroup], part_of_mean: f64) -> Vec<bool> {
        let per_view = |(&weight, &views): (&f32, &u32)| f64::from(weight) / f64::from(views.max(1));
        let weights: Vec<f64> = self.weights_px.iter().zip(&self.views_seen).map(per_view).collect();
        let kinds = self.kinds(groups);
        let mut sums = vec![(0.0, 0usize); 1 + groups.len()];
        for (&kind, &weight) in kinds.iter().zip(&weights) {
            sums[kind].0 += weight;
            sums[kind].1 += 1;
        }
        let least: Vec<f64> = sums.iter().map(|&(sum, count)| part_of_mean * sum / count.max(1) as f64).collect();
        let is_kept =
            |((&weight, &mean), &kind): ((&f64, &[f32; 3]), &usize)| weight >= least[kind] || !self.is_framed(mean);
        weights.iter().zip(means).zip(&kinds).map(is_kept).collect()
    }

    /// The kind of each Gaussian: 0 for the background, 1 + g for objects of group g.
    fn kinds(&self, groups: &[PosedGroup]) -> Vec<usize> {
        let ids = groups.iter().enumerate().flat_map(|(g, group)| group.instances.iter().map(move |i| (i.id, 1 + g)));
        let kind_of_id: BTreeMap<u32, usize> = ids.collect();
        self.labels.iter().map(|id| kind_of_id.get(id).copied().unwrap_or_default()).collect()
    }

    /// True if a point of the world is in the frame of a view, whether hidden or not.
    fn is_framed(&self, point_world: [f32; 3]) -> bool {
        let point = Vec3::from(point_world).as_dvec3();
        self.cameras.iter().any(|camera| camera.pixel_of(point).is_some_and(|at| camera.has_pixel(at)))
    }

    /// Reads the files of [`label_gaussians`] in a folder, for the folder's cloud, which has `gaussians` Gaussians.
    ///
    /// # Errors
    /// A file that is missing, damaged, or of another cloud.
    pub fn read(folder: &RunFolder, gaussians: usize) -> Result<Self, IoError> {
        require_segments(folder)?;
        let path = folder.labels();
        let mut file = Checkpoint::read(&path)?;
        if file.metadata.get(CLOUD_PRINT).is_some_and(|text| print_of(&folder.point_cloud()).as_ref() != Ok(text)) {
            let error = IoError::new(&path, "has the labels of another point_cloud.ply than the one beside it");
            return Err(error.advise("segment the scene again, into another folder"));
        }
        let labels: Vec<u32> = file.take(LABEL_TENSOR, &[], &path)?;
        let weights_px: Vec<f32> = file.take(WEIGHT_TENSOR, &[], &path)?;
        let views_seen: Vec<u32> = file.take(VIEWS_TENSOR, &[], &path)?;
        if [labels.len(), weights_px.len(), views_seen.len()] != [gaussians; 3] {
            let what = format!("has {} labels, and the cloud {gaussians} Gaussians", labels.len());
            return Err(IoError::new(&path, what).advise("segment the scene again, into another folder"));
        }
        let found: Consensus = read_json(&folder.consensus())?;
        let cameras = read_cameras(&folder.cameras())?;
        Ok(Self { labels, weights_px, views_seen, consensus: found.report, cameras, stages: Vec::new() })
    }

    fn write(&self, found: &Consensus, folder: &RunFolder) -> Result<(), IoError> {
        write_cameras(&folder.cameras(), &self.cameras)?;
        write_json(&folder.consensus(), found)?;
        let mut file = Checkpoint::default();
        file.put(LABEL_TENSOR, &[self.labels.len()], self.labels.clone());
        file.put(WEIGHT_TENSOR, &[self.weights_px.len()], self.weights_px.clone());
        file.put(VIEWS_TENSOR, &[self.views_seen.len()], self.views_seen.clone());
        file.metadata.insert(CLOUD_PRINT.into(), print_of(&folder.point_cloud())?);
        file.write(&folder.labels())
    }
}

/// True if the labels in a folder are of another cloud than the one beside them; false if nothing says so.
pub(super) fn are_of_another_cloud(folder: &RunFolder) -> bool {
    let labels = Checkpoint::read(&folder.labels()).ok();
    let print = labels.and_then(|mut file| file.metadata.remove(CLOUD_PRINT));
    print.is_some_and(|print| print_of(&folder.point_cloud()).is_ok_and(|now| now != print))
}

/// Length and hash of a file, as text: a change of it is noticed by them.
pub(super) fn print_of(file: &Path) -> Result<String, IoError> {
    let FilePrint { bytes, hash, .. } = FilePrint::of(file)?;
    Ok(format!("{bytes} {hash}"))
}

/// Makes the job's folder with its configuration and a plain cloud, as the stages read them; returns the scene of the cloud.
///
/// # Errors
/// A configuration that cannot be written down, or a file that cannot be written.
pub fn write_cloud(job: &PipelineJob, cloud: &Gaussians) -> Result<InstancedScene, PipelineError> {
    job.check_folders()?;
    let folder = job.folder();
    folder.create()?;
    let text = job.config.to_toml()?;
    atomic_write(&folder.config(), |out| out.write_all(text.as_bytes()))?;
    write_ply(&folder.point_cloud(), cloud, job.config.train.pixel_filter())?;
    Ok(read_cloud(&folder)?)
}

/// Reads the cloud that a folder's labels belong to.
///
/// # Errors
/// A file that is missing or damaged.
pub fn read_cloud(folder: &RunFolder) -> Result<InstancedScene, IoError> {
    Ok(load_scene(&folder.point_cloud())?.scene)
}

/// Checks that a folder has the files of [`label_gaussians`].
///
/// # Errors
/// One of these files is missing.
pub fn require_segments(folder: &RunFolder) -> Result<(), IoError> {
    if is_segmented(folder) {
        return Ok(());
    }
    let error = IoError::new(folder.path(), "holds no segmented scene");
    Err(error.advise("make one with instgs-vk segment --out, or name a run of --method instgs"))
}

/// True if a folder has all files that [`CloudLabels::read`] reads.
pub(super) fn is_segmented(folder: &RunFolder) -> bool {
    [folder.cameras(), folder.consensus(), folder.labels()].iter().all(|path| path.is_file())
}

/// Finds the objects of `cloud`, or, if the job resumes, reads them from the files of an earlier run if they fit.
/// `observer` receives the stages and the number of views done, counted over three sweeps.
///
/// # Errors
/// Masks that are missing or damaged, or a cloud too large for the device.
pub fn label_gaussians(
    gpu: &Arc<Gpu>,
    job: &PipelineJob,
    cloud: &InstancedScene,
    observer: &mut dyn Observer,
) -> Result<CloudLabels, PipelineError> {
    let started = Instant::now();
    if job.resume
        && is_segmented(&job.folder())
        && let Ok(earlier) = CloudLabels::read(&job.folder(), cloud.background.len())
    {
        return Ok(CloudLabels { stages: vec![StageTime::since(Stage::Segment.name(), started)], ..earlier });
    }
    // Groups of before are not those of the labels to come.
    forget_groups(&job.folder())?;
    let clock = Stage::Consensus.begin(observer)?;
    let (views, cameras) = training_views(job)?;
    let folder = mask_folder(job)?;
    if !matches!(MaskSource::of(job)?, MaskSource::Folder(_)) && !folder.is_dir() {
        let error = IoError::new(&job.out, "has no masks yet, which are to be made from boxes or words");
        let advice = "make them with instgs-vk masks --boxes or --prompt, and give their folder with --masks";
        return Err(error.advise(advice).into());
    }
    let masks = MaskFolder::open(&folder, &views)?;
    let options = label_options(job);
    let mask_of_view = |i: usize| Ok(masks.of_view(&views[i])?);
    let mut sweeps =
        ViewContributions::<PipelineError>::new(gpu, cloud, &cameras, mask_of_view, options.render, KEPT_BYTES)?;
    let total = 3 * sweeps.view_count();
    let known = ConsensusOptions { seed: job.config.train.seed, ..ConsensusOptions::default() };
    let mut found = consensus(&mut sweeps, &cloud.background, &masks.categories, &known, |done| {
        Ok(observer.notify(Message::Labelling(LabelProgress { done, total }))?)
    })?;
    let consensus_stage = clock.end(observer)?;
    let clock = Stage::Segment.begin(observer)?;
    let labels = label_views(&mut sweeps, &cloud.background.means, &found.table, &options, |at| {
        let done = cameras.len() + at.done;
        Ok(observer.notify(Message::Labelling(LabelProgress { done, total }))?)
    })?;
    drop(sweeps);
    found.report.count_gaussians(&labels.instance_of_gaussian);
    found.report.without_mask = views_without_mask(&masks, &views)?;
    let out = CloudLabels {
        labels: labels.instance_of_gaussian,
        weights_px: labels.weights_px.iter().map(|&weight| weight as f32).collect(),
        views_seen: labels.views_seen,
        consensus: found.report.clone(),
        cameras,
        stages: vec![consensus_stage, clock.end(observer)?],
    };
    out.write(&found, &job.folder())?;
    Ok(out)
}

/// Reads the training views, and their cameras at the size that is trained at.
///
/// # Errors
/// A data set that is missing or damaged.
pub fn training_views(job: &PipelineJob) -> Result<(Vec<View>, Vec<Camera>), IoError> {
    let views: Vec<View> = read_dataset(&job.data, &job.config.train)?.split(Split::Train).cloned().collect();
    let cameras = cameras_at_training_size(&views, &job.config.train);
    Ok((views, cameras))
}

fn label_options(job: &PipelineJob) -> LabelOptions {
    let segment = &job.config.pipeline.segment;
    let default = LabelOptions::default();
    LabelOptions {
        alpha: segment.alpha,
        unseen_neighbours: if segment.fill_unseen { default.unseen_neighbours } else { 0 },
        drop_strays: segment.drop_strays,
        render: eval_options(&job.config.train),
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use instgs_samples::ring;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::PosedInstance;

    /// The first two Gaussians contribute equally to all pictures together, the first in one of them, the second in 40
    /// and hardly in any. By sums over pictures the two could not be distinguished.
    #[test]
    fn what_one_picture_shows_well_stays_and_what_many_hardly_show_goes() {
        let segmented = CloudLabels {
            labels: vec![0; 4],
            weights_px: vec![3.0, 3.0, 100.0, 0.0],
            views_seen: vec![1, 40, 20, 0],
            cameras: ring(DVec3::Z),
            ..CloudLabels::default()
        };
        let well_seen = |part| segmented.well_seen(&[[0.0; 3]; 4], &[], part);
        // Contributions per view 3, 0.075, 5, 0: the mean is 2.02.
        assert_eq!(well_seen(0.1), [true, false, true, false]);
        assert_eq!(well_seen(0.03), [true, true, true, false]);
        assert_eq!(well_seen(0.0), [true; 4]);
        assert!(CloudLabels::default().well_seen(&[], &[], 0.1).is_empty());
    }

    /// The cameras look at the origin from 9 units aside and 4 above: a point far above them is in no frame.
    #[test]
    fn what_no_picture_has_in_its_frame_stays() {
        let segmented = CloudLabels {
            labels: vec![0; 3],
            weights_px: vec![9.0, 0.0, 0.0],
            views_seen: vec![1, 0, 0],
            cameras: ring(DVec3::Z),
            ..CloudLabels::default()
        };
        let means = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.0, 50.0]];
        assert_eq!(segmented.well_seen(&means, &[], 0.1), [true, false, true]);
    }

    /// Two of three Gaussians of objects contribute as much as any of their objects', and far less than the background.
    #[test]
    fn objects_are_judged_among_themselves() {
        let segmented = CloudLabels {
            labels: vec![0, 0, 7, 8, 8],
            weights_px: vec![100.0, 9.0, 2.0, 2.0, 0.1],
            views_seen: vec![1; 5],
            cameras: ring(DVec3::Z),
            ..CloudLabels::default()
        };
        let group = PosedGroup {
            template_id: 3,
            name: None,
            score: None,
            instances: [7, 8].map(|id| PosedInstance { id, world_from_template: Similarity::IDENTITY }).into(),
        };
        let means = [[0.0; 3]; 5];
        // The mean of all is 22.6, of the background alone 54.5, of the objects 1.37.
        assert_eq!(segmented.well_seen(&means, &[], 0.2), [true, true, false, false, false]);
        assert_eq!(segmented.well_seen(&means, std::slice::from_ref(&group), 0.2), [true, false, true, true, false]);
    }
}
