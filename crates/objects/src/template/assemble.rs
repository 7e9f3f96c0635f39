//! Builds an instanced scene from a labelled cloud and posed groups.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};

use super::error::TemplateError;
use super::instance_cloud::{InstanceCloud, Owners};
use super::offsets::{Common, push_offsets};
use super::options::{Keep, TemplateOptions, TemplateSource, Unmatched};
use super::report::{GroupReport, InstanceReport, counts, group_match_distance, match_distances};
use super::sample::draw;
use super::settle::settle;
use super::template_cloud::TemplateCloud;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, PosedGroup, PosedInstance, SourceRange};

/// Result of [`build`].
#[derive(Clone, Debug, PartialEq)]
pub struct Built {
    /// A valid scene, ready for training; the caller sets `pixel_filter`, `near_plane` and `source`.
    pub scene: InstancedScene,
    /// One report per group, in the order of the groups.
    pub report: Vec<GroupReport>,
}

/// Turns repeated objects of a plain cloud into templates with instances.
///
/// `cloud` is in the world frame. `instance_of_gaussian` has one label per Gaussian: the id of an instance in `groups`.
/// Gaussians with label 0 or an id of no group form the background, which is copied bit by bit. `groups` must have
/// distinct template ids, distinct instance ids, and poses that are similarities.
///
/// Gaussians of an instance that are not finite are dropped and counted in the report. A group without a usable
/// instance, or with a worse match than the options allow, is left out, and its Gaussians stay in the background. All
/// instances of other groups become instances of the scene in the groups' order, each with its own offset records,
/// unless the options ask for no kind of offset. `scene.groups` uses the scene's template indices.
///
/// Templates are about as large as their instances, since learning rates in their frames are those of the world: where the geometric
/// mean of a group's scales is above 2 or below 1/2, the frame of its template is scaled by it.
///
/// The result is deterministic. Time grows as N log N with the Gaussians of a group.
///
/// # Errors
/// Arrays of wrong length; a group without instances; ids that repeat; an instance id of 0; a pose that is no
/// similarity; an option out of range; more Gaussians or offset records than 32-bit indices count.
pub fn build(
    cloud: &Gaussians,
    instance_of_gaussian: &[u32],
    groups: &[PosedGroup],
    options: &TemplateOptions,
) -> Result<Built, TemplateError> {
    options.validate()?;
    check_cloud(cloud, instance_of_gaussian)?;
    check_groups(groups)?;
    let groups: Vec<PosedGroup> = groups.iter().map(in_units_of_the_world).collect();
    let owners = Owners::new(instance_of_gaussian, &groups)?;
    let templates = Gaussians::with_capacity(cloud.sh_degree, 0);
    let mut scene = InstancedScene { templates, ..InstancedScene::default() };
    let mut report = Vec::with_capacity(groups.len());
    for (g, group) in groups.iter().enumerate() {
        report.push(add_group(cloud, &owners.instances(cloud, g, group), group, options, &mut scene)?);
    }
    let stays = |group: Option<u32>| group.is_none_or(|g| report[g as usize].template.is_none());
    scene.background = cloud.filtered(|i| stays(owners.group_of_gaussian[i]));
    Ok(Built { scene, report })
}

/// Templates may be this much larger or smaller than their instances: learning rates need not be closer.
const MOST_SCALE: f64 = 2.0;

/// The group with poses whose scales are 1 in the geometric mean; as it is if they are about that.
fn in_units_of_the_world(group: &PosedGroup) -> PosedGroup {
    let mut out = group.clone();
    let log_scale = |instance: &PosedInstance| instance.world_from_template.scale().ln();
    let mean = group.instances.iter().map(log_scale).sum::<f64>() / group.instances.len() as f64;
    if mean.abs() > MOST_SCALE.ln() {
        let old_from_new = Similarity::from_parts(DMat3::IDENTITY, (-mean).exp(), DVec3::ZERO);
        for instance in &mut out.instances {
            instance.world_from_template = instance.world_from_template.after(&old_from_new);
        }
    }
    out
}

/// Adds a group's template, instances and offsets to the scene, unless the group is left out. Returns its report.
fn add_group(
    cloud: &Gaussians,
    instances: &[InstanceCloud],
    group: &PosedGroup,
    options: &TemplateOptions,
    scene: &mut InstancedScene,
) -> Result<GroupReport, TemplateError> {
    let mut report = report_without_template(instances, group);
    if !instances.iter().any(InstanceCloud::is_usable) {
        return Ok(report);
    }
    let distances = match_distances(instances);
    report.match_distance = group_match_distance(&distances);
    report.instances.iter_mut().zip(&distances).for_each(|(instance, distance)| instance.match_distance = *distance);
    if options.worst_match.is_some_and(|worst| report.match_distance > worst) {
        return Ok(report);
    }
    let template = draw_template(cloud, instances, options, group.template_id);
    let count = template.gaussians.len();
    let records = scene.offsets.len() as u64 + count as u64 * instances.len() as u64;
    if records >= u64::from(u32::MAX) {
        return Err(TemplateError::TooMany { what: "offset records", count: records });
    }
    report.template = Some(scene.template_ranges.len() as u32);
    report.template_gaussians = count;
    let range = SourceRange { first: scene.templates.len() as u32, count: count as u32 };
    for (k, own) in instances.iter().enumerate() {
        scene.instances.push(Instance {
            template: scene.template_ranges.len() as u32,
            world_from_template: group.instances[k].world_from_template,
            first_offset: options.kinds.any().then_some(scene.offsets.len() as u32),
        });
        let common = match options.kinds.any() {
            true => push_offsets(&template, cloud, own, options, &mut scene.offsets),
            false => Common::default(),
        };
        report.instances[k].lacking = common.lacking;
        if options.unmatched == Unmatched::Own {
            report.instances[k].own = push_unmatched(cloud, own, &common, scene);
        }
    }
    let instance_ids = group.instances.iter().map(|i| i.id).collect();
    let template_id = scene.template_ranges.len() as u32;
    scene.groups.push(Group { template_id, name: group.name.clone(), instance_ids });
    scene.template_ranges.push(range);
    scene.templates.append(&template.gaussians);
    Ok(report)
}

/// Makes the Gaussians of the last instance that have no match its own; returns their number. One that is too small to be matched
/// is shown as the template, and has none.
fn push_unmatched(cloud: &Gaussians, own: &InstanceCloud, common: &Common, scene: &mut InstancedScene) -> usize {
    let first = scene.own.len() as u32;
    scene.own.sh_degree = cloud.sh_degree;
    let is_own = |(_, matched): &(&u32, &bool)| own.is_usable() && !**matched;
    for (&i, _) in own.indices.iter().zip(&common.matched).filter(is_own) {
        own.template_from_world.push(cloud, i as usize, &mut scene.own);
    }
    let count = scene.own.len() as u32 - first;
    scene.own_ranges.push(SourceRange { first, count });
    count as usize
}

fn report_without_template(instances: &[InstanceCloud], group: &PosedGroup) -> GroupReport {
    let instance = |(own, posed): (&InstanceCloud, &PosedInstance)| InstanceReport {
        id: posed.id,
        gaussians: own.len(),
        non_finite: own.non_finite,
        is_usable: own.is_usable(),
        lacking: 0,
        own: 0,
        match_distance: None,
    };
    GroupReport {
        template_id: group.template_id,
        name: group.name.clone(),
        template: None,
        instances: instances.iter().zip(&group.instances).map(instance).collect(),
        gaussians_per_instance: counts(instances),
        template_gaussians: 0,
        match_distance: 0.0,
    }
}

/// Draws the template of a group with at least one usable instance.
fn draw_template(
    cloud: &Gaussians,
    instances: &[InstanceCloud],
    options: &TemplateOptions,
    template_id: u32,
) -> TemplateCloud {
    let sources = sources(instances, options.source);
    let means: Vec<[f32; 3]> = sources.iter().flat_map(|own| own.means.iter().copied()).collect();
    let origins: Vec<_> =
        sources.iter().flat_map(|own| own.indices.iter().map(|&i| (&own.template_from_world, i))).collect();
    // The mean count of the instances that were merged; a cast of a huge product saturates.
    let count = (means.len() as f64 / sources.len() as f64 * options.count_factor).round() as usize;
    let rng = Rng::new(options.seed).fork(u64::from(template_id));
    let drawn = draw(&means, count.max(1), options.sampling, rng);
    let drawn: Vec<_> = drawn.into_iter().map(|i| origins[i as usize]).collect();
    let mut template = TemplateCloud::new(cloud, &drawn);
    if options.source == TemplateSource::Merge {
        template = settle(template, cloud, instances, options);
    }
    if options.keep == Keep::PositionAndColour {
        template.renew();
    }
    template
}

/// The usable instances that the template is drawn from; at least one if any is usable.
fn sources(instances: &[InstanceCloud], source: TemplateSource) -> Vec<&InstanceCloud> {
    let usable = instances.iter().filter(|own| own.is_usable());
    match source {
        TemplateSource::Merge => usable.collect(),
        TemplateSource::Single => usable.take(1).collect(),
        // `max_by_key` returns the last of equal maxima: in reverse order, the first instance.
        TemplateSource::Max => usable.rev().max_by_key(|own| own.len()).into_iter().collect(),
    }
}

fn check_cloud(cloud: &Gaussians, instance_of_gaussian: &[u32]) -> Result<(), TemplateError> {
    let n = cloud.len();
    if let Some((array, len, want)) = cloud.wrong_length() {
        return Err(TemplateError::Cloud { array, len, want });
    }
    if instance_of_gaussian.len() != n {
        return Err(TemplateError::LabelCount { labels: instance_of_gaussian.len(), gaussians: n });
    }
    if n as u64 >= u64::from(u32::MAX) {
        return Err(TemplateError::TooMany { what: "Gaussians", count: n as u64 });
    }
    Ok(())
}

fn check_groups(groups: &[PosedGroup]) -> Result<(), TemplateError> {
    let mut template_ids = BTreeSet::new();
    for group in groups {
        let template_id = group.template_id;
        if group.instances.is_empty() {
            return Err(TemplateError::EmptyGroup { template_id });
        }
        if !template_ids.insert(template_id) {
            return Err(TemplateError::RepeatedTemplate { template_id });
        }
        for instance in &group.instances {
            let pose = Similarity::from_rows(instance.world_from_template.rows());
            pose.map_err(|reason| TemplateError::Pose { template_id, id: instance.id, reason })?;
        }
    }
    Ok(())
}
