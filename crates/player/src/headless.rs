//! Rendering without a window: the same passes, one frame after another.

use std::time::Instant;

use instgs_vk::render::FrameStats;
use instgs_vk::scene::Camera;

use super::error::PlayerError;
use super::scene_viewer::{PixelTimes, SceneViewer};

/// Times and statistics of a run of frames.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    /// Milliseconds from the completion of one frame to that of the next; frames that were seen to complete together
    /// share the time equally.
    pub ms: Vec<f64>,
    /// When the last of these frames completed, or when the first was begun.
    since: Option<Instant>,
    /// Number of frames submitted.
    submitted: usize,
    /// Device time of kernel `present` in milliseconds. It is known later, so that there are fewer entries than frames,
    /// and none if the device has no timestamps.
    pub present_ms: Vec<f64>,
    /// Device time of the interface in milliseconds, with the same gaps; empty without a window.
    pub ui_ms: Vec<f64>,
    /// Statistics of the render passes, one entry per complete frame.
    pub stats: Vec<FrameStats>,
}

impl Timings {
    /// Starts the clock at the first call, before the first frame.
    pub fn begin(&mut self) {
        self.since.get_or_insert_with(Instant::now);
    }

    /// Records a submission; `in_flight` frames are now in flight, including the new one.
    pub fn submitted(&mut self, in_flight: usize) {
        self.submitted += 1;
        self.arrived(in_flight);
    }

    /// Records the completion of all submitted frames except the `in_flight` last ones.
    pub fn arrived(&mut self, in_flight: usize) {
        let Some(since) = self.since else { return };
        let count = self.submitted.saturating_sub(in_flight + self.ms.len());
        if count > 0 {
            let ms = 1e3 * since.elapsed().as_secs_f64() / count as f64;
            self.ms.extend(std::iter::repeat_n(ms, count));
            self.since = Some(Instant::now());
        }
    }

    /// Number of frames submitted.
    pub fn submitted_len(&self) -> usize {
        self.submitted
    }

    /// Records the device times of the kernels that make pixels.
    pub fn note(&mut self, pixels: PixelTimes) {
        self.present_ms.extend(pixels.present_ms);
        self.ui_ms.extend(pixels.ui_ms);
    }
}

/// Draws `frames` frames through the cameras in turn and converts each to pixels. Waits only for the last frame.
pub fn play(viewer: &mut SceneViewer, cameras: &[Camera], frames: u64) -> Result<Timings, PlayerError> {
    let mut timings = Timings::default();
    timings.begin();
    let turns = cameras.iter().cycle().take(frames as usize);
    for camera in turns {
        viewer.draw_ahead(camera)?;
        let (recorder, _) = viewer.record_pixels([camera.width, camera.height], false)?;
        recorder.submit()?;
        timings.submitted(viewer.in_flight());
        timings.note(viewer.pixel_times());
        timings.stats.extend(viewer.take_arrived());
    }
    viewer.settle()?;
    timings.arrived(viewer.in_flight());
    timings.stats.extend(viewer.take_arrived());
    Ok(timings)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Two frames in flight, each 20 ms on the device: the time per frame does not depend on their number.
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
            // A sleep is never shorter than requested.
            assert!(timings.ms.iter().all(|ms| *ms >= 20.0), "{frames}: {:?}", timings.ms);
        }
    }
}
