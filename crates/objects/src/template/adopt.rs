//! Makes an object an instance of a template that was built without it.

use super::instance_cloud::InstanceCloud;
use super::offsets::push_offsets;
use super::options::{Doubles, OffsetKinds, TemplateOptions, Unmatched};
use super::template_cloud::TemplateCloud;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, Offsets};

/// A template that takes in objects; it is not changed by them.
pub struct Adopter {
    template: TemplateCloud,
}

/// What an object differs by from the template that it is now an instance of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adopted {
    /// One record per template Gaussian, or none if no kind of offset was asked for.
    pub offsets: Offsets,
    /// The object's Gaussians that no Gaussian of the template stands for, in the template's frame; empty unless they were asked
    /// for.
    pub own: Gaussians,
    /// Number of template Gaussians that the object lacks.
    pub lacking: usize,
}

impl Adopter {
    /// Takes a template in its own frame.
    pub fn new(template: Gaussians) -> Self {
        let opacity_logits = template.opacity_logits.clone();
        let mut template = TemplateCloud::from_gaussians(template);
        // It is drawn with its own opacities, not with those that training would begin with.
        template.gaussians.opacity_logits = opacity_logits;
        Self { template }
    }

    /// The differences of an object, a cloud in the world frame of the template's SH degree, at its pose. Each of the template's
    /// Gaussians is matched to one of the object's, as when a template is built. An object of very few Gaussians gets offsets of
    /// zero: it looks like the template.
    pub fn adopt(
        &self,
        object: &Gaussians,
        world_from_template: &Similarity,
        kinds: OffsetKinds,
        unmatched: Unmatched,
    ) -> Adopted {
        let all: Vec<u32> = (0..object.len() as u32).collect();
        let cloud = InstanceCloud::new(object, &all, world_from_template);
        let mut out = Adopted { own: Gaussians::with_capacity(object.sh_degree, 0), ..Adopted::default() };
        // What is adopted is looked at, and not trained.
        let doubles = Doubles::Alike;
        let options = TemplateOptions { kinds, unmatched, doubles, ..TemplateOptions::default() };
        let common = push_offsets(&self.template, object, &cloud, &options, &mut out.offsets);
        out.lacking = common.lacking;
        if !kinds.any() {
            out.offsets = Offsets::default();
        }
        // What is too small to be matched looks like the template, and is not drawn beside it once more.
        if unmatched == Unmatched::Own && cloud.is_usable() {
            for (&i, _) in cloud.indices.iter().zip(&common.matched).filter(|(_, matched)| !**matched) {
                cloud.template_from_world.push(object, i as usize, &mut out.own);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use instgs_vk::math::covariance::{covariance, normalised_quat, quat_multiply};
    use instgs_vk::math::rng::Rng;
    use instgs_vk::math::sh::widened;
    use instgs_vk::scene::{Instance, InstancedScene, SourceRange};

    fn template(count: usize) -> Gaussians {
        let mut rng = Rng::new(3);
        let mut out = Gaussians::with_capacity(1, count);
        for _ in 0..count {
            out.means.push(rng.normal_vector().as_vec3().to_array());
            out.quats.push(rng.rotation_quat().map(|q| q as f32));
            out.log_scales.push([-3.0; 3]);
            out.opacity_logits.push(1.0);
            out.sh.extend((0..4).map(|_| rng.normal_vector().as_vec3().to_array()));
        }
        out
    }

    /// The axes of a Gaussian may be in any order: offsets of shape go from each of the template's to the one that lies along it, and
    /// give the object's ellipsoids.
    #[test]
    fn offsets_of_shape_pair_axes_that_lie_along_each_other() {
        let mut rng = Rng::new(5);
        let mut template = template(150);
        // As training leaves them, quaternions have any length.
        template.quats.iter_mut().for_each(|quat| *quat = quat.map(|v| 3.0 * v));
        template.log_scales.iter_mut().for_each(|logs| *logs = [0.0, 1.0, 2.0].map(|v| v - 4.0));
        let mut object = template.clone();
        for (quat, logs) in object.quats.iter_mut().zip(&mut object.log_scales) {
            // A third of a turn about (1, 1, 1): each axis of the object is the template's next one.
            let turned = quat_multiply(quat.map(f64::from), [-0.5; 4]);
            let little = rng.rotation_quat().map(|v| 0.03 * v);
            let turned = quat_multiply(turned, [1.0 + little[0], little[1], little[2], little[3]]);
            *quat = normalised_quat(turned).map(|v| v as f32);
            *logs = [logs[1] + 0.1, logs[2], logs[0]];
        }
        let kinds = OffsetKinds { covariance: true, ..OffsetKinds::default() };
        let adopted = Adopter::new(template.clone()).adopt(&object, &Similarity::IDENTITY, kinds, Unmatched::Drop);
        assert_eq!((adopted.lacking, adopted.offsets.len()), (0, 150));
        for i in 0..150 {
            let (logs, quat) = (adopted.offsets.log_scales[i], adopted.offsets.quats[i]);
            assert!((logs[1] - 0.1).abs() < 1e-4 && logs[0].abs() + logs[2].abs() < 1e-4, "{i}: {logs:?}");
            assert!(quat.iter().all(|v| v.abs() < 3.0 * 0.1), "{i}: {quat:?}");
            let sum = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a + b)).collect::<Vec<_>>();
            let quat = sum(&template.quats[i], &quat);
            let logs = sum(&template.log_scales[i], &logs);
            let got = covariance([quat[0], quat[1], quat[2], quat[3]], DVec3::new(logs[0], logs[1], logs[2]));
            let want = covariance(object.quats[i].map(f64::from), widened(object.log_scales[i]));
            let error = (got - want).to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
            assert!(
                error < 1e-5 * want.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs())),
                "{i}: {error}"
            );
        }
    }

    /// An object that is the template moved a little and coloured anew, and has ten Gaussians beside it, far off.
    #[test]
    fn offsets_and_own_gaussians_give_the_object_back() {
        let template = template(200);
        let mut object = template.clone();
        object.means.iter_mut().for_each(|mean| mean[0] += 0.01);
        object.sh.chunks_exact_mut(4).for_each(|sh| sh[0] = [0.3, -0.2, 0.1]);
        for i in 0..10 {
            object.push_from(&template, i);
            object.means[200 + i] = [9.0 + i as f32, 9.0, 9.0];
        }
        let pose = Similarity::from_parts(DMat3::from_rotation_z(0.7), 1.5, DVec3::new(3.0, -2.0, 1.0));
        let world = object.clone().placed(pose);
        let adopter = Adopter::new(template.clone());
        let adopted = adopter.adopt(&world, &pose, OffsetKinds::default(), Unmatched::Own);
        assert_eq!((adopted.lacking, adopted.offsets.len(), adopted.own.len()), (0, 200, 10));
        let scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: 200 }],
            templates: template,
            instances: vec![Instance { template: 0, world_from_template: pose, first_offset: Some(0) }],
            own_ranges: vec![SourceRange { first: 0, count: 10 }],
            own: adopted.own,
            offsets: adopted.offsets,
            background: Gaussians::with_capacity(1, 0),
            ..InstancedScene::default()
        };
        scene.validate().unwrap();
        let shown = scene.flatten();
        let worst = shown.means.iter().zip(&world.means).flat_map(|(a, b)| (0..3).map(move |k| (a[k] - b[k]).abs()));
        assert!(worst.fold(0.0, f32::max) < 1e-5);
        let colors = shown.sh.iter().zip(&world.sh).flat_map(|(a, b)| (0..3).map(move |k| (a[k] - b[k]).abs()));
        assert!(colors.fold(0.0, f32::max) < 1e-5);
        let dropped = adopter.adopt(&world, &pose, OffsetKinds::default(), Unmatched::Drop);
        assert!(dropped.own.is_empty() && dropped.offsets.len() == 200);
        let bare = OffsetKinds { position: false, sh_dc: false, opacity: false, ..OffsetKinds::default() };
        assert!(adopter.adopt(&world, &pose, bare, Unmatched::Drop).offsets.is_empty());
        let own_alone = adopter.adopt(&world, &pose, bare, Unmatched::Own);
        assert_eq!((own_alone.offsets.len(), own_alone.own.len()), (0, 10));
    }
}
