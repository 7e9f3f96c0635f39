//! How many of the found poses are right, and of the wrong ones how many are said to be in doubt.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3, Vec3};
use instgs_objects::register::{RegisterOptions, Registered, Verdict};
use instgs_vk::scene::PosedGroup;

use super::labelled::{Labelled, Recipe};

/// Rotation right within this, degrees; translation within this part of the object's size. As issue 5 has it.
pub(crate) const DEGREES: f64 = 1.0;
pub(crate) const PART: f64 = 0.01;

/// Turns about the vertical, evenly spread, after which an object is the same: tables have two ends, vases are round.
pub(crate) fn symmetry(name: Option<&str>) -> usize {
    match name {
        Some("table") => 2,
        Some("vase") => 720,
        _ => 1,
    }
}

/// Angle in degrees and distance as a part of the size between the found and the true pose of an object, relative to the
/// found group's reference and up to symmetry.
pub(crate) fn pose_error(labelled: &Labelled, group: &PosedGroup, id: u32) -> Option<(f64, f64)> {
    let pose = |group: &PosedGroup, id: u32| group.instances.iter().find(|i| i.id == id).map(|i| i.world_from_template);
    let reference = &group.instances[0];
    let found = pose(group, id)?;
    let truth = labelled.truth.iter().find(|g| pose(g, id).is_some())?;
    let (to, from) = (pose(truth, id)?, pose(truth, reference.id)?);
    let own = (0..labelled.labels.len()).filter(|&i| labelled.labels[i] == id);
    let points: Vec<DVec3> = own.map(|i| Vec3::from(labelled.cloud.means[i]).as_dvec3()).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
    let count = symmetry(truth.name.as_deref());
    let errors = (0..count).map(|k| {
        let own_turn = DMat3::from_rotation_z(TAU * k as f64 / count as f64);
        let linear = to.linear() * own_turn * from.linear().inverse();
        let middle = reference.world_from_template.translation();
        let want = linear * (middle - from.translation()) + to.translation();
        let turn = found.rotation().transpose() * (linear * (1.0 / linear.determinant().cbrt()));
        let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
        let degrees = (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees();
        (degrees, want.distance(found.translation()) / low.distance(high))
    });
    errors.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// What came out of a scene.
#[derive(Default, Debug)]
pub(crate) struct Score {
    pub(crate) right: usize,
    /// Wrong, but said so.
    pub(crate) flagged: usize,
    /// Right, but put in doubt.
    pub(crate) doubted: usize,
    /// Wrong, and nothing said.
    pub(crate) silent: usize,
    pub(crate) worst: (f64, f64),
}

pub(crate) fn score(labelled: &Labelled, found: &Registered) -> Score {
    let mut out = Score::default();
    for instance in found.instances.iter().filter(|i| i.verdict != Verdict::Reference) {
        let error = found.groups.iter().find_map(|g| pose_error(labelled, g, instance.instance));
        let right = error.is_some_and(|(degrees, part)| degrees < DEGREES && part < PART);
        let doubt = matches!(instance.verdict, Verdict::Ambiguous | Verdict::Rejected);
        match (right, doubt) {
            (true, false) => out.right += 1,
            (true, true) => (out.right, out.doubted) = (out.right + 1, out.doubted + 1),
            (false, true) => out.flagged += 1,
            (false, false) => out.silent += 1,
        }
        if let Some((degrees, part)) = error.filter(|_| !doubt) {
            out.worst = (out.worst.0.max(degrees), out.worst.1.max(part));
        }
        if !right || doubt {
            println!("  {error:.3?} {instance:?}");
        }
    }
    out
}

pub(crate) fn measured(recipe: Recipe) -> Score {
    let labelled = recipe.labelled();
    let started = std::time::Instant::now();
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    let seconds = started.elapsed().as_secs_f64();
    let score = score(&labelled, &found);
    println!("{} seed {}: {score:?}, {} Gaussians, {seconds:.2} s", recipe.scene, recipe.seed, labelled.cloud.len());
    score
}
