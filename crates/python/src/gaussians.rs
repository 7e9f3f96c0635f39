//! `instgs.Gaussians`: a cloud with its arrays.

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;

use crate::arrays::{Numbers, from_row_groups, from_rows};
use crate::error::raised;
use instgs_vk::scene;
use instgs_vk::scene::gaussians::{MAX_SH_DEGREE, sh_coefficients};

/// N Gaussians in one frame, as 3DGS files store them.
///
/// Every attribute is a new numpy array of float32. To change some, make a new object of changed arrays.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Gaussians {
    /// The cloud.
    pub(crate) cloud: scene::Gaussians,
}

#[pymethods]
impl Gaussians {
    /// Gaussians(means, quats, log_scales, opacity_logits, sh): array-likes [N, 3], [N, 4], [N, 3], [N], [N, C, 3].
    ///
    /// C is 1, 4, 9 or 16: the SH coefficients of degree 0 to 3. Raises Error if shapes do not go together.
    #[new]
    fn new(
        means: &Bound<'_, PyAny>,
        quats: &Bound<'_, PyAny>,
        log_scales: &Bound<'_, PyAny>,
        opacity_logits: &Bound<'_, PyAny>,
        sh: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let means = Numbers::<f32>::of(means, "means", &[None, Some(3)])?;
        let count = Some(means.shape[0]);
        let sh = Numbers::<f32>::of(sh, "sh", &[count, None, Some(3)])?;
        let sh_degree = (0..=MAX_SH_DEGREE).find(|&degree| sh_coefficients(degree) == sh.shape[1]);
        let Some(sh_degree) = sh_degree else {
            return Err(raised(format_args!("sh has {} coefficients, want 1, 4, 9 or 16", sh.shape[1])));
        };
        let cloud = scene::Gaussians {
            sh_degree,
            means: means.rows(),
            quats: Numbers::of(quats, "quats", &[count, Some(4)])?.rows(),
            log_scales: Numbers::of(log_scales, "log_scales", &[count, Some(3)])?.rows(),
            opacity_logits: Numbers::of(opacity_logits, "opacity_logits", &[count])?.values,
            sh: sh.rows(),
        };
        Ok(Self { cloud })
    }

    /// Centres, [N, 3], scene units; in the world, or in the template's frame.
    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.cloud.means)
    }

    /// Rotations as quaternions (w, x, y, z) of any length but zero, [N, 4].
    #[getter]
    fn quats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.cloud.quats)
    }

    /// Natural logarithms of the standard deviations, [N, 3], scene units.
    #[getter]
    fn log_scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        from_rows(py, &self.cloud.log_scales)
    }

    /// Opacities before the sigmoid, [N].
    #[getter]
    fn opacity_logits<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.cloud.opacity_logits)
    }

    /// SH coefficients, [N, C, 3]: C is (sh_degree + 1)^2, the last axis rgb. Base colour = 0.2821 sh[:, 0] + 0.5.
    #[getter]
    fn sh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        from_row_groups(py, &self.cloud.sh, self.cloud.sh_coefficients())
    }

    /// The SH degree, 0 to 3.
    #[getter]
    fn sh_degree(&self) -> u32 {
        self.cloud.sh_degree
    }

    fn __len__(&self) -> usize {
        self.cloud.len()
    }

    fn __repr__(&self) -> String {
        format!("<instgs.Gaussians: {} of SH degree {}>", self.cloud.len(), self.cloud.sh_degree)
    }
}
