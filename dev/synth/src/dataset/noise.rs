//! Smooth noise for textures. Detail finer than the pixel's footprint fades to its mean to avoid aliasing.

use glam::{IVec3, Vec3, Vec4};

/// Odd factors that spread the bits of the coordinates.
const FACTORS: [u32; 3] = [0x8DA6_B343, 0xD816_3841, 0xCB1A_B31F];

/// Hashes three coordinates and a seed to 32 uniform bits.
pub fn hash(cell: IVec3, seed: u32) -> u32 {
    let part = |axis: usize| (cell[axis] as u32).wrapping_mul(FACTORS[axis]);
    mixed(part(0) ^ part(1) ^ part(2) ^ seeded(seed))
}

fn seeded(seed: u32) -> u32 {
    seed.wrapping_mul(0x9E37_79B9)
}

fn mixed(h: u32) -> u32 {
    let h = (h ^ h >> 16).wrapping_mul(0x7FEB_352D);
    let h = (h ^ h >> 15).wrapping_mul(0x846C_A68B);
    h ^ h >> 16
}

/// [`hash`] as a number in 0..1.
pub fn hash_unit(cell: IVec3, seed: u32) -> f32 {
    unit(hash(cell, seed))
}

fn unit(hash: u32) -> f32 {
    // As i32, which has a conversion instruction where u32 has none.
    (hash >> 8) as i32 as f32 / (1u32 << 24) as f32
}

/// Value noise in -1..=1 with features of size 1: random values at integer coordinates, smoothly interpolated.
pub fn noise(p: Vec3, seed: u32) -> f32 {
    // Rounds towards 0, so negative numbers can be one too high. `floor` is a function call on plain x86-64.
    let cut = p.as_ivec3();
    let cell = cut - IVec3::select(cut.as_vec3().cmpgt(p), IVec3::ONE, IVec3::ZERO);
    let f = p - cell.as_vec3();
    let f = f * f * (3.0 - 2.0 * f);
    // Contributions of each coordinate and its successor to `hash`.
    let parts: [[u32; 2]; 3] = std::array::from_fn(|axis| {
        let part = (cell[axis] as u32).wrapping_mul(FACTORS[axis]);
        [part, part.wrapping_add(FACTORS[axis])]
    });
    let [x, y, z] = parts;
    let seed = seeded(seed);
    let sides = [y[0] ^ z[0] ^ seed, y[1] ^ z[0] ^ seed, y[0] ^ z[1] ^ seed, y[1] ^ z[1] ^ seed];
    let row = |x: u32| Vec4::from_array(sides.map(|side| unit(mixed(side ^ x))));
    let (low, high) = (row(x[0]), row(x[1]));
    let [a, b, c, d] = (low + (high - low) * f.x).to_array();
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    2.0 * mix(mix(a, b, f.y), mix(c, d, f.y), f.z) - 1.0
}

/// Sum of `octaves` of noise, each half as large and half as strong as the one before, starting at `size`. Octaves
/// below three times the `footprint` (same unit as `p`) fade.
pub fn fractal(p: Vec3, size: f32, octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut size, mut weight) = (0.0, size, 0.5);
    for octave in 0..octaves {
        let visible = resolved(size, footprint);
        if visible <= 0.0 {
            break;
        }
        sum += weight * visible * noise(p / size, seed.wrapping_add(octave * 7919));
        size *= 0.5;
        weight *= 0.5;
    }
    sum
}

/// Visibility of detail of this size with this pixel footprint: 1 for large detail, 0 for what is lost.
pub fn resolved(size: f32, footprint: f32) -> f32 {
    ((size / footprint.max(1e-9) - 1.0) / 2.0).clamp(0.0, 1.0)
}

/// 0 below `low`, 1 above `high`, smooth in between.
pub fn smooth_step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// 1 where `x` is within `half` of `middle`, with edges `footprint` wide.
pub fn band(x: f32, middle: f32, half: f32, footprint: f32) -> f32 {
    let edge = footprint.max(1e-5);
    (0.5 + (half - (x - middle).abs()) / edge).clamp(0.0, 1.0)
}

/// Lines of the given width at every multiple of `pitch`: 1 on a line. Far away, the share that lines cover.
pub fn grid_line(x: f32, pitch: f32, width: f32, footprint: f32) -> f32 {
    let from_line = (x / pitch - (x / pitch).round()).abs() * pitch;
    let near = band(from_line, 0.0, 0.5 * width, footprint);
    let shown = resolved(pitch, footprint);
    near * shown + width / pitch * (1.0 - shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_smooth_and_fades() {
        for i in 0..2000 {
            let p = Vec3::new(i as f32 * 0.137, i as f32 * -0.071, 3.3);
            assert!(noise(p, 1).abs() <= 1.0 && fractal(p, 1.0, 5, 0.0, 1).abs() < 1.0);
            assert!((noise(p, 1) - noise(p + Vec3::splat(1e-3), 1)).abs() < 0.02);
            assert_eq!(fractal(p, 1.0, 5, 1.0, 1), 0.0);
        }
        assert_eq!(grid_line(2.0, 1.0, 0.1, 1e-6), 1.0);
        assert!(grid_line(2.5, 1.0, 0.1, 1e-6) == 0.0 && (grid_line(2.5, 1.0, 0.1, 9.0) - 0.1).abs() < 1e-6);
    }
}
