//! Renders one view: colour, id and depth of each pixel.

use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::bvh::Ray;
use super::irradiance::Irradiance;
use super::light::disc;
use super::scene_builder::Scene;
use super::world::{Hit, Point, World};
use crate::shading::encoded;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Camera;

/// The images of a view, in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Colours as sRGB bytes, three per pixel.
    pub colors: Vec<u8>,
    /// Id of the object at each pixel's centre, 0 = none.
    pub ids: Vec<u16>,
    /// View-space z at each pixel's centre, 0 = sky.
    pub depths: Vec<f32>,
}

/// Adaptive sampling: number of samples after which a pixel may be finished, and the largest contrast of its samples
/// for that. The last stage has no limit, so edges get all samples. The first stage counts only where all neighbouring
/// pixels show the same body.
const STAGES: [(usize, f32); 4] = [(4, 0.025), (9, 0.05), (18, 0.12), (MOST, f32::INFINITY)];
/// From this sample on, the nearest earlier sample of the same body is reused unless the sun reaches only some of them:
/// edges need many visibility rays, but not as many materials and shadows.
const SHADED: usize = STAGES[2].0;
/// Largest number of samples of a pixel.
const MOST: usize = 48;
/// Added to a luminance before contrasts are computed: differences below it are hardly visible.
const DARK: f32 = 0.15;
/// Samples of a pixel share indirect light if the cosine between their normals exceeds this ...
const SAME_NORMAL: f32 = 0.97;
/// ... and they are nearer to each other than this part of the spacing of light samples.
const SAME_PLACE: f32 = 0.35;
/// First of the random streams of views.
const VIEW_STREAM: u64 = 0x5EED_0001;

/// Camera rays in f32, from the camera's position.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    eye: Vec3,
    world_from_view: DMat3,
    focal: (f64, f64),
    middle: (f64, f64),
    /// Size of a pixel at distance 1.
    pub footprint: f32,
}

impl Lens {
    /// Rays of a pinhole camera.
    pub fn new(camera: &Camera) -> Self {
        Self {
            eye: camera.position_world().as_vec3(),
            world_from_view: camera.rotation().transpose(),
            focal: (camera.fx, camera.fy),
            middle: (camera.cx, camera.cy),
            footprint: (1.0 / camera.fx.max(camera.fy)) as f32,
        }
    }

    /// The ray through a position in the image, pixels; its parameter is the view-space z.
    pub fn ray(&self, x: f64, y: f64) -> Ray {
        let d = DVec3::new((x - self.middle.0) / self.focal.0, (y - self.middle.1) / self.focal.1, 1.0);
        Ray::new(self.eye, (self.world_from_view * d).as_vec3())
    }
}

/// Result of one sample.
#[derive(Clone, Copy, Default)]
struct Sample {
    color: Vec3,
    /// Body that was hit; `None` for the sky.
    body: Option<u32>,
    /// Share of the sun; a change between 0 and more marks a shadow edge.
    sun: f32,
    /// Position within the pixel.
    at: Vec2,
}

/// Renders a view. `seed` and the index `view` determine the positions of samples within their pixels.
pub fn take(scene: &Scene, light: &Irradiance, camera: &Camera, seed: u64, view: u64) -> Frame {
    let lens = Lens::new(camera);
    let stream = Rng::new(seed).fork(VIEW_STREAM + view);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let centre = |i: usize| scene.world.closest(&lens.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
    let centres: Vec<Option<Hit>> = (0..width * height).into_par_iter().map(centre).collect();
    let body = |i: usize| centres[i].map(|h| scene.world.body_of(&h));
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let mut around = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
        let calm = around.all(|other| body(other) == body(i));
        color_of(scene, light, &lens, (x as f64, y as f64), calm, &mut stream.fork(i as u64))
    };
    let colors: Vec<[u8; 3]> = (0..width * height).into_par_iter().map(pixel).collect();
    Frame {
        colors: colors.into_flattened(),
        ids: centres.iter().map(|hit| hit.map_or(0, |h| scene.world.id_of(&h) as u16)).collect(),
        depths: centres.iter().map(|hit| hit.map_or(0.0, |h| h.t)).collect(),
    }
}

fn color_of(scene: &Scene, light: &Irradiance, lens: &Lens, pixel: (f64, f64), calm: bool, rng: &mut Rng) -> [u8; 3] {
    let starts: [f64; 4] = std::array::from_fn(|_| rng.uniform());
    let mut samples = [Sample::default(); MOST];
    let mut count = 0;
    // Indirect light at the last sample.
    let mut shared = None;
    for &(enough, contrast) in &STAGES[usize::from(!calm)..] {
        while count < enough {
            let (x, y) = spread_evenly(count, [starts[0], starts[1]]);
            let at = DVec2::new(x, y).as_vec2();
            let ray = lens.ray(pixel.0 + x, pixel.1 + y);
            let hit = scene.world.closest(&ray);
            let body = hit.map(|h| scene.world.body_of(&h));
            let known = samples.get(..SHADED).filter(|_| count >= SHADED).and_then(|known| alike(known, body, at));
            samples[count] = known.unwrap_or_else(|| {
                // Points of the sun, in another order.
                let (u, v) = spread_evenly(count * 29 % MOST, [starts[2], starts[3]]);
                let sun = disc(u as f32, v as f32);
                Sample { at, ..sample(scene, light, lens, &ray, hit, sun, &mut shared) }
            });
            count += 1;
        }
        if is_even(&samples[..count], contrast) {
            break;
        }
    }
    let mean = samples[..count].iter().map(|s| s.color).sum::<Vec3>() / count as f32;
    encoded((mean * scene.world.light.exposure).as_dvec3())
        .to_array()
        .map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8)
}

/// Point `k` of the R2 sequence (Roberts 2018), every prefix of which is evenly spread.
fn spread_evenly(k: usize, start: [f64; 2]) -> (f64, f64) {
    let along = |step: f64, start: f64| (start + step * k as f64).fract();
    (along(0.754_877_666_246_692_7, start[0]), along(0.569_840_290_998_053_2, start[1]))
}

/// The nearest sample of the same body; `None` if there is none, or if the sun reaches only some of them.
fn alike(known: &[Sample], body: Option<u32>, at: Vec2) -> Option<Sample> {
    let mut of_body = known.iter().filter(|s| s.body == body);
    let mut nearest = of_body.next()?;
    for other in of_body {
        if (other.sun > 0.0) != (nearest.sun > 0.0) {
            return None;
        }
        if other.at.distance_squared(at) < nearest.at.distance_squared(at) {
            nearest = other;
        }
    }
    Some(*nearest)
}

/// Whether all samples show the same body in about the same colour.
fn is_even(samples: &[Sample], contrast: f32) -> bool {
    let (mut low, mut high) = (samples[0].color, samples[0].color);
    samples.iter().for_each(|s| (low, high) = (low.min(s.color), high.max(s.color)));
    let same_body = || samples.iter().all(|s| s.body == samples[0].body && (s.sun > 0.0) == (samples[0].sun > 0.0));
    let relative = (high - low).max_element() / (high.max_element() + DARK);
    relative < contrast && (contrast > STAGES[1].1 || same_body())
}

fn sample(
    scene: &Scene,
    light: &Irradiance,
    lens: &Lens,
    ray: &Ray,
    hit: Option<Hit>,
    sun: (f32, f32),
    shared: &mut Option<(Point, Vec3)>,
) -> Sample {
    let Some(hit) = hit else {
        let color = scene.world.light.sky(ray.direction.normalize());
        return Sample { color, body: None, sun: 1.0, at: Vec2::ZERO };
    };
    let point = scene.world.point(ray, &hit, lens.footprint);
    let on_it = scene.world.sun_on(&point, sun);
    let reach = SAME_PLACE * scene.light_spacing;
    let near = |other: &Point| {
        other.normal.dot(point.normal) > SAME_NORMAL && other.position.distance_squared(point.position) < reach * reach
    };
    let around = match shared {
        Some((other, around)) if near(other) => *around,
        _ => light.at(scene, &point),
    };
    *shared = Some((point, around));
    let color = shaded(&scene.world, &point, ray.direction.normalize(), around, on_it);
    Sample { color, body: Some(point.body), sun: on_it, at: Vec2::ZERO }
}

/// Linear colour of a point seen along the unit vector `view`, for given indirect light and share of the sun.
pub fn shaded(world: &World, point: &Point, view: Vec3, around: Vec3, sun: f32) -> Vec3 {
    let diffuse = point.surface.albedo * (around + world.light.sun * sun);
    if point.surface.coat <= 0.0 {
        return diffuse;
    }
    let cosine = (-view.dot(point.normal)).clamp(0.0, 1.0);
    let fresnel = point.surface.coat + (1.0 - point.surface.coat) * 0.6 * (1.0 - cosine).powi(5);
    let mirrored = view - 2.0 * view.dot(point.normal) * point.normal;
    // Surroundings occlude as much of the mirrored sky as of the whole sky.
    let openness = (around.y / world.light.horizon.y).clamp(0.0, 1.0);
    diffuse * (1.0 - fresnel) + world.light.mirrored(mirrored, sun.min(1.0)) * (fresnel * openness)
}
