//! Coded tables of clouds, as `--pack small` of older versions wrote them (format 2); only read today.
//!
//! Each tensor `NAME` of a cloud is the U8 tensor `NAME.small`, a coded table (`step_columns.rs`): positions in blocks of
//! 256 Gaussians, rotations as the index of the largest component of (w, x, y, z) and the other three in steps of 1/127 of
//! their maximum, 1 / sqrt 2, the index being a multiple of that step too.

pub use crate::step_columns::TableError;
use crate::step_columns::{Shape, decode};
use instgs_vk::math::smallest_three::whole_quat;

/// Suffix of the name of a coded tensor.
pub const SUFFIX: &str = ".small";

/// Step of quaternion components other than the largest: they are at most 1 / sqrt 2, 127 steps.
const QUAT_STEP: f32 = std::f32::consts::FRAC_1_SQRT_2 / 127.0;

/// The number of rows of a coded tensor, and of values per row.
///
/// # Errors
/// There is no header, or its counts are impossible.
pub fn small_shape(coded: &[u8]) -> Result<(usize, usize), TableError> {
    Shape::of(coded).map(|shape| (shape.rows, shape.width))
}

/// The values of a coded tensor, row by row; if `is_quats`, they are decoded to quaternions.
///
/// # Errors
/// The bytes are not a whole table, a rotation is invalid, or the values do not fit host memory.
pub fn small_values(coded: &[u8], is_quats: bool) -> Result<Vec<f32>, TableError> {
    let values = decode(coded)?;
    if !is_quats {
        return Ok(values);
    }
    let whole = |&[index, a, b, c]: &[f32; 4]| {
        let index = (index / QUAT_STEP).round();
        (0..4).find(|&i| i as f32 == index).and_then(|index| whole_quat(index, [a, b, c]))
    };
    let quats: Option<Vec<[f32; 4]>> = values.as_chunks::<4>().0.iter().map(whole).collect();
    quats.map(|quats| quats.as_flattened().to_vec()).ok_or(TableError::Rotation)
}
