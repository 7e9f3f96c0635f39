//! `instgs.Poses`: groups of objects that are alike, and where each object stands.

use instgs_objects::register::InstanceRegistration;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{PosedGroup, PosedInstance};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::arrays::{self, Numbers};
use crate::error::raised;
use crate::json::to_python;

/// Groups of objects that are alike and the pose of each, from Pipeline.register or your own.
///
/// Poses(groups): dictionaries as those of groups, of which "ids" and "world_from_template" are needed. Given ones are shared
/// even if the objects are not much alike. Raises Error.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Poses {
    /// The groups; the first object of each is its reference.
    pub(crate) groups: Vec<PosedGroup>,
    /// What registration found about each object.
    pub(crate) objects: Vec<InstanceRegistration>,
    /// Whether the user gave the groups.
    pub(crate) is_given: bool,
}

#[pymethods]
impl Poses {
    #[new]
    fn new(groups: Vec<Bound<'_, PyDict>>) -> PyResult<Self> {
        let groups = (0..).zip(&groups).map(|(g, group)| group_of(g, group)).collect::<PyResult<_>>()?;
        Ok(Self { groups, objects: Vec::new(), is_given: true })
    }

    /// The groups: [{"template_id", "name", "score", "ids": [K], uint32, "world_from_template": [K, 3, 4], float32}]. Ids are
    /// those of the masks' objects; the first is the reference.
    #[getter]
    fn groups<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let groups = self.groups.iter().map(|group| dict_of(py, group)).collect::<PyResult<Vec<_>>>()?;
        PyList::new(py, groups)
    }

    /// How each object was registered: [{"instance", "group", "verdict", "inliers", "rmse", "note", ...}]; empty for given groups.
    #[getter]
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.objects)
    }

    /// Number of groups.
    fn __len__(&self) -> usize {
        self.groups.len()
    }

    fn __repr__(&self) -> String {
        let objects: usize = self.groups.iter().map(|group| group.instances.len()).sum();
        format!("<instgs.Poses: {} groups, {objects} objects in them>", self.groups.len())
    }
}

fn dict_of<'py>(py: Python<'py>, group: &PosedGroup) -> PyResult<Bound<'py, PyDict>> {
    let ids: Vec<u32> = group.instances.iter().map(|instance| instance.id).collect();
    let rows: Vec<f32> =
        group.instances.iter().flat_map(|instance| instance.world_from_template.rows()).flatten().collect();
    let out = PyDict::new(py);
    out.set_item("template_id", group.template_id)?;
    out.set_item("name", &group.name)?;
    out.set_item("score", group.score)?;
    out.set_item("world_from_template", PyArray1::from_slice(py, &rows).reshape([ids.len(), 3, 4])?)?;
    out.set_item("ids", PyArray1::from_vec(py, ids))?;
    Ok(out)
}

/// A group of the user's, the g-th. Whether its ids are used once is checked when it is written.
fn group_of(g: u32, group: &Bound<'_, PyDict>) -> PyResult<PosedGroup> {
    let needed = |key: &str| {
        let value = group.get_item(key)?;
        value.ok_or_else(|| raised(format_args!("group {g} has no \"{key}\"")))
    };
    let optional =
        |key: &str| -> PyResult<Option<Bound<'_, PyAny>>> { Ok(group.get_item(key)?.filter(|value| !value.is_none())) };
    let wrong = |key: &str| {
        let what = format!("\"{key}\" of group {g} is not of the right kind");
        move |_| raised(what)
    };
    let ids = arrays::ids(&needed("ids")?, &format!("ids of group {g}"), &[None])?;
    let name = format!("world_from_template of group {g}");
    let shape = [Some(ids.len()), Some(3), Some(4)];
    let rows = Numbers::<f32>::of(&needed("world_from_template")?, &name, &shape)?.rows::<4>();
    let placed = |(k, (id, rows)): (usize, (u32, &[[f32; 4]; 3]))| {
        let world_from_template = Similarity::from_rows(*rows);
        let world_from_template = world_from_template.map_err(|e| raised(format_args!("{name}, object {k}: {e}")))?;
        Ok(PosedInstance { id, world_from_template })
    };
    Ok(PosedGroup {
        template_id: optional("template_id")?.map_or(Ok(g), |value| value.extract().map_err(wrong("template_id")))?,
        name: optional("name")?.map(|value| value.extract().map_err(wrong("name"))).transpose()?,
        score: optional("score")?.map(|value| value.extract().map_err(wrong("score"))).transpose()?,
        instances: ids.into_iter().zip(rows.as_chunks::<3>().0).enumerate().map(placed).collect::<PyResult<_>>()?,
    })
}
