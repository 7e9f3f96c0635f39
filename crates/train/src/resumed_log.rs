//! Which events of an earlier process stay in the log of a run that is resumed, and which are still to come.

use instgs_io::IoError;
use instgs_io::checkpoint::file_name;

use super::config::TrainConfig;
use super::event_log::EventLog;
use super::events::Event;
use super::observer::{TrainMessage, TrainObserver};
use super::trainer::TrainJob;

/// What is known of the part of a run that is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Past {
    /// Number of finished steps.
    pub(super) step: u64,
    /// Whether the densification after these steps is still to be done.
    pub(super) due: bool,
    /// Whether the log has the event of the step's checkpoint.
    pub(super) checkpoint: bool,
    /// Whether the test views were evaluated after the step.
    pub(super) evaluated: bool,
    /// Whether a shorter run ended with this step.
    pub(super) ended: bool,
    /// Whether it was reported that the device is full.
    pub(super) device_full: bool,
}

/// Opens the log of a run that goes on after `step` finished steps; `due` as in [`Past`].
///
/// # Errors
/// The log cannot be read or written; then it is unchanged.
pub(super) fn open_log(
    job: &TrainJob,
    step: u64,
    due: bool,
    observer: &mut dyn TrainObserver,
) -> Result<(EventLog, Past), IoError> {
    let path = job.folder().events();
    let mut past = Past { step, due, ..Past::default() };
    // Without a checkpoint everything begins anew.
    if !job.resume || step == 0 {
        return Ok((EventLog::create(&path)?, past));
    }
    let (log, kept) = EventLog::resume(&path, step, &mut |events| {
        past.ended = is_end_of_shorter(events, step, &job.config);
        events.iter().map(|event| past.ended || stays(event, past, &job.config)).collect()
    })?;
    for event in &kept.events {
        let is_last = event.step() == step;
        past.checkpoint |= is_last && matches!(event, Event::Checkpoint { .. });
        past.evaluated |= is_last && matches!(event, Event::Evaluated { .. });
        past.device_full |= matches!(event, Event::DeviceFull { .. });
    }
    if kept.later > 0 {
        observer.notify(TrainMessage::Rewound { step })?;
    }
    Ok((log, past))
}

impl Past {
    /// The event of the checkpoint that the run goes on from, if the process that wrote it did not get to log it.
    pub(super) fn missing_checkpoint(&self, job: &TrainJob) -> Option<Event> {
        let missing = self.step > 0 && !self.ended && !self.checkpoint && job.config.checkpoints_at(self.step);
        let path = job.folder().checkpoints().join(file_name(self.step));
        missing.then_some(Event::Checkpoint { step: self.step, path })
    }

    /// True if the test views are still to be evaluated before the next step.
    pub(super) fn misses_evaluation(&self, config: &TrainConfig) -> bool {
        let is_between = 0 < self.step && self.step < config.steps;
        is_between && !self.ended && !self.evaluated && config.evaluates_at(self.step)
    }
}

/// True if a run that had fewer steps than the configuration ended with `step`: its last evaluation stays.
fn is_end_of_shorter(events: &[Event], step: u64, config: &TrainConfig) -> bool {
    let ends = |event: &Event| matches!(event, Event::Finished { interrupted: false, .. }) && event.step() == step;
    step < config.steps && events.iter().any(ends)
}

/// True if an event stays in the log of a run that goes on from a checkpoint: it was before the checkpoint, or after it and
/// would not happen again.
fn stays(event: &Event, past: Past, config: &TrainConfig) -> bool {
    let Past { step, due, .. } = past;
    if event.step() != step {
        return event.step() < step;
    }
    match event {
        Event::Step { .. } => true,
        Event::Densified { .. } | Event::DeviceFull { .. } | Event::OpacityReset { .. } => !due,
        Event::Checkpoint { .. } => !due && config.checkpoints_at(step),
        Event::Evaluated { .. } => !due && config.evaluates_at(step) && step < config.steps,
        // It has the time of the process that was asked to stop.
        Event::Finished { interrupted, .. } => *interrupted,
        // Those of the next step, and of a process that did not get to another checkpoint.
        Event::Started { .. } | Event::ShDegree { .. } | Event::Overflow { .. } => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ConfigBuilder;
    use crate::events::EventSink;

    type Test = Result<(), Box<dyn std::error::Error>>;

    const STEP: u64 = 40;

    fn started(step: u64) -> Event {
        let (method, device) = ("3dgs".to_owned(), String::new());
        Event::Started { step, steps: 90, resumed: step > 0, method, device, gaussians: 1, views: 1, test_views: 1 }
    }

    fn step(step: u64) -> Event {
        let (loss, mean_loss, view_losses) = (0.5, None, Vec::new());
        let (l1, ssim, psnr, gaussians) = (0.1, 0.9, 20.0, 1);
        Event::Step {
            step,
            loss,
            mean_loss,
            view_losses,
            l1,
            ssim,
            psnr,
            gaussians,
            steps_per_second: 1.0,
            seconds: 1.0,
        }
    }

    /// All that may happen around a checkpoint after 40 steps, in order.
    fn sample() -> Vec<Event> {
        let densified =
            Event::Densified { step: STEP, cloned: 1, split: 0, pruned: 0, own: 0, relocated: 0, gaussians: 2 };
        vec![
            started(0),
            Event::ShDegree { step: 0, degree: 0 },
            Event::Overflow { step: 9, what: "pairs".into(), grown_to: 7 },
            step(STEP),
            densified,
            Event::DeviceFull { step: STEP, gaussians: 2 },
            Event::OpacityReset { step: STEP, to: 0.01 },
            Event::Checkpoint { step: STEP, path: "c".into() },
            Event::Evaluated { step: STEP, views: 1, psnr: 20.0, ssim: 0.9, lpips: None },
            Event::ShDegree { step: STEP, degree: 1 },
            Event::Overflow { step: STEP, what: "pairs".into(), grown_to: 9 },
            step(STEP + 10),
        ]
    }

    /// Resumes a log at the step; returns how many of its events stayed, whether it was said that steps are repeated, and
    /// the past.
    fn resumed(events: &[Event], sets: &[&str], due: bool) -> Result<(usize, bool, Past), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let (data, out) = (folder.path().into(), folder.path().into());
        let config = sets.iter().try_fold(ConfigBuilder::new(), |builder, set| builder.set(set))?.finish()?;
        let job = TrainJob { data, out, config, config_file: None, resume: true, accept_changed_data: false };
        let mut log = EventLog::create(&job.folder().events())?;
        events.iter().try_for_each(|event| log.event(event))?;
        log.flush()?;
        let mut rewound = false;
        let mut observer = |message: TrainMessage<'_>| {
            rewound |= matches!(message, TrainMessage::Rewound { step: STEP });
            Ok(())
        };
        let (_, past) = open_log(&job, STEP, due, &mut observer)?;
        let kept = crate::event_log::read_events(&job.folder().events())?;
        assert!(kept.iter().all(|event| events.contains(event)));
        Ok((kept.len(), rewound, past))
    }

    #[test]
    fn the_log_goes_on_where_its_checkpoint_was() -> Test {
        let all = sample();
        let often = ["steps=90", "checkpoint_every=20", "eval_every=20"];
        let past = Past { step: STEP, checkpoint: true, evaluated: true, device_full: true, ..Past::default() };
        // Killed at any moment after the checkpoint: what follows it is kept as far as it would not come again.
        for end in 7..=all.len() {
            let (kept, rewound, found) = resumed(&all[..end], &often, false)?;
            assert_eq!((kept, rewound), (end.min(9), end == all.len()), "{end}");
            assert_eq!(found, Past { checkpoint: end > 7, evaluated: end > 8, ..past }, "{end}");
        }
        // Neither is due at this step: the checkpoint of an interrupted run is no event of an uninterrupted one.
        let (kept, _, found) = resumed(&all, &["steps=90", "checkpoint_every=0"], false)?;
        assert_eq!((kept, found), (7, Past { checkpoint: false, evaluated: false, ..past }));
        // Written before the densification, which is done again.
        let (kept, _, found) = resumed(&all, &often, true)?;
        assert_eq!((kept, found), (4, Past { step: STEP, due: true, ..Past::default() }));
        Ok(())
    }

    #[test]
    fn ends_stay_only_where_more_steps_follow() -> Test {
        let finished = |interrupted| Event::Finished { step: STEP, interrupted, gaussians: 1, seconds: 2.0 };
        let mut ended = [&sample()[..9], &[finished(false)]].concat();
        let (kept, _, past) = resumed(&ended, &["steps=90"], false)?;
        assert!(kept == 10 && past.ended);
        // The same steps again: checkpoint, evaluation and end come again.
        let (kept, _, past) = resumed(&ended, &["steps=40"], false)?;
        assert!(kept == 8 && !past.ended && past.checkpoint, "{kept} {past:?}");
        ended[9] = finished(true);
        let (kept, _, past) = resumed(&ended, &["steps=90", "checkpoint_every=0"], false)?;
        assert!(kept == 8 && !past.ended && !past.checkpoint, "{kept} {past:?}");
        Ok(())
    }

    #[test]
    fn what_was_not_logged_is_still_to_come() -> Test {
        let (out, config) = ("run".into(), ConfigBuilder::new().set("steps=90")?.set("eval_every=20")?.finish()?);
        let mut job =
            TrainJob { data: "d".into(), out, config, config_file: None, resume: true, accept_changed_data: false };
        let past = Past { step: STEP, ..Past::default() };
        assert!(past.missing_checkpoint(&job).is_none() && past.misses_evaluation(&job.config));
        job.config.checkpoint_every = 40;
        let path = job.folder().checkpoints().join("step_0000040.safetensors");
        assert_eq!(past.missing_checkpoint(&job), Some(Event::Checkpoint { step: STEP, path }));
        for past in [Past { ended: true, ..past }, Past { checkpoint: true, evaluated: true, ..past }, Past::default()]
        {
            assert!(past.missing_checkpoint(&job).is_none() && !past.misses_evaluation(&job.config), "{past:?}");
        }
        Ok(())
    }
}
