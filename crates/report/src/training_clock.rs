//! Measures the training time at each event of a log.

use instgs_train::events::Event;

/// Adds up the times since each start of a run, each without evaluations and checkpoints.
#[derive(Debug, Default)]
pub(super) struct TrainingClock {
    /// Training time before the run was last resumed, seconds.
    before: f64,
    now: f64,
}

impl TrainingClock {
    /// Training time at `event`, seconds, or that of the event before; to be called with every event, in order.
    pub(super) fn at(&mut self, event: &Event) -> f64 {
        match event {
            Event::Started { .. } => self.before = self.now,
            Event::Step { seconds, .. } | Event::Finished { seconds, .. } if seconds.is_finite() => {
                self.now = self.now.max(self.before + seconds);
            }
            _ => {}
        }
        self.now
    }
}

/// Training time of a whole log, resumptions included: seconds without evaluations and checkpoints.
pub fn training_seconds(events: &[Event]) -> f64 {
    let mut clock = TrainingClock::default();
    events.iter().fold(0.0, |_, event| clock.at(event))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_resumed_run_add_up() {
        let started = |step| Event::Started {
            step,
            steps: 9,
            resumed: step > 0,
            method: "3dgs".into(),
            device: String::new(),
            gaussians: 1,
            views: 1,
            test_views: 0,
        };
        let finished = |seconds| Event::Finished { step: 5, interrupted: true, gaussians: 1, seconds };
        let events = [started(0), finished(4.0), started(5), finished(f64::NAN), finished(2.5)];
        let mut clock = TrainingClock::default();
        assert_eq!(events.each_ref().map(|event| clock.at(event)), [0.0, 4.0, 4.0, 4.0, 6.5]);
        assert_eq!((training_seconds(&events), training_seconds(&[])), (6.5, 0.0));
    }
}
