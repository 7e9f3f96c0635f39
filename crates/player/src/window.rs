//! The window: winit's events in, pictures out. Pictures are drawn only while something changes.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::window::{Window, WindowId};

use crate::swapchain::{PresentMode, Swapchain};
use crate::ui_painter::{UiFrame, UiPainter};
use instgs_vk::gpu::{DeviceChoice, Gpu};
use instgs_vk::render::FrameStats;
use instgs_vk::scene::{Boxes, Camera, InstancedScene};

use super::clock::FrameClock;
use super::controls::Controls;
use super::error::PlayerError;
use super::headless::Timings;
use super::hud::{Facts, Hud, Settings};
use super::hud_gizmo::{paint_brush, paint_gizmo};
use super::navigation::Navigator;
use super::recording::Recording;
use super::resolution::Resolution;
use super::script::Step;
use super::stage::{PixelTimes, Stage, StageOptions};

mod boxing;
mod editing;
mod input;
mod keeping;
mod key_steps;
mod leaving;
mod opening;
mod playing;

use boxing::Boxing;
use editing::Editing;

/// A pause that is longer is not flown through: the window was hidden, or the device busy.
const LONGEST_FLIGHT_SECONDS: f64 = 0.25;
/// A picture of fewer pixels is drawn again with all of them when nothing has moved for so long.
const REFINE_AFTER: Duration = Duration::from_millis(150);
/// A device that is lost again so soon is not opened a third time.
const LOST_FOR_GOOD: Duration = Duration::from_secs(10);

/// What to open.
pub struct WindowJob {
    /// File of the scene.
    pub path: PathBuf,
    /// What was in it, and its length in bytes; else what is wrong with it, to be said in the window.
    pub scene: Result<(InstancedScene, u64), String>,
    /// How it looks.
    pub options: StageOptions,
    /// Opacity compensation for small splats; `None` = as each scene says.
    pub antialias: Option<bool>,
    /// Views of a data set to step through; the first is where the player starts. May be empty.
    pub cameras: Vec<Camera>,
    /// The scene's vertical, if the user knows better.
    pub up: Option<glam::DVec3>,
    /// Width and height of the window, pixels.
    pub size_px: (u32, u32),
    /// When pictures replace each other.
    pub mode: PresentMode,
    /// Which device.
    pub device: DeviceChoice,
    /// With the validation layers.
    pub validation: bool,
    /// Close after so many pictures, drawn without pause through `path_cameras`; `None` = when the user closes it.
    pub frames: Option<u64>,
    /// Cameras of these pictures, in turn.
    pub path_cameras: Vec<Camera>,
    /// Where the last picture goes.
    pub screenshot: Option<PathBuf>,
    /// What is done before each of the first pictures; then the user goes on.
    pub script: VecDeque<Step>,
    /// Milliseconds that a picture may take on the device while things move; else it has fewer pixels.
    pub budget_ms: Option<f64>,
    /// Boxes around objects, and the file they are from: the tool for them is taken up at once.
    pub boxes: Option<(PathBuf, Boxes)>,
}

/// What the window did.
#[derive(Default)]
pub struct WindowReport {
    /// Of each picture, if their number was given.
    pub timings: Timings,
    /// The device's name.
    pub device: String,
    /// Size of the last picture.
    pub size_px: [u32; 2],
    /// First message of the validation layers.
    pub validation_message: Option<String>,
}

/// Opens the window and returns when it is closed.
///
/// # Errors
/// No display, no device that draws into its windows, or a failure while drawing.
pub fn run(job: WindowJob) -> Result<WindowReport, PlayerError> {
    let event_loop = EventLoop::new().map_err(window_error)?;
    event_loop.set_control_flow(ControlFlow::Wait);
    let mut player = Player { job, live: None, outcome: Ok(WindowReport::default()) };
    event_loop.run_app(&mut player).map_err(window_error)?;
    // Device objects before the event loop's display.
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

/// Everything that exists while the window does. Fields are dropped in this order: images before the window.
struct Live {
    painter: UiPainter,
    stage: Stage,
    swapchain: Swapchain,
    gpu: Arc<Gpu>,
    ui: egui_winit::State,
    window: Arc<Window>,
    path: PathBuf,
    title: String,
    file_bytes: u64,
    navigator: Navigator,
    home: Navigator,
    controls: Controls,
    hud: Hud,
    clock: FrameClock,
    /// Of the last picture that is known to be complete, and of those before it that the report wants.
    stats: FrameStats,
    arrived: Vec<FrameStats>,
    pixel_times: PixelTimes,
    /// Views of the data set, and which one was shown last.
    cameras: (Vec<Camera>, Option<usize>),
    /// Cameras that the user kept, and which one was shown last.
    kept: (Vec<Camera>, Option<usize>),
    opened: Instant,
    /// When the last picture was shown, if the one to come follows it without a pause.
    last_shown: Option<Instant>,
    /// Chosen, but not yet in use.
    next_mode: Option<PresentMode>,
    /// The user was told just now that changes are not saved, and what goes on without.
    warned: Option<String>,
    /// A scene is shown: none is if the file could not be read, or was too large for the device.
    has_scene: bool,
    script: VecDeque<Step>,
    /// Pictures that the first step of the script has waited.
    waited: u32,
    resolution: Resolution,
    /// When a picture of fewer pixels is drawn again with all of them, and that this was due: window systems differ in whether
    /// the picture or the wait comes first.
    refine_at: Option<Instant>,
    refine: bool,
    /// When the interface wants to be drawn again, for instance with a hint.
    ui_at: Option<Instant>,
    /// The camera path that is being recorded.
    recording: Option<Recording>,
    /// When the device was opened anew, and what validation layers said of the one before.
    reopened: Option<Instant>,
    validation_message: Option<String>,
    editing: Editing,
    boxing: Boxing,
}

impl ApplicationHandler for Player {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.live.is_some() {
            return;
        }
        match Live::open(event_loop, &mut self.job) {
            Ok(live) => {
                live.window.request_redraw();
                self.live = Some(live);
            }
            Err(error) => self.end(event_loop, Err(error)),
        }
    }

    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, Some(live)) = (cause, &self.live) {
            live.window.request_redraw();
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let wakes_at = self.live.as_mut().and_then(|live| {
            let now = Instant::now();
            // Once, even if the picture cannot be shown, as of a hidden window.
            let due = [&mut live.refine_at, &mut live.ui_at].map(|at| at.take_if(|at| *at <= now));
            live.refine |= due[0].is_some();
            if due.iter().any(Option::is_some) {
                live.window.request_redraw();
            }
            [live.refine_at, live.ui_at, live.boxing.wakes_at()].into_iter().flatten().min()
        });
        event_loop.set_control_flow(wakes_at.map_or(ControlFlow::Wait, ControlFlow::WaitUntil));
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(live) = &mut self.live else { return };
        let after = match event {
            WindowEvent::CloseRequested => Ok(live.close()),
            WindowEvent::RedrawRequested => self.redraw(),
            event => live.event(&event, &self.job),
        };
        match after {
            Ok(After::Nothing) => {}
            Ok(After::Redraw) => self.request_redraw(),
            Ok(After::Quit) => self.end(event_loop, Ok(())),
            Err(error) => self.failed(event_loop, error),
        }
    }
}

/// What an event leads to.
enum After {
    Nothing,
    Redraw,
    Quit,
}

impl Player {
    fn request_redraw(&self) {
        if let Some(live) = &self.live {
            live.window.request_redraw();
        }
    }

    fn redraw(&mut self) -> Result<After, PlayerError> {
        let Some(live) = &mut self.live else { return Ok(After::Nothing) };
        let done = self.outcome.as_ref().map_or(0, |report| report.timings.submitted_len() as u64);
        if self.job.frames.is_some() && !self.job.path_cameras.is_empty() {
            let cameras = &self.job.path_cameras;
            live.navigator.stand_at(&cameras[(done % cameras.len() as u64) as usize]);
        }
        if let After::Quit = live.play_step(&self.job)? {
            return Ok(After::Quit);
        }
        if let Ok(report) = &mut self.outcome {
            report.timings.begin();
        }
        let shown = live.picture(self.job.frames.is_some() || !live.script.is_empty())?;
        let Some(frames) = self.job.frames else { return Ok(After::Nothing) };
        if let (true, Ok(report)) = (shown, &mut self.outcome) {
            report.timings.submitted(live.stage.in_flight());
            report.timings.note(live.pixel_times);
            report.timings.stats.append(&mut live.arrived);
        }
        Ok(if done + u64::from(shown) >= frames { After::Quit } else { After::Nothing })
    }

    /// After the loss of the device, goes on with one that is opened anew; ends else, and if it is lost again soon. What is
    /// not saved is written first.
    fn failed(&mut self, event_loop: &ActiveEventLoop, error: PlayerError) {
        let Some(mut live) = self.live.take() else { return self.end(event_loop, Err(error)) };
        let (files, errors) = live.rescue();
        let again = error.is_lost() && live.reopened.is_none_or(|then| then.elapsed() > LOST_FOR_GOOD);
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

    /// Notes how it ended and leaves the event loop.
    fn end(&mut self, event_loop: &ActiveEventLoop, result: Result<(), PlayerError>) {
        event_loop.exit();
        let closing = result.and_then(|()| self.closing());
        if let Err(error) = closing {
            self.outcome = Err(error);
        }
    }

    fn closing(&mut self) -> Result<(), PlayerError> {
        let (Some(live), Ok(report)) = (&mut self.live, &mut self.outcome) else { return Ok(()) };
        report.device = live.gpu.caps().name.clone();
        report.size_px = live.swapchain.size_px();
        live.stage.settle()?;
        report.timings.arrived(live.stage.in_flight());
        report.timings.stats.extend(live.stage.take_arrived());
        if let Some(path) = &self.job.screenshot {
            live.stage.screenshot(path)?;
        }
        live.gpu.wait_all()?;
        let last = live.gpu.validation_messages().take().into_iter().next();
        report.validation_message = live.validation_message.take().or(last);
        Ok(())
    }
}

impl Live {
    /// Draws and shows a picture; false if there is nowhere to show it now. `goes_on` says that another one follows at once.
    fn picture(&mut self, goes_on: bool) -> Result<bool, PlayerError> {
        let start = Instant::now();
        if let Some(mode) = self.next_mode.take() {
            self.swapchain.set_mode(mode)?;
            self.check_mode(mode);
        }
        let mut target = self.swapchain.acquire()?;
        if target.is_none() {
            self.resize()?;
            target = self.swapchain.acquire()?;
        }
        let Some(target) = target else { return Ok(false) };
        let since = self.last_shown.map(|then| start.duration_since(then).as_secs_f64());
        let flight = self.controls.flight();
        self.navigator.fly(flight, since.unwrap_or(0.0).min(LONGEST_FLIGHT_SECONDS));
        self.follow_grip()?;
        self.take_found();
        let (frame, animated) = self.lay_out()?;
        self.painter.prepare(&frame)?;
        // All pixels when nothing moves: then there is time.
        // One that rests has waited for it.
        let rests = std::mem::take(&mut self.refine) || self.refine_at.is_some_and(|at| at <= start);
        let drags = !rests && (self.controls.is_dragging() || self.is_held());
        let moves = goes_on || !flight.is_still() || drags;
        let scale = if moves { self.resolution.scale() } else { 1.0 };
        let size_px = Resolution::of(target.size_px, scale);
        let resized = self.stage.size_px() != Some(size_px);
        if let Some(words) = self.stage.draw_what_fits(&self.navigator.camera(size_px))? {
            self.hud.message = Some(words);
            self.window.request_redraw();
        }
        let (recorder, pixels) = self.stage.record_pixels(target.size_px, target.blue_first)?;
        let fits = self.swapchain.present(recorder, target, pixels, Some((&mut self.painter, &frame)))?;
        if !fits {
            self.resize()?;
        }
        let ms = 1e3 * since.unwrap_or_else(|| start.elapsed().as_secs_f64());
        self.clock.push(ms);
        let goes_on = goes_on || !flight.is_still();
        self.last_shown = goes_on.then_some(start);
        self.pixel_times = self.stage.pixel_times();
        // While something is dragged, the next picture is on its way already; the one that rests waits for itself.
        let is_shown = goes_on || drags || self.stage.settle()?;
        self.arrived = self.stage.take_arrived();
        self.stats = self.arrived.last().unwrap_or(&self.stats).clone();
        if moves {
            // With another size all that were on their way arrive, and are of the size before.
            let first = if resized { self.arrived.len().saturating_sub(1) } else { 0 };
            let of_this_size = &self.arrived[first..];
            of_this_size.iter().for_each(|stats| self.resolution.took(stats.total_ms().unwrap_or(ms)));
        }
        self.refine_at = (!goes_on && (drags || scale < 1.0)).then(|| Instant::now() + REFINE_AFTER);
        if let Some(recording) = &mut self.recording {
            recording.push(self.opened.elapsed().as_secs_f64(), self.navigator.camera(target.size_px));
        }
        if goes_on || animated || !fits || !is_shown {
            self.window.request_redraw();
        }
        Ok(true)
    }

    /// Says so if the window has not the mode that was asked for.
    fn check_mode(&mut self, wanted: PresentMode) {
        let mode = self.swapchain.mode();
        // What went wrong with the file says more.
        if mode != wanted && self.hud.message.is_none() {
            self.hud.message = Some(format!("this window has no {}: {}", wanted.name(), mode.name()));
        }
    }

    fn resize(&mut self) -> Result<(), PlayerError> {
        let size = self.window.inner_size();
        Ok(self.swapchain.resize([size.width, size.height])?)
    }

    /// The interface of the next picture, and whether it moves by itself.
    fn lay_out(&mut self) -> Result<(UiFrame, bool), PlayerError> {
        let input = self.ui.take_egui_input(&self.window);
        let mut mode = self.swapchain.mode();
        let scene = self.stage.scene();
        let gaussians = [(scene.templates.len() + scene.background.len()) as u64, scene.expanded_len()];
        let bytes = [
            ("file", self.file_bytes),
            ("on the device", self.gpu.memory_usage().0),
            ("of it the scene", self.stage.device_bytes()),
            ("in it templates", scene.templates.tensor_bytes()),
            ("offsets", scene.offsets.tensor_bytes()),
            ("background", scene.background.tensor_bytes()),
        ];
        let ctx = self.ui.egui_ctx().clone();
        let (gizmo, hot, brush_px) = (self.gizmo(), self.editing.hot(), self.brush_px());
        let (mut actions, mut box_actions, mut boxes) = (Vec::new(), Vec::new(), self.boxing.on);
        let output = ctx.run(input, |ctx| {
            let facts = Facts {
                scene: &self.title,
                device: &self.gpu.caps().name,
                size_px: self.swapchain.size_px(),
                clock: &self.clock,
                stats: &self.stats,
                pixel_times: self.pixel_times,
                gaussians,
                bytes,
                chosen: self.stage.editor().chosen().iter().copied().collect(),
                instances: self.stage.scene().instances.len(),
                steps: self.stage.editor().steps(),
                scale: self.resolution.scale(),
            };
            let settings = Settings {
                navigator: &mut self.navigator,
                show: &mut self.stage.options.show,
                mode: &mut mode,
                budget_ms: &mut self.resolution.budget_ms,
                lod_error_px: &mut self.stage.options.render.lod_error_px,
                boxes: &mut boxes,
            };
            self.hud.lay_out(ctx, facts, settings);
            paint_gizmo(ctx, gizmo.as_ref(), hot);
            paint_brush(ctx, brush_px);
            actions.extend(self.lay_out_panel(ctx));
            box_actions.extend(self.lay_out_boxes(ctx));
        });
        let acts = !(actions.is_empty() && box_actions.is_empty()) || boxes != self.boxing.on;
        if boxes != self.boxing.on {
            self.toggle_boxes()?;
        }
        self.act(actions)?;
        self.act_on_boxes(box_actions)?;
        if mode != self.swapchain.mode() {
            // The image at hand belongs to the old mode: the next picture has the new one.
            self.next_mode = Some(mode);
        }
        self.ui.handle_platform_output(&self.window, output.platform_output);
        let primitives = ctx.tessellate(output.shapes, output.pixels_per_point);
        let delay = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        let animated = delay.is_some_and(|delay| delay.is_zero());
        self.ui_at = delay.filter(|_| !animated).and_then(|delay| Instant::now().checked_add(delay));
        let frame = UiFrame { textures: output.textures_delta, primitives, pixels_per_point: output.pixels_per_point };
        Ok((frame, animated || acts || self.next_mode.is_some()))
    }
}
