//! Moves the common part of all instances' offsets into the template.

use std::collections::BTreeSet;

use crate::scene::instanced_scene::{Instance, InstancedScene};

impl InstancedScene {
    /// Adds the mean over instances of the offsets of a template Gaussian to the template: every instance's Gaussians
    /// stay as they are, up to rounding. Training cannot tell the two apart, and a template Gaussian may end up far
    /// from its position in every instance. Then q8, whose steps are proportional to the largest offset, loses the
    /// small differences, and a copy without offsets shows the Gaussian out of place.
    ///
    /// Quaternions stay, since a template's quaternion plus a mean may be zero. Templates with an instance without
    /// offsets stay, as do those that share Gaussians with another, and all templates do if runs of records overlap
    /// partially.
    pub fn recentre_offsets(&mut self) {
        if self.runs_overlap() {
            return;
        }
        for t in 0..self.template_ranges.len() {
            let of_template = || self.instances.iter().filter(|instance| instance.template as usize == t);
            let range = self.template_ranges[t];
            if self.shares_gaussians(t) || of_template().any(|instance| instance.first_offset.is_none()) {
                continue;
            }
            let runs: BTreeSet<usize> =
                of_template().filter_map(|i| i.first_offset).map(|first| first as usize).collect();
            for j in 0..range.count as usize {
                self.recentre(range.first as usize + j, &runs.iter().map(|first| first + j).collect::<Vec<_>>());
            }
        }
    }

    /// True if any record belongs to two different runs.
    fn runs_overlap(&self) -> bool {
        let of_instance = |i: &Instance| {
            let first = i.first_offset?;
            Some((first, first + self.template_ranges[i.template as usize].count, i.template))
        };
        let runs: BTreeSet<(u32, u32, u32)> = self.instances.iter().filter_map(of_instance).collect();
        runs.iter().zip(runs.iter().skip(1)).any(|(a, b)| a.1 > b.0)
    }

    /// Recentres template Gaussian `i` and its offset `records`.
    fn recentre(&mut self, i: usize, records: &[usize]) {
        let (templates, offsets) = (&mut self.templates, &mut self.offsets);
        let coefficients = templates.sh_coefficients();
        let sh = &mut templates.sh[i * coefficients..][..coefficients];
        share(&mut templates.means[i], &mut offsets.means, records);
        share(&mut sh[0], &mut offsets.sh_dc, records);
        let logits = offsets.opacity_logits.as_chunks_mut().0;
        share(std::array::from_mut(&mut templates.opacity_logits[i]), logits, records);
        if !offsets.log_scales.is_empty() {
            share(&mut templates.log_scales[i], &mut offsets.log_scales, records);
        }
        let rest = offsets.rest_coefficients();
        for (k, sh) in sh[1..].iter_mut().take(rest).enumerate() {
            share(sh, &mut offsets.sh_rest, &records.iter().map(|m| m * rest + k).collect::<Vec<_>>());
        }
    }
}

/// Adds the mean of the `records` to `value`, and subtracts the change of `value` from each of them.
fn share<const N: usize>(value: &mut [f32; N], offsets: &mut [[f32; N]], records: &[usize]) {
    for (k, value) in value.iter_mut().enumerate() {
        let before = f64::from(*value);
        let sum: f64 = records.iter().map(|&m| f64::from(offsets[m][k])).sum();
        *value = (before + sum / records.len().max(1) as f64) as f32;
        for &m in records {
            offsets[m][k] = (before + f64::from(offsets[m][k]) - f64::from(*value)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::{Gaussians, Offsets, SourceRange};

    /// `n` Gaussians of degree 1; every parameter has another value.
    fn cloud(n: usize) -> Gaussians {
        let at = |i: usize, k: usize| (i * 7 + k) as f32 * 0.37 % 1.9 - 0.8;
        Gaussians {
            sh_degree: 1,
            means: (0..n).map(|i| [at(i, 0), at(i, 1), at(i, 2)]).collect(),
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scales: (0..n).map(|i| [at(i, 3), at(i, 4), at(i, 5)]).collect(),
            opacity_logits: (0..n).map(|i| at(i, 6)).collect(),
            sh: (0..4 * n).map(|i| [at(i, 1), at(i, 3), at(i, 5)]).collect(),
        }
    }

    /// Templates of three and of two Gaussians; the first with runs 0 and 3 (twice), the second with run 6 and one
    /// instance without offsets.
    fn sample() -> InstancedScene {
        let placed =
            |template, first_offset| Instance { template, world_from_template: Similarity::IDENTITY, first_offset };
        let offsets = cloud(8);
        InstancedScene {
            templates: cloud(5),
            template_ranges: vec![SourceRange { first: 0, count: 3 }, SourceRange { first: 3, count: 2 }],
            instances: vec![
                placed(0, Some(0)),
                placed(1, None),
                placed(0, Some(3)),
                placed(0, Some(3)),
                placed(1, Some(6)),
            ],
            offsets: Offsets {
                sh_dc: offsets.sh[..8].to_vec(),
                sh_rest: offsets.sh[8..].to_vec(),
                means: offsets.means,
                opacity_logits: offsets.opacity_logits,
                log_scales: offsets.log_scales,
                quats: Vec::new(),
            },
            background: cloud(2),
            ..InstancedScene::default()
        }
    }

    fn scalars(cloud: &Gaussians) -> Vec<f32> {
        let vectors = [&cloud.means, &cloud.log_scales, &cloud.sh].map(|v| v.as_flattened().to_vec());
        [vectors.concat(), cloud.opacity_logits.clone()].concat()
    }

    #[test]
    fn instances_stay_and_the_mean_offset_is_zero() -> Result<(), Box<dyn std::error::Error>> {
        let mut scene = sample();
        scene.offsets.means[1] = [30.0, 0.0, -4.0];
        scene.offsets.means[4] = [31.0, 0.0, -4.5];
        let before = scene.flatten();
        scene.recentre_offsets();
        scene.validate()?;
        let worst =
            scalars(&before).iter().zip(scalars(&scene.flatten())).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 4e-6, "{worst}");
        let offsets = &scene.offsets;
        for j in 0..3 {
            let means = |v: &[[f32; 3]]| (0..3).map(|k| (v[j][k] + v[j + 3][k]).abs()).fold(0.0, f32::max);
            let logit = (offsets.opacity_logits[j] + offsets.opacity_logits[j + 3]).abs();
            let rest = (0..3).map(|k| (offsets.sh_rest[3 * j][k] + offsets.sh_rest[3 * (j + 3)][k]).abs());
            let rest = rest.fold(0.0, f32::max);
            let all = [means(&offsets.means), means(&offsets.sh_dc), means(&offsets.log_scales), logit, rest];
            assert!(all.iter().all(|&v| v < 4e-6), "{all:?}");
        }
        assert!(offsets.means[1][0].abs() < 0.51 && scene.templates.means[1][0] > 29.0);
        // An instance without offsets shows the template, which must not change.
        assert_eq!(scene.templates.means[3..], sample().templates.means[3..]);
        assert_eq!(offsets.means[6..], sample().offsets.means[6..]);
        let once = scene.clone();
        scene.recentre_offsets();
        let again = scalars(&once.flatten()).iter().zip(scalars(&scene.flatten())).all(|(a, b)| (a - b).abs() < 4e-6);
        assert!(again);
        Ok(())
    }

    #[test]
    fn templates_that_share_gaussians_stay() {
        let mut scene = sample();
        scene.template_ranges[1] = SourceRange { first: 2, count: 2 };
        let before = scene.clone();
        scene.recentre_offsets();
        assert_eq!(scene, before);
    }

    #[test]
    fn runs_that_share_records_stay() {
        let mut scene = sample();
        scene.instances[2].first_offset = Some(2);
        let before = scene.clone();
        scene.recentre_offsets();
        assert_eq!(scene, before);
    }
}
