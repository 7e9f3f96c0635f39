//! Merges the objects of posed groups into templates, instances with offsets, and a background.

use super::config::RunConfig;
use crate::template::{GroupReport, POOR_MATCH, build};
use instgs_vk::scene::{InstancedScene, PosedGroup};

use super::error::PipelineError;
use super::label_gaussians::CloudLabels;

/// The scene that the joint phase starts from.
pub struct MergedScene {
    /// Templates, instances and background; without instances if no group has an object.
    pub scene: InstancedScene,
    /// Result of the merge for each group.
    pub groups: Vec<GroupReport>,
    /// Number of Gaussians of the cloud that were left out because they hardly contribute to any view.
    pub hardly_seen: u64,
}

/// Merges the objects of a labelled plain cloud. A group without Gaussians stays in the background; so does a group
/// whose members hardly match, unless the configuration gives the groups.
///
/// # Errors
/// Groups that do not fit each other, or more Gaussians than can be counted.
pub fn build_templates(
    cloud: &InstancedScene,
    segmented: &CloudLabels,
    groups: &[PosedGroup],
    config: &RunConfig,
) -> Result<MergedScene, PipelineError> {
    let is_kept = segmented.well_seen(&cloud.background.means, groups, config.pipeline.joint.prune_weight);
    let kept = cloud.background.filtered(|i| is_kept[i]);
    let labels: Vec<u32> =
        segmented.labels.iter().zip(&is_kept).filter(|(_, kept)| **kept).map(|(&id, _)| id).collect();
    let mut built = build(&kept, &labels, groups, &config.template_options())?;
    (built.scene.pixel_filter, built.scene.near_plane) = (config.train.pixel_filter(), config.train.near_plane());
    built.scene.source = "instgs-vk: merged, not yet trained".into();
    let hardly_seen = (cloud.background.len() - kept.len()) as u64;
    Ok(MergedScene { scene: built.scene, groups: built.report, hardly_seen })
}

/// Warnings about the groups, one line each.
pub fn warnings(groups: &[GroupReport]) -> Vec<String> {
    let mut out: Vec<String> = nothing_shared(groups).into_iter().collect();
    for group in groups {
        let name = group.name.clone().unwrap_or_else(|| format!("group {}", group.template_id));
        if let Some(why) = group.left_out() {
            out.push(format!("{name}: {why}"));
            continue;
        }
        if group.is_poor_match() {
            let distance = group.match_distance;
            out.push(format!(
                "{name}: its objects are not alike, or posed wrongly (match distance {distance:.3}, good below \
                 {POOR_MATCH:.2}): expect ghosts"
            ));
        }
        if group.is_single() {
            out.push(format!("{name}: only one of its objects has Gaussians; sharing gains nothing"));
        }
        for instance in group.instances.iter().filter(|i| !i.is_usable) {
            let (id, own) = (instance.id, instance.gaussians);
            out.push(format!("{name}: object {id} has only {own} Gaussians; it is shown as the template"));
        }
    }
    out
}

/// A warning if there is no template.
fn nothing_shared(groups: &[GroupReport]) -> Option<String> {
    let why = if groups.is_empty() {
        "no two objects are alike"
    } else if groups.iter().any(|group| group.template.is_some()) {
        return None;
    } else if groups.iter().any(|group| group.instances.iter().any(|i| i.is_usable)) {
        "no group's objects are alike"
    } else {
        "none of the groups has an object with Gaussians; check that masks and groups have the same ids"
    };
    Some(format!("nothing is shared, and the whole scene is background: {why}"))
}
