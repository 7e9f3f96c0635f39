//! Lens distortion on normalised image coordinates: OpenCV's model with three radial and two tangential terms, or its model
//! of fisheye lenses, whose picture grows with the angle from the axis.

/// Lens distortion. Coordinates are those of the view's plane z = 1 (x right,
/// y down, no unit): `x = (u - cx) / fx`. The coefficients have no unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial coefficient of r^2.
    pub k1: f64,
    /// Radial coefficient of r^4.
    pub k2: f64,
    /// First tangential coefficient.
    pub p1: f64,
    /// Second tangential coefficient.
    pub p2: f64,
    /// Radial coefficient of r^6.
    pub k3: f64,
    /// A fisheye lens: the radius in the photo is t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8), t being the angle from the axis.
    /// The other coefficients are then 0.
    pub fisheye: Option<[f64; 4]>,
}

/// Upper limit on Newton steps. The number of correct digits doubles with every step; within a real photo fewer than
/// ten are needed.
const NEWTON_STEPS: usize = 30;
/// Tolerance of `undistort`: a millionth of a pixel or better, since focal lengths are below 1e5 pixels.
const UNDISTORTED: f64 = 1e-11;

/// Steps at which a fisheye's radius is looked at for where it stops growing: a quarter of a degree.
const ANGLE_STEPS: usize = 360;

/// Radius in the photo of a fisheye lens at an angle from the axis, and its derivative.
fn fisheye_radius([k1, k2, k3, k4]: [f64; 4], angle: f64) -> [f64; 2] {
    let s = angle * angle;
    let radius = angle * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
    [radius, 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))]
}

/// The angle up to which the radius of a fisheye lens grows, at most a right angle.
fn fisheye_fold(k: [f64; 4]) -> f64 {
    let right = std::f64::consts::FRAC_PI_2;
    let at = |step: usize| right * step as f64 / ANGLE_STEPS as f64;
    let slope = |angle: f64| fisheye_radius(k, angle)[1];
    match (1..=ANGLE_STEPS).find(|&step| slope(at(step)) <= 0.0) {
        Some(step) => bisected(slope, at(step - 1), at(step)),
        None => right,
    }
}

impl Distortion {
    /// `None` if all coefficients are zero: then nothing needs to be undistorted.
    pub fn if_any(self) -> Option<Self> {
        (self != Self::default()).then_some(self)
    }

    /// Maps the undistorted (pinhole) position (x, y) to its distorted position in the photo.
    pub fn distort(&self, x: f64, y: f64) -> [f64; 2] {
        if let Some(k) = self.fisheye {
            let r = x.hypot(y);
            // Near the axis the angle is the radius.
            let scale = if r < 1e-8 { 1.0 } else { fisheye_radius(k, r.atan())[0] / r };
            return [x * scale, y * scale];
        }
        let Self { k1, k2, p1, p2, k3, .. } = *self;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// Maps the distorted position (x, y) to its undistorted (pinhole) position: the inverse of
    /// [`Distortion::distort`], by Newton's method; `None` beyond the radius where the model folds over.
    pub fn undistort(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        if let Some(k) = self.fisheye {
            return undistorted_fisheye(k, x, y);
        }
        let Self { k1, k2, p1, p2, k3, .. } = *self;
        let fold = self.fold_radius_squared();
        let [mut u, mut v] = [x, y];
        for _ in 0..NEWTON_STEPS {
            let [drawn_x, drawn_y] = self.distort(u, v);
            let (off_x, off_y) = (drawn_x - x, drawn_y - y);
            let r2 = u * u + v * v;
            if off_x.abs().max(off_y.abs()) < UNDISTORTED {
                return (r2 < fold).then_some([u, v]);
            }
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
            let xx = radial + slope * u * u + 2.0 * p1 * v + 6.0 * p2 * u;
            let xy = slope * u * v + 2.0 * p1 * u + 2.0 * p2 * v;
            let yy = radial + slope * v * v + 6.0 * p1 * v + 2.0 * p2 * u;
            // A determinant of 0 gives NaN or infinity, for which the loop never reports convergence.
            let determinant = xx * yy - xy * xy;
            u -= (yy * off_x - xy * off_y) / determinant;
            v -= (xx * off_y - xy * off_x) / determinant;
        }
        None
    }

    /// Squared radius from which on the radial terms fold the image over: up to it and no further, the distorted radius
    /// `r (1 + k1 r^2 + k2 r^4 + k3 r^6)` grows. Infinite if it grows everywhere. The model is meaningless beyond.
    pub fn fold_radius_squared(&self) -> f64 {
        if let Some(k) = self.fisheye {
            let fold = fisheye_fold(k);
            return if fold < std::f64::consts::FRAC_PI_2 { fold.tan().powi(2) } else { f64::INFINITY };
        }
        // The derivative of the distorted radius, in s = r^2.
        first_root([3.0 * self.k1, 5.0 * self.k2, 7.0 * self.k3])
    }
}

/// The pinhole position of a place in the photo of a fisheye lens; `None` from a right angle, or the fold, on.
fn undistorted_fisheye(k: [f64; 4], x: f64, y: f64) -> Option<[f64; 2]> {
    let radius = x.hypot(y);
    if radius < 1e-8 {
        return Some([x, y]);
    }
    let fold = fisheye_fold(k);
    if radius >= fisheye_radius(k, fold)[0] {
        return None;
    }
    // The radius grows up to the fold.
    let angle = bisected(|angle| radius - fisheye_radius(k, angle)[0], 0.0, fold);
    let scale = angle.tan() / radius;
    scale.is_finite().then_some([x * scale, y * scale])
}

/// The smallest positive root of 1 + b s + a s^2 + c s^3; infinite if there is none.
fn first_root([b, a, c]: [f64; 3]) -> f64 {
    if c == 0.0 {
        return smaller_root(1.0, b, a);
    }
    let at = |s: f64| 1.0 + s * (b + s * (a + s * c));
    // All roots have a smaller magnitude than this (Cauchy's bound).
    let farthest = 1.0 + [1.0, b, a].into_iter().fold(0.0, |most: f64, v| most.max((v / c).abs()));
    // The polynomial is monotonic between its extrema, so the first root lies between two consecutive ones of 0, the
    // extrema and the bound.
    let turns = [smaller_root(b, 2.0 * a, 3.0 * c), larger_root(b, 2.0 * a, 3.0 * c), farthest];
    let mut low = 0.0;
    for high in turns.into_iter().filter(|s| *s <= farthest) {
        if at(high) <= 0.0 {
            return bisected(at, low, high);
        }
        low = high;
    }
    f64::INFINITY
}

/// The smallest positive root of c + b s + a s^2; infinite if there is none.
fn smaller_root(c: f64, b: f64, a: f64) -> f64 {
    positive_roots(c, b, a).into_iter().fold(f64::INFINITY, f64::min)
}

/// The larger of the positive roots of c + b s + a s^2; infinite if there are fewer than two.
fn larger_root(c: f64, b: f64, a: f64) -> f64 {
    positive_roots(c, b, a).into_iter().fold(f64::NEG_INFINITY, f64::max)
}

/// Both roots of c + b s + a s^2, infinite for those that are not positive. Written so that a may be zero: s = 2 c /
/// (-b + sqrt(b^2 - 4 a c)), and the same with the other sign of the square root.
fn positive_roots(c: f64, b: f64, a: f64) -> [f64; 2] {
    let root = (b * b - 4.0 * a * c).sqrt();
    [root, -root].map(|d| 2.0 * c / (d - b)).map(|s| if s > 0.0 { s } else { f64::INFINITY })
}

/// The zero of a function that is positive at `low` and not positive at `high`, by bisection.
fn bisected(at: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return high;
        }
        if at(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: x = 0.5, y = -0.25: r^2 = 0.3125, radial = 1 + 0.03125 - 0.01953125 = 1.01171875.
    #[test]
    fn the_model_by_hand() {
        let d = Distortion { k1: 0.1, k2: -0.2, p1: 0.01, p2: -0.02, k3: 0.0, fisheye: None };
        let [x, y] = d.distort(0.5, -0.25);
        let want_x = 0.505859375 + 2.0 * 0.01 * -0.125 - 0.02 * (0.3125 + 0.5);
        let want_y = -0.2529296875 + 0.01 * (0.3125 + 0.125) + 2.0 * -0.02 * -0.125;
        assert!((x - want_x).abs() < 1e-15 && (y - want_y).abs() < 1e-15, "{x} {y}");
        assert_eq!(Distortion::default().distort(3.0, 4.0), [3.0, 4.0]);
        // Here r^6 = 64.
        assert_eq!(Distortion { k3: 0.5, ..Distortion::default() }.distort(0.0, 2.0), [0.0, 66.0]);
        assert_eq!((Distortion::default().if_any(), d.if_any()), (None, Some(d)));
    }

    #[test]
    fn fisheye_pictures_grow_with_the_angle() {
        let equidistant = Distortion { fisheye: Some([0.0; 4]), ..Distortion::default() };
        // 45 degrees from the axis, to the right: pi / 4 from the centre.
        let [x, y] = equidistant.distort(1.0, 0.0);
        assert!((x - std::f64::consts::FRAC_PI_4).abs() < 1e-15 && y == 0.0);
        assert!(equidistant.if_any().is_some() && equidistant.fold_radius_squared() == f64::INFINITY);
        // By hand: t = pi / 4, t^2 = 0.61685, 1 + 0.1 * 0.61685 - 0.02 * 0.61685^2.
        let k = Distortion { fisheye: Some([0.1, -0.02, 0.0, 0.0]), ..Distortion::default() };
        let t = std::f64::consts::FRAC_PI_4;
        let want = t * (1.0 + 0.1 * t * t - 0.02 * t.powi(4));
        assert!((k.distort(0.6, 0.8)[1] - 0.8 * want).abs() < 1e-15);
        for d in [equidistant, k, Distortion { fisheye: Some([-0.1, 0.02, 0.01, -0.03]), ..Distortion::default() }] {
            for (x, y) in [(0.0, 0.0), (0.3, -0.2), (-1.0, 0.5), (1.5, 1.0), (1e-9, 0.0)] {
                let [u, v] = d.distort(x, y);
                let [a, b] = d.undistort(u, v).expect("is in the picture");
                assert!((a - x).abs() < 1e-9 && (b - y).abs() < 1e-9, "{d:?} {x} {y}: {a} {b}");
            }
        }
        // Beyond a right angle, and beyond the fold: t - t^3 / 3 grows up to t = 1.
        assert_eq!(equidistant.undistort(1.6, 0.0), None);
        let folds = Distortion { fisheye: Some([-1.0 / 3.0, 0.0, 0.0, 0.0]), ..Distortion::default() };
        assert!((folds.fold_radius_squared() - 1f64.tan().powi(2)).abs() < 1e-9);
        assert_eq!(folds.undistort(0.67, 0.0), None);
        assert!(folds.undistort(0.66, 0.0).is_some());
    }

    #[test]
    fn undistorting_finds_what_was_distorted() {
        for d in [
            Distortion { k1: 0.1, k2: -0.02, p1: 0.01, p2: -0.02, k3: 0.0, fisheye: None },
            Distortion { k1: -0.3, k2: 0.1, p1: 0.0, p2: 0.001, k3: -0.02, fisheye: None },
            Distortion::default(),
        ] {
            for i in 0..100 {
                let (x, y) = (0.016 * f64::from(i % 10) - 0.6, 0.09 * f64::from(i / 10) - 0.4);
                let [u, v] = d.distort(x, y);
                let found = d.undistort(u, v).unwrap();
                assert!((found[0] - x).abs() < 1e-9 && (found[1] - y).abs() < 1e-9, "{d:?} {x} {y} {found:?}");
            }
        }
        // This lens images nothing farther out than 2/3 of sqrt(4/3).
        let barrel = Distortion { k1: -0.25, ..Distortion::default() };
        assert!(barrel.undistort(0.7, 0.0).is_some() && barrel.undistort(0.8, 0.0).is_none());
        assert_eq!(barrel.undistort(f64::NAN, 0.0), None);
    }

    #[test]
    fn the_fold_is_where_the_drawn_radius_stops_growing() {
        let fold = |k1, k2, k3| Distortion { k1, k2, k3, ..Distortion::default() }.fold_radius_squared();
        // No root, no positive root, one root (k2 = 0), two roots, and one of each sign.
        for (k1, k2, k3) in [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.1, 0.2, 0.0), (0.1, 0.2, 0.3), (-0.2, 0.1, 0.05)] {
            assert_eq!(fold(k1, k2, k3), f64::INFINITY, "{k1} {k2} {k3}");
        }
        assert!((fold(-0.25, 0.0, 0.0) - 4.0 / 3.0).abs() < 1e-15);
        let radial = [(-0.25, 0.0), (-0.5, 0.05), (0.3, -0.1), (0.0, -0.2), (-0.2, -0.1)].map(|(k1, k2)| (k1, k2, 0.0));
        // Sixth order: nearly the same lenses, folds that k3 causes, and one that it cannot prevent.
        let sixth = [(-0.25, 0.0, 1e-9), (0.3, -0.1, -1e-9), (0.2, 0.1, -0.3), (0.0, 0.0, -0.1), (-0.5, 0.05, 0.01)];
        for (k1, k2, k3) in radial.into_iter().chain(sixth) {
            let s: f64 = fold(k1, k2, k3);
            let drawn = |r2: f64| Distortion { k1, k2, k3, ..Distortion::default() }.distort(r2.sqrt(), 0.0)[0];
            let grows = (1..1000).all(|i| drawn(s * f64::from(i) / 1000.0) > drawn(s * f64::from(i - 1) / 1000.0));
            assert!(s.is_finite() && grows && drawn(s * 1.01) < drawn(s), "{k1} {k2} {k3}: {s}");
        }
    }
}
