//! `instgs.Instance` and `instgs.Group`: what a scene's instances are, for reading.

use instgs_vk::scene;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::instance_centres;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::from_rows;

/// One placed copy of a template, as it was when the scene was asked.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Instance {
    /// Its index in the scene, which edits take.
    #[pyo3(get)]
    index: usize,
    /// Index of its template.
    #[pyo3(get)]
    template: u32,
    /// Its mask id, or None.
    #[pyo3(get)]
    id: Option<u32>,
    /// Name of its group, or None.
    #[pyo3(get)]
    group: Option<String>,
    /// Number of Gaussians that it shows: its template's and its own.
    #[pyo3(get)]
    gaussians: u32,
    /// Number of Gaussians that it has beside its template's.
    #[pyo3(get)]
    own: u32,
    /// Index of its first record in Scene.offsets, or None without offsets.
    #[pyo3(get)]
    first_offset: Option<u32>,
    /// Uniform scale from the template to the world.
    #[pyo3(get)]
    scale: f64,
    rows: [[f32; 4]; 3],
    centre: [f64; 3],
}

#[pymethods]
impl Instance {
    /// The similarity from the template's frame to the world, rows of (A | t), [3, 4], float32.
    #[getter]
    fn world_from_template<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.rows)
    }

    /// Its centre: the mean of its template's means, in the world; [3], float64.
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.centre)
    }

    fn __repr__(&self) -> String {
        let group = self.group.as_ref().map(|name| format!(" of group \"{name}\"")).unwrap_or_default();
        let [x, y, z] = self.centre;
        format!("<instgs.Instance {} of template {}{group} at ({x:.3}, {y:.3}, {z:.3})>", self.index, self.template)
    }
}

/// A kind of object: its template, its name, and the mask ids of its instances.
#[pyclass(module = "instgs", frozen, get_all)]
pub(crate) struct Group {
    /// Index of its template.
    template: u32,
    /// Name of the kind of object, or None.
    name: Option<String>,
    /// Mask ids of its instances, in their order.
    instance_ids: Vec<u32>,
}

#[pymethods]
impl Group {
    fn __repr__(&self) -> String {
        let name = self.name.as_deref().unwrap_or("without a name");
        format!("<instgs.Group {name}: template {}, {} ids>", self.template, self.instance_ids.len())
    }
}

/// All instances of a scene, in their order.
pub(crate) fn instances_of(scene: &InstancedScene) -> Vec<Instance> {
    let labels = scene.instance_labels();
    let centres = instance_centres(scene, 0..scene.instances.len());
    let instance = |index: usize| {
        let scene::Instance { template, world_from_template, first_offset } = &scene.instances[index];
        let own = scene.own_range(index).count;
        Instance {
            index,
            template: *template,
            id: labels[index].id,
            group: labels[index].group.and_then(|group| scene.groups[group].name.clone()),
            gaussians: scene.template_ranges[*template as usize].count + own,
            own,
            first_offset: *first_offset,
            scale: world_from_template.scale(),
            rows: world_from_template.rows(),
            centre: centres[index].to_array(),
        }
    };
    (0..scene.instances.len()).map(instance).collect()
}

/// All groups of a scene, in their order.
pub(crate) fn groups_of(scene: &InstancedScene) -> Vec<Group> {
    let group = |group: &scene::Group| Group {
        template: group.template_id,
        name: group.name.clone(),
        instance_ids: group.instance_ids.clone(),
    };
    scene.groups.iter().map(group).collect()
}
