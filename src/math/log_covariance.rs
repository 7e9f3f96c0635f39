//! The logarithm of a Gaussian's covariance, in six numbers.
//!
//! Sizes and rotation say the same ellipsoid in 24 ways, one for each order and direction of its axes, and nearly round ones say
//! nearly the same with any rotation. The logarithm of the covariance, L = R diag(2 log s) R^T, has neither fault: ellipsoids that
//! are alike have numbers that are alike. Its six coordinates belong to an orthonormal basis of the symmetric matrices, so that
//! equal steps in each of them change the matrix equally: the trace over sqrt 3, the two differences of the diagonal, and sqrt 2
//! times yz, xz and xy.

use glam::{DMat3, DVec3};

use super::covariance::{quat_from_rotation, quat_multiply, rotation_from_quat};

/// The coordinates of the logarithm of a covariance, natural logarithms of scene units squared.
pub type LogCovariance = [f64; 6];

/// A Gaussian's shape as the parameters of a cloud have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Rotation (w, x, y, z), of any length but zero.
    pub quat: [f64; 4],
    /// Logarithms of the standard deviations along its axes.
    pub log_scales: [f64; 3],
}

/// How a number changes with a [`Shape`]: the derivatives by its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeDerivative {
    /// By w, x, y and z.
    pub quat: [f64; 4],
    /// By the logarithms of the standard deviations.
    pub log_scales: [f64; 3],
}

/// Two logarithms of variances nearer than this count as equal: the derivative by a turn, which is divided by their difference, is
/// mostly rounding there.
const EQUAL: f64 = 0.02;
/// At most so many rounds of turns in the three planes. Convergence is quadratic: nearly all matrices take three or four.
const SWEEPS: usize = 12;
/// Sum of squares off the diagonal, relative to that on it, that counts as zero: far below the precision of the f32 that are coded.
const CONVERGED: f64 = 1e-24;
/// The rotation that is none: shapes near it take the least time.
pub const NO_TURN: [f64; 4] = [1.0, 0.0, 0.0, 0.0];
/// The orders of three axes.
const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/// The coordinates of a shape; NaN for a quaternion that is zero or not finite.
pub fn log_covariance(shape: &Shape) -> LogCovariance {
    let rotation = rotation_from_quat(shape.quat);
    let logs = DVec3::from_array(shape.log_scales) * 2.0;
    coordinates(rotation * DMat3::from_diagonal(logs) * rotation.transpose())
}

/// The shape of these coordinates whose axes are the nearest to those of the rotation `near` (w, x, y, z), in order and direction.
/// The quaternion is the one of the two whose product with `near` is positive, and has length 1.
pub fn nearest_shape(coordinates: &LogCovariance, near: [f64; 4]) -> Shape {
    let [pairs] = eigen([matrix(coordinates)]);
    nearest(pairs, near)
}

/// [`nearest_shape`] of several, which takes less time for each.
pub fn nearest_shapes<const N: usize>(coordinates: &[LogCovariance; N], near: &[[f64; 4]; N]) -> [Shape; N] {
    let pairs = eigen(coordinates.each_ref().map(matrix));
    std::array::from_fn(|i| nearest(pairs[i], near[i]))
}

/// The shape with these variances (their logarithms) along these axes.
fn nearest(pairs: [(f64, DVec3); 3], near: [f64; 4]) -> Shape {
    let axes = pairs.map(|(_, axis)| axis);
    let along = if near == NO_TURN {
        axes
    } else {
        let near_from_scene = rotation_from_quat(near).transpose();
        axes.map(|axis| near_from_scene * axis)
    };
    let size = along.map(DVec3::abs);
    let mut most = f64::NEG_INFINITY;
    let mut order = ORDERS[0];
    for other in ORDERS {
        let sum = size[other[0]].x + size[other[1]].y + size[other[2]].z;
        if sum > most {
            (most, order) = (sum, other);
        }
    }
    let directed = std::array::from_fn::<_, 3, _>(|k| {
        let axis = pairs[order[k]].1;
        if along[order[k]][k] < 0.0 { -axis } else { axis }
    });
    // This is no mirror image, whose trace beside the other rotation would be at most 1: the sums of the six orders are at least 1
    // on average, as the squares of the nine numbers are 3 together, and if all are equal to 1, the numbers are 0 or 1 and a sum is 3.
    let quat = quat_from_rotation(DMat3::from_cols(directed[0], directed[1], directed[2]));
    let dot: f64 = quat.iter().zip(near).map(|(a, b)| a * b).sum();
    Shape { quat: if dot < 0.0 { quat.map(|v| -v) } else { quat }, log_scales: order.map(|axis| pairs[axis].0 / 2.0) }
}

/// Eigenvalues and unit eigenvectors of several matrices, by Jacobi's method. For 3 by 3 alone, and several times as fast as
/// `math::eigen`: a scene has millions of these. Each has the same result whatever the others are, but for the sign of a zero.
fn eigen<const N: usize>(matrices: [DMat3; N]) -> [[(f64, DVec3); 3]; N] {
    let mut turning = Turning { a: [[[0.0; N]; 3]; 3], vectors: [[[0.0; N]; 3]; 3] };
    for (lane, matrix) in matrices.iter().enumerate() {
        for (i, column) in matrix.to_cols_array_2d().iter().enumerate() {
            (0..3).for_each(|j| turning.a[i][j][lane] = column[j]);
            turning.vectors[i][i][lane] = 1.0;
        }
    }
    for _ in 0..SWEEPS {
        let turns = turning.lanes_that_turn();
        if turns == [false; N] {
            break;
        }
        turning.turn::<0, 1, 2>(turns);
        turning.turn::<0, 2, 1>(turns);
        turning.turn::<1, 2, 0>(turns);
    }
    let mut pairs = [[(0.0, DVec3::ZERO); 3]; N];
    for (lane, pairs) in pairs.iter_mut().enumerate() {
        for (k, pair) in pairs.iter_mut().enumerate() {
            let [x, y, z] = &turning.vectors[k];
            *pair = (turning.a[k][k][lane], DVec3::new(x[lane], y[lane], z[lane]));
        }
    }
    pairs
}

/// Symmetric matrices on their way to diagonal ones, one a lane, so that the compiler may use vector instructions. Of the numbers
/// off the diagonal those with the lower index first are kept.
struct Turning<const N: usize> {
    a: [[[f64; N]; 3]; 3],
    /// By axis.
    vectors: [[[f64; N]; 3]; 3],
}

impl<const N: usize> Turning<N> {
    /// The lanes whose matrix is not diagonal yet.
    fn lanes_that_turn(&self) -> [bool; N] {
        let [[x, xy, xz], [_, y, yz], [_, _, z]] = &self.a;
        let sum = |a: f64, b: f64, c: f64| a * a + b * b + c * c;
        std::array::from_fn(|l| {
            let converged = sum(xy[l], xz[l], yz[l]) <= CONVERGED * sum(x[l], y[l], z[l]);
            // A matrix with a number that is none turns on, until it has no other: poison stays poison.
            !converged
        })
    }

    /// Turns in the plane of axes P < Q so that `a[P][Q]` becomes 0, in some lanes; R is the third axis.
    #[inline(always)]
    fn turn<const P: usize, const Q: usize, const R: usize>(&mut self, lanes: [bool; N]) {
        let (mut cosines, mut sines) = ([0.0; N], [0.0; N]);
        for l in 0..N {
            // A turn by exactly nothing changes nothing but the sign of a zero.
            let off = if lanes[l] { self.a[P][Q][l] } else { 0.0 };
            let apart = self.a[Q][Q][l] - self.a[P][P][l];
            let reach = apart.abs() + (apart * apart + 4.0 * off * off).sqrt();
            // 0 where there is nothing to turn.
            let tan = (2.0 * off).copysign(off * apart) / reach.max(f64::MIN_POSITIVE);
            cosines[l] = 1.0 / (1.0 + tan * tan).sqrt();
            sines[l] = tan * cosines[l];
            self.a[P][P][l] -= tan * off;
            self.a[Q][Q][l] += tan * off;
            self.a[P][Q][l] -= off;
        }
        let [to_p, to_q] = [[P.min(R), P.max(R)], [Q.min(R), Q.max(R)]];
        for l in 0..N {
            let (p, q) = (self.a[to_p[0]][to_p[1]][l], self.a[to_q[0]][to_q[1]][l]);
            self.a[to_p[0]][to_p[1]][l] = cosines[l] * p - sines[l] * q;
            self.a[to_q[0]][to_q[1]][l] = sines[l] * p + cosines[l] * q;
        }
        for i in 0..3 {
            for l in 0..N {
                let (p, q) = (self.vectors[P][i][l], self.vectors[Q][i][l]);
                self.vectors[P][i][l] = cosines[l] * p - sines[l] * q;
                self.vectors[Q][i][l] = sines[l] * p + cosines[l] * q;
            }
        }
    }
}

/// The derivative by the coordinates, of what depends on the covariance alone and has this derivative by a shape.
pub fn derivative(shape: &Shape, by: &ShapeDerivative) -> LogCovariance {
    let rotation = rotation_from_quat(shape.quat);
    // By a turn about each axis of the Gaussian itself, radians.
    let turn = |k: usize| {
        let mut unit = [0.0; 4];
        unit[k + 1] = 0.5;
        quat_multiply(shape.quat, unit).iter().zip(by.quat).map(|(a, b)| a * b).sum::<f64>()
    };
    let own = |k: usize| by.log_scales[k] / 2.0;
    let mut matrix = DMat3::from_diagonal(DVec3::new(own(0), own(1), own(2)));
    for (i, j, k) in [(1, 2, 0), (2, 0, 1), (0, 1, 2)] {
        // A turn by w about axis k changes L_ij and L_ji by w (L_ii - L_jj).
        let apart = 2.0 * (shape.log_scales[i] - shape.log_scales[j]);
        // In a round section no turn is seen, and axes turned by 45 degrees are as good as these.
        let value = if apart.abs() < EQUAL { (own(i) - own(j)) / 2.0 } else { turn(k) / (2.0 * apart) };
        matrix.col_mut(j)[i] = value;
        matrix.col_mut(i)[j] = value;
    }
    coordinates(rotation * matrix * rotation.transpose())
}

/// The coordinates of a symmetric matrix.
fn coordinates(m: DMat3) -> LogCovariance {
    let [x, y, z] = [m.x_axis.x, m.y_axis.y, m.z_axis.z];
    let root = std::f64::consts::SQRT_2;
    [
        (x + y + z) / 3f64.sqrt(),
        (x - y) / root,
        (x + y - 2.0 * z) / 6f64.sqrt(),
        root * m.z_axis.y,
        root * m.z_axis.x,
        root * m.y_axis.x,
    ]
}

/// The inverse of [`coordinates`].
fn matrix(coordinates: &LogCovariance) -> DMat3 {
    let [trace, xy_apart, z_apart, yz, xz, xy] = *coordinates;
    let mean = trace / 3f64.sqrt();
    let [half, third] = [xy_apart / std::f64::consts::SQRT_2, z_apart / 6f64.sqrt()];
    let [yz, xz, xy] = [yz, xz, xy].map(|v| v / std::f64::consts::SQRT_2);
    DMat3::from_cols_array(&[mean + half + third, xy, xz, xy, mean - half + third, yz, xz, yz, mean - 2.0 * third])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::covariance::{covariance, normalised_quat};
    use crate::math::rng::Rng;

    fn random(rng: &mut Rng) -> Shape {
        Shape { quat: std::array::from_fn(|_| rng.normal()), log_scales: std::array::from_fn(|_| rng.normal() - 2.0) }
    }

    fn covariance_of(shape: &Shape) -> DMat3 {
        covariance(shape.quat, DVec3::from_array(shape.log_scales))
    }

    /// The largest difference, as a part of the largest number.
    fn apart(a: DMat3, b: DMat3) -> f64 {
        let most = |m: DMat3| m.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
        most(a - b) / most(a)
    }

    #[test]
    fn a_shape_comes_back_as_it_was_near_its_own_rotation() {
        let mut rng = Rng::new(3);
        for case in 0..500 {
            let shape = random(&mut rng);
            let back = nearest_shape(&log_covariance(&shape), shape.quat);
            let quat = normalised_quat(shape.quat);
            for (a, b) in quat.iter().zip(back.quat).chain(shape.log_scales.iter().zip(back.log_scales)) {
                assert!((a - b).abs() < 1e-9, "{case}: {shape:?} {back:?}");
            }
            // Far from it, it is the same ellipsoid, turned by less than any of the others.
            let near = random(&mut rng).quat;
            let other = nearest_shape(&log_covariance(&shape), near);
            assert!(apart(covariance_of(&shape), covariance_of(&other)) < 1e-9, "{case}");
            let dot = |quat: [f64; 4]| quat.iter().zip(normalised_quat(near)).map(|(a, b)| a * b).sum::<f64>();
            let half_turns: [[f64; 4]; 4] =
                std::array::from_fn(|i| std::array::from_fn(|k| f64::from(u8::from(i == k))));
            // The 24 turns of a cube: none or a half, none or one or two thirds, none or a quarter.
            let root = std::f64::consts::FRAC_1_SQRT_2;
            let (quarter, third) = ([root, 0.0, 0.0, root], [0.5; 4]);
            let thirds = [[1.0, 0.0, 0.0, 0.0], third, quat_multiply(third, third)];
            for (half, third) in half_turns.into_iter().flat_map(|half| thirds.map(|third| (half, third))) {
                let turn = quat_multiply(half, third);
                for turn in [turn, quat_multiply(turn, quarter)] {
                    assert!(dot(quat_multiply(other.quat, turn)).abs() < dot(other.quat) + 1e-9, "{case}");
                }
            }
        }
    }

    #[test]
    fn several_at_once_are_what_they_are_alone() {
        let mut rng = Rng::new(13);
        for _ in 0..100 {
            // A round one, and one along the axes of the scene, turn less than others; one that is no number never ends to.
            let mut all: [LogCovariance; 5] = std::array::from_fn(|_| log_covariance(&random(&mut rng)));
            all[1] = [0.0; 6];
            all[2][3..].fill(0.0);
            all[3][4] = f64::NAN;
            let near = std::array::from_fn(|_| random(&mut rng).quat);
            let together = nearest_shapes(&all, &near);
            for (i, shape) in together.iter().enumerate() {
                let alone = nearest_shape(&all[i], near[i]);
                let values = |shape: &Shape| shape.quat.into_iter().chain(shape.log_scales).collect::<Vec<_>>();
                let [together, alone] = [shape, &alone].map(values);
                if i == 3 {
                    assert!(together.iter().chain(&alone).all(|value| value.is_nan()), "{together:?} {alone:?}");
                } else {
                    assert_eq!(together, alone, "{i}");
                }
            }
        }
    }

    #[test]
    fn like_ellipsoids_have_like_coordinates() {
        let one = log_covariance(&Shape { quat: [1.0, 0.0, 0.0, 0.0], log_scales: [-1.0, -2.0, -2.001] });
        // Another order of the axes, and a nearly round section turned.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let ordered = log_covariance(&Shape { quat: [half, 0.0, 0.0, half], log_scales: [-2.0, -1.0, -2.001] });
        let turned = log_covariance(&Shape { quat: [0.9, 0.3, 0.0, 0.0], log_scales: [-1.0, -2.0, -2.001] });
        for (a, b) in one.iter().zip(ordered) {
            assert!((a - b).abs() < 1e-12);
        }
        for (a, b) in one.iter().zip(turned) {
            assert!((a - b).abs() < 2e-3);
        }
        // The sum of squares is that of the logarithms of the variances.
        let squares: f64 = one.iter().map(|v| v * v).sum();
        assert!((squares - 4.0 * (1.0 + 4.0 + 2.001f64.powi(2))).abs() < 1e-12);
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let mut rng = Rng::new(7);
        for case in 0..200 {
            let shape = random(&mut rng);
            // A function of the covariance alone.
            let weights = DMat3::from_cols_array(&std::array::from_fn(|_| rng.normal()));
            let value = |shape: &Shape| {
                let m = covariance_of(shape);
                (0..3).map(|k| m.col(k).dot(weights.col(k))).sum::<f64>()
            };
            let step = 1e-5;
            let by_shape = |change: &dyn Fn(&mut Shape, f64)| {
                let moved = |by| {
                    let mut shape = shape;
                    change(&mut shape, by);
                    value(&shape)
                };
                (moved(step) - moved(-step)) / (2.0 * step)
            };
            let by = ShapeDerivative {
                quat: std::array::from_fn(|i| by_shape(&|shape, by| shape.quat[i] += by)),
                log_scales: std::array::from_fn(|i| by_shape(&|shape, by| shape.log_scales[i] += by)),
            };
            let got = derivative(&shape, &by);
            let start = log_covariance(&shape);
            let most = got.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            for i in 0..6 {
                let moved = |by: f64| {
                    let mut coordinates = start;
                    coordinates[i] += by;
                    value(&nearest_shape(&coordinates, shape.quat))
                };
                let want = (moved(step) - moved(-step)) / (2.0 * step);
                let nearest = (0..3).map(|k| shape.log_scales[k] - shape.log_scales[(k + 1) % 3]);
                // Where two sizes are nearly equal, a mean stands for the derivative (the next test).
                if nearest.fold(f64::MAX, |least, v| least.min(v.abs())) > EQUAL {
                    assert!((got[i] - want).abs() < 1e-5 * most, "{case}, {i}: {} {want}", got[i]);
                }
            }
        }
    }

    /// In a round section the derivative has the size that it has with other axes.
    #[test]
    fn round_sections_have_derivatives_of_the_right_size() {
        let by = ShapeDerivative { quat: [0.0; 4], log_scales: [3.0, 1.0, 0.5] };
        let shape = |apart: f64| Shape { quat: [1.0, 0.0, 0.0, 0.0], log_scales: [-1.0, -1.0 - apart, -3.0] };
        let [_, _, _, _, _, xy] = derivative(&shape(0.0), &by);
        // The number beside the diagonal is half the difference of the two on it, and the coordinate sqrt 2 times that.
        assert!((xy - std::f64::consts::SQRT_2 * (1.5 - 0.5) / 2.0).abs() < 1e-12, "{xy}");
        // With sizes apart, a turn says it: none here.
        assert_eq!(derivative(&shape(0.5), &by)[5], 0.0);
    }

    #[test]
    fn poison_stays_poison() {
        let of = |quat, log_scales| log_covariance(&Shape { quat, log_scales });
        assert!(of([0.0; 4], [0.0; 3]).iter().all(|v| v.is_nan()));
        assert!(of([1.0, 0.0, 0.0, 0.0], [f64::NEG_INFINITY, 0.0, 0.0]).iter().any(|v| !v.is_finite()));
        // Round ones have no axes: those of the other rotation are as good as any.
        let round = nearest_shape(&[0.0; 6], [0.5, -0.5, 0.5, 0.5]);
        assert_eq!(round.log_scales, [0.0; 3]);
        assert!(round.quat.iter().all(|v| v.is_finite()));
    }
}
