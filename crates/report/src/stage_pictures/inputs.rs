//! The files of the stages in the run folder, and the training views.

use glam::DVec3;

use super::colors::Colors;
use super::framing::{choose_views, means, middle};
use super::overlay::Objects;
use instgs_io::checkpoint::Checkpoint;
use instgs_io::json::read_json;
use instgs_io::view_image::camera_at_width;
use instgs_io::{IoError, Mask, MaskFolder, View, load_scene, read_groups};
use instgs_objects::pipeline::label_gaussians::LABEL_TENSOR;
use instgs_objects::pipeline::{PipelineJob, Prepared, mask_folder, training_views};
use instgs_objects::segment::{Consensus, ConsensusReport, IdTable};
use instgs_vk::scene::{Camera, Gaussians, PosedGroup};

/// All inputs of the pictures.
pub(super) struct Inputs {
    /// The training views of the data set.
    pub(super) views: Vec<View>,
    /// Their cameras, at the size that is trained at.
    pub(super) cameras: Vec<Camera>,
    /// The plain cloud that was labelled.
    pub(super) cloud: Gaussians,
    /// The object of each Gaussian, 0 = none.
    pub(super) labels: Vec<u32>,
    /// The object of every mask.
    pub(super) table: IdTable,
    /// The masks; `None` if they do not exist any more.
    masks: Option<MaskFolder>,
    /// The groups with poses; empty if there are none.
    pub(super) groups: Vec<PosedGroup>,
}

/// The cameras of the training views at the size that is trained at.
pub(super) fn cameras(job: &PipelineJob) -> Result<Vec<Camera>, IoError> {
    Ok(training_views(job)?.1)
}

impl Inputs {
    pub(super) fn read(job: &PipelineJob) -> Result<Self, IoError> {
        let (views, cameras) = training_views(job)?;
        let folder = job.folder();
        let labels = folder.labels();
        let consensus: Consensus = read_json(&folder.consensus())?;
        let groups = folder.groups();
        // A resumed run needs no masks once it has labels.
        let masks = mask_folder(job).ok().and_then(|folder| MaskFolder::open(&folder, &views).ok());
        Ok(Self {
            views,
            cameras,
            cloud: load_scene(&folder.point_cloud())?.scene.background,
            labels: Checkpoint::read(&labels)?.take(LABEL_TENSOR, &[], &labels)?,
            table: consensus.table,
            masks,
            groups: if groups.is_file() { read_groups(&groups)? } else { Vec::new() },
        })
    }

    /// The training views to show, in order: only views with a mask, if there are any.
    pub(super) fn choose_views(&self, objects: &Objects<'_>, most: usize) -> Vec<usize> {
        let all: Vec<usize> = (0..self.views.len()).collect();
        let has_mask =
            |view: &usize| self.masks.as_ref().is_some_and(|m| m.has_view(&self.views[*view]).is_ok_and(|has| has));
        let masked: Vec<usize> = all.iter().copied().filter(has_mask).collect();
        let middles: Vec<DVec3> = objects.ids().map(|id| middle(&means(&objects.gaussians(id)))).collect();
        choose_views(&self.cameras, if masked.is_empty() { &all } else { &masked }, &middles, most)
    }

    /// The mask of a training view, if it has one.
    pub(super) fn mask_of(&self, view: usize) -> Result<Option<Mask>, IoError> {
        self.masks.as_ref().map_or(Ok(None), |masks| masks.of_view(&self.views[view]))
    }

    /// The camera of a training view for a picture of this width, larger or smaller than the photo.
    pub(super) fn camera_at_width(&self, view: usize, width: u32) -> Camera {
        picture_camera(&self.views[view].camera, width)
    }

    /// Remarks for the reader, one sentence each.
    pub(super) fn notes(&self, prepared: &Prepared, colors: &Colors) -> Vec<String> {
        let found = &prepared.consensus;
        let mut out = Vec::new();
        if self.masks.is_none() {
            out.push("The folder of the masks is not there any more, so they are not shown.".into());
        }
        out.extend(consensus_notes(found));
        if colors.ids().count() > Colors::DISTINCT {
            out.push(format!("There are more than {} objects: colours repeat.", Colors::DISTINCT));
        }
        out
    }
}

/// A camera for a picture of this width, larger or smaller than the photo.
fn picture_camera(camera: &Camera, width: u32) -> Camera {
    if camera.width >= width {
        return camera_at_width(camera, Some(width));
    }
    let height = f64::from(camera.height) * f64::from(width) / f64::from(camera.width);
    camera.resized(width, height.round().max(1.0) as u32)
}

/// The ids of masks before and after consensus, one sentence.
pub(super) fn consensus_notes(found: &ConsensusReport) -> Option<String> {
    if found.ids_agree {
        return Some("Ids are the same object in every view, and were kept.".into());
    }
    let (agreement, masks, objects) = (100.0 * found.agreement, found.masks, found.objects.len());
    let (merged, alone) = (found.undersegmented, found.unassigned);
    (masks > 0).then(|| {
        format!(
            "Ids are the same from view to view in {agreement:.0} % of the cases only: {masks} masks were joined to \
             {objects} objects. Striped masks were not used: in all views, {merged} of several objects, {alone} of none."
        )
    })
}
