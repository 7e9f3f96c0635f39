//! The scene in device memory: source Gaussians (templates, instances' own, background) as structure of arrays, instances,
//! chunk bounds, offsets. All instances share their template's arrays; edits change only rows of the instance table.
//!
//! A row of the instance table shows one range of source Gaussians. An instance has a row for its template, after it one for
//! its own Gaussians if it has any, and more for levels of detail.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use crate::gpu::interface::types;
use crate::gpu::staging::{download, upload, write};
use crate::gpu::{Buffer, BufferPart, Gpu, GpuError, Home, Recorder};
use crate::kernels::SceneTraits;
use crate::math::similarity::Similarity;
use crate::scene::lod::Levels;
use crate::scene::lod::pages::PageTable;
use crate::scene::parameters::Rows;
use crate::scene::source_layout::CloudSize;
use crate::scene::{
    DevicePrecision, Gaussians, InstancedScene, Owner, Parameter, ParameterSet, PixelFilter, SourceLayout, SourceRange,
};

use super::error::RenderError;
use super::instance_table::{InstanceTable, RecordedChanges};
use super::level_tables::{PagedTables, build_level_tables, build_paged_tables};
use super::packed_buffers::{PackedBuffers, planned_packed_bytes, stays_f32};
use super::packed_scene::PackedScene;
use super::parameter_buffers::{ParameterBuffers, planned_parameter_bytes};
use super::scene_tables::{Tables, build_tables, scale_bound, unbounded_tables};
use super::source_windows::{SourceWindow, SourceWindows};

/// Numbers of Gaussians, SH degrees and offset records of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneCounts {
    /// Gaussians of the templates.
    pub templates: usize,
    /// SH degree of the templates and of instances' own Gaussians.
    pub template_sh_degree: u32,
    /// Gaussians of the background; in pages, of its stand-ins and of all page slots.
    pub background: usize,
    /// SH degree of the background.
    pub background_sh_degree: u32,
    /// Rows of every parameter: `[of templates and instances' own Gaussians, of the background]`, or `[of offsets, 0]`.
    pub rows: ParameterSet<Rows>,
}

/// A scene in device memory.
pub struct DeviceScene {
    /// Rows of instances in file order; that of the background is the last if the scene has background Gaussians.
    pub instances: Buffer<types::Instance>,
    /// Bounds of chunks of `chunk_size` source Gaussians: templates and instances' own, background last.
    pub chunks: Buffer<types::Chunk>,
    /// The parameters that training may change, except poses: source Gaussians and offsets. A packed scene has only means and
    /// colour matrices here.
    pub parameters: ParameterBuffers,
    /// The other parameters of a packed scene.
    pub packed: PackedBuffers,
    /// How the scene is held.
    pub precision: DevicePrecision,
    /// Where `parameters` and `packed` live.
    pub home: Home,
    /// Number of rows, background included.
    pub instance_count: u32,
    /// Largest SH degree of templates and background.
    pub sh_degree: u32,
    /// Gaussians per chunk.
    pub chunk_size: u32,
    /// Total number of (instance, chunk) pairs: the most that culling can pass on.
    pub chunk_pairs: u64,
    /// Gaussians after expanding all instances.
    pub expanded_len: u64,
    /// Where arrays of source Gaussians are larger than a binding, the windows in which kernels see them; else one.
    pub windows: SourceWindows,
    /// The scene's own pixel filter.
    pub pixel_filter: PixelFilter,
    /// Numbers of Gaussians and offsets, levels of detail included.
    pub counts: SceneCounts,
    /// True in training if instances may get own Gaussians: then the backward pass keeps statistics by offset record.
    own_may_grow: bool,
    /// First row of every instance at full detail, and after the last one the number of these rows.
    first_rows: Vec<u32>,
    /// For each instance, the rows of its coarser levels in `instances`; `None` without levels of detail.
    coarser: Option<Vec<Range<u32>>>,
    /// Host copy of `instances`, which edits change. `None` for scenes in training, where the device changes the rows.
    table: Option<InstanceTable>,
}

/// How a device is to hold a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Holding {
    /// How precisely.
    pub precision: DevicePrecision,
    /// A scene that would take most of the device's memory, or of its budget, stays in host memory, where kernels read the chunks
    /// that may be seen over the bus: as much as ever, but slower.
    pub on_host_if_large: bool,
}

/// A scene of more than this part of the device's memory leaves too little for frames: each depth slab or range costs a pass over
/// what is in view.
const LARGE: f64 = 0.75;

/// Packing rounds logarithms of standard deviations, which are below 32, by at most 2^-7.
const HALF_LOG: f64 = 1.008;

/// The clouds and offsets to upload.
struct Content<'a> {
    /// Of a packed scene, what stays in f32.
    scene: &'a InstancedScene,
    /// What of them is not in f32; nothing if `precision` is.
    packed: &'a PackedScene,
    holding: Holding,
    /// Rows of the background beyond those of the scene, with undefined contents.
    spare: usize,
}

impl DeviceScene {
    /// Uploads a scene for kernels with `chunk_size` threads per work-group.
    ///
    /// # Errors
    /// Inconsistent indices, more than 2^32 - 1 expanded Gaussians, a scene that does not fit `precision`, or a buffer beyond
    /// the device's limits.
    pub fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32, holding: Holding) -> Result<Self, RenderError> {
        let precision = holding.precision;
        scene.validate()?;
        check_limit(scene.source_len())?;
        let packed = match precision {
            DevicePrecision::F32 => PackedScene::default(),
            _ => PackedScene::new(scene, &scene.offset_runs(), precision)?,
        };
        // Bounds are those of what is drawn.
        let tables = match precision {
            DevicePrecision::F32 => build_tables(scene, chunk_size)?,
            _ => build_tables(&packed.with_unpacked_shapes(scene), chunk_size)?,
        };
        let content = Content { scene, packed: &packed, holding, spare: 0 };
        Self::with_tables(gpu, &content, &SourceLayout::of(scene), tables, chunk_size)
    }

    /// The same as [`DeviceScene::new`], but nothing is culled by chunk: for training, where means move at every step, in f32.
    /// Only the device moves its instances: [`DeviceScene::place_instances`] and [`DeviceScene::show_instances`] fail.
    ///
    /// # Errors
    /// The same errors as [`DeviceScene::new`].
    pub fn unbounded(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        scene.validate()?;
        check_limit(scene.source_len())?;
        let mut tables = build_tables(scene, chunk_size)?;
        tables.widen();
        let content = Content { scene, packed: &PackedScene::default(), holding: Holding::default(), spare: 0 };
        let out = Self::with_tables(gpu, &content, &SourceLayout::of(scene), tables, chunk_size)?;
        Ok(Self { table: None, own_may_grow: !scene.own_ranges.is_empty(), ..out })
    }

    /// The same as [`DeviceScene::new`], with levels of detail, for `RenderOptions::lod_error_px` above 0. Takes two to
    /// three times the memory, and time on the host to merge Gaussians.
    ///
    /// # Errors
    /// The same errors as [`DeviceScene::new`], with levels included in the counts.
    pub fn with_levels(
        gpu: &Arc<Gpu>,
        scene: &InstancedScene,
        chunk_size: u32,
        holding: Holding,
    ) -> Result<Self, RenderError> {
        let precision = holding.precision;
        scene.validate()?;
        let mut levels = Levels::of(scene);
        let sources = levels.templates.len() + levels.own.len() + levels.background.len();
        check_limit(sources)?;
        let mut pool = InstancedScene { pixel_filter: scene.pixel_filter, ..InstancedScene::default() };
        levels.swap_pool(&mut pool);
        let mut packed = PackedScene::default();
        if precision != DevicePrecision::F32 {
            packed = PackedScene::new(&pool, &levels.offset_runs(), precision)?;
            pool = packed.with_unpacked_shapes(&pool);
        }
        levels.swap_pool(&mut pool);
        let tables = build_level_tables(&levels, chunk_size)?;
        levels.swap_pool(&mut pool);
        let content = Content { scene: &pool, packed: &packed, holding, spare: 0 };
        let out = Self::with_tables(gpu, &content, &SourceLayout::of(scene), tables, chunk_size)?;
        Ok(Self { expanded_len: scene.expanded_len(), coarser: Some(levels.coarser), ..out })
    }

    /// Uploads a scene whose background is in pages, with room for `spare` more rows of the background. The background of
    /// `scene` are the stand-ins, and [`PagedScene`](super::PagedScene) shows them and the pages. Also returns where the rows of
    /// blocks and levels begin.
    ///
    /// # Errors
    /// The same errors as [`DeviceScene::with_levels`].
    pub(super) fn with_pages(
        gpu: &Arc<Gpu>,
        scene: &InstancedScene,
        pages: &PageTable,
        spare: usize,
        chunk_size: u32,
        precision: DevicePrecision,
    ) -> Result<(Self, [u32; 2]), RenderError> {
        scene.validate()?;
        let mut levels = Levels::of(&InstancedScene { background: Gaussians::default(), ..scene.clone() });
        // Pages begin at whole words of packed arrays, so what comes before them has an even number of rows.
        if !(levels.templates.len() + levels.own.len()).is_multiple_of(2) {
            let cloud = if levels.own.is_empty() { &mut levels.templates } else { &mut levels.own };
            let last = cloud.range(SourceRange { first: cloud.len() as u32 - 1, count: 1 });
            cloud.append(&last);
        }
        check_limit(levels.templates.len() + levels.own.len() + scene.background.len() + spare)?;
        levels.background = scene.background.clone();
        let mut pool = InstancedScene { pixel_filter: scene.pixel_filter, ..InstancedScene::default() };
        levels.swap_pool(&mut pool);
        let mut packed = PackedScene::default();
        let mut sigma_factor = 1.0;
        if precision != DevicePrecision::F32 {
            packed = PackedScene::new(&pool, &levels.offset_runs(), precision)?;
            pool = packed.with_unpacked_shapes(&pool);
            // Pages are packed when they come: their bounds allow for it.
            sigma_factor = HALF_LOG;
        }
        levels.swap_pool(&mut pool);
        let PagedTables { tables, first_block, first_level } =
            build_paged_tables(&levels, pages, sigma_factor, chunk_size)?;
        levels.swap_pool(&mut pool);
        let holding = Holding { precision, on_host_if_large: false };
        let content = Content { scene: &pool, packed: &packed, holding, spare };
        let out = Self::with_tables(gpu, &content, &SourceLayout::of(scene), tables, chunk_size)?;
        // Rows of coarser levels of instances come after the blocks.
        let blocks = pages.block_counts.len() as u32;
        let coarser = levels.coarser.iter().map(|rows| rows.start + blocks..rows.end + blocks).collect();
        let expanded_len = scene.expanded_len() - scene.background.len() as u64 + pages.rows()[0];
        Ok((Self { expanded_len, coarser: Some(coarser), ..out }, [first_block, first_level]))
    }

    /// Writes the whole instance table at once, after most of its rows have changed. The device must be idle.
    pub(super) fn write_all_rows(&mut self, gpu: &Arc<Gpu>) -> Result<(), GpuError> {
        let Some(table) = &self.table else { return Ok(()) };
        write(gpu, &mut self.instances, table.rows())?;
        table.submitted();
        Ok(())
    }

    /// Changes a row of the instance table that is of no instance, as [`DeviceScene::place_instances`] does.
    pub(super) fn change_row(&mut self, index: usize, change: impl FnOnce(&mut types::Instance)) {
        if let Some(table) = &mut self.table {
            table.change(index, |row, _| change(row));
        }
    }

    /// Uploads the clouds and offsets of a scene with tables that index them; `layout` has the instances.
    fn with_tables(
        gpu: &Arc<Gpu>,
        content: &Content<'_>,
        layout: &SourceLayout,
        tables: Tables,
        chunk_size: u32,
    ) -> Result<Self, RenderError> {
        let Content { scene, packed, holding: Holding { precision, on_host_if_large }, spare } = *content;
        let sh_degree = scene.sh_degree();
        let spare = CloudSize { len: spare, sh_degree: scene.background.sh_degree };
        let spare_rows = ParameterSet::from_fn(|p| p.source_rows([CloudSize::default(), spare]).unwrap_or([0, 0]));
        let rows = scene.parameter_rows();
        let rows = ParameterSet::from_fn(|p| [rows[p][0], rows[p][1] + spare_rows[p][1]]);
        let is_f32 = |parameter| precision == DevicePrecision::F32 || stays_f32(parameter);
        let rows_in_f32 = ParameterSet::from_fn(|p| if is_f32(p) { rows[p] } else { [0, 0] });
        let spare_packed = ParameterSet::from_fn(|p| if is_f32(p) { 0 } else { spare_rows[p][1] });
        let windows = windows_of(gpu, &rows, sh_degree, precision, chunk_size)?;
        let f32_bytes = |(p, rows): (Parameter, &Rows)| 4 * (rows.iter().sum::<usize>() * p.width()) as u64;
        let bytes = rows_in_f32.iter().map(f32_bytes).sum::<u64>() + packed.bytes();
        let is_large = bytes as f64 > LARGE * gpu.memory_budget() as f64;
        let home = if on_host_if_large && is_large { Home::Host } else { Home::Device };
        Ok(Self {
            windows,
            own_may_grow: false,
            first_rows: layout.first_rows(),
            instances: upload(gpu, "instances", &tables.instances)?,
            chunks: upload(gpu, "chunks", &tables.chunks)?,
            parameters: ParameterBuffers::upload(gpu, scene, &rows_in_f32, home)?,
            packed: PackedBuffers::upload(gpu, packed, &spare_packed, home)?,
            home,
            precision,
            instance_count: tables.instances.len() as u32,
            sh_degree,
            chunk_size,
            chunk_pairs: tables.chunk_pairs,
            expanded_len: tables.flat,
            pixel_filter: scene.pixel_filter,
            counts: SceneCounts {
                templates: scene.templates.len(),
                template_sh_degree: scene.templates.sh_degree,
                background: scene.background.len() + spare.len,
                background_sh_degree: scene.background.sh_degree,
                rows,
            },
            coarser: None,
            table: Some(InstanceTable::new(tables.instances)),
        })
    }

    /// Makes the tables of a scene in training fit another layout with the same instances and SH degrees; their poses stay
    /// those of the device. The caller replaces the parameter buffers. As with [`DeviceScene::unbounded`], nothing is
    /// culled by chunk. The device must be idle.
    ///
    /// # Errors
    /// More Gaussians than the device can hold.
    pub fn relayout(&mut self, gpu: &Arc<Gpu>, layout: &SourceLayout) -> Result<(), RenderError> {
        self.fit_windows(gpu, layout)?;
        let rows = parameter_rows(layout, &self.counts.rows);
        let before = download(gpu, &self.instances, self.posed_rows() as usize)?;
        let mut tables = unbounded_tables(layout, self.has(Parameter::ColorFromTemplate), self.chunk_size)?;
        let first_rows = layout.first_rows();
        for row in &mut tables.instances[..first_rows[layout.instances.len()] as usize] {
            let before = &before[self.rows_of(row.owner as usize).start];
            (row.world_from_template, row.scale) = (before.world_from_template, before.scale);
        }
        self.first_rows = first_rows;
        self.instances = upload(gpu, "instances", &tables.instances)?;
        self.chunks = upload(gpu, "chunks", &tables.chunks)?;
        self.instance_count = tables.instances.len() as u32;
        self.chunk_pairs = tables.chunk_pairs;
        self.expanded_len = tables.flat;
        self.counts.templates = layout.templates.len;
        self.counts.background = layout.background.len;
        self.counts.rows = rows;
        Ok(())
    }

    /// Makes the windows fit the parameter buffers of another layout; the rest is that of the old one.
    ///
    /// # Errors
    /// More Gaussians than the device can hold.
    pub fn fit_windows(&mut self, gpu: &Gpu, layout: &SourceLayout) -> Result<(), RenderError> {
        check_limit(layout.source_count())?;
        let rows = parameter_rows(layout, &self.counts.rows);
        self.windows = windows_of(gpu, &rows, self.sh_degree, self.precision, self.chunk_size)?;
        Ok(())
    }

    /// Moves instances: the next frame's command buffer writes their rows of the instance table, and those of their
    /// levels. For one instance without levels that is 132 bytes, twice if it has own Gaussians. Frames in flight keep the
    /// poses they began with.
    ///
    /// # Errors
    /// An index is out of range, or the scene is in training; nothing is moved.
    pub fn place_instances(&mut self, places: &[(usize, Similarity)]) -> Result<(), RenderError> {
        self.change_instances(places, |world_from_template, row, _| {
            row.world_from_template = world_from_template.rows();
            row.scale = scale_bound(world_from_template);
        })
    }

    /// Shows instances (true) or hides them: a hidden instance has no Gaussians, so culling passes nothing on. Rows are
    /// written as by [`DeviceScene::place_instances`].
    ///
    /// # Errors
    /// The same errors as [`DeviceScene::place_instances`].
    pub fn show_instances(&mut self, shown: &[(usize, bool)]) -> Result<(), RenderError> {
        self.change_instances(shown, |shown, row, source_count| {
            row.source_count = if *shown { source_count } else { 0 }
        })
    }

    /// Changes the rows of instances and of their levels in the host copy.
    fn change_instances<T>(
        &mut self,
        instances: &[(usize, T)],
        change: impl Fn(&T, &mut types::Instance, u32),
    ) -> Result<(), RenderError> {
        let refused = |reason: String| Err(RenderError::Option { option: "the scene's instances", reason });
        let Some(table) = &mut self.table else {
            return refused("are those of a scene in training, which the device moves".into());
        };
        let posed = self.first_rows.len() - 1;
        if let Some((k, _)) = instances.iter().find(|(k, _)| *k >= posed) {
            return refused(format!("there are {posed}, and none has the index {k}"));
        }
        for (k, to) in instances {
            let levels = self.coarser.as_ref().map_or(0..0, |coarser| coarser[*k].clone());
            for row in (self.first_rows[*k]..self.first_rows[*k + 1]).chain(levels) {
                table.change(row as usize, |row, source_count| change(to, row, source_count));
            }
        }
        Ok(())
    }

    /// Records the writes of rows that changed since the last frame. The passes of a frame begin with this.
    pub(super) fn record_changes(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        self.table.as_ref().map_or(Ok(()), |table| table.record(recorder, &self.instances))
    }

    /// Takes the rows whose writes have just been recorded for a later submission.
    pub(super) fn take_changes(&self) -> RecordedChanges {
        self.table.as_ref().map_or_else(RecordedChanges::default, InstanceTable::take_recorded)
    }

    /// Notes that the writes recorded so far have been submitted.
    pub(super) fn changes_submitted(&self) {
        self.table.iter().for_each(InstanceTable::submitted);
    }

    /// True if the next frame begins with writing rows of instances that have changed.
    pub fn has_changes(&self) -> bool {
        self.table.as_ref().is_some_and(InstanceTable::has_changes)
    }

    /// Writes rows that no frame has written yet, before the device's table is read.
    pub(super) fn write_changes(&self, gpu: &Arc<Gpu>) -> Result<(), GpuError> {
        if !self.has_changes() {
            return Ok(());
        }
        let mut recorder = Recorder::new(gpu)?;
        self.record_changes(&mut recorder)?;
        let ticket = recorder.submit()?;
        self.changes_submitted();
        recorder.wait(ticket)
    }

    /// The traits of the scene that kernels for SH bands up to `sh_degree` are compiled for.
    pub fn traits(&self, sh_degree: u32) -> SceneTraits {
        let [rest, records] = [Parameter::OffsetShRest, Parameter::OffsetMeans].map(|p| self.counts.rows[p][0]);
        SceneTraits {
            sh_degree,
            offset_sh_rest: (rest / records.max(1)) as u32,
            offset_log_scales: self.has(Parameter::OffsetLogScales),
            offset_quats: self.has(Parameter::OffsetQuats),
            color_matrices: self.has(Parameter::ColorFromTemplate),
            own_may_grow: self.own_may_grow,
            levels: self.has_levels(),
            windowed: self.windows.are_several(),
            precision: self.precision,
        }
    }

    /// True if the parameter has rows in this scene.
    pub fn has(&self, parameter: Parameter) -> bool {
        self.counts.rows[parameter] != [0, 0]
    }

    /// Number of instances besides the background, which has no pose.
    pub fn posed_instances(&self) -> u32 {
        self.first_rows.len() as u32 - 1
    }

    /// Number of rows of these instances at full detail, the first ones of `instances`.
    pub fn posed_rows(&self) -> u32 {
        self.first_rows.last().copied().unwrap_or(0)
    }

    /// The rows of instance `k` at full detail: of its template, then of its own Gaussians if it has any.
    pub fn rows_of(&self, k: usize) -> Range<usize> {
        self.first_rows[k] as usize..self.first_rows[k + 1] as usize
    }

    /// True if the scene has levels of detail.
    pub fn has_levels(&self) -> bool {
        self.coarser.is_some()
    }

    /// What dispatches bind of the arrays of source Gaussians for one of the scene's windows; nothing if that is all of them.
    pub fn parts(&self, window: &SourceWindow) -> Vec<BufferPart> {
        if !self.windows.are_several() {
            return Vec::new();
        }
        [self.parameters.parts(window), self.packed.parts(window)].concat()
    }

    /// Size of all buffers, bytes, wherever they are.
    pub fn bytes(&self) -> u64 {
        self.instances.bytes() + self.chunks.bytes() + self.parameters.bytes() + self.packed.bytes()
    }

    /// Size of the buffers in host memory, bytes.
    pub fn host_bytes(&self) -> u64 {
        match self.home {
            Home::Device => 0,
            Home::Host => self.parameters.bytes() + self.packed.bytes(),
        }
    }
}

/// Size of a [`DeviceScene`] by content, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct PlannedBytes {
    /// Gaussians of the templates.
    pub templates: u64,
    /// Gaussians that instances have of their own.
    pub own: u64,
    /// Gaussians of the background.
    pub background: u64,
    /// Offset records of instances.
    pub offsets: u64,
    /// The instance table, with one row for the background, and the colour matrices.
    pub instances: u64,
    /// Bounds of all chunks.
    pub chunks: u64,
    /// Single elements in place of empty arrays, since Vulkan has no empty buffers.
    pub unused: u64,
}

impl PlannedBytes {
    /// The sum, equal to [`DeviceScene::bytes`].
    pub fn total(&self) -> u64 {
        self.templates + self.own + self.background + self.offsets + self.instances + self.chunks + self.unused
    }
}

/// The buffers that [`DeviceScene::new`] will allocate, without a device. The scene must be valid.
pub fn planned_bytes(scene: &InstancedScene, chunk_size: u32, precision: DevicePrecision) -> PlannedBytes {
    let background = scene.background.len() as u64;
    let chunks_of = |count: u32| u64::from(count.div_ceil(chunk_size));
    let own: BTreeSet<SourceRange> = scene.own_ranges.iter().copied().collect();
    let ranges = scene.template_ranges.iter().chain(&own);
    let chunks: u64 = ranges.map(|r| chunks_of(r.count)).sum::<u64>() + chunks_of(background as u32);
    let own_rows = scene.own_ranges.iter().filter(|range| range.count > 0).count() as u64;
    let instances = scene.instances.len() as u64 + own_rows + u64::from(background > 0);
    let chunk_bytes = size_of::<types::Chunk>() as u64;
    let instance_bytes = size_of::<types::Instance>() as u64;
    let placeholder = |len: u64, bytes: u64| if len == 0 { bytes } else { 0 };
    let is_f32 = |parameter| precision == DevicePrecision::F32 || stays_f32(parameter);
    let (f32s, packed) = (planned_parameter_bytes(scene, is_f32), planned_packed_bytes(scene, precision));
    let placeholders = placeholder(instances, instance_bytes) + placeholder(chunks, chunk_bytes);
    PlannedBytes {
        templates: f32s.templates + packed.templates,
        own: f32s.own + packed.own,
        background: f32s.background + packed.background,
        offsets: f32s.offsets + packed.offsets,
        instances: instances * instance_bytes + f32s.instances,
        chunks: chunks * chunk_bytes,
        unused: f32s.unused + packed.unused + placeholders,
    }
}

/// Numbers of rows of every parameter in a layout, for the kinds of offsets that `before` has.
fn parameter_rows(layout: &SourceLayout, before: &ParameterSet<Rows>) -> ParameterSet<Rows> {
    let clouds = [layout.posed(), layout.background];
    let records = before[Parameter::OffsetMeans][0].max(1);
    ParameterSet::from_fn(|parameter| {
        parameter.source_rows(clouds).unwrap_or_else(|| match parameter.owner() {
            // Coefficients above 0 have several rows per record.
            Owner::Offset => [before[parameter][0] / records * layout.offsets, 0],
            _ => before[parameter],
        })
    })
}

/// Checks the number of Gaussians before anything is built.
fn check_limit(count: usize) -> Result<(), RenderError> {
    let limit = u64::from(u32::MAX - 1);
    match count as u64 {
        needed if needed > limit => Err(RenderError::TooMany { what: "source Gaussians", needed, limit }),
        _ => Ok(()),
    }
}

/// Bytes of the widest row of a scene's arrays: a quaternion (16), or a mean (12) of a packed scene, or the highest SH band (2 l + 1
/// colours of 12 or 6 bytes).
pub(super) fn widest_row_bytes(sh_degree: u32, precision: DevicePrecision) -> u64 {
    let [others, color] = if precision == DevicePrecision::F32 { [16, 12] } else { [12, 6] };
    u64::from(others.max(color * (2 * sh_degree + 1)))
}

/// The windows of a scene with so many rows.
fn windows_of(
    gpu: &Gpu,
    rows: &ParameterSet<Rows>,
    sh_degree: u32,
    precision: DevicePrecision,
    chunk_size: u32,
) -> Result<SourceWindows, RenderError> {
    let row_bytes = widest_row_bytes(sh_degree, precision);
    let binding_bytes = gpu.caps().max_storage_bytes;
    SourceWindows::new(rows, row_bytes, binding_bytes, chunk_size).ok_or_else(|| RenderError::TooMany {
        what: "source Gaussians",
        needed: rows[Parameter::Means].iter().sum::<usize>() as u64,
        limit: binding_bytes / row_bytes,
    })
}
