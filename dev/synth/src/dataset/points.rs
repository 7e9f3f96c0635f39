//! Points on the surfaces that the views see: those where light is computed, and the cloud that training starts from.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::frame::{Lens, shaded};
use super::irradiance::{Irradiance, spread};
use super::scene_builder::Scene;
use super::world::Point;
use crate::shading::encoded;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Camera, PointCloud};

/// Largest number of rays over all views: about ten per point that is kept.
const MOST_RAYS: usize = 900_000;
/// Rays per pixel, if that is fewer: small pictures show no more.
const RAYS_PER_PIXEL: usize = 3;
/// Largest number of views that rays are cast from: more show nothing new.
const MOST_VIEWS: usize = 160;
/// Number of points of the cloud in the core, where light is computed.
const CLOUD_POINTS: usize = 20_000;
/// Standard deviation of the cloud's positions, in spacings of light samples.
const CLOUD_NOISE: f64 = 0.08;
/// Random pixels from which points beyond the core are taken, on far ground or in the sky. As many as the core has
/// points, so that near and far points have about the same density in pictures.
const FAR_RAYS: usize = CLOUD_POINTS;
/// Distance of sky points from the rig's target, in core radii: far enough for little parallax, near enough to be
/// learned at the rates of a scene's own points.
const SKY_DISTANCE: f32 = 6.0;
/// Stream of the core points, derived from the seed.
const CLOUD_STREAM: u64 = 0xC10D;
/// Stream of the far points, derived from the seed.
const FAR_STREAM: u64 = 0xFA12;

/// Evenly spread points on the surfaces that the cameras see within the core, where light is computed.
pub(super) fn seen(scene: &Scene, cameras: &[Camera]) -> Vec<Point> {
    let stride = cameras.len().div_ceil(MOST_VIEWS).max(1);
    let chosen: Vec<&Camera> = cameras.iter().step_by(stride).collect();
    let pixels: usize = cameras.iter().map(|c| c.width as usize * c.height as usize).sum();
    let rays = MOST_RAYS.min(pixels.saturating_mul(RAYS_PER_PIXEL));
    let per_view = (rays / chosen.len().max(1)).max(1) as f64;
    let of_view = |camera: &&Camera| -> Vec<Point> {
        let lens = Lens::new(camera);
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let columns = (per_view * w / h).sqrt().clamp(1.0, per_view) as usize;
        let rows = (per_view as usize / columns).max(1);
        let at = |i: usize| {
            let (x, y) = (((i % columns) as f64 + 0.5) / columns as f64, ((i / columns) as f64 + 0.5) / rows as f64);
            let ray = lens.ray(x * w, y * h);
            let hit = scene.world.closest(&ray)?;
            Some(scene.world.point(&ray, &hit, lens.footprint))
        };
        (0..columns * rows).filter_map(at).filter(|p| scene.core_share(p.position) > 0.0).collect()
    };
    let points: Vec<Vec<Point>> = chosen.par_iter().map(of_view).collect();
    spread(points.into_iter().flatten(), scene.light_spacing)
}

/// The initial cloud: some of the lit points, with noise, and points that the cameras see beyond the core.
pub(super) fn cloud(scene: &Scene, light: &Irradiance, cameras: &[Camera], seed: u64) -> PointCloud {
    let mut rng = Rng::new(seed).fork(CLOUD_STREAM);
    let mut chosen: Vec<usize> = (0..light.points().len()).collect();
    rng.shuffle(&mut chosen);
    chosen.truncate(CLOUD_POINTS);
    let mut out = PointCloud::default();
    for lit in chosen.into_iter().map(|i| &light.points()[i]) {
        let sun = scene.world.sun_on(&lit.point, (0.0, 0.0));
        let color = shaded(&scene.world, &lit.point, -lit.point.normal, lit.light, sun) * scene.world.light.exposure;
        let noise = rng.normal_vector() * (CLOUD_NOISE * f64::from(scene.light_spacing));
        let position: Vec3 = (lit.point.position.as_dvec3() + noise).as_vec3();
        add(&mut out, position, color);
    }
    add_far(&mut out, scene, light, cameras, seed);
    out
}

fn add(cloud: &mut PointCloud, position: Vec3, color: Vec3) {
    cloud.positions.push(position.to_array());
    let bytes: DVec3 = encoded(color.as_dvec3()) * 255.0;
    cloud.colors.push(bytes.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8));
}

/// Adds points beyond the core that random pixels show. Without them a short training fills the sky with fog in front
/// of the cameras. Closed scenes (a room) get none.
fn add_far(cloud: &mut PointCloud, scene: &Scene, light: &Irradiance, cameras: &[Camera], seed: u64) {
    let mut rng = Rng::new(seed).fork(FAR_STREAM);
    for i in 0..FAR_RAYS {
        let camera = &cameras[i % cameras.len()];
        let lens = Lens::new(camera);
        let ray = lens.ray(rng.uniform() * f64::from(camera.width), rng.uniform() * f64::from(camera.height));
        let (position, color) = match scene.world.closest(&ray) {
            None => {
                let direction = ray.direction.normalize();
                let distance = SKY_DISTANCE * scene.core_radius;
                (scene.rig.target.as_vec3() + direction * distance, scene.world.light.sky(direction))
            }
            Some(hit) => {
                let point = scene.world.point(&ray, &hit, lens.footprint);
                if scene.core_share(point.position) > 0.0 {
                    continue;
                }
                let sun = scene.world.sun_on(&point, (0.0, 0.0));
                let around = light.at(scene, &point);
                (point.position, shaded(&scene.world, &point, ray.direction.normalize(), around, sun))
            }
        };
        add(cloud, position, color * scene.world.light.exposure);
    }
}
