//! `instgs.Camera`: a pinhole camera.

use std::path::PathBuf;

use glam::DVec3;
use instgs_vk::scene;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{from_rows, matrix, vector};
use crate::error::{OrRaise, raised};
use crate::views::views_of;

/// A pinhole camera in OpenCV's axes: x right, y down, z forward. Pixel (i, j) has its centre at (i + 0.5, j + 0.5).
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Camera {
    /// The camera; it is valid.
    pub(crate) camera: scene::Camera,
}

impl Camera {
    fn checked(camera: scene::Camera) -> PyResult<Self> {
        camera.validate().or_raise()?;
        Ok(Self { camera })
    }
}

/// A picture's width and height in pixels, of any numbers; a camera or a data set checks the limits.
pub(crate) fn size_of((width, height): (i64, i64)) -> PyResult<(u32, u32)> {
    let side = |value: i64| u32::try_from(value).ok();
    side(width).zip(side(height)).ok_or_else(|| raised(format_args!("size {width}x{height} is no size of a picture")))
}

#[pymethods]
impl Camera {
    /// Camera(width, height, fx, fy, cx, cy, view_from_world, name=""): sizes in pixels, and the rigid 4x4 matrix from world
    /// to view. Raises Error if these are no camera.
    #[new]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, view_from_world, name = String::new()))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        width: i64,
        height: i64,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        view_from_world: &Bound<'_, PyAny>,
        name: String,
    ) -> PyResult<Self> {
        let (width, height) = size_of((width, height))?;
        let view_from_world = matrix(view_from_world, "view_from_world")?;
        Self::checked(scene::Camera { name, width, height, fx, fy, cx, cy, view_from_world })
    }

    /// A camera at eye that looks at target, with up roughly upwards in the picture. fov is the vertical field of view in
    /// degrees.
    #[staticmethod]
    #[pyo3(signature = (eye, target, up, *, fov = 50.0, size = (1280, 720), name = ""))]
    fn look_at(
        eye: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: &Bound<'_, PyAny>,
        fov: f64,
        size: (i64, i64),
        name: &str,
    ) -> PyResult<Self> {
        let size = size_of(size)?;
        let [eye, target, up] =
            [vector(eye, "eye")?, vector(target, "target")?, vector(up, "up")?].map(DVec3::from_array);
        let camera = scene::Camera::look_at(name, eye, target, up, fov.to_radians(), size);
        if !camera.view_from_world.as_flattened().iter().all(|v| v.is_finite()) {
            return Err(raised("eye and target must differ, and up must not point along the view"));
        }
        Self::checked(camera)
    }

    /// The cameras of a file: one object or a list of {"name","width","height","fx","fy","cx","cy","view_from_world"}, or the
    /// cameras.json that INRIA's 3DGS leaves.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Vec<Self>> {
        let cameras = py.detach(|| instgs_io::read_cameras(&path)).or_raise()?;
        Ok(cameras.into_iter().map(|camera| Self { camera }).collect())
    }

    /// The cameras of a data set's views: of its "test" views, of the "train" ones, or of "all".
    #[staticmethod]
    #[pyo3(signature = (data, split = "test"))]
    fn of_data(py: Python<'_>, data: PathBuf, split: &str) -> PyResult<Vec<Self>> {
        let views = views_of(py, &data, split)?;
        Ok(views.into_iter().map(|view| Self { camera: view.camera }).collect())
    }

    /// The same view with a picture of width x height pixels.
    fn resized(&self, width: i64, height: i64) -> PyResult<Self> {
        let (width, height) = size_of((width, height))?;
        Self::checked(self.camera.resized(width, height))
    }

    /// The transform from world to view, rows of a 4x4 matrix, float64.
    #[getter]
    fn view_from_world<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, &self.camera.view_from_world)
    }

    /// Centre of the camera in the world, [3], float64, scene units.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.camera.position_world().to_array())
    }

    /// Name of the view.
    #[getter]
    fn name(&self) -> &str {
        &self.camera.name
    }

    /// Width of the picture, pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.camera.width
    }

    /// Height of the picture, pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.camera.height
    }

    /// Focal length along x, pixels.
    #[getter]
    fn fx(&self) -> f64 {
        self.camera.fx
    }

    /// Focal length along y, pixels.
    #[getter]
    fn fy(&self) -> f64 {
        self.camera.fy
    }

    /// Principal point x, pixels.
    #[getter]
    fn cx(&self) -> f64 {
        self.camera.cx
    }

    /// Principal point y, pixels.
    #[getter]
    fn cy(&self) -> f64 {
        self.camera.cy
    }

    fn __repr__(&self) -> String {
        let scene::Camera { name, width, height, .. } = &self.camera;
        format!("<instgs.Camera \"{name}\": {width} x {height}>")
    }
}
