//! Turns poses into a group and the reports of its objects.

use glam::DMat3;

use super::decide::{Certainty, Decision};
use super::members::Aligned;
use super::pose::Pose;
use super::report::{InstanceRegistration, Verdict};
use super::sample::ObjectSurface;
use super::spread::PoseUncertainty;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{PosedGroup, PosedInstance};

/// An object whose cost exceeds the group's median by this factor fits worse than differences of make explain.
const POOR_FIT: f64 = 1.6;

/// Standard deviation of the angle, degrees, above which a pose is ambiguous.
const UNSURE_DEGREES: f64 = 0.6;
/// The same for the position, part of the object's size.
const UNSURE_PART: f64 = 0.006;
/// Up to this standard deviation, degrees, the doubt is slight: the joint phase corrects such poses.
const SLIGHT_DEGREES: f64 = 1.0;
/// The same for the position, part of the object's size.
const SLIGHT_PART: f64 = 0.01;

/// Id of a template, and its name.
type Label<'a> = (u32, Option<&'a String>);

/// The relative pose of target and reference as a map of the world that moves the reference onto the target.
pub(super) fn target_from_reference(reference: &ObjectSurface, target: &ObjectSurface, pose: &Pose) -> Similarity {
    let translation = target.centroid + pose.apply(-reference.centroid);
    Similarity::from_parts(pose.rotation, pose.scale, translation)
}

/// The group as in `groups.json`: the reference first, with the template's origin at the centre of its bounding box.
pub(super) fn posed_group(
    (template_id, name): Label<'_>,
    reference: &ObjectSurface,
    members: &[Aligned<'_>],
) -> PosedGroup {
    let at = |world_from_template, id| PosedInstance { id, world_from_template };
    let own = Similarity::from_parts(DMat3::IDENTITY, 1.0, reference.box_middle);
    let mut instances = vec![at(own, reference.id)];
    instances.extend(members.iter().map(|m| at(world_from_template(reference, m), m.surface.id)));
    let inliers: f64 = members.iter().map(|m| m.decision.hypothesis.fit.inliers).sum();
    let score = Some((inliers / members.len().max(1) as f64).clamp(0.0, 1.0));
    PosedGroup { template_id, name: name.cloned(), score, instances }
}

/// Reports of the reference and the members (at least one); `uncertainties` are those of the members.
pub(super) fn reports(
    (template_id, name): Label<'_>,
    reference: &ObjectSurface,
    members: &[Aligned<'_>],
    uncertainties: &[Option<PoseUncertainty>],
) -> Vec<InstanceRegistration> {
    let reference = InstanceRegistration {
        group: Some(template_id),
        inliers: 1.0,
        accepted: true,
        verdict: Verdict::Reference,
        ..rejected(reference.id, name, reference.gaussians, "most of its surface was seen".into())
    };
    let mut costs: Vec<f64> = members.iter().map(|m| m.decision.hypothesis.fit.cost_there).collect();
    costs.sort_by(f64::total_cmp);
    // The lower of the two in the middle: of two members the worse one may be wrong.
    let median = costs.get(costs.len().saturating_sub(1) / 2).copied().unwrap_or(0.0);
    let report = |(member, &uncertainty): (&Aligned<'_>, &Option<PoseUncertainty>)| {
        let Said { verdict, slight, note } = said(&member.decision, median, uncertainty);
        let fit = member.decision.hypothesis.fit;
        InstanceRegistration {
            instance: member.surface.id,
            gaussians: member.surface.gaussians,
            inliers: fit.inliers,
            rmse: fit.rmse,
            relative_rmse: fit.rmse / member.surface.size,
            photometric: member.decision.agreement.map(|a| a.photometric),
            uncertainty,
            verdict,
            slight,
            note,
            ..reference.clone()
        }
    };
    let mut out: Vec<InstanceRegistration> = members.iter().zip(uncertainties).map(report).collect();
    out.push(reference.clone());
    out
}

/// Report of an object that is in no group.
pub(super) fn rejected(instance: u32, name: Option<&String>, gaussians: usize, note: String) -> InstanceRegistration {
    InstanceRegistration {
        instance,
        group: None,
        name: name.cloned(),
        gaussians,
        inliers: 0.0,
        rmse: 0.0,
        relative_rmse: 0.0,
        photometric: None,
        uncertainty: None,
        accepted: false,
        verdict: Verdict::Rejected,
        slight: false,
        note,
    }
}

/// Verdict on a member, for its report.
struct Said {
    verdict: Verdict,
    slight: bool,
    note: String,
}

fn said(decision: &Decision, median_cost: f64, uncertainty: Option<PoseUncertainty>) -> Said {
    let cost = decision.hypothesis.fit.cost_there;
    let doubt = |note| Said { verdict: Verdict::Ambiguous, slight: false, note };
    match (decision.certainty, uncertainty) {
        (Certainty::Ambiguous(by), _) => doubt(format!("another pose is only {:.1} % less likely", 100.0 * by)),
        _ if cost > POOR_FIT * median_cost => {
            doubt(format!("its surface is {:.1} times as far off as the median of its group", cost / median_cost))
        }
        (_, Some(PoseUncertainty { degrees, part })) if degrees > UNSURE_DEGREES || part > UNSURE_PART => {
            let percent = 100.0 * part;
            let note =
                format!("halves of its Gaussians give poses {degrees:.1} degrees and {percent:.1} % of its size apart");
            Said { slight: degrees <= SLIGHT_DEGREES && part <= SLIGHT_PART, ..doubt(note) }
        }
        (Certainty::Symmetric(count), _) => {
            let note = format!("symmetric: {count} poses fit equally well");
            Said { verdict: Verdict::Symmetric, slight: false, note }
        }
        (Certainty::Certain, _) => Said { verdict: Verdict::Accepted, slight: false, note: String::new() },
    }
}

fn world_from_template(reference: &ObjectSurface, member: &Aligned<'_>) -> Similarity {
    let pose = &member.decision.hypothesis.pose;
    let translation = member.surface.centroid + pose.apply(reference.box_middle - reference.centroid);
    Similarity::from_parts(pose.rotation, pose.scale, translation)
}
