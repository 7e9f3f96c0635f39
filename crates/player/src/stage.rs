//! A scene on the device, and pictures of it as pixels of a window.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::swapchain::UI_PASS;
use instgs_io::picture_png::write_png;
use instgs_io::{ExportFormat, export_scene, save_scene};
use instgs_vk::gpu::staging::download_from;
use instgs_vk::gpu::{Buffer, Gpu, Recorder};
use instgs_vk::render::{
    Ahead, Arrived, DeviceScene, ExtraPasses, FRAMES_IN_FLIGHT, FrameStats, InstanceLook, MarkShape, Marks, Presenter,
    RenderOptions, Renderer, Show, ShownPicture, Surfaces,
};
use instgs_vk::scene::edit::{Edit, EditOutcome};
use instgs_vk::scene::{Camera, Instance, InstancedScene};

use super::editor::{Changed, Editor};
use super::error::PlayerError;

/// How pictures look.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageOptions {
    /// Of the render passes; `antialias` is the scene's own unless it says otherwise.
    pub render: RenderOptions,
    /// What is shown.
    pub show: Show,
}

/// Milliseconds that the device took to make pixels of a picture; `None` before the first, or if it has no clock. The copy
/// into the window's image is in neither: it waits until the window has one to give.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelTimes {
    /// Kernel `present`.
    pub present_ms: Option<f64>,
    /// Drawing the interface over the picture; `None` without a window.
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

/// A scene and the passes that draw it.
pub struct Stage {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    presenter: Presenter,
    surfaces: Surfaces,
    marks: Marks,
    /// Pictures that the device may still be drawing.
    ahead: Ahead,
    /// For making pixels, in turn: one for each picture on its way.
    recorders: [Recorder; FRAMES_IN_FLIGHT],
    turn: usize,
    /// Of the pixels that `recorders[turn]` made last.
    pixel_times: PixelTimes,
    scene: InstancedScene,
    device_scene: DeviceScene,
    /// How pictures look; may change between pictures.
    pub options: StageOptions,
    /// Of the last picture.
    camera: Option<Camera>,
    /// Depth slabs that the last complete picture took.
    slabs: u32,
    /// Of pictures that are complete, until they are asked for.
    arrived: Vec<FrameStats>,
    /// The surfaces are the last picture's.
    has_surfaces: bool,
    /// The marks are the last picture's, in this shape.
    has_marks: Option<MarkShape>,
    editor: Editor,
}

impl Stage {
    /// Uploads a scene.
    ///
    /// # Errors
    /// The device refuses it.
    pub fn new(gpu: &Arc<Gpu>, scene: InstancedScene, options: StageOptions) -> Result<Self, PlayerError> {
        let renderer = Renderer::profiled(gpu)?;
        Ok(Self {
            gpu: gpu.clone(),
            presenter: Presenter::new(gpu, &renderer)?,
            surfaces: Surfaces::new(gpu)?,
            marks: Marks::new(gpu)?,
            ahead: Ahead::new(gpu)?,
            recorders: [Recorder::with_profiler(gpu)?, Recorder::with_profiler(gpu)?],
            turn: 0,
            pixel_times: PixelTimes::default(),
            device_scene: renderer.upload_for(&scene, &options.render)?,
            scene,
            renderer,
            options,
            camera: None,
            slabs: 0,
            arrived: Vec::new(),
            has_surfaces: false,
            has_marks: None,
            editor: Editor::default(),
        })
    }

    /// Shows another scene in place of this one, whose memory goes first: both may not fit. Nothing is chosen or can be taken
    /// back.
    ///
    /// # Errors
    /// The device refuses it: an empty scene is shown.
    pub fn open(&mut self, scene: InstancedScene, options: StageOptions) -> Result<(), PlayerError> {
        while self.ahead.arrive()?.is_some() {}
        (self.scene, self.options, self.editor) = (InstancedScene::default(), options, Editor::default());
        (self.camera, self.slabs, self.has_surfaces, self.has_marks) = (None, 0, false, None);
        self.arrived.clear();
        self.renderer.forget_picture();
        self.device_scene = self.renderer.upload_for(&self.scene, &options.render)?;
        self.device_scene = self.renderer.upload_for(&scene, &options.render)?;
        self.scene = scene;
        Ok(())
    }

    /// The same scene, with what is chosen and can be taken back, on another device.
    ///
    /// # Errors
    /// The device refuses it.
    pub fn reopened(gpu: &Arc<Gpu>, old: Self) -> Result<Self, PlayerError> {
        let Self { scene, options, editor, .. } = old;
        let mut stage = Self { editor, ..Self::new(gpu, scene, options)? };
        stage.show(stage.editor.hidden().clone())?;
        Ok(stage)
    }

    /// The scene.
    pub fn scene(&self) -> &InstancedScene {
        &self.scene
    }

    /// Bytes of the scene on the device.
    pub fn device_bytes(&self) -> u64 {
        self.device_scene.bytes()
    }

    /// Draws a picture and leaves it on the device.
    pub fn draw(&mut self, camera: &Camera) -> Result<(), PlayerError> {
        while let Some(arrived) = self.ahead.arrive()? {
            self.note(arrived);
        }
        self.upload_levels()?;
        let mut stats = self.render(camera)?;
        if stats.slabs > 1 && matches!(self.options.show, Show::TileLoad(_)) {
            // The load is that of the last depth slab: a picture that overflowed its buffers is drawn with those that it grew.
            stats = self.render(camera)?;
        }
        self.note(Arrived::Complete(stats));
        self.camera = Some(camera.clone());
        Ok(())
    }

    fn render(&mut self, camera: &Camera) -> Result<FrameStats, PlayerError> {
        self.prepare_looks()?;
        let options = self.render_options();
        let extra = ExtraPasses {
            surfaces: self.has_surfaces.then_some(&mut self.surfaces),
            marks: self.has_marks.map(|shape| (&mut self.marks, shape)),
        };
        Ok(self.renderer.render_with(&self.device_scene, camera, &options, extra)?)
    }

    /// Notes what the next picture will have besides colours, and says which instances are chosen.
    fn prepare_looks(&mut self) -> Result<(), PlayerError> {
        self.has_surfaces = self.needs_surfaces();
        self.has_marks = self.options.show.marks();
        if self.has_surfaces {
            self.presenter.set_instances(&self.looks())?;
        }
        Ok(())
    }

    /// Options of the render passes.
    fn render_options(&self) -> RenderOptions {
        let mut options = self.options.render;
        if matches!(self.options.show, Show::Offsets(_)) {
            // The merged Gaussians of coarser levels have offsets of their own.
            options.lod_error_px = 0.0;
        }
        options
    }

    /// What the passes did for the pictures that have been completed since this was asked last, in order.
    pub fn take_arrived(&mut self) -> Vec<FrameStats> {
        std::mem::take(&mut self.arrived)
    }

    /// True if the picture is complete.
    fn note(&mut self, arrived: Arrived) -> bool {
        let Arrived::Complete(stats) = arrived else { return false };
        self.slabs = stats.slabs;
        self.arrived.push(stats);
        true
    }

    /// As [`Stage::draw`], but does not wait for the picture if it is like the ones before: of their size, and in one depth slab.
    /// After the last picture comes [`Stage::settle`].
    pub fn draw_ahead(&mut self, camera: &Camera) -> Result<(), PlayerError> {
        let alike = self.size_px() == Some([camera.width, camera.height]) && self.slabs == 1;
        if !alike || !self.has_wanted_levels() {
            return self.draw(camera);
        }
        while self.ahead.is_full() {
            if !self.ahead.arrive()?.is_some_and(|arrived| self.note(arrived)) {
                return self.draw(camera);
            }
        }
        self.prepare_looks()?;
        let options = self.render_options();
        let extra = ExtraPasses {
            surfaces: self.has_surfaces.then_some(&mut self.surfaces),
            marks: self.has_marks.map(|shape| (&mut self.marks, shape)),
        };
        self.renderer.submit_ahead(&mut self.ahead, &self.device_scene, camera, &options, extra)?;
        self.camera = Some(camera.clone());
        Ok(())
    }

    /// As [`Stage::draw_ahead`]; but where the device has no room for how the scene is shown, it is shown in a way that takes
    /// less, and the words say why and which.
    pub fn draw_what_fits(&mut self, camera: &Camera) -> Result<Option<String>, PlayerError> {
        let mut words = None;
        loop {
            match self.draw_ahead(camera) {
                Err(error) if error.is_out_of_memory() => match self.ask_for_less()? {
                    Some(instead) => words = Some(format!("{instead}: {error}")),
                    None => return Err(error),
                },
                done => return done.map(|()| words),
            }
        }
    }

    /// Gives up the next of what takes memory besides the scene itself; `None` if there is nothing of that kind.
    fn ask_for_less(&mut self) -> Result<Option<&'static str>, PlayerError> {
        if self.options.render.lod_error_px > 0.0 {
            self.options.render.lod_error_px = 0.0;
            self.upload()?;
            return Ok(Some("detail is not merged"));
        }
        if self.options.show.needs_surfaces() || self.options.show.marks().is_some() {
            self.options.show = Show::Color;
            return Ok(Some("the view is the colours again"));
        }
        if !self.editor.chosen().is_empty() {
            self.editor.click(None, false);
            return Ok(Some("nothing is chosen any more"));
        }
        Ok(None)
    }

    /// Pictures that the device may still be drawing.
    pub fn in_flight(&self) -> usize {
        self.ahead.pending_len()
    }

    /// Waits for the last picture. False if it had to be drawn again, since a buffer was too small for it: what was shown
    /// is an older one.
    pub fn settle(&mut self) -> Result<bool, PlayerError> {
        let mut complete = true;
        while let Some(arrived) = self.ahead.arrive()? {
            complete = self.note(arrived);
        }
        if let Some(camera) = self.camera.clone().filter(|_| !complete) {
            self.draw(&camera)?;
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
        self.device_scene.has_levels() == (self.options.render.lod_error_px > 0.0)
    }

    /// Levels of detail come and go with the error that is allowed, so that full quality is what it is without them.
    fn upload_levels(&mut self) -> Result<(), PlayerError> {
        if !self.has_wanted_levels() {
            self.upload()?;
        }
        Ok(())
    }

    /// Puts the scene on the device in place of the one that is there, whose memory goes first: both may not fit.
    fn upload(&mut self) -> Result<(), PlayerError> {
        let options = &self.options.render;
        self.device_scene = self.renderer.upload_for(&InstancedScene::default(), options)?;
        self.device_scene = self.renderer.upload_for(&self.scene, options)?;
        self.show(self.editor.hidden().clone())
    }

    /// Records the last picture as pixels of a window of `shown_px`; to be submitted with the recorder that comes back.
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
            scene: &self.device_scene,
            surfaces: self.has_surfaces.then_some(&self.surfaces),
            marks: show.marks().filter(|_| self.has_marks == show.marks()).map(|_| &self.marks),
        };
        self.presenter.record(recorder, show, picture, shown_px, blue_first)?;
        Ok((recorder, self.presenter.pixels()))
    }

    /// What the device took for the pixels of an earlier picture.
    pub fn pixel_times(&self) -> PixelTimes {
        self.pixel_times
    }

    /// Width and height of the last picture; `None` before it.
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.camera.as_ref().map(|camera| [camera.width, camera.height])
    }

    /// The last picture, as it is shown and at its own size, as bytes red, green, blue.
    pub fn rgb8(&mut self) -> Result<Vec<u8>, PlayerError> {
        self.settle()?;
        let size = self.size_px().unwrap_or([1, 1]);
        let (recorder, _) = self.record_pixels(size, false)?;
        let ticket = recorder.submit()?;
        recorder.wait(ticket)?;
        Ok(self.presenter.rgb8()?)
    }

    /// Writes the last picture, as it is shown and at its own size, as PNG.
    pub fn screenshot(&mut self, path: &Path) -> Result<(), PlayerError> {
        let [width, height] = self.size_px().unwrap_or([1, 1]);
        let rgb = self.rgb8()?;
        Ok(write_png(path, &rgb, (width, height))?)
    }

    /// The point of the world that a pixel of the last picture shows; `None` where nothing is.
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

    /// The instance that a pixel of the last picture shows; `None` for the background and where nothing is.
    pub fn instance_at(&mut self, at_px: [f64; 2]) -> Result<Option<usize>, PlayerError> {
        let Some(camera) = self.camera.clone().filter(|camera| camera.has_pixel(at_px)) else { return Ok(None) };
        self.settle()?;
        if !self.has_surfaces {
            self.upload_levels()?;
            let options = &self.options.render;
            self.renderer.render_with_surfaces(&self.device_scene, &camera, options, &mut self.surfaces)?;
        }
        let instance = self.surfaces.at(at_px.map(|v| v as u32))?.map(|point| point.instance as usize);
        Ok(instance.filter(|&k| k < self.scene.instances.len()))
    }

    /// The template of the instance that a pixel of the last picture shows, and the point it shows, in the template's frame;
    /// `None` for the background and where nothing is.
    pub fn template_point_at(&mut self, at_px: [f64; 2]) -> Result<Option<(u32, DVec3)>, PlayerError> {
        let (Some(instance), Some(point)) = (self.instance_at(at_px)?, self.point_at(at_px)?) else { return Ok(None) };
        let Instance { template, world_from_template, .. } = &self.scene.instances[instance];
        let from_origin = point - world_from_template.translation();
        Ok(Some((*template, world_from_template.linear().inverse() * from_origin)))
    }

    /// What is chosen and what can be taken back.
    pub fn editor(&self) -> &Editor {
        &self.editor
    }

    /// See [`Editor::click`].
    pub fn click(&mut self, instance: Option<usize>, more: bool) {
        self.editor.click(instance, more);
    }

    /// See [`Editor::choose_alike`].
    pub fn choose_alike(&mut self) {
        self.editor.choose_alike(&self.scene);
    }

    /// See [`Editor::choose_group`].
    pub fn choose_group(&mut self) {
        self.editor.choose_group(&self.scene);
    }

    /// See [`Editor::hide_chosen`]; false if nothing is chosen.
    pub fn hide_chosen(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.hide_chosen();
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// See [`Editor::show_all`]; false if nothing is hidden.
    pub fn show_all(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.show_all();
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Does an edit, in the scene and on the device; the words say why it cannot be done.
    pub fn edit(&mut self, edit: &Edit) -> Result<Result<EditOutcome, String>, PlayerError> {
        let unsaved = self.editor.is_unsaved();
        match self.editor.apply(&mut self.scene, edit) {
            Ok((outcome, changed)) => {
                let refused = self.follow_or(&changed, |editor, scene| editor.refuse(scene, unsaved))?;
                Ok(refused.map_or(Ok(outcome), Err))
            }
            Err(error) => Ok(Err(error.to_string())),
        }
    }

    /// Does an edit in place of the one before, as a drag does; see [`Editor::apply_live`].
    pub fn edit_live(&mut self, edit: &Edit) -> Result<Result<EditOutcome, String>, PlayerError> {
        let (outcome, changed) = self.editor.apply_live(&mut self.scene, edit);
        let refused = self.follow_or(&changed, |editor, scene| drop(editor.cancel(scene)))?;
        Ok(refused.map_or(outcome.map_err(|error| error.to_string()), Err))
    }

    /// See [`Editor::finish`].
    pub fn finish_live(&mut self) {
        self.editor.finish();
    }

    /// See [`Editor::cancel`].
    pub fn cancel_live(&mut self) -> Result<(), PlayerError> {
        let changed = self.editor.cancel(&mut self.scene);
        self.follow(&changed)
    }

    /// Takes the last edit back; false if there is none. The words say why the device refuses it, which leaves it as it is.
    pub fn undo(&mut self) -> Result<Result<bool, String>, PlayerError> {
        self.step(false)
    }

    /// Does again what was taken back last; false if there is nothing. Words as of [`Stage::undo`].
    pub fn redo(&mut self) -> Result<Result<bool, String>, PlayerError> {
        self.step(true)
    }

    fn step(&mut self, redo: bool) -> Result<Result<bool, String>, PlayerError> {
        let unsaved = self.editor.is_unsaved();
        let done = if redo { self.editor.redo(&mut self.scene) } else { self.editor.undo(&mut self.scene) };
        let Some(changed) = done else { return Ok(Ok(false)) };
        let refused = self.follow_or(&changed, |editor, scene| editor.refuse_step(scene, redo, unsaved))?;
        Ok(refused.map_or(Ok(true), Err))
    }

    /// Writes the scene as `.instgs`.
    pub fn save(&mut self, path: &Path) -> Result<(), PlayerError> {
        self.write_copy(path)?;
        self.editor.saved();
        Ok(())
    }

    /// The same, but what is unsaved stays so.
    pub fn write_copy(&self, path: &Path) -> Result<(), PlayerError> {
        Ok(save_scene(path, &self.scene)?)
    }

    /// Writes the scene, hidden instances included, in the format that the file's ending names; see [`export_scene`].
    pub fn export(&self, path: &Path, up: DVec3) -> Result<(), PlayerError> {
        export_scene(path, &self.scene, ExportFormat::of(path, None)?, up)?;
        Ok(())
    }

    /// As [`Stage::follow`]; but what the device refuses, since there is no room for it, is taken back, and the words say
    /// why.
    fn follow_or(
        &mut self,
        changed: &Changed,
        take_back: impl FnOnce(&mut Editor, &mut InstancedScene),
    ) -> Result<Option<String>, PlayerError> {
        match self.follow(changed) {
            Err(error) if !error.is_lost() => {
                take_back(&mut self.editor, &mut self.scene);
                self.upload()?;
                Ok(Some(error.to_string()))
            }
            done => done.map(|()| None),
        }
    }

    /// Makes the device's scene that of the host.
    fn follow(&mut self, changed: &Changed) -> Result<(), PlayerError> {
        match changed {
            Changed::Places(instances) => {
                let place = |&k: &usize| (k, self.scene.instances[k].world_from_template);
                let places: Vec<_> = instances.iter().map(place).collect();
                self.device_scene.place_instances(&places)?;
            }
            Changed::Shown(instances) => self.show(instances.iter().copied())?,
            Changed::Everything => self.upload()?,
        }
        Ok(())
    }

    /// Makes the device draw these instances, or leave them out, as the editor says.
    fn show(&mut self, instances: impl IntoIterator<Item = usize>) -> Result<(), PlayerError> {
        let shown: Vec<_> = instances.into_iter().map(|k| (k, !self.editor.hidden().contains(&k))).collect();
        Ok(self.device_scene.show_instances(&shown)?)
    }
}
