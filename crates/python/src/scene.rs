//! `instgs.Scene`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{InstancedScene, SourceRange};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{direction, from_rows, matrix};
use crate::camera::{Camera, size_of};
use crate::device::DeviceName;
use crate::error::{OrRaise, raised, warn};
use crate::gaussians::Gaussians;
use crate::instances::{Group, Instance, groups_of, instances_of};
use crate::{edit, save};

/// A scene: templates, instances of them with offsets, and a background. A plain cloud has only a background.
///
/// Scene(background=None, *, templates=(), instances=(), names=()): Gaussians in the world, Gaussians of each template in its
/// frame, pairs (template, world_from_template) with a 3x4 similarity, and the name of each template's kind of object.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Scene {
    /// Shared with whoever draws or reads it; a change copies what is shared. The lock is never held while a thread waits for the
    /// interpreter: one that has the interpreter may wait for the lock.
    scene: Mutex<Arc<InstancedScene>>,
}

impl Scene {
    /// The Python object of a scene.
    pub(crate) fn of(scene: InstancedScene) -> Self {
        Self { scene: Mutex::new(Arc::new(scene)) }
    }

    /// The scene as it is now, whatever other threads make of it.
    pub(crate) fn snapshot(&self, py: Python<'_>) -> Arc<InstancedScene> {
        if let Ok(scene) = self.scene.try_lock() {
            return scene.clone();
        }
        // Another thread's change may take long.
        py.detach(|| self.lock().clone())
    }

    /// Changes the scene, detached from the interpreter. Other threads wait for it, or go on with what they have of the scene.
    pub(crate) fn change<T: Send>(&self, py: Python<'_>, change: impl FnOnce(&mut InstancedScene) -> T + Send) -> T {
        py.detach(|| change(Arc::make_mut(&mut self.lock())))
    }

    fn lock(&self) -> MutexGuard<'_, Arc<InstancedScene>> {
        // Edits are done as a whole or not at all.
        self.scene.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A template's index and the placed instance's matrix.
type Placed<'py> = (u32, Bound<'py, PyAny>);

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (background = None, *, templates = Vec::new(), instances = Vec::new(), names = Vec::new()))]
    fn new(
        background: Option<PyRef<'_, Gaussians>>,
        templates: Vec<PyRef<'_, Gaussians>>,
        instances: Vec<Placed<'_>>,
        names: Vec<Option<String>>,
    ) -> PyResult<Self> {
        let mut scene = InstancedScene::from_cloud(background.map(|b| b.cloud.clone()).unwrap_or_default());
        scene.templates.sh_degree = templates.iter().map(|t| t.cloud.sh_degree).max().unwrap_or_default();
        for template in &templates {
            let (first, count) = (scene.templates.len() as u32, template.cloud.len() as u32);
            scene.template_ranges.push(SourceRange { first, count });
            scene.templates.append(&template.cloud);
        }
        for (k, (template, rows)) in instances.iter().enumerate() {
            let name = format!("the matrix of instance {k}");
            let world_from_template =
                Similarity::from_rows(matrix(rows, &name)?).map_err(|e| raised(format_args!("{name} {e}")))?;
            scene.instances.push(scene::Instance { template: *template, world_from_template, first_offset: None });
        }
        scene.groups = named_groups(&scene, names)?;
        scene.validate().or_raise()?;
        Ok(Self::of(scene))
    }

    /// Reads a scene: .instgs, .ply, .spz, .sog, .splat or .glb. Remarks on the file are warnings.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let loaded = py.detach(|| instgs_io::load_scene(&path)).or_raise()?;
        for what in loaded.warnings() {
            warn(py, format_args!("{}: {what}", path.display()))?;
        }
        Ok(Self::of(loaded.scene))
    }

    /// Writes the scene: .instgs, .glb, .usda, .usdc and .html (a page that draws it) keep instances; .ply, .spz and .sog have
    /// them expanded.
    ///
    /// pack, for .instgs and .html: "f32", "f16", "q8" or "small"; with data, a data set's folder, "small" is only as precise as its
    /// views need for pictures of picture_psnr dB. finish: number of steps, some 400, in which the written scene is trained
    /// through its rounding with the photos of data; this one does not change. run: the folder of the scene's run, which says
    /// their width, masks, background and exposures; without it they are taken at full size, on black. Ctrl-C is looked for
    /// after each view and step, and before the file is written. up: the direction that becomes +y of .glb, .usda and .usdc,
    /// and points up in .html. device: for data. up and device are warned of where they are not used.
    #[pyo3(signature = (
        path, pack = None, *, data = None, picture_psnr = None, finish = 0, run = None, up = None, device = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        pack: Option<&str>,
        data: Option<PathBuf>,
        picture_psnr: Option<f64>,
        finish: i64,
        run: Option<PathBuf>,
        up: Option<Bound<'_, PyAny>>,
        device: Option<DeviceName>,
    ) -> PyResult<()> {
        let up = up.map(|up| direction(&up, "up")).transpose()?;
        let how = save::How { pack: pack.map(save::parse_pack).transpose()?, data, picture_psnr, finish, run, up };
        save::save(py, &self.snapshot(py), &path, how, device)
    }

    /// An independent copy.
    fn copy(&self, py: Python<'_>) -> Self {
        Self { scene: Mutex::new(self.snapshot(py)) }
    }

    /// Changes instances; see the package's documentation for operations and their values.
    ///
    /// scene.edit("move", "group:car", by=(1, 0, 0)) ... which: an index, a list of them, or "id:7", "group:car", "template:0".
    /// Returns {"changed", "added", "removed", "warnings"}: indices of instances, and remarks. Raises Error if it is not
    /// possible; the scene is then unchanged. Remarks are warnings too, after the change: a filter that makes errors of them
    /// raises although the scene has changed.
    #[pyo3(signature = (operation, which = None, **values))]
    fn edit<'py>(
        &self,
        py: Python<'py>,
        operation: &str,
        which: Option<Bound<'py, PyAny>>,
        values: Option<Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        edit::edit(py, self, operation, which.as_ref(), values.as_ref())
    }

    /// Every instance's Gaussians in the world, in flat order, then the background: a plain cloud that looks the same.
    fn flatten(&self, py: Python<'_>) -> Gaussians {
        let scene = self.snapshot(py);
        Gaussians { cloud: py.detach(move || scene.flatten()) }
    }

    /// count cameras on a circle around the scene, as render's --orbit beside no run. size: (width, height), pixels; up: a
    /// direction, by default that of a flat scene's normal, else -y.
    #[pyo3(signature = (count, size = (1280, 720), up = None))]
    fn orbit(
        &self,
        py: Python<'_>,
        count: i64,
        size: (i64, i64),
        up: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Vec<Camera>> {
        let up = up.map(|up| direction(&up, "up")).transpose()?;
        let size = size_of(size)?;
        let count = u32::try_from(count).map_err(|_| raised(format_args!("an orbit cannot have {count} cameras")))?;
        let cameras = Orbit::around(&self.snapshot(py), up).cameras(count, size);
        let checked = |camera: scene::Camera| camera.validate().map(|()| Camera { camera }).or_raise();
        cameras.into_iter().map(checked).collect()
    }

    /// The instances, in their order.
    #[getter]
    fn instances(&self, py: Python<'_>) -> Vec<Instance> {
        instances_of(&self.snapshot(py))
    }

    /// The groups of instances with their names and mask ids.
    #[getter]
    fn groups(&self, py: Python<'_>) -> Vec<Group> {
        groups_of(&self.snapshot(py))
    }

    /// The Gaussians of each template, in its frame.
    #[getter]
    fn templates(&self, py: Python<'_>) -> Vec<Gaussians> {
        let scene = self.snapshot(py);
        let template = |&range: &SourceRange| Gaussians { cloud: scene.templates.range(range) };
        scene.template_ranges.iter().map(template).collect()
    }

    /// The Gaussians in the world that belong to no instance; may be set.
    #[getter]
    fn background(&self, py: Python<'_>) -> Gaussians {
        Gaussians { cloud: self.snapshot(py).background.clone() }
    }

    #[setter]
    fn set_background(&self, py: Python<'_>, background: PyRef<'_, Gaussians>) {
        let background = background.cloud.clone();
        self.change(py, |scene| scene.background = background);
    }

    /// The Gaussians that instance k has beside its template's, in the template's frame.
    fn own(&self, py: Python<'_>, k: i64) -> PyResult<Gaussians> {
        let scene = self.snapshot(py);
        let Some(k) = usize::try_from(k).ok().filter(|&k| k < scene.instances.len()) else {
            return Err(raised(format_args!("there is no instance {k}: there are {}", scene.instances.len())));
        };
        Ok(Gaussians { cloud: scene.own.range(scene.own_range(k)) })
    }

    /// The offset records: {"means": [M, 3], "sh_dc": [M, 3], "opacity_logits": [M]}. Instance.first_offset says where an
    /// instance's begin: one record for each Gaussian of its template.
    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (out, scene) = (PyDict::new(py), self.snapshot(py));
        let offsets = &scene.offsets;
        out.set_item("means", from_rows(py, &offsets.means)?)?;
        out.set_item("sh_dc", from_rows(py, &offsets.sh_dc)?)?;
        out.set_item("opacity_logits", numpy::PyArray1::from_slice(py, &offsets.opacity_logits))?;
        Ok(out)
    }

    /// The number of Gaussians of each part: "template", "offsets" (records), "own", "background" and "expanded", and "hidden" if there are any.
    #[getter]
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::json::to_python(py, &instgs_eval::Counts::of(&self.snapshot(py)))
    }

    /// Where the scene came from, free text.
    #[getter]
    fn source(&self, py: Python<'_>) -> String {
        self.snapshot(py).source.clone()
    }

    /// Number of Gaussians after expanding all instances.
    fn __len__(&self, py: Python<'_>) -> usize {
        usize::try_from(self.snapshot(py).expanded_len()).unwrap_or(usize::MAX)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let scene = self.snapshot(py);
        format!(
            "<instgs.Scene: {} Gaussians stored, {} expanded, {} templates, {} instances>",
            scene.source_len(),
            scene.expanded_len(),
            scene.template_ranges.len(),
            scene.instances.len()
        )
    }
}

/// A group for each named template; the mask id of instance k is k + 1.
fn named_groups(scene: &InstancedScene, names: Vec<Option<String>>) -> PyResult<Vec<scene::Group>> {
    if names.len() > scene.template_ranges.len() {
        return Err(raised(format_args!("{} names for {} templates", names.len(), scene.template_ranges.len())));
    }
    let ids = |template: u32| {
        let all = (1..).zip(&scene.instances);
        all.filter(|(_, instance)| instance.template == template).map(|(id, _)| id).collect()
    };
    let group = |(template_id, name)| scene::Group { template_id, name: Some(name), instance_ids: ids(template_id) };
    Ok((0..).zip(names).filter_map(|(template, name)| Some((template, name?))).map(group).collect())
}
