//! The window: handles winit's events and draws frames. Frames are drawn only while something changes.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::WindowId;

use crate::swapchain::{Pixels, PresentMode, Target};
use crate::ui_painter::UiFrame;
use instgs_console::opened::{OpenedScene, SceneMemory};
use instgs_vk::gpu::DeviceChoice;
use instgs_vk::scene::{Boxes, Camera, NearPlane, PixelFilterChoice};

use super::error::PlayerError;
use super::headless::Timings;
use super::hud::{Facts, Hud, Settings, ground};
use super::hud_gizmo::{paint_brush, paint_gizmo};
use super::panel_texts::texts_of;
use super::remembered::{Recent, Remembered};
use super::resolution::Resolution;
use super::scene_viewer::ViewerOptions;
use super::script::Step;
use super::texts;

mod boxing;
mod editing;
mod input;
mod keeping;
mod key_steps;
mod leaving;
mod opening;
mod parts;
mod playing;
mod split;
mod work;

use parts::{CameraState, Interaction, Pacing, Playback, Screen, Session};

/// The camera flies at most this long per frame: a longer interval means a hidden window or a busy device.
const LONGEST_FLIGHT_SECONDS: f64 = 0.25;
/// A still view is redrawn at full resolution after this delay.
const REFINE_AFTER: Duration = Duration::from_millis(150);
/// Work on threads is looked at so often.
const LOOK_AGAIN: Duration = Duration::from_millis(50);
/// A device that is lost again within this time is not reopened.
const LOST_FOR_GOOD: Duration = Duration::from_secs(10);

/// What the window opens, and how.
pub struct WindowJob {
    /// Path of the scene's file.
    pub path: PathBuf,
    /// The scene; `None` to read `path` beside the first frames.
    pub scene: Option<OpenedScene>,
    /// How frames are rendered. What depends on the scene, its near plane, its pixel filter and the range of depths, is set when it
    /// is there.
    pub options: ViewerOptions,
    /// What the user asks of the pixel filter; the rest is each scene's own.
    pub pixel_filter: PixelFilterChoice,
    /// The near plane, if it is not to be each scene's own.
    pub near_plane: Option<NearPlane>,
    /// Views of a data set to step through; the first is the start camera. May be empty.
    pub cameras: Vec<Camera>,
    /// The scene's up axis, if the user gives it.
    pub up: Option<glam::DVec3>,
    /// Width and height of the window, pixels.
    pub size_px: (u32, u32),
    /// The requested present mode.
    pub mode: PresentMode,
    /// The Vulkan device to open.
    pub device: DeviceChoice,
    /// Device memory to draw with, bytes, the scene included; `u64::MAX` = what the device has.
    pub memory_budget_bytes: u64,
    /// Host memory to read scenes with.
    pub memory: SceneMemory,
    /// True to enable the validation layers.
    pub validation: bool,
    /// Number of frames to draw without a pause through `path_cameras`, after which the window closes; `None` = the
    /// user closes it.
    pub frames: Option<u64>,
    /// Cameras of these frames, used in turn.
    pub path_cameras: Vec<Camera>,
    /// File for the last frame, as PNG.
    pub screenshot: Option<PathBuf>,
    /// Input to play back, one step per frame, before the user takes over.
    pub script: VecDeque<Step>,
    /// Device time in milliseconds that a frame may take while the view changes; above it the resolution is lowered.
    pub budget_ms: Option<f64>,
    /// Boxes around objects and their file; the tool for boxes is active at once.
    pub boxes: Option<(PathBuf, Boxes)>,
}

/// What the window did, for reports.
#[derive(Default)]
pub struct WindowReport {
    /// Times of the frames, if their number was given.
    pub timings: Timings,
    /// Name of the Vulkan device.
    pub device: String,
    /// Width and height of the last frame, pixels.
    pub size_px: [u32; 2],
    /// Bytes of the scene that are in host memory, where kernels read what is in view.
    pub scene_on_host_bytes: u64,
    /// First message of the validation layers.
    pub validation_message: Option<String>,
}

/// Opens the window and returns when it is closed.
///
/// # Errors
/// No display, no device that can present to its windows, or a failure while drawing.
pub fn run(job: WindowJob) -> Result<WindowReport, PlayerError> {
    let event_loop = EventLoop::new().map_err(window_error)?;
    event_loop.set_control_flow(ControlFlow::Wait);
    let mut player = Player { job, live: None, outcome: Ok(WindowReport::default()) };
    event_loop.run_app(&mut player).map_err(window_error)?;
    // Device objects are destroyed before the event loop's display.
    player.live = None;
    player.outcome
}

fn window_error(error: impl std::fmt::Display) -> PlayerError {
    PlayerError::Window(error.to_string())
}

struct Player {
    job: WindowJob,
    live: Option<Live>,
    outcome: Result<WindowReport, PlayerError>,
}

/// Everything that exists while the window does. Parts are dropped in order: the scene on the device before the window.
struct Live {
    /// The scene as it was opened, beside the present one.
    split: Option<split::Split>,
    session: Session,
    screen: Screen,
    hud: Hud,
    camera: CameraState,
    input: Interaction,
    pacing: Pacing,
    playback: Playback,
    /// The work that runs beside the picture.
    work: Option<work::Work>,
    recent: Recent,
    remembered: Remembered,
}

impl ApplicationHandler for Player {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.live.is_some() {
            return;
        }
        match Live::open(event_loop, &mut self.job) {
            Ok(live) => {
                live.screen.window.request_redraw();
                self.live = Some(live);
            }
            Err(error) => self.end(event_loop, Err(error)),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(live)) = (cause, &self.live) {
            live.screen.window.request_redraw();
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let wakes_at = self.live.as_mut().and_then(|live| {
            if live.pacing.take_due(Instant::now()) {
                live.screen.window.request_redraw();
            }
            live.pacing.wakes_at().into_iter().chain(live.input.boxing.wakes_at()).min()
        });
        event_loop.set_control_flow(wakes_at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(live) = &mut self.live else { return };
        let after = match event {
            WindowEvent::CloseRequested => Ok(live.close()),
            WindowEvent::RedrawRequested => self.redraw(),
            event => live.event(&event),
        };
        match after {
            Ok(After::Nothing) => {}
            Ok(After::Redraw) => self.request_redraw(),
            Ok(After::Quit) => self.end(event_loop, Ok(())),
            Err(error) => self.failed(event_loop, error),
        }
    }
}

/// The window's reaction to an event.
enum After {
    Nothing,
    Redraw,
    Quit,
}

impl Player {
    fn request_redraw(&self) {
        if let Some(live) = &self.live {
            live.screen.window.request_redraw();
        }
    }

    fn redraw(&mut self) -> Result<After, PlayerError> {
        let Some(live) = &mut self.live else { return Ok(After::Nothing) };
        let done = self.outcome.as_ref().map_or(0, |report| report.timings.submitted_len() as u64);
        if self.job.frames.is_some() && !self.job.path_cameras.is_empty() {
            let cameras = &self.job.path_cameras;
            live.camera.navigator.stand_at(&cameras[(done % cameras.len() as u64) as usize]);
        }
        if let After::Quit = live.play_step()? {
            return Ok(After::Quit);
        }
        if let Ok(report) = &mut self.outcome {
            report.timings.begin();
        }
        let works = live.go_on_working(&self.job)?;
        let waits = live.work.is_some() || live.hud.files.waits();
        live.pacing.look_at = waits.then(|| Instant::now() + LOOK_AGAIN);
        let shown = live.picture(works || self.job.frames.is_some() || !live.playback.script.is_empty())?;
        if works && !shown {
            // A minimised window shows nothing that the next frame for a file could follow.
            live.pacing.look_at = Some(Instant::now());
        }
        let Some(frames) = self.job.frames else { return Ok(After::Nothing) };
        if let (true, Ok(report)) = (shown, &mut self.outcome) {
            report.timings.submitted(live.session.viewer.in_flight());
            report.timings.note(live.pacing.pixel_times);
            report.timings.stats.append(&mut live.pacing.arrived);
        }
        Ok(if done + u64::from(shown) >= frames { After::Quit } else { After::Nothing })
    }

    /// After the loss of the device, continues on a reopened one. Ends on any other error, and if the device is lost
    /// again soon. Unsaved work is written first.
    fn failed(&mut self, event_loop: &ActiveEventLoop, error: PlayerError) {
        let Some(live) = self.live.take() else { return self.end(event_loop, Err(error)) };
        let (files, errors) = live.rescue();
        let again = error.is_lost() && live.session.reopened.is_none_or(|then| then.elapsed() > LOST_FOR_GOOD);
        let reopened = if again { live.reopen(&self.job, &error) } else { Err(error) };
        match reopened {
            Ok(live) => {
                // Nothing was lost.
                files.iter().for_each(|path| drop(std::fs::remove_file(path)));
                self.live = Some(live);
                self.request_redraw();
            }
            Err(reason) if files.is_empty() && errors.is_empty() => self.end(event_loop, Err(reason)),
            Err(reason) => {
                let files = files.iter().map(|path| path.display().to_string()).chain(errors);
                let files = files.collect::<Vec<_>>().join(", ");
                self.end(event_loop, Err(PlayerError::Rescued { reason: Box::new(reason), files }));
            }
        }
    }

    /// Records the outcome and leaves the event loop.
    fn end(&mut self, event_loop: &ActiveEventLoop, result: Result<(), PlayerError>) {
        event_loop.exit();
        let closing = result.and_then(|()| self.closing());
        if let Err(error) = closing {
            self.outcome = Err(error);
        }
    }

    fn closing(&mut self) -> Result<(), PlayerError> {
        let (Some(live), Ok(report)) = (&mut self.live, &mut self.outcome) else { return Ok(()) };
        // A file that could not be written is told only after all else has ended.
        let written = live.wait_for_writing();
        report.device = live.session.gpu.caps().name.clone();
        report.size_px = live.screen.swapchain.size_px();
        report.scene_on_host_bytes = live.session.viewer.scene_on_host_bytes();
        live.session.viewer.settle()?;
        report.timings.arrived(live.session.viewer.in_flight());
        report.timings.stats.extend(live.session.viewer.take_arrived());
        if let Some(path) = &self.job.screenshot {
            live.session.viewer.screenshot(path)?;
        }
        live.session.gpu.wait_all()?;
        report.validation_message = live.session.take_validation_message();
        written
    }
}

impl Live {
    /// Draws and presents a frame; false if there is no image to draw to. `goes_on` means that another frame follows at
    /// once.
    fn picture(&mut self, goes_on: bool) -> Result<bool, PlayerError> {
        let start = Instant::now();
        let Some(target) = self.acquire()? else { return Ok(false) };
        let since = self.pacing.seconds_since_last(start);
        let flight = self.input.controls.flight();
        self.camera.navigator.fly(flight, since.unwrap_or(0.0).min(LONGEST_FLIGHT_SECONDS));
        self.follow_grip()?;
        self.take_found();
        let (frame, animated) = self.lay_out()?;
        self.screen.painter.prepare(&frame)?;
        // A still view is drawn at full resolution, and so is the frame after REFINE_AFTER without motion.
        let rests = self.pacing.take_refine(start);
        let drags = !rests && (self.input.controls.is_dragging() || self.input.is_held());
        let moves = goes_on || !flight.is_still() || drags;
        let scale = if moves { self.pacing.resolution.scale() } else { 1.0 };
        let size_px = Resolution::of(target.size_px, scale);
        let resized = self.session.viewer.size_px() != Some(size_px);
        if let Some(words) = self.session.viewer.draw_what_fits(&self.camera.navigator.camera(size_px))? {
            self.hud.message = Some(words);
            self.screen.window.request_redraw();
        }
        self.draw_opened(size_px, target)?;
        self.begin_capture()?;
        let left = self.split.as_ref().map(|split| split.pixels(target.size_px));
        let (recorder, all) = self.session.viewer.record_pixels(target.size_px, target.blue_first)?;
        let ui = Some((&mut self.screen.painter, &frame));
        let fits = self.screen.swapchain.present(recorder, target, Pixels { all, left }, ui)?;
        self.end_capture()?;
        if !fits {
            self.screen.resize()?;
        }
        let ms = 1e3 * since.unwrap_or_else(|| start.elapsed().as_secs_f64());
        self.pacing.clock.push(ms);
        let goes_on = goes_on || !flight.is_still();
        self.pacing.last_shown = goes_on.then_some(start);
        self.pacing.pixel_times = self.session.viewer.pixel_times();
        // During a drag the next frame is requested already; a still frame is waited for.
        let is_shown = goes_on || drags || self.session.viewer.settle()?;
        self.pacing.note_arrived(self.session.viewer.take_arrived());
        if moves {
            self.pacing.adapt_resolution(resized, ms);
        }
        self.pacing.refine_at = (!goes_on && (drags || scale < 1.0)).then(|| Instant::now() + REFINE_AFTER);
        if let Some(recording) = &mut self.camera.recording {
            recording.push(self.pacing.seconds(), self.camera.navigator.camera(target.size_px));
        }
        if goes_on || animated || !fits || !is_shown || self.session.viewer.awaits_pages() {
            self.screen.window.request_redraw();
        }
        Ok(true)
    }

    /// Acquires an image to draw to, in the mode and of the size that the window has now; `None` if there is none.
    fn acquire(&mut self) -> Result<Option<Target>, PlayerError> {
        if let Some(mode) = self.screen.next_mode.take() {
            self.screen.swapchain.set_mode(mode)?;
            self.check_mode(mode);
        }
        let target = self.screen.swapchain.acquire()?;
        if target.is_some() {
            return Ok(target);
        }
        self.screen.resize()?;
        Ok(self.screen.swapchain.acquire()?)
    }

    /// Displays a notice if the window does not support the requested mode.
    fn check_mode(&mut self, wanted: PresentMode) {
        let mode = self.screen.swapchain.mode();
        // An error about the file is more important.
        if mode != wanted && self.hud.message.is_none() {
            self.hud.message = Some(texts::no_such_mode(wanted, mode));
        }
    }

    /// Lays out the overlay of the next frame; the flag is true while it is animated.
    fn lay_out(&mut self) -> Result<(UiFrame, bool), PlayerError> {
        let mut input = self.screen.ui.take_egui_input(&self.screen.window);
        input.time = self.playback.time_of(input.time);
        let mut present = self.screen.swapchain.mode();
        let ctx = self.screen.ui.egui_ctx().clone();
        let (gizmo, hot, brush_px) = (self.gizmo(), self.input.editing.hot(), self.brush_px());
        let (camera, home) = (self.handle_camera(), self.camera.home.target());
        let (distance, [_, _, up]) = (self.camera.navigator.distance(), self.camera.navigator.level_axes());
        let file = self.session.save_path();
        let (step, beside, work) = (self.number_step(), self.beside(), self.work_shown());
        let (mut actions, mut box_actions) = (Vec::new(), Vec::new());
        let output = ctx.run(input, |ctx| {
            // Show and render options change while the scene is read.
            let mut options = self.session.viewer.options;
            let facts = Facts {
                title: &self.session.title,
                device: &self.session.gpu.caps().name,
                size_px: self.screen.swapchain.size_px(),
                clock: &self.pacing.clock,
                stats: &self.pacing.stats,
                pixel_times: self.pacing.pixel_times,
                scene: self.session.viewer.scene(),
                background_len: self.session.viewer.background_len(),
                editor: self.session.viewer.editor(),
                file_bytes: self.session.file_bytes,
                device_bytes: [self.session.gpu.memory_usage().0, self.session.viewer.device_bytes()],
                scene_on_host_bytes: self.session.viewer.scene_on_host_bytes(),
                scale: self.pacing.resolution.scale(),
                up,
                step,
                beside,
                mode: self.input.editing.mode,
                file: &file,
                kept: &self.camera.kept.list,
                recent: self.recent.files(),
                work: work.clone(),
                boxes: self.input.boxing.on,
                split: self.split.is_some(),
            };
            let settings = Settings {
                navigator: &mut self.camera.navigator,
                show: &mut options.show,
                background: &mut options.render.background,
                present: &mut present,
                budget_ms: &mut self.pacing.resolution.budget_ms,
                lod_error_px: &mut options.render.lod_error_px,
                occlusion: &mut options.render.occlusion,
            };
            if self.hud.visible && self.hud.grid {
                ground::grid(ctx, &camera, home, up, distance);
            }
            if self.hud.visible && self.hud.axes {
                ground::axes(ctx, &camera);
            }
            let (points, closed) = self.hud.edit.drawn_points();
            ground::outline(ctx, &camera, points, closed);
            actions.extend(self.hud.lay_out(ctx, &facts, settings));
            self.session.viewer.options = options;
            paint_gizmo(ctx, gizmo.as_ref(), hot);
            paint_brush(ctx, brush_px);
            if let Some(split) = &self.split {
                split.paint(ctx, self.input.controls.pointer_px());
            }
            box_actions.extend(self.lay_out_boxes(ctx));
        });
        if !self.playback.script.is_empty() {
            self.playback.texts = texts_of(&output.shapes);
        }
        self.remembered.note(&ctx, &self.hud);
        let acts = !(actions.is_empty() && box_actions.is_empty());
        self.act(actions)?;
        self.act_on_boxes(box_actions)?;
        if present != self.screen.swapchain.mode() {
            // The acquired image belongs to the old mode: the next frame uses the new one.
            self.screen.next_mode = Some(present);
        }
        self.screen.ui.handle_platform_output(&self.screen.window, output.platform_output);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        let delay = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        let animated = delay.is_some_and(|delay| delay.is_zero());
        self.pacing.ui_at = delay.filter(|_| !animated).and_then(|delay| Instant::now().checked_add(delay));
        let frame = UiFrame { textures: output.textures_delta, primitives, pixels_per_point: output.pixels_per_point };
        Ok((frame, animated || acts || self.screen.next_mode.is_some()))
    }
}
