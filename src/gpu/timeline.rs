//! A timeline semaphore per device: every submission signals the next value.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use ash::vk;

use super::error::GpuError;

/// The timeline value that a submission signals when it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(pub(crate) u64);

/// Submissions and waits since a device was opened. The counts depend on the calls alone, not on the device's speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SubmissionCounts {
    /// Command buffers that were submitted.
    pub submissions: u64,
    /// Host waits for a submission that was not known to have finished.
    pub waits: u64,
    /// Of these waits, those for the last submission: they leave the device idle.
    pub drains: u64,
}

/// The semaphore and the value of the last accepted submission.
pub(crate) struct Timeline {
    device: ash::Device,
    /// Created for the first submission: devices that can only compile have none.
    semaphore: OnceLock<vk::Semaphore>,
    last: AtomicU64,
    /// True once the device is lost: nothing is in flight any more.
    lost: AtomicBool,
    /// The largest value known to be reached: everything up to it has finished.
    finished: AtomicU64,
    waits: AtomicU64,
    drains: AtomicU64,
}

impl Timeline {
    pub(crate) fn new(device: &ash::Device) -> Self {
        let [last, finished, waits, drains] = [0; 4].map(AtomicU64::new);
        let (device, semaphore, lost) = (device.clone(), OnceLock::new(), AtomicBool::new(false));
        Self { device, semaphore, last, lost, finished, waits, drains }
    }

    /// The same with the semaphore, so that nothing can fail later.
    pub(crate) fn with_semaphore(device: &ash::Device) -> Result<Self, GpuError> {
        let timeline = Self::new(device);
        timeline.semaphore().map_err(GpuError::vulkan("timeline semaphore"))?;
        Ok(timeline)
    }

    /// The semaphore that submissions signal. The caller holds the queue's lock, or is the only user, so
    /// that nobody else creates it meanwhile.
    pub(crate) fn semaphore(&self) -> Result<vk::Semaphore, vk::Result> {
        if let Some(&semaphore) = self.semaphore.get() {
            return Ok(semaphore);
        }
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device has the timelineSemaphore feature (required at creation); the chain lives through the call.
        let semaphore = unsafe { self.device.create_semaphore(&info, None) }?;
        Ok(*self.semaphore.get_or_init(|| semaphore))
    }

    /// The value that the next submission signals. The caller holds the queue's lock until it has called `submitted`.
    pub(crate) fn next(&self) -> Ticket {
        Ticket(self.last.load(Ordering::SeqCst) + 1)
    }

    /// Notes that the submission of `ticket` was accepted. A rejected one must not be waited for.
    pub(crate) fn submitted(&self, ticket: Ticket) {
        self.last.store(ticket.0, Ordering::SeqCst);
    }

    /// The value of the last accepted submission.
    pub(crate) fn last(&self) -> Ticket {
        Ticket(self.last.load(Ordering::SeqCst))
    }

    /// Numbers of submissions and waits so far.
    pub(crate) fn counts(&self) -> SubmissionCounts {
        let [submissions, waits, drains] =
            [&self.last, &self.waits, &self.drains].map(|count| count.load(Ordering::SeqCst));
        SubmissionCounts { submissions, waits, drains }
    }

    /// Blocks until the semaphore has the value of `ticket`.
    pub(crate) fn wait(&self, ticket: Ticket) -> Result<(), vk::Result> {
        if ticket.0 <= self.finished.load(Ordering::SeqCst) {
            return Ok(());
        }
        // Without a submission there is no ticket to wait for.
        let Some(&semaphore) = self.semaphore.get() else { return Ok(()) };
        // A lost device says so at every wait.
        if self.lost.load(Ordering::SeqCst) {
            return Err(vk::Result::ERROR_DEVICE_LOST);
        }
        self.waits.fetch_add(1, Ordering::SeqCst);
        if ticket == self.last() {
            self.drains.fetch_add(1, Ordering::SeqCst);
        }
        let (semaphores, values) = ([semaphore], [ticket.0]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore belongs to `device` and the arrays live through the call.
        let waited = unsafe { self.device.wait_semaphores(&info, u64::MAX) };
        if waited == Err(vk::Result::ERROR_DEVICE_LOST) {
            self.lost.store(true, Ordering::SeqCst);
        }
        if waited.is_ok() {
            self.finished.fetch_max(ticket.0, Ordering::SeqCst);
        }
        waited
    }

    /// Makes the device count as lost, once all that was submitted has finished: a device that only counts as lost still works on it.
    pub(crate) fn lose(&self) {
        let _ = self.wait(self.last());
        self.finished.store(0, Ordering::SeqCst);
        self.lost.store(true, Ordering::SeqCst);
    }

    /// True if the semaphore has reached the value of `ticket`, or never will because the device is lost.
    pub(crate) fn is_over(&self, ticket: Ticket) -> bool {
        ticket <= self.finished()
    }

    /// True if the device is known to be lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.finished() == Ticket(u64::MAX)
    }

    /// The last value that was reached; the largest u64 if the device is lost.
    pub(crate) fn finished(&self) -> Ticket {
        if self.lost.load(Ordering::SeqCst) {
            return Ticket(u64::MAX);
        }
        let Some(&semaphore) = self.semaphore.get() else { return Ticket(0) };
        // SAFETY: a timeline semaphore of this device.
        match unsafe { self.device.get_semaphore_counter_value(semaphore) } {
            Ok(value) => Ticket(value),
            Err(vk::Result::ERROR_DEVICE_LOST) => {
                self.lost.store(true, Ordering::SeqCst);
                Ticket(u64::MAX)
            }
            Err(_) => Ticket(0),
        }
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        if let Some(semaphore) = self.semaphore.take() {
            // SAFETY: the owner has waited for the submissions that signal the semaphore, or the device is lost.
            unsafe { self.device.destroy_semaphore(semaphore, None) };
        }
    }
}
