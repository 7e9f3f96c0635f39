//! Finds objects from masks whose ids differ from view to view, as segmenters of single images produce them.
//!
//! This is MaskClustering (Yan et al., CVPR 2024) with Gaussians in place of a depth sensor's points. A Gaussian lies
//! in the mask that receives more than half of its contribution to a view (`observe`), which accounts for occlusion.
//! Masks whose points the views show in one mask belong to one object (`relations`, `cluster`, `objects`, `reunite`).
//! Ids that already agree are kept (`agreement`).

mod agreement;
mod bits;
mod cluster;
mod objects;
mod observe;
mod relations;
pub mod report;
mod reunite;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use agreement::{AGREEMENT, Agreement};
use instgs_vk::scene::Gaussians;
use objects::Object;
use observe::{MaskKey, Observations, observe};
use relations::Relations;
use report::{ConsensusReport, ObjectReport};

use super::error::SegmentError;
use super::id_table::IdTable;
use super::sweep::ViewContributions;

/// Options of [`consensus()`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConsensusOptions {
    /// At most this many Gaussians are used, drawn at random. With 100,000 an object that is a thousandth of the scene
    /// still has a hundred.
    pub max_points: usize,
    /// Seed of the random draw.
    pub seed: u64,
    /// Masks with fewer points are not clustered. MaskClustering uses 25, for rooms; small pictures have smaller masks.
    pub min_points: usize,
    /// A mask shows several objects if more than this part of the views that see it see it in pieces (MaskClustering:
    /// 0.3); 1 turns the filter off.
    pub undersegmented_part: f64,
}

impl Default for ConsensusOptions {
    /// The values that the fields' comments explain.
    fn default() -> Self {
        Self { max_points: 100_000, seed: 0, min_points: 5, undersegmented_part: 0.3 }
    }
}

/// Result of [`consensus()`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Consensus {
    /// Object of every mask.
    pub table: IdTable,
    /// Statistics of the result, and its objects.
    pub report: ConsensusReport,
}

/// Finds the objects in the masks of a plain cloud's views. `categories` names ids, as in `categories.json`; an object
/// gets the name that most of its masks have. `progress` receives the number of views done.
///
/// # Errors
/// Those of [`ViewContributions::for_each`]; no mask with an object; more than 65535 objects; errors of `progress`.
pub fn consensus<E: From<SegmentError>>(
    views: &mut ViewContributions<'_, E>,
    cloud: &Gaussians,
    categories: &BTreeMap<u32, String>,
    options: &ConsensusOptions,
    progress: impl FnMut(usize) -> Result<(), E>,
) -> Result<Consensus, E> {
    let started = Instant::now();
    let observations = observe(views, cloud, options, progress)?;
    let positions: Vec<[f32; 3]> = observations.gaussians.iter().map(|&i| cloud.means[i as usize]).collect();
    let mut out = of_observations(&observations, &positions, categories, options)?;
    out.report.contribution_bytes = views.kept_bytes();
    out.report.point_bytes = observations.bytes();
    out.report.seconds = started.elapsed().as_secs_f64();
    Ok(out)
}

/// The part of [`consensus()`] that needs no device.
fn of_observations(
    observations: &Observations,
    positions: &[[f32; 3]],
    categories: &BTreeMap<u32, String>,
    options: &ConsensusOptions,
) -> Result<Consensus, SegmentError> {
    let agreement = Agreement::measure(observations, options);
    let mut report = ConsensusReport {
        ids_agree: agreement.part() >= AGREEMENT,
        agreement: agreement.part(),
        points: observations.gaussians.len(),
        masks: observations.masks.len(),
        ..ConsensusReport::default()
    };
    let named = |mut object: ObjectReport, masks: &[MaskKey]| {
        let mut views: Vec<u32> = masks.iter().map(|key| key.view).collect();
        views.dedup();
        (object.views, object.masks) = (views.len(), masks.len());
        object.category = category(masks, categories);
        object
    };
    if report.ids_agree {
        let mut masks_of_id: BTreeMap<u16, Vec<MaskKey>> = BTreeMap::new();
        observations.masks.iter().for_each(|&key| masks_of_id.entry(key.id).or_default().push(key));
        let object = |(&id, masks): (&u16, &Vec<MaskKey>)| {
            named(ObjectReport { id: u32::from(id), ..ObjectReport::default() }, masks)
        };
        report.objects = masks_of_id.iter().map(object).collect();
        return Ok(Consensus { table: IdTable::Same, report });
    }
    let relations = Relations::new(observations, options);
    let nodes = cluster::cluster(observations, &relations, positions);
    let objects = objects::objects(nodes, observations, &relations, positions);
    if objects.len() > usize::from(u16::MAX) {
        return Err(SegmentError::TooManyObjects { count: objects.len() });
    }
    report.undersegmented = relations.is_undersegmented.iter().filter(|&&is| is).count();
    report.unassigned = report.masks - report.undersegmented - objects.iter().map(|o| o.masks.len()).sum::<usize>();
    let keys = |object: &Object| object.masks.iter().map(|&mask| observations.masks[mask as usize]).collect::<Vec<_>>();
    let object = |(id, object): (u32, &Object)| named(ObjectReport { id, ..ObjectReport::default() }, &keys(object));
    report.objects = (1..).zip(&objects).map(object).collect();
    Ok(Consensus { table: table(&objects, observations), report })
}

/// Table from masks to objects, which are numbered from 1 in order.
fn table(objects: &[Object], observations: &Observations) -> IdTable {
    let mut views = vec![BTreeMap::new(); observations.view_count];
    for (id, object) in (1..).zip(objects) {
        for &mask in &object.masks {
            let key = observations.masks[mask as usize];
            views[key.view as usize].insert(key.id, id);
        }
    }
    IdTable::PerView(views)
}

/// The most frequent name among masks whose id has one; the first in the alphabet in a tie.
fn category(masks: &[MaskKey], categories: &BTreeMap<u32, String>) -> Option<String> {
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    for name in masks.iter().filter_map(|key| categories.get(&u32::from(key.id))) {
        *counts.entry(name).or_default() += 1;
    }
    let most = counts.values().max()?;
    counts.iter().find(|(_, count)| *count == most).map(|(name, _)| (*name).clone())
}
