//! Levels whose Gaussians were optimised to look like their template, for use in place of merged ones.

use std::collections::BTreeSet;

use half::f16;

use crate::scene::{Gaussians, InstancedScene};

use super::ladder::ladder;
use super::merge::Merged;

/// One level of a template with optimised Gaussians (`instgs_levels` makes them). It belongs to a template by that one's
/// values, so it follows the template from scene to scene, and one that was changed since has none.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedLevel {
    /// [`template_print`] of the template.
    pub template_print: u64,
    /// Side of the cells whose Gaussians are merged, template units: that of a level by merging.
    pub cell: f32,
    /// As many Gaussians as the level by merging has, in the same order, of the templates' SH degree.
    pub gaussians: Gaussians,
}

/// A number for the values of a template's Gaussians. All values but means are rounded to half precision first, so that a
/// scene file of half precision has the same ones (FNV-1a, 64 bits).
pub fn template_print(template: &Gaussians) -> u64 {
    let mut print = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bits: u32| print = (print ^ u64::from(bits)).wrapping_mul(0x0000_0100_0000_01b3);
    template.means.as_flattened().iter().for_each(|v| add(v.to_bits()));
    let Gaussians { quats, log_scales, opacity_logits, sh, .. } = template;
    let others = [quats.as_flattened(), log_scales.as_flattened(), opacity_logits, sh.as_flattened()];
    others.iter().flat_map(|values| values.iter()).for_each(|&v| add(f16::from_f32(v).to_bits().into()));
    print
}

impl InstancedScene {
    /// The optimised levels that are of its templates as they are now, of finite values only. The others are of templates
    /// that have been changed or removed.
    pub fn current_levels(&self) -> Vec<&FittedLevel> {
        if self.fitted_levels.is_empty() {
            return Vec::new();
        }
        let prints: BTreeSet<u64> =
            self.template_ranges.iter().map(|&range| template_print(&self.templates.range(range))).collect();
        let is_finite = |cloud: &Gaussians| (0..cloud.len()).all(|i| cloud.is_finite(i));
        let is_current = |level: &&FittedLevel| prints.contains(&level.template_print) && is_finite(&level.gaussians);
        self.fitted_levels.iter().filter(is_current).collect()
    }

    /// Removes the optimised levels that are not current; returns how many.
    pub fn drop_stale_levels(&mut self) -> usize {
        let current: Vec<FittedLevel> = self.current_levels().into_iter().cloned().collect();
        let stale = self.fitted_levels.len() - current.len();
        self.fitted_levels = current;
        stale
    }
}

/// The levels of a template by merging, the finest first: what [`FittedLevel`]s start from.
pub fn merged_levels(template: &Gaussians) -> Vec<FittedLevel> {
    let template_print = template_print(template);
    let of = |rung: super::ladder::Rung| FittedLevel {
        template_print,
        cell: rung.cell,
        gaussians: merged(template, &rung.members),
    };
    ladder(template).into_iter().map(of).collect()
}

/// One Gaussian for each list of members.
pub(super) fn merged(cloud: &Gaussians, lists: &[Vec<u32>]) -> Gaussians {
    let mut out = Gaussians::with_capacity(cloud.sh_degree, lists.len());
    lists.iter().for_each(|members| Merged::of(cloud, members, None).push_to(&mut out));
    out
}
