//! Gaussians of the background that become an instance's own, and an instance's own that go back to the background.

use glam::{DMat3, DVec3};

use crate::math::sh::widened;
use crate::scene::edit::membership::{drop_foreign, release};
use crate::scene::edit::scatter::span;
use crate::scene::edit::{EditOutcome, EditReason, Selector, checked};
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{InstancedScene, SourceRange};

/// What places may differ by after they were rounded to f32, as a part of a box's longest side.
const ROUNDING: f64 = 1e-5;

/// Gives one instance the Gaussians of the background inside its template's box, which is grown by `margin` of its size on
/// every side: they move with it from now on.
pub(super) fn give(scene: &mut InstancedScene, which: &Selector, margin: f64) -> Result<EditOutcome, EditReason> {
    // Half of the size and less would leave no box.
    if !(margin.is_finite() && margin > -0.5) {
        return Err(EditReason::value(format!("{margin} is not a margin: want a part of the size above -0.5")));
    }
    let k = which.resolve_one(scene)?;
    let instance = scene.instances[k].clone();
    let template_from_world = checked(instance.world_from_template.inverse(), k)?;
    let spans = DVec3::AXES.map(|axis| span(scene, instance.template, DMat3::IDENTITY, axis));
    let [low, high] = [0, 1].map(|end| DVec3::from_array(spans.map(|span| span[end])));
    // The box of a flat template has no thickness: rounding must not put its own plane outside.
    let margin = margin * (high - low) + ROUNDING * (high - low).max_element();
    let inside = |mean: [f32; 3]| {
        let mean = template_from_world.transform_point(widened(mean));
        mean.cmpge(low - margin).all() && mean.cmple(high + margin).all()
    };
    let given: Vec<bool> = scene.background.means.iter().map(|&mean| inside(mean)).collect();
    let count = given.iter().filter(|&&given| given).count();
    let mut outcome = EditOutcome::default();
    if count == 0 {
        return Err(EditReason::value(format!("no Gaussian of the background is inside instance {k}")));
    }
    drop_foreign(scene, "own.", &mut outcome);
    drop_foreign(scene, "background.", &mut outcome);
    let mut cloud = scene.background.filtered(|i| given[i]);
    change_sh_degree(&mut cloud, scene.templates.sh_degree, "the templates have", &mut outcome);
    let cloud = cloud.placed(template_from_world);
    scene.background = scene.background.filtered(|i| !given[i]);
    let old = scene.own.range(scene.own_range(k));
    let range = SourceRange { first: scene.own.len() as u32, count: (old.len() + cloud.len()) as u32 };
    if scene.own.is_empty() {
        scene.own.sh_degree = scene.templates.sh_degree;
    }
    scene.own.append(&old);
    scene.own.append(&cloud);
    scene.own_ranges.resize(scene.instances.len(), SourceRange::default());
    scene.own_ranges[k] = range;
    outcome.changed.push(k);
    release(scene, &[], &mut outcome);
    Ok(outcome)
}

/// Returns the own Gaussians of instances to the background, where they are now.
pub(super) fn take(scene: &mut InstancedScene, which: &Selector) -> Result<EditOutcome, EditReason> {
    let chosen = which.resolve(scene)?;
    let mut outcome = EditOutcome::default();
    for k in chosen {
        let range = scene.own_range(k);
        if range.count == 0 {
            continue;
        }
        drop_foreign(scene, "background.", &mut outcome);
        let mut cloud = scene.own.range(range).placed(scene.instances[k].world_from_template);
        if scene.background.is_empty() {
            scene.background.sh_degree = cloud.sh_degree;
        }
        change_sh_degree(&mut cloud, scene.background.sh_degree, "the background has", &mut outcome);
        scene.background.append(&cloud);
        scene.own_ranges[k] = SourceRange::default();
        outcome.changed.push(k);
    }
    if outcome.changed.is_empty() {
        return Err(EditReason::value(format!("instance {which} has no own Gaussians")));
    }
    release(scene, &[], &mut outcome);
    Ok(outcome)
}

/// Changes the SH degree of Gaussians to that of a cloud they move to, with a warning, given once, if their colours lose bands.
fn change_sh_degree(cloud: &mut Gaussians, sh_degree: u32, who_has: &str, outcome: &mut EditOutcome) {
    let text = format!("their colours lose SH bands above {sh_degree}: {who_has} none");
    if cloud.sh_degree > sh_degree && !outcome.warnings.contains(&text) {
        outcome.warnings.push(text);
    }
    cloud.set_sh_degree(sh_degree);
}
