//! What happens during training, as typed events; progress bars, the log and the report's curves are made of them.
//!
//! Every event has `step`, the number of finished steps when it happened. Times on the clock are in events and reports
//! only, never in checkpoints, which must not differ between runs.

use std::path::PathBuf;

use serde::{Deserialize, Deserializer, Serialize};

use instgs_io::IoError;

/// One event; a line of `RUN/events.jsonl`, as an object with the event's name under `event`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A run, or the rest of one, begins.
    Started {
        /// Finished steps: 0, or those of the checkpoint that the run continues from.
        step: u64,
        /// Steps in all.
        steps: u64,
        /// True if it continues from a checkpoint.
        resumed: bool,
        /// `"3dgs"`.
        method: String,
        /// Device name.
        device: String,
        /// Gaussians at this moment.
        gaussians: u64,
        /// Training views.
        views: u64,
        /// Test views.
        test_views: u64,
    },
    /// A step is finished. Not every step need be reported.
    Step {
        /// Finished steps.
        step: u64,
        /// The loss that was minimised, on the step's view.
        #[serde(deserialize_with = "null_is_nan")]
        loss: f64,
        /// Mean loss of the steps since the one reported before; `None` in logs of versions that did not have it.
        #[serde(default)]
        mean_loss: Option<f64>,
        /// Of these steps, but those whose loss is not finite: index of the training view, and the loss. Empty in logs of
        /// versions that did not have it.
        #[serde(default)]
        view_losses: Vec<(u32, f32)>,
        /// Mean absolute difference, 0..=1.
        #[serde(deserialize_with = "null_is_nan")]
        l1: f64,
        /// Structural similarity, at most 1.
        #[serde(deserialize_with = "null_is_nan")]
        ssim: f64,
        /// Peak signal-to-noise ratio, dB.
        #[serde(deserialize_with = "null_is_nan")]
        psnr: f64,
        /// Gaussians.
        gaussians: u64,
        /// Over the last reported stretch.
        #[serde(deserialize_with = "null_is_nan")]
        steps_per_second: f64,
        /// Wall time of this run, or this part of it, so far.
        #[serde(deserialize_with = "null_is_nan")]
        seconds: f64,
    },
    /// Gaussians were added, moved or removed.
    Densified {
        /// Finished steps.
        step: u64,
        /// Cloned (or, with `mcmc`, added).
        cloned: u64,
        /// Replaced by smaller ones.
        split: u64,
        /// Removed.
        pruned: u64,
        /// Moved onto others (`mcmc`).
        #[serde(default)]
        relocated: u64,
        /// How many there are now.
        gaussians: u64,
    },
    /// The cloud can grow no further: it has as many Gaussians as the device's largest binding has room for.
    DeviceFull {
        /// Finished steps.
        step: u64,
        /// Gaussians.
        gaussians: u64,
    },
    /// Opacities were lowered.
    OpacityReset {
        /// Finished steps.
        step: u64,
        /// To at most this, after the sigmoid.
        to: f64,
    },
    /// Colours have more coefficients from now on.
    ShDegree {
        /// Finished steps.
        step: u64,
        /// The degree in use.
        degree: u32,
    },
    /// A buffer was too small; it was enlarged and the work done again.
    Overflow {
        /// Finished steps.
        step: u64,
        /// Which buffer.
        what: String,
        /// Its new capacity, elements.
        grown_to: u64,
    },
    /// Test views were rendered and compared; means over the views.
    Evaluated {
        /// Finished steps.
        step: u64,
        /// How many views.
        views: u64,
        /// dB.
        #[serde(deserialize_with = "null_is_nan")]
        psnr: f64,
        /// At most 1.
        #[serde(deserialize_with = "null_is_nan")]
        ssim: f64,
        /// 0 is best; `None` if there are no weights to compute it with.
        #[serde(default)]
        lpips: Option<f64>,
    },
    /// A checkpoint was written.
    Checkpoint {
        /// Finished steps.
        step: u64,
        /// Its file.
        path: PathBuf,
    },
    /// The run ends.
    Finished {
        /// Finished steps.
        step: u64,
        /// True if someone asked to stop before the last step.
        interrupted: bool,
        /// Gaussians at the end.
        gaussians: u64,
        /// Wall time of this run, or this part of it.
        seconds: f64,
    },
}

impl Event {
    /// Finished steps when it happened.
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

/// Where the trainer puts its events: [`super::event_log::EventLog`], or that and an observer.
pub trait EventSink {
    /// Takes an event.
    ///
    /// # Errors
    /// A log that cannot be written; training ends with it.
    fn event(&mut self, event: &Event) -> Result<(), IoError>;

    /// Makes sure that the events so far outlive the process; called before a checkpoint is written, which stands on them.
    ///
    /// # Errors
    /// As [`EventSink::event`].
    fn flush(&mut self) -> Result<(), IoError> {
        Ok(())
    }
}

/// JSON has no NaN and no infinities: they are written as `null`.
pub fn null_is_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_the_event_and_its_fields() -> serde_json::Result<()> {
        let event = Event::Densified { step: 600, cloned: 1, split: 2, pruned: 3, relocated: 0, gaussians: 10 };
        let text = serde_json::to_string(&event)?;
        assert_eq!(
            text,
            r#"{"event":"densified","step":600,"cloned":1,"split":2,"pruned":3,"relocated":0,"gaussians":10}"#
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
