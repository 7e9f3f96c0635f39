//! What happens during training, as typed events; progress bars, the log and the report's curves are made of them.
//!
//! Every event has `step`, the number of finished steps when it happened. Wall-clock times are in events and reports
//! only, never in checkpoints, which must not differ between runs.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use instgs_io::IoError;
use instgs_io::json::null_is_nan;

/// One event; a line of `RUN/events.jsonl`, as an object with the event's name under `event`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A run begins or is resumed.
    Started {
        /// Number of finished steps: 0, or those of the checkpoint that the run continues from.
        step: u64,
        /// Number of steps of the whole run.
        steps: u64,
        /// True if the run continues from a checkpoint.
        resumed: bool,
        /// Method by its name on the command line, for instance `"3dgs"`.
        method: String,
        /// Name of the device in use.
        device: String,
        /// Number of Gaussians at this moment.
        gaussians: u64,
        /// Number of training views.
        views: u64,
        /// Number of test views.
        test_views: u64,
    },
    /// A step is finished. Not every step need be reported.
    Step {
        /// Number of finished steps.
        step: u64,
        /// The loss that was minimised, on the step's view.
        #[serde(deserialize_with = "null_is_nan")]
        loss: f64,
        /// Mean loss of the steps since the last report; `None` in logs of versions without this field.
        #[serde(default)]
        mean_loss: Option<f64>,
        /// For each of these steps whose loss is finite, the index of the training view and the loss. Empty in logs of
        /// versions without this field.
        #[serde(default)]
        view_losses: Vec<(u32, f32)>,
        /// Mean absolute difference, 0..=1.
        #[serde(deserialize_with = "null_is_nan")]
        l1: f64,
        /// Structural similarity, at most 1.
        #[serde(deserialize_with = "null_is_nan")]
        ssim: f64,
        /// Peak signal-to-noise ratio over all pixels, dB: those that a mask of pixels hides count as right, other than in
        /// evaluations.
        #[serde(deserialize_with = "null_is_nan")]
        psnr: f64,
        /// Number of Gaussians.
        gaussians: u64,
        /// Steps per second since the last report.
        #[serde(deserialize_with = "null_is_nan")]
        steps_per_second: f64,
        /// Wall time since this process started or resumed the run, seconds.
        #[serde(deserialize_with = "null_is_nan")]
        seconds: f64,
    },
    /// Gaussians were added, moved or removed.
    Densified {
        /// Number of finished steps.
        step: u64,
        /// Number of Gaussians cloned (or, with `mcmc`, added).
        cloned: u64,
        /// Number of Gaussians replaced by smaller ones.
        split: u64,
        /// Number of Gaussians removed.
        pruned: u64,
        /// Number of Gaussians that single instances got for their own.
        #[serde(default)]
        own: u64,
        /// Number of Gaussians moved onto others (`mcmc`).
        #[serde(default)]
        relocated: u64,
        /// Number of Gaussians afterwards.
        gaussians: u64,
    },
    /// The cloud cannot grow further: it has as many Gaussians as the device's bindings and buffers can hold.
    DeviceFull {
        /// Number of finished steps.
        step: u64,
        /// Number of Gaussians.
        gaussians: u64,
    },
    /// Opacities were lowered.
    OpacityReset {
        /// Number of finished steps.
        step: u64,
        /// Upper bound of all opacities from now on, after the sigmoid.
        to: f64,
    },
    /// Colours have more coefficients from now on.
    ShDegree {
        /// Number of finished steps.
        step: u64,
        /// The SH degree in use.
        degree: u32,
    },
    /// A buffer was too small; it was enlarged and the work repeated.
    Overflow {
        /// Number of finished steps.
        step: u64,
        /// Name of the buffer that overflowed.
        what: String,
        /// Its new capacity, elements.
        grown_to: u64,
    },
    /// Test views were rendered and compared; means over the views.
    Evaluated {
        /// Number of finished steps.
        step: u64,
        /// Number of test views.
        views: u64,
        /// Mean peak signal-to-noise ratio, dB.
        #[serde(deserialize_with = "null_is_nan")]
        psnr: f64,
        /// Mean structural similarity, at most 1.
        #[serde(deserialize_with = "null_is_nan")]
        ssim: f64,
        /// Mean perceptual distance, 0 is best; `None` without the network's weights.
        #[serde(default)]
        lpips: Option<f64>,
    },
    /// A checkpoint was written.
    Checkpoint {
        /// Number of finished steps.
        step: u64,
        /// Path of the checkpoint.
        path: PathBuf,
    },
    /// The run ended or was interrupted.
    Finished {
        /// Number of finished steps.
        step: u64,
        /// True if the run was asked to stop before the last step.
        interrupted: bool,
        /// Number of Gaussians at the end.
        gaussians: u64,
        /// Wall time since this process started or resumed the run, seconds.
        seconds: f64,
    },
}

impl Event {
    /// Number of finished steps when the event happened.
    pub fn step(&self) -> u64 {
        match *self {
            Self::Started { step, .. }
            | Self::Step { step, .. }
            | Self::Densified { step, .. }
            | Self::DeviceFull { step, .. }
            | Self::OpacityReset { step, .. }
            | Self::ShDegree { step, .. }
            | Self::Overflow { step, .. }
            | Self::Evaluated { step, .. }
            | Self::Checkpoint { step, .. }
            | Self::Finished { step, .. } => step,
        }
    }
}

/// Receives the trainer's events: [`super::event_log::EventLog`], or a log together with an observer.
pub trait EventSink {
    /// Receives one event.
    ///
    /// # Errors
    /// The log cannot be written; training ends with this error.
    fn event(&mut self, event: &Event) -> Result<(), IoError>;

    /// Makes sure that the events so far outlive the process; called before a checkpoint is written, which relies on
    /// them.
    ///
    /// # Errors
    /// The same error as [`EventSink::event`].
    fn flush(&mut self) -> Result<(), IoError> {
        Ok(())
    }

    /// Receives a warning for the user: one line, which is no event.
    ///
    /// # Errors
    /// The same error as [`EventSink::event`].
    fn warn(&mut self, text: &str) -> Result<(), IoError> {
        let _ = text;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_event_and_its_fields() -> serde_json::Result<()> {
        let event = Event::Densified { step: 600, cloned: 1, split: 2, pruned: 3, own: 4, relocated: 0, gaussians: 14 };
        let text = serde_json::to_string(&event)?;
        assert_eq!(
            text,
            r#"{"event":"densified","step":600,"cloned":1,"split":2,"pruned":3,"own":4,"relocated":0,"gaussians":14}"#
        );
        assert_eq!(serde_json::from_str::<Event>(&text)?, event);
        assert_eq!(event.step(), 600);
        Ok(())
    }

    #[test]
    fn a_loss_that_is_no_number_survives() -> serde_json::Result<()> {
        let text = r#"{"event":"evaluated","step":3,"views":1,"psnr":null,"ssim":0.5}"#;
        let back: Event = serde_json::from_str(text)?;
        let Event::Evaluated { psnr, ssim, lpips, .. } = back else { panic!("{back:?}") };
        assert!(psnr.is_nan() && ssim == 0.5 && lpips.is_none());
        Ok(())
    }
}
