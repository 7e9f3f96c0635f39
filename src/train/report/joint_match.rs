//! How long the joint phase of an instanced run takes to be as good on the training views as the plain cloud was.

use serde::{Deserialize, Serialize};

use super::training_clock::TrainingClock;
use crate::train::events::{Event, null_is_nan};

/// A mean is over at least so many steps, however few the views are.
const FEWEST_STEPS: u64 = 50;

/// When the training loss of the joint phase came down to the plain cloud's final one.
///
/// The loss of a step is that of one view, and views differ more than the phases do. So it is measured on running means
/// over the steps before, as many as make whole passes through the training views and at least 50 steps, the same number
/// in both phases. `loss` is the plain cloud's mean over its last steps. The match is at the first reported step of the
/// joint phase whose mean is not above it; as the mean looks back, that is never earlier than the steps it is made of, and
/// at most as many too late. Reports come every few steps, and a mean takes whole reports.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct JointMatch {
    /// Training time of the joint phase until then, without segmentation, merging, evaluations and checkpoints.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
    /// The same per training time of the plain cloud.
    #[serde(deserialize_with = "null_is_nan")]
    pub fraction_of_vanilla: f64,
    /// The plain cloud's final loss.
    #[serde(deserialize_with = "null_is_nan")]
    pub loss: f64,
}

impl JointMatch {
    /// From the logs of the two phases and the number of training views. `None` if the joint phase did not get there, or
    /// if a log is too short to say.
    pub fn of(vanilla: &[Event], joint: &[Event], train_views: u64) -> Option<Self> {
        let loss = final_loss(vanilla, train_views)?;
        let seconds = running_means(joint, train_views).into_iter().find(|(_, mean)| *mean <= loss)?.0;
        let vanilla_seconds = TrainingClock::total(vanilla);
        (vanilla_seconds > 0.0).then(|| Self { seconds, fraction_of_vanilla: seconds / vanilla_seconds, loss })
    }
}

/// The running mean at the end of a log, if it is long enough and a number.
pub(super) fn final_loss(events: &[Event], train_views: u64) -> Option<f64> {
    running_means(events, train_views).last().map(|(_, mean)| *mean).filter(|mean| mean.is_finite())
}

/// Steps of a mean.
fn window(train_views: u64) -> u64 {
    let views = train_views.max(1);
    FEWEST_STEPS.div_ceil(views).saturating_mul(views)
}

/// (training time, mean loss of the steps before) at each reported step that has enough steps before it.
fn running_means(events: &[Event], train_views: u64) -> Vec<(f64, f64)> {
    let (window, reports) = (window(train_views), reports(events));
    let mean_at = |last: usize| {
        let (mut steps, mut sum) = (0, 0.0);
        for report in reports[..=last].iter().rev() {
            (steps, sum) = (steps + report.steps, sum + report.steps as f64 * report.loss);
            if steps >= window {
                return Some((reports[last].seconds, sum / steps as f64));
            }
        }
        None
    };
    (0..reports.len()).filter_map(mean_at).collect()
}

/// What the log says about a stretch of steps.
struct Report {
    steps: u64,
    loss: f64,
    seconds: f64,
}

fn reports(events: &[Event]) -> Vec<Report> {
    let (mut clock, mut done, mut out) = (TrainingClock::default(), 0, Vec::new());
    for event in events {
        let seconds = clock.at(event);
        let Event::Step { step, loss, mean_loss, .. } = event else { continue };
        if *step > done {
            out.push(Report { steps: step - done, loss: mean_loss.unwrap_or(*loss), seconds });
            done = *step;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log with a report every 10 steps and 5 seconds.
    fn log(losses: &[f64]) -> Vec<Event> {
        let event = |(i, loss): (usize, &f64)| {
            let (step, seconds) = (10 * (i as u64 + 1), 5.0 * (i as f64 + 1.0));
            let (l1, ssim, psnr, gaussians, steps_per_second) = (0.1, 0.5, 20.0, 7, 2.0);
            // The loss of the step's own view is far off, as it may be.
            let (loss, mean_loss) = (9.0 * loss, Some(*loss));
            Event::Step { step, loss, mean_loss, l1, ssim, psnr, gaussians, steps_per_second, seconds }
        };
        losses.iter().enumerate().map(event).collect()
    }

    #[test]
    fn windows_are_whole_passes() {
        assert_eq!([0, 1, 8, 43, 50, 51, 300].map(window), [50, 50, 56, 86, 50, 51, 300]);
    }

    /// With 25 views a mean is over 50 steps, 5 reports.
    #[test]
    fn the_match_by_hand() {
        let plain = log(&[9.0, 9.0, 5.0, 4.0, 3.0, 2.0, 1.0]);
        assert_eq!(final_loss(&plain, 25), Some(3.0));
        // Means from the fifth on: 5.2, 4.2, 3.2, 2.2. A single report below 3 is not enough.
        let joint = log(&[6.0, 6.0, 6.0, 6.0, 2.0, 1.0, 1.0, 1.0, 1.0]);
        let found = JointMatch::of(&plain, &joint, 25);
        assert_eq!(found, Some(JointMatch { seconds: 40.0, fraction_of_vanilla: 40.0 / 35.0, loss: 3.0 }));
        assert_eq!(JointMatch::of(&plain, &joint[..7], 25), None);
        assert_eq!(JointMatch::of(&plain, &log(&[3.0; 5]), 25).map(|m| m.seconds), Some(25.0));
    }

    #[test]
    fn logs_that_do_not_say() {
        let (plain, joint) = (log(&[3.0; 5]), log(&[1.0; 5]));
        assert!(JointMatch::of(&plain, &joint, 25).is_some());
        assert!(JointMatch::of(&[], &joint, 25).is_none() && JointMatch::of(&plain, &[], 25).is_none());
        assert!(JointMatch::of(&plain[..4], &joint, 25).is_none(), "too short");
        assert!(JointMatch::of(&plain, &joint, 51).is_none(), "too short for a pass");
        assert!(JointMatch::of(&log(&[f64::NAN; 5]), &joint, 25).is_none());
        // A mean with a loss that is no number says nothing; later ones do.
        let joint = log(&[1.0, f64::NAN, 1.0, 1.0, 1.0, 1.0, 1.0]);
        assert_eq!(JointMatch::of(&plain, &joint, 25).map(|m| m.seconds), Some(35.0));
    }

    #[test]
    fn older_logs_have_the_loss_of_one_view() {
        let old = |loss| -> Vec<Event> {
            let mut events = log(&[loss; 5]);
            for event in &mut events {
                if let Event::Step { mean_loss, .. } = event {
                    *mean_loss = None;
                }
            }
            events
        };
        assert_eq!(final_loss(&old(2.0), 25), Some(18.0));
    }
}
