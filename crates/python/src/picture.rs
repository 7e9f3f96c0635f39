//! `instgs.Picture`: a rendered picture as numpy arrays.

use std::path::PathBuf;

use instgs_io::picture_png::{encode_png, write_png};
use instgs_vk::render::{self, FrameStats, SurfacePoint};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::OrRaise;

/// The background is at the pixel's surface.
pub(crate) const BACKGROUND: i32 = -1;
/// At least half of the light passes.
pub(crate) const NOTHING: i32 = -2;

/// A picture of H rows and W columns, from the top left. Arrays are this object's own: changing them changes no scene.
#[pyclass(module = "instgs", frozen)]
pub(crate) struct Picture {
    /// Colour over the background, [H, W, 3], float32, in the encoding of the photos (sRGB); may exceed 0..1.
    #[pyo3(get)]
    colour: Py<PyArray3<f32>>,
    /// 1 - transmittance, [H, W], float32.
    #[pyo3(get)]
    alpha: Py<PyArray2<f32>>,
    /// Expected view depth, [H, W], float32, scene units; 0 where nothing was drawn.
    #[pyo3(get)]
    depth: Py<PyArray2<f32>>,
    /// Index of the instance at the surface, [H, W], int32; BACKGROUND or NOTHING where there is none. None with ids=False.
    #[pyo3(get)]
    instance_ids: Option<Py<PyArray2<i32>>>,
    /// Number of Gaussians that touch the picture.
    #[pyo3(get)]
    visible: u64,
    /// The colours in 8 bits, and width and height: what PNG files are made of.
    rgb8: Vec<u8>,
    size: (u32, u32),
}

/// The arrays of a picture, before they are numpy's.
pub(crate) struct Drawn {
    picture: render::Picture,
    rgb8: Vec<u8>,
    colour: Vec<f32>,
    alpha: Vec<f32>,
    ids: Option<Vec<i32>>,
    visible: u64,
}

impl Drawn {
    /// Splits a picture into arrays; `instances` is the number of instances in the scene.
    pub(crate) fn new(
        picture: render::Picture,
        surfaces: Option<Vec<Option<SurfacePoint>>>,
        instances: usize,
        stats: &FrameStats,
    ) -> Self {
        let id = |point: Option<SurfacePoint>| match point {
            None => NOTHING,
            // The background counts as one more instance than there are.
            Some(point) if point.instance as usize >= instances => BACKGROUND,
            Some(point) => point.instance as i32,
        };
        Self {
            rgb8: picture.rgb8(),
            colour: picture.colors.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
            alpha: picture.colors.iter().map(|c| c[3]).collect(),
            ids: surfaces.map(|points| points.into_iter().map(id).collect()),
            visible: stats.visible,
            picture,
        }
    }

    /// The Python object.
    pub(crate) fn into_picture(self, py: Python<'_>) -> PyResult<Picture> {
        let Self { picture, rgb8, colour, alpha, ids, visible } = self;
        let (height, width) = (picture.height as usize, picture.width as usize);
        Ok(Picture {
            colour: PyArray1::from_vec(py, colour).reshape([height, width, 3])?.unbind(),
            alpha: PyArray1::from_vec(py, alpha).reshape([height, width])?.unbind(),
            depth: PyArray1::from_vec(py, picture.depths).reshape([height, width])?.unbind(),
            instance_ids: match ids {
                Some(ids) => Some(PyArray1::from_vec(py, ids).reshape([height, width])?.unbind()),
                None => None,
            },
            visible,
            rgb8,
            size: (picture.width, picture.height),
        })
    }
}

#[pymethods]
impl Picture {
    /// The colours as 8-bit rgb, [H, W, 3], uint8: rounded to nearest, clamped to 0..1.
    fn rgb8<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let (width, height) = self.size;
        PyArray1::from_slice(py, &self.rgb8).reshape([height as usize, width as usize, 3])
    }

    /// Writes a PNG file of 8 bits per channel.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| write_png(&path, &self.rgb8, self.size)).or_raise()
    }

    /// What notebooks show.
    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut png = Vec::new();
        encode_png(&mut png, &self.rgb8, self.size).or_raise()?;
        Ok(PyBytes::new(py, &png))
    }

    fn __repr__(&self) -> String {
        format!("<instgs.Picture: {} x {}, {} Gaussians in view>", self.size.0, self.size.1, self.visible)
    }
}
