//! How much pictures change with the logarithms of covariances, from gradients by rotations and sizes.
//!
//! Gradients of rotations and sizes are turned into those by the six coordinates of `math::log_covariance`, view by view, and their
//! squares summed. Of a template's Gaussian it is the gradient when the shapes of all instances change together: a record adds its
//! coordinates to the template's, so its gradient is a part of the template's.

use rayon::prelude::*;

use instgs_vk::math::log_covariance::{Shape, ShapeDerivative, derivative};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::offset_runs::sources_of_records;

/// Gradients of a step, row by row; empty for parameters that the scene has not.
pub(super) struct ShapeGradients {
    /// Four for each source Gaussian.
    pub(super) quats: Vec<f32>,
    /// Three for each source Gaussian.
    pub(super) log_scales: Vec<f32>,
    /// Four for each offset record.
    pub(super) offset_quats: Vec<f32>,
    /// Three for each offset record.
    pub(super) offset_log_scales: Vec<f32>,
}

/// Sums of squared derivatives by coordinate.
pub(super) struct ShapeSums {
    /// Shapes of the source Gaussians.
    shapes: Vec<Shape>,
    /// By record the source Gaussian that it belongs to, and the shape of the two; empty if offsets have no shape, or records
    /// belong to several Gaussians: `--pack small` leaves those as they are.
    records: Vec<Option<(usize, Shape)>>,
    of_sources: Vec<[f64; 6]>,
    of_records: Vec<[f64; 6]>,
    /// By Gaussian of the templates, in a view: the sum over its records of the derivatives by coordinates and by shapes; empty
    /// without such records.
    through: Vec<([f64; 6], ShapeDerivative)>,
}

const NO_DERIVATIVE: ShapeDerivative = ShapeDerivative { quat: [0.0; 4], log_scales: [0.0; 3] };

fn shape(quat: [f32; 4], log_scales: [f32; 3]) -> Shape {
    Shape { quat: quat.map(f64::from), log_scales: log_scales.map(f64::from) }
}

/// The derivative by the coordinates; zero for what no pixel saw, and for a shape that has no logarithm.
fn by_coordinates(shape: &Shape, by: &ShapeDerivative) -> [f64; 6] {
    if *by == NO_DERIVATIVE {
        return [0.0; 6];
    }
    let out = derivative(shape, by);
    if out.iter().all(|v| v.is_finite()) { out } else { [0.0; 6] }
}

fn add_squares(sum: &mut [f64; 6], values: [f64; 6]) {
    sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value * value);
}

/// The derivative in a row of gradients.
fn row_of(quats: &[f32], log_scales: &[f32], row: usize) -> ShapeDerivative {
    ShapeDerivative {
        quat: std::array::from_fn(|i| f64::from(quats[4 * row + i])),
        log_scales: std::array::from_fn(|i| f64::from(log_scales[3 * row + i])),
    }
}

impl ShapeSums {
    /// Sums of zero, for a scene whose instances share neither own Gaussians nor offset records.
    pub(super) fn new(scene: &InstancedScene) -> Self {
        let clouds = [&scene.templates, &scene.own, &scene.background];
        let all = clouds.iter().flat_map(|cloud| cloud.quats.iter().zip(&cloud.log_scales));
        let shapes: Vec<Shape> = all.map(|(&quat, &log_scales)| shape(quat, log_scales)).collect();
        let offsets = &scene.offsets;
        let have_shapes = offsets.quats.len().min(offsets.log_scales.len());
        let (sources, several) = sources_of_records(&scene.offset_runs(), offsets.len());
        let templates = &scene.templates;
        let sum_of = |(record, source): (usize, &Option<u32>)| {
            let row = (*source)? as usize;
            let quat = std::array::from_fn(|i| templates.quats[row][i] + offsets.quats[record][i]);
            let sizes = std::array::from_fn(|i| templates.log_scales[row][i] + offsets.log_scales[record][i]);
            Some((row, shape(quat, sizes)))
        };
        let records: Vec<_> = match have_shapes > 0 && !several {
            true => sources.iter().enumerate().map(sum_of).collect(),
            false => Vec::new(),
        };
        let through = vec![([0.0; 6], NO_DERIVATIVE); if records.is_empty() { 0 } else { templates.len() }];
        let [of_sources, of_records] = [shapes.len(), have_shapes].map(|rows| vec![[0.0; 6]; rows]);
        Self { shapes, records, of_sources, of_records, through }
    }

    /// Adds a view's.
    pub(super) fn add(&mut self, gradients: &ShapeGradients) {
        let ShapeGradients { quats, log_scales, offset_quats, offset_log_scales } = gradients;
        let of_record = |(record, of): (usize, &Option<(usize, Shape)>)| {
            let (row, shape) = (*of)?;
            let by = row_of(offset_quats, offset_log_scales, record);
            Some((row, by_coordinates(&shape, &by), by))
        };
        let of_records: Vec<_> = self.records.par_iter().enumerate().map(of_record).collect();
        self.through.fill(([0.0; 6], NO_DERIVATIVE));
        for (sums, of) in self.of_records.iter_mut().zip(of_records) {
            let Some((row, coordinates, by)) = of else { continue };
            add_squares(sums, coordinates);
            let (sum, sum_by) = &mut self.through[row];
            sum.iter_mut().zip(coordinates).for_each(|(sum, value)| *sum += value);
            sum_by.quat.iter_mut().zip(by.quat).for_each(|(sum, value)| *sum += value);
            sum_by.log_scales.iter_mut().zip(by.log_scales).for_each(|(sum, value)| *sum += value);
        }
        let through = &self.through;
        self.of_sources.par_iter_mut().zip(&self.shapes).enumerate().for_each(|(row, (sums, shape))| {
            let mut by = row_of(quats, log_scales, row);
            let mut coordinates = [0.0; 6];
            if let Some((sum, sum_by)) = through.get(row) {
                // What is left is of instances without offsets.
                by.quat.iter_mut().zip(sum_by.quat).for_each(|(by, part)| *by -= part);
                by.log_scales.iter_mut().zip(sum_by.log_scales).for_each(|(by, part)| *by -= part);
                coordinates = *sum;
            }
            let direct = by_coordinates(shape, &by);
            add_squares(sums, std::array::from_fn(|i| coordinates[i] + direct[i]));
        });
    }

    /// The sums times a factor, of source Gaussians and of records.
    pub(super) fn scaled(self, factor: f64) -> (Vec<[f32; 6]>, Vec<[f32; 6]>) {
        let scaled = |rows: Vec<[f64; 6]>| rows.into_iter().map(|row| row.map(|v| (factor * v) as f32)).collect();
        (scaled(self.of_sources), scaled(self.of_records))
    }
}
