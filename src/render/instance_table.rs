//! The host copy of the instance table, for scenes that are drawn and edited: edits change it, and the next frame's
//! command buffer writes the changed rows to the device before anything reads them. Nothing waits, and nothing is read
//! back.
//!
//! Frames in flight keep the rows they began with: command buffers run in the order of submission, and each begins with
//! a barrier after all earlier ones.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::gpu::interface::types;
use crate::gpu::{Buffer, GpuError, Recorder};

/// Largest gap of unchanged rows that one update command bridges: writing 1 KiB costs less than another command.
const MOST_BETWEEN: usize = 8;

/// The rows of a scene's instance table.
pub(super) struct InstanceTable {
    rows: Vec<types::Instance>,
    /// Number of source Gaussians of each row while its instance is shown.
    source_counts: Vec<u32>,
    /// Rows that no submission has written yet. Behind a lock, since a scene is shared while it is drawn.
    changed: Arc<Mutex<BTreeSet<usize>>>,
}

/// Rows that a recording writes that is not submitted yet. They do not count as changed meanwhile.
#[derive(Default)]
pub(super) struct RecordedChanges {
    rows: BTreeSet<usize>,
    of: Arc<Mutex<BTreeSet<usize>>>,
}

impl RecordedChanges {
    /// The recording will not be submitted: the rows count as changed again.
    pub(super) fn restore(self) {
        self.of.lock().unwrap_or_else(PoisonError::into_inner).extend(self.rows);
    }
}

impl InstanceTable {
    /// The table of rows that the device already has.
    pub(super) fn new(rows: Vec<types::Instance>) -> Self {
        let source_counts = rows.iter().map(|row| row.source_count).collect();
        Self { rows, source_counts, changed: Arc::default() }
    }

    /// Changes a row; `change` also gets the number of source Gaussians that the row has while its instance is shown.
    ///
    /// # Panics
    /// If `index` is out of range.
    pub(super) fn change(&mut self, index: usize, change: impl FnOnce(&mut types::Instance, u32)) {
        change(&mut self.rows[index], self.source_counts[index]);
        self.changed().insert(index);
    }

    /// All rows.
    pub(super) fn rows(&self) -> &[types::Instance] {
        &self.rows
    }

    /// True if a changed row has not been written by a submission yet.
    pub(super) fn has_changes(&self) -> bool {
        !self.changed().is_empty()
    }

    /// Records the writes of all changed rows. They count as changed until [`InstanceTable::submitted`] is called: the
    /// recording might never be submitted.
    pub(super) fn record(&self, recorder: &mut Recorder, on_device: &Buffer<types::Instance>) -> Result<(), GpuError> {
        recorder.update(on_device, &self.rows, &runs(&self.changed()))
    }

    /// Takes the rows whose writes have just been recorded for a later submission.
    pub(super) fn take_recorded(&self) -> RecordedChanges {
        RecordedChanges { rows: std::mem::take(&mut *self.changed()), of: self.changed.clone() }
    }

    /// Notes that the writes recorded so far have been submitted.
    pub(super) fn submitted(&self) {
        self.changed().clear();
    }

    fn changed(&self) -> MutexGuard<'_, BTreeSet<usize>> {
        self.changed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ascending runs that cover `rows` and gaps of at most [`MOST_BETWEEN`] rows.
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
