//! What a run does where device memory is short.

use super::Run;
use crate::error::TrainError;
use crate::facts::MemoryUse;
use crate::memory::{Needs, memory_uses};

/// Fraction of the device's memory above which it is nearly full: other programs and allocators use some too.
const TIGHT: f64 = 0.8;

impl Run<'_> {
    /// What memory is used for in a step.
    pub(super) fn memory_uses(&self) -> Vec<MemoryUse> {
        match self.runner.frame().buffers() {
            None if !self.used_before.is_empty() => self.used_before.clone(),
            _ => memory_uses(&self.state, &self.runner, &self.views),
        }
    }

    /// Does work between steps, after `done` of them. Where memory is short the buffers of steps make room, then photos.
    pub(super) fn with_room<T>(
        &mut self,
        done: u64,
        mut work: impl FnMut(&mut Self) -> Result<T, TrainError>,
    ) -> Result<T, TrainError> {
        let mut released = false;
        loop {
            match work(self) {
                Err(error) if error.missing_bytes().is_some() => {
                    if !std::mem::replace(&mut released, true) {
                        self.used_before = self.memory_uses();
                        self.runner.release();
                    } else if !self.views.give_way(done)? {
                        return Err(error);
                    }
                }
                result => return result,
            }
        }
    }

    /// What would fit, if the error is that memory ran out.
    pub(super) fn remedy(&self, error: &TrainError) -> Option<String> {
        let needs = Needs {
            missing: error.missing_bytes()?,
            gaussians: self.state.source_count() as u64,
            gaussian_bytes: self.state_bytes(),
            picture_bytes: self.views.bytes(),
            budget_mb: self.job.config.device_memory_mb,
        };
        Some(needs.what_fits())
    }

    /// Bytes of the Gaussians on the device, with gradients and moments.
    fn state_bytes(&self) -> u64 {
        self.state.scene.bytes() + self.state.gradients.bytes() + self.state.moments.bytes()
    }

    /// True if a second copy of the state might exceed the device's memory or the budget.
    pub(super) fn memory_is_tight(&self) -> bool {
        self.gpu.memory_usage().0 + self.state_bytes() > (self.gpu.memory_budget() as f64 * TIGHT) as u64
    }
}
