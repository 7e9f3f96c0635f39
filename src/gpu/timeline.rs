//! One timeline semaphore per device: every submission gets the next value.

use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;

use super::error::GpuError;

/// The timeline value that a submission signals when it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(pub(crate) u64);

/// What the host has asked of a device since it was opened. The counts depend on the calls alone, not on how fast the device is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SubmissionCounts {
    /// Command buffers that were submitted.
    pub submissions: u64,
    /// Host waits for a submission that no earlier wait had shown to be finished.
    pub waits: u64,
    /// Of these waits, those for the last submission: they leave the device without work.
    pub drains: u64,
}

/// The semaphore and the value of the last accepted submission.
pub(crate) struct Timeline {
    pub(crate) semaphore: vk::Semaphore,
    last: AtomicU64,
    /// The largest value that a wait has returned for: everything up to it is finished.
    finished: AtomicU64,
    waits: AtomicU64,
    drains: AtomicU64,
}

impl Timeline {
    pub(crate) fn new(device: &ash::Device) -> Result<Self, GpuError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device has the timelineSemaphore feature (required at creation); the chain lives through the call.
        let semaphore =
            unsafe { device.create_semaphore(&info, None) }.map_err(GpuError::vulkan("timeline semaphore"))?;
        let [last, finished, waits, drains] = [0; 4].map(AtomicU64::new);
        Ok(Self { semaphore, last, finished, waits, drains })
    }

    /// The value that the next submission signals. The caller holds the queue's lock until it has called `submitted`.
    pub(crate) fn next(&self) -> Ticket {
        Ticket(self.last.load(Ordering::SeqCst) + 1)
    }

    /// Notes that the submission of `ticket` was accepted; one that failed must not be waited for.
    pub(crate) fn submitted(&self, ticket: Ticket) {
        self.last.store(ticket.0, Ordering::SeqCst);
    }

    /// The value of the last accepted submission.
    pub(crate) fn last(&self) -> Ticket {
        Ticket(self.last.load(Ordering::SeqCst))
    }

    /// Submissions and waits so far.
    pub(crate) fn counts(&self) -> SubmissionCounts {
        let [submissions, waits, drains] =
            [&self.last, &self.waits, &self.drains].map(|count| count.load(Ordering::SeqCst));
        SubmissionCounts { submissions, waits, drains }
    }

    /// Blocks until the submission behind `ticket` has finished.
    pub(crate) fn wait(&self, device: &ash::Device, ticket: Ticket) -> Result<(), vk::Result> {
        if ticket.0 <= self.finished.load(Ordering::SeqCst) {
            return Ok(());
        }
        self.waits.fetch_add(1, Ordering::SeqCst);
        if ticket == self.last() {
            self.drains.fetch_add(1, Ordering::SeqCst);
        }
        let (semaphores, values) = ([self.semaphore], [ticket.0]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore belongs to `device` and the arrays live through the call.
        unsafe { device.wait_semaphores(&info, u64::MAX) }?;
        self.finished.fetch_max(ticket.0, Ordering::SeqCst);
        Ok(())
    }
}
