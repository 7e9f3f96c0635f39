//! Events of a run go to its log, and then to its observer.

use instgs_io::IoError;

use super::event_log::EventLog;
use super::events::{Event, EventSink};
use super::observer::{TrainMessage, TrainObserver};

/// The run's log and its observer, as one receiver of events.
pub(super) struct LogAndObserver<'a> {
    pub(super) log: EventLog,
    pub(super) observer: &'a mut dyn TrainObserver,
}

impl EventSink for LogAndObserver<'_> {
    fn event(&mut self, event: &Event) -> Result<(), IoError> {
        self.log.event(event)?;
        self.tell_if_restored()?;
        self.observer.notify(TrainMessage::Event(event))
    }

    fn flush(&mut self) -> Result<(), IoError> {
        self.log.flush()?;
        self.tell_if_restored()
    }

    fn warn(&mut self, text: &str) -> Result<(), IoError> {
        self.observer.notify(TrainMessage::Note(text))
    }
}

impl LogAndObserver<'_> {
    fn tell_if_restored(&mut self) -> Result<(), IoError> {
        if !self.log.was_restored() {
            return Ok(());
        }
        let text = format!("{}: was removed during the training and is written again", self.log.path().display());
        self.warn(&text)
    }
}
