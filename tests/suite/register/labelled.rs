//! Clouds whose poses are known: points of the true surfaces that cameras see.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use glam::DMat3;
use instgs_objects::register::{RegisterError, RegisterInput, RegisterOptions, Registered, register};
use instgs_synth::dataset::frame::Lens;
use instgs_synth::dataset::world::Point;
use instgs_synth::dataset::{Options, build, truth};
use instgs_vk::math::covariance::quat_from_rotation;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::{Camera, Gaussians, PosedGroup};

/// A labelled cloud and what is true of it.
pub(crate) struct Labelled {
    pub(crate) cloud: Gaussians,
    pub(crate) labels: Vec<u32>,
    pub(crate) categories: BTreeMap<u32, String>,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) truth: Vec<PosedGroup>,
}

/// What a cloud is made with.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    pub(crate) scene: &'static str,
    pub(crate) instances: Option<u32>,
    pub(crate) seed: u64,
    /// Cameras stand around so many radians; TAU is all around.
    pub(crate) azimuths: f64,
    /// Deviation of the points' places, as a part of the object's size.
    pub(crate) noise: f64,
}

impl Recipe {
    pub(crate) const fn new(scene: &'static str, seed: u64) -> Self {
        Self { scene, instances: None, seed, azimuths: TAU, noise: 0.003 }
    }

    /// One flat Gaussian for each cell of `spacing` that a ray of a camera meets.
    pub(crate) fn labelled(self) -> Labelled {
        let options =
            Options { views: 40, size: (240, 135), seed: self.seed, instances: self.instances, ..Options::default() };
        let scene = build(self.scene, &options).unwrap();
        let rig = instgs_synth::dataset::views::Rig {
            azimuths: (scene.rig.azimuths.0, scene.rig.azimuths.1.min(self.azimuths)),
            ..scene.rig.clone()
        };
        let cameras = rig.cameras(options.views, options.size, options.seed);
        let truth = truth::groups(&scene);
        let size = truth.iter().flat_map(|g| sizes(&scene, g)).collect::<BTreeMap<u32, f64>>();
        let mut rng = Rng::new(self.seed).fork(0x7E57);
        let mut seen = BTreeSet::new();
        let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
        for camera in &cameras {
            let lens = Lens::new(camera);
            for y in 0..camera.height {
                for x in 0..camera.width {
                    let ray = lens.ray(f64::from(x) + rng.uniform(), f64::from(y) + rng.uniform());
                    let Some(hit) = scene.world.closest(&ray) else { continue };
                    let id = scene.world.id_of(&hit);
                    let spacing = size.get(&id).map_or(0.4, |size| size / 45.0);
                    let at = ray.at(hit.t).as_dvec3();
                    let cell = (at / spacing).floor().to_array().map(|c| c as i64);
                    if seen.insert((id, cell)) {
                        push(
                            &mut cloud,
                            &scene.world.point(&ray, &hit, lens.footprint),
                            (spacing, self.noise),
                            &mut rng,
                        );
                        labels.push(id);
                    }
                }
            }
        }
        let named = |g: &PosedGroup| g.instances.iter().map(|i| (i.id, g.name.clone().unwrap())).collect::<Vec<_>>();
        let categories = truth.iter().flat_map(named).collect();
        Labelled { cloud, labels, categories, cameras, truth }
    }
}

/// The diagonals of the objects' boxes by id.
pub(crate) fn sizes(scene: &instgs_synth::dataset::scene_builder::Scene, group: &PosedGroup) -> Vec<(u32, f64)> {
    let bodies = scene.world.bodies().iter().filter(|b| group.instances.iter().any(|i| i.id == b.id));
    let size = |b: &instgs_synth::dataset::world::Body| {
        f64::from(scene.world.object_bounds(b).diagonal()) * b.world_from_object.scale()
    };
    bodies.map(|b| (b.id, size(b))).collect()
}

/// A disc on the surface, a little off, as training leaves them: also tilted, and of uneven size.
pub(crate) fn push(cloud: &mut Gaussians, point: &Point, (spacing, noise): (f64, f64), rng: &mut Rng) {
    let normal = (point.flat_normal.as_dvec3() + 0.15 * rng.normal_vector()).normalize();
    let side = normal.any_orthonormal_vector();
    cloud.means.push((point.position.as_dvec3() + noise * rng.normal_vector()).as_vec3().to_array());
    cloud.quats.push(quat_from_rotation(DMat3::from_cols(side, normal.cross(side), normal)).map(|q| q as f32));
    let wide = (0.4 * spacing * (0.4 * rng.normal()).exp()).ln() as f32;
    cloud.log_scales.push([wide, wide, wide - 2.0]);
    cloud.opacity_logits.push(rng.range(-0.5, 3.0) as f32);
    let shade = point.surface.albedo.as_dvec3().powf(1.0 / 2.2) + 0.04 * rng.normal_vector();
    cloud.sh.push(((shade - 0.5) / SH_C0).as_vec3().to_array());
}

impl Labelled {
    pub(crate) fn register(&self, options: &RegisterOptions) -> Result<Registered, RegisterError> {
        register(&self.input(&self.categories), None, options)
    }

    pub(crate) fn input<'a>(&'a self, categories: &'a BTreeMap<u32, String>) -> RegisterInput<'a> {
        RegisterInput { cloud: &self.cloud, instance_of_gaussian: &self.labels, categories, cameras: &self.cameras }
    }
}

/// A scene of so many objects.
pub(crate) fn recipe(scene: &'static str, instances: u32, seed: u64) -> Recipe {
    Recipe { instances: Some(instances), ..Recipe::new(scene, seed) }
}
