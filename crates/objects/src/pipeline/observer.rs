//! What a run tells while it goes on, to the one who watches it.

use super::config::RunConfig;
use super::prepare::Prepared;
use super::stage_kinds::Stage;
use crate::segment::LabelProgress;
use instgs_detect::{PromptReport, ViewMasks};
use instgs_io::{IoError, RunFolder};
use instgs_train::TrainMessage;
use instgs_train::facts::{StageTime, TrainFacts};

/// The parts of a run, in order. A plain cloud has the first one only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// A plain cloud is trained, or taken over.
    PlainCloud,
    /// From masks to templates.
    Objects,
    /// Templates, offsets, background and poses are trained together.
    Joint,
}

/// One thing that a run tells.
#[derive(Clone, Copy, Debug)]
pub enum Message<'a> {
    /// A part of a run with templates and instances begins; what is there already is not told of.
    PhaseStarted(Phase),
    /// What the user should know, one line.
    Warning(&'a str),
    /// A stage from masks to templates begins.
    StageStarted(Stage),
    /// That stage is done.
    StageFinished(&'a StageTime),
    /// What the prompt names was looked for in a view.
    ViewMasked {
        /// The view's name.
        name: &'a str,
        /// What was found.
        found: &'a ViewMasks,
        /// Views in all.
        views: usize,
    },
    /// What the prompt names was looked for in all views.
    NamesFound(&'a PromptReport),
    /// Views looked at, of masks from boxes and of labels.
    Labelling(LabelProgress),
    /// Objects, groups and templates are there, in the files of the run folder.
    Prepared(&'a Prepared),
    /// From the training of a phase.
    Training {
        /// Which one.
        phase: Phase,
        /// What it tells.
        message: TrainMessage<'a>,
    },
    /// The training of a phase is done, or a plain cloud was taken over.
    Trained {
        /// Which one.
        phase: Phase,
        /// Its run folder.
        folder: &'a RunFolder,
        /// What it went by.
        config: &'a RunConfig,
        /// What came out.
        facts: &'a TrainFacts,
    },
}

/// Who watches a run. Closures that take a [`Message`] are observers.
pub trait Observer {
    /// Takes a message.
    ///
    /// # Errors
    /// A file that cannot be written; the run ends with it.
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError>;
}

impl<F: FnMut(Message<'_>) -> Result<(), IoError>> Observer for F {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        self(message)
    }
}
