//! The Gaussians of one instance including its offsets, and the offsets of its merged Gaussians.

use crate::scene::flatten::Local;
use crate::scene::{Gaussians, Instance, InstancedScene, Offsets};

use super::TemplateLevel;
use super::merge::Merged;

/// A template with an instance's offsets added, in the template's frame.
pub(super) struct ShownCloud {
    cloud: Gaussians,
    first_offset: usize,
}

/// The template plus the offsets of `instance`; `None` for an instance without offsets.
pub(super) fn shown_cloud(scene: &InstancedScene, instance: &Instance) -> Option<ShownCloud> {
    let first_offset = instance.first_offset? as usize;
    let count = scene.template_ranges[instance.template as usize].count as usize;
    let mut cloud = Gaussians::with_capacity(scene.templates.sh_degree, count);
    // Levels have their instance's colour matrix, so colours are those before it.
    (0..count).for_each(|local| Local::shown(scene, instance, None, local).push_to(&mut cloud));
    Some(ShownCloud { cloud, first_offset })
}

fn minus<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|k| a[k] - b[k])
}

impl ShownCloud {
    /// The template's Gaussians with the offsets added.
    #[cfg(test)]
    pub(super) fn cloud(&self) -> &Gaussians {
        &self.cloud
    }

    /// The offsets of one level: from the template's merged Gaussians to the instance's, so that their sum equals merging
    /// the instance itself. If shapes have no offsets (or only scales or only rotations do, which cannot express a merged
    /// shape), the template's shapes are used, and opacities refer to those shapes.
    pub(super) fn level(&self, scene: &InstancedScene, level: &TemplateLevel) -> Offsets {
        let (kinds, of_template) = (&scene.offsets, &level.merged);
        let shapes = !kinds.log_scales.is_empty() && !kinds.quats.is_empty();
        let mut out = Offsets::default();
        for (i, members) in level.rung.members.iter().enumerate() {
            if let [one] = members.as_slice() {
                out.push_from(kinds, self.first_offset + *one as usize);
                continue;
            }
            let shape = (!shapes).then(|| of_template.log_scales[i]);
            let own = Merged::of(&self.cloud, members, shape);
            let (log_scales, quat) =
                if shapes { (own.log_scales, own.quat) } else { (of_template.log_scales[i], of_template.quats[i]) };
            out.means.push(minus(own.mean, of_template.means[i]));
            out.sh_dc.push(minus(own.sh[0], of_template.sh_of(i)[0]));
            out.opacity_logits.push(own.opacity_logit - of_template.opacity_logits[i]);
            let rest = own.sh.iter().zip(of_template.sh_of(i)).skip(1).take(kinds.rest_coefficients());
            out.sh_rest.extend(rest.map(|(&a, &b)| minus(a, b)));
            if !kinds.log_scales.is_empty() {
                out.log_scales.push(minus(log_scales, of_template.log_scales[i]));
            }
            if !kinds.quats.is_empty() {
                out.quats.push(minus(quat, of_template.quats[i]));
            }
        }
        out
    }
}
