//! Lower resolution while the view changes, if the device exceeds the time budget of a frame.

/// Ratio of consecutive scales: two steps halve the number of pixels.
const STEP: f64 = 0.840_896_415_253_714_6;
/// Number of steps to the smallest scale, a quarter of width and height.
const MOST_STEPS: u32 = 8;
/// The scale grows only if the predicted time is below this fraction of the budget, so that it does not shrink again at
/// once.
const HEADROOM: f64 = 0.8;
/// Number of consecutive fast frames before the scale grows: a third of a second at 60 frames per second.
const PATIENCE: u32 = 20;

/// The scale of frames while the view changes; still frames have full resolution.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Device time in milliseconds that a frame may take; `None` = no limit and always full resolution.
    pub budget_ms: Option<f64>,
    steps: u32,
    fast: u32,
}

impl Resolution {
    /// Starts at full resolution with a budget.
    pub fn with_budget(budget_ms: Option<f64>) -> Self {
        Self { budget_ms, ..Self::default() }
    }

    /// Factor on width and height; 1 = full resolution.
    pub fn scale(&self) -> f64 {
        if self.budget_ms.is_some() { STEP.powi(self.steps as i32) } else { 1.0 }
    }

    /// Adapts the scale to the device time `ms` of a frame at the present scale. The time is assumed to be proportional
    /// to the number of pixels, which holds for blending and is optimistic for the rest; further steps then correct it.
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

    /// Size of a frame for a window at a scale; at least one pixel, or zero for a minimised window.
    pub fn of([width, height]: [u32; 2], scale: f64) -> [u32; 2] {
        [width, height].map(|side| ((f64::from(side) * scale).round() as u32).max(side.min(1)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device that takes 1 ms plus 40 ms per full-resolution frame.
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
        // The view becomes cheap: the scale returns to 1 step by step.
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
