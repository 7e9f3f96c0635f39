//! Writes the reports of a run while it goes on, from the messages that the run's observer receives.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use super::stage_pictures::{self, data::StagePictures};
use super::{
    JointMatch, ReportData, ReportError, Rgb8, RunReport, SceneView, ViewPicture, choose, training_seconds, write,
};
use instgs_eval::Evaluated;
use instgs_io::json::read_json;
use instgs_io::picture_png::encode_png;
use instgs_io::{IoError, RunFolder, atomic_write, run_folder};
use instgs_objects::pipeline::config::RunConfig;
use instgs_objects::pipeline::{Finished, Message, ObjectPhases, Phase, PipelineJob, Prepared};
use instgs_train::TrainMessage;
use instgs_train::config::Method;
use instgs_train::event_log::read_events;
use instgs_train::events::Event;
use instgs_train::facts::{StageTime, TrainFacts};
use instgs_vk::gpu::Gpu;

/// Upper bound of the test views whose pictures the page shows.
const PICTURES: usize = 8;

/// Collects what a report needs, and writes it.
#[derive(Default)]
pub struct ReportWriter {
    /// Test views of the training in progress.
    test_views: Vec<TestView>,
    /// Report of the last finished training.
    last: ReportData,
    /// Report and log of the plain cloud that the run trained or reused.
    cloud: Option<(RunReport, Vec<Event>)>,
    pictures: StagePictures,
    /// Time spent on pictures of the stages and on views of scenes, seconds.
    drawing_seconds: f64,
}

/// What is kept of a test view until the run folder is told: pictures of many megapixels would fill the memory.
struct TestView {
    /// For the page, should it be chosen.
    picture: ViewPicture,
    /// The rendering at full size as a PNG file.
    png: Vec<u8>,
}

impl ReportWriter {
    /// A writer that has received no message yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Receives a message of the pipeline. The report of a plain cloud and the rendered test views are written at once; that of
    /// a reused cloud is read before the next phase, and written if the process that trained it did not get to it.
    ///
    /// # Errors
    /// A log that cannot be read, or a file that cannot be written.
    pub fn observe(&mut self, message: &Message<'_>) -> Result<(), IoError> {
        match message {
            Message::Training { message: TrainMessage::TestView(view), .. } => self.test_views.push(kept_of(view)?),
            Message::Trained { phase, folder, config, facts } => {
                let views = std::mem::take(&mut self.test_views);
                write_renders(folder, &views)?;
                let events = read_events(&folder.events())?;
                let report = report_of(facts, &events, config);
                let shown = choose(&report.views, PICTURES).into_iter().filter_map(|i| views.get(i));
                let pictures = shown.map(|view| view.picture.clone()).collect();
                let scene = Some(self.scene_view(folder, &report));
                self.last = ReportData { report, events, pictures, scene, ..ReportData::default() };
                if *phase == Phase::PlainCloud {
                    write(folder, &self.last)?;
                    self.cloud = Some((self.last.report.clone(), self.last.events.clone()));
                }
            }
            Message::Reused { folder, config, facts } => self.cloud = Some(report_of_reused(folder, config, facts)?),
            _ => {}
        }
        Ok(())
    }

    /// The view of a trained scene.
    fn scene_view(&mut self, run: &RunFolder, report: &RunReport) -> SceneView {
        let started = Instant::now();
        let view = SceneView::of_run(run, Path::new(&report.dataset.path));
        self.drawing_seconds += started.elapsed().as_secs_f64();
        view
    }

    /// Draws pictures of the stages from masks to templates, into `RUN/stages/` and for the page.
    ///
    /// # Errors
    /// The same errors as [`stage_pictures::draw`].
    pub fn draw_stages(&mut self, gpu: &Arc<Gpu>, job: &PipelineJob, prepared: &Prepared) -> Result<(), ReportError> {
        let started = Instant::now();
        let drawn = stage_pictures::draw(gpu, job, prepared);
        self.drawing_seconds += started.elapsed().as_secs_f64();
        self.pictures = drawn?;
        Ok(())
    }

    /// Writes the contact sheet `RUN/review.html`.
    ///
    /// # Errors
    /// The same errors as [`stage_pictures::review_segments`].
    pub fn review(&mut self, job: &PipelineJob) -> Result<(), IoError> {
        let started = Instant::now();
        let reviewed = stage_pictures::review_segments(job);
        self.drawing_seconds += started.elapsed().as_secs_f64();
        reviewed
    }

    /// Adds pictures of the templates after the joint phase, if the stages were drawn.
    ///
    /// # Errors
    /// The same errors as [`stage_pictures::add_trained_templates`].
    pub fn draw_trained_templates(&mut self, gpu: &Arc<Gpu>, job: &PipelineJob) -> Result<(), ReportError> {
        if self.pictures.views.is_empty() {
            return Ok(());
        }
        let started = Instant::now();
        let added = stage_pictures::add_trained_templates(gpu, job, &mut self.pictures);
        self.drawing_seconds += started.elapsed().as_secs_f64();
        added
    }

    /// Writes the report of the whole run; with templates and instances it covers both phases, if both were run.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(mut self, job: &PipelineJob, finished: Finished) -> Result<RunReport, IoError> {
        if let Some(objects) = finished.objects {
            self.complete(job, objects);
        }
        // That of a plain cloud was written when it was trained.
        if job.config.train.method == Method::Instanced {
            write(&job.folder(), &self.last)?;
        }
        Ok(self.last.report)
    }

    /// Extends the joint phase's report to the whole run.
    fn complete(&mut self, job: &PipelineJob, objects: ObjectPhases) {
        let ObjectPhases { plain_cloud, prepared } = objects;
        let (vanilla, vanilla_events) = self.cloud.take().unwrap_or_else(|| report_of_given(job, &plain_cloud));
        let of_phase = |phase: &str, stages: &[StageTime]| -> Vec<StageTime> {
            stages.iter().map(|s| StageTime { name: format!("{phase}: {}", s.name), ..s.clone() }).collect()
        };
        let data = &mut self.last;
        let report = &mut data.report;
        let joint = of_phase("joint", &report.stages);
        report.warnings = prepared.warnings();
        let drawing = vec![StageTime { name: "pictures".into(), seconds: self.drawing_seconds }];
        report.stages = [of_phase("3dgs", &vanilla.stages), prepared.stages, drawing, joint].concat();
        report.seconds = report.stages.iter().map(|s| s.seconds).sum();
        report.groups = prepared.groups;
        report.registration = prepared.registration;
        report.joint_match = JointMatch::of(&vanilla_events, &data.events, report.dataset.train_views);
        report.vanilla = Some(Box::new(vanilla));
        data.vanilla_events = vanilla_events;
        data.stages = std::mem::take(&mut self.pictures);
    }
}

/// The report of a given plain cloud, which has no log.
fn report_of_given(job: &PipelineJob, facts: &TrainFacts) -> (RunReport, Vec<Event>) {
    let mut config = job.cloud_phase().config;
    config.train.steps = 1;
    (report_of(facts, &[], &config), Vec::new())
}

/// Report and log of a plain cloud that was trained before.
fn report_of_reused(
    run: &RunFolder,
    config: &RunConfig,
    facts: &TrainFacts,
) -> Result<(RunReport, Vec<Event>), IoError> {
    // The log may have been removed; only the page needs it.
    let events = if run.events().is_file() { read_events(&run.events())? } else { Vec::new() };
    if run.report().is_file() {
        let report: RunReport = read_json(&run.report())?;
        if report.steps == facts.steps {
            return Ok((report, events));
        }
    }
    let report = report_of(facts, &events, config);
    let scene = Some(SceneView::of_run(run, Path::new(&report.dataset.path)));
    let data = ReportData { report, events, scene, ..ReportData::default() };
    write(run, &data)?;
    Ok((data.report, data.events))
}

/// The report of one training. The facts of a resumed run cover the time since it was resumed; the log covers all.
fn report_of(facts: &TrainFacts, events: &[Event], config: &RunConfig) -> RunReport {
    let facts = facts.clone();
    let stages: Vec<StageTime> = facts
        .stages
        .into_iter()
        .map(|stage| match stage.name.as_str() {
            "train" => StageTime { seconds: training_seconds(events), ..stage },
            _ => stage,
        })
        .collect();
    RunReport {
        method: facts.method,
        steps: facts.steps,
        seconds: stages.iter().map(|s| s.seconds).sum(),
        steps_per_second: facts.steps_per_second,
        stages,
        passes_ms: facts.passes_ms.into_iter().collect(),
        eval: facts.eval,
        gaussians: facts.gaussians,
        bytes: facts.bytes,
        device: facts.device,
        seed: facts.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        repeated: facts.repeated,
        host_fraction: facts.host_fraction,
        memory_explained: facts.memory_explained,
        views: facts.views,
        dataset: facts.dataset,
        config: config.clone(),
        ..RunReport::default()
    }
}

fn kept_of(view: &Evaluated<'_>) -> Result<TestView, IoError> {
    let rgb8 = |pixels: &[[f32; 3]]| Rgb8 {
        width: view.pair.width(),
        height: view.pair.height(),
        pixels: pixels.iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect(),
    };
    let fail = |error: &dyn std::fmt::Display| IoError::new(Path::new(view.name), error.to_string());
    let (photo, render) = (rgb8(view.pair.target()), rgb8(view.pair.render()));
    let picture = ViewPicture::new(view.name, view.metrics, &photo, &render).map_err(|e| fail(&e))?;
    let mut png = Vec::new();
    encode_png(&mut png, &render.pixels, (render.width, render.height)).map_err(|e| fail(&e))?;
    Ok(TestView { picture, png })
}

fn write_renders(run: &RunFolder, views: &[TestView]) -> Result<(), IoError> {
    if views.is_empty() {
        return Ok(());
    }
    let folder = run.renders();
    run_folder::create(&folder)?;
    for TestView { picture, png } in views {
        atomic_write(&folder.join(format!("{}.png", picture.name)), |out| out.write_all(png))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_eval::{Metrics, PicturePair};
    use instgs_io::picture_png::write_png;

    /// The file is that of the whole picture; what is kept for the page is no wider than the page.
    #[test]
    fn a_test_view_leaves_its_whole_picture_and_keeps_a_small_one() -> Result<(), Box<dyn std::error::Error>> {
        let (width, height) = (1000, 20);
        let color = |i: u32| [(i % 251) as f32 / 250.0, (i % 83) as f32 / 90.0, (i % 7) as f32 / 6.0];
        let render: Vec<_> = (0..width * height).map(color).collect();
        let photo: Vec<_> = (0..width * height).map(|i| color(i + 3)).collect();
        let pair = PicturePair::new((width, height), &render, &photo, None)?;
        let view = Evaluated { name: "a", pair: &pair, metrics: Metrics::default(), visible: 1 };
        let kept = kept_of(&view)?;
        let ViewPicture { size, ground_truth, render: small, difference, .. } = &kept.picture;
        assert_eq!((size, small.width, small.height), (&[1000, 20], 480, 10));
        assert_eq!([ground_truth.pixels.len(), difference.pixels.len()], [3 * 480 * 10; 2]);
        let folder = tempfile::tempdir()?;
        let run = RunFolder::new(folder.path());
        write_renders(&run, &[kept])?;
        let bytes: Vec<u8> = render.iter().flatten().map(|v| (v * 255.0).round() as u8).collect();
        let plain = folder.path().join("plain.png");
        write_png(&plain, &bytes, (width, height))?;
        assert!(std::fs::read(run.renders().join("a.png"))? == std::fs::read(plain)?, "the bytes of before");
        Ok(())
    }
}
