//! Joins objects that are one: those that share their points, and those that are sides of one object.
//!
//! Views from opposite sides share too few points of an object for clustering to compare their masks. But where views
//! of one side see points of the other at all, they see them in the object's own masks.

use std::collections::BTreeMap;

use super::cluster::united;
use super::objects::Object;
use super::observe::Observations;
use super::relations::Relations;
use crate::segment::components::Partition;

/// Objects are one if the smaller one shares more than this part of its points (MaskClustering).
const OVERLAP: f64 = 0.8;
/// Two objects are sides of one if, where views with a mask of one see points of the other, at least this part of these
/// lie in that mask, in both directions. Neighbouring objects have masks of their own there.
const COMMON_PART: f64 = 0.5;
/// Least sightings in each direction: a few stray points at an object's border are fewer.
const MIN_SIGHTINGS: u32 = 10;

/// Joins objects that are sides of one. It runs before points with few masks are removed: points seen from both sides
/// are such points.
pub(super) fn with_all_sides(parts: Vec<Object>, observations: &Observations, relations: &Relations) -> Vec<Object> {
    let mut partition = Partition::new(parts.len());
    let sightings = Sightings::new(&parts, observations, relations);
    for &[a, b] in sightings.inside.keys().filter(|[a, b]| a < b) {
        if sightings.is_inside(a, b) && sightings.is_inside(b, a) {
            partition.join(a as usize, b as usize);
        }
    }
    joined(&parts, partition)
}

/// Joins objects that share most of their points.
pub(super) fn without_overlap(objects: Vec<Object>, point_count: usize) -> Vec<Object> {
    let mut partition = Partition::new(objects.len());
    for ([a, b], count) in shared_points(&objects, point_count) {
        let least = objects[a as usize].points.len().min(objects[b as usize].points.len());
        if f64::from(count) > OVERLAP * least as f64 {
            partition.join(a as usize, b as usize);
        }
    }
    joined(&objects, partition)
}

fn joined(objects: &[Object], partition: Partition) -> Vec<Object> {
    let of_part = |part: &Vec<u32>| {
        part.iter().map(|&i| &objects[i as usize]).fold(Object::default(), |all, object| Object {
            masks: united(&all.masks, &object.masks),
            points: united(&all.points, &object.points),
        })
    };
    partition.parts().iter().map(of_part).collect()
}

/// Number of points that each pair of objects shares.
fn shared_points(objects: &[Object], point_count: usize) -> BTreeMap<[u32; 2], u32> {
    let mut owners: Vec<Vec<u32>> = vec![Vec::new(); point_count];
    for (i, object) in (0..).zip(objects) {
        object.points.iter().for_each(|&point| owners[point as usize].push(i));
    }
    let mut out = BTreeMap::new();
    for owners in &owners {
        for (i, &a) in owners.iter().enumerate() {
            owners[i + 1..].iter().for_each(|&b| *out.entry([a, b]).or_default() += 1);
        }
    }
    out
}

/// Where the points of objects are seen: a sighting is a point in a mask.
struct Sightings {
    /// By [object, other]: sightings of the object's points in masks of the other.
    inside: BTreeMap<[u32; 2], u32>,
    /// By object, by view: sightings of the object's points.
    of_view: Vec<Vec<u32>>,
    /// By object: views in which it has a mask, ascending.
    views: Vec<Vec<u32>>,
}

impl Sightings {
    fn new(objects: &[Object], observations: &Observations, relations: &Relations) -> Self {
        let view_of = |mask: u32| observations.masks[mask as usize].view;
        let mut owner = vec![None; observations.masks.len()];
        for (i, object) in (0..).zip(objects) {
            object.masks.iter().for_each(|&mask| owner[mask as usize] = Some(i));
        }
        let mut inside: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut of_view = vec![vec![0; observations.view_count]; objects.len()];
        for (i, object) in (0..).zip(objects) {
            let masks = object.points.iter().flat_map(|&point| observations.masks_of_point(point));
            for mask in masks.filter(|&mask| relations.is_node[mask as usize]) {
                of_view[i as usize][view_of(mask) as usize] += 1;
                if let Some(other) = owner[mask as usize] {
                    *inside.entry([i, other]).or_default() += 1;
                }
            }
        }
        let views = |object: &Object| {
            let mut views: Vec<u32> = object.masks.iter().map(|&mask| view_of(mask)).collect();
            views.dedup();
            views
        };
        Self { inside, of_view, views: objects.iter().map(views).collect() }
    }

    /// Whether enough of what the other's views see of the object lies in the other's masks.
    fn is_inside(&self, object: u32, other: u32) -> bool {
        let inside = self.inside.get(&[object, other]).copied().unwrap_or(0);
        let of_view = &self.of_view[object as usize];
        let all: u32 = self.views[other as usize].iter().map(|&view| of_view[view as usize]).sum();
        inside >= MIN_SIGHTINGS && f64::from(inside) >= COMMON_PART * f64::from(all)
    }
}
