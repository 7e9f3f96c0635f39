//! What a run leaves at its end: the scene, how good it is, and the facts of `trained.json`.

use std::time::Instant;

use instgs_io::View;
use instgs_io::json::write_json;
use instgs_vk::scene::{InstancedScene, RepeatedBytes};

use super::{Run, Trained, evaluated};
use crate::error::TrainError;
use crate::events::{Event, EventSink};
use crate::exposures;
use crate::facts::{Bytes, Counts, DatasetFacts, StageTime, TrainFacts};
use crate::log_and_observer::LogAndObserver;
use crate::observer::TrainMessage;
use crate::results::{cleaned, evaluate_at_end, write_scene, write_training_cameras};
use crate::start::TrainData;

/// How far a run has come when it ends, which Ctrl-C makes earlier.
pub(super) struct Course {
    /// Steps that an earlier process has finished.
    pub(super) first_step: u64,
    /// Steps that are finished, those of earlier processes included.
    pub(super) done: u64,
    /// Wall time of this process's steps, without evaluations and checkpoints.
    pub(super) seconds: f64,
}

/// What a run has written at its end.
struct Saved {
    /// The scene as its file has it.
    scene: InstancedScene,
    /// Gaussians left out because a parameter is not finite.
    dropped_non_finite: usize,
    /// Gaussians left out because they are transparent in every instance.
    pruned: usize,
    /// Bytes of the scene's file.
    file_bytes: u64,
}

impl Run<'_> {
    /// Writes and evaluates the scene, and writes the facts of a run that was not interrupted. `stages` are those so far.
    pub(super) fn end(
        mut self,
        sink: &mut LogAndObserver<'_>,
        data: &TrainData,
        course: Course,
        mut stages: Vec<StageTime>,
    ) -> Result<Trained, TrainError> {
        let Course { first_step, done, seconds } = course;
        let (gpu, job) = (self.gpu, self.job);
        let memory_explained = self.memory_uses();
        let device_peak = gpu.memory_usage().1;
        let save = Instant::now();
        let Saved { scene, dropped_non_finite, pruned, file_bytes } = self.save(sink, &data.train, done)?;
        stages.push(StageTime::since("save", save));

        let interrupted = done < job.config.steps;
        let gaussians = self.state.source_count() as u64;
        let (dataset, times) = (self.dataset_facts(data), self.times);
        // Free the memory of training first: the pictures of the test views and a second copy of the scene may need it.
        drop((self.runner, self.views, self.state));
        let evaluation = Instant::now();
        let test = if interrupted { &[][..] } else { &data.test };
        let eval = evaluate_at_end(gpu, &scene, test, &job.config, sink.observer)?;
        if let Some(report) = &eval {
            sink.event(&evaluated(done, report))?;
            stages.push(StageTime::since("eval", evaluation));
        }
        sink.event(&Event::Finished { step: done, interrupted, gaussians, seconds })?;
        sink.flush()?;
        let steps = (done - first_step) as f64;
        let per_step = |ms: f64| ms / times.steps.max(1) as f64;
        let parameters = memory_explained.iter().find(|m| m.name == "parameters").map_or(0, |m| m.bytes);
        let facts = TrainFacts {
            method: job.config.method.name().into(),
            steps: done,
            steps_per_second: if seconds > 0.0 { steps / seconds } else { 0.0 },
            stages,
            passes_ms: times.passes_ms.iter().map(|(pass, ms)| ((*pass).into(), per_step(*ms))).collect(),
            eval: eval.as_ref().map(|report| report.mean),
            gaussians: Counts::of(&scene),
            bytes: Bytes {
                file: file_bytes,
                host: scene.tensor_bytes(),
                device_scene: parameters,
                scene_on_host: 0,
                device_peak,
            },
            device: gpu.caps().name.clone(),
            seed: job.config.seed,
            repeated: (!scene.instances.is_empty()).then(|| RepeatedBytes::of(&scene)),
            host_fraction: times.host.as_secs_f64() / times.total.as_secs_f64().max(1e-9),
            memory_explained,
            views: eval.as_ref().map(|eval| eval.views.clone()).unwrap_or_default(),
            dataset,
        };
        if !interrupted {
            write_json(&job.folder().facts(), &facts)?;
        }
        Ok(Trained { scene, dropped_non_finite, pruned, interrupted, facts })
    }

    /// Writes the scene after `done` steps, the cameras of the training views and their exposures.
    fn save(&mut self, sink: &mut LogAndObserver<'_>, training_views: &[View], done: u64) -> Result<Saved, TrainError> {
        let job = self.job;
        let mut scene = self.with_room(done, |run| Ok(run.state.download(run.gpu)?))?;
        self.files.restore()?.iter().try_for_each(|text| sink.warn(text))?;
        (scene.pixel_filter, scene.near_plane) = (job.config.pixel_filter(), job.config.near_plane());
        scene.source = format!("instgs-vk train, {done} steps");
        let (dropped_non_finite, pruned) = cleaned(&mut scene, &job.config);
        let file_bytes = write_scene(job, &scene, pruned, done)?;
        write_training_cameras(&job.folder(), training_views, &job.config)?;
        if let Some(learned) = &self.state.exposures {
            exposures::save(self.gpu, learned, training_views, &job.folder())?;
        }
        if dropped_non_finite > 0 {
            let what = format!("dropped {dropped_non_finite} Gaussians with a non-finite parameter");
            sink.observer.notify(TrainMessage::Warning(&what))?;
        }
        Ok(Saved { scene, dropped_non_finite, pruned, file_bytes })
    }

    fn dataset_facts(&self, data: &TrainData) -> DatasetFacts {
        let [width, height] = self.views.largest_px();
        DatasetFacts {
            path: self.job.data.display().to_string(),
            train_views: data.train.len() as u64,
            test_views: data.test.len() as u64,
            width,
            height,
            points: data.points.len() as u64,
            extent: data.extent,
        }
    }
}
