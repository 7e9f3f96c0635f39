//! Instance and chunk tables of a scene with levels of detail: every level is an instance, with its owner and cell
//! size.

use std::collections::HashMap;

use glam::Vec3;

use crate::math::sh::widened;
use crate::scene::bound::{Bound, round_up};
use crate::scene::lod::pages::{Ball, PageTable, chunks_of as balls_of};
use crate::scene::lod::{Cloud, Levels, Part};
use crate::scene::source_layout::CloudSize;
use crate::scene::{Gaussians, SourceRange};

use super::error::RenderError;
use super::scene_tables::{Bounded, Owner, Placement, Source, Tables};

/// The tables of a scene with levels for chunks of `chunk_size` Gaussians.
///
/// # Errors
/// More expanded Gaussians, levels included, than a u32 can count.
pub(super) fn build_level_tables(levels: &Levels, chunk_size: u32) -> Result<Tables, RenderError> {
    let mut builder = Builder::new(levels, chunk_size);
    levels.parts.iter().try_for_each(|part| builder.push(part))?;
    Ok(builder.tables)
}

/// Tables of a scene whose background is in pages, and which of their rows show it.
pub(super) struct PagedTables {
    /// The tables; rows of the background show nothing yet.
    pub(super) tables: Tables,
    /// The row of the first block at full detail; those of the others follow.
    pub(super) first_block: u32,
    /// The row of the first level of a block.
    pub(super) first_level: u32,
}

/// The tables of a scene with levels, whose background is that of a table of pages; its rows are in the order of those of
/// [`build_level_tables`]. `sigma_factor` is what packing may do to the largest standard deviations.
///
/// # Errors
/// The same errors as [`build_level_tables`].
pub(super) fn build_paged_tables(
    levels: &Levels,
    pages: &PageTable,
    sigma_factor: f64,
    chunk_size: u32,
) -> Result<PagedTables, RenderError> {
    let mut builder = Builder::new(levels, chunk_size);
    let at_full_detail = levels.coarser.first().map_or(levels.parts.len(), |range| range.start as usize);
    let (full, coarser) = levels.parts.split_at(at_full_detail);
    full.iter().try_for_each(|part| builder.push(part))?;
    let first_block = builder.tables.instances.len() as u32;
    let mut chunks = pages.block_chunks.as_slice();
    for (ball, &count) in pages.block_balls.iter().zip(&pages.block_counts) {
        let balls;
        (balls, chunks) = chunks.split_at(balls_of(count));
        builder.push_paged(ball, balls, count, sigma_factor)?;
    }
    coarser.iter().try_for_each(|part| builder.push(part))?;
    let first_level = builder.tables.instances.len() as u32;
    let mut chunks = pages.level_chunks.as_slice();
    for level in &pages.levels {
        let balls;
        (balls, chunks) = chunks.split_at(balls_of(level.count));
        builder.push_paged(&pages.block_balls[level.block as usize], balls, level.count, sigma_factor)?;
    }
    Ok(PagedTables { tables: builder.tables, first_block, first_level })
}

/// Tables that grow.
struct Builder<'a> {
    levels: &'a Levels,
    chunk_size: u32,
    tables: Tables,
    /// The chunks of ranges that have been met: instances of one template share them.
    known: HashMap<(Cloud, SourceRange), Bounded>,
    /// How far ranges of levels lie outside the ball of their full detail.
    outside: HashMap<(Cloud, SourceRange), f64>,
}

impl<'a> Builder<'a> {
    fn new(levels: &'a Levels, chunk_size: u32) -> Self {
        Self { levels, chunk_size, tables: Tables::default(), known: HashMap::new(), outside: HashMap::new() }
    }

    /// Appends the row of a part.
    fn push(&mut self, part: &Part) -> Result<(), RenderError> {
        let Self { levels, chunk_size, .. } = *self;
        let full = self.chunks_of(part.cloud, part.full).bound;
        let shown = self.chunks_of(part.cloud, part.range);
        // All levels have the same ball, and thus the same distance from the camera. Merged means lie within the ball of the
        // Gaussians they are made of; those of fitted levels may have been moved out of it.
        let bounded = Bounded { bound: Bound { sigma_max: shown.bound.sigma_max, ..full }, ..shown };
        let outside = self.outside(part, &full);
        let place = Placement::of(&part.world_from_template, &levels.offsets, part.first_offset, part.range.count);
        let owner = match part.cloud {
            Cloud::Templates => Owner::of_template(part.owner, !levels.color_from_template.is_empty()),
            Cloud::Own { .. } | Cloud::Background => Owner::without_color(part.owner),
        };
        self.tables.push_instance(&place, bounded, source_of(levels, part), owner, chunk_size)?;
        if let Some(entry) = self.tables.instances.last_mut() {
            (entry.cell, entry.next_cell) = (part.cell, part.next_cell);
            if outside > 0.0 {
                entry.max_offset = round_up(f64::from(entry.max_offset) + outside);
            }
        }
        Ok(())
    }

    /// How far the means that a part shows lie outside the ball of its full detail, in its own frame; 0 if none does.
    fn outside(&mut self, part: &Part, full: &Bound) -> f64 {
        if part.range == part.full {
            return 0.0;
        }
        let gaussians = self.gaussians_of(part.cloud);
        let beyond = |mean: &[f32; 3]| widened(*mean).distance(full.center) - full.radius;
        let means = &gaussians.means[part.range.first as usize..][..part.range.count as usize];
        *self
            .outside
            .entry((part.cloud, part.range))
            .or_insert_with(|| means.iter().map(beyond).filter(|beyond| *beyond > 0.0).fold(0.0, f64::max))
    }

    fn gaussians_of(&self, cloud: Cloud) -> &'a Gaussians {
        match cloud {
            Cloud::Templates => &self.levels.templates,
            Cloud::Own { .. } => &self.levels.own,
            Cloud::Background => &self.levels.background,
        }
    }

    /// Appends the row of a block or of one of its levels, which is within the block's ball; `balls` are those of its chunks.
    fn push_paged(&mut self, block: &Ball, balls: &[Ball], count: u32, sigma_factor: f64) -> Result<(), RenderError> {
        let sigma_max = sigma_factor * f64::from(balls.iter().fold(0.0, |most, ball| ball[4].max(most)));
        let bound = Bound { center: Vec3::from_slice(block).as_dvec3(), radius: block[3].into(), sigma_max };
        let first_chunk = self.tables.push_balls(balls, count, sigma_factor, self.chunk_size);
        let range = SourceRange { first: 0, count };
        let source = Source::of_background(CloudSize::default(), CloudSize::default(), range);
        let owner = Owner::without_color(self.levels.coarser.len() as u32);
        let place = Placement::at_origin(None);
        self.tables.push_instance(&place, Bounded { first_chunk, bound }, source, owner, self.chunk_size)?;
        if let Some(row) = self.tables.instances.last_mut() {
            // Its ball is the block's to the bit: levels are chosen by it.
            (row.bound_radius, row.source_count) = (block[3], 0);
        }
        Ok(())
    }

    /// First chunk and bound of a range.
    fn chunks_of(&mut self, cloud: Cloud, range: SourceRange) -> Bounded {
        let (gaussians, chunk_size) = (self.gaussians_of(cloud), self.chunk_size);
        *self.known.entry((cloud, range)).or_insert_with(|| self.tables.push_chunks(gaussians, range, chunk_size))
    }
}

fn source_of(levels: &Levels, part: &Part) -> Source {
    let [templates, own, background] = [&levels.templates, &levels.own, &levels.background].map(CloudSize::of);
    match part.cloud {
        Cloud::Templates => Source::of_posed(templates, part.range, 0),
        Cloud::Own { local_before } => {
            let first = templates.len as u32 + part.range.first;
            Source::of_posed(templates, SourceRange { first, ..part.range }, local_before)
        }
        Cloud::Background => {
            let posed = CloudSize { len: templates.len + own.len, ..templates };
            Source::of_background(posed, background, part.range)
        }
    }
}
