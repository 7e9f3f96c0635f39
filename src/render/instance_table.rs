//! The instance table on the host, for scenes that are drawn and edited: edits change it, and the next picture's command buffer
//! writes the changed rows to the device before anything reads them. Nobody waits, and nothing is read back.
//!
//! Pictures in flight keep the rows they began with: command buffers run in the order in which they were submitted, and each
//! begins with a barrier behind all that came before.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::gpu::interface::types;
use crate::gpu::{Buffer, GpuError, Recorder};

/// Changed rows with at most so many unchanged ones between them are written by one command: 1 KiB costs less than a command.
const MOST_BETWEEN: usize = 8;

/// The rows of a scene's instance table.
pub(super) struct InstanceTable {
    rows: Vec<types::Instance>,
    /// Source Gaussians of each row while its instance is shown.
    source_counts: Vec<u32>,
    /// Rows that no submission has written yet. Behind a lock, since a scene is shared while it is drawn.
    changed: Mutex<BTreeSet<usize>>,
}

impl InstanceTable {
    /// Of a table that the device has already.
    pub(super) fn new(rows: Vec<types::Instance>) -> Self {
        let source_counts = rows.iter().map(|row| row.source_count).collect();
        Self { rows, source_counts, changed: Mutex::default() }
    }

    /// Changes a row; `change` is also told how many source Gaussians the row has while its instance is shown.
    ///
    /// # Panics
    /// If there is no such row.
    pub(super) fn change(&mut self, index: usize, change: impl FnOnce(&mut types::Instance, u32)) {
        change(&mut self.rows[index], self.source_counts[index]);
        self.changed().insert(index);
    }

    /// True if a row was changed that no submission has written.
    pub(super) fn has_changes(&self) -> bool {
        !self.changed().is_empty()
    }

    /// Records the writes of all changed rows, which stay changed until [`InstanceTable::submitted`] says otherwise: what
    /// was recorded may not come to be submitted.
    pub(super) fn record(&self, recorder: &mut Recorder, on_device: &Buffer<types::Instance>) -> Result<(), GpuError> {
        recorder.update(on_device, &self.rows, &runs(&self.changed()))
    }

    /// What was recorded since the last change has been submitted.
    pub(super) fn submitted(&self) {
        self.changed().clear();
    }

    fn changed(&self) -> MutexGuard<'_, BTreeSet<usize>> {
        self.changed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ascending runs of rows that cover these and little else.
fn runs(rows: &BTreeSet<usize>) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for &row in rows {
        match runs.last_mut() {
            Some(run) if row - run.end <= MOST_BETWEEN => run.end = row + 1,
            _ => runs.push(row..row + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_are_close_are_one_run() {
        let of = |rows: &[usize]| runs(&rows.iter().copied().collect());
        assert!(of(&[]).is_empty());
        assert_eq!(of(&[5]), std::slice::from_ref(&(5..6)));
        assert_eq!(of(&[7, 2, 3]), std::slice::from_ref(&(2..8)));
        assert_eq!(
            of(&[0, 1 + MOST_BETWEEN, 3 + 2 * MOST_BETWEEN]),
            [0..2 + MOST_BETWEEN, 3 + 2 * MOST_BETWEEN..4 + 2 * MOST_BETWEEN]
        );
    }
}
