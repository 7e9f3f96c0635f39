//! Real spherical harmonics up to degree 3 in INRIA's order and signs, and their exact rotation. All in f64.
//!
//! Coefficient l^2 + l + m belongs to degree l, order m = -l..=l. Directions are unit vectors.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

/// Factor of degree 0: sqrt(1 / (4 pi)).
pub const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Factor of degree 1: sqrt(3 / (4 pi)); the signs of y and x are negative in the basis.
pub const SH_C1: f64 = 0.488_602_511_902_919_9;
/// Factors of degree 2, in order m = -2..=2: of xy, yz, 2zz - xx - yy, xz, xx - yy.
pub const SH_C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// Factors of degree 3, in order m = -3..=3: of y(3xx - yy), xyz, y(4zz - xx - yy), z(2zz - 3xx - 3yy), x(4zz - xx -
/// yy), z(xx - yy), x(xx - 3yy).
pub const SH_C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// The first 16 basis functions at `dir` (a unit vector); `dir` is used as it is, not normalised.
pub fn sh_basis(dir: DVec3) -> [f64; 16] {
    let DVec3 { x, y, z } = dir;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    [
        SH_C0,
        -SH_C1 * y,
        SH_C1 * z,
        -SH_C1 * x,
        SH_C2[0] * x * y,
        SH_C2[1] * y * z,
        SH_C2[2] * (2.0 * zz - xx - yy),
        SH_C2[3] * x * z,
        SH_C2[4] * (xx - yy),
        SH_C3[0] * y * (3.0 * xx - yy),
        SH_C3[1] * x * y * z,
        SH_C3[2] * y * (4.0 * zz - xx - yy),
        SH_C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        SH_C3[4] * x * (4.0 * zz - xx - yy),
        SH_C3[5] * z * (xx - yy),
        SH_C3[6] * x * (xx - 3.0 * yy),
    ]
}

/// The gradients of `sh_basis` with respect to `dir`, as polynomials in three independent coordinates.
pub fn sh_basis_gradient(dir: DVec3) -> [DVec3; 16] {
    let DVec3 { x, y, z } = dir;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let v = DVec3::new;
    [
        DVec3::ZERO,
        -SH_C1 * DVec3::Y,
        SH_C1 * DVec3::Z,
        -SH_C1 * DVec3::X,
        SH_C2[0] * v(y, x, 0.0),
        SH_C2[1] * v(0.0, z, y),
        SH_C2[2] * v(-2.0 * x, -2.0 * y, 4.0 * z),
        SH_C2[3] * v(z, 0.0, x),
        SH_C2[4] * v(2.0 * x, -2.0 * y, 0.0),
        SH_C3[0] * v(6.0 * x * y, 3.0 * (xx - yy), 0.0),
        SH_C3[1] * v(y * z, x * z, x * y),
        SH_C3[2] * v(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z),
        SH_C3[3] * v(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * (xx + yy)),
        SH_C3[4] * v(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z),
        SH_C3[5] * v(2.0 * x * z, -2.0 * y * z, xx - yy),
        SH_C3[6] * v(3.0 * (xx - yy), -6.0 * x * y, 0.0),
    ]
}

/// Number of coefficients of degrees 0..=`degree`, per channel.
const fn sh_coefficients(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// Sum of coefficient times basis function at `dir` for `[C][rgb]` coefficients; C = (degree + 1)^2, at most 16.
/// Without the +0.5 and the clamp of the renderer.
pub fn eval_sh_f64(degree: u32, coefficients: &[DVec3], dir: DVec3) -> DVec3 {
    let basis = sh_basis(dir);
    let count = sh_coefficients(degree);
    basis.iter().zip(coefficients).take(count).fold(DVec3::ZERO, |sum, (&b, &c)| sum + b * c)
}

/// [`eval_sh_f64`] for coefficients as the scene stores them.
pub fn eval_sh(degree: u32, coefficients: &[[f32; 3]], dir: DVec3) -> DVec3 {
    let wide: Vec<DVec3> = coefficients.iter().map(|&c| widened(c)).collect();
    eval_sh_f64(degree, &wide, dir)
}

/// A stored rgb triple in f64.
pub fn widened(c: [f32; 3]) -> DVec3 {
    DVec3::new(f64::from(c[0]), f64::from(c[1]), f64::from(c[2]))
}

/// The matrices that rotate SH coefficients: one block per degree, because rotations do not mix degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct ShRotation {
    /// Block of degree 1: rows are output coefficients.
    band1: [[f64; 3]; 3],
    /// Block of degree 2: rows are output coefficients.
    band2: [[f64; 5]; 5],
    /// Block of degree 3: rows are output coefficients.
    band3: [[f64; 7]; 7],
}

impl ShRotation {
    /// The matrices of the rotation R: `eval(rotated, d) == eval(original, R^T d)` for all unit d.
    ///
    /// Entry (j, i) of a block is the projection of the rotated function on the basis, the integral over the sphere of
    /// Y_j(d) Y_i(R^T d). The integrand is a polynomial of degree at most 6, which the quadrature below integrates
    /// exactly.
    pub fn new(rotation: DMat3) -> Self {
        let mut out = Self { band1: [[0.0; 3]; 3], band2: [[0.0; 5]; 5], band3: [[0.0; 7]; 7] };
        let template_from_world = rotation.transpose();
        for (dir, weight) in quadrature_degree_7() {
            let fixed = sh_basis(dir);
            let turned = sh_basis(template_from_world * dir);
            accumulate(&mut out.band1, &fixed[1..4], &turned[1..4], weight);
            accumulate(&mut out.band2, &fixed[4..9], &turned[4..9], weight);
            accumulate(&mut out.band3, &fixed[9..16], &turned[9..16], weight);
        }
        out
    }

    /// The rotated coefficients; `coefficients` has (degree + 1)^2 entries for a degree of 0..=3.
    pub fn rotate(&self, coefficients: &[DVec3]) -> Vec<DVec3> {
        let mut out = Vec::with_capacity(coefficients.len());
        out.extend_from_slice(&coefficients[..1]);
        if coefficients.len() >= 4 {
            out.extend(product(&self.band1, &coefficients[1..4]));
        }
        if coefficients.len() >= 9 {
            out.extend(product(&self.band2, &coefficients[4..9]));
        }
        if coefficients.len() >= 16 {
            out.extend(product(&self.band3, &coefficients[9..16]));
        }
        out
    }
}

/// Adds the outer product weight * fixed * turned^T to the block.
fn accumulate<const N: usize>(block: &mut [[f64; N]; N], fixed: &[f64], turned: &[f64], weight: f64) {
    for (row, f) in block.iter_mut().zip(fixed) {
        for (entry, t) in row.iter_mut().zip(turned) {
            *entry += weight * f * t;
        }
    }
}

/// The matrix-vector product block * coefficients.
fn product<const N: usize>(block: &[[f64; N]; N], coefficients: &[DVec3]) -> [DVec3; N] {
    block.map(|row| row.iter().zip(coefficients).fold(DVec3::ZERO, |sum, (&b, &c)| sum + b * c))
}

/// Directions and weights (sum 4 pi) that integrate polynomials of degree <= 7 over the unit sphere exactly: four
/// Gauss-Legendre nodes in z (exact to degree 7) times eight equal steps in azimuth (exact to order 7).
fn quadrature_degree_7() -> impl Iterator<Item = (DVec3, f64)> {
    const AZIMUTHS: u32 = 8;
    let inner = (3.0 / 7.0 - 2.0 / 7.0 * (6.0f64 / 5.0).sqrt()).sqrt();
    let outer = (3.0 / 7.0 + 2.0 / 7.0 * (6.0f64 / 5.0).sqrt()).sqrt();
    let (inner_weight, outer_weight) = ((18.0 + 30f64.sqrt()) / 36.0, (18.0 - 30f64.sqrt()) / 36.0);
    let nodes = [(-outer, outer_weight), (-inner, inner_weight), (inner, inner_weight), (outer, outer_weight)];
    nodes.into_iter().flat_map(|(z, weight)| {
        let radius = (1.0 - z * z).sqrt();
        (0..AZIMUTHS).map(move |k| {
            let azimuth = 2.0 * PI * (f64::from(k) + 0.25) / f64::from(AZIMUTHS);
            let dir = DVec3::new(radius * azimuth.cos(), radius * azimuth.sin(), z);
            (dir, weight * 2.0 * PI / f64::from(AZIMUTHS))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::covariance::rotation_from_quat;
    use crate::math::rng::Rng;

    /// Orthonormality over the sphere: wrong constants or a wrong polynomial fail it. Measured: 8.9e-16.
    #[test]
    fn the_basis_is_orthonormal() {
        for i in 0..16 {
            for j in 0..16 {
                let integral: f64 = quadrature_degree_7().map(|(d, w)| w * sh_basis(d)[i] * sh_basis(d)[j]).sum();
                let want = if i == j { 1.0 } else { 0.0 };
                assert!((integral - want).abs() < 2e-15, "{i} {j}: {integral}");
            }
        }
    }

    /// Signs and order at the axes, written out from the INRIA definition.
    #[test]
    fn signs_and_order() {
        let (x, y, z) = (sh_basis(DVec3::X), sh_basis(DVec3::Y), sh_basis(DVec3::Z));
        assert_eq!([y[1], z[2], x[3]], [-SH_C1, SH_C1, -SH_C1]);
        assert_eq!([z[6], x[8], y[8]], [2.0 * SH_C2[2], SH_C2[4], -SH_C2[4]]);
        assert_eq!([y[9], z[12], x[15]], [-SH_C3[0], 2.0 * SH_C3[3], SH_C3[6]]);
    }

    /// Against central differences, directions of any length. Measured: 4.5e-10.
    #[test]
    fn basis_gradients_agree_with_differences() {
        let mut rng = Rng::new(3);
        let step = 1e-6;
        let mut worst: f64 = 0.0;
        for _ in 0..100 {
            let dir = rng.normal_vector();
            let gradient = sh_basis_gradient(dir);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let (plus, minus) = (sh_basis(dir + step * axis), sh_basis(dir - step * axis));
                for k in 0..16 {
                    let difference = (plus[k] - minus[k]) / (2.0 * step);
                    worst = worst.max((gradient[k].dot(axis) - difference).abs() / (1.0 + difference.abs()));
                }
            }
        }
        assert!(worst < 1e-8, "{worst:e}");
    }

    fn worst_rotation_error(degree: u32, spoil: bool) -> f64 {
        let mut rng = Rng::new(100 + u64::from(degree));
        let mut worst: f64 = 0.0;
        for _ in 0..200 {
            let rotation = rotation_from_quat(rng.rotation_quat());
            let original: Vec<DVec3> = (0..sh_coefficients(degree)).map(|_| rng.normal_vector()).collect();
            let mut rotated = ShRotation::new(rotation).rotate(&original);
            if spoil {
                *rotated.last_mut().unwrap() *= -1.0;
            }
            for _ in 0..20 {
                let dir = rng.unit_vector();
                let want = eval_sh_f64(degree, &original, rotation.transpose() * dir);
                worst = worst.max((eval_sh_f64(degree, &rotated, dir) - want).abs().max_element());
            }
        }
        worst
    }

    /// Measured over 4000 (rotation, direction) pairs per degree: 0, 8.9e-16, 2.3e-15, 2.7e-15.
    #[test]
    fn rotated_coefficients_show_the_same_function_turned() {
        for degree in 0..=3 {
            let worst = worst_rotation_error(degree, false);
            assert!(worst < 1e-12, "degree {degree}: {worst:e}");
        }
    }

    /// The difference that must be detected. Measured: 1.9 and more.
    #[test]
    fn the_rotation_check_fails_on_a_flipped_sign() {
        assert!((0..=3).all(|degree| worst_rotation_error(degree, true) > 0.1));
    }

    /// Rotating twice is rotating by the product. Measured: 1.4e-15.
    #[test]
    fn rotations_compose() {
        let mut rng = Rng::new(9);
        let (a, b) = (rotation_from_quat(rng.rotation_quat()), rotation_from_quat(rng.rotation_quat()));
        let c: Vec<DVec3> = (0..16).map(|_| rng.normal_vector()).collect();
        let once = ShRotation::new(a * b).rotate(&c);
        let twice = ShRotation::new(a).rotate(&ShRotation::new(b).rotate(&c));
        assert!(once.iter().zip(&twice).all(|(p, q)| (*p - *q).length() < 1e-13));
    }
}
