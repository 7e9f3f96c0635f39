//! Pictures without a window: the same passes, one after another.

use std::time::Instant;

use crate::render::FrameStats;
use crate::scene::Camera;

use super::error::PlayerError;
use super::stage::{PixelTimes, Stage};

/// What a run of pictures took.
#[derive(Clone, Debug, Default)]
pub struct Timings {
    /// From one picture to the next, milliseconds, by picture.
    pub ms: Vec<f64>,
    /// Kernel `present` on the device, milliseconds; of fewer pictures, since it is known later, and empty if the device has
    /// no clock.
    pub present_ms: Vec<f64>,
    /// The interface, likewise; empty without a window.
    pub ui_ms: Vec<f64>,
    /// What the render passes did, by complete picture.
    pub stats: Vec<FrameStats>,
}

impl Timings {
    /// Notes what the pixels of a picture took.
    pub fn note(&mut self, pixels: PixelTimes) {
        self.present_ms.extend(pixels.present_ms);
        self.ui_ms.extend(pixels.ui_ms);
    }
}

/// Draws `frames` pictures, the cameras in turn, and makes each into pixels. Nobody waits for a picture but the last.
pub fn play(stage: &mut Stage, cameras: &[Camera], frames: u64) -> Result<Timings, PlayerError> {
    let mut timings = Timings::default();
    let turns = cameras.iter().cycle().take(frames as usize);
    for camera in turns {
        let start = Instant::now();
        stage.draw_ahead(camera)?;
        let (recorder, _) = stage.record_pixels([camera.width, camera.height], false)?;
        recorder.submit()?;
        timings.ms.push(1e3 * start.elapsed().as_secs_f64());
        timings.note(stage.pixel_times());
        timings.stats.extend(stage.take_arrived());
    }
    stage.settle()?;
    timings.stats.extend(stage.take_arrived());
    Ok(timings)
}
