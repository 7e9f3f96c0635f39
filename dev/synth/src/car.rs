//! The template: a racing car of about eleven thousand flat Gaussians. Frame: x forward, y left, z up, origin on the
//! ground below the middle; metres.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec2, DVec3};

use crate::surface::{Surfel, curve, plane, revolved, sample, sample_box, superellipse};
use instgs_vk::math::rng::Rng;

/// Material of a surfel of the car; liveries choose colours by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// A painted body panel.
    Paint,
    /// Glass of the windows.
    Glass,
    /// Rubber of the tyres.
    Tyre,
    /// Wheel rim and spokes.
    Rim,
    /// Bare carbon fibre: splitter, skirts, diffuser, arches.
    Carbon,
    /// The rear wing with its struts and end plates.
    Wing,
    /// Glass of a front lamp.
    Headlight,
    /// Glass of a rear lamp.
    Taillight,
}

/// One surfel of the car.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarSurfel {
    /// Position and normal in the template frame.
    pub surfel: Surfel,
    /// The material, by part of the car.
    pub part: Part,
}

/// Distance of the axles from the car's centre along x, metres.
pub const AXLE_X: f64 = 1.36;
/// Distance of a wheel's centre from the centre plane, metres.
pub const WHEEL_Y: f64 = 0.825;
/// Radius of a tyre, and height of the axles, metres.
pub const WHEEL_RADIUS: f64 = 0.34;
/// Radius of the wheel arches, metres.
pub(crate) const ARCH_RADIUS: f64 = 0.395;

/// Smallest distance between surfels of large panels, metres.
const PANEL_SPACING: f64 = 0.043;
/// Smallest distance between surfels of detailed parts, metres.
const DETAIL_SPACING: f64 = 0.032;

/// (x, half width), (x, upper edge), (x, lower edge) of the body, and (x, roof height) of the cabin.
const WIDTH: [(f64, f64); 9] = [
    (-2.28, 0.84),
    (-1.95, 0.95),
    (-1.35, 1.00),
    (-0.45, 0.93),
    (0.45, 0.91),
    (1.35, 0.99),
    (1.80, 0.96),
    (2.10, 0.85),
    (2.30, 0.60),
];
const TOP: [(f64, f64); 8] =
    [(-2.28, 0.80), (-1.90, 0.88), (-1.20, 0.86), (0.00, 0.80), (0.90, 0.76), (1.60, 0.64), (2.10, 0.47), (2.30, 0.36)];
const BOTTOM: [(f64, f64); 6] = [(-2.28, 0.40), (-2.05, 0.25), (-1.50, 0.15), (1.70, 0.13), (2.10, 0.15), (2.30, 0.22)];
const ROOF: [(f64, f64); 8] = [
    (-1.75, 0.84),
    (-1.20, 1.01),
    (-0.60, 1.15),
    (-0.15, 1.19),
    (0.15, 1.165),
    (0.45, 1.05),
    (0.80, 0.86),
    (1.00, 0.75),
];

/// A tyre's tread from the inner edge outwards, then over the shoulder down the face to the hub; (radius, distance
/// outwards from the wheel's middle).
pub(crate) const TYRE: [(f64, f64); 7] =
    [(0.33, -0.13), (0.34, -0.10), (0.34, 0.08), (0.33, 0.115), (0.30, 0.135), (0.235, 0.125), (0.215, 0.09)];

/// Samples the surfels of the whole car.
pub fn car_surfels(rng: &mut Rng) -> Vec<CarSurfel> {
    let mut out = Vec::new();
    add_body(rng, &mut out);
    add_cabin(rng, &mut out);
    for (x, y) in [(AXLE_X, WHEEL_Y), (AXLE_X, -WHEEL_Y), (-AXLE_X, WHEEL_Y), (-AXLE_X, -WHEEL_Y)] {
        add_wheel(rng, &mut out, DVec3::new(x, y, WHEEL_RADIUS));
    }
    add_wing(rng, &mut out);
    add_aero(rng, &mut out);
    out
}

fn add(out: &mut Vec<CarSurfel>, surfels: Vec<Surfel>, part: impl Fn(&Surfel) -> Option<Part>) {
    out.extend(surfels.into_iter().filter_map(|surfel| part(&surfel).map(|part| CarSurfel { surfel, part })));
}

/// The body's cross-section at `x`, scaled towards its middle by `inset`. Fenders rise over the wheels.
pub(crate) fn body_point(x: f64, angle: f64, inset: f64) -> DVec3 {
    let (width, top, bottom) = (curve(&WIDTH, x), curve(&TOP, x), curve(&BOTTOM, x));
    let section = superellipse(angle, 4.5);
    let across = section.x * inset;
    let bump = |axle: f64, length: f64| (-((x - axle) / length).powi(2)).exp();
    let fender = (0.13 * bump(AXLE_X, 0.36) + 0.09 * bump(-AXLE_X, 0.42)) * smooth(0.42, 0.72, across.abs());
    let middle = 0.5 * (top + bottom);
    let mut z = middle + 0.5 * (top - bottom) * section.y * inset;
    z += fender * smooth(middle - 0.1, top, z);
    // The sides lean in towards the top and are drawn in between the wheels.
    let waist = 1.0 - 0.06 * smooth(middle, top, z) - 0.05 * (-(x / 0.75).powi(2)).exp() * smooth(0.5, 0.3, z);
    DVec3::new(x, across * width * waist, z)
}

fn smooth(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The body's skin for u and v in 0..=1: over the top from the left lower edge to the right one, and from rear to front. The
/// floor is a plane of its own.
pub(crate) fn skin_point(u: f64, v: f64) -> DVec3 {
    let (rear, front) = ends();
    body_point(rear + (front - rear) * v, PI * (-0.24 + 1.48 * u), 1.0)
}

/// x coordinates of the body's rear and front end, metres.
pub(crate) fn ends() -> (f64, f64) {
    (TOP[0].0, TOP[TOP.len() - 1].0)
}

/// False where the skin has openings for wheels, and under the cabin.
pub(crate) fn has_skin(s: &Surfel) -> bool {
    !in_wheel_arch(s) && !under_cabin(s.position)
}

fn add_body(rng: &mut Rng, out: &mut Vec<CarSurfel>) {
    let (rear, front) = ends();
    let skin = sample(rng, PANEL_SPACING, skin_point);
    add(out, skin, |s| has_skin(s).then(|| skin_part(s)));
    let nose = sample(rng, DETAIL_SPACING, |u, v| body_point(front, TAU * u, 1.0 - v));
    add(out, nose, |s| Some(if s.position.z < 0.31 { Part::Carbon } else { Part::Paint }));
    let tail = sample(rng, DETAIL_SPACING, |u, v| body_point(rear, TAU * u, v));
    add(out, tail, |s| Some(tail_part(s)));
    let floor = sample(rng, 0.11, plane(DVec3::new(-2.2, -0.8, 0.15), DVec3::Y * 1.6, DVec3::X * 4.2));
    add(out, floor, |_| Some(Part::Carbon));
}

/// Material of the flat rear end.
pub(crate) fn tail_part(s: &Surfel) -> Part {
    let p = s.position;
    match () {
        () if (0.62..0.72).contains(&p.z) && p.y.abs() > 0.30 => Part::Taillight,
        () if p.z < 0.55 => Part::Carbon,
        () => Part::Paint,
    }
}

/// Material of the body's skin.
pub(crate) fn skin_part(s: &Surfel) -> Part {
    let p = s.position;
    let near_arch =
        (DVec2::new(p.x.abs() - AXLE_X, p.z - WHEEL_RADIUS).length() < ARCH_RADIUS + 0.035) && s.normal.y.abs() > 0.8;
    let intake = p.x > 2.02 && p.z < 0.30;
    let lamp = DVec2::new((p.x - 1.95 + 0.5 * (p.y.abs() - 0.62)) / 0.15, (p.y.abs() - 0.62) / 0.085).length() < 1.0
        && s.normal.z > 0.1;
    let vent = p.x < -1.5 && p.x > -1.9 && p.y.abs() < 0.5 && (p.x * 9.0).rem_euclid(1.0) < 0.4 && s.normal.z > 0.5;
    let rear_lamp = p.x < -2.2 && (0.62..0.72).contains(&p.z) && p.y.abs() > 0.5;
    match () {
        () if near_arch || intake || vent || p.z < 0.20 => Part::Carbon,
        () if lamp => Part::Headlight,
        () if rear_lamp => Part::Taillight,
        () => Part::Paint,
    }
}

fn in_wheel_arch(s: &Surfel) -> bool {
    let p = s.position;
    let from_axle = DVec2::new(p.x.abs() - AXLE_X, p.z - WHEEL_RADIUS);
    from_axle.length() < ARCH_RADIUS && p.y.abs() > 0.60 && p.z < 0.73 && s.normal.z < 0.7
}

/// Inside the cabin's foot print, well away from its rim, where the body is never seen.
fn under_cabin(p: DVec3) -> bool {
    p.x > -1.2 && p.x < 0.6 && p.y.abs() < 0.5 && p.z > 0.6
}

/// The cabin for u and v in 0..=1: from the left sill over the roof to the right one, and from rear to front.
pub(crate) fn cabin_point(u: f64, v: f64) -> DVec3 {
    let (rear, front) = (ROOF[0].0, ROOF[ROOF.len() - 1].0);
    let x = rear + (front - rear) * v;
    let foot = curve(&TOP, x) - 0.08;
    let half_width = 0.74 - 0.16 * smooth(-0.4, -1.75, x) - 0.10 * smooth(0.3, 1.0, x);
    let section = superellipse(PI * u, 2.7);
    let height = (curve(&ROOF, x) - foot).max(0.01);
    // Tumblehome: narrower towards the roof.
    DVec3::new(x, section.x * half_width * (1.0 - 0.22 * section.y), foot + height * section.y)
}

/// Material of the cabin.
pub(crate) fn cabin_part(s: &Surfel) -> Part {
    let p = s.position;
    let sill = p.z < curve(&TOP, p.x) + 0.05;
    let roof = s.normal.z > 0.80 && p.x > -1.05 && p.x < 0.18;
    let engine_cover = p.x < -1.12;
    let pillar =
        s.normal.y.abs() > 0.35 && ((p.x + 0.42).abs() < 0.05 || (p.x - 0.42 + 1.1 * (p.z - 1.0)).abs() < 0.05);
    let visor = s.normal.x > 0.2 && p.z > 1.10;
    if sill || roof || engine_cover || pillar || visor { Part::Paint } else { Part::Glass }
}

fn add_cabin(rng: &mut Rng, out: &mut Vec<CarSurfel>) {
    let shell = sample(rng, PANEL_SPACING, cabin_point);
    add(out, shell, |s| Some(cabin_part(s)));
    // Mirrors.
    for side in [1.0, -1.0] {
        let housing =
            sample_box(rng, 0.03, DVec3::new(0.52, 0.86 * side, 0.93), DMat3::IDENTITY, DVec3::new(0.05, 0.09, 0.045));
        add(out, housing, |_| Some(Part::Paint));
        let stalk =
            sample_box(rng, 0.03, DVec3::new(0.52, 0.72 * side, 0.88), DMat3::IDENTITY, DVec3::new(0.02, 0.08, 0.012));
        add(out, stalk, |_| Some(Part::Carbon));
    }
}

fn add_wheel(rng: &mut Rng, out: &mut Vec<CarSurfel>, hub: DVec3) {
    let outward = DVec3::Y * hub.y.signum();
    let knots = TYRE;
    let profile = move |u: f64| {
        let t = u * (knots.len() - 1) as f64;
        let i = (t as usize).min(knots.len() - 2);
        let (a, b, f) = (knots[i], knots[i + 1], t - i as f64);
        DVec2::new(a.0 + (b.0 - a.0) * f, a.1 + (b.1 - a.1) * f)
    };
    // `revolved` is outwards to the right of the profile's run, which here runs along +axis.
    let tyre = sample(rng, DETAIL_SPACING, revolved(hub, outward, profile));
    add(out, tyre, |s| {
        let radius = DVec2::new(s.position.x - hub.x, s.position.z - hub.z).length();
        Some(if radius < 0.238 { Part::Rim } else { Part::Tyre })
    });
    let dish = move |u: f64| DVec2::new(0.218 * (1.0 - u), 0.085 - 0.05 * (PI * u).sin() * (1.0 - u));
    let rim = sample(rng, 0.021, revolved(hub, outward, dish));
    add(out, rim, |s| {
        let (x, z) = (s.position.x - hub.x, s.position.z - hub.z);
        let spoke = (z.atan2(x) * 5.0 / TAU).rem_euclid(1.0);
        let radius = DVec2::new(x, z).length();
        Some(if spoke < 0.42 || !(0.055..=0.195).contains(&radius) { Part::Rim } else { Part::Carbon })
    });
    // The inner wall of the wheel arch.
    let well = move |u: f64| DVec2::new((ARCH_RADIUS + 0.04) * (1.0 - u), -0.17);
    let well = sample(rng, 0.06, revolved(hub, outward, well));
    add(out, well, |s| (s.position.z > 0.12).then_some(Part::Carbon));
}

fn add_wing(rng: &mut Rng, out: &mut Vec<CarSurfel>) {
    let (sin, cos) = 0.16f64.sin_cos();
    let tilt = DMat3::from_cols(DVec3::new(cos, 0.0, -sin), DVec3::Y, DVec3::new(sin, 0.0, cos));
    let mut parts = sample_box(rng, 0.036, DVec3::new(-2.12, 0.0, 1.19), tilt, DVec3::new(0.19, 0.92, 0.020));
    for side in [1.0, -1.0] {
        let plate = DVec3::new(-2.12, 0.93 * side, 1.14);
        parts.extend(sample_box(rng, 0.034, plate, DMat3::IDENTITY, DVec3::new(0.23, 0.010, 0.13)));
        let (sin, cos) = 0.30f64.sin_cos();
        let lean = DMat3::from_cols(DVec3::new(cos, 0.0, sin), DVec3::Y, DVec3::new(-sin, 0.0, cos));
        let strut = DVec3::new(-2.02, 0.34 * side, 1.02);
        parts.extend(sample_box(rng, 0.032, strut, lean, DVec3::new(0.07, 0.014, 0.17)));
    }
    add(out, parts, |_| Some(Part::Wing));
}

fn add_aero(rng: &mut Rng, out: &mut Vec<CarSurfel>) {
    let mut parts = sample_box(rng, 0.05, DVec3::new(2.06, 0.0, 0.115), DMat3::IDENTITY, DVec3::new(0.27, 0.74, 0.015));
    parts.extend(sample_box(rng, 0.05, DVec3::new(-2.20, 0.0, 0.26), DMat3::IDENTITY, DVec3::new(0.16, 0.78, 0.02)));
    for side in [1.0, -1.0] {
        let skirt = DVec3::new(0.0, 0.87 * side, 0.135);
        parts.extend(sample_box(rng, 0.05, skirt, DMat3::IDENTITY, DVec3::new(0.92, 0.05, 0.02)));
    }
    add(out, parts, |_| Some(Part::Carbon));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_car_has_its_size_and_all_parts() {
        let car = car_surfels(&mut Rng::new(5));
        assert!((8_000..=12_000).contains(&car.len()), "{}", car.len());
        use Part::*;
        for part in [Paint, Glass, Tyre, Rim, Carbon, Wing, Headlight, Taillight] {
            assert!(car.iter().filter(|s| s.part == part).count() > 20, "{part:?}");
        }
        for s in &car {
            let p = s.surfel.position;
            assert!(p.x.abs() < 2.5 && p.y.abs() < 1.08 && (-0.01..1.35).contains(&p.z), "{p}");
            assert!((s.surfel.normal.length() - 1.0).abs() < 1e-9);
        }
    }

    /// Panels face away from the car's middle line, apart from few in concave places.
    #[test]
    fn panels_face_outwards() {
        let car = car_surfels(&mut Rng::new(5));
        let panels: Vec<_> = car.iter().filter(|s| matches!(s.part, Part::Paint | Part::Glass | Part::Tyre)).collect();
        let outwards = |s: &&&CarSurfel| {
            let p = s.surfel.position;
            let inside = if s.part == Part::Tyre {
                DVec3::new(AXLE_X * p.x.signum(), WHEEL_Y * p.y.signum(), WHEEL_RADIUS)
            } else {
                DVec3::new(p.x.clamp(-1.8, 1.6), 0.0, 0.45)
            };
            s.surfel.normal.dot(p - inside) > 0.0
        };
        let share = panels.iter().filter(outwards).count() as f64 / panels.len() as f64;
        assert!(share > 0.97, "{share}");
    }
}
