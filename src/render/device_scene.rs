//! The scene in device memory: source Gaussians (templates, then background) as structure of arrays, instances, chunk
//! bounds, offsets. Immutable; one template serves all its instances.

use std::sync::Arc;

use glam::DVec3;

use crate::gpu::interface::constants::NO_OFFSET;
use crate::gpu::interface::types;
use crate::gpu::staging::upload;
use crate::gpu::{Buffer, Gpu};
use crate::math::similarity::Similarity;
use crate::scene::gaussians::sh_coefficients;
use crate::scene::{Gaussians, InstancedScene};

use super::error::RenderError;

/// Gaussians of the clouds of a scene, their SH degrees, and its offset records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneCounts {
    /// Gaussians of the templates.
    pub templates: usize,
    /// SH degree of the templates.
    pub template_sh_degree: u32,
    /// Gaussians of the background.
    pub background: usize,
    /// SH degree of the background.
    pub background_sh_degree: u32,
    /// Offset records.
    pub offsets: usize,
}

/// A scene on the device.
pub struct DeviceScene {
    /// Instances in file order; the background is the last one if the scene has background Gaussians.
    pub instances: Buffer<types::Instance>,
    /// Bounds of chunks of `chunk_size` source Gaussians, template by template, background last.
    pub chunks: Buffer<types::Chunk>,
    /// Source means.
    pub means: Buffer<[f32; 3]>,
    /// Source quaternions wxyz.
    pub quats: Buffer<[f32; 4]>,
    /// Source log standard deviations.
    pub log_scales: Buffer<[f32; 3]>,
    /// Source opacity logits.
    pub opacity_logits: Buffer<f32>,
    /// Source SH by band: 1, 3, 5, 7 coefficients per Gaussian of the clouds that have the band (see
    /// `Instance::first_in_band`). Bands are apart because one binding is at most 128 MiB on some drivers.
    pub sh_bands: [Buffer<[f32; 3]>; 4],
    /// Offset means.
    pub offset_means: Buffer<[f32; 3]>,
    /// Offsets of SH coefficient 0.
    pub offset_sh_dc: Buffer<[f32; 3]>,
    /// Offsets of opacity logits.
    pub offset_opacity_logits: Buffer<f32>,
    /// Number of instances, background included.
    pub instance_count: u32,
    /// SH degree of the bands.
    pub sh_degree: u32,
    /// Gaussians per chunk.
    pub chunk_size: u32,
    /// (instance, chunk) pairs in all: the most that culling can pass on.
    pub chunk_pairs: u64,
    /// Gaussians after expanding all instances.
    pub expanded_len: u64,
    /// The scene's own antialias flag.
    pub antialias: bool,
    /// How many there are of what.
    pub counts: SceneCounts,
}

/// What chunk culling may assume.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Bounds {
    /// The means as they are.
    Tight,
    /// Nothing: means will move.
    Everywhere,
}

/// A radius that no frustum test excludes, and that stays finite in its products with focal lengths.
const RADIUS_EVERYWHERE: f32 = 1e25;

/// A ball around means, with the largest standard deviation inside.
struct Bound {
    center: DVec3,
    radius: f64,
    sigma_max: f64,
}

/// Chunk and instance tables before upload.
#[derive(Default)]
struct Tables {
    instances: Vec<types::Instance>,
    chunks: Vec<types::Chunk>,
    chunk_pairs: u64,
    flat: u64,
}

impl DeviceScene {
    /// Uploads a scene for kernels with `chunk_size` threads per work-group.
    ///
    /// # Errors
    /// Inconsistent indices, more than 2^32 - 1 expanded Gaussians, or a buffer beyond the device's limits.
    pub fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        Self::with_bounds(gpu, scene, chunk_size, Bounds::Tight)
    }

    /// As [`DeviceScene::new`], but nothing is culled by chunk: for training, where means move every step.
    pub fn unbounded(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        Self::with_bounds(gpu, scene, chunk_size, Bounds::Everywhere)
    }

    fn with_bounds(
        gpu: &Arc<Gpu>,
        scene: &InstancedScene,
        chunk_size: u32,
        bounds: Bounds,
    ) -> Result<Self, RenderError> {
        scene.validate()?;
        let sh_degree = scene.sh_degree();
        let pool = |field: fn(&Gaussians) -> usize| field(&scene.templates) + field(&scene.background);
        check_limit(gpu, pool(Gaussians::len), sh_degree)?;
        let mut tables = build_tables(scene, chunk_size)?;
        if bounds == Bounds::Everywhere {
            tables.widen();
        }
        let band = |gpu: &Arc<Gpu>, l: u32| upload(gpu, &format!("sh band {l}"), &sh_band(scene, l));
        Ok(Self {
            instances: upload(gpu, "instances", &tables.instances)?,
            chunks: upload(gpu, "chunks", &tables.chunks)?,
            means: upload(gpu, "means", &joined(scene, |g| &g.means))?,
            quats: upload(gpu, "quats", &joined(scene, |g| &g.quats))?,
            log_scales: upload(gpu, "log_scales", &joined(scene, |g| &g.log_scales))?,
            opacity_logits: upload(gpu, "opacity_logits", &joined(scene, |g| &g.opacity_logits))?,
            sh_bands: [band(gpu, 0)?, band(gpu, 1)?, band(gpu, 2)?, band(gpu, 3)?],
            offset_means: upload(gpu, "offset means", &scene.offsets.means)?,
            offset_sh_dc: upload(gpu, "offset sh_dc", &scene.offsets.sh_dc)?,
            offset_opacity_logits: upload(gpu, "offset opacity_logits", &scene.offsets.opacity_logits)?,
            instance_count: tables.instances.len() as u32,
            sh_degree,
            chunk_size,
            chunk_pairs: tables.chunk_pairs,
            expanded_len: tables.flat,
            antialias: scene.antialias,
            counts: SceneCounts {
                templates: scene.templates.len(),
                template_sh_degree: scene.templates.sh_degree,
                background: scene.background.len(),
                background_sh_degree: scene.background.sh_degree,
                offsets: scene.offsets.len(),
            },
        })
    }

    /// Makes the tables of a scene that is only a background those of one with `count` Gaussians. The caller replaces
    /// the parameter buffers. As with [`DeviceScene::unbounded`], nothing is culled by chunk.
    ///
    /// # Errors
    /// More Gaussians than the device takes.
    ///
    /// # Panics
    /// If the scene has templates.
    pub fn resize_background(&mut self, gpu: &Arc<Gpu>, count: usize) -> Result<(), RenderError> {
        assert_eq!(self.counts.templates, 0, "only plain clouds change their number of Gaussians");
        check_limit(gpu, count, self.sh_degree)?;
        let mut tables = Tables::default();
        let place = Placement { world_from_template: &Similarity::IDENTITY, first_offset: NO_OFFSET, max_offset: 0.0 };
        let bound = Bound { center: DVec3::ZERO, radius: 0.0, sigma_max: 0.0 };
        let source = Source {
            first: 0,
            count: count as u32,
            sh_degree: self.counts.background_sh_degree,
            first_in_band: [0; 3],
        };
        tables.push_instance(&place, &bound, source, 0, self.chunk_size)?;
        tables.chunks = vec![types::Chunk::default(); count.div_ceil(self.chunk_size as usize)];
        tables.widen();
        self.instances = upload(gpu, "instances", &tables.instances)?;
        self.chunks = upload(gpu, "chunks", &tables.chunks)?;
        self.instance_count = tables.instances.len() as u32;
        self.chunk_pairs = tables.chunk_pairs;
        self.expanded_len = tables.flat;
        self.counts.background = count;
        Ok(())
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.instances.bytes()
            + self.chunks.bytes()
            + self.means.bytes()
            + self.quats.bytes()
            + self.log_scales.bytes()
            + self.opacity_logits.bytes()
            + self.sh_bands.iter().map(Buffer::bytes).sum::<u64>()
            + self.offset_means.bytes()
            + self.offset_sh_dc.bytes()
            + self.offset_opacity_logits.bytes()
    }
}

/// Bytes of a [`DeviceScene`] by what they are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PlannedBytes {
    /// Gaussians of the templates.
    pub templates: u64,
    /// Gaussians of the background.
    pub background: u64,
    /// Offset records.
    pub offsets: u64,
    /// The instance table, with one entry for the background.
    pub instances: u64,
    /// Chunk bounds.
    pub chunks: u64,
    /// Single elements that stand for empty arrays, since Vulkan has no empty buffers.
    pub unused: u64,
}

impl PlannedBytes {
    /// What [`DeviceScene::bytes`] will be.
    pub fn total(&self) -> u64 {
        self.templates + self.background + self.offsets + self.instances + self.chunks + self.unused
    }
}

/// What [`DeviceScene::new`] will allocate, without a device. The scene must be valid.
pub fn planned_bytes(scene: &InstancedScene, chunk_size: u32) -> PlannedBytes {
    // Mean, quaternion, log scales, opacity logit, SH; an offset record is mean, SH 0, logit.
    let gaussian_bytes = |degree: u32| 4 * (3 + 4 + 3 + 1 + 3 * sh_coefficients(degree) as u64);
    let (templates, background) = (scene.templates.len() as u64, scene.background.len() as u64);
    let chunks_of = |count: u32| u64::from(count.div_ceil(chunk_size));
    let chunks: u64 =
        scene.template_ranges.iter().map(|r| chunks_of(r.count)).sum::<u64>() + chunks_of(background as u32);
    let instances = scene.instances.len() as u64 + u64::from(background > 0);
    let chunk_bytes = size_of::<types::Chunk>() as u64;
    let instance_bytes = size_of::<types::Instance>() as u64;
    let placeholder = |len: u64, bytes: u64| if len == 0 { bytes } else { 0 };
    let in_band = |l: u32| {
        let clouds = [&scene.templates, &scene.background];
        clouds.into_iter().filter(|c| c.sh_degree >= l).map(|c| c.len() as u64).sum::<u64>()
    };
    PlannedBytes {
        templates: templates * gaussian_bytes(scene.templates.sh_degree),
        background: background * gaussian_bytes(scene.background.sh_degree),
        offsets: scene.offsets.tensor_bytes(),
        instances: instances * instance_bytes,
        chunks: chunks * chunk_bytes,
        unused: placeholder(templates + background, 44)
            + (0..4).map(|l| placeholder(in_band(l), 12)).sum::<u64>()
            + placeholder(scene.offsets.len() as u64, 28)
            + placeholder(instances, instance_bytes)
            + placeholder(chunks, chunk_bytes),
    }
}

/// Says the limit in Gaussians before anything is built: the largest array has a quaternion (16 bytes) or the highest SH
/// band (2 l + 1 colours of 12 bytes) per Gaussian.
fn check_limit(gpu: &Gpu, count: usize, sh_degree: u32) -> Result<(), RenderError> {
    let largest = u64::from(16.max(12 * (2 * sh_degree + 1)));
    let limit = u64::from(u32::MAX - 1).min(gpu.caps().max_storage_bytes / largest);
    if count as u64 > limit {
        return Err(RenderError::TooMany { what: "source Gaussians", needed: count as u64, limit });
    }
    Ok(())
}

fn joined<T: Copy>(scene: &InstancedScene, field: fn(&Gaussians) -> &Vec<T>) -> Vec<T> {
    [field(&scene.templates).as_slice(), field(&scene.background).as_slice()].concat()
}

/// Coefficients l^2 .. (l+1)^2 of every source Gaussian whose cloud has them.
fn sh_band(scene: &InstancedScene, l: u32) -> Vec<[f32; 3]> {
    let first = if l == 0 { 0 } else { sh_coefficients(l - 1) };
    let mut out = Vec::new();
    for cloud in [&scene.templates, &scene.background] {
        if cloud.sh_degree >= l {
            (0..cloud.len()).for_each(|i| out.extend_from_slice(&cloud.sh_of(i)[first..sh_coefficients(l)]));
        }
    }
    out
}

fn build_tables(scene: &InstancedScene, chunk_size: u32) -> Result<Tables, RenderError> {
    let mut tables = Tables::default();
    let mut template_bounds = Vec::new();
    for range in &scene.template_ranges {
        let first_chunk = tables.chunks.len() as u32;
        let bound = tables.push_chunks(&scene.templates, range.first as usize, range.count as usize, chunk_size);
        template_bounds.push((first_chunk, bound));
    }
    for instance in &scene.instances {
        let range = scene.template_ranges[instance.template as usize];
        let (first_chunk, bound) = &template_bounds[instance.template as usize];
        let max_offset = instance.first_offset.map_or(0.0, |first| {
            let run = &scene.offsets.means[first as usize..(first + range.count) as usize];
            run.iter().map(|d| dvec(*d).length()).fold(0.0, f64::max)
        });
        let place = Placement {
            world_from_template: &instance.world_from_template,
            first_offset: instance.first_offset.unwrap_or(NO_OFFSET),
            max_offset,
        };
        let source = Source {
            first: range.first,
            count: range.count,
            sh_degree: scene.templates.sh_degree,
            first_in_band: [range.first; 3],
        };
        tables.push_instance(&place, bound, source, *first_chunk, chunk_size)?;
    }
    if !scene.background.is_empty() {
        let first_chunk = tables.chunks.len() as u32;
        let count = scene.background.len();
        let bound = tables.push_chunks(&scene.background, 0, count, chunk_size);
        let place = Placement { world_from_template: &Similarity::IDENTITY, first_offset: NO_OFFSET, max_offset: 0.0 };
        let source = Source {
            first: scene.templates.len() as u32,
            count: count as u32,
            sh_degree: scene.background.sh_degree,
            first_in_band: [1, 2, 3]
                .map(|l| if scene.templates.sh_degree >= l { scene.templates.len() as u32 } else { 0 }),
        };
        tables.push_instance(&place, &bound, source, first_chunk, chunk_size)?;
    }
    Ok(tables)
}

/// Which source Gaussians an instance shows.
struct Source {
    first: u32,
    count: u32,
    sh_degree: u32,
    first_in_band: [u32; 3],
}

/// Where an instance stands and which offsets it has.
struct Placement<'a> {
    world_from_template: &'a Similarity,
    first_offset: u32,
    max_offset: f64,
}

impl Tables {
    /// Makes every bound hold whatever the means become.
    fn widen(&mut self) {
        self.chunks.iter_mut().for_each(|chunk| chunk.radius = RADIUS_EVERYWHERE);
        self.instances.iter_mut().for_each(|instance| instance.bound_radius = RADIUS_EVERYWHERE);
    }

    /// Appends the chunks of one range and returns the bound of all of it.
    fn push_chunks(&mut self, cloud: &Gaussians, first: usize, count: usize, chunk_size: u32) -> Bound {
        for start in (0..count).step_by(chunk_size as usize) {
            let size = (count - start).min(chunk_size as usize);
            let bound = bound_of(cloud, first + start, size);
            self.chunks.push(types::Chunk {
                center: bound.center.as_vec3().to_array(),
                radius: round_up(bound.radius),
                sigma_max: round_up(bound.sigma_max),
            });
        }
        bound_of(cloud, first, count)
    }

    fn push_instance(
        &mut self,
        place: &Placement<'_>,
        bound: &Bound,
        source: Source,
        first_chunk: u32,
        chunk_size: u32,
    ) -> Result<(), RenderError> {
        self.instances.push(types::Instance {
            world_from_template: place.world_from_template.rows(),
            bound_center: bound.center.as_vec3().to_array(),
            bound_radius: round_up(bound.radius),
            sigma_max: round_up(bound.sigma_max),
            max_offset: round_up(place.max_offset),
            scale: round_up(place.world_from_template.scale()),
            first_source: source.first,
            source_count: source.count,
            first_offset: place.first_offset,
            first_chunk,
            sh_degree: source.sh_degree,
            first_in_band: source.first_in_band,
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

/// To f32 and a little more, so that a bound stays a bound.
fn round_up(value: f64) -> f32 {
    (value * (1.0 + 1e-6)) as f32
}

fn bound_of(cloud: &Gaussians, first: usize, count: usize) -> Bound {
    let means = &cloud.means[first..first + count];
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for mean in means {
        low = low.min(dvec(*mean));
        high = high.max(dvec(*mean));
    }
    // The centre is stored as f32: measure the radius from what is stored.
    let center = if count == 0 { DVec3::ZERO } else { ((low + high) * 0.5).as_vec3().as_dvec3() };
    let radius = means.iter().map(|m| dvec(*m).distance(center)).fold(0.0, f64::max);
    let scales = &cloud.log_scales[first..first + count];
    let log_max = scales.iter().flatten().copied().fold(f32::NEG_INFINITY, f32::max);
    Bound { center, radius, sigma_max: f64::from(log_max).exp() }
}
