//! From the world to a template's frame: the inverse of what `InstancedScene::flatten` does to one instance.

use glam::{DMat3, DVec3};

use instgs_vk::math::covariance::{normalised_quat, quat_from_rotation, quat_multiply};
use instgs_vk::math::log_covariance::Shape;
use instgs_vk::math::sh::{ShRotation, widened};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::Gaussians;

/// The inverse of an instance's `world_from_template`, prepared for many Gaussians. In f64, rounded once to f32.
pub(super) struct TemplateFromWorld {
    /// Inverse of the linear part A of the pose.
    linear: DMat3,
    /// Position of the template's origin, world frame.
    origin_world: DVec3,
    /// Inverse rotation R^T as a quaternion.
    quat: [f64; 4],
    /// Inverse rotation R^T for SH coefficients.
    sh: ShRotation,
    /// Natural logarithm of the scale of A.
    ln_scale: f64,
}

impl TemplateFromWorld {
    /// Inverts a pose, which must be a valid similarity.
    pub(super) fn new(world_from_template: &Similarity) -> Self {
        let rotation = world_from_template.rotation().transpose();
        Self {
            linear: world_from_template.linear().inverse(),
            origin_world: world_from_template.translation(),
            quat: quat_from_rotation(rotation),
            sh: ShRotation::new(rotation),
            ln_scale: world_from_template.scale().ln(),
        }
    }

    /// A world position in the template's frame.
    pub(super) fn mean(&self, mean_world: [f32; 3]) -> [f32; 3] {
        (self.linear * (widened(mean_world) - self.origin_world)).as_vec3().to_array()
    }

    /// A world orientation, of any length but 0, in the template's frame; a unit quaternion.
    pub(super) fn quat(&self, quat_world: [f32; 4]) -> [f32; 4] {
        quat_multiply(self.quat, normalised_quat(quat_world.map(f64::from))).map(|c| c as f32)
    }

    /// World log scales in the template's units.
    pub(super) fn log_scales(&self, log_scales_world: [f32; 3]) -> [f32; 3] {
        log_scales_world.map(|v| (f64::from(v) - self.ln_scale) as f32)
    }

    /// The shape of a Gaussian of the world's `cloud`, in the template's frame and units.
    pub(super) fn shape(&self, cloud: &Gaussians, i: usize) -> Shape {
        Shape {
            quat: self.quat(cloud.quats[i]).map(f64::from),
            log_scales: self.log_scales(cloud.log_scales[i]).map(f64::from),
        }
    }

    /// SH coefficients of a Gaussian, rotated to the template's frame.
    pub(super) fn sh(&self, sh_world: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let wide: Vec<DVec3> = sh_world.iter().map(|&c| widened(c)).collect();
        self.sh.rotate(&wide).into_iter().map(|c| c.as_vec3().to_array()).collect()
    }

    /// Appends Gaussian `i` of the world's `cloud` to `out`, which has the same SH degree.
    pub(super) fn push(&self, cloud: &Gaussians, i: usize, out: &mut Gaussians) {
        out.means.push(self.mean(cloud.means[i]));
        out.quats.push(self.quat(cloud.quats[i]));
        out.log_scales.push(self.log_scales(cloud.log_scales[i]));
        out.opacity_logits.push(cloud.opacity_logits[i]);
        out.sh.extend(self.sh(cloud.sh_of(i)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::covariance::rotation_from_quat;
    use instgs_vk::math::rng::Rng;
    use instgs_vk::scene::{Instance, InstancedScene, SourceRange};

    fn drawn(rng: &mut Rng, len: usize) -> Gaussians {
        let mut out = Gaussians::with_capacity(3, len);
        for _ in 0..len {
            out.means.push(rng.normal_vector().as_vec3().to_array());
            out.quats.push(rng.rotation_quat().map(|q| q as f32));
            out.log_scales.push((rng.normal_vector() - 3.0).as_vec3().to_array());
            out.opacity_logits.push(rng.normal() as f32);
            out.sh.extend((0..16).map(|_| rng.normal_vector().as_vec3().to_array()));
        }
        out
    }

    /// Largest difference of any parameter; quaternions up to sign.
    fn difference(a: &Gaussians, b: &Gaussians) -> f32 {
        let vectors = a.means.iter().chain(&a.log_scales).chain(&a.sh).flatten();
        let others = b.means.iter().chain(&b.log_scales).chain(&b.sh).flatten();
        let mut worst = vectors.zip(others).fold(0.0f32, |m, (p, q)| m.max((p - q).abs()));
        for (p, q) in a.quats.iter().zip(&b.quats) {
            let dot: f32 = p.iter().zip(q).map(|(x, y)| x * y).sum();
            worst = worst.max((dot.abs() - 1.0).abs());
        }
        worst
    }

    /// Flattening and bringing back gives the template, up to rounding the world's values to f32.
    #[test]
    fn undoes_flatten() {
        let mut rng = Rng::new(4);
        for scale in [1.0, 0.4, 2.5] {
            let template = drawn(&mut rng, 40);
            let rotation = rotation_from_quat(rng.rotation_quat());
            let pose = Similarity::from_parts(rotation, scale, rng.normal_vector() * 3.0);
            let scene = InstancedScene {
                template_ranges: vec![SourceRange { first: 0, count: 40 }],
                instances: vec![Instance { template: 0, world_from_template: pose, first_offset: None }],
                templates: template.clone(),
                background: Gaussians::with_capacity(3, 0),
                ..InstancedScene::default()
            };
            let world = scene.flatten();
            let back = |pose: &Similarity| {
                let template_from_world = TemplateFromWorld::new(pose);
                let mut out = Gaussians::with_capacity(3, 40);
                (0..40).for_each(|i| template_from_world.push(&world, i, &mut out));
                difference(&out, &template)
            };
            assert!(back(&pose) < 5e-6, "{}", back(&pose));
            assert!(back(&Similarity::from_parts(rotation, 1.5 * scale, pose.translation())) > 0.3);
            assert!(back(&Similarity::from_parts(rotation.transpose(), scale, pose.translation())) > 0.3);
        }
    }
}
