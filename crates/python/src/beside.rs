//! Long work in a thread of its own, while the caller's thread passes what it tells to the user's callback and looks for Ctrl-C.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::ScopedJoinHandle;
use std::time::Duration;

use instgs_io::IoError;
use instgs_objects::pipeline::{Message, Observer};
use instgs_train::TrainMessage;
use instgs_train::interrupt::Interrupt;
use pyo3::prelude::*;

use crate::error::{OrRaise, warn};
use crate::events::{Told, told};
use crate::json::text_to_python;

/// Why the work ended early.
pub(crate) type WorkError = Box<dyn std::error::Error + Send + Sync>;

/// How often the caller's thread looks for Ctrl-C.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// What the work has of the thread that waits for it.
pub(crate) struct Teller {
    /// The request to stop.
    pub(crate) interrupt: Interrupt,
    sender: Sender<Told>,
    /// The folder that messages name.
    folder: PathBuf,
}

impl Teller {
    /// Sends a remark for the user.
    pub(crate) fn warn(&self, text: impl Into<String>) {
        self.tell(Told::Warning(text.into()));
    }

    fn tell(&self, told: Told) {
        // The caller's thread listens until this end is gone.
        let _ = self.sender.send(told);
    }
}

/// Passes messages on. It stops the work between two stages, and while photos are read, when that is asked for; the trainer looks
/// for itself, between steps, and leaves a checkpoint.
impl Observer for Teller {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        if let Some(told) = told(&message) {
            self.tell(told);
        }
        let trains = match message {
            // Reading may take minutes, and there is no step yet whose result would be lost.
            Message::Training { message: TrainMessage::PhotoRead { .. }, .. } => false,
            Message::Training { .. } | Message::Trained { .. } => true,
            _ => false,
        };
        if self.interrupt.requested() && !trains {
            let error = IoError::new(&self.folder, "was stopped between two stages, or before the first step");
            return Err(error.advise("continue it with resume=True"));
        }
        Ok(())
    }
}

/// Does the work in a thread; this one passes on what it tells. `folder` is the one that it writes.
///
/// # Errors
/// What the work returns; or first of all Ctrl-C or an exception of `on_event`, which ask it to stop.
pub(crate) fn beside<T: Send>(
    py: Python<'_>,
    folder: PathBuf,
    on_event: Option<&Py<PyAny>>,
    work: impl FnOnce(Teller) -> Result<T, WorkError> + Send,
) -> PyResult<T> {
    let (interrupt, (sender, receiver)) = (Interrupt::new(), channel());
    let receiver = Mutex::new(receiver);
    let teller = Teller { interrupt: interrupt.clone(), sender, folder };
    std::thread::scope(|scope| {
        let worker = scope.spawn(move || work(teller));
        let stopped = listen(py, &receiver, &interrupt, on_event);
        let result = py.detach(|| join(worker));
        match stopped {
            Some(error) => Err(error),
            None => result.or_raise(),
        }
    })
}

fn join<T>(worker: ScopedJoinHandle<'_, Result<T, WorkError>>) -> Result<T, WorkError> {
    worker.join().unwrap_or_else(|_| Err("the run ended in a fault of this program; see stderr".into()))
}

/// Passes on what the work tells until it ends. Ctrl-C or an exception of the user's callback asks it to stop; the first of
/// these is returned.
fn listen(
    py: Python<'_>,
    receiver: &Mutex<Receiver<Told>>,
    interrupt: &Interrupt,
    on_event: Option<&Py<PyAny>>,
) -> Option<PyErr> {
    let next = || receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(LOOK_EVERY);
    let mut stopped = None;
    loop {
        let told = match py.detach(next) {
            Ok(told) => Some(told),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return stopped,
        };
        let passed = py.check_signals().and_then(|()| match (told, &stopped) {
            (Some(told), None) => pass_on(py, told, on_event),
            _ => Ok(()),
        });
        if let Err(error) = passed {
            interrupt.request();
            stopped.get_or_insert(error);
        }
    }
}

fn pass_on(py: Python<'_>, told: Told, on_event: Option<&Py<PyAny>>) -> PyResult<()> {
    match (told, on_event) {
        (Told::Warning(text), _) => warn(py, text),
        (Told::Event(event), Some(on_event)) => on_event.call1(py, (text_to_python(py, &event)?,)).map(drop),
        (Told::Event(_), None) => Ok(()),
    }
}
