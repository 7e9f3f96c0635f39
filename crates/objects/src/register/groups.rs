//! Forms posed groups from a labelled cloud.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::alike::{Unlike, check_fit, check_shape};
use super::check::{Agreement, PoseCheck};
use super::decide::{Decision, decide};
use super::error::RegisterError;
use super::hypotheses::{Hypothesis, hypotheses};
use super::members::{Aligned, Group};
use super::options::RegisterOptions;
use super::outcome::{posed_group, rejected, reports, target_from_reference};
use super::report::InstanceRegistration;
use super::sample::{FEW_GAUSSIANS, ObjectSurface};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Camera, Gaussians, PosedGroup, UpAxes};

/// Objects larger than usual in their category by more than this factor are tried last as references: a mask that holds
/// two objects makes a large one, and every object would fit a half of it.
const OVERSIZE: f64 = 1.4;
/// Input of registration.
#[derive(Clone, Copy, Debug)]
pub struct RegisterInput<'a> {
    /// Plain cloud in the world frame.
    pub cloud: &'a Gaussians,
    /// Mask id of each Gaussian, 0 = background.
    pub instance_of_gaussian: &'a [u32],
    /// Names by mask id. Objects with the same name are registered as one category, those without a name as another.
    pub categories: &'a BTreeMap<u32, String>,
    /// Training views: they give the up axis and the outer side of surfaces. May be empty.
    pub cameras: &'a [Camera],
}

/// Result of registration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Registered {
    /// Groups of at least two objects, the reference first. The frame of a group has the world's axes and its origin at
    /// the centre of the reference's bounding box.
    pub groups: Vec<PosedGroup>,
    /// One report per mask id that a Gaussian has, by id.
    pub instances: Vec<InstanceRegistration>,
}

/// Finds groups and poses. `check`, if given, compares the candidate poses of each object by pictures.
///
/// # Errors
/// Arrays of wrong length; an invalid camera or option; an error of `check`. Problems with a single object are in its
/// report.
pub fn register<'a>(
    input: &RegisterInput<'_>,
    check: Option<&'a mut (dyn PoseCheck + 'a)>,
    options: &'a RegisterOptions,
) -> Result<Registered, RegisterError> {
    options.validate()?;
    validate(input)?;
    let mut indices: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (i, &id) in input.instance_of_gaussian.iter().enumerate().filter(|(_, id)| **id != 0) {
        indices.entry(id).or_default().push(i as u32);
    }
    let surface =
        |(&id, indices): (&u32, &Vec<u32>)| (id, ObjectSurface::new(id, indices, input.cloud, input.cameras, options));
    let surfaces: Vec<(u32, Result<ObjectSurface, String>)> = indices.par_iter().map(surface).collect();
    let (mut classes, mut without_points) = (Classes::new(), Vec::new());
    for (id, surface) in &surfaces {
        let name = input.categories.get(id);
        match surface {
            Ok(surface) => classes.entry(name).or_default().push(surface),
            Err(reason) => without_points.push(rejected(*id, name, 0, reason.clone())),
        }
    }
    let UpAxes { level, straight } = UpAxes::of(input.cameras, input.cloud.means.iter().copied());
    let mut run = Run { up: level.or(straight), options, check, out: Registered::default() };
    let mut groups = run.groups(&classes)?;
    // On a flight `level` is the north: then turns about it were tried, and half turns about it would be.
    if let (Some(up), Some(normal)) = (level, straight)
        && (groups.is_empty() || Group::stand_rather_about(&groups, normal, up))
    {
        run = Run { up: straight, out: Registered::default(), ..run };
        groups = run.groups(&classes)?;
    }
    let axis = run.up.map(|up| Group::axis_of(&groups, up));
    groups.into_iter().try_for_each(|group| run.settle(group, axis))?;
    run.out.instances.extend(without_points);
    run.out.instances.sort_by_key(|i| i.instance);
    Ok(run.out)
}

pub(super) fn validate(input: &RegisterInput<'_>) -> Result<(), RegisterError> {
    let (cloud, count) = (input.cloud, input.cloud.len());
    if let Some((array, len, want)) = cloud.wrong_length() {
        return Err(RegisterError::Cloud { array, len, want });
    }
    if input.instance_of_gaussian.len() != count {
        return Err(RegisterError::LabelCount { labels: input.instance_of_gaussian.len(), gaussians: count });
    }
    input.cameras.iter().try_for_each(Camera::validate).map_err(RegisterError::Camera)
}

/// Objects by name: those of one name, or of none, are compared.
type Classes<'a> = BTreeMap<Option<&'a String>, Vec<&'a ObjectSurface>>;

/// A target and its pose, or why it has none.
type Outcome<'s> = (&'s ObjectSurface, Result<Decision, Unlike>);

/// State of a run of [`register()`].
struct Run<'a> {
    up: Option<DVec3>,
    options: &'a RegisterOptions,
    check: Option<&'a mut (dyn PoseCheck + 'a)>,
    out: Registered,
}

/// Median size of the objects that were seen well, scene units; infinite if there are fewer than three.
fn usual_size(objects: &[&ObjectSurface]) -> f64 {
    let mut sizes: Vec<f64> = objects.iter().filter(|s| s.gaussians >= FEW_GAUSSIANS).map(|s| s.size).collect();
    sizes.sort_by(f64::total_cmp);
    if sizes.len() < 3 { f64::INFINITY } else { sizes[(sizes.len() - 1) / 2] }
}

impl Run<'_> {
    /// Forms groups of the objects of each class.
    fn groups<'s>(&mut self, classes: &Classes<'s>) -> Result<Vec<Group<'s>>, RegisterError> {
        let mut groups = Vec::new();
        for (name, members) in classes {
            groups.extend(self.class(*name, members.clone())?);
        }
        Ok(groups)
    }

    /// Forms groups of the objects of one category, or of those without a name.
    fn class<'s>(
        &mut self,
        name: Option<&'s String>,
        mut open: Vec<&'s ObjectSurface>,
    ) -> Result<Vec<Group<'s>>, RegisterError> {
        let mut groups = Vec::new();
        let usual = usual_size(&open);
        open.sort_by_key(|s| (s.size > OVERSIZE * usual, std::cmp::Reverse(s.gaussians), s.id));
        // For each object, the best attempt so far.
        let mut reasons: BTreeMap<u32, Unlike> = BTreeMap::new();
        let mut tried = 0;
        let most = if name.is_some() { self.options.most_references } else { open.len() };
        while open.len() > 1 && tried < most {
            let reference = open.remove(0);
            let (mut members, mut left) = (Vec::new(), Vec::new());
            for (surface, outcome) in self.align(reference, &open, name.is_some())? {
                match outcome {
                    Ok(decision) => members.push(Aligned { surface, decision }),
                    Err(unlike) => {
                        let nearer = reasons.get(&surface.id).is_none_or(|before| before.agree < unlike.agree);
                        if nearer {
                            reasons.insert(surface.id, unlike);
                        }
                        left.push(surface);
                    }
                }
            }
            if members.is_empty() {
                tried += 1;
                let reason =
                    reasons.remove(&reference.id).map_or_else(|| "no other object is like it".into(), |u| u.reason);
                self.out.instances.push(rejected(reference.id, name, reference.gaussians, reason));
            } else {
                groups.push(Group::new(name, reference, members));
            }
            open = left;
        }
        for surface in open {
            let alone = || match name {
                Some(name) => format!("the only {name}: a group needs two objects"),
                None => "no other object is like it".into(),
            };
            let reason = reasons.remove(&surface.id).map_or_else(alone, |unlike| unlike.reason);
            self.out.instances.push(rejected(surface.id, name, surface.gaussians, reason));
        }
        Ok(groups)
    }

    /// The pose of each target, or why it has none.
    fn align<'s>(
        &mut self,
        reference: &ObjectSurface,
        targets: &[&'s ObjectSurface],
        named: bool,
    ) -> Result<Vec<Outcome<'s>>, RegisterError> {
        let (up, options) = (self.up, self.options);
        let found = |target: &&'s ObjectSurface| -> Result<Vec<Hypothesis>, Unlike> {
            check_shape(reference, target, named, options)?;
            check_fit(hypotheses(reference, target, up, options), reference.id, options)
        };
        let all: Vec<Result<Vec<Hypothesis>, Unlike>> = targets.par_iter().map(found).collect();
        let mut out = Vec::with_capacity(targets.len());
        for (&target, found) in targets.iter().zip(all) {
            let decision = match found {
                Ok(found) => {
                    let seen = self.pictures(reference, target, &found)?;
                    decide(reference, &found, seen.as_deref(), options).ok_or_else(|| Unlike::at_once("has no points"))
                }
                Err(reason) => Err(reason),
            };
            out.push((target, decision));
        }
        Ok(out)
    }

    /// Agreement of pictures for each hypothesis; `None` without a check.
    fn pictures(
        &mut self,
        reference: &ObjectSurface,
        target: &ObjectSurface,
        found: &[Hypothesis],
    ) -> Result<Option<Vec<Agreement>>, RegisterError> {
        let Some(check) = self.check.as_deref_mut() else { return Ok(None) };
        let poses: Vec<Similarity> = found.iter().map(|h| target_from_reference(reference, target, &h.pose)).collect();
        check.check(reference.id, target.id, &poses)
    }

    /// Refines a group and adds it to the result; `axis` is the up axis of its upright objects.
    fn settle(&mut self, mut group: Group<'_>, axis: Option<DVec3>) -> Result<(), RegisterError> {
        let uncertainties = group.settle(axis, self.check.as_deref_mut(), self.options)?;
        let Group { name, reference, members, .. } = group;
        let template_id = self.out.groups.len() as u32;
        let instances = reports((template_id, name), reference, &members, &uncertainties);
        self.out.groups.push(posed_group((template_id, name), reference, &members));
        self.out.instances.extend(instances);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};
    use instgs_vk::math::rng::Rng;

    /// Adds an object of two boxes, as a chair has a seat and a back, of so many Gaussians; its size and place are scene units.
    fn push(cloud: &mut Gaussians, labels: &mut Vec<u32>, id: u32, count: usize, world_from_object: Similarity) {
        let boxes = [
            (DVec3::new(0.0, 0.0, 0.2), DVec3::new(0.6, 0.4, 0.2)),
            (DVec3::new(-0.5, 0.1, 0.7), DVec3::new(0.1, 0.3, 0.3)),
        ];
        let mut rng = Rng::new(u64::from(id));
        for i in 0..count {
            let (middle, half) = boxes[i % 2];
            let mut at = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
            let axis = (3.0 * rng.uniform()) as usize % 3;
            at[axis] = if rng.chance(0.5) { 1.0 } else { -1.0 };
            cloud.means.push(world_from_object.transform_point(middle + at * half).as_vec3().to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([(0.02 * world_from_object.scale()).ln() as f32; 3]);
            cloud.opacity_logits.push(3.0);
            cloud.sh.push([0.3, i as f32 % 2.0, -0.2]);
            labels.push(id);
        }
    }

    /// The first reference is like none of the others, which are alike.
    #[test]
    fn as_many_references_are_tried_as_the_options_say() -> Result<(), RegisterError> {
        let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
        for (id, count, scale) in [(1, 900, 0.1), (2, 600, 1.0), (3, 600, 1.0)] {
            let place = DVec3::X * (4.0 * f64::from(id));
            push(&mut cloud, &mut labels, id, count, Similarity::from_parts(DMat3::IDENTITY, scale, place));
        }
        let categories: BTreeMap<u32, String> = (1..=3).map(|id| (id, "chair".to_owned())).collect();
        let input =
            RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories: &categories, cameras: &[] };
        let groups = |most_references| {
            let options = RegisterOptions { most_references, ..RegisterOptions::default() };
            register(&input, None, &options).map(|found| found.groups.len())
        };
        assert_eq!((groups(1)?, groups(2)?), (0, 1));
        assert!(groups(0).is_err_and(|error| error.to_string().contains("most_references")));
        Ok(())
    }

    /// From a flight that looks straight down the upper edges of pictures point north, or there and back. Objects that are turned
    /// about the vertical, if only by a few degrees, are then aligned by turns about one axis, and stand upright.
    #[test]
    fn objects_below_a_flight_stand_upright() -> Result<(), RegisterError> {
        let camera = |i: u32, up: DVec3| {
            let eye = DVec3::new(f64::from(i % 4) * 3.0, f64::from(i / 4) * 2.0, 9.0);
            Camera::look_at("", eye, eye + DVec3::NEG_Z, up, 0.9, (64, 48))
        };
        for (back, turn) in [(DVec3::Y, 0.9), (DVec3::NEG_Y, 0.9), (DVec3::Y, 0.02)] {
            let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
            for i in 0..6_u32 {
                let place = DVec3::new(f64::from(i % 3) * 4.0, f64::from(i / 3) * 4.0, 0.0);
                let turned = DMat3::from_rotation_z(turn * f64::from(i));
                push(&mut cloud, &mut labels, i + 1, 500, Similarity::from_parts(turned, 1.0, place));
            }
            let up_of = |i: u32| if (i / 4).is_multiple_of(2) { DVec3::Y } else { back };
            let cameras: Vec<Camera> = (0..16).map(|i| camera(i, up_of(i))).collect();
            let input = RegisterInput {
                cloud: &cloud,
                instance_of_gaussian: &labels,
                categories: &BTreeMap::new(),
                cameras: &cameras,
            };
            let found = register(&input, None, &RegisterOptions::default())?;
            let [group] = found.groups.as_slice() else { panic!("{} groups", found.groups.len()) };
            let turns = group.instances.iter().map(|i| DQuat::from_mat3(&i.world_from_template.rotation()));
            let axes: Vec<DVec3> = turns.filter_map(|turn| turn.to_scaled_axis().try_normalize()).collect();
            assert_eq!(axes.len(), 5, "all but the reference are turned");
            for axis in axes {
                assert!(axis.z.abs() > 0.999, "{axis}");
                assert!(axis.cross(group_axis(group)).length() < 1e-6, "{axis}");
            }
        }
        Ok(())
    }

    /// The axis about which the second instance is turned.
    fn group_axis(group: &PosedGroup) -> DVec3 {
        DQuat::from_mat3(&group.instances[1].world_from_template.rotation()).to_scaled_axis().normalize()
    }
}
