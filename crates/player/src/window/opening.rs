//! From a file and a window to the first frame: opening devices, reopening them after a loss, and opening scenes.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use raw_window_handle::{HasDisplayHandle, HasWindowHandle, RawDisplayHandle, RawWindowHandle};
use winit::dpi::PhysicalSize;
use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use super::boxing::Boxing;
use super::editing::Editing;
use super::keeping::{CameraList, kept_cameras};
use super::parts::{CameraState, Interaction, Pacing, Playback, Screen, Session};
use super::{Live, WindowJob, window_error};
use crate::error::PlayerError;
use crate::hud::{CameraPanel, Hud};
use crate::hud_edit::EditPanel;
use crate::navigation::Navigator;
use crate::remembered::{Recent, Remembered};
use crate::scene_viewer::SceneViewer;
use crate::swapchain::{PresentMode, Swapchain};
use crate::texts;
use crate::ui_painter::UiPainter;
use crate::views::View;
use instgs_console::opened::OpenedScene;
use instgs_io::IoError;
use instgs_io::page::{cameras_beside, up_of_run};
use instgs_vk::gpu::{Faults, Gpu, GpuOptions};
use instgs_vk::kernels::open_tuned;
use instgs_vk::render::Show;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{InstancedScene, up_direction};

impl Live {
    pub(super) fn open(event_loop: &ActiveEventLoop, job: &mut WindowJob) -> Result<Self, PlayerError> {
        let title = title_of(&job.path);
        let attributes = Window::default_attributes()
            .with_title(texts::window_title(&title))
            .with_inner_size(PhysicalSize::new(job.size_px.0, job.size_px.1));
        let window = Arc::new(event_loop.create_window(attributes).map_err(window_error)?);
        let (gpu, screen) = open_device(window, job, job.mode)?;
        let alone = job.frames.is_some() || !job.script.is_empty();
        let (mut hud, remembered) = (Hud::new(job.frames.is_none()), Remembered::open(alone));
        remembered.restore(screen.ui.egui_ctx(), &mut hud);
        let navigator = Navigator::around(&Orbit::around(&InstancedScene::default(), job.up));
        let mut live = Self {
            session: Session {
                viewer: viewer_of(&gpu, job)?,
                gpu,
                path: job.path.clone(),
                title,
                file_bytes: 0,
                memory: job.memory,
                up: job.up,
                has_scene: false,
                reopened: None,
                validation_message: None,
            },
            screen,
            hud,
            camera: CameraState {
                home: navigator.clone(),
                navigator,
                // The view starts at the data set's first camera.
                data_views: CameraList { list: std::mem::take(&mut job.cameras), at: Some(0) },
                kept: CameraList { list: kept_cameras(&job.path), at: None },
                recording: None,
            },
            input: Interaction::default(),
            pacing: Pacing::new(job.budget_ms),
            recent: Recent::open(alone),
            playback: Playback { script: std::mem::take(&mut job.script), ..Playback::default() },
            work: None,
            split: None,
            remembered,
        };
        live.input.controls.per_point = live.screen.window.scale_factor();
        match job.scene.take() {
            Some(scene) => live.take_first(Ok(scene), job)?,
            None => live.read_first(&job.path),
        }
        live.check_mode(job.mode);
        Ok(live)
    }

    /// Shows the scene that the window was opened for, with the boxes of the command line.
    pub(super) fn take_first(
        &mut self,
        scene: Result<OpenedScene, IoError>,
        job: &WindowJob,
    ) -> Result<(), PlayerError> {
        self.take_scene(scene, job)?;
        if let Some((path, boxes)) = &job.boxes {
            self.input.boxing = Boxing::from_file(path.clone(), boxes.clone());
        }
        Ok(())
    }

    /// Moves everything to a reopened device after the loss of the present one.
    pub(super) fn reopen(mut self, job: &WindowJob, reason: &PlayerError) -> Result<Self, PlayerError> {
        let mode = self.screen.swapchain.mode();
        let validation_message = self.session.take_validation_message();
        // Everything of the old device goes first: the window can have one swapchain at a time.
        let Screen { painter, swapchain, window, next_mode, .. } = self.screen;
        drop((painter, swapchain));
        let (gpu, screen) = open_device(window, job, mode)?;
        let viewer = SceneViewer::reopened(&gpu, self.session.viewer)?;
        let reopened = Some(Instant::now());
        self.pacing.last_shown = None;
        self.remembered.restore(screen.ui.egui_ctx(), &mut self.hud);
        self.split = None;
        // Pictures of the old device are gone with its textures.
        self.hud.cameras = CameraPanel::default();
        self.hud.message = Some(texts::device_reopened(reason));
        Ok(Self {
            session: Session { viewer, gpu, reopened, validation_message, ..self.session },
            screen: Screen { next_mode, ..screen },
            ..self
        })
    }

    /// Shows a scene, or displays why there is none.
    pub(super) fn take_scene(
        &mut self,
        scene: Result<OpenedScene, IoError>,
        job: &WindowJob,
    ) -> Result<(), PlayerError> {
        let opened = match scene {
            Ok(opened) => opened,
            Err(error) => {
                self.hud.message = Some(error.to_string());
                return Ok(());
            }
        };
        let notes = opened.warnings(self.session.memory);
        let scene = opened.scene();
        let data = &self.camera.data_views.list;
        let beside = if data.is_empty() { cameras_beside(&self.session.path).unwrap_or_default() } else { Vec::new() };
        let orbit = Orbit::around(scene, job.up.or_else(|| up_direction(data)).or_else(|| up_of_run(&beside, scene)));
        self.camera.home = Navigator::around(&orbit);
        if let Some(camera) = data.first().or(self.camera.kept.list.first()).or(beside.first()) {
            self.camera.home.stand_at(camera);
            self.camera.home.aim_at(orbit.center);
        }
        self.camera.navigator = self.camera.home.clone();
        let mut options = self.session.viewer.options;
        options.render = options.render.filtered(job.pixel_filter.over(scene.pixel_filter));
        options.render.near = job.near_plane.unwrap_or(scene.near_plane).0;
        if let Show::Depth(_) = options.show {
            options.show = View::Depth.show(orbit.distance);
        }
        // Frames that are being drawn are of the old scene.
        self.cancel_work();
        self.hud.forget_scene();
        self.input.editing = Editing::default();
        (self.hud.edit, self.hud.cameras) = (EditPanel::default(), CameraPanel::default());
        self.stop_search();
        self.split = None;
        self.input.boxing = Boxing::default();
        (self.camera.recording, self.pacing.refine_at, self.input.asked) = (None, None, None);
        self.session.file_bytes = opened.file_bytes();
        self.pacing.clock.clear();
        self.session.has_scene = false;
        match self.session.viewer.open(opened, options) {
            Ok(()) => {
                self.session.has_scene = true;
                self.recent.note(&self.session.path);
                if !notes.is_empty() {
                    self.hud.message = Some(texts::first_note(&notes));
                }
            }
            Err(error) if error.is_lost() => return Err(error),
            // The scene does not fit this device; the next file may.
            Err(error) => self.hud.message = Some(error.to_string()),
        }
        Ok(())
    }

    /// Shows the scene of a file that was read; errors are displayed in the window.
    pub(super) fn take_file(
        &mut self,
        path: &Path,
        loaded: Result<OpenedScene, IoError>,
        job: &WindowJob,
    ) -> Result<(), PlayerError> {
        if loaded.is_ok() {
            self.take_path(path);
            self.camera.data_views = CameraList::default();
            self.camera.kept = CameraList { list: kept_cameras(path), at: None };
            self.hud.message = None;
        }
        self.take_scene(loaded, job)
    }

    /// Another file is the scene's own from now on.
    pub(super) fn take_path(&mut self, path: &Path) {
        (self.session.title, self.session.path) = (title_of(path), path.to_path_buf());
        self.screen.window.set_title(&texts::window_title(&self.session.title));
    }
}

/// The name of a file, for people.
fn title_of(path: &Path) -> String {
    path.file_name().map_or("instgs".into(), |name| name.to_string_lossy().into_owned())
}

/// A viewer of nothing yet. Frames that are timed wait for all pages of a scene; in a window stand-ins are drawn until they come.
fn viewer_of(gpu: &Arc<Gpu>, job: &WindowJob) -> Result<SceneViewer, PlayerError> {
    let mut viewer = SceneViewer::new(gpu, InstancedScene::default(), job.options)?;
    viewer.waits_for_pages = job.frames.is_some();
    Ok(viewer)
}

/// Opens a device for a window, and makes its swapchain and the painter of the overlay.
fn open_device(window: Arc<Window>, job: &WindowJob, mode: PresentMode) -> Result<(Arc<Gpu>, Screen), PlayerError> {
    let (display, handle) = handles(&window)?;
    let (device, validation) = (job.device.clone(), job.validation);
    let faults = Faults::of_environment()?;
    let options = GpuOptions { device, validation, display: Some(display), faults, ..Default::default() };
    let gpu = open_tuned(options)?;
    gpu.set_memory_budget(job.memory_budget_bytes);
    let size = window.inner_size();
    // SAFETY: `Screen` drops the swapchain before the window, and so does this function on errors; the device was opened
    // for this display.
    let swapchain = unsafe { Swapchain::new(&gpu, display, handle, [size.width, size.height], mode) }?;
    let painter = UiPainter::new(&gpu, &swapchain)?;
    let scale = window.scale_factor() as f32;
    let ctx = egui::Context::default();
    // Each blink would redraw the scene.
    let mut fonts = egui::FontDefinitions::default();
    egui_phosphor::add_to_fonts(&mut fonts, egui_phosphor::Variant::Regular);
    ctx.set_fonts(fonts);
    ctx.all_styles_mut(|style| style.visuals.text_cursor.blink = false);
    let ui = egui_winit::State::new(ctx, egui::ViewportId::ROOT, &*window, Some(scale), None, None);
    Ok((gpu, Screen { painter, swapchain, ui, window, next_mode: None }))
}

/// The raw display and window handles of a window.
fn handles(window: &Window) -> Result<(RawDisplayHandle, RawWindowHandle), PlayerError> {
    let display = window.display_handle().map_err(window_error)?.as_raw();
    Ok((display, window.window_handle().map_err(window_error)?.as_raw()))
}
