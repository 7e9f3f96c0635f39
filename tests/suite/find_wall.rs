//! Windows of a made-up house: geometry is the same for all openings of its walls, only the pattern of colours differs.

use std::ops::ControlFlow;

use glam::{DQuat, DVec3, Vec3};
use instgs_objects::register::{FindInput, FindOptions, Found, find_alike};
use instgs_vk::math::covariance::logit;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::{Camera, Gaussians, ObjectBox};

/// What is in an opening, which is 1 wide and 1.4 high.
#[derive(Clone, Copy, PartialEq)]
enum Opening {
    /// A white frame with a cross in it; the glass is of another colour each time.
    Window,
    /// A dark rim with something light in it.
    Vent,
    /// Evenly dark.
    Niche,
}
use Opening::{Niche, Vent, Window};

/// Rows of openings: heights of their middles, and what they are.
type Rows<const N: usize> = [(f64, [Opening; N]); 2];
const FRONT: Rows<4> = [(1.6, [Window, Vent, Window, Niche]), (4.2, [Window, Window, Vent, Window])];
const SIDE: Rows<3> = [(1.6, [Window, Niche, Vent]), (4.2, [Vent, Window, Niche])];
const SPACING: f64 = 1.8;

/// Colour and depth of a wall `across` from the middle of an opening, `above` it.
fn look(kind: Opening, glass: Vec3, across: f64, above: f64) -> Option<(Vec3, f64)> {
    let edge = (0.5 - across.abs()).min(0.7 - above.abs());
    let is_rim = edge < 0.15;
    let is_cross = across.abs() < 0.06 || above.abs() < 0.06;
    let depth = if is_rim { 0.0 } else { 0.1 };
    (edge > 0.0).then(|| {
        let color = match kind {
            Window if is_rim || is_cross => Vec3::splat(0.9),
            Window => glass,
            Vent if is_rim => Vec3::splat(0.15),
            Vent => Vec3::splat(0.75),
            Niche => Vec3::new(0.15, 0.25, 0.2),
        };
        (color, depth)
    })
}

/// Adds a wall of Gaussians from `corner` along `right`, facing `out`; returns the middles of its windows.
fn wall<const N: usize>(
    cloud: &mut Gaussians,
    rows: &Rows<N>,
    (corner, right, out): (DVec3, DVec3, DVec3),
    shade: f32,
) -> Vec<DVec3> {
    let mut rng = Rng::new(3 + N as u64);
    let middles = rows
        .iter()
        .flat_map(|(z, kinds)| kinds.iter().enumerate().map(move |(k, kind)| (SPACING * (k as f64 + 0.5), *z, *kind)));
    let openings: Vec<_> =
        middles.map(|of| (of, 0.4 * Vec3::from_array(std::array::from_fn(|_| rng.uniform() as f32)))).collect();
    for i in 0..(10.0 * SPACING) as usize * N {
        for j in 0..60 {
            let (along, z) = (0.1 * i as f64 + 0.02 * rng.uniform(), 0.1 * j as f64 + 0.02 * rng.uniform());
            let inside =
                openings.iter().find_map(|((x, height, kind), glass)| look(*kind, *glass, along - x, z - height));
            let (color, depth) = inside.unwrap_or((Vec3::new(0.55, 0.3, 0.25), 0.0));
            let noisy = shade * (color + 0.06 * rng.normal_vector().as_vec3());
            cloud.means.push((corner + along * right + z * DVec3::Z - depth * out).as_vec3().to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push((0.06 - 0.05 * out.abs()).as_vec3().to_array().map(f32::ln));
            cloud.opacity_logits.push(logit(0.9) as f32);
            cloud.sh.push(((noisy - 0.5) / SH_C0 as f32).to_array());
        }
    }
    let windows = openings.iter().filter(|((_, _, kind), _)| *kind == Window);
    windows.map(|((x, z, _), _)| corner + *x * right + *z * DVec3::Z).collect()
}

/// Two walls of a house, and its windows: five in front, two at the side, where there is shade.
fn house() -> (Gaussians, Vec<DVec3>) {
    let mut cloud = Gaussians::with_capacity(0, 0);
    let width = 4.0 * SPACING;
    let mut windows = wall(&mut cloud, &FRONT, (DVec3::ZERO, DVec3::X, -DVec3::Y), 1.0);
    windows.extend(wall(&mut cloud, &SIDE, (width * DVec3::X, DVec3::Y, DVec3::X), 0.7));
    (cloud, windows)
}

fn find(cloud: &Gaussians, center: DVec3) -> Found {
    let eye = |x: f64, y: f64| {
        Camera::look_at("a", DVec3::new(x, y, 2.0), DVec3::new(5.0, 1.0, 2.5), DVec3::Z, 1.0, (320, 180))
    };
    let cameras = [eye(2.0, -9.0), eye(9.0, -9.0), eye(16.0, 2.0)];
    let object =
        ObjectBox { id: 1, category: None, center, size: DVec3::new(1.2, 0.5, 1.6), world_from_box: DQuat::IDENTITY };
    let input = FindInput { cloud, cameras: &cameras, object: &object, up: None };
    find_alike(&input, &FindOptions::default(), &mut |_| ControlFlow::Continue(())).unwrap()
}

/// All windows and nothing else, in spite of other glass and of shade; also around the corner, turned.
#[test]
fn windows_are_told_from_other_openings_by_their_colours() {
    let (cloud, windows) = house();
    let found = find(&cloud, windows[0]);
    for place in &found.objects {
        println!(
            "{:.2} inliers {:.2} explained {:.2} at {:.2}",
            place.score, place.inliers, place.explained, place.object.center
        );
    }
    found.rejected.iter().take(5).for_each(|place| println!("not {:.2} at {:.2}", place.score, place.center));
    assert!(found.in_wall);
    assert_eq!(found.objects.len(), windows.len() - 1);
    for window in &windows[1..] {
        let near = found.objects.iter().find(|place| place.object.center.distance(*window) < 0.15).unwrap();
        let out = near.object.world_from_box * -DVec3::Y;
        let want = if window.y > 0.1 { DVec3::X } else { -DVec3::Y };
        assert!(out.angle_between(want).to_degrees() < 3.0, "{window} faces {out}");
    }
}

/// The same answer with any number of threads.
#[test]
fn it_does_not_depend_on_threads() {
    let (cloud, windows) = house();
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(find(&cloud, windows[1]), one_thread.install(|| find(&cloud, windows[1])));
}
