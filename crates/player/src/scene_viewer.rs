//! A scene on the device, and frames of it as pixels for a window. Changes of the scene are in `changes`.

mod changes;

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::swapchain::UI_PASS;
use instgs_console::opened::{DrawnScene, OpenedScene, PagedView};
use instgs_io::picture_png::write_png;
use instgs_io::{IoError, PagedFile};
use instgs_vk::gpu::staging::download_from;
use instgs_vk::gpu::{Buffer, Gpu, Recorder};
use instgs_vk::render::{
    Ahead, Arrived, ExtraPasses, FRAMES_IN_FLIGHT, FrameStats, InstanceLook, MarkShape, Marks, Presenter,
    RenderOptions, Renderer, Show, ShownPicture, Surfaces,
};
use instgs_vk::scene::{Camera, Instance, InstancedScene};

use super::editor::Editor;
use super::error::PlayerError;
use super::texts;

/// How frames are rendered.
#[derive(Clone, Copy, Debug, Default)]
pub struct ViewerOptions {
    /// Options of the render passes; `antialias` is the scene's own unless the user overrides it.
    pub render: RenderOptions,
    /// The view: colours, depth, instances ...
    pub show: Show,
}

/// Device times in milliseconds of turning a frame into pixels; `None` before the first frame or without device
/// timestamps. The copy into the swapchain's image is in neither: it may wait for the presentation engine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelTimes {
    /// Time of kernel `present`.
    pub present_ms: Option<f64>,
    /// Time of drawing the overlay; `None` without a window.
    pub ui_ms: Option<f64>,
}

impl PixelTimes {
    fn of(passes: &[(&'static str, f64)]) -> Self {
        let ms_of = |ui: bool| {
            let of_kind = passes.iter().filter(|(name, _)| (*name == UI_PASS) == ui);
            of_kind.map(|(_, ms)| *ms).reduce(|a, b| a + b)
        };
        Self { present_ms: ms_of(false), ui_ms: ms_of(true) }
    }
}

/// A scene on the host and on the device, its editor, and the passes that draw it.
pub struct SceneViewer {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    presenter: Presenter,
    surfaces: Surfaces,
    marks: Marks,
    /// The frames in flight.
    ahead: Ahead,
    /// Recorders for making pixels, used in turn: one per frame in flight.
    recorders: [Recorder; FRAMES_IN_FLIGHT],
    turn: usize,
    /// Times of the pixels that `recorders[turn]` made last.
    pixel_times: PixelTimes,
    /// In pages, with stand-ins as its background.
    scene: InstancedScene,
    on_device: DrawnScene,
    /// True if frames wait for all pages that they want; else stand-ins are drawn until they have come.
    pub waits_for_pages: bool,
    /// True if the last frame wanted pages that had not come.
    awaits_pages: bool,
    /// How frames are rendered; may change between frames.
    pub options: ViewerOptions,
    /// Camera of the last frame.
    camera: Option<Camera>,
    /// Number of depth slabs of the last complete frame.
    slabs: u32,
    /// True if that frame was drawn by one submission, as frames in flight have to be.
    one_submission: bool,
    /// Statistics of complete frames that have not been taken yet.
    arrived: Vec<FrameStats>,
    /// True if the id buffer belongs to the last frame.
    has_surfaces: bool,
    /// The shape of the marks that belong to the last frame, if any.
    has_marks: Option<MarkShape>,
    /// True once a frame was asked for that may give up what does not fit: such frames may, too, if they are redrawn.
    gives_way: bool,
    /// A notice of what a redrawn frame gave up, until the next frame returns it.
    given_up: Option<String>,
    editor: Editor,
}

impl SceneViewer {
    /// Uploads a scene to the device.
    ///
    /// # Errors
    /// The device fails or has no memory for it.
    pub fn new(gpu: &Arc<Gpu>, scene: InstancedScene, options: ViewerOptions) -> Result<Self, PlayerError> {
        let renderer = Renderer::profiled(gpu)?;
        let on_device = DrawnScene::whole(&renderer, &scene, &options.render)?;
        Self::with(gpu, renderer, scene, on_device, options)
    }

    /// The same for a scene that was opened, which may be in pages.
    ///
    /// # Errors
    /// The errors of [`SceneViewer::new`].
    pub fn of_opened(gpu: &Arc<Gpu>, opened: OpenedScene, options: ViewerOptions) -> Result<Self, PlayerError> {
        let file = match opened {
            OpenedScene::Whole(loaded) => return Self::new(gpu, loaded.scene, options),
            OpenedScene::InPages(file) => *file,
        };
        let renderer = Renderer::profiled(gpu)?;
        let (view, scene) = PagedView::new(file, gpu, &renderer, &options.render)?;
        Self::with(gpu, renderer, scene, DrawnScene::InPages(Box::new(view)), options)
    }

    fn with(
        gpu: &Arc<Gpu>,
        renderer: Renderer,
        scene: InstancedScene,
        on_device: DrawnScene,
        options: ViewerOptions,
    ) -> Result<Self, PlayerError> {
        Ok(Self {
            gpu: gpu.clone(),
            presenter: Presenter::new(gpu, &renderer)?,
            surfaces: Surfaces::new(gpu)?,
            marks: Marks::new(gpu)?,
            ahead: Ahead::new(gpu)?,
            recorders: [Recorder::with_profiler(gpu)?, Recorder::with_profiler(gpu)?],
            turn: 0,
            pixel_times: PixelTimes::default(),
            on_device,
            scene,
            waits_for_pages: true,
            awaits_pages: false,
            renderer,
            options,
            camera: None,
            slabs: 0,
            one_submission: false,
            arrived: Vec::new(),
            has_surfaces: false,
            has_marks: None,
            gives_way: false,
            given_up: None,
            editor: Editor::default(),
        })
    }

    /// Shows another scene in place of this one, which is freed first since both may not fit. Selection and undo
    /// history are cleared.
    ///
    /// # Errors
    /// The device fails or has no memory for it; an empty scene is shown then.
    pub fn open(&mut self, opened: OpenedScene, options: ViewerOptions) -> Result<(), PlayerError> {
        while self.ahead.arrive()?.is_some() {}
        (self.scene, self.options, self.editor) = (InstancedScene::default(), options, Editor::default());
        (self.camera, self.slabs, self.one_submission) = (None, 0, false);
        (self.has_surfaces, self.has_marks, self.awaits_pages) = (false, None, false);
        self.given_up = None;
        self.arrived.clear();
        self.renderer.forget_picture();
        self.on_device = DrawnScene::whole(&self.renderer, &self.scene, &options.render)?;
        (self.on_device, self.scene) = match opened {
            OpenedScene::Whole(loaded) => {
                (DrawnScene::whole(&self.renderer, &loaded.scene, &options.render)?, loaded.scene)
            }
            OpenedScene::InPages(file) => {
                let (view, scene) = PagedView::new(*file, &self.gpu, &self.renderer, &options.render)?;
                (DrawnScene::InPages(Box::new(view)), scene)
            }
        };
        Ok(())
    }

    /// Moves the scene, with selection and undo history, to another device.
    ///
    /// # Errors
    /// The device fails or has no memory for it, or the file of a scene in pages is gone.
    pub fn reopened(gpu: &Arc<Gpu>, old: Self) -> Result<Self, PlayerError> {
        let Self { scene, options, editor, on_device, waits_for_pages, .. } = old;
        let viewer = match on_device.paged_file() {
            None => Self::new(gpu, scene, options)?,
            Some(path) => {
                let file = PagedFile::open(path)?.ok_or_else(|| IoError::new(path, texts::NO_PAGES))?;
                Self::of_opened(gpu, OpenedScene::InPages(Box::new(file)), options)?
            }
        };
        let mut viewer = Self { editor, waits_for_pages, ..viewer };
        viewer.show(viewer.editor.hidden().clone())?;
        Ok(viewer)
    }

    /// True if most of the background is not in memory, so that the scene can be looked at, but not edited or saved.
    pub fn is_in_pages(&self) -> bool {
        self.on_device.paged_file().is_some()
    }

    /// True if the last frame drew stand-ins for pages that are being read: draw it again.
    pub fn awaits_pages(&self) -> bool {
        self.awaits_pages
    }

    /// Gets the pages that a view wants, or those of them that have come.
    fn follow_view(&mut self, camera: &Camera, waits: bool) -> Result<(), PlayerError> {
        let options = self.render_options();
        self.awaits_pages = if waits {
            self.on_device.follow(camera, &options)?;
            false
        } else {
            !self.on_device.follow_ahead(camera, &options)?.missing.is_empty()
        };
        Ok(())
    }

    /// The scene as edited, on the host.
    pub fn scene(&self) -> &InstancedScene {
        &self.scene
    }

    /// Number of stored Gaussians of the background, wherever they are.
    pub fn background_len(&self) -> u64 {
        self.on_device.background_len(&self.scene)
    }

    /// Memory of the scene on the device, bytes.
    pub fn device_bytes(&self) -> u64 {
        self.on_device.device().bytes() - self.on_device.device().host_bytes()
    }

    /// Draws a frame and waits for it; the frame stays on the device.
    pub fn draw(&mut self, camera: &Camera) -> Result<(), PlayerError> {
        while let Some(arrived) = self.ahead.arrive()? {
            self.note(arrived);
        }
        self.upload_levels()?;
        self.follow_view(camera, self.waits_for_pages)?;
        let mut stats = self.render(camera)?;
        if stats.slabs > 1 && matches!(self.options.show, Show::TileLoad(_)) {
            // The tile load is that of the last depth slab: a frame that overflowed its buffers is redone with the
            // larger ones.
            stats = self.render(camera)?;
        }
        self.note(Arrived::Complete(stats));
        self.camera = Some(camera.clone());
        Ok(())
    }

    /// The same as [`SceneViewer::draw`], for pictures that are kept: waits for all pages that there is room for.
    ///
    /// # Errors
    /// The errors of [`SceneViewer::draw`].
    pub fn draw_complete(&mut self, camera: &Camera) -> Result<(), PlayerError> {
        let waits = std::mem::replace(&mut self.waits_for_pages, true);
        let drawn = self.draw(camera);
        self.waits_for_pages = waits;
        drawn
    }

    /// Draws the last frame again if it lacks pages.
    ///
    /// # Errors
    /// The errors of [`SceneViewer::draw`].
    pub fn complete(&mut self) -> Result<(), PlayerError> {
        match self.camera.clone().filter(|_| self.awaits_pages) {
            Some(camera) => self.draw_complete(&camera),
            None => Ok(()),
        }
    }

    fn render(&mut self, camera: &Camera) -> Result<FrameStats, PlayerError> {
        self.prepare_looks()?;
        let options = self.render_options();
        let extra = ExtraPasses {
            surfaces: self.has_surfaces.then_some(&mut self.surfaces),
            marks: self.has_marks.map(|shape| (&mut self.marks, shape)),
        };
        Ok(self.renderer.render_with(self.on_device.device(), camera, &options, extra)?)
    }

    /// Prepares what the next frame has besides colours, and uploads which instances are selected.
    fn prepare_looks(&mut self) -> Result<(), PlayerError> {
        self.has_surfaces = self.needs_surfaces();
        self.has_marks = self.options.show.marks();
        if self.has_surfaces {
            self.presenter.set_instances(&self.looks())?;
        }
        Ok(())
    }

    /// Options of the render passes for the present view.
    fn render_options(&self) -> RenderOptions {
        let mut options = self.options.render;
        if matches!(self.options.show, Show::Offsets(_)) {
            // Merged Gaussians of coarser levels have offsets of their own.
            options.lod_error_px = 0.0;
        }
        // The lists of the whole picture are shown.
        options.occlusion &= !matches!(self.options.show, Show::TileLoad(_));
        options
    }

    /// Bytes of the scene that are in host memory since the device has too little, where kernels read what is in view.
    pub fn scene_on_host_bytes(&self) -> u64 {
        self.on_device.device().host_bytes()
    }

    /// Statistics of the frames that completed since the last call, in order.
    pub fn take_arrived(&mut self) -> Vec<FrameStats> {
        std::mem::take(&mut self.arrived)
    }

    /// Records a frame that has left the device; true if it is complete.
    fn note(&mut self, arrived: Arrived) -> bool {
        let Arrived::Complete(stats) = arrived else { return false };
        (self.slabs, self.one_submission) = (stats.slabs, stats.is_one_submission());
        self.arrived.push(stats);
        true
    }

    /// Like [`SceneViewer::draw`], but without waiting if the frame has the size of the previous one and that had one depth
    /// slab. Call [`SceneViewer::settle`] after the last frame.
    pub fn draw_ahead(&mut self, camera: &Camera) -> Result<(), PlayerError> {
        let alike = self.size_px() == Some([camera.width, camera.height]) && self.one_submission;
        if !alike || !self.has_wanted_levels() {
            return self.draw(camera);
        }
        while self.ahead.is_full() {
            if !self.ahead.arrive()?.is_some_and(|arrived| self.note(arrived)) {
                return self.draw(camera);
            }
        }
        self.follow_view(camera, self.waits_for_pages)?;
        self.prepare_looks()?;
        let options = self.render_options();
        let extra = ExtraPasses {
            surfaces: self.has_surfaces.then_some(&mut self.surfaces),
            marks: self.has_marks.map(|shape| (&mut self.marks, shape)),
        };
        self.renderer.submit_ahead(&mut self.ahead, self.on_device.device(), camera, &options, extra)?;
        self.camera = Some(camera.clone());
        Ok(())
    }

    /// Like [`SceneViewer::draw_ahead`]. If the frame needs more than the device has room for, falls back to a view that
    /// needs less, and returns a notice that says which and why. If that is found out only in [`SceneViewer::settle`], the
    /// next frame returns the notice.
    pub fn draw_what_fits(&mut self, camera: &Camera) -> Result<Option<String>, PlayerError> {
        self.gives_way = true;
        let earlier = self.given_up.take().or_else(|| self.on_device.take_problem());
        Ok(self.draw_giving_way(camera, Self::draw_ahead)?.or(earlier))
    }

    /// Draws a frame, if need be one of a view that needs less; returns a notice in that case.
    fn draw_giving_way(
        &mut self,
        camera: &Camera,
        draw: impl Fn(&mut Self, &Camera) -> Result<(), PlayerError>,
    ) -> Result<Option<String>, PlayerError> {
        let mut words = None;
        loop {
            match draw(self, camera) {
                Err(error) if error.is_too_much() => match self.ask_for_less(&error)? {
                    Some(instead) => words = Some(format!("{instead}: {error}")),
                    None => return Err(error),
                },
                done => return done.map(|()| words),
            }
        }
    }

    /// After an error of a frame that needs too much, gives up the next thing that takes room besides the scene itself
    /// and returns a notice; `None` if nothing is left to give up.
    fn ask_for_less(&mut self, error: &PlayerError) -> Result<Option<&'static str>, PlayerError> {
        // Levels take memory, but a frame has fewer chunks with them. A scene in pages has its levels in any case.
        if error.is_out_of_memory() && self.options.render.lod_error_px > 0.0 && !self.is_in_pages() {
            self.options.render.lod_error_px = 0.0;
            self.upload()?;
            return Ok(Some(texts::NO_LEVELS));
        }
        if self.options.show.needs_surfaces() || self.options.show.marks().is_some() {
            self.options.show = Show::Color;
            return Ok(Some(texts::BACK_TO_COLOURS));
        }
        if !self.editor.chosen().is_empty() {
            self.editor.click(None, false);
            return Ok(Some(texts::SELECTION_CLEARED));
        }
        Ok(None)
    }

    /// Number of frames in flight.
    pub fn in_flight(&self) -> usize {
        self.ahead.pending_len()
    }

    /// Waits for the last frame. False if it had to be redrawn because of an overflow, so that the window shows an
    /// older frame.
    pub fn settle(&mut self) -> Result<bool, PlayerError> {
        let mut complete = true;
        while let Some(arrived) = self.ahead.arrive()? {
            complete = self.note(arrived);
        }
        if let Some(camera) = self.camera.clone().filter(|_| !complete) {
            if self.gives_way {
                self.given_up = self.draw_giving_way(&camera, Self::draw)?.or_else(|| self.given_up.take());
            } else {
                self.draw(&camera)?;
            }
        }
        Ok(complete)
    }

    fn needs_surfaces(&self) -> bool {
        self.options.show.needs_surfaces() || !self.editor.chosen().is_empty()
    }

    fn looks(&self) -> Vec<InstanceLook> {
        let chosen = self.editor.chosen_flags(&self.scene);
        let templates = self.scene.instances.iter().map(|instance| instance.template);
        chosen.into_iter().zip(templates).map(|(chosen, template)| InstanceLook { chosen, template }).collect()
    }

    fn has_wanted_levels(&self) -> bool {
        // A scene in pages has levels always: they stand in.
        self.is_in_pages() || self.on_device.device().has_levels() == (self.options.render.lod_error_px > 0.0)
    }

    /// Levels of detail exist on the device only while merging is allowed, so that full quality is independent of them.
    fn upload_levels(&mut self) -> Result<(), PlayerError> {
        if !self.has_wanted_levels() {
            self.upload()?;
        }
        Ok(())
    }

    /// Uploads the scene in place of the present one, which is freed first since both may not fit.
    fn upload(&mut self) -> Result<(), PlayerError> {
        if self.is_in_pages() {
            // Nothing of it changes but what is shown.
            return Ok(());
        }
        // The last frame shows the scene before: its ids may be other instances now.
        (self.has_surfaces, self.has_marks) = (false, None);
        let options = &self.options.render;
        self.on_device = DrawnScene::whole(&self.renderer, &InstancedScene::default(), options)?;
        self.on_device = DrawnScene::whole(&self.renderer, &self.scene, options)?;
        self.show(self.editor.hidden().clone())
    }

    /// Records the conversion of the last frame to pixels for a window of `shown_px`; the caller submits the returned
    /// recorder.
    pub fn record_pixels(
        &mut self,
        shown_px: [u32; 2],
        blue_first: bool,
    ) -> Result<(&mut Recorder, &Buffer<u32>), PlayerError> {
        self.turn = (self.turn + 1) % FRAMES_IN_FLIGHT;
        let recorder = &mut self.recorders[self.turn];
        recorder.wait_for_last()?;
        self.pixel_times = PixelTimes::of(&recorder.passes_ms()?);
        let show = self.options.show;
        let picture = ShownPicture {
            renderer: &self.renderer,
            scene: self.on_device.device(),
            surfaces: self.has_surfaces.then_some(&self.surfaces),
            marks: show.marks().filter(|_| self.has_marks == show.marks()).map(|_| &self.marks),
        };
        self.presenter.record(recorder, show, picture, shown_px, blue_first)?;
        Ok((recorder, self.presenter.pixels()))
    }

    /// The pixels that were recorded last.
    pub fn pixels(&self) -> &Buffer<u32> {
        self.presenter.pixels()
    }

    /// Device times of the pixels of an earlier frame.
    pub fn pixel_times(&self) -> PixelTimes {
        self.pixel_times
    }

    /// Width and height of the last frame; `None` before the first.
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.camera.as_ref().map(|camera| [camera.width, camera.height])
    }

    /// The last frame as the view shows it, at its own size, as 8-bit RGB.
    pub fn rgb8(&mut self) -> Result<Vec<u8>, PlayerError> {
        self.settle()?;
        let size = self.size_px().unwrap_or([1, 1]);
        let (recorder, _) = self.record_pixels(size, false)?;
        let ticket = recorder.submit()?;
        recorder.wait(ticket)?;
        Ok(self.presenter.rgb8()?)
    }

    /// Writes the last frame as the view shows it, at its own size, as PNG.
    pub fn screenshot(&mut self, path: &Path) -> Result<(), PlayerError> {
        let [width, height] = self.size_px().unwrap_or([1, 1]);
        let rgb = self.rgb8()?;
        Ok(write_png(path, &rgb, (width, height))?)
    }

    /// The world point that a pixel of the last frame shows; `None` where no splat is.
    pub fn point_at(&mut self, at_px: [f64; 2]) -> Result<Option<DVec3>, PlayerError> {
        self.settle()?;
        let (Some(frame), Some(camera)) = (self.renderer.frame(), &self.camera) else { return Ok(None) };
        if !camera.has_pixel(at_px) {
            return Ok(None);
        }
        let index = at_px[1] as usize * camera.width as usize + at_px[0] as usize;
        let depths = download_from(&self.gpu, &frame.depths, index, 1)?;
        let depth = depths.first().map_or(0.0, |d| f64::from(d[0]));
        let ray = DVec3::new((at_px[0] - camera.cx) / camera.fx, (at_px[1] - camera.cy) / camera.fy, 1.0);
        let point = camera.position_world() + camera.rotation().transpose() * (ray * depth);
        Ok((depth > 0.0).then_some(point))
    }

    /// The instance that a pixel of the last frame shows; `None` for the background and where no splat is.
    pub fn instance_at(&mut self, at_px: [f64; 2]) -> Result<Option<usize>, PlayerError> {
        let Some(camera) = self.camera.clone().filter(|camera| camera.has_pixel(at_px)) else { return Ok(None) };
        self.settle()?;
        if !self.has_surfaces {
            self.upload_levels()?;
            let options = &self.options.render;
            self.renderer.render_with_surfaces(self.on_device.device(), &camera, options, &mut self.surfaces)?;
        }
        let instance = self.surfaces.at(at_px.map(|v| v as u32))?.map(|point| point.instance as usize);
        Ok(instance.filter(|&k| k < self.scene.instances.len()))
    }

    /// The template of the instance that a pixel of the last frame shows, and the surface point in the template's
    /// frame; `None` for the background and where no splat is.
    pub fn template_point_at(&mut self, at_px: [f64; 2]) -> Result<Option<(u32, DVec3)>, PlayerError> {
        let (Some(instance), Some(point)) = (self.instance_at(at_px)?, self.point_at(at_px)?) else { return Ok(None) };
        let Instance { template, world_from_template, .. } = &self.scene.instances[instance];
        let from_origin = point - world_from_template.translation();
        Ok(Some((*template, world_from_template.linear().inverse() * from_origin)))
    }
}
