//! Messages of a training run to its observer.

use super::events::Event;
use instgs_eval::Evaluated;
use instgs_io::IoError;

/// One message of a training run.
#[derive(Clone, Copy, Debug)]
pub enum TrainMessage<'a> {
    /// A warning for the user, before the first step or about the result: one line.
    Warning(&'a str),
    /// A warning while steps go on: one line.
    Note(&'a str),
    /// A photo was decoded and checked before the first step.
    PhotoRead {
        /// Number of photos read so far.
        done: usize,
        /// Number of photos to read, those of the test views included.
        total: usize,
    },
    /// The run continues from this step; later steps of an earlier process are repeated.
    Rewound {
        /// Number of finished steps.
        step: u64,
    },
    /// An event, after it was written to the log.
    Event(&'a Event),
    /// A test view at the end of the run, rendered and compared with its photo.
    TestView(&'a Evaluated<'a>),
}

/// Observes a run. Closures that take a [`TrainMessage`] are observers.
pub trait TrainObserver {
    /// Receives a message.
    ///
    /// # Errors
    /// A file that cannot be written; training ends with this error.
    fn notify(&mut self, message: TrainMessage<'_>) -> Result<(), IoError>;
}

impl<F: FnMut(TrainMessage<'_>) -> Result<(), IoError>> TrainObserver for F {
    fn notify(&mut self, message: TrainMessage<'_>) -> Result<(), IoError> {
        self(message)
    }
}
