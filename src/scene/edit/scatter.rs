//! Scattering new instances of a template over a plane or along a path.
//!
//! A new instance starts with the rotation and scale of the template's first instance (none: those of the template's
//! frame), is then rotated about the plane's normal or the path's up vector, and stands on the plane or path.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use crate::math::rng::Rng;
use crate::math::sh::widened;
use crate::math::similarity::Similarity;
use crate::scene::edit::membership::{MOST_INSTANCES, add, copy_look, drop_foreign};
use crate::scene::edit::placement::template_centres;
use crate::scene::edit::{EditOutcome, EditReason, Selector, checked, existing_template, offset_runs};
use crate::scene::instanced_scene::{Instance, InstancedScene};

/// The ground contact of an object is this percentile of its means: trained templates have outliers below.
const BELOW_GROUND: f64 = 0.01;
/// Random positions tried for an instance before the plane counts as full: then less than 1 % of it is free with 99.99
/// % certainty.
const TRIES: usize = 1000;
/// A forward axis counts as vertical if its horizontal part is shorter than this.
const LEVEL: f64 = 1e-3;

/// Parameters of scattering: adds instances of a template.
#[derive(Clone, Debug, PartialEq)]
pub struct Scatter {
    /// Index of the template.
    pub template: u32,
    /// Number of new instances, at least 1.
    pub count: usize,
    /// The plane or path they stand on.
    pub over: ScatterOver,
    /// The offsets they get.
    pub offsets: OffsetSource,
}

/// The plane or path that scattered instances stand on.
#[derive(Clone, Debug, PartialEq)]
pub enum ScatterOver {
    /// Random positions in a rectangle, with random rotations about its normal.
    Plane {
        /// The rectangle's centre, world units.
        point: DVec3,
        /// Up direction, of any length but zero.
        normal: DVec3,
        /// Side lengths of the rectangle, world units. The first side is the world's x axis projected on the plane (z
        /// if the normal is within 25 degrees of x), the second is perpendicular to it.
        extent: [f64; 2],
        /// Least distance between the instances' centres within the plane, world units.
        min_distance: f64,
        /// Largest random angle, radians: [`TAU`] gives any direction, 0 none.
        turn: f64,
        /// Seed of the positions and angles.
        seed: u64,
    },
    /// Random positions in a polygon, with random rotations about its up direction.
    Polygon {
        /// The corners, world units, three or more, in order. Instances stand on the plane through their mean.
        points: Vec<DVec3>,
        /// Up direction, of any length but zero.
        up: DVec3,
        /// Least distance between the instances' centres within the plane, world units.
        min_distance: f64,
        /// As of [`ScatterOver::Plane`], radians.
        turn: f64,
        /// Seed of the positions and angles.
        seed: u64,
    },
    /// Equal distances along a polyline, both ends included, rotated so that the reference's x axis (the template's, as
    /// the first instance is placed) points along it.
    Path {
        /// The corners of the polyline, world units, two or more.
        points: Vec<DVec3>,
        /// Up direction, of any length but zero.
        up: DVec3,
        /// Additional rotation about `up`, radians.
        yaw: f64,
    },
}

/// Which offsets, own Gaussians and colour matrix scattered instances get.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OffsetSource {
    /// No offsets: they look like the template.
    None,
    /// The offsets of an existing instance, shared with it: no memory until one of them is recoloured. Its own Gaussians are
    /// shared, too, and its colour matrix is copied.
    Shared(Selector),
    /// A copy of an existing instance's offsets for each; own Gaussians are shared with it, and its colour matrix is copied.
    Copied(Selector),
}

/// What commands take as the most instances of one scatter: more than any scene shows, so a typing error ends here.
pub const MOST_SCATTERED: usize = 1_000_000;

/// A position on the ground, world units, and a rotation about the up axis, radians.
type Spot = (DVec3, f64);

/// How the template is placed before its rotation: linear part, centre, up axis, and height of its ground contact.
struct Stance {
    linear: DMat3,
    centre: DVec3,
    up: DVec3,
    ground: f64,
}

pub(super) fn scatter(scene: &mut InstancedScene, scatter: &Scatter) -> Result<EditOutcome, EditReason> {
    existing_template(scene, scatter.template)?;
    let total = (scene.instances.len() as u64).saturating_add(scatter.count as u64);
    if scatter.count == 0 || total > MOST_INSTANCES {
        return Err(EditReason::value(format!("{} is not a valid number of instances", scatter.count)));
    }
    let source_instance = offset_source(scene, scatter)?;
    let source = source_instance.and_then(|k| scene.instances[k].first_offset);
    let placements = placements(scene, scatter)?;
    let mut outcome = EditOutcome::default();
    let copies = source.is_some() && matches!(scatter.offsets, OffsetSource::Copied(_));
    let records = scene.template_ranges[scatter.template as usize].count;
    if copies {
        offset_runs::reserve(scene, u64::from(records) * scatter.count as u64)?;
        drop_foreign(scene, "offset.", &mut outcome);
    }
    let mut instance = |world_from_template| {
        let first_offset = if copies { Some(offset_runs::append(scene, source, records)) } else { source };
        Instance { template: scatter.template, world_from_template, first_offset }
    };
    let instances: Vec<Instance> = placements.into_iter().map(&mut instance).collect();
    add(scene, instances, &mut outcome);
    if let Some(k) = source_instance {
        copy_look(scene, k, &outcome.added);
    }
    Ok(outcome)
}

/// Index of the instance that new ones take their look from; `None` for that of the template.
fn offset_source(scene: &InstancedScene, scatter: &Scatter) -> Result<Option<usize>, EditReason> {
    let which = match &scatter.offsets {
        OffsetSource::None => return Ok(None),
        OffsetSource::Shared(which) | OffsetSource::Copied(which) => which,
    };
    let k = which.resolve_one(scene)?;
    let source = &scene.instances[k];
    if source.template != scatter.template {
        let (has, wanted) = (source.template, scatter.template);
        return Err(EditReason::OtherOffsets { which: which.clone(), has, wanted });
    }
    if scene.looks_like_template(k) {
        return Err(EditReason::NoOffsets { which: which.clone() });
    }
    Ok(Some(k))
}

fn placements(scene: &InstancedScene, scatter: &Scatter) -> Result<Vec<Similarity>, EditReason> {
    let (up, what) = match &scatter.over {
        ScatterOver::Plane { normal, .. } => (normal, "normal"),
        ScatterOver::Path { up, .. } | ScatterOver::Polygon { up, .. } => (up, "up direction"),
    };
    let up = up.try_normalize().ok_or_else(|| EditReason::value(format!("the {what} has no direction")))?;
    let stance = stance(scene, scatter.template, up);
    let spots = match &scatter.over {
        ScatterOver::Plane { point, extent, min_distance, turn, seed, .. } => {
            let area = Area { point: *point, normal: up, extent: *extent, corners: Vec::new() };
            area.spots(*min_distance, scatter.count, *turn, *seed)?
        }
        ScatterOver::Polygon { points, min_distance, turn, seed, .. } => {
            Area::of_polygon(points, up)?.spots(*min_distance, scatter.count, *turn, *seed)?
        }
        ScatterOver::Path { points, yaw, .. } => path_spots(points, *yaw, scatter.count, &stance)?,
    };
    let first = scene.instances.len();
    let place = |(i, &spot): (usize, &Spot)| checked(stance.at(spot), first + i);
    spots.iter().enumerate().map(place).collect()
}

fn stance(scene: &InstancedScene, template: u32, up: DVec3) -> Stance {
    let reference = scene.instances.iter().find(|i| i.template == template);
    let linear = reference.map_or(DMat3::IDENTITY, |i| i.world_from_template.linear());
    let [ground, _] = span(scene, template, linear, up);
    Stance { linear, centre: linear * template_centres(scene)[template as usize], up, ground }
}

/// Extent of a placed template along a direction, without outliers at either end.
pub(super) fn span(scene: &InstancedScene, template: u32, linear: DMat3, direction: DVec3) -> [f64; 2] {
    let range = scene.template_ranges[template as usize];
    let means = &scene.templates.means[range.first as usize..(range.first + range.count) as usize];
    let mut places: Vec<f64> = means.iter().map(|&mean| direction.dot(linear * widened(mean))).collect();
    places.sort_by(f64::total_cmp);
    let strays = (BELOW_GROUND * places.len() as f64) as usize;
    let at = |place: Option<&f64>| place.copied().unwrap_or(0.0);
    [at(places.get(strays)), at(places.iter().rev().nth(strays))]
}

/// The rectangle of the ground that an instance occupies, and its height above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Centre of the rectangle, world units.
    pub point: DVec3,
    /// Side lengths, world units, along the sides of [`ScatterOver::Plane`].
    pub extent: [f64; 2],
    /// Extent along the up direction, world units.
    pub height: f64,
}

/// The footprint of an instance for an up direction of any length but zero; outliers among its Gaussians are ignored.
///
/// # Panics
/// If there is no such instance.
pub fn footprint(scene: &InstancedScene, instance: usize, up: DVec3) -> Footprint {
    let Instance { template, world_from_template, .. } = &scene.instances[instance];
    let up = up.normalize_or(DVec3::Z);
    let span = |direction| span(scene, *template, world_from_template.linear(), direction);
    let sides = sides(up);
    let spans = sides.map(span);
    let [bottom, top] = span(up);
    let mut point = world_from_template.translation() + up * bottom;
    for (side, [low, high]) in sides.iter().zip(spans) {
        point += *side * (low + high) / 2.0;
    }
    Footprint { point, extent: spans.map(|[low, high]| high - low), height: top - bottom }
}

/// Coordinate along a unit vector of the lower end of an instance, world units, without outliers.
pub(super) fn instance_base(scene: &InstancedScene, instance: usize, axis: DVec3) -> f64 {
    let Instance { template, world_from_template, .. } = &scene.instances[instance];
    axis.dot(world_from_template.translation()) + span(scene, *template, world_from_template.linear(), axis)[0]
}

/// Directions of the sides of a rectangle with the given unit normal.
fn sides(normal: DVec3) -> [DVec3; 2] {
    let side = if normal.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    let along = (side - side.dot(normal) * normal).normalize();
    [along, normal.cross(along)]
}

impl Stance {
    /// The transform that rotates the object and places it on a spot with its centre above the spot.
    fn at(&self, (spot, yaw): Spot) -> Similarity {
        let turn = DMat3::from_axis_angle(self.up, yaw);
        let level = self.centre - self.up * self.up.dot(self.centre);
        Similarity::from_parts(turn * self.linear, 1.0, spot - turn * level - self.up * self.ground)
    }

    /// The rotation about `up` that points the template's x axis along a direction; 0 if the direction is vertical.
    fn yaw_along(&self, direction: DVec3) -> f64 {
        let level = |v: DVec3| v.try_normalize().map(|v| v - self.up * self.up.dot(v)).filter(|v| v.length() > LEVEL);
        let forward = level(self.linear.x_axis).or_else(|| level(self.linear.z_axis));
        match (forward, level(direction)) {
            (Some(from), Some(to)) => self.up.dot(from.cross(to)).atan2(from.dot(to)),
            _ => 0.0,
        }
    }
}

/// A part of the ground: a rectangle, or a polygon in it.
struct Area {
    /// Centre of the rectangle, world units.
    point: DVec3,
    /// Unit vector upwards.
    normal: DVec3,
    /// Side lengths of the rectangle, world units.
    extent: [f64; 2],
    /// Corners of the polygon along the sides of the rectangle, from its centre; empty for the whole rectangle.
    corners: Vec<[f64; 2]>,
}

impl Area {
    /// The polygon of three or more points, at the mean of their heights.
    fn of_polygon(points: &[DVec3], normal: DVec3) -> Result<Self, EditReason> {
        if points.len() < 3 || !points.iter().all(|p| p.is_finite()) {
            return Err(EditReason::value("a polygon has three or more points of finite numbers"));
        }
        let sides = sides(normal);
        let along = |k: usize| points.iter().map(move |p| sides[k].dot(*p));
        let ranges =
            [0, 1].map(|k| [along(k).fold(f64::INFINITY, f64::min), along(k).fold(f64::NEG_INFINITY, f64::max)]);
        let [x, y] = ranges.map(|[low, high]| (low + high) / 2.0);
        let height = points.iter().map(|p| normal.dot(*p)).sum::<f64>() / points.len() as f64;
        let corners = along(0).zip(along(1)).map(|(a, b)| [a - x, b - y]).collect();
        let extent = ranges.map(|[low, high]| high - low);
        Ok(Self { point: x * sides[0] + y * sides[1] + height * normal, normal, extent, corners })
    }

    /// True if a spot is inside, by the parity of the edges to its right.
    fn has(&self, [x, y]: [f64; 2]) -> bool {
        let next = self.corners.iter().cycle().skip(1);
        let crosses = |(a, b): (&[f64; 2], &[f64; 2])| {
            (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        };
        self.corners.is_empty() || self.corners.iter().zip(next).filter(|edge| crosses(*edge)).count() % 2 == 1
    }

    /// Random spots, with at least the least distance between any two, and random angles of at most `turn` radians.
    fn spots(&self, min_distance: f64, count: usize, turn: f64, seed: u64) -> Result<Vec<Spot>, EditReason> {
        if !turn.is_finite() {
            return Err(EditReason::value("the turn is not finite"));
        }
        if !self.extent.iter().chain([&min_distance]).all(|v| v.is_finite() && *v >= 0.0) {
            return Err(EditReason::value("extent and distance are lengths: want finite numbers from 0 on"));
        }
        let [along, across] = sides(self.normal);
        let mut rng = Rng::new(seed);
        let mut taken = Taken { min_distance, spots_of_cell: BTreeMap::new() };
        let mut spots = Vec::new();
        for _ in 0..count {
            let mut draw = || [0, 1].map(|axis| self.extent[axis] * (rng.uniform() - 0.5));
            let free = (0..TRIES).map(|_| draw()).find(|&spot| self.has(spot) && taken.is_free(spot));
            let Some(spot) = free else {
                let found = spots.len();
                return Err(EditReason::DoNotFit { found, count });
            };
            taken.insert(spot);
            let yaw = rng.range(0.0, TAU) * (turn / TAU);
            spots.push((self.point + along * spot[0] + across * spot[1], yaw));
        }
        Ok(spots)
    }
}

/// Spots in grid cells of the least distance, so that only nine cells can hold a spot that is too near.
struct Taken {
    min_distance: f64,
    spots_of_cell: BTreeMap<[i64; 2], Vec<[f64; 2]>>,
}

impl Taken {
    fn cell(&self, spot: [f64; 2]) -> [i64; 2] {
        spot.map(|v| (v / self.min_distance).floor() as i64)
    }

    fn is_free(&self, spot: [f64; 2]) -> bool {
        if self.min_distance == 0.0 {
            return true;
        }
        let [x, y] = self.cell(spot);
        let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [x.saturating_add(i), y.saturating_add(j)]));
        let distance = |other: &[f64; 2]| (spot[0] - other[0]).hypot(spot[1] - other[1]);
        near.filter_map(|cell| self.spots_of_cell.get(&cell))
            .flatten()
            .all(|other| distance(other) >= self.min_distance)
    }

    fn insert(&mut self, spot: [f64; 2]) {
        if self.min_distance > 0.0 {
            self.spots_of_cell.entry(self.cell(spot)).or_default().push(spot);
        }
    }
}

/// Evenly spaced spots along a path; a single one is at its start.
fn path_spots(points: &[DVec3], yaw: f64, count: usize, stance: &Stance) -> Result<Vec<Spot>, EditReason> {
    if points.len() < 2 || !points.iter().all(|p| p.is_finite()) || !yaw.is_finite() {
        return Err(EditReason::value("a path has two or more points of finite numbers"));
    }
    let pieces: Vec<(DVec3, DVec3)> = points.windows(2).map(|w| (w[0], w[1])).filter(|(a, b)| a != b).collect();
    let length: f64 = pieces.iter().map(|(a, b)| a.distance(*b)).sum();
    if pieces.is_empty() || !length.is_finite() {
        return Err(EditReason::value(format!("a path of length {length} has no direction")));
    }
    let spacing = length / (count.max(2) - 1) as f64;
    let (mut piece, mut before) = (0, 0.0);
    let mut spots = Vec::new();
    for i in 0..count {
        let at = spacing * i as f64;
        let (mut begin, mut end) = pieces[piece];
        while at > before + begin.distance(end) && piece + 1 < pieces.len() {
            before += begin.distance(end);
            piece += 1;
            (begin, end) = pieces[piece];
        }
        let part = ((at - before) / begin.distance(end)).clamp(0.0, 1.0);
        spots.push((begin.lerp(end, part), stance.yaw_along(end - begin) + yaw));
    }
    Ok(spots)
}
