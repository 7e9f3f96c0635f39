//! Messages of a pipeline run to its observer.

use super::config::RunConfig;
use super::prepare::Prepared;
use super::stage_kinds::Stage;
use crate::segment::LabelProgress;
use instgs_detect::{PromptReport, ViewMasks};
use instgs_io::{IoError, RunFolder};
use instgs_train::TrainMessage;
use instgs_train::facts::{StageTime, TrainFacts};

/// The phases of a run, in order. A run that trains a plain cloud has the first one only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// A plain cloud is trained, or a given one is used.
    PlainCloud,
    /// The stages from masks to templates.
    Objects,
    /// Templates, offsets, background and poses are trained together.
    Joint,
}

/// One message of a pipeline run.
#[derive(Clone, Copy, Debug)]
pub enum Message<'a> {
    /// A phase of a run with templates and instances begins. Not sent for a plain cloud that is reused or given.
    PhaseStarted(Phase),
    /// A warning for the user, one line.
    Warning(&'a str),
    /// A stage from masks to templates begins.
    StageStarted(Stage),
    /// A stage ended; its name and wall time.
    StageFinished(&'a StageTime),
    /// Detection in one view is done.
    ViewMasked {
        /// Name of the training view.
        name: &'a str,
        /// Boxes and masks of the view.
        found: &'a ViewMasks,
        /// Number of views in all.
        views: usize,
    },
    /// Detection is done in all views.
    NamesFound(&'a PromptReport),
    /// Progress through the views, of masks from boxes and of labels.
    Labelling(LabelProgress),
    /// The stages before the joint phase are done; their results are in the run folder.
    Prepared(&'a Prepared),
    /// A message of the training of a phase.
    Training {
        /// The phase in training.
        phase: Phase,
        /// The trainer's message.
        message: TrainMessage<'a>,
    },
    /// The plain cloud of an earlier, finished training is used again.
    Reused {
        /// Run folder of the plain cloud.
        folder: &'a RunFolder,
        /// Configuration of the plain cloud's training.
        config: &'a RunConfig,
        /// Results of that training.
        facts: &'a TrainFacts,
    },
    /// The training of a phase is done.
    Trained {
        /// The phase that is done.
        phase: Phase,
        /// Run folder of the phase.
        folder: &'a RunFolder,
        /// Configuration of the phase.
        config: &'a RunConfig,
        /// Times, counts, sizes and quality.
        facts: &'a TrainFacts,
    },
}

/// Observes a run. Closures that take a [`Message`] are observers.
pub trait Observer {
    /// Receives a message.
    ///
    /// # Errors
    /// A file that cannot be written; the run ends with this error.
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError>;
}

impl<F: FnMut(Message<'_>) -> Result<(), IoError>> Observer for F {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        self(message)
    }
}
