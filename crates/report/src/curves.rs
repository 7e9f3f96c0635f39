//! Curves over steps or training time, from the log of a run.

use super::training_clock::TrainingClock;
use instgs_train::events::Event;

/// A curve: (steps done or seconds, value), in the order of the log.
pub(super) type Points = Vec<(f64, f64)>;

/// The horizontal axis of a curve.
#[derive(Clone, Copy)]
pub(super) enum Over {
    /// Number of finished steps.
    Steps,
    /// Training time, seconds; the log begins at this time.
    Time(f64),
}

/// The curves of a run, read from its log.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Curves {
    /// Mean loss since the last report; in old logs the loss of one view.
    pub(super) loss: Points,
    pub(super) train_psnr: Points,
    pub(super) test_psnr: Points,
    pub(super) gaussians: Points,
    pub(super) steps_per_second: Points,
    /// Steps or times at which opacities were reset.
    pub(super) resets: Vec<f64>,
}

impl Curves {
    pub(super) fn of(events: &[Event], over: Over) -> Self {
        let (mut curves, mut clock) = (Self::default(), TrainingClock::default());
        for event in events {
            let seconds = clock.at(event);
            let at = match over {
                Over::Steps => event.step() as f64,
                Over::Time(first) => first + seconds,
            };
            match event {
                Event::Step { loss, mean_loss, psnr, gaussians, steps_per_second, .. } => {
                    curves.loss.push((at, mean_loss.unwrap_or(*loss)));
                    curves.train_psnr.push((at, *psnr));
                    curves.gaussians.push((at, *gaussians as f64));
                    curves.steps_per_second.push((at, *steps_per_second));
                }
                Event::Started { gaussians, .. } | Event::Densified { gaussians, .. } => {
                    curves.gaussians.push((at, *gaussians as f64));
                }
                Event::Evaluated { psnr, .. } => curves.test_psnr.push((at, *psnr)),
                Event::OpacityReset { .. } => curves.resets.push(at),
                _ => {}
            }
        }
        curves
    }
}

/// At most `most` points, each the mean of equally many neighbours. Non-finite values are ignored.
pub(super) fn thinned(points: &[(f64, f64)], most: usize) -> Points {
    let finite: Points = points.iter().copied().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
    let run = finite.len().div_ceil(most.max(1)).max(1);
    finite.chunks(run).map(mean).collect()
}

/// The mean over `window` neighbours around each point, fewer at the ends.
pub(super) fn smoothed(points: &[(f64, f64)], window: usize) -> Points {
    let half = window / 2;
    let around = |i: usize| &points[i.saturating_sub(half)..(i + half + 1).min(points.len())];
    (0..points.len()).map(|i| (points[i].0, mean(around(i)).1)).collect()
}

fn mean(points: &[(f64, f64)]) -> (f64, f64) {
    let n = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
    (x / n, y / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_means_and_leaves_out_what_is_no_number() {
        let points = [(1.0, 2.0), (2.0, f64::NAN), (3.0, 4.0), (4.0, 6.0), (5.0, f64::INFINITY), (6.0, 10.0)];
        assert_eq!(thinned(&points, 2), [(2.0, 3.0), (5.0, 8.0)]);
        assert_eq!(thinned(&points, 100).len(), 4);
        assert!(thinned(&[], 3).is_empty());
    }

    #[test]
    fn smoothing_by_hand() {
        let points = [(1.0, 0.0), (2.0, 3.0), (3.0, 6.0), (4.0, 0.0)];
        assert_eq!(smoothed(&points, 3), [(1.0, 1.5), (2.0, 3.0), (3.0, 3.0), (4.0, 3.0)]);
        assert_eq!(smoothed(&points, 1), points);
    }

    #[test]
    fn curves_are_made_of_their_events() {
        let events = [
            Event::ShDegree { step: 1, degree: 1 },
            Event::OpacityReset { step: 2, to: 0.01 },
            Event::Densified { step: 3, cloned: 1, split: 0, pruned: 0, own: 0, relocated: 0, gaussians: 9 },
            Event::Evaluated { step: 4, views: 1, psnr: 20.0, ssim: 0.5, lpips: None },
        ];
        let curves = Curves::of(&events, Over::Steps);
        assert_eq!(
            (curves.resets, curves.gaussians, curves.test_psnr),
            (vec![2.0], vec![(3.0, 9.0)], vec![(4.0, 20.0)])
        );
        assert!(curves.loss.is_empty());
    }
}
