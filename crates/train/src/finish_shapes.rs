//! Moves of shapes by a step on a rounded scene (see [`finish`](super::finish)).
//!
//! A rounded covariance has axes of its own, which for nearly round Gaussians are far from those of the covariance before it is
//! rounded. So a move is added to the logarithm of the covariance, which has no axes (`math::log_covariance`).

use instgs_vk::math::log_covariance::{Shape, log_covariance, nearest_shape};
use instgs_vk::scene::{Gaussians, InstancedScene, Parameter};
use rayon::prelude::*;

/// A scene before it is rounded, the rounded one, and that after the step, with as many rows of everything.
pub(super) struct Moved<'a> {
    pub(super) scene: &'a mut InstancedScene,
    pub(super) rounded: &'a InstancedScene,
    pub(super) after: &'a InstancedScene,
    /// By offset record, the Gaussian of the templates that it belongs to.
    pub(super) record_sources: &'a [Option<u32>],
}

/// True if rows of the parameter move with [`Moved::add`], not each number by itself.
pub(super) fn are_shapes(scene: &InstancedScene, parameter: Parameter) -> bool {
    match parameter {
        Parameter::Quats | Parameter::LogScales => true,
        Parameter::OffsetQuats | Parameter::OffsetLogScales => has_shapes(scene),
        _ => false,
    }
}

/// True if offsets have both parts of a shape.
fn has_shapes(scene: &InstancedScene) -> bool {
    !scene.offsets.quats.is_empty() && !scene.offsets.log_scales.is_empty()
}

fn wide<const N: usize>(values: [f32; N]) -> [f64; N] {
    values.map(f64::from)
}

fn narrow<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|v| v as f32)
}

fn shape_of(cloud: &Gaussians, i: usize) -> Shape {
    Shape { quat: wide(cloud.quats[i]), log_scales: wide(cloud.log_scales[i]) }
}

/// The shape that an instance has: its template's and its offset together.
fn shape_of_record(scene: &InstancedScene, record: usize, source: usize) -> Shape {
    let template = shape_of(&scene.templates, source);
    let (quat, log_scales) = (wide(scene.offsets.quats[record]), wide(scene.offsets.log_scales[record]));
    Shape {
        quat: std::array::from_fn(|i| template.quat[i] + quat[i]),
        log_scales: std::array::from_fn(|i| template.log_scales[i] + log_scales[i]),
    }
}

/// `shape` with the difference from `rounded` to `after`; `None` if a number is not finite.
fn moved(shape: &Shape, rounded: &Shape, after: &Shape) -> Option<Shape> {
    let [whole, from, to] = [shape, rounded, after].map(log_covariance);
    let sum: [f64; 6] = std::array::from_fn(|i| whole[i] + to[i] - from[i]);
    sum.iter().all(|v| v.is_finite()).then(|| nearest_shape(&sum, shape.quat))
}

impl Moved<'_> {
    /// Adds the moves of all shapes. Rotations get the length 1.
    pub(super) fn add(self) {
        let Self { scene, rounded, after, record_sources } = self;
        let of_record = |(record, source): (usize, &Option<u32>)| {
            let source = (*source)? as usize;
            let of = |scene: &InstancedScene| shape_of_record(scene, record, source);
            Some((source, moved(&of(scene), &of(rounded), &of(after))?))
        };
        let records: Vec<Option<(usize, Shape)>> = match has_shapes(scene) {
            true => record_sources.par_iter().enumerate().map(of_record).collect(),
            false => Vec::new(),
        };
        let clouds = [
            (&mut scene.templates, &rounded.templates, &after.templates),
            (&mut scene.own, &rounded.own, &after.own),
            (&mut scene.background, &rounded.background, &after.background),
        ];
        for (cloud, rounded, after) in clouds {
            let of = |i: usize| {
                let (from, to) = (shape_of(rounded, i), shape_of(after, i));
                // All of them, once they are held: taking them apart and together again would move them by rounding.
                if from == to { None } else { moved(&shape_of(cloud, i), &from, &to) }
            };
            let shapes: Vec<Option<Shape>> = (0..cloud.len()).into_par_iter().map(of).collect();
            for (i, shape) in shapes.iter().enumerate().filter_map(|(i, shape)| Some((i, shape.as_ref()?))) {
                (cloud.quats[i], cloud.log_scales[i]) = (narrow(shape.quat), narrow(shape.log_scales));
            }
        }
        let (templates, offsets) = (&scene.templates, &mut scene.offsets);
        for (record, (source, sum)) in records.iter().enumerate().filter_map(|(m, row)| Some((m, row.as_ref()?))) {
            let template = shape_of(templates, *source);
            offsets.quats[record] = narrow(std::array::from_fn(|i| sum.quat[i] - template.quat[i]));
            offsets.log_scales[record] = narrow(std::array::from_fn(|i| sum.log_scales[i] - template.log_scales[i]));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball whose rounded shape is a little longer along an axis of another rotation: a step that makes it longer along that axis
    /// makes the ball longer there, whatever the axes of either.
    #[test]
    fn moves_do_not_depend_on_axes() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let ball = Shape { quat: [1.0, 0.0, 0.0, 0.0], log_scales: [-1.0; 3] };
        // Its x axis is the world's y axis.
        let rounded = Shape { quat: [half, 0.0, 0.0, half], log_scales: [-0.9, -1.0, -1.0] };
        let after = Shape { log_scales: [-0.7, -1.0, -1.0], ..rounded };
        let shape = moved(&ball, &rounded, &after).expect("finite");
        let want = log_covariance(&Shape { log_scales: [-1.0, -0.8, -1.0], ..ball });
        let error = log_covariance(&shape).iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(error < 1e-9, "{shape:?}");
        assert!(moved(&ball, &rounded, &Shape { quat: [0.0; 4], ..after }).is_none());
    }
}
