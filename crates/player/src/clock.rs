//! Frame times: the intervals between frames on the screen.

use std::collections::VecDeque;

use instgs_vk::math::statistics::percentile;

/// Number of intervals kept: two seconds at 120 frames per second.
const REMEMBERED: usize = 240;

/// The times of the last frames.
#[derive(Clone, Debug, Default)]
pub struct FrameClock {
    /// Intervals between frames in milliseconds, oldest first.
    times_ms: VecDeque<f64>,
}

/// Median and slow frame times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRate {
    /// Half of the frames took less, milliseconds.
    pub median_ms: f64,
    /// One frame in a hundred took longer, milliseconds.
    pub slow_ms: f64,
}

impl FrameClock {
    /// Records a frame that was shown `ms` milliseconds after the one before.
    pub fn push(&mut self, ms: f64) {
        if self.times_ms.len() == REMEMBERED {
            self.times_ms.pop_front();
        }
        self.times_ms.push_back(ms);
    }

    /// Clears the record: the next frame follows a pause.
    pub fn clear(&mut self) {
        self.times_ms.clear();
    }

    /// Times of the last frames in milliseconds, oldest first.
    pub fn times_ms(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.times_ms.iter().copied()
    }

    /// Median and 99th percentile; `None` before the first frame.
    pub fn rate(&self) -> Option<FrameRate> {
        let times: Vec<f64> = self.times_ms().collect();
        let at = |fraction| percentile(&times, fraction);
        (!times.is_empty()).then(|| FrameRate { median_ms: at(0.5), slow_ms: at(0.99) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn median_and_slow_end_of_what_is_remembered() {
        let mut clock = FrameClock::default();
        assert_eq!(clock.rate(), None);
        clock.push(7.0);
        assert_eq!(clock.rate(), Some(FrameRate { median_ms: 7.0, slow_ms: 7.0 }));
        (0..1000).for_each(|k| clock.push(f64::from(k % 240)));
        assert_eq!(clock.times_ms().len(), REMEMBERED);
        let rate = clock.rate().unwrap();
        assert!((rate.median_ms - 119.5).abs() < 1e-9 && (rate.slow_ms - 236.61).abs() < 1e-9, "{rate:?}");
        clock.clear();
        assert_eq!(clock.rate(), None);
    }
}
