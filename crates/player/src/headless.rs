//! Pictures without a window: the same passes, one after another.

use std::time::Instant;

use instgs_vk::render::FrameStats;
use instgs_vk::scene::Camera;

use super::error::PlayerError;
use super::stage::{PixelTimes, Stage};

/// What a run of pictures took.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    /// From one picture's arrival to the next one's, milliseconds, by picture; those that are known to have arrived together
    /// share the time.
    pub ms: Vec<f64>,
    /// When the last of these arrived, or the first picture was begun.
    since: Option<Instant>,
    /// Pictures that were submitted.
    submitted: usize,
    /// Kernel `present` on the device, milliseconds; of fewer pictures, since it is known later, and empty if the device has
    /// no clock.
    pub present_ms: Vec<f64>,
    /// The interface, likewise; empty without a window.
    pub ui_ms: Vec<f64>,
    /// What the render passes did, by complete picture.
    pub stats: Vec<FrameStats>,
}

impl Timings {
    /// The clock starts with the first call, before the first picture.
    pub fn begin(&mut self) {
        self.since.get_or_insert_with(Instant::now);
    }

    /// Another picture was submitted, and `in_flight` are on their way with it.
    pub fn submitted(&mut self, in_flight: usize) {
        self.submitted += 1;
        self.arrived(in_flight);
    }

    /// Of all that were submitted `in_flight` are still on their way.
    pub fn arrived(&mut self, in_flight: usize) {
        let Some(since) = self.since else { return };
        let count = self.submitted.saturating_sub(in_flight + self.ms.len());
        if count > 0 {
            let ms = 1e3 * since.elapsed().as_secs_f64() / count as f64;
            self.ms.extend(std::iter::repeat_n(ms, count));
            self.since = Some(Instant::now());
        }
    }

    /// Pictures that were submitted.
    pub fn submitted_len(&self) -> usize {
        self.submitted
    }

    /// Notes what the pixels of a picture took.
    pub fn note(&mut self, pixels: PixelTimes) {
        self.present_ms.extend(pixels.present_ms);
        self.ui_ms.extend(pixels.ui_ms);
    }
}

/// Draws `frames` pictures, the cameras in turn, and makes each into pixels. Nobody waits for a picture but the last.
pub fn play(stage: &mut Stage, cameras: &[Camera], frames: u64) -> Result<Timings, PlayerError> {
    let mut timings = Timings::default();
    timings.begin();
    let turns = cameras.iter().cycle().take(frames as usize);
    for camera in turns {
        stage.draw_ahead(camera)?;
        let (recorder, _) = stage.record_pixels([camera.width, camera.height], false)?;
        recorder.submit()?;
        timings.submitted(stage.in_flight());
        timings.note(stage.pixel_times());
        timings.stats.extend(stage.take_arrived());
    }
    stage.settle()?;
    timings.arrived(stage.in_flight());
    timings.stats.extend(stage.take_arrived());
    Ok(timings)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Two pictures in flight, of 20 ms each on the device: few pictures are not faster than many.
    #[test]
    fn pictures_count_when_they_arrive() {
        for frames in 1..6_usize {
            let mut timings = Timings::default();
            timings.begin();
            for k in 0..frames {
                if k >= 2 {
                    std::thread::sleep(Duration::from_millis(20));
                }
                timings.submitted((k + 1).min(2));
            }
            std::thread::sleep(Duration::from_millis(20 * frames.min(2) as u64));
            timings.arrived(0);
            assert_eq!((timings.ms.len(), timings.submitted_len()), (frames, frames));
            // A sleep is never shorter than asked for.
            assert!(timings.ms.iter().all(|ms| *ms >= 20.0), "{frames}: {:?}", timings.ms);
        }
    }
}
