//! The paddock: asphalt with bays and markings, a kerb, a lawn, on a slab with a rounded rim.

use std::f64::consts::TAU;

use glam::{DMat3, DVec2, DVec3};

use super::discs::{push_disc, push_gaussian};
use super::ground_map::GroundMap;
use super::markings::Markings;
use super::props::Caster;
use super::shading::{Light, TO_SUN, diffuse, sh_dc};
use instgs_synth::shading::albedo;
use instgs_synth::surface::{PointGrid, Surfel};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::gaussians::Gaussians;

/// Half the lawn's size, metres; the slab ends there.
pub(crate) const SLAB_HALF: DVec2 = DVec2::new(23.0, 14.6);
/// Half the asphalt's size.
pub(crate) const ASPHALT_HALF: DVec2 = DVec2::new(19.8, 11.0);
/// Distance between bays.
pub(crate) const BAY_PITCH: f64 = 3.1;
/// Bays per row.
pub(crate) const BAYS: usize = 12;
/// |y| of the open and of the closed end of the bays.
pub(crate) const BAY_Y: (f64, f64) = (4.6, 10.2);

const SLAB_CORNER: f64 = 4.0;
const ASPHALT_CORNER: f64 = 2.2;
const KERB_WIDTH: f64 = 0.5;
const SLAB_DEPTH: f64 = 0.9;
/// Smallest distance of ground Gaussians: on paint, at shadow edges, on the kerb, on asphalt, on the lawn.
const SPACINGS: [f64; 5] = [0.10, 0.17, 0.17, 0.26, 0.36];
/// How fast the spacing may grow with distance: neighbours then have similar sizes and leave no holes between them.
const SPACING_GROWTH: f64 = 0.4;
/// Ground Gaussians are this much larger than those of small surfaces.
const ENLARGED: f64 = 1.1;
/// Darts per point of the finest spacing.
const DARTS: f64 = 14.0;

/// Shadows on the ground.
pub(crate) struct GroundLight {
    sun: GroundMap,
    contact: GroundMap,
}

impl GroundLight {
    /// From everything that throws a shadow.
    pub(crate) fn new(casters: &[Caster]) -> Self {
        let (mut sun, mut contact) = (GroundMap::new(SLAB_HALF), GroundMap::new(SLAB_HALF));
        for caster in casters {
            let p = caster.position;
            let along = TO_SUN.truncate() / TO_SUN.z;
            sun.cover(p.truncate() - along * p.z, caster.radius + 0.03, 1.0);
            if p.z < 0.9 {
                contact.cover(p.truncate(), caster.radius + 0.05, 1.0);
            }
        }
        Self { sun: sun.blurred(0.10), contact: contact.blurred(0.32) }
    }

    /// Light at a ground point.
    pub(crate) fn at(&self, p: DVec2) -> Light {
        let contact = self.contact.at(p);
        Light { openness: 1.0 - 0.82 * contact, sun: (1.0 - self.sun.at(p)) * (1.0 - 0.5 * contact) }
    }

    fn is_edge(&self, p: DVec2) -> bool {
        (0.06..0.94).contains(&self.sun.at(p))
    }
}

/// Signed distance to a rectangle with rounded corners, negative inside.
fn rounded_rectangle(p: DVec2, half: DVec2, corner: f64) -> f64 {
    let q = p.abs() - half + corner;
    q.max(DVec2::ZERO).length() + q.max_element().min(0.0) - corner
}

/// Adds the whole ground.
pub(crate) fn add_ground(rng: &mut Rng, cloud: &mut Gaussians, light: &GroundLight) {
    add_surface(rng, cloud, light);
    add_rim(rng, cloud);
}

/// Smooth noise in about -1..1: a sum of waves.
fn noise(p: DVec2) -> f64 {
    let wave = |kx: f64, ky: f64, phase: f64| (kx * p.x + ky * p.y + phase).sin();
    0.4 * wave(0.61, 0.37, 0.3) + 0.3 * wave(-0.83, 1.31, 1.9) + 0.2 * wave(2.3, 1.1, 4.0) + 0.1 * wave(-3.1, 4.7, 0.9)
}

fn add_surface(rng: &mut Rng, cloud: &mut Gaussians, light: &GroundLight) {
    let markings = Markings::new();
    let spacings = spacing_map(light, &markings);
    let finest = SPACINGS[0];
    let mut grid = PointGrid::new(0.5 * (SPACINGS[0] + SPACINGS[4]));
    let area = 4.0 * SLAB_HALF.x * SLAB_HALF.y;
    for _ in 0..(DARTS * area / (finest * finest)) as usize {
        let p = DVec2::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0)) * SLAB_HALF;
        let spacing = spacings.at(p).max(finest);
        // Darts in proportion to the points wanted.
        if !rng.chance((finest / spacing).powi(2)) || rounded_rectangle(p, SLAB_HALF, SLAB_CORNER) > -0.08 {
            continue;
        }
        if !grid.insert_apart(p.extend(0.0), spacing) {
            continue;
        }
        let from_asphalt = rounded_rectangle(p, ASPHALT_HALF, ASPHALT_CORNER);
        let (kerb, lawn) = ((0.0..KERB_WIDTH).contains(&from_asphalt), from_asphalt >= KERB_WIDTH);
        let (base, z, bump) = if kerb {
            let segment = (kerb_arc_length(p) / 1.2).rem_euclid(2.0) < 1.0;
            (albedo(if segment { 0xC8201E } else { 0xECECE8 }), 0.05, 0.0)
        } else if lawn {
            let fresh = 0.5 + 0.5 * noise(p * 1.4);
            // Mown in strips.
            let strip = if (p.x / 2.0).rem_euclid(2.0) < 1.0 { 1.0 } else { 0.82 };
            (albedo(0x44681F).lerp(albedo(0x6C8A34), fresh) * strip * rng.range(0.82, 1.18), 0.02, 0.16)
        } else {
            (markings.over(asphalt_albedo(p) * rng.range(0.94, 1.06), p), 0.0, 0.0)
        };
        let normal = (DVec3::Z + rng.unit_vector() * bump).normalize();
        let color = diffuse(base, normal, TO_SUN, light.at(p));
        let surfel = Surfel { position: p.extend(z), normal: DVec3::Z, spacing: ENLARGED * spacing };
        push_disc(cloud, &surfel, 0.98, &[sh_dc(color)]);
        if lawn && rng.chance(0.3) {
            add_tuft(rng, cloud, p, base, light);
        }
    }
}

/// The spacing wanted at each place, graded.
fn spacing_map(light: &GroundLight, markings: &Markings) -> GroundMap {
    let [paint, edge, kerb, asphalt, lawn] = SPACINGS;
    let wanted = |p: DVec2| {
        let from_asphalt = rounded_rectangle(p, ASPHALT_HALF, ASPHALT_CORNER);
        match () {
            () if markings.near(p) => paint,
            () if light.is_edge(p) => edge,
            () if from_asphalt > KERB_WIDTH => lawn,
            () if from_asphalt > 0.0 => kerb,
            () => asphalt,
        }
    };
    GroundMap::of(SLAB_HALF, wanted).graded(SPACING_GROWTH)
}

/// Grey with patches, and two worn tracks along the aisle.
fn asphalt_albedo(p: DVec2) -> DVec3 {
    let track = |y: f64| (-((p.y - y) / 0.28).powi(2)).exp();
    let worn = if p.x.abs() < 18.0 { track(1.4) + track(2.9) + track(-1.4) + track(-2.9) } else { 0.0 };
    albedo(0x5E6064) * (1.0 + 0.07 * noise(p) - 0.20 * worn)
}

/// Position along the kerb, close enough for its segments.
fn kerb_arc_length(p: DVec2) -> f64 {
    let flat = ASPHALT_HALF - ASPHALT_CORNER;
    let q = p - p.clamp(-flat, flat);
    if q.x.abs() > 1e-9 && q.y.abs() > 1e-9 {
        return flat.x + flat.y + ASPHALT_CORNER * q.y.abs().atan2(q.x.abs());
    }
    if q.x.abs() > q.y.abs() { p.y } else { p.x }
}

fn add_tuft(rng: &mut Rng, cloud: &mut Gaussians, p: DVec2, base: DVec3, light: &GroundLight) {
    let at = p + DVec2::new(rng.range(-0.15, 0.15), rng.range(-0.15, 0.15));
    let lean = (DVec3::Z + 0.35 * rng.unit_vector()).normalize();
    let (a, b) = lean.any_orthonormal_pair();
    let color = diffuse(base * rng.range(0.9, 1.5), DVec3::Z, TO_SUN, light.at(at));
    let size = rng.range(0.03, 0.06);
    let axes = DMat3::from_cols(a, b, lean);
    push_gaussian(cloud, at.extend(0.05), axes, DVec3::new(0.9, 0.9, 1.4) * size, 0.9, &[sh_dc(color)]);
}

/// The slab's side: soil below a line of grass.
fn add_rim(rng: &mut Rng, cloud: &mut Gaussians) {
    let spacing = 0.26;
    let flat = SLAB_HALF - SLAB_CORNER;
    let perimeter = 4.0 * (flat.x + flat.y) + TAU * SLAB_CORNER;
    let steps = (perimeter / spacing) as usize;
    for k in 0..steps {
        // Walk around by angle; the closest point of the rounded rectangle and its normal.
        let (sin, cos) = (TAU * k as f64 / steps as f64).sin_cos();
        let far = DVec2::new(cos, sin) * 1.42 * SLAB_HALF.max_element();
        let far = far.clamp(-SLAB_HALF - 1.0, SLAB_HALF + 1.0);
        let corner = far.clamp(-flat, flat);
        let normal = (far - corner).normalize_or(DVec2::X);
        let p = corner + normal * SLAB_CORNER;
        for level in 0..4 {
            let z = -SLAB_DEPTH * (f64::from(level) + 0.4 + rng.range(-0.2, 0.2)) / 4.0;
            let soil = albedo(0x6E5238).lerp(albedo(0x4A3626), rng.uniform());
            let base = if level == 0 { soil.lerp(albedo(0x4E6C28), 0.6) } else { soil };
            let color = diffuse(base, normal.extend(0.15).normalize(), TO_SUN, Light { openness: 0.85, sun: 0.9 });
            let surfel = Surfel { position: p.extend(z), normal: normal.extend(0.0), spacing };
            push_disc(cloud, &surfel, 0.97, &[sh_dc(color)]);
        }
    }
}
