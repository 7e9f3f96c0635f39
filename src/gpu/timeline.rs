//! One timeline semaphore per device: every submission gets the next value.

use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;

use super::error::GpuError;

/// The timeline value that a submission signals when it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(pub(crate) u64);

/// The semaphore and the value of the last accepted submission.
pub(crate) struct Timeline {
    pub(crate) semaphore: vk::Semaphore,
    last: AtomicU64,
}

impl Timeline {
    pub(crate) fn new(device: &ash::Device) -> Result<Self, GpuError> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: the device has the timelineSemaphore feature (required at creation); the chain lives through the call.
        let semaphore =
            unsafe { device.create_semaphore(&info, None) }.map_err(GpuError::vulkan("timeline semaphore"))?;
        Ok(Self { semaphore, last: AtomicU64::new(0) })
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

    /// Blocks until the submission behind `ticket` has finished.
    pub(crate) fn wait(&self, device: &ash::Device, ticket: Ticket) -> Result<(), vk::Result> {
        if ticket.0 == 0 {
            return Ok(());
        }
        let (semaphores, values) = ([self.semaphore], [ticket.0]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore belongs to `device` and the arrays live through the call.
        unsafe { device.wait_semaphores(&info, u64::MAX) }
    }
}
