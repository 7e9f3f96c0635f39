//! The speed of training once the number of Gaussians is final.

use super::training_clock::TrainingClock;
use instgs_train::events::Event;

/// Fraction of the steps, at the end, that is measured: by then every preset has stopped adding Gaussians, except
/// `mcmc`, which adds some until five sixths of the steps.
const LAST_PART: f64 = 0.2;

/// Steps per second of training over the last fifth of the steps of a whole log, the pace at which a longer training
/// would continue; the first steps are faster, as they have fewer Gaussians. `None` if the log is too short.
pub fn final_steps_per_second(events: &[Event]) -> Option<f64> {
    let mut clock = TrainingClock::default();
    let mut reported: Vec<(u64, f64)> = Vec::new();
    for event in events {
        let seconds = clock.at(event);
        if let Event::Step { step, .. } = event {
            reported.push((*step, seconds));
        }
    }
    let &(last_step, last_seconds) = reported.last()?;
    let from = ((1.0 - LAST_PART) * last_step as f64) as u64;
    let &(first_step, first_seconds) = reported.iter().find(|(step, _)| *step >= from)?;
    let (steps, seconds) = (last_step - first_step, last_seconds - first_seconds);
    (steps > 0 && seconds > 0.0).then(|| steps as f64 / seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(step: u64, seconds: f64) -> Event {
        let (loss, mean_loss, view_losses, l1, ssim) = (0.1, None, Vec::new(), 0.1, 0.5);
        let (psnr, gaussians, steps_per_second) = (20.0, 7, f64::NAN);
        Event::Step { step, loss, mean_loss, view_losses, l1, ssim, psnr, gaussians, steps_per_second, seconds }
    }

    /// Ten steps per second at first, two at the end; the mean over all lies between.
    #[test]
    fn the_last_fifth_counts() {
        let events = [at(10, 1.0), at(40, 4.0), at(79, 9.0), at(80, 10.0), at(90, 15.0), at(100, 20.0)];
        assert_eq!(final_steps_per_second(&events), Some(2.0));
        let with_pause = [&events[..], &[Event::OpacityReset { step: 100, to: 0.01 }]].concat();
        assert_eq!(final_steps_per_second(&with_pause), Some(2.0));
    }

    #[test]
    fn logs_that_do_not_say() {
        assert_eq!(final_steps_per_second(&[]), None);
        assert_eq!(final_steps_per_second(&[at(10, 1.0)]), None, "one report");
        assert_eq!(final_steps_per_second(&[at(10, 1.0), at(20, 1.0)]), None, "no time");
    }
}
