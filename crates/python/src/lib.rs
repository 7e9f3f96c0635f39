//! The Python package `instgs`: scenes with numpy arrays, pictures, edits, training and evaluation. It parses Python's
//! arguments and calls the same libraries as the command line; errors are of the one class `instgs.Error` and have the
//! command line's one-line texts, remarks on files are Python warnings. What takes long runs detached from the interpreter.
//!
//! The user's documentation is in the docstrings, in `instgs.pyi` and in `docs/python.md`.

mod arrays;
mod beside;
mod camera;
mod device;
mod edit;
mod edit_values;
mod error;
mod evaluate;
mod events;
mod gaussians;
mod instances;
mod json;
mod look;
mod picture;
mod pipeline;
mod poses;
mod renderer;
mod save;
mod scene;
mod segments;
mod synth;
mod train;
mod views;

use pyo3::prelude::*;

/// 3D Gaussian scenes with shared templates for repeated objects: load, render, edit, train; on Vulkan, without CUDA.
#[pymodule]
mod instgs {
    #[pymodule_export]
    use crate::camera::Camera;
    #[pymodule_export]
    use crate::device::devices;
    #[pymodule_export]
    use crate::error::Error;
    #[pymodule_export]
    use crate::evaluate::eval;
    #[pymodule_export]
    use crate::gaussians::Gaussians;
    #[pymodule_export]
    use crate::instances::{Group, Instance};
    #[pymodule_export]
    use crate::picture::Picture;
    #[pymodule_export]
    use crate::pipeline::{Merged, Pipeline};
    #[pymodule_export]
    use crate::poses::Poses;
    #[pymodule_export]
    use crate::renderer::Renderer;
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::segments::Segments;
    #[pymodule_export]
    use crate::synth::synth;
    #[pymodule_export]
    use crate::train::{Trained, train};

    use super::*;

    /// In `Picture.instance_ids`: the background is at the pixel's surface.
    #[pymodule_export]
    const BACKGROUND: i32 = crate::picture::BACKGROUND;
    /// In `Picture.instance_ids`: at least half of the light passes the pixel.
    #[pymodule_export]
    const NOTHING: i32 = crate::picture::NOTHING;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
