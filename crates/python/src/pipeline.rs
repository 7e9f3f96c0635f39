//! `instgs.Pipeline`: the stages from a plain cloud to a trained instanced scene, one call each.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use instgs_io::ply::ply_bytes;
use instgs_io::{IoError, RunLock, read_bytes, read_views, write_groups, write_scene_file};
use instgs_objects::pipeline::{
    self, CloudLabels, Finished, MergedScene, Message, ObjectGroups, Observer, PipelineJob, build_templates,
    check_masks, check_same_method, check_same_stages, find_groups, joint_has_begun, label_gaussians, write_cloud,
};
use instgs_report::{ReportWriter, RunReport, stage_pictures};
use instgs_train::Trained as TrainedScene;
use instgs_train::given::plain_cloud_of;
use instgs_vk::gpu::Gpu;
use instgs_vk::scene::{Gaussians, InstancedScene};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pyo3::{PyTraverseError, PyVisit};

use crate::beside::{Teller, WorkError, beside};
use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, raised, warn};
use crate::json::to_python;
use crate::poses::Poses;
use crate::scene::Scene;
use crate::segments::Segments;
use crate::train::{Trained, check_resume, resolved};

/// The stages from a plain cloud to a trained scene of templates and instances: segment, register, template, joint.
///
/// Pipeline(data, out, *, config=None, set=None, resume=False, accept_changed_data=False, device=None, on_event=None): each stage
/// takes what the one before returned, or what you made of it, and leaves its files in the folder out, as the command line's stages
/// do. config, set and on_event are those of train. resume: the folder's configuration is used, segment reads labels that are
/// there, and joint goes on from its last checkpoint, for which it wants the scene that it began with; where there is no run, a new
/// one begins with a warning. accept_changed_data: joint goes on although the data set has changed since. Ctrl-C and an exception
/// of on_event stop a stage. Raises Error.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Pipeline {
    job: PipelineJob,
    gpu: Arc<Gpu>,
    on_event: Option<Py<PyAny>>,
}

impl Pipeline {
    /// Does a stage in a thread, with the folder's lock.
    fn stage<T: Send>(&self, py: Python<'_>, work: impl FnOnce(Teller) -> Result<T, WorkError> + Send) -> PyResult<T> {
        let out = &self.job.out;
        let locked = |teller| -> Result<T, WorkError> {
            // Before anything of the folder is read that another run may be writing.
            let _lock = RunLock::take(out)?;
            work(teller)
        };
        let result = beside(py, out.clone(), self.on_event.as_ref(), locked)?;
        check_validation(&self.gpu)?;
        Ok(result)
    }

    /// The job of a stage that takes its groups from the user, whose word counts more than how alike the objects are.
    fn with_given_groups(&self) -> PipelineJob {
        let mut job = self.job.clone();
        job.config.pipeline.groups = Some(job.folder().groups());
        job
    }
}

#[pymethods]
impl Pipeline {
    #[new]
    #[pyo3(signature = (
        data, out, *, config = None, set = None, resume = false, accept_changed_data = false, device = None, on_event = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        py: Python<'_>,
        data: PathBuf,
        out: PathBuf,
        config: Option<PathBuf>,
        set: Option<Bound<'_, PyDict>>,
        resume: bool,
        accept_changed_data: bool,
        device: Option<DeviceName>,
        on_event: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let config = resolved(&out, Some("instgs"), config, set.as_ref(), resume)?;
        check_resume(py, &out, resume, accept_changed_data)?;
        let job = PipelineJob { data, out, config, resume, accept_changed_data };
        job.check_folders().or_raise()?;
        if !resume && let Some(found) = job.folder().trace_of_segments() {
            let error = IoError::new(&job.out, format!("holds segments or a run already ({found})"));
            return Err(raised(error.advise("go on with resume=True, or choose another folder")));
        }
        py.detach(|| read_views(&job.data)).or_raise()?;
        Ok(Self { gpu: open_device(py, device)?, job, on_event })
    }

    /// Finds the object of each Gaussian of a trained plain cloud in the masks of its training views; returns Segments.
    ///
    /// Leaves point_cloud.ply, cameras.json, consensus.json, labels.safetensors, config.toml and review.html.
    fn segment(&self, py: Python<'_>, cloud: &Scene) -> PyResult<Segments> {
        let (job, gpu, scene) = (&self.job, &self.gpu, cloud.snapshot(py));
        let read = || -> Result<_, IoError> {
            let mut warnings = check_masks(job)?;
            let (cloud, of_cloud) = plain_cloud_of(&scene, Path::new("the cloud"), &job.config.train)?;
            warnings.extend(of_cloud);
            Ok((cloud, warnings))
        };
        let (cloud, warnings) = py.detach(read).or_raise()?;
        warnings.iter().try_for_each(|text| warn(py, text))?;
        let (cloud, labels) = self.stage(py, |mut teller| -> Result<(InstancedScene, CloudLabels), WorkError> {
            // These compare with files that are written anew after them.
            check_same_method(job)?;
            check_same_stages(job)?;
            check_cloud_of_joint(job, &cloud)?;
            let cloud = write_cloud(job, &cloud)?;
            let labels = label_gaussians(gpu, job, &cloud, &mut teller)?;
            // Labels that are there need no masks any more; the sheet does.
            if let Err(error) = stage_pictures::review_segments(job) {
                teller.warn(format!("the contact sheet of masks is missing: {error}"));
            }
            Ok((cloud, labels))
        })?;
        labels.consensus.warning().map_or(Ok(()), |text| warn(py, text))?;
        Ok(Segments { cloud: Py::new(py, Scene::of(cloud))?, labels: Arc::new(labels) })
    }

    /// Finds which objects are alike and the pose of each; returns Poses. With the configuration's "groups" it takes these, and
    /// refines their poses unless that is off.
    ///
    /// Leaves groups.json, unless the joint phase has begun: that goes on from the one that is there.
    fn register(&self, py: Python<'_>, segments: PyRef<'_, Segments>) -> PyResult<Poses> {
        let (cloud, labels) = segments.parts(py);
        let (job, gpu) = (&self.job, &self.gpu);
        let found = self.stage(py, |mut teller| -> Result<ObjectGroups, WorkError> {
            Ok(find_groups(gpu, job, &cloud, &labels, &mut teller)?)
        })?;
        pipeline::register_objects::warnings(&found.registration).try_for_each(|text| warn(py, text))?;
        let is_given = job.config.pipeline.groups.is_some();
        Ok(Poses { groups: found.groups, objects: found.registration, is_given })
    }

    /// Makes one template for each group, with offsets for its objects; returns Merged. Its scene is not trained yet.
    ///
    /// Leaves groups.json and initial.instgs, unless the joint phase has begun: that goes on from those that are there.
    fn template(&self, py: Python<'_>, segments: PyRef<'_, Segments>, poses: PyRef<'_, Poses>) -> PyResult<Merged> {
        let (cloud, labels) = segments.parts(py);
        let (groups, is_given) = (&poses.groups, poses.is_given);
        let job = if is_given { self.with_given_groups() } else { self.job.clone() };
        let merged = self.stage(py, |_| -> Result<MergedScene, WorkError> {
            // What a joint phase began with may have been edited after this stage: it stays as it is.
            let has_begun = joint_has_begun(&job.folder());
            if !has_begun {
                write_groups(&job.folder().groups(), groups)?;
            }
            let merged = build_templates(&cloud, &labels, groups, &job.config)?;
            if !has_begun {
                write_scene_file(&job.folder().initial_scene(), &merged.scene)?;
            }
            Ok(merged)
        })?;
        pipeline::build_templates::warnings(&merged.groups).into_iter().try_for_each(|text| warn(py, text))?;
        Ok(Merged {
            scene: Py::new(py, Scene::of(merged.scene))?,
            groups: to_python(py, &merged.groups)?.unbind(),
            hardly_seen: merged.hardly_seen,
        })
    }

    /// Trains templates, offsets, background and poses together, from the scene of a Merged or another instanced scene; returns
    /// Trained.
    ///
    /// Leaves what a run leaves: scene.instgs, checkpoints, events.jsonl, report.html. One that was stopped goes on with
    /// Pipeline(..., resume=True).joint of the same scene; instgs.train does not go on from it.
    fn joint(&self, py: Python<'_>, scene: &Scene) -> PyResult<Trained> {
        let (job, gpu, scene) = (&self.job, &self.gpu, scene.snapshot(py));
        if !job.resume && job.folder().events().is_file() {
            let error = IoError::new(&job.out, "holds a joint phase already");
            return Err(raised(error.advise("go on with resume=True, or choose another folder")));
        }
        let report = self.stage(py, |teller| train_jointly(gpu, job, &scene, teller))?;
        Trained::of_run(py, job.out.clone(), &report)
    }

    /// The folder of the results.
    #[getter]
    fn folder(&self) -> PathBuf {
        self.job.out.clone()
    }

    /// For Python's collector of cycles: a callback may hold this pipeline. It needs no `__clear__`: a pipeline never changes, so
    /// something else of the cycle does, and lets go.
    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        visit.call(&self.on_event)
    }

    fn __repr__(&self) -> String {
        format!("<instgs.Pipeline of {} in {}>", self.job.data.display(), self.job.out.display())
    }
}

/// Refuses another cloud than the folder's, once the joint phase has begun with that.
fn check_cloud_of_joint(job: &PipelineJob, cloud: &Gaussians) -> Result<(), IoError> {
    let file = job.folder().point_cloud();
    if !joint_has_begun(&job.folder()) || !file.is_file() {
        return Ok(());
    }
    if read_bytes(&file)? == ply_bytes(cloud, job.config.train.pixel_filter()) {
        return Ok(());
    }
    let error = IoError::new(&job.out, "its joint phase began with another cloud");
    Err(error.advise("give that one (point_cloud.ply), or choose another folder"))
}

/// Runs the joint phase and writes its report.
fn train_jointly(
    gpu: &Arc<Gpu>,
    job: &PipelineJob,
    scene: &InstancedScene,
    mut teller: Teller,
) -> Result<RunReport, WorkError> {
    let (interrupt, mut writer) = (teller.interrupt.clone(), ReportWriter::new());
    let mut observer = |message: Message<'_>| {
        writer.observe(&message)?;
        teller.notify(message)
    };
    let trained = pipeline::Pipeline { gpu, interrupt: &interrupt }.joint(job, scene, &mut observer)?;
    let TrainedScene { scene, facts, .. } = trained;
    Ok(writer.finish(job, Finished { scene, facts, objects: None })?)
}

/// The scene that the joint phase starts from, and how alike its objects were.
#[pyclass(module = "instgs", frozen, get_all)]
pub(crate) struct Merged {
    /// Templates, instances and background; only background if nothing is shared.
    scene: Py<Scene>,
    /// For each group its template, the match distance and what became of its objects.
    groups: Py<PyAny>,
    /// Number of Gaussians of the cloud that were left out because they hardly contribute to any view.
    hardly_seen: u64,
}

#[pymethods]
impl Merged {
    fn __repr__(&self, py: Python<'_>) -> String {
        let scene = self.scene.get().snapshot(py);
        let (templates, instances) = (scene.template_ranges.len(), scene.instances.len());
        format!("<instgs.Merged: {templates} templates, {instances} instances>")
    }
}
