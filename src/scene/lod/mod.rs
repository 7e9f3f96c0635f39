//! Levels of detail: coarser copies of templates and of the background, made of merged Gaussians.
//!
//! A level has a *cell*, the side of a cubic grid in the template's frame. The Gaussians of a template whose means
//! share a cell, and none of which is larger than it, become one with their mass, mean, covariance and colour
//! ([`merge`]), and every instance's offsets become those of its merged Gaussians. So the error of a level is at most
//! about one cell, and a renderer that uses it only where a cell is at most E pixels wide has an error of at most about
//! E pixels (`reference::lod` has the rule). Levels are extra templates: the device draws them like any template.
//!
//! The background is cut into blocks, each with levels of its own, so that its far parts are coarse while its near ones
//! are not.
//!
//! Merging was compared with sorted prefixes of a template whose remaining Gaussians grow by the area left out (Cook,
//! Halstead, Planck, Ryu: Stochastic simplification of aggregate detail, 2007): merging is 2 dB closer to the full
//! picture at the same number of Gaussians.

mod blocks;
mod fitted;
mod ladder;
pub mod merge;
pub mod pages;
mod shown;

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use crate::math::similarity::Similarity;
use crate::scene::instanced_scene::ColorMatrix;
use crate::scene::{Gaussians, Instance, InstancedScene, Offsets, SourceRange};

pub use fitted::{FittedLevel, merged_levels, template_print};

use blocks::block_order;
use fitted::merged;
use ladder::{Rung, ladder};
use shown::shown_cloud;

/// Value of [`Part::next_cell`] without a coarser level: larger than any cell, and finite in f32.
pub const NO_NEXT_CELL: f32 = 1e30;

/// The cloud that a part is a range of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cloud {
    /// The cloud [`Levels::templates`].
    Templates,
    /// The cloud [`Levels::own`].
    Own {
        /// Number of the template's Gaussians, which come first in the instance.
        local_before: u32,
    },
    /// The cloud [`Levels::background`].
    Background,
}

/// One level of an instance or of a block of the background: what the device sees as an instance.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Index of the instance; for the background, the number of instances.
    pub owner: u32,
    /// The cloud that holds its Gaussians.
    pub cloud: Cloud,
    /// Its Gaussians, a range of that cloud.
    pub range: SourceRange,
    /// The Gaussians of the same object at full detail: all levels share their bounds, and so their distance to the
    /// camera.
    pub full: SourceRange,
    /// First record in [`Levels::offsets`].
    pub first_offset: Option<u32>,
    /// The transform of the instance; identity for the background.
    pub world_from_template: Similarity,
    /// Side of the merged cells, template units; 0 at full detail.
    pub cell: f32,
    /// Cell of the next coarser level; [`NO_NEXT_CELL`] if there is none.
    pub next_cell: f32,
}

/// A scene with its levels of detail.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Levels {
    /// The scene's templates, unchanged, followed by their levels.
    pub templates: Gaussians,
    /// The scene's own Gaussians of instances, unchanged: they have no levels.
    pub own: Gaussians,
    /// The scene's background, block by block, followed by the blocks' levels.
    pub background: Gaussians,
    /// The scene's colour matrices, by owner of a part: merging is linear, so levels have those of their instance.
    pub color_from_template: Vec<ColorMatrix>,
    /// The scene's offsets, unchanged, followed by those of levels.
    pub offsets: Offsets,
    /// In this order: instances at full detail, in the scene's order, each followed by its own Gaussians if it has any;
    /// blocks of the background at full detail; coarser levels of instances, grouped by instance; coarser levels of blocks.
    pub parts: Vec<Part>,
    /// For each instance, the range of `parts` with its coarser levels.
    pub coarser: Vec<Range<u32>>,
}

impl Levels {
    /// Exchanges the clouds, offsets and colour matrices with those of `pool`.
    pub fn swap_pool(&mut self, pool: &mut InstancedScene) {
        std::mem::swap(&mut self.templates, &mut pool.templates);
        std::mem::swap(&mut self.own, &mut pool.own);
        std::mem::swap(&mut self.background, &mut pool.background);
        std::mem::swap(&mut self.offsets, &mut pool.offsets);
        std::mem::swap(&mut self.color_from_template, &mut pool.color_from_template);
    }

    /// Builds the levels of a valid scene.
    pub fn of(scene: &InstancedScene) -> Self {
        let mut out = Self {
            templates: scene.templates.clone(),
            own: scene.own.clone(),
            background: Gaussians { sh_degree: scene.background.sh_degree, ..Gaussians::default() },
            color_from_template: scene.color_from_template.clone(),
            offsets: scene.offsets.clone(),
            ..Self::default()
        };
        let of_templates: Vec<Vec<TemplateLevel>> =
            scene.template_ranges.iter().map(|&range| out.push_template(scene, range)).collect();
        for (k, instance) in scene.instances.iter().enumerate() {
            let full = scene.template_ranges[instance.template as usize];
            let levels = &of_templates[instance.template as usize];
            out.parts.push(Part {
                owner: k as u32,
                cloud: Cloud::Templates,
                range: full,
                full,
                first_offset: instance.first_offset,
                world_from_template: instance.world_from_template,
                cell: 0.0,
                next_cell: levels.first().map_or(NO_NEXT_CELL, |level| level.rung.cell),
            });
            out.push_own(scene.own_range(k), full.count);
        }
        let blocks = out.push_blocks(scene);
        let runs = out.push_offsets(scene, &of_templates);
        let full: Vec<usize> = (0..out.parts.len()).filter(|&p| out.parts[p].cloud == Cloud::Templates).collect();
        for (k, instance) in scene.instances.iter().enumerate() {
            let first = out.parts.len() as u32;
            let run = instance.first_offset.and_then(|first| runs.get(&(instance.template, first)).copied());
            out.push_coarser(full[k], &of_templates[instance.template as usize], run);
            out.coarser.push(first..out.parts.len() as u32);
        }
        out.parts.extend(blocks);
        out
    }

    /// Appends the own Gaussians of the instance whose part is the last one.
    fn push_own(&mut self, range: SourceRange, local_before: u32) {
        if let Some(part) = self.parts.last().filter(|_| range.count > 0) {
            let cloud = Cloud::Own { local_before };
            let next_cell = NO_NEXT_CELL;
            self.parts.push(Part { cloud, range, full: range, first_offset: None, next_cell, ..part.clone() });
        }
    }

    /// Appends the levels of one template, fitted ones where the scene has them.
    fn push_template(&mut self, scene: &InstancedScene, range: SourceRange) -> Vec<TemplateLevel> {
        let own = scene.templates.range(range);
        let print = if scene.fitted_levels.is_empty() { 0 } else { template_print(&own) };
        let mut levels = merged_ladder(&own);
        for level in &mut levels {
            let fits = |fitted: &&FittedLevel| {
                (fitted.template_print, fitted.cell, fitted.gaussians.len())
                    == (print, level.rung.cell, level.merged.len())
            };
            let shown = scene.fitted_levels.iter().find(fits).map_or(&level.merged, |fitted| &fitted.gaussians);
            level.range.first = self.templates.len() as u32;
            self.templates.append(shown);
        }
        levels
    }

    /// Appends the background in blocks, with their parts at full detail; returns the parts of their levels.
    fn push_blocks(&mut self, scene: &InstancedScene) -> Vec<Part> {
        let owner = scene.instances.len() as u32;
        let (order, blocks) = block_order(&scene.background);
        order.iter().for_each(|&i| self.background.push_from(&scene.background, i as usize));
        let clouds: Vec<Gaussians> = blocks.iter().map(|&block| self.background.range(block)).collect();
        let made: Vec<Vec<TemplateLevel>> = clouds.par_iter().map(merged_ladder).collect();
        let mut coarser = Vec::new();
        for (&full, levels) in blocks.iter().zip(made) {
            let part = |range, cell, next_cell| Part {
                owner,
                cloud: Cloud::Background,
                range,
                full,
                first_offset: None,
                world_from_template: Similarity::IDENTITY,
                cell,
                next_cell,
            };
            let cells: Vec<f32> = levels.iter().map(|level| level.rung.cell).chain([NO_NEXT_CELL]).collect();
            self.parts.push(part(full, 0.0, cells[0]));
            for (r, level) in levels.iter().enumerate() {
                let range = SourceRange { first: self.background.len() as u32, ..level.range };
                self.background.append(&level.merged);
                coarser.push(part(range, level.rung.cell, cells[r + 1]));
            }
        }
        coarser
    }

    /// Appends the offsets of all levels, level by level, for each run of offsets that a template has in the scene: instances
    /// that share a run share those. Returns the first record by template and first record of the run.
    fn push_offsets(
        &mut self,
        scene: &InstancedScene,
        of_templates: &[Vec<TemplateLevel>],
    ) -> BTreeMap<(u32, u32), u32> {
        let run_of = |instance: &Instance| instance.first_offset.map(|first| (instance.template, first));
        let runs: BTreeMap<(u32, u32), &Instance> =
            scene.instances.iter().filter_map(|instance| run_of(instance).map(|run| (run, instance))).collect();
        let merged = |(run, instance): (&(u32, u32), &&Instance)| {
            let shown = shown_cloud(scene, instance)?;
            let levels = &of_templates[run.0 as usize];
            Some((*run, levels.iter().map(|level| shown.level(scene, level)).collect()))
        };
        let merged: Vec<((u32, u32), Vec<Offsets>)> = runs.par_iter().filter_map(merged).collect();
        let place = |(run, levels): ((u32, u32), Vec<Offsets>)| {
            let first = self.offsets.len() as u32;
            levels.iter().for_each(|level| (0..level.len()).for_each(|m| self.offsets.push_from(level, m)));
            (run, first)
        };
        merged.into_iter().map(place).collect()
    }

    /// Appends the coarser parts of an instance, whose full detail is `part`; `first_offset` is that of the first of them if
    /// the instance has offsets.
    fn push_coarser(&mut self, part: usize, levels: &[TemplateLevel], mut first_offset: Option<u32>) {
        let full = self.parts[part].clone();
        for (r, TemplateLevel { rung, range, .. }) in levels.iter().enumerate() {
            self.parts.push(Part {
                range: *range,
                first_offset,
                cell: rung.cell,
                next_cell: levels.get(r + 1).map_or(NO_NEXT_CELL, |next| next.rung.cell),
                ..full.clone()
            });
            first_offset = first_offset.map(|first| first + range.count);
        }
    }
}

/// One level of a template or of a block of the background.
struct TemplateLevel {
    rung: Rung,
    /// The level's Gaussians in the cloud that it was appended to.
    range: SourceRange,
    /// The level by merging, which offsets of instances refer to.
    merged: Gaussians,
}

/// The levels of a cloud by merging; ranges begin at 0.
fn merged_ladder(cloud: &Gaussians) -> Vec<TemplateLevel> {
    let level = |rung: Rung| {
        let merged = merged(cloud, &rung.members);
        TemplateLevel { range: SourceRange { first: 0, count: merged.len() as u32 }, rung, merged }
    };
    ladder(cloud).into_iter().map(level).collect()
}

#[cfg(test)]
mod tests;
