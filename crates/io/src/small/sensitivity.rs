//! How much a change of a parameter changes pictures.

use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::parameters::{Owner, Parameter, ParameterSet};

/// How much the pictures of some views change with each row of each parameter: the mean, over the row's values and over all
/// views, of the sum over pixels and channels of the squared derivative of the colour, divided by the number of pixels times
/// three. An error e of one value thus adds about e^2 times this to the mean squared error of a picture (Gauss-Newton).
///
/// Rows are those of the scene that it was measured on: source Gaussians as templates, own, background, an SH band only
/// where their cloud has it; offset records.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sensitivity {
    /// By parameter, one number per row, 0 or more; empty for parameters that the scene has not. Files hold shapes in place of
    /// sizes and rotations.
    pub rows: ParameterSet<Vec<f32>>,
    /// By source Gaussian, one number for each coordinate of the logarithm of its covariance (`math::log_covariance`), together
    /// with those of the instances that add their offsets to it.
    pub source_shapes: Vec<[f32; 6]>,
    /// By offset record, the same for what it adds to the logarithm of its template's; empty if offsets have no sizes or no
    /// rotations.
    pub offset_shapes: Vec<[f32; 6]>,
}

impl Sensitivity {
    /// True if any parameter shows in any view.
    pub fn shows_anything(&self) -> bool {
        self.rows.iter().any(|(_, rows)| rows.iter().any(|&s| s > 0.0))
    }

    /// True if it has a row for every row of the scene.
    pub fn fits(&self, scene: &InstancedScene) -> bool {
        let clouds = [&scene.templates, &scene.own, &scene.background];
        let of = |parameter: Parameter| match parameter.owner() {
            Owner::Source => Some(scene.source_len()),
            Owner::ShBand(l) => Some(clouds.iter().filter(|cloud| l <= cloud.sh_degree).map(|cloud| cloud.len()).sum()),
            Owner::Offset => scene.offsets.array(parameter).map(|array| array.flat().len() / parameter.width()),
            Owner::Instance => None,
        };
        let offset_shapes = scene.offsets.quats.len().min(scene.offsets.log_scales.len());
        self.rows.iter().all(|(parameter, rows)| of(parameter).is_none_or(|count| count == rows.len()))
            && [self.source_shapes.len(), self.offset_shapes.len()] == [scene.source_len(), offset_shapes]
    }
}

/// How `--pack small` rounds a scene whose sensitivity is known.
#[derive(Clone, Copy, Debug)]
pub struct SmallOptions<'a> {
    /// Of the scene that is packed.
    pub sensitivity: &'a Sensitivity,
    /// PSNR that pictures of the packed scene have beside those of the unpacked one, dB, by the measure of `sensitivity`.
    pub picture_psnr_db: f64,
}
