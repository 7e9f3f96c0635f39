//! Even point sets on parametric surfaces.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use instgs_vk::math::rng::Rng;

/// A sample of a surface: a point, its normal and the spacing of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Position, scene units.
    pub position: DVec3,
    /// Unit normal, outwards.
    pub normal: DVec3,
    /// Smallest distance to another surfel of the same surface, scene units.
    pub spacing: f64,
}

/// Candidates per point of the densest packing: more gain few further points.
const CANDIDATES_PER_POINT: f64 = 9.0;
/// Cells per side in which a patch's area is measured.
const AREA_CELLS: usize = 64;

/// Accepted points in cells, for distance queries.
#[derive(Default)]
pub struct PointGrid {
    cell: f64,
    cells: HashMap<[i32; 3], Vec<DVec3>>,
}

impl PointGrid {
    /// An empty grid whose cells have the given side.
    pub fn new(cell: f64) -> Self {
        Self { cell, cells: HashMap::new() }
    }

    fn cell_of(&self, p: DVec3) -> [i32; 3] {
        (p / self.cell).floor().as_ivec3().to_array()
    }

    /// Adds `p` if no point is nearer than `distance`; true if it was added.
    pub fn insert_apart(&mut self, p: DVec3, distance: f64) -> bool {
        let (low, high) = (self.cell_of(p - distance), self.cell_of(p + distance));
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
                    let near = |q: &DVec3| (*q - p).length_squared() < distance * distance;
                    if self.cells.get(&[i, j, k]).is_some_and(|points| points.iter().any(near)) {
                        return false;
                    }
                }
            }
        }
        self.cells.entry(self.cell_of(p)).or_default().push(p);
        true
    }
}

/// Points at least `spacing` apart, spread over the patch (u, v) -> position for u, v in 0..1, by dart throwing over
/// its area. The normal is dP/du x dP/dv.
pub fn sample(rng: &mut Rng, spacing: f64, patch: impl Fn(f64, f64) -> DVec3) -> Vec<Surfel> {
    let tangents = |u: f64, v: f64| {
        let h = 1e-4;
        let (u0, u1, v0, v1) = ((u - h).max(0.0), (u + h).min(1.0), (v - h).max(0.0), (v + h).min(1.0));
        ((patch(u1, v) - patch(u0, v)) / (u1 - u0), (patch(u, v1) - patch(u, v0)) / (v1 - v0))
    };
    let mut cumulative = Vec::with_capacity(AREA_CELLS * AREA_CELLS);
    let mut area = 0.0;
    for i in 0..AREA_CELLS * AREA_CELLS {
        let centre = |k: usize| (k as f64 + 0.5) / AREA_CELLS as f64;
        let (du, dv) = tangents(centre(i / AREA_CELLS), centre(i % AREA_CELLS));
        area += du.cross(dv).length() / (AREA_CELLS * AREA_CELLS) as f64;
        cumulative.push(area);
    }
    let candidates = (CANDIDATES_PER_POINT * area / (spacing * spacing)).ceil() as usize;
    let mut grid = PointGrid::new(spacing);
    let mut out = Vec::new();
    for _ in 0..candidates {
        let target = rng.uniform() * area;
        let cell = cumulative.partition_point(|&a| a < target).min(AREA_CELLS * AREA_CELLS - 1);
        let u = ((cell / AREA_CELLS) as f64 + rng.uniform()) / AREA_CELLS as f64;
        let v = ((cell % AREA_CELLS) as f64 + rng.uniform()) / AREA_CELLS as f64;
        let position = patch(u, v);
        let (du, dv) = tangents(u, v);
        let normal = du.cross(dv).normalize_or_zero();
        if normal != DVec3::ZERO && grid.insert_apart(position, spacing) {
            out.push(Surfel { position, normal, spacing });
        }
    }
    out
}

/// The parallelogram corner + u a + v b; the normal is a x b.
pub fn plane(corner: DVec3, a: DVec3, b: DVec3) -> impl Fn(f64, f64) -> DVec3 {
    move |u, v| corner + a * u + b * v
}

/// The six faces of the box with this centre, these axes (columns of a rotation) and half sizes.
pub fn sample_box(rng: &mut Rng, spacing: f64, centre: DVec3, axes: DMat3, half: DVec3) -> Vec<Surfel> {
    let mut out = Vec::new();
    for k in 0..3 {
        let (n, a, b) = (axes.col(k) * half[k], axes.col((k + 1) % 3), axes.col((k + 2) % 3));
        let (a, b) = (a * half[(k + 1) % 3], b * half[(k + 2) % 3]);
        out.extend(sample(rng, spacing, plane(centre + n - a - b, 2.0 * a, 2.0 * b)));
        out.extend(sample(rng, spacing, plane(centre - n - a - b, 2.0 * b, 2.0 * a)));
    }
    out
}

/// A surface of revolution about the line through `centre` along the unit vector `axis`: `profile(u)` is (distance
/// from the axis, position along it). Outwards is right of the direction in which u runs.
pub fn revolved(centre: DVec3, axis: DVec3, profile: impl Fn(f64) -> DVec2) -> impl Fn(f64, f64) -> DVec3 {
    let (a, b) = axis.any_orthonormal_pair();
    move |u, v| {
        let p = profile(u);
        let (sin, cos) = (-TAU * v).sin_cos();
        centre + (a * cos + b * sin) * p.x + axis * p.y
    }
}

/// The point of a superellipse |y|^n + |z|^n = 1 at `angle`; n = 2 is a circle, larger is boxier.
pub fn superellipse(angle: f64, n: f64) -> DVec2 {
    let (sin, cos) = angle.sin_cos();
    let r = (cos.abs().powf(n) + sin.abs().powf(n)).powf(-1.0 / n);
    DVec2::new(cos, sin) * r
}

/// A smooth curve through (x, value) knots of ascending x: cubic Hermite with Catmull-Rom slopes; constant outside.
pub fn curve(knots: &[(f64, f64)], x: f64) -> f64 {
    let last = knots.len() - 1;
    let i = knots.partition_point(|k| k.0 <= x);
    if i == 0 || i > last {
        return knots[if i == 0 { 0 } else { last }].1;
    }
    let slope = |k: usize| {
        let (a, b) = (knots[k.saturating_sub(1)], knots[(k + 1).min(last)]);
        (b.1 - a.1) / (b.0 - a.0)
    };
    let (a, b) = (knots[i - 1], knots[i]);
    let (width, t) = (b.0 - a.0, (x - a.0) / (b.0 - a.0));
    let s = t * t * (3.0 - 2.0 * t);
    let (m0, m1) = (slope(i - 1) * width, slope(i) * width);
    a.1 * (1.0 - s) + b.1 * s + m0 * t * (1.0 - t) * (1.0 - t) - m1 * t * t * (1.0 - t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_apart_and_cover_the_plane() {
        let points = sample(&mut Rng::new(1), 0.1, plane(DVec3::ZERO, DVec3::X, DVec3::Y));
        for (i, p) in points.iter().enumerate() {
            assert_eq!(p.normal, DVec3::Z);
            assert!(points[..i].iter().all(|q| (q.position - p.position).length() >= 0.1));
        }
        // Saturated dart throwing covers 0.547 of the area with discs of diameter 0.1: about 70 points, edges add some.
        assert!((60..95).contains(&points.len()), "{}", points.len());
        let mut rng = Rng::new(2);
        for _ in 0..1000 {
            let p = DVec3::new(rng.uniform(), rng.uniform(), 0.0);
            assert!(points.iter().any(|q| (q.position - p).length() < 0.13));
        }
    }

    #[test]
    fn normals_of_closed_surfaces_point_outwards() {
        let mut rng = Rng::new(3);
        let cube = sample_box(&mut rng, 0.2, DVec3::ONE, DMat3::IDENTITY, DVec3::new(0.5, 1.0, 0.7));
        assert!(cube.iter().all(|s| s.normal.dot(s.position - DVec3::ONE) > 0.0));
        // A half circle from the lower to the upper pole: right of it is outside.
        let half_circle = |u: f64| {
            let angle = std::f64::consts::PI * (u - 0.5);
            DVec2::new(angle.cos(), angle.sin())
        };
        let ball = sample(&mut rng, 0.2, revolved(DVec3::ONE, DVec3::Z, half_circle));
        assert!(ball.len() > 150 && ball.iter().all(|s| s.normal.dot(s.position - DVec3::ONE) > 0.99));
    }

    #[test]
    fn curves_meet_their_knots() {
        let knots = [(0.0, 1.0), (1.0, 3.0), (4.0, 2.0)];
        assert!(knots.iter().all(|&(x, y)| (curve(&knots, x) - y).abs() < 1e-12));
        assert_eq!((curve(&knots, -1.0), curve(&knots, 9.0)), (1.0, 2.0));
        assert!(superellipse(0.7, 2.0).length() - 1.0 < 1e-12);
    }
}
