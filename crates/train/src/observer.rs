//! What a training run tells while it goes on, to the one who watches it.

use super::events::Event;
use instgs_eval::Evaluated;
use instgs_io::IoError;

/// One thing that a run tells.
#[derive(Clone, Copy, Debug)]
pub enum TrainMessage<'a> {
    /// What the user should know before the first step, or of the result: one line.
    Warning(&'a str),
    /// The run goes on from this step, and what an earlier process had done after it is done again.
    Rewound {
        /// Finished steps.
        step: u64,
    },
    /// An event, after it was written to the log.
    Event(&'a Event),
    /// A test view at the end of the run, rendered and compared.
    TestView(&'a Evaluated<'a>),
}

/// Who watches a run. Closures that take a [`TrainMessage`] are observers.
pub trait TrainObserver {
    /// Takes a message.
    ///
    /// # Errors
    /// A file that cannot be written; training ends with it.
    fn notify(&mut self, message: TrainMessage<'_>) -> Result<(), IoError>;
}

impl<F: FnMut(TrainMessage<'_>) -> Result<(), IoError>> TrainObserver for F {
    fn notify(&mut self, message: TrainMessage<'_>) -> Result<(), IoError> {
        self(message)
    }
}
