//! Assembles a scene from meshes, props and objects.

use std::sync::Arc;

use glam::{DMat3, DVec3, Vec3};

use super::light::Daylight;
use super::look::Look;
use super::mesh::{Mesh, MeshBuilder};
use super::noise::smooth_step;
use super::views::Rig;
use super::world::{Body, Kind, World};
use instgs_vk::math::similarity::Similarity;

/// A scene: its world, the groups of like objects, and the cameras.
pub struct Scene {
    /// Geometry, materials and light.
    pub world: World,
    /// The groups of objects.
    pub kinds: Vec<Kind>,
    /// Rig that the cameras stand on.
    pub rig: Rig,
    /// Spacing of the points where indirect light is computed, metres.
    pub light_spacing: f32,
    /// Radius of the core around the rig's target, metres; beyond it surfaces are lit by the open sky.
    pub core_radius: f32,
}

impl Scene {
    /// The same scene with a part of the differences between objects of a kind; see [`World::with_differences`].
    pub fn with_differences(self, share: f32) -> Self {
        let world = if share < 1.0 { self.world.with_differences(&self.kinds, share) } else { self.world };
        Self { world, ..self }
    }

    /// Weight of computed light at a position: 1 in the core, 0 outside, with a smooth transition.
    pub fn core_share(&self, position: Vec3) -> f32 {
        let distance = position.distance(self.rig.target.as_vec3());
        1.0 - smooth_step(0.85 * self.core_radius, self.core_radius, distance)
    }
}

/// Builds a [`Scene`] from meshes, props and objects. Ids of objects start at 1.
#[derive(Default)]
pub struct SceneBuilder {
    meshes: Vec<Mesh>,
    bodies: Vec<Body>,
    kinds: Vec<Kind>,
    objects: u32,
}

impl SceneBuilder {
    /// A builder without meshes.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a mesh and returns its index.
    pub fn mesh(&mut self, builder: MeshBuilder) -> usize {
        self.meshes.push(builder.build());
        self.meshes.len() - 1
    }

    /// Adds a mesh to the background.
    pub fn prop(&mut self, mesh: usize, place: Similarity, look: impl Look + 'static) {
        self.bodies.push(Body { meshes: vec![mesh], world_from_object: place, look: Arc::new(look), id: 0 });
    }

    /// Adds an object to the group with the name `kind`.
    pub fn object(&mut self, kind: &str, meshes: Vec<usize>, place: Similarity, look: impl Look + 'static) {
        self.objects += 1;
        let id = self.objects;
        match self.kinds.iter_mut().find(|k| k.name == kind) {
            Some(kind) => kind.ids.push(id),
            None => self.kinds.push(Kind { name: kind.into(), ids: vec![id] }),
        }
        self.bodies.push(Body { meshes, world_from_object: place, look: Arc::new(look), id });
    }

    /// Builds the scene; `light_spacing` and `core_radius` are in metres.
    pub fn finish(self, light: Daylight, rig: Rig, light_spacing: f32, core_radius: f32) -> Scene {
        Scene { world: World::new(self.meshes, self.bodies, light), kinds: self.kinds, rig, light_spacing, core_radius }
    }
}

/// A pose: scaled, turned about the up axis by `yaw` radians, and moved to `position`.
pub fn placed(position: DVec3, yaw: f64, scale: f64) -> Similarity {
    Similarity::from_parts(DMat3::from_rotation_z(yaw), scale, position)
}
