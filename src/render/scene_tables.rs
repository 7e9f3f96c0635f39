//! Instance and chunk tables of a scene: transforms, bounds for culling, and ranges of source Gaussians.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::gpu::interface::constants::{NO_COLOR, NO_OFFSET};
use crate::gpu::interface::types;
use crate::math::similarity::Similarity;
use crate::scene::bound::{Bound, round_up};
use crate::scene::lod::NO_NEXT_CELL;
use crate::scene::lod::pages::{Ball, ball_around, chunks_of};
use crate::scene::source_layout::CloudSize;
use crate::scene::{Gaussians, InstancedScene, Offsets, SourceLayout, SourceRange};

use super::error::RenderError;

/// A radius that passes every frustum test and stays finite in products with focal lengths.
const RADIUS_EVERYWHERE: f32 = 1e25;

/// Chunk and instance tables before upload.
#[derive(Default)]
pub(super) struct Tables {
    /// Rows of instances in file order: what each has of its template, then what it has of its own, if anything. The
    /// background's row is the last.
    pub(super) instances: Vec<types::Instance>,
    /// Bounds of all chunks.
    pub(super) chunks: Vec<types::Chunk>,
    /// Total number of (instance, chunk) pairs.
    pub(super) chunk_pairs: u64,
    /// Gaussians after expanding all instances.
    pub(super) flat: u64,
}

/// The tables of a valid scene for chunks of `chunk_size` Gaussians.
///
/// # Errors
/// More expanded Gaussians than a u32 can count.
pub(super) fn build_tables(scene: &InstancedScene, chunk_size: u32) -> Result<Tables, RenderError> {
    let layout = SourceLayout::of(scene);
    let mut tables = Tables::default();
    let mut template_bounds = Vec::new();
    for range in &scene.template_ranges {
        template_bounds.push(tables.push_chunks(&scene.templates, *range, chunk_size));
    }
    let colored = !scene.color_from_template.is_empty();
    // Instances may share own Gaussians, as copies do.
    let mut own_bounds: BTreeMap<SourceRange, Bounded> = BTreeMap::new();
    for (k, instance) in scene.instances.iter().enumerate() {
        let range = scene.template_ranges[instance.template as usize];
        let first_offset = instance.first_offset;
        let place = Placement::of(&instance.world_from_template, &scene.offsets, first_offset, range.count);
        let source = Source::of_posed(layout.templates, range, 0);
        let owner = Owner::of_template(k as u32, colored);
        tables.push_instance(&place, template_bounds[instance.template as usize], source, owner, chunk_size)?;
        let own = scene.own_range(k);
        if own.count > 0 {
            let place = Placement::of(&instance.world_from_template, &scene.offsets, None, own.count);
            let bound = *own_bounds.entry(own).or_insert_with(|| tables.push_chunks(&scene.own, own, chunk_size));
            let source = Source::of_posed(layout.templates, layout.own_sources(k), range.count);
            tables.push_instance(&place, bound, source, Owner::without_color(k as u32), chunk_size)?;
        }
    }
    if !scene.background.is_empty() {
        let range = SourceRange { first: 0, count: scene.background.len() as u32 };
        let bound = tables.push_chunks(&scene.background, range, chunk_size);
        let source = Source::of_background(layout.posed(), layout.background, range);
        let owner = Owner::without_color(scene.instances.len() as u32);
        tables.push_instance(&Placement::at_origin(None), bound, source, owner, chunk_size)?;
    }
    Ok(tables)
}

/// The tables of a layout for Gaussians that move: nothing is culled by chunk, and every transform is the identity.
///
/// # Errors
/// More expanded Gaussians than a u32 can count.
pub(super) fn unbounded_tables(layout: &SourceLayout, colored: bool, chunk_size: u32) -> Result<Tables, RenderError> {
    let mut tables = Tables::default();
    let of_templates: Vec<Bounded> =
        layout.template_ranges.iter().map(|range| tables.push_unbounded(range.count, chunk_size)).collect();
    for (k, instance) in layout.instances.iter().enumerate() {
        let range = layout.template_ranges[instance.template as usize];
        let source = Source::of_posed(layout.templates, range, 0);
        let owner = Owner::of_template(k as u32, colored);
        let place = Placement::at_origin(instance.first_offset);
        tables.push_instance(&place, of_templates[instance.template as usize], source, owner, chunk_size)?;
        let own = layout.own_sources(k);
        if own.count > 0 {
            let bound = tables.push_unbounded(own.count, chunk_size);
            let source = Source::of_posed(layout.templates, own, range.count);
            let owner = Owner::without_color(k as u32);
            tables.push_instance(&Placement::at_origin(None), bound, source, owner, chunk_size)?;
        }
    }
    let background = SourceRange { first: 0, count: layout.background.len as u32 };
    if background.count > 0 {
        let bound = tables.push_unbounded(background.count, chunk_size);
        let source = Source::of_background(layout.posed(), layout.background, background);
        let owner = Owner::without_color(layout.instances.len() as u32);
        tables.push_instance(&Placement::at_origin(None), bound, source, owner, chunk_size)?;
    }
    tables.widen();
    Ok(tables)
}

/// The chunks of a range of Gaussians, with a bound around all of it.
#[derive(Clone, Copy)]
pub(super) struct Bounded {
    /// Index of the first chunk.
    pub(super) first_chunk: u32,
    /// Bound of the range.
    pub(super) bound: Bound,
}

/// The instance that a row belongs to.
#[derive(Clone, Copy)]
pub(super) struct Owner {
    instance: u32,
    color: u32,
}

impl Owner {
    /// Owner of a row that shows a template; `colored` = instances have colour matrices.
    pub(super) fn of_template(instance: u32, colored: bool) -> Self {
        Self { instance, color: if colored { instance } else { NO_COLOR } }
    }

    /// Owner of a row whose colours no matrix changes: own Gaussians, or the background.
    pub(super) fn without_color(instance: u32) -> Self {
        Self { instance, color: NO_COLOR }
    }
}

/// The source Gaussians that a row shows.
pub(super) struct Source {
    /// Number of the instance's Gaussians in rows before this one.
    local_before: u32,
    first: u32,
    count: u32,
    sh_degree: u32,
    first_in_band: [u32; 3],
}

impl Source {
    /// The source of a range of the templates or of instances' own Gaussians, by index in the source pool.
    pub(super) fn of_posed(templates: CloudSize, range: SourceRange, local_before: u32) -> Self {
        let SourceRange { first, count } = range;
        Self { local_before, first, count, sh_degree: templates.sh_degree, first_in_band: [first; 3] }
    }

    /// The source of a range of the background, which follows the posed Gaussians in the bands that these have.
    pub(super) fn of_background(posed: CloudSize, background: CloudSize, range: SourceRange) -> Self {
        let before = |l: u32| if posed.sh_degree >= l { posed.len as u32 } else { 0 };
        Self {
            local_before: 0,
            first: posed.len as u32 + range.first,
            count: range.count,
            sh_degree: background.sh_degree,
            first_in_band: [1, 2, 3].map(|l| before(l) + range.first),
        }
    }
}

/// Transform and offsets of an instance.
pub(super) struct Placement<'a> {
    world_from_template: &'a Similarity,
    first_offset: u32,
    max_offset: f64,
    /// Logarithm of the largest factor of the offsets on a standard deviation, at least 0.
    log_growth: f64,
}

impl<'a> Placement<'a> {
    /// Placement by the identity: of the background's instance, or of one whose transform is written later.
    pub(super) fn at_origin(first_offset: Option<u32>) -> Self {
        Self {
            world_from_template: &Similarity::IDENTITY,
            first_offset: first_offset.unwrap_or(NO_OFFSET),
            max_offset: 0.0,
            log_growth: 0.0,
        }
    }

    /// Placement of an instance with a run of `count` offsets, if it has any.
    pub(super) fn of(
        world_from_template: &'a Similarity,
        offsets: &Offsets,
        first_offset: Option<u32>,
        count: u32,
    ) -> Self {
        let run = first_offset.map_or(0..0, |first| first as usize..(first + count) as usize);
        let scales = offsets.log_scales.get(run.clone()).unwrap_or_default();
        Self {
            world_from_template,
            first_offset: first_offset.unwrap_or(NO_OFFSET),
            max_offset: offsets.means[run].iter().map(|d| dvec(*d).length()).fold(0.0, f64::max),
            log_growth: scales.iter().flatten().fold(0.0, |most, &offset| f64::from(offset).max(most)),
        }
    }
}

impl Tables {
    /// Makes every bound hold for any means.
    pub(super) fn widen(&mut self) {
        self.chunks.iter_mut().for_each(|chunk| chunk.radius = RADIUS_EVERYWHERE);
        self.instances.iter_mut().for_each(|instance| instance.bound_radius = RADIUS_EVERYWHERE);
    }

    /// Appends the chunks of a range.
    pub(super) fn push_chunks(&mut self, cloud: &Gaussians, range: SourceRange, chunk_size: u32) -> Bounded {
        let first_chunk = self.chunks.len() as u32;
        let (first, count) = (range.first as usize, range.count as usize);
        for start in (0..count).step_by(chunk_size as usize) {
            let size = (count - start).min(chunk_size as usize);
            let bound = Bound::of(cloud, first + start, size);
            self.chunks.push(types::Chunk {
                center: bound.center.as_vec3().to_array(),
                radius: round_up(bound.radius),
                sigma_max: round_up(bound.sigma_max),
            });
        }
        Bounded { first_chunk, bound: Bound::of(cloud, first, count) }
    }

    /// Appends chunks for `count` Gaussians, of which each 256 have one of `balls`; returns the first. Standard deviations get
    /// `sigma_factor`.
    pub(super) fn push_balls(&mut self, balls: &[Ball], count: u32, sigma_factor: f64, chunk_size: u32) -> u32 {
        let first_chunk = self.chunks.len() as u32;
        for start in (0..count).step_by(chunk_size as usize) {
            let end = count.min(start + chunk_size);
            // A chunk that is smaller has the ball of all 256, and a larger one a ball around those of its parts.
            let [x, y, z, radius, sigma_max] = match &balls[chunks_of(start + 1) - 1..chunks_of(end)] {
                [ball] => *ball,
                several => ball_around(several),
            };
            let sigma_max = round_up(sigma_factor * f64::from(sigma_max));
            self.chunks.push(types::Chunk { center: [x, y, z], radius, sigma_max });
        }
        first_chunk
    }

    /// Appends chunks for `count` Gaussians whose bounds are not known.
    fn push_unbounded(&mut self, count: u32, chunk_size: u32) -> Bounded {
        let first_chunk = self.chunks.len() as u32;
        let chunks = self.chunks.len() + count.div_ceil(chunk_size) as usize;
        self.chunks.resize(chunks, types::Chunk::default());
        Bounded { first_chunk, bound: Bound { center: DVec3::ZERO, radius: 0.0, sigma_max: 0.0 } }
    }

    /// Appends a row at full detail.
    ///
    /// # Errors
    /// More expanded Gaussians than a u32 can count.
    pub(super) fn push_instance(
        &mut self,
        place: &Placement<'_>,
        Bounded { first_chunk, bound }: Bounded,
        source: Source,
        owner: Owner,
        chunk_size: u32,
    ) -> Result<(), RenderError> {
        self.instances.push(types::Instance {
            world_from_template: place.world_from_template.rows(),
            bound_center: bound.center.as_vec3().to_array(),
            bound_radius: round_up(bound.radius),
            sigma_max: round_up(bound.sigma_max),
            max_offset: round_up(place.max_offset),
            sigma_growth: round_up(place.log_growth.exp()),
            scale: scale_bound(place.world_from_template),
            first_source: source.first,
            source_count: source.count,
            first_offset: place.first_offset,
            first_chunk,
            sh_degree: source.sh_degree,
            first_in_band: source.first_in_band,
            cell: 0.0,
            next_cell: NO_NEXT_CELL,
            owner: owner.instance,
            color: owner.color,
            local_before: source.local_before,
        });
        self.chunk_pairs += u64::from(source.count.div_ceil(chunk_size));
        self.flat += u64::from(source.count);
        let limit = u64::from(u32::MAX);
        if self.flat > limit {
            return Err(RenderError::TooMany { what: "expanded Gaussians", needed: self.flat, limit });
        }
        Ok(())
    }
}

fn dvec(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from(v).as_dvec3()
}

/// Largest factor of a transform on lengths, for bounds.
pub(super) fn scale_bound(world_from_template: &Similarity) -> f32 {
    round_up(world_from_template.scale())
}
