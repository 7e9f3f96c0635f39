//! `--pack small`: stores a cloud in about a fifth of the bytes of f16.
//!
//! Each tensor `NAME` of a cloud becomes the U8 tensor `NAME.small`, a coded table (`step_columns.rs`):
//!
//! - positions in blocks of 256 Gaussians that are neighbours in space; the step is 1/16 of the 10th percentile of the
//!   block's Gaussian sizes (geometric mean of the three standard deviations);
//! - rotations as the index of the largest component of (w, x, y, z) and the other three in steps of 1/127 of their
//!   maximum, 1 / sqrt 2, the largest being positive;
//! - logarithms of standard deviations in steps of 0.05: a size changes by at most 2.5 %;
//! - opacity logits in steps of 0.1: an opacity changes by at most 1/80;
//! - SH in steps of 0.02: the base colour (times 0.282) changes by at most 0.7 of 255 levels.
//!
//! On scenes trained from 48 photos of 320x180 this costs 0.01 to 0.04 dB of test PSNR at 24 bytes per Gaussian,
//! against 124 as f16. Finer SH steps (0.01) gain 0.02 dB for 6 more bytes, coarser ones (0.04) lose 0.1 dB.

use crate::scene_pack::floats;
pub use crate::step_columns::TableError;
use crate::step_columns::{Shape, decode, encode};
use instgs_vk::math::morton::morton_order;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::ForeignTensor;

/// Suffix of the name of a coded tensor.
pub const SUFFIX: &str = ".small";

/// Number of Gaussians in a block of positions.
const BLOCK: usize = 256;
/// Step of positions, relative to the percentile `SMALL_PART` of a block's Gaussian sizes.
const MEAN_STEP: f64 = 1.0 / 16.0;
const SMALL_PART: f64 = 0.1;
const LOG_SCALE_STEP: f32 = 0.05;
const LOGIT_STEP: f32 = 0.1;
const SH_STEP: f32 = 0.02;
/// Step of quaternion components other than the largest: they are at most 1 / sqrt 2, 127 steps.
const QUAT_STEP: f32 = std::f32::consts::FRAC_1_SQRT_2 / 127.0;

type Coder<'a> = &'a dyn Fn() -> std::io::Result<Vec<u8>>;

/// The cloud's tensors by the names of their fields. Tensors that cannot be coded (values that are not finite,
/// rotations of zero length, empty ones) stay floats.
///
/// # Errors
/// zstd fails.
pub fn small_tensors(cloud: &Gaussians) -> std::io::Result<Vec<(String, ForeignTensor)>> {
    let (n, c) = (cloud.len(), cloud.sh_coefficients());
    let mut out = Vec::with_capacity(5);
    let mut put = |name: &str, inner: &[usize], values: &[f32], can_be_coded: bool, coded: Coder<'_>| {
        let is_coded = n > 0 && can_be_coded && values.iter().all(|v| v.is_finite());
        out.push(if is_coded {
            let bytes = coded()?;
            (format!("{name}{SUFFIX}"), ForeignTensor { dtype: "U8".into(), shape: vec![bytes.len()], bytes })
        } else {
            (name.to_owned(), floats(&[&[n], inner].concat(), values))
        });
        Ok::<(), std::io::Error>(())
    };
    let steps = |values: &[f32], width: usize, step: f32| encode(values, width, n, |_| step);
    let (means, log_scales, sh) =
        (cloud.means.as_flattened(), cloud.log_scales.as_flattened(), cloud.sh.as_flattened());
    put("means", &[3], means, true, &|| encode(means, 3, BLOCK, |rows| mean_step(&cloud.log_scales[rows])))?;
    let parts: Option<Vec<[f32; 4]>> = cloud.quats.iter().map(smallest_three).collect();
    let coded = || steps(parts.as_deref().unwrap_or_default().as_flattened(), 4, QUAT_STEP);
    put("quats", &[4], cloud.quats.as_flattened(), parts.is_some(), &coded)?;
    put("log_scales", &[3], log_scales, true, &|| steps(log_scales, 3, LOG_SCALE_STEP))?;
    put("opacity_logits", &[], &cloud.opacity_logits, true, &|| steps(&cloud.opacity_logits, 1, LOGIT_STEP))?;
    put("sh", &[c, 3], sh, true, &|| steps(sh, 3 * c, SH_STEP))?;
    Ok(out)
}

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
    let quats: Option<Vec<[f32; 4]>> = values.as_chunks::<4>().0.iter().map(whole_quat).collect();
    quats.map(|quats| quats.as_flattened().to_vec()).ok_or(TableError::Rotation)
}

/// The cloud in Morton order: neighbours in the file are neighbours in space, as small blocks of positions require.
pub fn in_space_order(cloud: &Gaussians) -> Gaussians {
    let mut out = Gaussians::with_capacity(cloud.sh_degree, cloud.len());
    morton_order(&cloud.means).into_iter().for_each(|i| out.push_from(cloud, i as usize));
    out
}

/// Step of the positions of a block, from its Gaussians' sizes; 0 for the finest possible.
fn mean_step(log_scales: &[[f32; 3]]) -> f32 {
    let mut sizes: Vec<f64> = log_scales.iter().map(|s| s.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let small = sizes.get((SMALL_PART * sizes.len() as f64) as usize).copied().unwrap_or_default();
    // A size that is NaN or beyond f32 gives the step that the positions' range requires.
    let step = (MEAN_STEP * small.exp()) as f32;
    if step.is_finite() { step } else { 0.0 }
}

/// The index of the largest component (as a multiple of the step), and the other three with the sign that makes it
/// positive; `None` for a quaternion that is zero or not finite.
fn smallest_three(quat: &[f32; 4]) -> Option<[f32; 4]> {
    let q = quat.map(f64::from);
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 0.0) {
        return None;
    }
    let largest = (0..4).max_by(|&a, &b| q[a].abs().total_cmp(&q[b].abs()))?;
    let scale = q[largest].signum() / length;
    let mut rest = (0..4).filter(|&i| i != largest).map(|i| (q[i] * scale) as f32);
    Some([largest as f32 * QUAT_STEP, rest.next()?, rest.next()?, rest.next()?])
}

/// The inverse of [`smallest_three`]; `None` if the index is not that of a component.
fn whole_quat([index, a, b, c]: &[f32; 4]) -> Option<[f32; 4]> {
    let squares = [a, b, c].map(|&v| f64::from(v).powi(2)).iter().sum::<f64>();
    let largest = (1.0 - squares).max(0.0).sqrt() as f32;
    let index = (index / QUAT_STEP).round();
    (0..4).find(|&i| i as f32 == index && largest > 0.0).map(|i| {
        let mut rest = [a, b, c].into_iter();
        std::array::from_fn(|k| if k == i { largest } else { rest.next().copied().unwrap_or_default() })
    })
}
