//! Triangle meshes with smooth normals, and the shapes they are built from.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DMat3, DVec2, DVec3, Vec3, Vec4};

use super::bvh::{Bounds, Bvh, LANES, Ray};

/// Corners and edges of the triangles of a leaf, by axis, one triangle per lane. Unused lanes have edges of length 0,
/// which no ray hits.
#[derive(Clone, Copy, Debug, Default)]
struct Packet {
    corners: [Vec4; 3],
    edges: [[Vec4; 3]; 2],
}

/// Shading data of a triangle.
#[derive(Clone, Copy, Debug, Default)]
struct Skin {
    flat: Vec3,
    normals: [Vec3; 3],
    part: u8,
}

/// The triangles of an object in its own frame, metres.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// One packet per leaf.
    packets: Vec<Packet>,
    /// One entry per lane of each packet.
    skins: Vec<Skin>,
    bvh: Bvh,
    bounds: Bounds,
    triangles: usize,
}

/// Intersection of a ray with a mesh.
#[derive(Clone, Copy, Debug)]
pub struct MeshHit {
    /// Ray parameter of the hit.
    pub t: f32,
    face: u32,
    barycentric: [f32; 2],
}

impl Mesh {
    /// Bounding box of all vertices.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Number of triangles in the mesh.
    pub fn len(&self) -> usize {
        self.triangles
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles == 0
    }

    /// The nearest hit with a ray parameter in (0, `t_max`).
    pub fn closest(&self, ray: &Ray, t_max: f32) -> Option<MeshHit> {
        let (mut best, mut limit) = (None, t_max);
        self.bvh.walk(ray, &mut limit, |leaf, limit| {
            let met = self.packets[leaf].meets(ray, *limit);
            for lane in (0..LANES).filter(|lane| met.lanes >> lane & 1 == 1) {
                if met.t[lane] < *limit {
                    *limit = met.t[lane];
                    let face = (LANES * leaf + lane) as u32;
                    best = Some(MeshHit { t: met.t[lane], face, barycentric: [met.u[lane], met.v[lane]] });
                }
            }
            false
        });
        best
    }

    /// Whether anything is hit with a ray parameter in (0, `t_max`).
    pub fn occludes(&self, ray: &Ray, t_max: f32) -> bool {
        let (mut found, mut limit) = (false, t_max);
        self.bvh.walk(ray, &mut limit, |leaf, limit| {
            found = self.packets[leaf].meets(ray, *limit).lanes != 0;
            found
        });
        found
    }

    /// Part, geometric normal and smooth normal (unit vectors) of a hit.
    pub fn skin(&self, hit: &MeshHit) -> (u8, Vec3, Vec3) {
        let skin = &self.skins[hit.face as usize];
        let [u, v] = hit.barycentric;
        let smooth = skin.normals[0] * (1.0 - u - v) + skin.normals[1] * u + skin.normals[2] * v;
        (skin.part, skin.flat, smooth.normalize_or(skin.flat))
    }
}

impl Skin {
    fn new((p, normals, part): &Triangle) -> Self {
        let flat = (p[1] - p[0]).cross(p[2] - p[0]).as_vec3().normalize_or(Vec3::Z);
        Self { flat, normals: normals.map(|n| n.as_vec3()), part: *part }
    }
}

/// Ray parameters and barycentric coordinates, and one bit per triangle that is hit.
struct Met {
    t: Vec4,
    u: Vec4,
    v: Vec4,
    lanes: u32,
}

impl Packet {
    fn new(triangles: &[&Triangle]) -> Self {
        let mut out = Self::default();
        for (lane, (p, _, _)) in triangles.iter().enumerate() {
            let (corner, edges) = (p[0].as_vec3(), [(p[1] - p[0]).as_vec3(), (p[2] - p[0]).as_vec3()]);
            for axis in 0..3 {
                out.corners[axis][lane] = corner[axis];
                out.edges[0][axis][lane] = edges[0][axis];
                out.edges[1][axis][lane] = edges[1][axis];
            }
        }
        out
    }

    /// The test of Moller and Trumbore for all triangles at once.
    fn meets(&self, ray: &Ray, t_max: f32) -> Met {
        let lanes = |v: Vec3| v.to_array().map(Vec4::splat);
        let (origin, direction) = (lanes(ray.origin), lanes(ray.direction));
        let p = cross(&direction, &self.edges[1]);
        let inverse = dot(&self.edges[0], &p).recip();
        let from_corner = std::array::from_fn(|axis| origin[axis] - self.corners[axis]);
        let u = dot(&from_corner, &p) * inverse;
        let q = cross(&from_corner, &self.edges[0]);
        let v = dot(&direction, &q) * inverse;
        let t = dot(&self.edges[1], &q) * inverse;
        let inside = u.cmpge(Vec4::ZERO) & v.cmpge(Vec4::ZERO) & (u + v).cmple(Vec4::ONE);
        let lanes = (inside & t.cmpgt(Vec4::ZERO) & t.cmplt(Vec4::splat(t_max))).bitmask();
        Met { t, u, v, lanes }
    }
}

fn dot(a: &[Vec4; 3], b: &[Vec4; 3]) -> Vec4 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: &[Vec4; 3], b: &[Vec4; 3]) -> [Vec4; 3] {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

/// Corners, vertex normals and part of a triangle.
type Triangle = ([DVec3; 3], [DVec3; 3], u8);

/// Collects triangles; the tag `part` is given to those that are added next.
#[derive(Clone, Debug, Default)]
pub struct MeshBuilder {
    /// Tag for [`super::look::Look`].
    pub part: u8,
    triangles: Vec<Triangle>,
}

/// Steps per quarter circle at rounded edges.
const BEVEL_STEPS: usize = 2;

impl MeshBuilder {
    /// A builder without triangles.
    pub fn new() -> Self {
        Self::default()
    }

    /// Builds the mesh with its bounding volume hierarchy.
    pub fn build(self) -> Mesh {
        let boxes: Vec<Bounds> =
            self.triangles.iter().map(|t| t.0.iter().fold(Bounds::EMPTY, |b, p| b.with(p.as_vec3()))).collect();
        let (bvh, leaves) = Bvh::build(&boxes, LANES);
        let mut out = Mesh {
            packets: Vec::with_capacity(leaves.len()),
            skins: Vec::with_capacity(LANES * leaves.len()),
            bvh,
            bounds: boxes.into_iter().fold(Bounds::EMPTY, Bounds::union),
            triangles: self.triangles.len(),
        };
        for leaf in &leaves {
            let triangles: Vec<&Triangle> = leaf.iter().map(|&i| &self.triangles[i as usize]).collect();
            out.packets.push(Packet::new(&triangles));
            out.skins.extend(triangles.iter().map(|t| Skin::new(t)));
            out.skins.resize(LANES * out.packets.len(), Skin::default());
        }
        out
    }

    /// Adds one triangle with a normal per corner; degenerate ones are dropped.
    pub fn triangle(&mut self, corners: [DVec3; 3], normals: [DVec3; 3]) {
        let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        if area > 1e-12 {
            self.triangles.push((corners, normals, self.part));
        }
    }

    /// Adds the parallelogram corner + u a + v b with a single normal.
    pub fn card(&mut self, corner: DVec3, a: DVec3, b: DVec3, normal: DVec3) {
        self.triangle([corner, corner + a, corner + a + b], [normal; 3]);
        self.triangle([corner, corner + a + b, corner + b], [normal; 3]);
    }

    /// Adds a grid over the surface `at(u, v)`, u and v in 0..=1, with its own normals. `keep` gets centre and normal
    /// of each cell and may reject it.
    pub fn patch(
        &mut self,
        cells: (usize, usize),
        at: impl Fn(f64, f64) -> DVec3,
        keep: impl Fn(DVec3, DVec3) -> bool,
    ) {
        let (nu, nv) = cells;
        let place = |i: usize, j: usize| (i as f64 / nu as f64, j as f64 / nv as f64);
        let vertices: Vec<(DVec3, DVec3)> = (0..=nu)
            .flat_map(|i| (0..=nv).map(move |j| place(i, j)))
            .map(|(u, v)| (at(u, v), normal_of(&at, u, v)))
            .collect();
        for (i, j) in (0..nu).flat_map(|i| (0..nv).map(move |j| (i, j))) {
            let [a, b, c, d] =
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| vertices[i * (nv + 1) + j]);
            if keep(0.25 * (a.0 + b.0 + c.0 + d.0), (a.1 + b.1 + c.1 + d.1).normalize_or(DVec3::Z)) {
                self.triangle([a.0, b.0, c.0], [a.1, b.1, c.1]);
                self.triangle([a.0, c.0, d.0], [a.1, c.1, d.1]);
            }
        }
    }

    /// Adds a box with rounded edges: centre, axes (columns of a rotation), half sizes, radius of the edges.
    pub fn rounded_box(&mut self, centre: DVec3, axes: DMat3, half: DVec3, radius: f64) {
        let radius = radius.min(half.min_element());
        let inner = half - radius;
        // Each angle at a corner belongs to both adjacent faces: the quads in between are the faces.
        let ring = |quarter: usize| {
            (0..=BEVEL_STEPS).map(move |i| FRAC_PI_2 * (quarter as f64 + i as f64 / BEVEL_STEPS as f64))
        };
        let turns: Vec<(f64, DVec2)> = (0..4)
            .flat_map(|q| {
                ring(q).map(move |a| (a, [DVec2::ONE, DVec2::new(-1., 1.), -DVec2::ONE, DVec2::new(1., -1.)][q]))
            })
            .collect();
        let heights: Vec<(f64, f64)> =
            (0..2).flat_map(|h| ring(h).map(move |a| (a - FRAC_PI_2, 2.0 * h as f64 - 1.0))).collect();
        let vertex = |turn: &(f64, DVec2), height: &(f64, f64)| {
            let (sin, cos) = height.0.sin_cos();
            let normal = DVec3::new(turn.0.cos() * cos, turn.0.sin() * cos, sin);
            let point = turn.1.extend(height.1) * inner + normal * radius;
            (centre + axes * point, axes * normal)
        };
        for (i, turn) in turns.iter().enumerate() {
            let next = &turns[(i + 1) % turns.len()];
            for pair in heights.windows(2) {
                let [a, b, c, d] =
                    [(turn, &pair[0]), (next, &pair[0]), (next, &pair[1]), (turn, &pair[1])].map(|(t, h)| vertex(t, h));
                self.triangle([a.0, b.0, c.0], [a.1, b.1, c.1]);
                self.triangle([a.0, c.0, d.0], [a.1, c.1, d.1]);
            }
        }
        for side in [-1.0, 1.0] {
            let (a, b) = (axes.x_axis * inner.x, axes.y_axis * inner.y);
            let normal = axes.z_axis * side;
            self.card(centre + normal * half.z - a - b, 2.0 * a, 2.0 * b, normal);
        }
    }

    /// Adds an axis-aligned box; see [`MeshBuilder::rounded_box`].
    pub fn block(&mut self, centre: DVec3, half: DVec3, radius: f64) {
        self.rounded_box(centre, DMat3::IDENTITY, half, radius);
    }

    /// Adds a surface of revolution about the line through `centre` along the unit vector `axis`: (radius, height)
    /// points joined by cones, with smooth joints if `smooth`.
    pub fn lathe(&mut self, centre: DVec3, axis: DVec3, profile: &[(f64, f64)], segments: usize, smooth: bool) {
        let (x, y) = axis.any_orthonormal_pair();
        let slope = |i: usize| {
            let (a, b) = (profile[i], profile[i + 1]);
            DVec2::new(b.1 - a.1, a.0 - b.0).normalize_or(DVec2::X)
        };
        let last = profile.len() - 1;
        for i in 0..last {
            let own = slope(i);
            let joint = |other: usize| if smooth { (own + slope(other)).normalize_or(own) } else { own };
            let ends = [joint(i.saturating_sub(1)), joint((i + 1).min(last - 1))];
            for s in 0..segments {
                let vertex = |end: usize, step: usize| {
                    let (sin, cos) = (TAU * (s + step) as f64 / segments as f64).sin_cos();
                    let (out, (radius, height)) = (x * cos + y * sin, profile[i + end]);
                    (centre + out * radius + axis * height, out * ends[end].x + axis * ends[end].y)
                };
                let [a, b, c, d] = [vertex(0, 0), vertex(0, 1), vertex(1, 1), vertex(1, 0)];
                self.triangle([a.0, b.0, c.0], [a.1, b.1, c.1]);
                self.triangle([a.0, c.0, d.0], [a.1, c.1, d.1]);
            }
        }
    }

    /// Adds a closed round bar from `a` to `b` with the given radii at its ends.
    pub fn limb(&mut self, a: DVec3, b: DVec3, radii: (f64, f64), segments: usize) {
        let length = (b - a).length();
        let axis = (b - a).normalize_or(DVec3::Z);
        self.lathe(a, axis, &[(0.0, 0.0), (radii.0, 0.0), (radii.1, length), (0.0, length)], segments, false);
    }

    /// Adds an ellipsoid: centre, axes, half lengths.
    pub fn ellipsoid(&mut self, centre: DVec3, axes: DMat3, half: DVec3, cells: (usize, usize)) {
        let at = |u: f64, v: f64| {
            let (sin, cos) = (PI * (u - 0.5)).sin_cos();
            centre + axes * (half * DVec3::new(cos * (TAU * v).cos(), cos * (TAU * v).sin(), sin))
        };
        self.patch(cells, at, |_, _| true);
    }

    /// Adds a torus: centre, unit axis, radius of the ring, radius of the tube.
    pub fn torus(&mut self, centre: DVec3, axis: DVec3, radii: (f64, f64), cells: (usize, usize)) {
        let (x, y) = axis.any_orthonormal_pair();
        let at = |u: f64, v: f64| {
            let out = x * (TAU * u).cos() + y * (TAU * u).sin();
            centre + out * (radii.0 + radii.1 * (TAU * v).cos()) + axis * (radii.1 * (TAU * v).sin())
        };
        self.patch(cells, at, |_, _| true);
    }
}

/// The normal of a surface from finite differences; at poles, that of a point nearby.
fn normal_of(at: &impl Fn(f64, f64) -> DVec3, u: f64, v: f64) -> DVec3 {
    const STEP: f64 = 1e-4;
    for inset in [0.0, 2e-3] {
        let (u, v) = (u.clamp(inset, 1.0 - inset), v.clamp(inset, 1.0 - inset));
        let du = at((u + STEP).min(1.0), v) - at((u - STEP).max(0.0), v);
        let dv = at(u, (v + STEP).min(1.0)) - at(u, (v - STEP).max(0.0));
        let normal = du.cross(dv);
        if normal.length() > 1e-6 * (du.length_squared() + dv.length_squared()) {
            return normal.normalize();
        }
    }
    DVec3::Z
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(mesh: &Mesh, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        mesh.closest(&Ray::new(origin, direction), 1e9).map(|h| (h.t, mesh.skin(&h).2))
    }

    #[test]
    fn shapes_are_where_they_should_be() {
        let mut b = MeshBuilder::new();
        b.block(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), 0.1);
        let block = b.build();
        for (axis, half) in [(Vec3::X, 1.0), (Vec3::Y, 2.0), (Vec3::Z, 3.0)] {
            for side in [axis, -axis] {
                let (t, normal) = hit(&block, side * 10.0 + Vec3::splat(0.013), -side).unwrap();
                assert!((t - (10.0 - half)).abs() < 0.02 && normal.dot(side).abs() > 0.999, "{side} {t} {normal}");
            }
        }
        let mut b = MeshBuilder::new();
        b.ellipsoid(DVec3::ZERO, DMat3::IDENTITY, DVec3::ONE, (32, 32));
        b.part = 3;
        b.torus(DVec3::Z * 5.0, DVec3::Z, (2.0, 0.5), (48, 24));
        let mesh = b.build();
        let (t, normal) = hit(&mesh, Vec3::new(0.3, 0.2, -9.0), Vec3::Z).unwrap();
        assert!((t - 8.067).abs() < 0.02 && normal.z.abs() > 0.9, "{t} {normal}");
        let ring = Ray::new(Vec3::new(2.0, 0.01, 9.0), -Vec3::Z);
        let found = mesh.closest(&ring, 1e9).unwrap();
        assert!((found.t - 3.5).abs() < 0.02 && mesh.skin(&found).0 == 3);
        assert!(mesh.occludes(&ring, 4.0) && !mesh.occludes(&ring, 3.0));
    }
}
