//! Instance and chunk tables of a scene with levels of detail: every level is an instance, with its owner and cell
//! size.

use std::collections::HashMap;

use crate::scene::SourceRange;
use crate::scene::lod::{Cloud, Levels, Part};
use crate::scene::source_layout::CloudSize;

use super::error::RenderError;
use super::scene_tables::{Bound, Bounded, Owner, Placement, Source, Tables};

/// The tables of a scene with levels for chunks of `chunk_size` Gaussians.
///
/// # Errors
/// More expanded Gaussians, levels included, than a u32 can count.
pub(super) fn build_level_tables(levels: &Levels, chunk_size: u32) -> Result<Tables, RenderError> {
    let mut tables = Tables::default();
    let mut known: HashMap<(Cloud, SourceRange), Bounded> = HashMap::new();
    let colored = !levels.color_from_template.is_empty();
    for part in &levels.parts {
        let full = chunks_of(&mut tables, &mut known, levels, part.cloud, part.full, chunk_size).bound;
        let shown = chunks_of(&mut tables, &mut known, levels, part.cloud, part.range, chunk_size);
        // Merged means lie within the ball of the Gaussians they are made of, so all levels can have the same ball, and
        // thus the same distance from the camera.
        let bounded = Bounded { bound: Bound { sigma_max: shown.bound.sigma_max, ..full }, ..shown };
        let place = Placement::of(&part.world_from_template, &levels.offsets, part.first_offset, part.range.count);
        let owner = match part.cloud {
            Cloud::Templates => Owner::of_template(part.owner, colored),
            Cloud::Own { .. } | Cloud::Background => Owner::without_color(part.owner),
        };
        tables.push_instance(&place, bounded, source_of(levels, part), owner, chunk_size)?;
        if let Some(entry) = tables.instances.last_mut() {
            (entry.cell, entry.next_cell) = (part.cell, part.next_cell);
        }
    }
    Ok(tables)
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

/// First chunk and bound of a range; instances of one template share its chunks.
fn chunks_of(
    tables: &mut Tables,
    known: &mut HashMap<(Cloud, SourceRange), Bounded>,
    levels: &Levels,
    cloud: Cloud,
    range: SourceRange,
    chunk_size: u32,
) -> Bounded {
    *known.entry((cloud, range)).or_insert_with(|| {
        let gaussians = match cloud {
            Cloud::Templates => &levels.templates,
            Cloud::Own { .. } => &levels.own,
            Cloud::Background => &levels.background,
        };
        tables.push_chunks(gaussians, range, chunk_size)
    })
}
