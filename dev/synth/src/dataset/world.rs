//! A world of placed meshes, traced by rays.

use std::sync::Arc;

use glam::{Affine3A, Vec3, Vec3A};

use super::bvh::{Bounds, Bvh, Ray};
use super::light::Daylight;
use super::look::{Between, Look, Spot, Surface};
use super::mesh::{Mesh, MeshHit};
use instgs_vk::math::similarity::Similarity;

/// A body in the world: meshes that share a pose, a look and an id.
pub struct Body {
    /// Indices of its meshes. An object's first one is common to its group; differences follow.
    pub meshes: Vec<usize>,
    /// Pose of the body in the world.
    pub world_from_object: Similarity,
    /// Materials of the body.
    pub look: Arc<dyn Look>,
    /// Id in the masks; 0 = background.
    pub id: u32,
}

/// Objects of one kind, or those that the scene claims to be alike.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Name of the kind of object.
    pub name: String,
    /// Ids of its objects, the reference first.
    pub ids: Vec<u32>,
}

/// A mesh of a body, with its pose.
#[derive(Clone, Copy)]
struct Piece {
    body: usize,
    mesh: usize,
    object_from_world: Affine3A,
}

/// Geometry, materials and light of a scene.
pub struct World {
    meshes: Vec<Mesh>,
    bodies: Vec<Body>,
    /// One piece per leaf of `bvh`.
    pieces: Vec<Piece>,
    bvh: Bvh,
    /// Sun and sky of the scene.
    pub light: Daylight,
}

/// Intersection of a ray with the world.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Ray parameter of the hit.
    pub t: f32,
    piece: u32,
    on_mesh: MeshHit,
}

/// A point on a surface, for shading.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Position in the world frame.
    pub position: Vec3,
    /// Smooth unit normal, towards the viewer.
    pub normal: Vec3,
    /// Unit normal of the triangle, towards the viewer.
    pub flat_normal: Vec3,
    /// Index of the body in the world.
    pub body: u32,
    /// Material at the point.
    pub surface: Surface,
}

/// Distance of ray origins from their surface, metres: f32 coordinates of 100 m are exact to 1e-5 m.
const LIFT: f32 = 1e-3;
/// Largest ray parameter.
const FAR: f32 = 1e6;

impl World {
    /// Builds the tree over all meshes of all bodies.
    pub fn new(meshes: Vec<Mesh>, bodies: Vec<Body>, light: Daylight) -> Self {
        let mut pieces = Vec::new();
        let mut boxes = Vec::new();
        for (number, body) in bodies.iter().enumerate() {
            let world_from_object = affine(&body.world_from_object);
            for &mesh in &body.meshes {
                let corners = meshes[mesh].bounds().corners();
                boxes.push(
                    corners.into_iter().fold(Bounds::EMPTY, |b, p| b.with(world_from_object.transform_point3(p))),
                );
                pieces.push(Piece { body: number, mesh, object_from_world: world_from_object.inverse() });
            }
        }
        // One piece per leaf: its box already has a tree of its own.
        let (bvh, leaves) = Bvh::build(&boxes, 1);
        let pieces = leaves.iter().flatten().map(|&i| pieces[i as usize]).collect();
        Self { meshes, bodies, pieces, bvh, light }
    }

    /// The same world with the part `share` of the differences between objects of a kind: materials are interpolated
    /// from the reference's, and from a half on each object has its own meshes.
    pub fn with_differences(mut self, kinds: &[Kind], share: f32) -> Self {
        for kind in kinds {
            let Some(reference) = self.bodies.iter().find(|body| kind.ids.first() == Some(&body.id)) else { continue };
            let (look, meshes) = (reference.look.clone(), reference.meshes.clone());
            for body in self.bodies.iter_mut().filter(|body| kind.ids[1..].contains(&body.id)) {
                if share < 0.5 {
                    body.meshes.clone_from(&meshes);
                }
                body.look = Arc::new(Between { looks: [look.clone(), body.look.clone()], share });
            }
        }
        Self::new(self.meshes, self.bodies, self.light)
    }

    /// All bodies, in the order of their indices.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Bounding box of a body's first mesh, in the body's frame.
    pub fn object_bounds(&self, body: &Body) -> Bounds {
        body.meshes.first().map_or(Bounds::EMPTY, |&mesh| self.meshes[mesh].bounds())
    }

    /// Number of triangles, each mesh counted once.
    pub fn triangles(&self) -> usize {
        self.meshes.iter().map(Mesh::len).sum()
    }

    /// The nearest hit, if any.
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        let (mut best, mut limit) = (None, FAR);
        self.bvh.walk(ray, &mut limit, |leaf, limit| {
            let piece = &self.pieces[leaf];
            if let Some(on_mesh) = self.meshes[piece.mesh].closest(&piece.local(ray), *limit) {
                *limit = on_mesh.t;
                best = Some(Hit { t: on_mesh.t, piece: leaf as u32, on_mesh });
            }
            false
        });
        best
    }

    /// Mask id of the body that was hit.
    pub fn id_of(&self, hit: &Hit) -> u32 {
        self.bodies[self.pieces[hit.piece as usize].body].id
    }

    /// Index of the body that was hit.
    pub fn body_of(&self, hit: &Hit) -> u32 {
        self.pieces[hit.piece as usize].body as u32
    }

    /// Whether the ray from the point `from` in direction `towards` hits nothing.
    pub fn open(&self, from: Vec3, towards: Vec3) -> bool {
        let ray = Ray::new(from, towards);
        let (mut blocked, mut limit) = (false, FAR);
        self.bvh.walk(&ray, &mut limit, |leaf, limit| {
            let piece = &self.pieces[leaf];
            blocked = self.meshes[piece.mesh].occludes(&piece.local(&ray), *limit);
            blocked
        });
        !blocked
    }

    /// The surface point at a hit of `ray`. `footprint` is the size of a pixel at distance 1 of the ray.
    pub fn point(&self, ray: &Ray, hit: &Hit, footprint: f32) -> Point {
        let piece = &self.pieces[hit.piece as usize];
        let body = &self.bodies[piece.body];
        let (part, flat, smooth) = self.meshes[piece.mesh].skin(&hit.on_mesh);
        // Normals are transformed with the transposed inverse; for similarities that is right up to length.
        let to_world = piece.object_from_world.matrix3.transpose();
        let world_normal = |n: Vec3| Vec3::from(to_world * Vec3A::from(n)).normalize_or(Vec3::Z);
        let (flat_normal, normal) = (world_normal(flat), world_normal(smooth));
        let facing = |n: Vec3| if n.dot(ray.direction) > 0.0 { -n } else { n };
        let position = ray.at(hit.t);
        let scale = piece.object_from_world.matrix3.x_axis.length();
        let spot = Spot {
            part,
            position: piece.object_from_world.transform_point3(position),
            normal: smooth,
            footprint: footprint * hit.t * scale / (0.35 + 0.65 * flat_normal.dot(ray.direction.normalize()).abs()),
        };
        let (flat_normal, surface) = (facing(flat_normal), body.look.surface(&spot));
        // Smooth normals face the viewer, except those of leaves, which point out of the crown.
        let turned = normal.dot(flat_normal) < 0.0 && surface.through == 0.0;
        let normal = if turned { -normal } else { normal };
        Point { position, normal, flat_normal, body: piece.body as u32, surface }
    }

    /// Share of the sun's light on a point, times the cosine; `at` is a point of the sun's disc, as a unit disc.
    pub fn sun_on(&self, point: &Point, at: (f32, f32)) -> f32 {
        let direction = self.light.sun_direction(at.0, at.1);
        let cosine = point.normal.dot(direction);
        let (flat, through) = (point.flat_normal.dot(direction), point.surface.through);
        let lit =
            if through > 0.0 { cosine.max(0.0) * (1.0 - through) + through * flat.abs() } else { cosine.max(0.0) };
        if lit <= 0.0 || (through == 0.0 && flat <= 0.0) {
            return 0.0;
        }
        if self.open(point.lifted(direction), direction) { lit } else { 0.0 }
    }
}

impl Piece {
    /// The ray in the object's frame, with the same parameter.
    fn local(&self, ray: &Ray) -> Ray {
        let to = &self.object_from_world;
        Ray::new(to.transform_point3(ray.origin), to.transform_vector3(ray.direction))
    }
}

impl Point {
    /// Origin of a ray in this direction: on the side of the surface towards which it leaves.
    pub fn lifted(&self, direction: Vec3) -> Vec3 {
        let side = if self.flat_normal.dot(direction) >= 0.0 { LIFT } else { -LIFT };
        self.position + self.flat_normal * side
    }
}

fn affine(similarity: &Similarity) -> Affine3A {
    Affine3A::from_mat3_translation(similarity.linear().as_mat3(), similarity.translation().as_vec3())
}
