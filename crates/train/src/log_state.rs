//! What a checkpoint holds besides the scene, so that the log of a resumed run goes on as that of an uninterrupted one.

use std::path::Path;

use instgs_io::IoError;
use instgs_io::checkpoint::Checkpoint;

/// Tensor of a checkpoint: view and loss (the bits of an f64) of each step since the last report. Absent if there is none.
const LOSSES: &str = "log.losses";
/// Metadata of a checkpoint: capacity for (splat, tile) pairs, and width and height of the pictures that it was found with.
const ROOM: &str = "log.intersections";

/// What the log of a run depends on besides the scene in training.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LogState {
    /// View and loss of each step since the last report.
    pub(super) losses: Vec<(usize, f64)>,
    /// Room for (splat, tile) pairs that steps needed so far; `None` if it need not hold for the next ones.
    pub(super) room: Option<Room>,
}

/// A capacity for (splat, tile) pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    pub(super) intersections: u32,
    /// Width and height that no training picture exceeds, pixels.
    pub(super) largest_px: [u32; 2],
}

impl LogState {
    /// Adds the state to a checkpoint.
    pub(super) fn put(&self, checkpoint: &mut Checkpoint) {
        if !self.losses.is_empty() {
            let rows = self.losses.iter().flat_map(|&(view, loss)| [view as u64, loss.to_bits()]).collect();
            checkpoint.put::<u64>(LOSSES, &[self.losses.len(), 2], rows);
        }
        if let Some(Room { intersections, largest_px: [width, height] }) = self.room {
            checkpoint.metadata.insert(ROOM.into(), format!("{intersections} {width} {height}"));
        }
    }

    /// Takes the state out of a checkpoint; older versions wrote none. `path` is for messages.
    ///
    /// # Errors
    /// A tensor has another type or shape.
    pub(super) fn take(checkpoint: &mut Checkpoint, path: &Path) -> Result<Self, IoError> {
        let mut out = Self::default();
        if checkpoint.tensors.contains_key(LOSSES) {
            let rows: Vec<u64> = checkpoint.take(LOSSES, &[2], path)?;
            out.losses = rows.as_chunks().0.iter().map(|&[view, loss]| (view as usize, f64::from_bits(loss))).collect();
        }
        let numbers = checkpoint.metadata.get(ROOM).map(|text| text.split(' ').map(str::parse).collect());
        if let Some(Ok::<Vec<u32>, _>(numbers)) = numbers
            && let [intersections, width, height] = numbers[..]
        {
            out.room = Some(Room { intersections, largest_px: [width, height] });
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_put_is_taken() -> Result<(), IoError> {
        let path = Path::new("c");
        let room = Room { intersections: 70_000, largest_px: [640, 480] };
        let state = LogState { losses: vec![(3, 0.1 + 0.2), (0, f64::INFINITY)], room: Some(room) };
        let mut checkpoint = Checkpoint::default();
        state.put(&mut checkpoint);
        assert_eq!(LogState::take(&mut checkpoint, path)?, state);
        // Nothing is written where there is nothing, and nothing is what older versions have.
        let mut empty = Checkpoint::default();
        LogState::default().put(&mut empty);
        assert_eq!(empty, Checkpoint::default());
        assert_eq!(LogState::take(&mut empty, path)?, LogState::default());
        empty.metadata.insert(ROOM.into(), "many".into());
        assert_eq!(LogState::take(&mut empty, path)?, LogState::default());
        Ok(())
    }
}
