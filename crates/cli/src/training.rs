//! Runs a training job with printed progress and reports; shared by all commands that train.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::progress_lines::{LabelLines, NamingLines, group_lines, warn_of_names};
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer, Progress, device};
use instgs_io::{IoError, RunLock};
use instgs_objects::pipeline::{Message, Observer, Phase, Pipeline, PipelineError, PipelineJob, Prepared, Stage};
use instgs_report::{ReportError, ReportWriter, RunReport};
use instgs_train::TrainMessage;
use instgs_train::events::Event;
use instgs_train::interrupt::Interrupt;
use instgs_vk::gpu::Gpu;
use instgs_vk::scene::InstancedScene;

/// Reading photos shows its progress if it takes longer.
const SHORT_WAIT: Duration = Duration::from_secs(2);

/// Device, interrupt and printer of a command, shared by its runs.
pub struct Session<'a> {
    /// Device to render and train on.
    pub gpu: &'a Arc<Gpu>,
    /// The request to stop that Ctrl-C makes.
    pub interrupt: &'a Interrupt,
    /// Printer of progress and warnings.
    pub printer: &'a Printer,
}

/// Runs all phases of the job's method; afterwards the run folder has all results.
///
/// # Errors
/// Faulty input, a device that fails, an interrupted run, or another process that trains in the folder.
pub fn train_job(session: &Session<'_>, job: &PipelineJob) -> Result<RunReport, CliError> {
    // Before anything of the folder is read that another run may be writing.
    let _lock = RunLock::take(&job.out)?;
    let mut watcher = Watcher {
        session,
        job,
        training: TrainProgress::new(session.printer),
        naming: NamingLines::new(session.printer),
        labels: LabelLines::new(session.printer),
        report: ReportWriter::new(),
    };
    let finished = Pipeline { gpu: session.gpu, interrupt: session.interrupt }.run(job, &mut watcher)?;
    device::check_validation(session.gpu)?;
    let mut report = watcher.report;
    if finished.objects.is_some()
        && let Err(error) = report.draw_trained_templates(session.gpu, job)
    {
        warn_of_pictures(session.printer, &error);
    }
    Ok(report.finish(job, finished)?)
}

/// Prints the messages of a run and passes them to the report.
struct Watcher<'a> {
    session: &'a Session<'a>,
    job: &'a PipelineJob,
    training: TrainProgress<'a>,
    naming: NamingLines<'a>,
    labels: LabelLines<'a>,
    report: ReportWriter,
}

impl Observer for Watcher<'_> {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        self.report.observe(&message)?;
        let printer = self.session.printer;
        match message {
            Message::PhaseStarted(phase) => printer.line(match phase {
                Phase::PlainCloud => "1 of 3: a plain cloud of Gaussians",
                Phase::Objects => "2 of 3: the object of each Gaussian, and one template per group",
                Phase::Joint => "3 of 3: templates, offsets, background and poses together",
            }),
            Message::Warning(text) => printer.warning(text),
            Message::ViewMasked { name, found, views } => self.naming.at(name, found, views),
            Message::NamesFound(found) => {
                self.naming.end();
                warn_of_names(found, printer);
            }
            Message::Labelling(at) => self.labels.at(at),
            Message::Prepared(prepared) => self.prepared(prepared),
            Message::Training { message, .. } => self.training.tell(message),
            Message::Trained { .. } | Message::Reused { .. } => self.training.bar = None,
            // The progress of labelling continues that of the consensus.
            Message::StageStarted(Stage::Segment) | Message::StageFinished(_) => {}
            Message::StageStarted(_) => self.labels.end(),
        }
        Ok(())
    }
}

impl Watcher<'_> {
    /// Prints the groups and draws the stages. A run is worth more than its pictures: if they fail it continues.
    fn prepared(&mut self, prepared: &Prepared) {
        let (printer, folder) = (self.session.printer, self.job.folder());
        group_lines(&prepared.groups, printer);
        match self.report.draw_stages(self.session.gpu, self.job, prepared) {
            Ok(()) => {
                let folder = folder.stage_pictures();
                printer.line(format_args!("pictures of masks, objects, poses and templates: {}", folder.display()));
            }
            Err(error) => warn_of_pictures(printer, &error),
        }
        match self.report.review(self.job) {
            Ok(()) => {
                printer.line(format_args!("masks and objects of every view: {}", folder.review().display()));
            }
            Err(error) => printer.warning(format_args!("the contact sheet of masks is missing: {error}")),
        }
    }
}

fn warn_of_pictures(printer: &Printer, error: &ReportError) {
    printer.warning(format_args!("pictures of the stages are missing: {error}"));
}

/// Training progress for people: a bar with loss, PSNR, Gaussians and speed, and lines for events between steps.
struct TrainProgress<'a> {
    printer: &'a Printer,
    /// When the first of the photos was read that are read now.
    photos_since: Option<Instant>,
    /// Their progress, if it takes long.
    photos: Option<Progress>,
    bar: Option<Progress>,
}

impl<'a> TrainProgress<'a> {
    fn new(printer: &'a Printer) -> Self {
        Self { printer, photos_since: None, photos: None, bar: None }
    }

    fn tell(&mut self, message: TrainMessage<'_>) {
        match message {
            TrainMessage::Warning(text) => {
                // The only one after the first step is about the result: the bar has nothing more to show.
                self.bar = None;
                self.printer.warning(text);
            }
            TrainMessage::Note(text) => self.printer.warning(text),
            TrainMessage::PhotoRead { done, total } => {
                let since = *self.photos_since.get_or_insert_with(Instant::now);
                if self.photos.is_none() && since.elapsed() > SHORT_WAIT {
                    self.photos = Some(self.printer.progress("photos", total as u64));
                }
                if let Some(photos) = &mut self.photos {
                    photos.advance_to(done as u64, "");
                }
                if done == total {
                    (self.photos, self.photos_since) = (None, None);
                }
            }
            TrainMessage::Rewound { step } => {
                self.printer.line(format_args!("continuing from step {step}; later steps are repeated"));
            }
            TrainMessage::Event(event) => self.event(event),
            TrainMessage::TestView(_) => {}
        }
    }

    fn event(&mut self, event: &Event) {
        match event {
            Event::Started { step, steps, gaussians, views, test_views, device, .. } => {
                let (gaussians, printer) = (grouped(*gaussians), self.printer);
                printer.line(format_args!(
                    "{device}: {gaussians} Gaussians, {views} training and {test_views} test views"
                ));
                let mut bar = printer.progress("train", *steps);
                bar.advance_to(*step, "");
                self.bar = Some(bar);
            }
            Event::Step { step, loss, psnr, gaussians, steps_per_second, .. } => {
                let text = format!(
                    "PSNR {psnr:.2}, {steps_per_second:.2} steps/s, loss {loss:.4}, {} Gaussians",
                    grouped(*gaussians)
                );
                if let Some(bar) = &mut self.bar {
                    bar.advance_to(*step, text);
                }
            }
            Event::Evaluated { step, psnr, ssim, .. } => {
                self.printer.line(format_args!("step {step}: test PSNR {psnr:.2} dB, SSIM {ssim:.3}"));
            }
            Event::DeviceFull { step, gaussians } => {
                let gaussians = grouped(*gaussians);
                self.printer.line(format_args!(
                    "step {step}: {gaussians} Gaussians, as many as a buffer of this device has room for: no more are added \
                     (max_gaussians allows more)"
                ));
            }
            _ => {}
        }
    }
}

/// Trains a scene of templates and instances, without the phases before the joint one; returns the trained scene.
///
/// # Errors
/// Faulty input, a device that fails, an interrupted run, or another process that trains in the folder.
pub fn refine_scene(
    session: &Session<'_>,
    job: &PipelineJob,
    scene: &InstancedScene,
) -> Result<InstancedScene, CliError> {
    let _lock = RunLock::take(&job.out)?;
    let mut progress = TrainProgress::new(session.printer);
    let mut tell = |message: Message<'_>| {
        if let Message::Training { message, .. } = message {
            progress.tell(message);
        }
        Ok(())
    };
    match (Pipeline { gpu: session.gpu, interrupt: session.interrupt }).joint(job, scene, &mut tell) {
        Ok(trained) => Ok(trained.scene),
        Err(PipelineError::Interrupted { steps, .. }) => {
            Err(CliError::msg(format!("stopped after {steps} steps; the same command continues")))
        }
        Err(error) => Err(error.into()),
    }
}
