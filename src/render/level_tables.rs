//! Instance and chunk tables of a scene with levels of detail: every level is an instance, with its owner and cell
//! size.

use std::collections::HashMap;

use crate::scene::TemplateRange;
use crate::scene::lod::{Cloud, Levels, Part};
use crate::scene::source_layout::CloudSize;

use super::error::RenderError;
use super::scene_tables::{Bound, Placement, Source, Tables};

/// The tables of a scene with levels for chunks of `chunk_size` Gaussians.
///
/// # Errors
/// More expanded Gaussians, levels included, than a u32 can count.
pub(super) fn build_level_tables(levels: &Levels, chunk_size: u32) -> Result<Tables, RenderError> {
    let mut tables = Tables::default();
    let mut known: HashMap<(Cloud, TemplateRange), (u32, Bound)> = HashMap::new();
    for part in &levels.parts {
        let (_, full) = chunks_of(&mut tables, &mut known, levels, part.cloud, part.full, chunk_size);
        let (first_chunk, own) = chunks_of(&mut tables, &mut known, levels, part.cloud, part.range, chunk_size);
        // Merged means lie within the ball of the Gaussians they are made of, so all levels can have the same ball, and
        // thus the same distance from the camera.
        let bound = Bound { sigma_max: own.sigma_max, ..full };
        let place = Placement::of(&part.world_from_template, &levels.offsets, part.first_offset, part.range.count);
        tables.push_instance(&place, &bound, source_of(levels, part), first_chunk, chunk_size)?;
        if let Some(entry) = tables.instances.last_mut() {
            (entry.cell, entry.next_cell, entry.owner) = (part.cell, part.next_cell, part.owner);
        }
    }
    Ok(tables)
}

fn source_of(levels: &Levels, part: &Part) -> Source {
    let [templates, background] = [&levels.templates, &levels.background].map(CloudSize::of);
    match part.cloud {
        Cloud::Templates => Source::of_templates(templates, part.range),
        Cloud::Background => Source::of_background(templates, background, part.range),
    }
}

/// First chunk and bound of a range; instances of one template share its chunks.
fn chunks_of(
    tables: &mut Tables,
    known: &mut HashMap<(Cloud, TemplateRange), (u32, Bound)>,
    levels: &Levels,
    cloud: Cloud,
    range: TemplateRange,
    chunk_size: u32,
) -> (u32, Bound) {
    *known.entry((cloud, range)).or_insert_with(|| {
        let gaussians = match cloud {
            Cloud::Templates => &levels.templates,
            Cloud::Background => &levels.background,
        };
        let first_chunk = tables.chunks.len() as u32;
        (first_chunk, tables.push_chunks(gaussians, range.first as usize, range.count as usize, chunk_size))
    })
}
