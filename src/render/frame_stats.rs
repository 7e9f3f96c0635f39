//! Counts and times of a frame, and their sums and medians by pass.

use crate::math::statistics::median;

/// Counts and times of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameStats {
    /// Visible (instance, chunk) pairs that were expanded.
    pub work_items: u64,
    /// Splats that touch at least one tile.
    pub visible: u64,
    /// (splat, tile) pairs of all slabs.
    pub intersections: u64,
    /// Depth slabs that the frame took, at least one a layer.
    pub slabs: u32,
    /// Depth layers of the frame; 1 if it was drawn in one piece.
    pub layers: u32,
    /// True if the host has chosen the layers, as depth ranges that fit the buffers.
    pub in_ranges: bool,
    /// Number of restarts of the frame because a buffer was too small.
    pub redone: u32,
    /// (pass, milliseconds) in order; empty without profiling. Redone attempts are not included.
    pub passes_ms: Vec<(&'static str, f64)>,
}

impl FrameStats {
    /// True if the frame is drawn by one submission: no layer took a second slab, or is a submission of its own.
    pub fn is_one_submission(&self) -> bool {
        self.slabs == self.layers && !self.in_ranges
    }

    /// (pass, milliseconds): sums over the frame's dispatches of the same pass, in the order of the first of each.
    pub fn ms_by_pass(&self) -> Vec<(&'static str, f64)> {
        let mut sums: Vec<(&'static str, f64)> = Vec::new();
        for &(pass, ms) in &self.passes_ms {
            match sums.iter_mut().find(|(name, _)| *name == pass) {
                Some((_, sum)) => *sum += ms,
                None => sums.push((pass, ms)),
            }
        }
        sums
    }

    /// (pass, milliseconds): medians over frames; a frame without a pass counts as 0 for that pass.
    pub fn median_ms_by_pass(frames: &[Self]) -> Vec<(&'static str, f64)> {
        let mut by_pass: Vec<(&'static str, Vec<f64>)> = Vec::new();
        for (k, frame) in frames.iter().enumerate() {
            for (pass, ms) in frame.ms_by_pass() {
                let index = by_pass.iter().position(|(name, _)| *name == pass).unwrap_or_else(|| {
                    by_pass.push((pass, vec![0.0; frames.len()]));
                    by_pass.len() - 1
                });
                by_pass[index].1[k] = ms;
            }
        }
        by_pass.into_iter().map(|(pass, values)| (pass, median(&values))).collect()
    }

    /// Milliseconds of all passes; `None` without profiling.
    pub fn total_ms(&self) -> Option<f64> {
        (!self.passes_ms.is_empty()).then(|| self.passes_ms.iter().map(|(_, ms)| ms).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_are_summed_in_a_frame_and_medians_over_frames() {
        let frame =
            |passes_ms: &[(&'static str, f64)]| FrameStats { passes_ms: passes_ms.to_vec(), ..Default::default() };
        let frames =
            [frame(&[("scan", 1.0), ("sort", 5.0), ("scan", 2.0)]), frame(&[("sort", 7.0)]), frame(&[("scan", 9.0)])];
        assert_eq!(frames[0].ms_by_pass(), [("scan", 3.0), ("sort", 5.0)]);
        assert_eq!(FrameStats::median_ms_by_pass(&frames), [("scan", 3.0), ("sort", 5.0)]);
        assert!(FrameStats::median_ms_by_pass(&[]).is_empty());
    }
}
