//! Sizes and rotations as `--pack small` codes them: as logarithms of covariances (`math::log_covariance`), those of offsets as
//! what a record adds to the logarithm of its template's Gaussian.

use instgs_vk::math::log_covariance::{LogCovariance, NO_TURN, Shape, log_covariance, nearest_shape, nearest_shapes};
use instgs_vk::math::smallest_three::normal_scale;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::offset_runs::{OffsetRun, sources_of_records};

/// Name of the tensor that stands for `quats` and `log_scales` of a group, without the group.
pub const LOG_COVARIANCES: &str = "log_covariances";
/// A cloud with a logarithm of a size beyond this keeps sizes and rotations as they are: beside such a number, an f32 does not
/// hold the others.
const MOST_LOG_SCALE: f32 = 1e4;

/// Rotations and sizes: quaternions (w, x, y, z) and logarithms of standard deviations, or offsets of them.
pub(crate) type Shapes = (Vec<[f32; 4]>, Vec<[f32; 3]>);

/// The shape of a Gaussian; `None` if it has no axes, or a size that is not finite.
fn shape_of(quat: [f32; 4], log_scales: [f32; 3]) -> Option<Shape> {
    normal_scale(&quat)?;
    let finite = log_scales.iter().all(|v| v.is_finite());
    finite.then(|| Shape { quat: quat.map(f64::from), log_scales: log_scales.map(f64::from) })
}

/// The logarithm of a Gaussian's covariance; `None` if f32 do not hold it.
fn coded(quat: [f32; 4], log_scales: [f32; 3]) -> Option<LogCovariance> {
    let shape = shape_of(quat, log_scales)?;
    log_scales.iter().all(|v| v.abs() <= MOST_LOG_SCALE).then(|| log_covariance(&shape))
}

/// The logarithms of a cloud's covariances; `None` if a rotation has no length, or a value is not finite or too large: then all
/// stay as they are.
pub(super) fn cloud_shapes(cloud: &Gaussians) -> Option<Vec<[f32; 6]>> {
    let of = |(&quat, &log_scales)| Some(coded(quat, log_scales)?.map(|v| v as f32));
    cloud.quats.iter().zip(&cloud.log_scales).map(of).collect()
}

/// How the shapes of offset records are stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum OffsetShapes {
    /// Offsets have none.
    None,
    /// What each record adds to the logarithm of the covariance of its template's Gaussian; 0 for a record that none has.
    Coded(Vec<[f32; 6]>),
    /// As offsets of sizes and rotations, in floats.
    AsTheyAre,
}

impl OffsetShapes {
    /// The shapes of a scene's offsets beside those of its templates, if these are coded.
    pub(super) fn of(scene: &InstancedScene, templates: Option<&[[f32; 6]]>) -> Self {
        let offsets = &scene.offsets;
        if offsets.quats.is_empty() && offsets.log_scales.is_empty() {
            return Self::None;
        }
        let (sources, several) = sources_of_records(&scene.offset_runs(), offsets.len());
        let Some(templates) = templates.filter(|_| !several && offsets.quats.len() == offsets.log_scales.len()) else {
            return Self::AsTheyAre;
        };
        let of_record = |(record, source): (usize, &Option<u32>)| -> Option<[f32; 6]> {
            let Some(row) = source.map(|row| row as usize) else { return Some([0.0; 6]) };
            let [quat, offset] = [scene.templates.quats[row], offsets.quats[record]];
            let [size, wider] = [scene.templates.log_scales[row], offsets.log_scales[record]];
            let sum = coded(std::array::from_fn(|i| quat[i] + offset[i]), std::array::from_fn(|i| size[i] + wider[i]))?;
            Some(std::array::from_fn(|i| (sum[i] - f64::from(templates[row][i])) as f32))
        };
        sources.iter().enumerate().map(of_record).collect::<Option<_>>().map_or(Self::AsTheyAre, Self::Coded)
    }
}

fn wide(coordinates: &[f32; 6]) -> LogCovariance {
    coordinates.map(f64::from)
}

/// So many shapes are computed together: a few vectors of f64 on any CPU, so that some divide while others wait for theirs.
const LANES: usize = 8;

/// Rotations and sizes from six coordinates a row, with axes as near as can be to those of the scene.
pub(crate) fn shapes_from(log_covariances: &[f32]) -> Shapes {
    let rows = log_covariances.as_chunks::<6>().0;
    let (mut quats, mut log_scales) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
    let mut put = |shape: Shape| {
        quats.push(shape.quat.map(|v| v as f32));
        log_scales.push(shape.log_scales.map(|v| v as f32));
    };
    let (groups, rest) = rows.as_chunks::<LANES>();
    let mut together = [[0.0; 6]; LANES];
    for group in groups {
        together.iter_mut().zip(group).for_each(|(of, row)| *of = wide(row));
        nearest_shapes(&together, &[NO_TURN; LANES]).into_iter().for_each(&mut put);
    }
    rest.iter().for_each(|row| put(nearest_shape(&wide(row), NO_TURN)));
    (quats, log_scales)
}

/// The offsets of rotations and sizes from six coordinates a record, for templates that have been read. Axes are as near as can be
/// to those of the template's Gaussian, so that offsets are small; those of a record that no instance has are 0. `None` if a record
/// belongs to several Gaussians: it cannot be a difference to all of them.
pub(crate) fn offset_shapes_from(log_covariances: &[f32], templates: &Gaussians, runs: &[OffsetRun]) -> Option<Shapes> {
    let rows = log_covariances.as_chunks::<6>().0;
    let (sources, several) = sources_of_records(runs, rows.len());
    let of = |(source, row): (&Option<u32>, &[f32; 6])| {
        let template = source.and_then(|source| {
            let row = source as usize;
            Some((shape_of(templates.quats[row], templates.log_scales[row])?, row))
        });
        let Some((template, at)) = template else { return ([0.0; 4], [0.0; 3]) };
        let (whole, more) = (log_covariance(&template), wide(row));
        let sum = nearest_shape(&std::array::from_fn(|i| whole[i] + more[i]), template.quat);
        // The sum is to have the template's length, as that is what the offset is beside.
        let length = template.quat.iter().map(|v| v * v).sum::<f64>().sqrt();
        let quat = std::array::from_fn(|i| (length * sum.quat[i] - f64::from(templates.quats[at][i])) as f32);
        let sizes = std::array::from_fn(|i| (sum.log_scales[i] - f64::from(templates.log_scales[at][i])) as f32);
        (quat, sizes)
    };
    (!several).then(|| sources.iter().zip(rows).map(of).unzip())
}
