//! Pictures without a window: the same passes, one after another.

use std::time::Instant;

use crate::render::FrameStats;
use crate::scene::Camera;

use super::error::PlayerError;
use super::stage::Stage;

/// What a picture took.
#[derive(Clone, Debug, Default)]
pub struct FrameTime {
    /// From one picture to the next, milliseconds.
    pub ms: f64,
    /// Of it, kernel `present` on the device; `None` if the device has no clock.
    pub present_ms: Option<f64>,
    /// What the render passes did.
    pub stats: FrameStats,
}

/// Draws `frames` pictures, the cameras in turn, and makes each into pixels.
pub fn play(stage: &mut Stage, cameras: &[Camera], frames: u64) -> Result<Vec<FrameTime>, PlayerError> {
    let mut times = Vec::new();
    let turns = cameras.iter().cycle().take(frames as usize);
    for camera in turns {
        let start = Instant::now();
        let stats = stage.draw(camera)?;
        let (recorder, _) = stage.record_pixels([camera.width, camera.height], false)?;
        let ticket = recorder.submit()?;
        recorder.wait(ticket)?;
        let ms = 1e3 * start.elapsed().as_secs_f64();
        times.push(FrameTime { ms, present_ms: stage.present_ms()?, stats });
    }
    Ok(times)
}
