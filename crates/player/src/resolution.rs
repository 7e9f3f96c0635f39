//! Smaller pictures while things move, if the device does not make it within the time that a picture may take.

/// Each scale is this part of the one before: half the pixels in two steps.
const STEP: f64 = 0.840_896_415_253_714_6;
/// The smallest scale, a quarter of width and height, is this many steps away.
const MOST_STEPS: u32 = 8;
/// A larger scale must be expected to need at most this part of the budget, so that it is not left again at once.
const HEADROOM: f64 = 0.8;
/// So many pictures in a row must be fast before the scale grows: a third of a second at 60 per second.
const PATIENCE: u32 = 20;

/// The scale that pictures are drawn at while things move; what stands still has all its pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Milliseconds that a picture may take on the device; `None` = as long as it takes, with all pixels.
    pub budget_ms: Option<f64>,
    steps: u32,
    fast: u32,
}

impl Resolution {
    /// With all pixels at first.
    pub fn with_budget(budget_ms: Option<f64>) -> Self {
        Self { budget_ms, ..Self::default() }
    }

    /// Part of width and height; 1 = all of it.
    pub fn scale(&self) -> f64 {
        if self.budget_ms.is_some() { STEP.powi(self.steps as i32) } else { 1.0 }
    }

    /// A picture of the current scale took `ms` on the device. The time of a picture is taken to go with its pixels, which
    /// is true of what is blended and too bold for the rest: then another step follows.
    pub fn took(&mut self, ms: f64) {
        let Some(budget) = self.budget_ms.filter(|budget| *budget > 0.0 && ms.is_finite()) else { return };
        let per_step = STEP * STEP;
        if ms > budget {
            let wanted = ((budget / ms).ln() / per_step.ln()).ceil().clamp(1.0, f64::from(MOST_STEPS)) as u32;
            (self.steps, self.fast) = ((self.steps + wanted).min(MOST_STEPS), 0);
        } else if self.steps > 0 && ms / per_step < HEADROOM * budget {
            self.fast += 1;
            if self.fast == PATIENCE {
                (self.steps, self.fast) = (self.steps - 1, 0);
            }
        } else {
            self.fast = 0;
        }
    }

    /// The size of a picture for a window; at least one pixel.
    pub fn of([width, height]: [u32; 2], scale: f64) -> [u32; 2] {
        [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(side.min(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device that takes 1 ms and 40 more per full picture.
    fn ms(scale: f64) -> f64 {
        1.0 + 40.0 * scale * scale
    }

    #[test]
    fn it_settles_within_the_budget_and_comes_back() {
        let mut resolution = Resolution { budget_ms: Some(16.0), ..Resolution::default() };
        let mut scales = Vec::new();
        for _ in 0..200 {
            resolution.took(ms(resolution.scale()));
            scales.push(resolution.scale());
        }
        assert!(ms(scales[3]) <= 16.0, "{:?}", &scales[..4]);
        assert!(scales[3..].iter().all(|s| *s == scales[3]), "no to and fro: {scales:?}");
        assert!(ms(scales[3] / STEP) > HEADROOM * 16.0, "no smaller than needed");
        // The view becomes easy: step by step all pixels again.
        (0..PATIENCE * MOST_STEPS).for_each(|_| resolution.took(2.0));
        assert_eq!(resolution.scale(), 1.0);
    }

    #[test]
    fn limits() {
        let mut resolution = Resolution::default();
        resolution.took(1e9);
        assert_eq!(resolution.scale(), 1.0, "no budget, all pixels");
        resolution.budget_ms = Some(1.0);
        (0..9).for_each(|_| resolution.took(1e9));
        resolution.took(f64::NAN);
        assert!((resolution.scale() - 0.25).abs() < 1e-12);
        assert_eq!(Resolution::of([101, 1], 0.25), [25, 1]);
        assert_eq!(Resolution::of([0, 0], 0.25), [0, 0], "a window that is minimised");
    }
}
