//! How long pictures take.

use std::collections::VecDeque;

use instgs_vk::math::statistics::percentile;

/// Pictures that are remembered: two seconds at 120 per second.
const REMEMBERED: usize = 240;

/// Times of the last pictures.
#[derive(Clone, Debug, Default)]
pub struct FrameClock {
    /// From one picture to the next, milliseconds, oldest first.
    times_ms: VecDeque<f64>,
}

/// What the times say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRate {
    /// Half of the pictures took less, milliseconds.
    pub median_ms: f64,
    /// One picture in a hundred took longer, milliseconds.
    pub slow_ms: f64,
}

impl FrameClock {
    /// Notes a picture that came `ms` milliseconds after the one before.
    pub fn push(&mut self, ms: f64) {
        if self.times_ms.len() == REMEMBERED {
            self.times_ms.pop_front();
        }
        self.times_ms.push_back(ms);
    }

    /// Forgets everything: the next picture follows a pause.
    pub fn clear(&mut self) {
        self.times_ms.clear();
    }

    /// Milliseconds of the last pictures, oldest first.
    pub fn times_ms(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.times_ms.iter().copied()
    }

    /// Median and slowest percent; `None` before the first picture.
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
