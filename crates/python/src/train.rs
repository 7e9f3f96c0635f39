//! `instgs.train`: a run of the pipeline with its reports.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use instgs_io::{IoError, RunFolder, RunLock, load_scene, read_views};
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_objects::pipeline::{Message, Observer, Pipeline, PipelineJob, Prepared};
use instgs_report::{ReportWriter, RunReport};
use instgs_train::unused_masks;
use instgs_vk::gpu::Gpu;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use toml::Value;

use crate::beside::{Teller, WorkError, beside};
use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, raised, warn};
use crate::json::to_python;
use crate::scene::Scene;

/// What a finished run made.
#[pyclass(module = "instgs", frozen, get_all)]
pub(crate) struct Trained {
    /// The trained scene, as in RUN/scene.instgs.
    scene: Py<Scene>,
    /// The contents of RUN/report.json: steps, seconds, figures of the test views, counts, sizes, device.
    report: Py<PyAny>,
    /// The run folder, with report.html and all else.
    folder: PathBuf,
}

impl Trained {
    /// What a finished run left in its folder.
    pub(crate) fn of_run(py: Python<'_>, folder: PathBuf, report: &RunReport) -> PyResult<Self> {
        let scene = py.detach(|| load_scene(&RunFolder::new(&folder).scene())).or_raise()?.scene;
        Ok(Self { scene: Py::new(py, Scene::of(scene))?, report: to_python(py, report)?.unbind(), folder })
    }
}

#[pymethods]
impl Trained {
    fn __repr__(&self) -> String {
        format!("<instgs.Trained in {}>", self.folder.display())
    }
}

/// Trains a scene from a data set's photos into the run folder out, as the command line's `train`; returns a Trained.
///
/// method: "3dgs", a plain cloud, or "instgs", templates with instances; by default the configuration's. config: a preset
/// ("quick", "instgs_quick", ...) or a TOML file. set: {"steps": 500, "joint.steps": 300, ...}, values above the configuration's;
/// a path object becomes absolute; numpy's numbers are taken too. resume: continue the run of train in out with its configuration
/// (one of a Pipeline goes on with Pipeline(..., resume=True).joint); where there is none, a new one begins with a warning.
/// accept_changed_data: continue although the data set has changed since. on_event: called with a dict for every event,
/// {"event": "step", "step": 100, "loss": ...} as in events.jsonl, with the "phase".
///
/// Ctrl-C, and an exception of on_event, stop the run after the step, with a checkpoint, or after the photo that is being read;
/// then that exception is raised. Raises Error. The interpreter is free meanwhile.
#[pyfunction]
#[pyo3(signature = (
    data, out, method = None, *,
    config = None, set = None, resume = false, accept_changed_data = false, device = None, on_event = None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub(crate) fn train(
    py: Python<'_>,
    data: PathBuf,
    out: PathBuf,
    method: Option<&str>,
    config: Option<PathBuf>,
    set: Option<Bound<'_, PyDict>>,
    resume: bool,
    accept_changed_data: bool,
    device: Option<DeviceName>,
    on_event: Option<Py<PyAny>>,
) -> PyResult<Trained> {
    let config = resolved(&out, method, config, set.as_ref(), resume)?;
    check_resume(py, &out, resume, accept_changed_data)?;
    if !resume {
        RunFolder::new(&out).expect_no_run().or_raise()?;
    }
    // Before anything is written: a folder without cameras should not leave an empty run.
    let dataset = py.detach(|| read_views(&data)).or_raise()?;
    unused_masks(&data, &config.train, &dataset.views).iter().try_for_each(|note| warn(py, note))?;
    let job = PipelineJob { data, out, config, resume, accept_changed_data };
    job.check_folders().or_raise()?;
    let gpu = open_device(py, device)?;
    let report = beside(py, job.out.clone(), on_event.as_ref(), |teller| run(&gpu, &job, teller))?;
    check_validation(&gpu)?;
    Trained::of_run(py, job.out, &report)
}

/// Refuses `accept_changed_data` without `resume`, and warns of `resume` where nothing is.
pub(crate) fn check_resume(py: Python<'_>, out: &Path, resume: bool, accept_changed_data: bool) -> PyResult<()> {
    if accept_changed_data && !resume {
        return Err(raised("accept_changed_data is for a run that goes on: give resume=True, or leave it out"));
    }
    if resume && RunFolder::new(out).trace_of_run().is_none() {
        warn(py, format_args!("{} holds no run to resume: a new one begins", out.display()))?;
    }
    Ok(())
}

/// The configuration: the run's own when it goes on, the preset or file, then the values set.
pub(crate) fn resolved(
    out: &Path,
    method: Option<&str>,
    config: Option<PathBuf>,
    set: Option<&Bound<'_, PyDict>>,
    resume: bool,
) -> PyResult<RunConfig> {
    let own = RunFolder::new(out).config();
    let mut builder = ConfigBuilder::new();
    if resume && own.is_file() {
        builder = builder.run_file(&own).or_raise()?;
    }
    if let Some(file) = config {
        builder = builder.file(&file.display().to_string()).or_raise()?;
    }
    for (key, value) in set.into_iter().flat_map(|set| set.iter()) {
        let key: String = key.extract()?;
        builder = builder.flag("set", &key, toml_value(&key, &value)?).or_raise()?;
    }
    if let Some(method) = method {
        builder = builder.flag("method", "method", method).or_raise()?;
    }
    builder.finish().or_raise()
}

/// A value of `set` as the configuration takes it.
fn toml_value(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    let value = &of_python(value)?;
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return value
            .extract()
            .map(Value::Integer)
            .map_err(|_| raised(format_args!("set: {key} = {value} is too large")));
    }
    if value.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(value.extract()?));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    match value.extract::<PathBuf>() {
        // A resumed run may be in another folder.
        Ok(path) => Ok(Value::String(std::path::absolute(path).or_raise()?.display().to_string())),
        Err(_) => Err(raised(format_args!("set: {key} = {value} is no number, text or path"))),
    }
}

/// A scalar of numpy's as Python's own; other values as they are.
fn of_python<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let scalar = value.py().import("numpy")?.getattr("generic")?;
    if value.is_instance(&scalar)? { value.call_method0("item") } else { Ok(value.clone()) }
}

/// Runs the job and writes its reports.
fn run(gpu: &Arc<Gpu>, job: &PipelineJob, teller: Teller) -> Result<RunReport, WorkError> {
    // Before anything of the folder is read that another run may be writing.
    let _lock = RunLock::take(&job.out)?;
    let interrupt = teller.interrupt.clone();
    let mut watcher = Watcher { gpu, job, teller, report: ReportWriter::new() };
    let finished = Pipeline { gpu, interrupt: &interrupt }.run(job, &mut watcher)?;
    if finished.objects.is_some()
        && let Err(error) = watcher.report.draw_trained_templates(gpu, job)
    {
        watcher.teller.warn(format!("pictures of the stages are missing: {error}"));
    }
    Ok(watcher.report.finish(job, finished)?)
}

/// Passes the messages of a run to the report and to the caller's thread.
struct Watcher<'a> {
    gpu: &'a Arc<Gpu>,
    job: &'a PipelineJob,
    teller: Teller,
    report: ReportWriter,
}

impl Observer for Watcher<'_> {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        self.report.observe(&message)?;
        if let Message::Prepared(prepared) = message {
            self.draw(prepared);
        }
        self.teller.notify(message)
    }
}

impl Watcher<'_> {
    /// Draws the stages. A run is worth more than its pictures: if they fail it continues.
    fn draw(&mut self, prepared: &Prepared) {
        if let Err(error) = self.report.draw_stages(self.gpu, self.job, prepared) {
            self.teller.warn(format!("pictures of the stages are missing: {error}"));
        }
        if let Err(error) = self.report.review(self.job) {
            self.teller.warn(format!("the contact sheet of masks is missing: {error}"));
        }
    }
}
