//! `instgs.train`: a run of the pipeline with its reports. The run has a thread of its own; the caller's thread passes its
//! events to the user's callback and looks for Ctrl-C.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::ScopedJoinHandle;
use std::time::Duration;

use instgs_io::{IoError, RunFolder, RunLock, load_scene, read_views};
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_objects::pipeline::{Message, Observer, Pipeline, PipelineJob, Prepared};
use instgs_report::{ReportWriter, RunReport};
use instgs_train::interrupt::Interrupt;
use instgs_train::unused_masks;
use instgs_vk::gpu::Gpu;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use toml::Value;

use crate::device::{DeviceName, check_validation, open_device};
use crate::error::{OrRaise, raised, warn};
use crate::events::{Told, told};
use crate::json::{text_to_python, to_python};
use crate::scene::Scene;

/// Why a run ended early.
type RunError = Box<dyn std::error::Error + Send + Sync>;

/// How often the caller's thread looks for Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(50);

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
/// a path object becomes absolute. resume: continue the run in out with its configuration; accept_changed_data: although the data
/// set has changed since. on_event: called with a dict for every event, {"event": "step", "step": 100, "loss": ...} as in
/// events.jsonl, with the "phase".
///
/// Ctrl-C, and an exception of on_event, stop the run after the step, with a checkpoint; then that exception is raised. Raises
/// Error. The interpreter is free meanwhile.
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
    if !resume {
        RunFolder::new(&out).expect_no_run().or_raise()?;
    }
    // Before anything is written: a folder without cameras should not leave an empty run.
    let dataset = py.detach(|| read_views(&data)).or_raise()?;
    unused_masks(&data, &config.train, &dataset.views).iter().try_for_each(|note| warn(py, note))?;
    let gpu = open_device(py, device)?;
    let job = PipelineJob { data, out, config, resume, accept_changed_data };
    let report = run_beside(py, &gpu, &job, on_event.as_ref())?;
    check_validation(&gpu)?;
    let scene = py.detach(|| load_scene(&job.folder().scene())).or_raise()?.scene;
    Ok(Trained { scene: Py::new(py, Scene::of(scene))?, report: to_python(py, &report)?.unbind(), folder: job.out })
}

/// The configuration: the run's own when it goes on, the preset or file, then the values set.
fn resolved(
    out: &Path,
    method: Option<&str>,
    config: Option<PathBuf>,
    set: Option<&Bound<'_, PyDict>>,
    resume: bool,
) -> PyResult<RunConfig> {
    let own = RunFolder::new(out).config();
    let mut builder = ConfigBuilder::new();
    let files = (resume && own.is_file()).then_some(own).into_iter().chain(config);
    for file in files {
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

/// Runs the job in a thread; this one passes on what it tells.
fn run_beside(py: Python<'_>, gpu: &Arc<Gpu>, job: &PipelineJob, on_event: Option<&Py<PyAny>>) -> PyResult<RunReport> {
    let (interrupt, (sender, receiver)) = (Interrupt::new(), channel());
    let receiver = Mutex::new(receiver);
    std::thread::scope(|scope| {
        let (interrupt, asked) = (&interrupt, interrupt.clone());
        let worker = scope.spawn(move || run(gpu, &asked, job, sender));
        let stopped = listen(py, &receiver, interrupt, on_event);
        let result = py.detach(|| join(worker));
        match stopped {
            Some(error) => Err(error),
            None => result.or_raise(),
        }
    })
}

fn join(worker: ScopedJoinHandle<'_, Result<RunReport, RunError>>) -> Result<RunReport, RunError> {
    worker.join().unwrap_or_else(|_| Err("the run ended in a fault of this program; see stderr".into()))
}

/// Passes on what the run tells until it ends. Ctrl-C or an exception of the user's callback asks it to stop; the first of
/// these is returned.
fn listen(
    py: Python<'_>,
    receiver: &Mutex<Receiver<Told>>,
    interrupt: &Interrupt,
    on_event: Option<&Py<PyAny>>,
) -> Option<PyErr> {
    let next = || receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK_EVERY);
    let mut stopped = None;
    loop {
        let told = match py.detach(next) {
            Ok(told) => Some(told),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return stopped,
        };
        let passed = py.check_signals().and_then(|()| match (told, &stopped) {
            (Some(told), None) => pass_on(py, told, on_event),
            _ => Ok(()),
        });
        if let Err(error) = passed {
            interrupt.request();
            stopped.get_or_insert(error);
        }
    }
}

fn pass_on(py: Python<'_>, told: Told, on_event: Option<&Py<PyAny>>) -> PyResult<()> {
    match (told, on_event) {
        (Told::Warning(text), _) => warn(py, text),
        (Told::Event(event), Some(on_event)) => on_event.call1(py, (text_to_python(py, &event)?,)).map(drop),
        (Told::Event(_), None) => Ok(()),
    }
}

/// Runs the job and writes its reports.
fn run(gpu: &Arc<Gpu>, interrupt: &Interrupt, job: &PipelineJob, sender: Sender<Told>) -> Result<RunReport, RunError> {
    // Before anything of the folder is read that another run may be writing.
    let _lock = RunLock::take(&job.out)?;
    let mut watcher = Watcher { gpu, job, interrupt, sender, report: ReportWriter::new() };
    let finished = Pipeline { gpu, interrupt }.run(job, &mut watcher)?;
    if finished.objects.is_some()
        && let Err(error) = watcher.report.draw_trained_templates(gpu, job)
    {
        watcher.warn(format!("pictures of the stages are missing: {error}"));
    }
    Ok(watcher.report.finish(job, finished)?)
}

/// Passes the messages of a run to the report and to the caller's thread.
struct Watcher<'a> {
    gpu: &'a Arc<Gpu>,
    job: &'a PipelineJob,
    interrupt: &'a Interrupt,
    sender: Sender<Told>,
    report: ReportWriter,
}

impl Observer for Watcher<'_> {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        self.report.observe(&message)?;
        if let Some(told) = told(&message) {
            self.tell(told);
        }
        if let Message::Prepared(prepared) = message {
            self.draw(prepared);
        }
        // The trainer looks for itself, between steps, and leaves a checkpoint.
        let trains = matches!(message, Message::Training { .. } | Message::Trained { .. });
        if self.interrupt.requested() && !trains {
            return Err(
                IoError::new(&self.job.out, "was stopped between two stages").advise("continue it with resume=True")
            );
        }
        Ok(())
    }
}

impl Watcher<'_> {
    /// Draws the stages. A run is worth more than its pictures: if they fail it continues.
    fn draw(&mut self, prepared: &Prepared) {
        if let Err(error) = self.report.draw_stages(self.gpu, self.job, prepared) {
            self.warn(format!("pictures of the stages are missing: {error}"));
        }
        if let Err(error) = self.report.review(self.job) {
            self.warn(format!("the contact sheet of masks is missing: {error}"));
        }
    }

    fn warn(&self, text: String) {
        self.tell(Told::Warning(text));
    }

    fn tell(&self, told: Told) {
        // The caller's thread listens until this end is gone.
        let _ = self.sender.send(told);
    }
}
