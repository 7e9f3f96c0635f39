//! `instgs.Segments`: a plain cloud and the object of each of its Gaussians.

use std::sync::Arc;

use instgs_objects::pipeline::CloudLabels;
use instgs_vk::scene::InstancedScene;
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::ids;
use crate::camera::Camera;
use crate::json::to_python;
use crate::scene::Scene;

/// A plain cloud of N Gaussians and the object of each, from Pipeline.segment.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Segments {
    /// The plain cloud.
    #[pyo3(get)]
    pub(crate) cloud: Py<Scene>,
    /// Its labels.
    pub(crate) labels: Arc<CloudLabels>,
}

impl Segments {
    /// Cloud and labels, for a thread of its own.
    pub(crate) fn parts(&self, py: Python<'_>) -> (Arc<InstancedScene>, Arc<CloudLabels>) {
        (self.cloud.get().snapshot(py), self.labels.clone())
    }
}

#[pymethods]
impl Segments {
    /// The object of each Gaussian, 0 for none: [N], uint32.
    #[getter]
    fn labels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.labels.labels)
    }

    /// What each Gaussian contributes to all training views, pixels: [N], float32.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.labels.weights_px)
    }

    /// The number of training views to which each Gaussian contributes: [N], uint32.
    #[getter]
    fn views_seen<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.labels.views_seen)
    }

    /// The objects that the masks show: [{"id", "category", "views", "masks", "gaussians"}].
    #[getter]
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.labels.consensus.objects)
    }

    /// The training views' cameras, at the size that is trained at.
    #[getter]
    fn cameras(&self) -> Vec<Camera> {
        self.labels.cameras.iter().map(|camera| Camera { camera: camera.clone() }).collect()
    }

    /// The same with other labels, [N], whole numbers from 0 to 65535: what you know better than the masks. The files of the
    /// folder keep those found. Raises Error.
    fn relabelled(&self, py: Python<'_>, labels: &Bound<'_, PyAny>) -> PyResult<Self> {
        let count = self.labels.labels.len();
        let mut changed =
            CloudLabels { labels: ids(labels, "labels", &[Some(count)])?, ..CloudLabels::clone(&self.labels) };
        changed.consensus.count_gaussians(&changed.labels);
        Ok(Self { cloud: self.cloud.clone_ref(py), labels: Arc::new(changed) })
    }

    fn __len__(&self) -> usize {
        self.labels.labels.len()
    }

    fn __repr__(&self) -> String {
        let objects = self.labels.consensus.objects.len();
        format!("<instgs.Segments: {} Gaussians, {objects} objects>", self.labels.labels.len())
    }
}
