//! SPZ's quantisation: sizes of the attribute arrays, and conversion of their values to and from [`Gaussians`].

use crate::host_memory::gaussian_bytes;
use crate::logit_of_byte;
use crate::spz_axes::Axes;
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};

/// SH 0 is stored as 0.5 + 0.15 c, so that colours slightly beyond 0..1 fit a byte.
pub(crate) const COLOUR_SCALE: f64 = 0.15;
/// Bits of SH degree 1 and of the higher degrees that are kept when writing: coarser steps compress better.
const SH1_BITS: u32 = 5;
const SH_REST_BITS: u32 = 4;
/// Shapes of the arrays of one file. Index: 0 positions, 1 alphas, 2 colours, 3 scales, 4 rotations, 5 SH.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    splats: u64,
    sh_degree: u32,
    half_positions: bool,
    smallest_three: bool,
}

impl Layout {
    pub(crate) fn new(version: u32, splats: u32, sh_degree: u8) -> Self {
        Self {
            splats: u64::from(splats),
            sh_degree: u32::from(sh_degree),
            half_positions: version == 1,
            smallest_three: version >= 3,
        }
    }

    /// Bytes of each array; at most 91 per splat, so that nothing overflows.
    pub(crate) fn array_bytes(&self) -> [u64; 6] {
        let sh = 3 * (sh_coefficients(self.sh_degree) as u64 - 1);
        let position = if self.half_positions { 6 } else { 9 };
        [position, 1, 3, 3, if self.smallest_three { 4 } else { 3 }, sh].map(|bytes| bytes * self.splats)
    }

    pub(crate) fn total_bytes(&self) -> u64 {
        self.array_bytes().iter().sum()
    }

    /// SH degree of the Gaussians that are decoded.
    fn kept_degree(&self) -> u32 {
        self.sh_degree.min(MAX_SH_DEGREE)
    }

    /// Bytes of the Gaussians that are decoded; at most 236 per splat, so that nothing overflows.
    pub(crate) fn gaussians_bytes(&self) -> u64 {
        self.splats * gaussian_bytes(self.kept_degree())
    }
}

/// Decodes arrays that have the lengths of `layout`, of a file with the given axes.
pub(crate) fn decode(layout: &Layout, fractional_bits: u32, axes: Axes, arrays: &[&[u8]; 6]) -> Gaussians {
    let splats = layout.splats as usize;
    let degree = layout.kept_degree();
    let mut out = Gaussians::with_capacity(degree, splats);
    let stored = sh_coefficients(layout.sh_degree) - 1;
    let kept = sh_coefficients(degree) - 1;
    let unit = f64::from(fractional_bits).exp2().recip();
    let (signs, quat_signs, sh_signs) = (axes.signs(), axes.quat_signs(), axes.sh_signs());
    let [positions, alphas, colours, scales, rotations, sh] = *arrays;
    for i in 0..splats {
        let position: [f64; 3] = std::array::from_fn(|k| {
            if layout.half_positions {
                let at = 6 * i + 2 * k;
                return half::f16::from_le_bytes([positions[at], positions[at + 1]]).to_f64();
            }
            let at = 9 * i + 3 * k;
            // The three bytes are the upper part of an i32: the arithmetic shift back extends the sign.
            let fixed = i32::from_le_bytes([0, positions[at], positions[at + 1], positions[at + 2]]) >> 8;
            f64::from(fixed) * unit
        });
        // Adding 0.0 turns -0 into 0.
        out.means.push(std::array::from_fn(|k| (position[k] * signs[k] + 0.0) as f32));
        out.opacity_logits.push(logit_of_byte(alphas[i]));
        out.log_scales.push(std::array::from_fn(|k| f32::from(scales[3 * i + k]) / 16.0 - 10.0));
        let xyzw = if layout.smallest_three {
            unpack_smallest_three(u32::from_le_bytes(std::array::from_fn(|k| rotations[4 * i + k])))
        } else {
            unpack_first_three(std::array::from_fn(|k| rotations[3 * i + k]))
        };
        let [x, y, z, w] = xyzw;
        out.quats.push([w, x * quat_signs[0], y * quat_signs[1], z * quat_signs[2]].map(|v| v as f32));
        out.sh.push(std::array::from_fn(|k| ((f64::from(colours[3 * i + k]) / 255.0 - 0.5) / COLOUR_SCALE) as f32));
        for (c, sign) in sh_signs.iter().enumerate().take(kept) {
            let at = 3 * (stored * i + c);
            out.sh.push(std::array::from_fn(|k| (f32::from(sh[at + k]) - 128.0) / 128.0 * sign));
        }
    }
    axes.turned(out)
}

/// The arrays of a version 3 or 4 file, in the order of [`Layout`]. All values must be finite and positions within range.
pub(crate) fn encode(cloud: &Gaussians, fractional_bits: u32) -> [Vec<u8>; 6] {
    let mut arrays: [Vec<u8>; 6] = Default::default();
    let [positions, alphas, colours, scales, rotations, sh] = &mut arrays;
    let unit = f64::from(fractional_bits).exp2();
    let axes = Axes::USUAL;
    let (signs, quat_signs, sh_signs) = (axes.signs(), axes.quat_signs(), axes.sh_signs());
    let byte = |v: f64| v.round().clamp(0.0, 255.0) as u8;
    for i in 0..cloud.len() {
        for (k, sign) in signs.iter().enumerate() {
            let fixed = (f64::from(cloud.means[i][k]) * sign * unit).round() as i32;
            positions.extend_from_slice(&fixed.to_le_bytes()[..3]);
            scales.push(byte((f64::from(cloud.log_scales[i][k]) + 10.0) * 16.0));
            colours.push(byte((f64::from(cloud.sh_of(i)[0][k]) * COLOUR_SCALE + 0.5) * 255.0));
        }
        alphas.push(byte(255.0 / (1.0 + f64::from(-cloud.opacity_logits[i]).exp())));
        let [w, x, y, z] = cloud.quats[i].map(f64::from);
        let turned = [x * quat_signs[0], y * quat_signs[1], z * quat_signs[2], w];
        rotations.extend_from_slice(&pack_smallest_three(turned).to_le_bytes());
        for (c, rgb) in cloud.sh_of(i)[1..].iter().enumerate() {
            let bits = if c < 3 { SH1_BITS } else { SH_REST_BITS };
            sh.extend(rgb.iter().map(|&v| quantise_sh(v * sh_signs[c], bits)));
        }
    }
    arrays
}

/// Quantises to 8 bits around 128, then to the nearest multiple of the step, of which 128 is one.
fn quantise_sh(value: f32, bits: u32) -> u8 {
    let step = 1i32 << (8 - bits);
    let fine = (f64::from(value) * 128.0).round().clamp(-1024.0, 1024.0) as i32 + 128;
    ((fine + step / 2).div_euclid(step) * step).clamp(0, 255) as u8
}

/// Decodes x, y, z, stored as bytes over -1..1; w >= 0 follows from them.
fn unpack_first_three(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|b| f64::from(b) / 127.5 - 1.0);
    [x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]
}

/// Decodes a smallest-three quaternion. Bits 30-31: index of the largest of x, y, z, w. The others follow from the
/// highest bits down: a sign bit and nine bits of magnitude over 0..sqrt(1/2).
fn unpack_smallest_three(word: u32) -> [f64; 4] {
    let largest = (word >> 30) as usize;
    let mut out = [0.0; 4];
    let mut shift = 0;
    for i in (0..4).rev().filter(|&i| i != largest) {
        let magnitude = f64::from((word >> shift) & 511) / 511.0 * std::f64::consts::FRAC_1_SQRT_2;
        out[i] = if (word >> shift) & 512 != 0 { -magnitude } else { magnitude };
        shift += 10;
    }
    out[largest] = (1.0 - out.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    out
}

fn pack_smallest_three(xyzw: [f64; 4]) -> u32 {
    let norm = xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = (1..4).fold(0, |best, i| if xyzw[i].abs() > xyzw[best].abs() { i } else { best });
    let sign = if xyzw[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut word = largest as u32;
    for i in (0..4).filter(|&i| i != largest) {
        let value = xyzw[i] * sign / norm;
        let magnitude = ((value.abs() * std::f64::consts::SQRT_2 * 511.0).round() as u32).min(511);
        word = (word << 10) | (u32::from(value < 0.0) << 9) | magnitude;
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_survive_packing() {
        for q in [
            [0.0, 0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 0.0],
            [0.5, -0.5, 0.5, -0.5],
            [0.1, 0.7, -0.2, -0.3],
            [-0.9, 0.1, 0.1, 0.0],
        ] {
            let norm = q.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            let back = unpack_smallest_three(pack_smallest_three(q));
            let dot = q.iter().zip(back).map(|(a, b)| a / norm * b).sum::<f64>();
            assert!(dot.abs() > 1.0 - 1e-5, "{q:?} {back:?}");
        }
    }

    #[test]
    fn sh_steps_contain_zero_and_saturate() {
        for bits in [4, 5, 8] {
            assert_eq!(quantise_sh(0.0, bits), 128);
            assert_eq!(quantise_sh(9.0, bits), 255);
            assert_eq!(quantise_sh(-9.0, bits), 0);
        }
    }
}
