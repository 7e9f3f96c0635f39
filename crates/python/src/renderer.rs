//! `instgs.Renderer`: draws scenes on a device.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use instgs_vk::gpu::Gpu;
use instgs_vk::render::{self, DeviceScene, RenderError, RenderOptions, Surfaces};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::Selector;
use pyo3::prelude::*;

use crate::camera::Camera;
use crate::device::{DeviceName, check_validation, open_device};
use crate::edit_values::selector;
use crate::error::{OrRaise, raised};
use crate::look::Look;
use crate::picture::{Drawn, Picture};
use crate::scene::Scene;

/// Draws scenes on one Vulkan device. The last scene stays on the device until another one, or a changed one, is drawn.
///
/// Renderer(device=None): a device's number in devices() or a part of its name; by default that of the environment variable
/// INSTGS_DEVICE, else the fastest kind. Raises Error if there is none.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Renderer {
    gpu: Arc<Gpu>,
    state: Mutex<State>,
}

/// What a renderer keeps between pictures.
struct State {
    renderer: render::Renderer,
    surfaces: Surfaces,
    uploaded: Option<Uploaded>,
}

/// The scene on the device.
struct Uploaded {
    /// The scene that it is of. Weak, so that an edit of a scene that nobody else holds need not copy it; the edit then ends
    /// this reference.
    of: Weak<InstancedScene>,
    on_device: DeviceScene,
    hidden: BTreeSet<usize>,
}

impl State {
    /// Draws a picture, and uploads the scene first if it is not the last one.
    fn draw(
        &mut self,
        scene: &Arc<InstancedScene>,
        camera: &Camera,
        options: &RenderOptions,
        hidden: &BTreeSet<usize>,
        ids: bool,
    ) -> Result<Drawn, RenderError> {
        let with_levels = options.lod_error_px > 0.0;
        let is_there = self.uploaded.as_ref().is_some_and(|uploaded| {
            uploaded.of.ptr_eq(&Arc::downgrade(scene)) && (uploaded.on_device.has_levels() || !with_levels)
        });
        if !is_there {
            // The old scene's memory may be needed for the new one.
            self.uploaded = None;
            let on_device = self.renderer.upload_for(scene, options)?;
            self.uploaded = Some(Uploaded { of: Arc::downgrade(scene), on_device, hidden: BTreeSet::new() });
        }
        let Some(Uploaded { on_device, hidden: now_hidden, .. }) = &mut self.uploaded else {
            unreachable!("uploaded above")
        };
        let changes: Vec<(usize, bool)> =
            now_hidden.symmetric_difference(hidden).map(|k| (*k, now_hidden.contains(k))).collect();
        if !changes.is_empty() {
            on_device.show_instances(&changes)?;
            now_hidden.clone_from(hidden);
        }
        let (stats, surfaces) = if ids {
            let stats = self.renderer.render_with_surfaces(on_device, &camera.camera, options, &mut self.surfaces)?;
            (stats, Some(self.surfaces.download()?))
        } else {
            (self.renderer.render(on_device, &camera.camera, options)?, None)
        };
        Ok(Drawn::new(self.renderer.download()?, surfaces, scene.instances.len(), &stats))
    }
}

impl Renderer {
    /// Opens a device.
    pub(crate) fn open(py: Python<'_>, device: Option<DeviceName>) -> PyResult<Self> {
        let gpu = open_device(py, device)?;
        let state = || -> Result<State, RenderError> {
            Ok(State { renderer: render::Renderer::new(&gpu)?, surfaces: Surfaces::new(&gpu)?, uploaded: None })
        };
        let state = Mutex::new(py.detach(state).or_raise()?);
        Ok(Self { gpu, state })
    }
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(signature = (device = None))]
    fn new(py: Python<'_>, device: Option<DeviceName>) -> PyResult<Self> {
        Self::open(py, device)
    }

    /// Draws the scene as the camera sees it.
    ///
    /// background: rgb behind everything; near: depth of the near plane, scene units; antialias, dilation (px^2): the pixel
    /// filter, by default the scene's; lod: merge far Gaussians with an error of at most that many pixels; hide: instances to
    /// leave out, as edits select them, [] for none; ids: whether instance_ids are made. Raises Error.
    #[pyo3(signature = (
        scene, camera, *, background = None, near = None, antialias = None, dilation = None, lod = None, hide = None, ids = true
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn render(
        &self,
        py: Python<'_>,
        scene: &Scene,
        camera: &Camera,
        background: Option<[f32; 3]>,
        near: Option<f32>,
        antialias: Option<bool>,
        dilation: Option<f32>,
        lod: Option<f32>,
        hide: Option<Bound<'_, PyAny>>,
        ids: bool,
    ) -> PyResult<Picture> {
        let scene = scene.snapshot(py);
        let hidden = hide.map_or_else(|| Ok(BTreeSet::new()), |hide| hidden_by(&hide, &scene))?;
        let options = Look { background, near, antialias, dilation, lod }.options(&scene);
        let drawn = py.detach(|| {
            // A panic in another thread leaves nothing half done that the next picture would use.
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            state.draw(&scene, camera, &options, &hidden, ids)
        });
        let drawn = drawn.or_raise()?;
        check_validation(&self.gpu)?;
        drawn.into_picture(py)
    }

    /// Name of the device.
    #[getter]
    fn device(&self) -> &str {
        &self.gpu.caps().name
    }

    fn __repr__(&self) -> String {
        format!("<instgs.Renderer on {}>", self.gpu.caps().name)
    }
}

/// The instances to leave out, as edits select them; an empty list leaves out none.
fn hidden_by(hide: &Bound<'_, PyAny>, scene: &InstancedScene) -> PyResult<BTreeSet<usize>> {
    match selector(hide)? {
        Selector::Indices(none) if none.is_empty() => Ok(BTreeSet::new()),
        which => {
            let found = which.resolve(scene).map_err(|e| raised(format_args!("hide: {e}")))?;
            Ok(found.into_iter().collect())
        }
    }
}
