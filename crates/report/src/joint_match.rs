//! The time that the joint phase of an instanced run needs to reach the plain cloud's loss on the training views.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::training_clock::{TrainingClock, training_seconds};
use instgs_io::json::null_is_nan;
use instgs_train::events::Event;

/// Length of the window of steps whose mean loss is compared; it stands for the step in the middle. The loss of one
/// view varies by a few percent from one use to the next, which is as much as the joint phase gains in ten steps when
/// it comes near.
const STEPS: usize = 30;

/// The time at which the training loss of the joint phase reached the plain cloud's final loss.
///
/// The loss of a step is that of one view, and views differ more than the phases do. So each step is compared with the
/// plain cloud's last loss of the same view: the match is in the middle of the first 30 steps of the joint phase whose
/// mean loss is not above the mean of those.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct JointMatch {
    /// Training time of the joint phase until then, seconds, without preparation, evaluations and checkpoints.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
    /// The same time as a fraction of the plain cloud's training time.
    #[serde(deserialize_with = "null_is_nan")]
    pub fraction_of_vanilla: f64,
    /// The plain cloud's final loss, mean over the views.
    #[serde(deserialize_with = "null_is_nan")]
    pub loss: f64,
}

impl JointMatch {
    /// Compares the logs of the two phases; `train_views` is the number of training views. `None` if the joint phase
    /// did not reach the loss, or if a log is too short or of a version that did not write the losses of views.
    pub fn of(vanilla: &[Event], joint: &[Event], train_views: u64) -> Option<Self> {
        let loss = final_loss(vanilla, train_views)?;
        let seconds = match_seconds(&last_losses(vanilla), joint)?;
        let vanilla_seconds = training_seconds(vanilla);
        (vanilla_seconds > 0.0).then(|| Self { seconds, fraction_of_vanilla: seconds / vanilla_seconds, loss })
    }
}

/// True if the logs suffice to see whether the joint phase reached the plain cloud's loss.
pub(super) fn is_measured(vanilla: &[Event], joint: &[Event]) -> bool {
    training_seconds(vanilla) > 0.0 && excesses(&last_losses(vanilla), joint).len() >= STEPS
}

/// Mean over the training views of the last loss of each, if the log has all of them.
pub(super) fn final_loss(events: &[Event], train_views: u64) -> Option<f64> {
    let last = last_losses(events);
    (train_views > 0 && last.len() as u64 == train_views).then(|| last.values().sum::<f64>() / last.len() as f64)
}

/// The last loss of each training view, by its index.
fn last_losses(events: &[Event]) -> BTreeMap<u32, f64> {
    let of_event = |event: &Event| match event {
        Event::Step { view_losses, .. } => view_losses.clone(),
        _ => Vec::new(),
    };
    events.iter().flat_map(of_event).map(|(view, loss)| (view, f64::from(loss))).collect()
}

/// Training time in the middle of the first window of steps that is not worse than the views' losses `then`.
fn match_seconds(then: &BTreeMap<u32, f64>, joint: &[Event]) -> Option<f64> {
    let steps = excesses(then, joint);
    let first = steps.windows(STEPS).find(|window| window.iter().map(|(_, excess)| excess).sum::<f64>() <= 0.0)?;
    Some(first[STEPS / 2 - 1].0)
}

/// For each step: training time at its end, and its loss minus its view's `then`. Steps of a report are equally long.
fn excesses(then: &BTreeMap<u32, f64>, joint: &[Event]) -> Vec<(f64, f64)> {
    let mut clock = TrainingClock::default();
    let mut steps = Vec::new();
    let mut before = 0.0;
    for event in joint {
        let seconds = clock.at(event);
        if let Event::Step { view_losses, .. } = event {
            for (i, (view, now)) in view_losses.iter().enumerate() {
                let at = before + (seconds - before) * (i + 1) as f64 / view_losses.len() as f64;
                steps.extend(then.get(view).map(|then| (at, f64::from(*now) - then)));
            }
        }
        before = seconds;
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log with a report every 10 steps and 5 seconds. `losses` are the losses of view 0, one per report; each of the
    /// four views has 8 more than the previous one.
    fn log(losses: &[f64]) -> Vec<Event> {
        let event = |(i, mean): (usize, &f64)| {
            let (step, seconds) = (10 * (i as u64 + 1), 5.0 * (i as f64 + 1.0));
            let (l1, ssim, psnr, gaussians, steps_per_second) = (0.1, 0.5, 20.0, 7, 2.0);
            let of_view = |view: u64| (view as u32, (mean + 8.0 * view as f64) as f32);
            let view_losses = (step - 10..step).map(|s| of_view(s % 4)).collect();
            let (loss, mean_loss) = (9.0 * mean, Some(*mean));
            Event::Step { step, loss, mean_loss, view_losses, l1, ssim, psnr, gaussians, steps_per_second, seconds }
        };
        losses.iter().enumerate().map(event).collect()
    }

    #[test]
    fn the_match_by_hand() {
        let plain = log(&[9.0, 9.0, 5.0, 4.0, 3.0, 2.0, 1.0]);
        assert_eq!(final_loss(&plain, 4), Some(13.0));
        // One report below is not enough: the fourth to the sixth are the first three whose mean, 1, is not higher.
        let joint = log(&[6.0, 6.0, 2.0, 3.0, 2.0, -2.0, 1.0, 1.0]);
        let found = JointMatch::of(&plain, &joint, 4);
        assert_eq!(found, Some(JointMatch { seconds: 22.5, fraction_of_vanilla: 22.5 / 35.0, loss: 13.0 }));
        assert_eq!(JointMatch::of(&plain, &joint[..5], 4), None);
        assert_eq!(JointMatch::of(&plain, &log(&[1.0; 5]), 4).map(|m| m.seconds), Some(7.5));
        assert_eq!(JointMatch::of(&plain, &log(&[1.01; 50]), 4), None);
    }

    #[test]
    fn logs_that_do_not_say() {
        let (plain, joint) = (log(&[3.0; 5]), log(&[1.0; 5]));
        assert!(JointMatch::of(&plain, &joint, 4).is_some());
        assert!(JointMatch::of(&[], &joint, 4).is_none() && JointMatch::of(&plain, &[], 4).is_none());
        assert!(JointMatch::of(&plain, &joint, 5).is_none(), "a view was never looked at");
        assert!(JointMatch::of(&plain, &joint[..2], 4).is_none(), "too short");
        assert!(is_measured(&plain, &joint) && is_measured(&plain, &log(&[9.0; 3])));
        assert!(!is_measured(&plain, &joint[..2]) && !is_measured(&[], &joint) && !is_measured(&plain, &[]));
        // Steps without a finite loss are missing from the log; the others are still compared.
        let mut holes = log(&[9.0, 1.0, 1.0, 1.0, 1.0]);
        for event in &mut holes[..2] {
            if let Event::Step { view_losses, .. } = event {
                view_losses.clear();
            }
        }
        assert_eq!(JointMatch::of(&plain, &holes, 4).map(|m| m.seconds), Some(17.5));
    }

    #[test]
    fn older_logs_say_nothing() {
        let mut old = log(&[2.0; 5]);
        for event in &mut old {
            if let Event::Step { view_losses, .. } = event {
                view_losses.clear();
            }
        }
        assert_eq!((final_loss(&old, 4), JointMatch::of(&old, &log(&[1.0; 5]), 4)), (None, None));
    }
}
