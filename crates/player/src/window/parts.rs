//! The parts of an open window by responsibility. [`super::Live`] holds them and coordinates what needs several.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use winit::window::Window;

use super::boxing::Boxing;
use super::editing::Editing;
use super::keeping::CameraList;
use super::leaving::Asked;
use crate::clock::FrameClock;
use crate::controls::Controls;
use crate::error::PlayerError;
use crate::navigation::Navigator;
use crate::panel_texts::PanelText;
use crate::recording::Recording;
use crate::resolution::Resolution;
use crate::scene_viewer::{PixelTimes, SceneViewer};
use crate::script::Step;
use crate::swapchain::{PresentMode, Swapchain};
use crate::ui_painter::UiPainter;
use instgs_console::opened::SceneMemory;
use instgs_io::json::write_json;
use instgs_vk::gpu::{Gpu, GpuError};
use instgs_vk::render::FrameStats;

/// Time of the panels for each step of a script: longer than their animations, and short enough for a press and a release in the
/// next frame to be a click.
const SECONDS_PER_STEP: f64 = 0.1;

/// The scene on the device, and the file it is from.
pub(super) struct Session {
    pub(super) viewer: SceneViewer,
    pub(super) gpu: Arc<Gpu>,
    /// The scene's file; names of other files are derived from it.
    pub(super) path: PathBuf,
    /// Name of the file, for the window's title.
    pub(super) title: String,
    /// Size of the scene's file, bytes.
    pub(super) file_bytes: u64,
    /// Host memory to read scenes with.
    pub(super) memory: SceneMemory,
    /// The scene's up axis, if the user gave it.
    pub(super) up: Option<glam::DVec3>,
    /// False if no scene could be read, or it was too large for the device.
    pub(super) has_scene: bool,
    /// When the device was reopened after a loss.
    pub(super) reopened: Option<Instant>,
    /// First validation message of the lost device.
    pub(super) validation_message: Option<String>,
}

impl Session {
    /// The first unused file name beside the scene with this extension.
    pub(super) fn free_name(&self, ending: &str) -> PathBuf {
        let [path] = self.free_names([ending]);
        path
    }

    /// The names beside the scene with these extensions and the first number that none of them is used with.
    pub(super) fn free_names<const N: usize>(&self, endings: [&str; N]) -> [PathBuf; N] {
        free_names(&self.path, endings)
    }

    /// The file to save to: the scene's own if that is an `.instgs`; else an unused name beside it.
    pub(super) fn save_path(&self) -> PathBuf {
        let beside = self.path.with_extension("instgs");
        if beside == self.path || !beside.exists() { beside } else { self.free_name("instgs") }
    }

    /// The first message of the validation layers, on this device or a lost one before it.
    pub(super) fn take_validation_message(&mut self) -> Option<String> {
        let of_device = self.gpu.validation_messages().take().into_iter().next();
        self.validation_message.take().or(of_device)
    }

    /// Writes the device's [`SubmissionCounts`](instgs_vk::gpu::SubmissionCounts) as JSON.
    pub(super) fn write_counts(&self, path: &Path) -> Result<(), PlayerError> {
        let counts = self.gpu.submission_counts();
        let record = serde_json::json!({
            "submissions": counts.submissions, "waits": counts.waits, "drains": counts.drains,
        });
        Ok(write_json(path, &record)?)
    }
}

/// The names beside a file with these extensions and the first number that none of them is used with.
pub(super) fn free_names<const N: usize>(beside: &Path, endings: [&str; N]) -> [PathBuf; N] {
    let mut names = (0..=u32::MAX).map(|n| endings.map(|ending| beside.with_extension(format!("{n:03}.{ending}"))));
    let free = names.find(|paths| !paths.iter().any(|path| path.exists()));
    free.unwrap_or_else(|| endings.map(|_| PathBuf::new()))
}

/// The window, its swapchain, and the overlay's input and output. Fields are dropped in order: the swapchain before the
/// window.
pub(super) struct Screen {
    pub(super) painter: UiPainter,
    pub(super) swapchain: Swapchain,
    pub(super) ui: egui_winit::State,
    pub(super) window: Arc<Window>,
    /// A present mode that was selected and is not in use yet.
    pub(super) next_mode: Option<PresentMode>,
}

impl Screen {
    /// Window pixels per interface point.
    pub(super) fn per_point(&self) -> f64 {
        f64::from(self.ui.egui_ctx().pixels_per_point())
    }

    /// Recreates the swapchain's images for the window's present size.
    pub(super) fn resize(&mut self) -> Result<(), GpuError> {
        let size = self.window.inner_size();
        self.swapchain.resize([size.width, size.height])
    }

    /// True if a position in interface points is over the overlay. An event's own flag refers to the last frame, since
    /// when the pointer may have moved.
    pub(super) fn is_over_interface(&self, [x, y]: [f64; 2]) -> bool {
        let layer = self.ui.egui_ctx().layer_id_at(egui::pos2(x as f32, y as f32));
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }
}

/// The camera, and the cameras that it can be set to.
pub(super) struct CameraState {
    pub(super) navigator: Navigator,
    /// The first camera, which the user can return to.
    pub(super) home: Navigator,
    /// Views of the data set.
    pub(super) data_views: CameraList,
    /// Cameras that the user kept.
    pub(super) kept: CameraList,
    /// The camera path that is being recorded.
    pub(super) recording: Option<Recording>,
}

/// The user's input: what is pressed and dragged, and the tools for editing and for boxes.
#[derive(Default)]
pub(super) struct Interaction {
    pub(super) controls: Controls,
    pub(super) editing: Editing,
    pub(super) boxing: Boxing,
    /// The question that was just displayed.
    pub(super) asked: Option<Asked>,
}

impl Interaction {
    /// True while something is dragged.
    pub(super) fn is_held(&self) -> bool {
        self.editing.is_held() || self.boxing.is_held()
    }
}

/// When frames are drawn and at which resolution, and what they took.
pub(super) struct Pacing {
    pub(super) clock: FrameClock,
    /// Statistics of the last complete frame.
    pub(super) stats: FrameStats,
    /// Statistics of the frames that completed with the last one.
    pub(super) arrived: Vec<FrameStats>,
    pub(super) pixel_times: PixelTimes,
    opened: Instant,
    /// When the last frame was shown, if the next one follows without a pause.
    pub(super) last_shown: Option<Instant>,
    pub(super) resolution: Resolution,
    /// When the view is redrawn at full resolution.
    pub(super) refine_at: Option<Instant>,
    /// True once that time has come: window systems differ in whether the redraw or the end of the wait is reported
    /// first.
    refine: bool,
    /// When the overlay asks to be redrawn, for instance to show a tooltip.
    pub(super) ui_at: Option<Instant>,
    /// When the work beside the picture, or the system's file dialog, is looked at again.
    pub(super) look_at: Option<Instant>,
}

impl Pacing {
    /// The state of a window that opens now; `budget_ms` as of [`Resolution::budget_ms`].
    pub(super) fn new(budget_ms: Option<f64>) -> Self {
        Self {
            clock: FrameClock::default(),
            stats: FrameStats::default(),
            arrived: Vec::new(),
            pixel_times: PixelTimes::default(),
            opened: Instant::now(),
            last_shown: None,
            resolution: Resolution::with_budget(budget_ms),
            refine_at: None,
            refine: false,
            ui_at: None,
            look_at: None,
        }
    }

    /// Seconds since the window was opened.
    pub(super) fn seconds(&self) -> f64 {
        self.opened.elapsed().as_secs_f64()
    }

    /// Seconds from the last frame to `now`; `None` after a pause.
    pub(super) fn seconds_since_last(&self, now: Instant) -> Option<f64> {
        self.last_shown.map(|then| now.duration_since(then).as_secs_f64())
    }

    /// True if a redraw is due, which is cleared even if no frame can be shown then, as in a hidden window.
    pub(super) fn take_due(&mut self, now: Instant) -> bool {
        let due = [&mut self.refine_at, &mut self.ui_at, &mut self.look_at].map(|at| at.take_if(|at| *at <= now));
        self.refine |= due[0].is_some();
        due.iter().any(Option::is_some)
    }

    /// When the next redraw is due.
    pub(super) fn wakes_at(&self) -> Option<Instant> {
        [self.refine_at, self.ui_at, self.look_at].into_iter().flatten().min()
    }

    /// True if the frame that begins at `start` is the one at full resolution after a time without motion.
    pub(super) fn take_refine(&mut self, start: Instant) -> bool {
        std::mem::take(&mut self.refine) || self.refine_at.is_some_and(|at| at <= start)
    }

    /// Records the statistics of frames that completed.
    pub(super) fn note_arrived(&mut self, arrived: Vec<FrameStats>) {
        self.arrived = arrived;
        if let Some(last) = self.arrived.last() {
            self.stats = last.clone();
        }
    }

    /// Adapts the resolution to the frames that completed last; `ms` stands for their time if the device has no
    /// timestamps. `resized` is true if the last frame has another size than those before it.
    pub(super) fn adapt_resolution(&mut self, resized: bool, ms: f64) {
        // After a resize, the frames in flight complete first, and they have the old size.
        let first = if resized { self.arrived.len().saturating_sub(1) } else { 0 };
        let of_this_size = &self.arrived[first..];
        of_this_size.iter().for_each(|stats| self.resolution.took(stats.total_ms().unwrap_or(ms)));
    }
}

/// The script that is played back.
#[derive(Default)]
pub(super) struct Playback {
    pub(super) script: VecDeque<Step>,
    /// Frames that the first step of the script has waited for.
    pub(super) waited: u32,
    /// The texts of the panels in the last frame, while a script is played.
    pub(super) texts: Vec<PanelText>,
    /// Where the widget that the script looks for was in the last frame, interface points.
    pub(super) sought: Option<egui::Pos2>,
    /// Time of the panels in seconds while a script is played.
    pub(super) seconds: f64,
    /// True while a file that was read waits for the script to go on.
    pub(super) holds_file: bool,
    /// Where the next frame is saved with the overlay.
    pub(super) screen: Option<PathBuf>,
}

impl Playback {
    /// The time of the panels' next frame, seconds. During a script it passes evenly, so that a click is one however long frames take.
    pub(super) fn time_of(&mut self, real: Option<f64>) -> Option<f64> {
        if !self.script.is_empty() {
            self.seconds += SECONDS_PER_STEP;
            return Some(self.seconds);
        }
        // It never goes back.
        real.map(|real| real.max(self.seconds))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_number_is_free_if_nothing_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let scene = at("room.instgs");
        assert_eq!(free_names(&scene, ["frames", "mp4"]), [at("room.000.frames"), at("room.000.mp4")]);
        // Of an earlier turntable only the video was kept, of the next only the frames.
        std::fs::write(at("room.000.mp4"), "x").unwrap();
        std::fs::create_dir(at("room.001.frames")).unwrap();
        assert_eq!(free_names(&scene, ["frames", "mp4"]), [at("room.002.frames"), at("room.002.mp4")]);
        assert_eq!(free_names(&scene, ["frames"]), [at("room.000.frames")]);
    }

    #[test]
    fn work_that_is_waited_for_wakes_the_window() {
        let (mut pacing, now) = (Pacing::new(None), Instant::now());
        assert!(!pacing.take_due(now) && pacing.wakes_at().is_none());
        let later = now + Duration::from_secs(1);
        (pacing.look_at, pacing.refine_at) = (Some(now), Some(later));
        assert_eq!(pacing.wakes_at(), Some(now));
        assert!(pacing.take_due(now) && !pacing.take_refine(now), "it is no reason for the full resolution");
        assert!(!pacing.take_due(now) && pacing.wakes_at() == Some(later));
    }
}
