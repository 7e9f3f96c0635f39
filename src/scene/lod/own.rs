//! The Gaussians of one instance including its offsets, and the offsets of its merged Gaussians.

use crate::scene::{Gaussians, Instance, InstancedScene, Offsets, SourceRange};

use super::ladder::Rung;
use super::merge::Merged;

/// A template with an instance's offsets added, in the template's frame.
pub(super) struct OwnCloud {
    cloud: Gaussians,
    first_offset: usize,
}

/// The template plus the offsets of `instance`; `None` for an instance without offsets.
pub(super) fn own_cloud(scene: &InstancedScene, instance: &Instance) -> Option<OwnCloud> {
    let first_offset = instance.first_offset? as usize;
    let range = scene.template_ranges[instance.template as usize];
    let mut cloud = scene.templates.range(range);
    let offsets = &scene.offsets;
    let coefficients = cloud.sh_coefficients();
    for i in 0..range.count as usize {
        let m = first_offset + i;
        add(&mut cloud.means[i], offsets.means[m]);
        cloud.opacity_logits[i] += offsets.opacity_logits[m];
        let sh = &mut cloud.sh[i * coefficients..(i + 1) * coefficients];
        add(&mut sh[0], offsets.sh_dc[m]);
        sh[1..].iter_mut().zip(offsets.rest_of(m)).for_each(|(sh, &d)| add(sh, d));
        offsets.log_scales.get(m).into_iter().for_each(|&d| add(&mut cloud.log_scales[i], d));
        offsets.quats.get(m).into_iter().for_each(|&d| add(&mut cloud.quats[i], d));
    }
    Some(OwnCloud { cloud, first_offset })
}

fn add<const N: usize>(to: &mut [f32; N], offset: [f32; N]) {
    to.iter_mut().zip(offset).for_each(|(value, d)| *value += d);
}

fn minus<const N: usize>(a: [f32; N], b: [f32; N]) -> [f32; N] {
    std::array::from_fn(|k| a[k] - b[k])
}

impl OwnCloud {
    /// The template's Gaussians with the offsets added.
    #[cfg(test)]
    pub(super) fn cloud(&self) -> &Gaussians {
        &self.cloud
    }

    /// The offsets of one level, which is `range` of `templates`: from the template's merged Gaussians to the
    /// instance's, so that their sum equals merging the instance itself. If shapes have no offsets (or only scales or
    /// only rotations do, which cannot express a merged shape), the template's shapes are used, and opacities refer to
    /// those shapes.
    pub(super) fn level(
        &self,
        scene: &InstancedScene,
        rung: &Rung,
        templates: &Gaussians,
        range: SourceRange,
    ) -> Offsets {
        let kinds = &scene.offsets;
        let shapes = !kinds.log_scales.is_empty() && !kinds.quats.is_empty();
        let mut out = Offsets::default();
        for (members, i) in rung.members.iter().zip(range.first as usize..) {
            if let [one] = members.as_slice() {
                out.push_from(kinds, self.first_offset + *one as usize);
                continue;
            }
            let shape = (!shapes).then(|| templates.log_scales[i]);
            let own = Merged::of(&self.cloud, members, shape);
            let (log_scales, quat) =
                if shapes { (own.log_scales, own.quat) } else { (templates.log_scales[i], templates.quats[i]) };
            out.means.push(minus(own.mean, templates.means[i]));
            out.sh_dc.push(minus(own.sh[0], templates.sh_of(i)[0]));
            out.opacity_logits.push(own.opacity_logit - templates.opacity_logits[i]);
            if !kinds.sh_rest.is_empty() {
                out.sh_rest.extend(own.sh[1..].iter().zip(&templates.sh_of(i)[1..]).map(|(&a, &b)| minus(a, b)));
            }
            if !kinds.log_scales.is_empty() {
                out.log_scales.push(minus(log_scales, templates.log_scales[i]));
            }
            if !kinds.quats.is_empty() {
                out.quats.push(minus(quat, templates.quats[i]));
            }
        }
        out
    }
}
