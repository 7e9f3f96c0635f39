//! Turns clusters of masks into objects: splits clusters that are apart in space, removes points that few masks have,
//! joins objects that overlap, and assigns the masks that clustering could not use.

use std::collections::BTreeMap;

use super::cluster::Node;
use super::observe::Observations;
use super::relations::Relations;
use super::reunite::{with_all_sides, without_overlap};
use crate::segment::components::{Partition, components, usual_reach};

/// Least number of masks of an object (MaskClustering): a single mask is not confirmed by another.
const MIN_MASKS: usize = 2;
/// A mask covers a component if this part of its points lies there (MaskClustering drops smaller parts).
const COVERED_PART: f64 = 0.2;
/// Components stay together if this part of the masks of the smaller one cover both.
const LINKED_PART: f64 = 0.3;
/// Points that at most this part of the masks at their place have do not belong to the object (MaskClustering).
const DETECTION_RATE: f64 = 0.5;
/// A mask belongs to an object that has this part of all the mask's points ...
const OWN_PART: f64 = 0.5;
/// ... and this part of those that any object has; the same limit as for containment.
const PURE_PART: f64 = 0.8;
/// Least points of a mask that clustering could not use: fewer may coincide with an object by chance.
const MIN_ADOPTED_POINTS: usize = 3;

/// Masks and points of one object.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Object {
    /// Indices of its masks, ascending.
    pub(super) masks: Vec<u32>,
    /// Indices of its points, ascending.
    pub(super) points: Vec<u32>,
}

/// The objects of clusters, in order of their smallest mask. `positions` are those of the points.
pub(super) fn objects(
    nodes: Vec<Node>,
    observations: &Observations,
    relations: &Relations,
    positions: &[[f32; 3]],
) -> Vec<Object> {
    let clusters = nodes.into_iter().map(|node| Object { masks: node.masks, points: node.points });
    let large = clusters.filter(|object| object.masks.len() >= MIN_MASKS);
    let parts = large.flat_map(|object| taken_apart(object, observations, positions)).collect();
    let whole = with_all_sides(parts, observations, relations).into_iter();
    let cleaned: Vec<Object> = whole.filter_map(|object| cleaned(object, observations, relations)).collect();
    let mut out = without_overlap(cleaned, observations.gaussians.len());
    adopt(&mut out, observations, relations);
    out.sort_by_key(|object| object.masks.first().copied());
    out
}

/// The parts of an object that are apart in space and share few masks; the object unchanged unless at least two parts
/// have enough masks.
fn taken_apart(object: Object, observations: &Observations, positions: &[[f32; 3]]) -> Vec<Object> {
    let own: Vec<[f32; 3]> = object.points.iter().map(|&point| positions[point as usize]).collect();
    let Some(reach) = usual_reach(&own) else { return vec![object] };
    let loose = components(&own, reach);
    if loose.len() < 2 {
        return vec![object];
    }
    let mut component_of_point: BTreeMap<u32, usize> = BTreeMap::new();
    for (c, members) in loose.iter().enumerate() {
        component_of_point.extend(members.iter().map(|&member| (object.points[member as usize], c)));
    }
    let covered_by: Vec<Vec<usize>> =
        object.masks.iter().map(|&mask| covered(mask, observations, &component_of_point)).collect();
    let part_of_component = linked(&covered_by, loose.len());
    let mut parts: BTreeMap<usize, Object> = BTreeMap::new();
    for (&mask, covered) in object.masks.iter().zip(&covered_by) {
        // A mask that covers no component is no evidence.
        let Some(&largest) = covered.first() else { continue };
        parts.entry(part_of_component[largest]).or_default().masks.push(mask);
    }
    for (&point, &component) in &component_of_point {
        if let Some(part) = parts.get_mut(&part_of_component[component]) {
            part.points.push(point);
        }
    }
    parts.retain(|_, part| part.masks.len() >= MIN_MASKS);
    if parts.len() < 2 { vec![object] } else { parts.into_values().collect() }
}

/// Components that a mask covers; the one with most of its points first.
fn covered(mask: u32, observations: &Observations, component_of_point: &BTreeMap<u32, usize>) -> Vec<usize> {
    let points = &observations.points_of_mask[mask as usize];
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for component in points.iter().filter_map(|point| component_of_point.get(point)) {
        *counts.entry(*component).or_default() += 1;
    }
    let mut out: Vec<(usize, usize)> =
        counts.into_iter().filter(|&(_, count)| count as f64 >= COVERED_PART * points.len() as f64).collect();
    out.sort_by_key(|&(component, count)| (std::cmp::Reverse(count), component));
    out.into_iter().map(|(component, _)| component).collect()
}

/// For each component, the representative of the part that it belongs to.
fn linked(covered_by: &[Vec<usize>], count: usize) -> Vec<usize> {
    let mut masks_of = vec![0usize; count];
    let mut common: BTreeMap<[usize; 2], usize> = BTreeMap::new();
    for covered in covered_by {
        for (i, &a) in covered.iter().enumerate() {
            masks_of[a] += 1;
            covered[i + 1..].iter().for_each(|&b| *common.entry([a.min(b), a.max(b)]).or_default() += 1);
        }
    }
    let mut partition = Partition::new(count);
    for ([a, b], masks) in common {
        if masks as f64 >= LINKED_PART * masks_of[a].min(masks_of[b]) as f64 {
            partition.join(a, b);
        }
    }
    (0..count).map(|component| partition.root(component)).collect()
}

/// The object without points that few of the masks have, and without masks that keep few points; `None` if too little
/// is left.
fn cleaned(mut object: Object, observations: &Observations, relations: &Relations) -> Option<Object> {
    let is_detected = |point: &u32| {
        // Masks of two objects and masks that are too small are no evidence.
        let masks = observations.masks_of_point(*point).filter(|&mask| relations.is_node[mask as usize]);
        let (all, own) =
            masks.fold((0, 0), |(all, own), mask| (all + 1, own + u32::from(contains(&object.masks, mask))));
        f64::from(own) > DETECTION_RATE * f64::from(all)
    };
    let points: Vec<u32> = object.points.iter().copied().filter(is_detected).collect();
    object.points = points;
    let is_own = |mask: &u32| {
        let of_mask = &observations.points_of_mask[*mask as usize];
        let own = of_mask.iter().filter(|&&point| contains(&object.points, point)).count();
        own as f64 >= OWN_PART * of_mask.len() as f64
    };
    let masks: Vec<u32> = object.masks.iter().copied().filter(is_own).collect();
    object.masks = masks;
    (object.masks.len() >= MIN_MASKS && !object.points.is_empty()).then_some(object)
}

fn contains(ascending: &[u32], value: u32) -> bool {
    ascending.binary_search(&value).is_ok()
}

/// Gives masks without an object to the object with most of their points, unless they show two objects.
fn adopt(objects: &mut [Object], observations: &Observations, relations: &Relations) {
    let mut owner = vec![None; observations.gaussians.len()];
    for (i, object) in objects.iter().enumerate() {
        object.points.iter().for_each(|&point| owner[point as usize] = owner[point as usize].or(Some(i)));
    }
    let mut has_object = relations.is_undersegmented.clone();
    objects.iter().flat_map(|object| &object.masks).for_each(|&mask| has_object[mask as usize] = true);
    for (mask, points) in observations.points_of_mask.iter().enumerate() {
        if has_object[mask] || points.len() < MIN_ADOPTED_POINTS {
            continue;
        }
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        for owner in points.iter().filter_map(|&point| owner[point as usize]) {
            *counts.entry(owner).or_default() += 1;
        }
        let owned: usize = counts.values().sum();
        let largest = counts.iter().max_by_key(|&(object, count)| (*count, std::cmp::Reverse(*object)));
        let Some((&object, &count)) = largest else { continue };
        if count as f64 >= OWN_PART * points.len() as f64 && count as f64 > PURE_PART * owned as f64 {
            objects[object].masks.push(mask as u32);
        }
    }
    objects.iter_mut().for_each(|object| object.masks.sort_unstable());
}
