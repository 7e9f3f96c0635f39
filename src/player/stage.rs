//! A scene on the device, and pictures of it as pixels of a window.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use crate::gpu::staging::download;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::io::picture_png::write_png;
use crate::io::save_scene;
use crate::render::{DeviceScene, FrameStats, Presenter, RenderOptions, Renderer, Show, Surfaces};
use crate::scene::edit::{Edit, EditOutcome};
use crate::scene::{Camera, InstancedScene};

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

/// A scene and the passes that draw it.
pub struct Stage {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    presenter: Presenter,
    surfaces: Surfaces,
    recorder: Recorder,
    scene: InstancedScene,
    device_scene: DeviceScene,
    /// How pictures look; may change between pictures.
    pub options: StageOptions,
    /// Of the last picture.
    camera: Option<Camera>,
    /// The surfaces are the last picture's.
    has_surfaces: bool,
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
            recorder: Recorder::with_profiler(gpu)?,
            device_scene: renderer.upload(&scene)?,
            scene,
            renderer,
            options,
            camera: None,
            has_surfaces: false,
            editor: Editor::default(),
        })
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
    pub fn draw(&mut self, camera: &Camera) -> Result<FrameStats, PlayerError> {
        let (scene, options) = (&self.device_scene, &self.options.render);
        self.has_surfaces = self.options.show == Show::Instances || !self.editor.chosen().is_empty();
        let stats = if self.has_surfaces {
            self.presenter.set_chosen(&self.editor.chosen_flags(&self.scene))?;
            self.renderer.render_with_surfaces(scene, camera, options, &mut self.surfaces)?
        } else {
            self.renderer.render(scene, camera, options)?
        };
        self.camera = Some(camera.clone());
        Ok(stats)
    }

    /// Records the last picture as pixels of a window of `shown_px`; to be submitted with the recorder that comes back.
    pub fn record_pixels(
        &mut self,
        shown_px: [u32; 2],
        blue_first: bool,
    ) -> Result<(&mut Recorder, &Buffer<u32>), PlayerError> {
        let surfaces = self.has_surfaces.then_some(&self.surfaces);
        let show = (self.options.show, surfaces);
        self.presenter.record(&mut self.recorder, &self.renderer, show, (shown_px, blue_first))?;
        Ok((&mut self.recorder, self.presenter.pixels()))
    }

    /// Milliseconds that the device took for the pixels submitted last, once it is done; `None` if it has no clock.
    pub fn present_ms(&self) -> Result<Option<f64>, PlayerError> {
        let passes = self.recorder.passes_ms()?;
        Ok((!passes.is_empty()).then(|| passes.iter().map(|(_, ms)| ms).sum()))
    }

    /// Width and height of the last picture; `None` before it.
    pub fn size_px(&self) -> Option<[u32; 2]> {
        self.camera.as_ref().map(|camera| [camera.width, camera.height])
    }

    /// The last picture, as it is shown and at its own size, as bytes red, green, blue.
    pub fn rgb8(&mut self) -> Result<Vec<u8>, PlayerError> {
        let size = self.size_px().unwrap_or([1, 1]);
        self.record_pixels(size, false)?;
        let ticket = self.recorder.submit()?;
        self.recorder.wait(ticket)?;
        Ok(self.presenter.rgb8()?)
    }

    /// Writes the last picture, as it is shown and at its own size, as PNG.
    pub fn screenshot(&mut self, path: &Path) -> Result<(), PlayerError> {
        let [width, height] = self.size_px().unwrap_or([1, 1]);
        let rgb = self.rgb8()?;
        Ok(write_png(path, &rgb, (width, height))?)
    }

    /// The point of the world that a pixel of the last picture shows; `None` where nothing is.
    pub fn point_at(&self, at_px: [f64; 2]) -> Result<Option<DVec3>, PlayerError> {
        let (Some(frame), Some(camera)) = (self.renderer.frame(), &self.camera) else { return Ok(None) };
        if !camera.has_pixel(at_px) {
            return Ok(None);
        }
        let index = at_px[1] as usize * camera.width as usize + at_px[0] as usize;
        let depths = download(&self.gpu, &frame.depths, index + 1)?;
        let depth = depths.last().map_or(0.0, |d| f64::from(d[0]));
        let ray = DVec3::new((at_px[0] - camera.cx) / camera.fx, (at_px[1] - camera.cy) / camera.fy, 1.0);
        let point = camera.position_world() + camera.rotation().transpose() * (ray * depth);
        Ok((depth > 0.0).then_some(point))
    }

    /// The instance that a pixel of the last picture shows; `None` for the background and where nothing is.
    pub fn instance_at(&mut self, at_px: [f64; 2]) -> Result<Option<usize>, PlayerError> {
        let Some(camera) = self.camera.clone().filter(|camera| camera.has_pixel(at_px)) else { return Ok(None) };
        if !self.has_surfaces {
            let options = &self.options.render;
            self.renderer.render_with_surfaces(&self.device_scene, &camera, options, &mut self.surfaces)?;
        }
        let instance = self.surfaces.instance_at(at_px.map(|v| v as u32))?.map(|k| k as usize);
        Ok(instance.filter(|&k| k < self.scene.instances.len()))
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

    /// Does an edit, in the scene and on the device; the words say why it cannot be done.
    pub fn edit(&mut self, edit: &Edit) -> Result<Result<EditOutcome, String>, PlayerError> {
        match self.editor.apply(&mut self.scene, edit) {
            Ok((outcome, changed)) => {
                self.follow(&changed)?;
                Ok(Ok(outcome))
            }
            Err(error) => Ok(Err(error.to_string())),
        }
    }

    /// Takes the last edit back; false if there is none.
    pub fn undo(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.undo(&mut self.scene);
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Does again what was taken back last; false if there is nothing.
    pub fn redo(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.redo(&mut self.scene);
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Writes the scene as `.instgs`.
    pub fn save(&mut self, path: &Path) -> Result<(), PlayerError> {
        save_scene(path, &self.scene)?;
        self.editor.saved();
        Ok(())
    }

    /// Makes the device's scene that of the host.
    fn follow(&mut self, changed: &Changed) -> Result<(), PlayerError> {
        match changed {
            Changed::Places(instances) => {
                for &k in instances {
                    let place = &self.scene.instances[k].world_from_template;
                    self.device_scene.place_instance(&self.gpu, k, place)?;
                }
            }
            Changed::Everything => self.device_scene = self.renderer.upload(&self.scene)?,
        }
        Ok(())
    }
}
