//! Makes each Gaussian of a drawn template the mean of its matches.
//!
//! A drawn Gaussian has one instance's shape, but with its offsets it represents a Gaussian of each instance, and SH
//! above the base colour, and by some settings shapes, have no offsets. So each template Gaussian becomes the mean of
//! its matches in the common pose: of position, opacity logit and SH directly, and of shape by the logarithm of the
//! covariance, which keeps flat shapes flat and averages log volumes (Arsigny et al. 2006, log-Euclidean metric).

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::instance_cloud::InstanceCloud;
use super::matching::{Match, match_template};
use super::options::{Doubles, TemplateOptions};
use super::template_cloud::TemplateCloud;
use instgs_vk::math::covariance::{quat_from_rotation, rotation_from_quat};
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::Gaussians;

/// Sums over the matches of one template Gaussian.
#[derive(Clone)]
struct Sums {
    count: f64,
    mean: DVec3,
    opacity_logit: f64,
    /// Half the logarithm of the covariance, whose eigenvalues are log scales.
    log_shape: DMat3,
    sh: Vec<DVec3>,
}

/// Matches every usable instance and replaces each template Gaussian by the mean of its matches, `settle_rounds` times. A
/// Gaussian without a match in any instance does not change.
pub(super) fn settle(
    mut template: TemplateCloud,
    cloud: &Gaussians,
    instances: &[InstanceCloud],
    options: &TemplateOptions,
) -> TemplateCloud {
    for _ in 0..options.settle_rounds {
        let mut gaussians = template.gaussians.clone();
        let sums = sums_of_matches(&template, cloud, instances, options.doubles());
        for (i, sums) in sums.iter().enumerate().filter(|(_, sums)| sums.count > 0.0) {
            sums.write_mean(&mut gaussians, i);
        }
        template = TemplateCloud::from_gaussians(gaussians);
    }
    template
}

fn sums_of_matches(
    template: &TemplateCloud,
    cloud: &Gaussians,
    instances: &[InstanceCloud],
    doubles: Doubles,
) -> Vec<Sums> {
    let coefficients = cloud.sh_coefficients();
    let none = Sums {
        count: 0.0,
        mean: DVec3::ZERO,
        opacity_logit: 0.0,
        log_shape: DMat3::ZERO,
        sh: vec![DVec3::ZERO; coefficients],
    };
    let mut sums = vec![none; template.gaussians.len()];
    for own in instances.iter().filter(|own| own.is_usable()) {
        let matches = match_template(template, cloud, own, doubles);
        sums.par_iter_mut().zip(matches).enumerate().for_each(|(i, (sums, matched))| {
            if matched.is_near(template, i) {
                sums.add(cloud, own, &matched);
            }
        });
    }
    sums
}

impl Sums {
    /// Adds the matched Gaussian of an instance.
    fn add(&mut self, cloud: &Gaussians, own: &InstanceCloud, matched: &Match) {
        let (frame, i) = (&own.template_from_world, own.indices[matched.own as usize] as usize);
        let shown = matched.counterpart(cloud, own);
        self.count += 1.0;
        self.mean += widened(shown.mean);
        self.opacity_logit += f64::from(shown.opacity_logit);
        let rotation = rotation_from_quat(shown.shape.quat);
        let log_scales = DVec3::from_array(shown.shape.log_scales);
        self.log_shape += rotation * DMat3::from_diagonal(log_scales) * rotation.transpose();
        for (sum, sh) in self.sh.iter_mut().zip(frame.sh(cloud.sh_of(i))) {
            *sum += widened(sh);
        }
    }

    /// Sets template Gaussian `i` to the mean.
    fn write_mean(&self, gaussians: &mut Gaussians, i: usize) {
        let part = 1.0 / self.count;
        let narrow = |v: DVec3| (v * part).as_vec3().to_array();
        let coefficients = self.sh.len();
        gaussians.means[i] = narrow(self.mean);
        let pairs = symmetric_eigen((self.log_shape * part).to_cols_array_2d());
        let [x, y, _] = pairs.map(|(_, axis)| DVec3::from_array(axis));
        gaussians.log_scales[i] = pairs.map(|(log_scale, _)| log_scale as f32);
        gaussians.quats[i] = quat_from_rotation(DMat3::from_cols(x, y, x.cross(y))).map(|c| c as f32);
        gaussians.opacity_logits[i] = (self.opacity_logit * part) as f32;
        for c in 0..coefficients {
            gaussians.sh[i * coefficients + c] = narrow(self.sh[c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::template::instance_cloud::Owners;
    use crate::template::options::OffsetKinds;
    use instgs_vk::math::covariance::sigmoid;
    use instgs_vk::math::rng::Rng;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::{PosedGroup, PosedInstance};

    const COUNT: usize = 27;

    /// Two objects of 27 Gaussians on a grid, with the same rotated shape except for log scales, SH, opacity and a
    /// shift along x, which are `-d` off in the first and `+d` in the second. The second is moved, rotated and three
    /// times as large.
    fn two_objects(d: f32) -> (Gaussians, Vec<InstanceCloud>, TemplateCloud) {
        let mut rng = Rng::new(2);
        let mut cloud = Gaussians::with_capacity(1, 2 * COUNT);
        let rotation = rotation_from_quat(rng.rotation_quat());
        let poses = [
            Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::ZERO),
            Similarity::from_parts(rotation, 3.0, DVec3::new(5.0, -8.0, 2.0)),
        ];
        let quats: Vec<[f64; 4]> = (0..COUNT).map(|_| rng.rotation_quat()).collect();
        for (pose, d) in poses.iter().zip([-d, d]) {
            for (i, quat) in quats.iter().enumerate() {
                let mean = DVec3::new((i % 3) as f64 + f64::from(0.1 * d), (i / 3 % 3) as f64, (i / 9) as f64);
                cloud.means.push(pose.transform_point(mean).as_vec3().to_array());
                let turned = quat_from_rotation(pose.rotation() * rotation_from_quat(*quat));
                cloud.quats.push(turned.map(|c| c as f32));
                let ln_scale = pose.scale().ln() as f32;
                cloud.log_scales.push([-3.0 + d, -2.0 - 0.5 * d, -1.0].map(|s| s + ln_scale));
                cloud.opacity_logits.push(1.0 + d);
                cloud.sh.extend([[0.5 + d, -d, 0.1], [0.0; 3], [0.0; 3], [0.0; 3]]);
            }
        }
        let instances = (0..2).map(|k| PosedInstance { id: k + 1, world_from_template: poses[k as usize] }).collect();
        let group = PosedGroup { template_id: 0, name: None, score: None, instances };
        let labels: Vec<u32> = (0..2 * COUNT).map(|i| 1 + (i / COUNT) as u32).collect();
        let owners = Owners::new(&labels, std::slice::from_ref(&group)).expect("valid");
        let own = owners.instances(&cloud, 0, &group);
        let drawn: Vec<_> = own[0].indices.iter().map(|&i| (&own[0].template_from_world, i)).collect();
        let template = TemplateCloud::new(&cloud, &drawn);
        (cloud, own, template)
    }

    fn rounds(settle_rounds: u32) -> TemplateOptions {
        let kinds = OffsetKinds { covariance: true, ..OffsetKinds::default() };
        TemplateOptions { settle_rounds, kinds, ..TemplateOptions::default() }
    }

    /// Without the pose's scale, log scales would be off by ln 3 / 2.
    #[test]
    fn becomes_the_mean_in_the_common_pose() {
        let (cloud, own, drawn) = two_objects(0.3);
        let wanted = two_objects(0.0).2.gaussians;
        let settled = settle(drawn, &cloud, &own, &rounds(1)).gaussians;
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 2e-5);
        assert!(close(settled.means.as_flattened(), wanted.means.as_flattened()));
        assert!(close(&settled.opacity_logits, &wanted.opacity_logits));
        assert!(close(settled.sh.as_flattened(), wanted.sh.as_flattened()));
        for i in 0..COUNT {
            let shape = |g: &Gaussians| {
                let rotation = rotation_from_quat(g.quats[i].map(f64::from));
                rotation * DMat3::from_diagonal(widened(g.log_scales[i])) * rotation.transpose()
            };
            let error = (shape(&settled) - shape(&wanted)).to_cols_array();
            assert!(error.iter().all(|e| e.abs() < 2e-5), "{error:?}");
        }
    }

    #[test]
    fn what_is_not_matched_stays() {
        let (cloud, own, drawn) = two_objects(0.3);
        let before = drawn.gaussians.clone();
        assert_eq!(settle(drawn, &cloud, &own, &rounds(0)).gaussians, before);
        // A part that no instance has.
        let mut far = before.clone();
        (4..8).for_each(|i| far.means[i] = [100.0, 0.1 * i as f32, 0.0]);
        let settled = settle(TemplateCloud::from_gaussians(far.clone()), &cloud, &own, &rounds(1)).gaussians;
        assert_eq!((&settled.means[4..8], &settled.quats[4..8]), (&far.means[4..8], &far.quats[4..8]));
        assert_ne!(settled.means[3], far.means[3]);
    }

    /// Three template Gaussians that share a match, or two that are alike, cover together what it covers alone.
    #[test]
    fn those_that_share_a_gaussian_share_its_opacity() {
        let (cloud, own, _) = two_objects(0.0);
        for (times, doubles) in [(3, Doubles::default()), (2, Doubles::Alike)] {
            let drawn: Vec<_> =
                own[0].indices.repeat(times).into_iter().map(|i| (&own[0].template_from_world, i)).collect();
            let options = TemplateOptions { doubles, ..rounds(1) };
            let settled = settle(TemplateCloud::new(&cloud, &drawn), &cloud, &own, &options).gaussians;
            let alone = sigmoid(1.0);
            for (i, logit) in settled.opacity_logits.iter().enumerate() {
                let each = sigmoid(f64::from(*logit));
                let together = 1.0 - (1.0 - each).powi(times as i32);
                assert!((together - alone).abs() < 1e-6 && each < alone, "{i}: {together} for {alone}");
            }
        }
    }

    /// Two that share one become its halves, each on the side where it lay.
    #[test]
    fn two_that_share_a_gaussian_are_its_halves() {
        let (cloud, own, _) = two_objects(0.0);
        let twice: Vec<_> = own[0].indices.repeat(2).into_iter().map(|i| (&own[0].template_from_world, i)).collect();
        let mut drawn = TemplateCloud::new(&cloud, &twice);
        // The first of each two lies a little ahead along the longest axis, the third.
        let axis = |i: usize| rotation_from_quat(cloud.quats[i].map(f64::from)).col(2);
        for i in 0..COUNT {
            drawn.gaussians.means[i] = (widened(drawn.gaussians.means[i]) + axis(i) * 1e-3).as_vec3().to_array();
        }
        let settled = settle(drawn, &cloud, &own, &rounds(1)).gaussians;
        let sigma = f64::from(cloud.log_scales[0][2]).exp();
        for i in 0..2 * COUNT {
            let side = if i < COUNT { 1.0 } else { -1.0 };
            let away = widened(settled.means[i]) - widened(cloud.means[i % COUNT]);
            let want = axis(i % COUNT) * (side * (1.0f64 - 1.6f64.powi(-2)).sqrt() * sigma);
            assert!((away - want).length() < 1e-4 * sigma, "{i}: {away} {want}");
            let mut logs = settled.log_scales[i];
            logs.sort_by(f32::total_cmp);
            let mut wanted = cloud.log_scales[i % COUNT];
            wanted[2] -= 1.6f32.ln();
            wanted.sort_by(f32::total_cmp);
            assert!(logs.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-4), "{i}: {logs:?} {wanted:?}");
            assert!((sigmoid(f64::from(settled.opacity_logits[i])) - 0.6 * sigmoid(1.0)).abs() < 1e-6);
        }
    }
}
