//! Renders one view: colour, id and depth of each pixel.

use glam::{DMat3, DVec3, Vec3};
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

/// Adaptive sampling: a pixel whose neighbourhood is even, by the centres of its pixels, is finished at the first of these
/// that its samples meet.
const EVEN: [Even; 3] = [
    Even { samples: 4, contrast: 0.025, one_kind: true },
    Even { samples: 8, contrast: 0.05, one_kind: true },
    Even { samples: 16, contrast: 0.1, one_kind: false },
];
/// Largest contrast of the centres of an even neighbourhood.
const EVEN_AROUND: f32 = 0.1;
/// What is uneven goes on: a pixel is finished after so many samples if the first half of them says the same as all, and
/// in any case after the last number. Noise would be learned by heart, and hide how good a scene is.
const HALVES: [usize; 3] = [2 * EVEN[2].samples, 4 * EVEN[2].samples, MOST];
/// Largest number of samples of a pixel.
const MOST: usize = 128;
/// Largest difference between the two for that, in the encoded value of a channel. The halves agree by chance, too, so that
/// the first time counts only where all samples show one kind: at an edge a third of all pixels would stop there.
const SAME: f64 = 2.0 / 255.0;
/// The sun's points are a pixel's points in steps of this, modulo [`MOST`]: odd, so that all of them are used, and of those
/// one after which the first 16, 32 and 64 are spread well.
const SUN_STEP: usize = 73;
/// Added to the brightest channel before contrasts are computed: differences below it are hardly visible.
const DARK: f32 = 0.15;
/// Samples of a pixel share indirect light if the cosine between their normals exceeds this ...
const SAME_NORMAL: f32 = 0.97;
/// ... and they are nearer to each other than this part of the spacing of light samples.
const SAME_PLACE: f32 = 0.35;
/// First of the random streams of views.
const VIEW_STREAM: u64 = 0x5EED_0001;

/// When a pixel may be finished early.
struct Even {
    /// Number of its samples.
    samples: usize,
    /// Their contrast is below this.
    contrast: f32,
    /// True if, besides, all of them have to show the same body, in the sun or not.
    one_kind: bool,
}

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

/// What one sample shows.
#[derive(Clone, Copy, PartialEq)]
struct Kind {
    /// Body that was hit; `None` for the sky.
    body: Option<u32>,
    /// True if the sun reaches it.
    sunny: bool,
}

/// Renders a view. `seed` and the index `view` determine the positions of samples within their pixels.
pub fn take(scene: &Scene, light: &Irradiance, camera: &Camera, seed: u64, view: u64) -> Frame {
    let lens = Lens::new(camera);
    let stream = Rng::new(seed).fork(VIEW_STREAM + view);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let centre = |i: usize| {
        let (x, y) = (i % width, i / width);
        let ray = lens.ray(x as f64 + 0.5, y as f64 + 0.5);
        let hit = scene.world.closest(&ray);
        // Neighbours look at different points of the sun's rim: half shadows are not even, however wide they are.
        let rim = disc(0.9, (x % 3 + 3 * (y % 3)) as f32 / 9.0);
        (hit, sample(scene, light, &lens, &ray, hit, rim, &mut None))
    };
    let centres: Vec<(Option<Hit>, (Vec3, Kind))> = (0..width * height).into_par_iter().map(centre).collect();
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let mut around = Taken::default();
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for x in x.saturating_sub(1)..(x + 2).min(width) {
                around.add(centres[y * width + x].1);
            }
        }
        let is_even = around.is_one_kind && around.contrast() < EVEN_AROUND;
        color_of(scene, light, &lens, (x as f64, y as f64), is_even, &mut stream.fork(i as u64))
    };
    let colors: Vec<[u8; 3]> = (0..width * height).into_par_iter().map(pixel).collect();
    Frame {
        colors: colors.into_flattened(),
        ids: centres.iter().map(|(hit, _)| hit.map_or(0, |h| scene.world.id_of(&h) as u16)).collect(),
        depths: centres.iter().map(|(hit, _)| hit.map_or(0.0, |h| h.t)).collect(),
    }
}

fn color_of(
    scene: &Scene,
    light: &Irradiance,
    lens: &Lens,
    pixel: (f64, f64),
    is_even: bool,
    rng: &mut Rng,
) -> [u8; 3] {
    let starts: [f64; 4] = std::array::from_fn(|_| rng.uniform());
    let mut taken = Taken::default();
    // Indirect light at the last sample.
    let mut shared = None;
    let mut take_until = |taken: &mut Taken, enough: usize| {
        for k in taken.count..enough {
            let (x, y) = spread_evenly(k, [starts[0], starts[1]]);
            // Points of the sun, in another order.
            let (u, v) = spread_evenly(k * SUN_STEP % MOST, [starts[2], starts[3]]);
            let ray = lens.ray(pixel.0 + x, pixel.1 + y);
            let hit = scene.world.closest(&ray);
            taken.add(sample(scene, light, lens, &ray, hit, disc(u as f32, v as f32), &mut shared));
        }
        encoded((taken.sum / taken.count as f32 * scene.world.light.exposure).as_dvec3())
    };
    let byte = |c: f64| (c * 255.0).round().clamp(0.0, 255.0) as u8;
    let mut color = DVec3::ZERO;
    for Even { samples, contrast, one_kind } in EVEN {
        color = take_until(&mut taken, samples);
        if is_even && taken.contrast() < contrast && (taken.is_one_kind || !one_kind) {
            return color.to_array().map(byte);
        }
    }
    for enough in HALVES {
        let half = color;
        color = take_until(&mut taken, enough);
        if (color - half).abs().max_element() < SAME && (taken.is_one_kind || enough > HALVES[0]) {
            break;
        }
    }
    color.to_array().map(byte)
}

/// The samples of a pixel so far.
#[derive(Default)]
struct Taken {
    count: usize,
    sum: Vec3,
    low: Vec3,
    high: Vec3,
    first: Option<Kind>,
    /// True if all of them show the same body, in the sun or not.
    is_one_kind: bool,
}

impl Taken {
    fn add(&mut self, (color, kind): (Vec3, Kind)) {
        let first = *self.first.get_or_insert(kind);
        if self.count == 0 {
            (self.low, self.high, self.is_one_kind) = (color, color, true);
        }
        self.count += 1;
        self.sum += color;
        (self.low, self.high) = (self.low.min(color), self.high.max(color));
        self.is_one_kind &= kind == first;
    }

    /// The largest difference of two samples in a channel, as a part of the brightest.
    fn contrast(&self) -> f32 {
        (self.high - self.low).max_element() / (self.high.max_element() + DARK)
    }
}

/// Point `k` of the R2 sequence (Roberts 2018), every prefix of which is evenly spread.
fn spread_evenly(k: usize, start: [f64; 2]) -> (f64, f64) {
    let along = |step: f64, start: f64| (start + step * k as f64).fract();
    (along(0.754_877_666_246_692_7, start[0]), along(0.569_840_290_998_053_2, start[1]))
}

fn sample(
    scene: &Scene,
    light: &Irradiance,
    lens: &Lens,
    ray: &Ray,
    hit: Option<Hit>,
    sun: (f32, f32),
    shared: &mut Option<(Point, Vec3)>,
) -> (Vec3, Kind) {
    let Some(hit) = hit else {
        let color = scene.world.light.sky(ray.direction.normalize());
        return (color, Kind { body: None, sunny: true });
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
    (color, Kind { body: Some(point.body), sunny: on_it > 0.0 })
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
