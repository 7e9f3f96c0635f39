//! A whole scene without training: a paddock with racing cars, made by code. What tests render, pack and merge.

mod discs;
mod ground;
mod ground_map;
mod markings;
mod occlusion;
mod props;
mod shading;

use std::f64::consts::PI;

use glam::{DMat3, DVec2, DVec3};

pub(crate) use discs::push_disc;
use ground::{ASPHALT_HALF, BAY_PITCH, BAY_Y, BAYS, GroundLight, add_ground};
use instgs_synth::car::{CarSurfel, Part, car_surfels};
use instgs_synth::livery::{Livery, Pattern, Wing};
use instgs_synth::shading::albedo;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::{Group, Instance, InstancedScene, SourceRange};
use instgs_vk::scene::offsets::Offsets;
use occlusion::{Smoother, VoxelGrid};
use props::{Caster, Props};
use shading::{ClearCoat, Light, TO_SUN, diffuse, sh_dc};

const SEED: u64 = 20;
/// Radius over which baked light is averaged, metres.
const SMOOTHING: f64 = 0.13;
/// Opacity of a car's Gaussians.
const OPACITY: f64 = 0.975;
/// Logit offset of a part that a car does not have: alpha falls below 1/255 and is skipped.
const HIDDEN_LOGIT: f32 = -14.0;
/// Bays that stay empty, row by row.
const EMPTY_BAYS: [usize; 3] = [4, 14, 21];

/// A car's place and look.
struct Placed {
    position: DVec2,
    yaw: f64,
    scale: f64,
    livery: Livery,
}

/// Builds the scene: one template of about 11,000 Gaussians (SH degree 3), 24 instances with their own offsets, and
/// about 27,000 background Gaussians (SH degree 0). The same bits on every call.
pub(crate) fn embedded_scene() -> InstancedScene {
    let root = Rng::new(SEED);
    let car = car_surfels(&mut root.fork(1));
    let grid = VoxelGrid::new(car.iter().map(|s| s.surfel.position));
    let surfels: Vec<_> = car.iter().map(|s| s.surfel).collect();
    let smoother = Smoother::new(&surfels, SMOOTHING);
    let openness: Vec<f64> = car.iter().map(|s| car_openness(&grid, s)).collect();
    let openness = smoother.smoothed(&smoother.smoothed(&openness));
    let cars = placed_cars(&mut root.fork(2));
    let mut casters = Vec::new();
    let mut instances = Vec::new();
    let mut offsets = Offsets::default();
    for placed in &cars {
        let pose = pose_of(placed);
        let first_offset = Some(offsets.len() as u32);
        instances.push(Instance { template: 0, world_from_template: pose, first_offset });
        let sun = smoother.smoothed(&smoother.smoothed(&sun_on_car(&car, &grid, placed.yaw)));
        add_offsets(&car, &openness, &sun, placed, &mut offsets);
        casters.extend(car.iter().filter(|s| !placed.livery.hides(s)).map(|s| Caster {
            position: pose.transform_point(s.surfel.position + placed.livery.displacement(s)),
            radius: 0.8 * s.surfel.spacing * placed.scale,
        }));
    }
    let templates = template_cloud(&car, &openness);
    let mut background = Gaussians::with_capacity(0, 30_000);
    add_props(&mut root.fork(3), &mut Props { cloud: &mut background, casters: &mut casters });
    add_ground(&mut root.fork(4), &mut background, &GroundLight::new(&casters));
    InstancedScene {
        template_ranges: vec![SourceRange { first: 0, count: templates.len() as u32 }],
        groups: vec![Group {
            template_id: 0,
            name: Some("car".into()),
            instance_ids: (1..=instances.len() as u32).collect(),
        }],
        templates,
        instances,
        offsets,
        background,
        source: "embedded scene of instgs-vk".into(),
        ..InstancedScene::default()
    }
}

/// Share of the sky over a surfel; the ground takes its part low on the car.
fn car_openness(grid: &VoxelGrid, s: &CarSurfel) -> f64 {
    let height = (s.surfel.position.z / 0.5).clamp(0.0, 1.0);
    grid.openness(&s.surfel) * (0.5 + 0.5 * height)
}

fn pose_of(placed: &Placed) -> Similarity {
    Similarity::from_parts(DMat3::from_rotation_z(placed.yaw), placed.scale, placed.position.extend(0.0))
}

/// The template without offsets: grey, the sun overhead (which no yaw changes), and the clear coat.
fn template_cloud(car: &[CarSurfel], openness: &[f64]) -> Gaussians {
    let coat = ClearCoat::new();
    let mut out = Gaussians::with_capacity(3, car.len());
    for (s, &open) in car.iter().zip(openness) {
        let reflectance = match s.part {
            Part::Paint => 0.075,
            Part::Glass => 0.18,
            Part::Rim => 0.28,
            Part::Headlight => 0.12,
            Part::Wing | Part::Taillight => 0.05,
            Part::Carbon => 0.025,
            Part::Tyre => 0.008,
        };
        let mut sh = coat.sh(s.surfel.normal, reflectance, open * open);
        sh[0] += sh_dc(template_color(s, open));
        push_disc(&mut out, &s.surfel, OPACITY, &sh);
    }
    out
}

fn template_color(s: &CarSurfel, openness: f64) -> DVec3 {
    let light = Light { openness, sun: 0.6 * openness };
    diffuse(Livery::TEMPLATE.albedo_of(s), s.surfel.normal, DVec3::Z, light)
}

/// The direction to the sun in the frame of a car with this yaw.
fn sun_in_template(yaw: f64) -> DVec3 {
    DMat3::from_rotation_z(-yaw) * TO_SUN
}

/// Per surfel 1 if the sun shines on it, else 0.
fn sun_on_car(car: &[CarSurfel], grid: &VoxelGrid, yaw: f64) -> Vec<f64> {
    let to_sun = sun_in_template(yaw);
    car.iter().map(|s| if grid.sees(&s.surfel, to_sun) { 1.0 } else { 0.0 }).collect()
}

/// One record per surfel: livery and sunlight of this place in the world, moved parts, missing parts.
fn add_offsets(car: &[CarSurfel], openness: &[f64], sun: &[f64], placed: &Placed, out: &mut Offsets) {
    let to_sun = sun_in_template(placed.yaw);
    for ((s, &open), &sun) in car.iter().zip(openness).zip(sun) {
        let base = placed.livery.albedo_of(s);
        // The wing is so thin that its two sides are drawn in one another: both get the same light.
        let color = if s.part == Part::Wing {
            diffuse(base, DVec3::Z, to_sun, Light { openness: 0.8, sun: 0.8 })
        } else {
            diffuse(base, s.surfel.normal, to_sun, Light { openness: open, sun })
        };
        let change = (color - template_color(s, open)) / SH_C0;
        out.sh_dc.push(change.as_vec3().to_array());
        out.means.push(placed.livery.displacement(s).as_vec3().to_array());
        out.opacity_logits.push(if placed.livery.hides(s) { HIDDEN_LOGIT } else { 0.0 });
    }
}

/// Two rows of bays with a few left empty, a car on show in the middle and two on the aisle.
fn placed_cars(rng: &mut Rng) -> Vec<Placed> {
    let mut out = Vec::new();
    let show = Livery {
        primary: albedo(0xC8141E),
        secondary: albedo(0xF2F2F0),
        rims: albedo(0xD0D2D6),
        pattern: Pattern::Stripes,
        roundels: true,
        wing: Wing::Raised(0.05),
        ride_height: 0.0,
        steering: 0.32,
    };
    out.push(Placed { position: DVec2::ZERO, yaw: -0.62, scale: 1.04, livery: show });
    for (x, y, yaw) in [(-10.4, 2.0, PI + 0.07), (9.6, -1.9, 0.10)] {
        let livery = Livery::drawn(out.len() + 3, rng);
        out.push(Placed { position: DVec2::new(x, y), yaw, scale: 1.0, livery });
    }
    for bay in (0..2 * BAYS).filter(|bay| !EMPTY_BAYS.contains(bay)) {
        let side = if bay < BAYS { 1.0 } else { -1.0 };
        let x = BAY_PITCH * ((bay % BAYS) as f64 - 0.5 * (BAYS as f64 - 1.0));
        let y = side * 0.5 * (BAY_Y.0 + BAY_Y.1);
        // Most stand nose to the aisle.
        let nose_out = !rng.chance(0.25);
        let facing = if nose_out { -side } else { side };
        out.push(Placed {
            position: DVec2::new(x + rng.range(-0.15, 0.15), y + rng.range(-0.2, 0.2)),
            yaw: 0.5 * PI * facing + rng.range(-0.06, 0.06),
            scale: rng.range(0.95, 1.05),
            livery: Livery::drawn(out.len(), rng),
        });
    }
    out
}

fn add_props(rng: &mut Rng, props: &mut Props) {
    let far = ASPHALT_HALF + DVec2::new(1.7, 1.9);
    for (x, y, height) in
        [(-17.5, 1.0, 4.4), (-12.4, 1.05, 5.2), (-3.6, 1.0, 4.6), (5.2, 1.02, 5.4), (13.1, 1.0, 4.3), (18.6, 1.0, 5.0)]
    {
        props.tree(rng, DVec2::new(x, y * far.y), height);
    }
    for (y, height) in [(-7.6, 4.0), (6.9, 4.8)] {
        props.tree(rng, DVec2::new(-far.x, y), height);
        props.tree(rng, DVec2::new(far.x, -y), height * 0.95);
    }
    for x in [-8.2, 0.6, 9.3] {
        props.lamp(rng, DVec2::new(x, ASPHALT_HALF.y + 0.9), DVec2::NEG_Y);
    }
    for x in [-13.0, 13.0] {
        props.lamp(rng, DVec2::new(x, -ASPHALT_HALF.y - 0.9), DVec2::Y);
    }
    for k in 0..10 {
        let color = if k % 2 == 0 { 0xC8201E } else { 0xE8E8E4 };
        props.tyre_stack(rng, DVec2::new(ASPHALT_HALF.x - 0.55, 0.72 * (f64::from(k) - 4.5)), color);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_is_consistent_finite_and_of_the_promised_size() {
        let scene = embedded_scene();
        scene.validate().unwrap();
        assert!(scene.instances.len() >= 24);
        assert!((8_000..=12_000).contains(&scene.templates.len()), "{}", scene.templates.len());
        assert!((15_000..=30_000).contains(&scene.background.len()), "{}", scene.background.len());
        assert!((250_000..=350_000).contains(&scene.expanded_len()), "{}", scene.expanded_len());
        assert_eq!(scene.templates.sh_degree, 3);
        assert_eq!(scene.offsets.len(), scene.instances.len() * scene.templates.len());
        assert!(scene.offsets.means.iter().chain(&scene.offsets.sh_dc).flatten().all(|v| v.is_finite()));
        for cloud in [&scene.templates, &scene.background] {
            assert!((0..cloud.len()).all(|i| cloud.is_finite(i)));
        }
        let flat = scene.flatten();
        assert_eq!(flat.len() as u64, scene.expanded_len());
        assert!((0..flat.len()).all(|i| flat.is_finite(i)));
        // 62 floats per Gaussian in a .ply.
        assert!(62 * 4 * scene.expanded_len() > 4 * scene.tensor_bytes());
    }

    #[test]
    fn every_call_gives_the_same_scene() {
        assert!(embedded_scene() == embedded_scene());
    }

    /// The instances differ in colour, position and opacity offsets, in place, yaw and scale.
    #[test]
    fn instances_differ() {
        let scene = embedded_scene();
        let n = scene.templates.len();
        let records = |k: usize| &scene.offsets.sh_dc[k * n..(k + 1) * n];
        for k in 1..scene.instances.len() {
            assert_ne!(scene.instances[k].world_from_template, scene.instances[k - 1].world_from_template);
            assert_ne!(records(k), records(k - 1));
        }
        assert!(scene.offsets.opacity_logits.contains(&HIDDEN_LOGIT) && scene.offsets.opacity_logits.contains(&0.0));
        assert!(scene.offsets.means.iter().any(|m| m[2] > 0.05));
    }
}
