//! A scene of which the device holds a part of the background: the pages that are in view, as many as a budget has room for.
//!
//! The background's stand-ins and all that instances show are always there. Before a frame, [`PagedScene::in_view`] returns which
//! pages its view lacks, those first whose stand-ins are coarsest on the screen. Whoever has them, from a file or a thread that
//! reads it, gives them to [`PagedScene::place`]; until then the block's finest stand-in is drawn. With all pages of a view in
//! place, the picture has the bytes of the scene with levels in one piece ([`DeviceScene::with_levels`]), as flat order, by
//! which equal depths are blended, is that of the rows.

use std::sync::Arc;

use crate::gpu::{Buffer, Gpu, Recorder, Ticket};
use crate::scene::lod::NO_NEXT_CELL;
use crate::scene::lod::pages::{Ball, Page, PageTable, PagedLevel, ball_around, chunks_of};
use crate::scene::source_layout::CloudSize;
use crate::scene::{Camera, DevicePrecision, Gaussians, InstancedScene, Parameter};

use super::device_scene::{DeviceScene, widest_row_bytes};
use super::error::RenderError;
use super::frustum::Frustum;
use super::packed_scene::PackedScene;
use super::page_slots::PageSlots;
use super::render_options::RenderOptions;

/// Page slots have a multiple of this number of rows, so that they begin at whole words of packed arrays and chunks do not share lines.
const SLOT_ROWS: u32 = 256;
/// Levels fade over a quarter of an octave (`lod.glsl`); with a margin for f32.
const FADE: f64 = 0.84;

/// A scene in device memory whose background is in pages.
pub struct PagedScene {
    device: DeviceScene,
    table: PageTable,
    pages: Vec<Page>,
    /// By page, a ball around those of its blocks.
    balls: Vec<Ball>,
    slots: PageSlots,
    /// Rows of a page slot.
    slot_rows: u32,
    /// Row of the background at which the first page slot begins: the stand-ins are before it.
    first_slot: u32,
    /// Gaussians of templates and instances' own, which come before the background.
    posed: CloudSize,
    /// Rows of the instance table: of the first block, and of the first level of a block.
    first_rows: [u32; 2],
    upload: Upload,
}

/// The pages that a view wants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PagesInView {
    /// The wanted pages that are not in place and have room; the one whose stand-ins are coarsest on the screen first.
    pub missing: Vec<u32>,
    /// Number of wanted pages without room: their stand-ins are drawn.
    pub without_room: usize,
}

/// How many bytes and rows of device memory a paged scene takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PagedBytes {
    /// What is always there, but for the tables of rows and chunks: stand-ins, and what instances show.
    pub standing: u64,
    /// Device memory of one page slot.
    pub slot: u64,
    /// Rows of a page slot.
    pub slot_rows: u64,
    /// Rows of what is before the first one, with levels of templates.
    pub standing_rows: u64,
    /// The widest row of any of the arrays, bytes.
    pub widest_row: u64,
    /// Number of pages.
    pub pages: u32,
}

/// Buffers that pages are uploaded through.
struct Upload {
    recorder: Recorder,
    /// One for each array of floats and of words.
    floats: Vec<Buffer<f32>>,
    words: Vec<Buffer<u32>>,
    /// The last upload, which still reads them.
    last: Option<Ticket>,
}

/// Rows of a page slot that holds any of the pages.
fn slot_rows(pages: &[Page]) -> u32 {
    pages.iter().map(Page::rows).max().unwrap_or(0).div_ceil(SLOT_ROWS).saturating_mul(SLOT_ROWS)
}

/// Bytes of a Gaussian in device memory.
pub fn row_bytes(sh_degree: u32, precision: DevicePrecision) -> u64 {
    let colors = 3 * u64::from((sh_degree + 1).pow(2));
    // Means; then shape, opacity and rotation, and colours.
    12 + if precision == DevicePrecision::F32 { 32 + 4 * colors } else { 14 + 2 * colors }
}

impl PagedBytes {
    /// The bytes of a scene with these stand-ins as its background, without a device.
    pub fn of(scene: &InstancedScene, table: &PageTable, precision: DevicePrecision) -> Self {
        let pages = table.pages();
        let posed_rows = (scene.templates.len() + scene.own.len()) as u64;
        let posed = posed_rows * row_bytes(scene.templates.sh_degree, precision) + scene.offsets.tensor_bytes();
        let row = row_bytes(scene.background.sh_degree, precision);
        Self {
            // Levels of templates are about as many again, and so are their offsets.
            standing: 2 * posed + scene.background.len() as u64 * row,
            slot: u64::from(slot_rows(&pages)) * row,
            slot_rows: slot_rows(&pages).into(),
            standing_rows: 4 * posed_rows + scene.background.len() as u64,
            widest_row: widest_row_bytes(scene.sh_degree(), precision),
            pages: pages.len() as u32,
        }
    }

    /// The number of page slots in a budget, on a device whose buffers have at most `buffer_bytes`; `None` if not even two pages
    /// have room beside what is always there.
    pub fn slots(&self, budget: u64, buffer_bytes: u64) -> Option<u32> {
        let rows = (buffer_bytes / self.widest_row).min(u64::from(u32::MAX)).saturating_sub(self.standing_rows);
        let slots = (budget.saturating_sub(self.standing) / self.slot.max(1)).min(rows / self.slot_rows.max(1));
        let slots = u32::try_from(slots).unwrap_or(u32::MAX).min(self.pages);
        (slots >= self.pages.min(2)).then_some(slots)
    }
}

impl PagedScene {
    /// Uploads a scene without pages, whose background are the stand-ins of `table`, with room for `slots` pages, for kernels
    /// with `chunk_size` threads per work-group.
    ///
    /// # Errors
    /// A damaged table, and the errors of [`DeviceScene::with_levels`].
    pub fn new(
        gpu: &Arc<Gpu>,
        scene: &InstancedScene,
        mut table: PageTable,
        slots: u32,
        chunk_size: u32,
        precision: DevicePrecision,
    ) -> Result<Self, RenderError> {
        let refused = |reason: String| RenderError::Option { option: "the background's pages", reason };
        table.check().map_err(|error| refused(error.to_string()))?;
        let stand_ins = table.rows()[2];
        if stand_ins != scene.background.len() as u64 {
            return Err(refused(format!("have {stand_ins} stand-ins, and there are {}", scene.background.len())));
        }
        let pages = table.pages();
        let slot_rows = slot_rows(&pages);
        // Slots begin at whole words of packed arrays.
        let first_slot = scene.background.len().next_multiple_of(2);
        let spare = first_slot - scene.background.len() + slots as usize * slot_rows as usize;
        let (device, first_rows) = DeviceScene::with_pages(gpu, scene, &table, spare, chunk_size, precision)?;
        // A block is in view, too, where a finer level of it is, whose merged Gaussians are larger.
        let mut level_chunks = table.level_chunks.iter();
        for level in &table.levels {
            let sigmas = level_chunks.by_ref().take(chunks_of(level.count)).map(|ball| ball[4]);
            let sigma_max = sigmas.fold(0.0, f32::max);
            if !level.stands_in {
                let of_block = &mut table.block_balls[level.block as usize][4];
                *of_block = of_block.max(sigma_max);
            }
        }
        let posed = device.counts.rows[Parameter::Means][0];
        let posed = CloudSize { len: posed, sh_degree: device.counts.template_sh_degree };
        let mut out = Self {
            balls: pages.iter().map(|page| ball_around(&table.block_balls[page.blocks.clone()])).collect(),
            slots: PageSlots::new(slots, pages.len()),
            slot_rows,
            first_slot: first_slot as u32,
            posed,
            first_rows,
            upload: Upload { recorder: Recorder::new(gpu)?, floats: Vec::new(), words: Vec::new(), last: None },
            device,
            table,
            pages,
        };
        let mut first = 0;
        for l in 0..out.table.levels.len() {
            if out.table.levels[l].stands_in {
                let count = out.table.levels[l].count;
                out.show(out.first_rows[1] as usize + l, first, count);
                first += count;
            }
        }
        (0..out.pages.len() as u32).for_each(|page| out.show_stand_ins(page, false));
        out.device.write_all_rows(gpu)?;
        Ok(out)
    }

    /// The scene as the device has it now.
    pub fn device(&self) -> &DeviceScene {
        &self.device
    }

    /// The same, for changes of its instances.
    pub fn device_mut(&mut self) -> &mut DeviceScene {
        &mut self.device
    }

    /// The pages of the background.
    pub fn pages(&self) -> &[Page] {
        &self.pages
    }

    /// The pages that a view wants, by the size on the screen of the cells of their stand-ins. With levels of detail, pages of
    /// which only stand-ins would be drawn are not wanted.
    pub fn in_view(&mut self, camera: &Camera, options: &RenderOptions) -> PagesInView {
        let view = Frustum::of(camera, options);
        let mut wanted: Vec<(f64, u32)> = Vec::new();
        for (p, page) in self.pages.iter().enumerate() {
            if !view.may_show(&self.balls[p]) {
                continue;
            }
            let cells = self
                .finest_stand_ins(page)
                .map(|(block, level)| view.cell_px(&self.table.block_balls[block], level.cell));
            let coarsest = cells.fold(0.0, f64::max);
            if coarsest > f64::from(options.lod_error_px) * FADE {
                wanted.push((coarsest, p as u32));
            }
        }
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let pages: Vec<u32> = wanted.iter().map(|&(_, page)| page).take(self.slots.len()).collect();
        let missing = self.slots.want(&pages);
        PagesInView { missing, without_room: wanted.len() - pages.len() }
    }

    /// Gives the device a page: its Gaussians at full detail, then those of its finer levels, in the order of the table. The
    /// frames that follow draw it; those that were submitted before keep what they began with. (A picture that is recorded and
    /// submitted later would show rows of the new page for the old one's.) The page that was wanted longest ago makes room.
    /// Returns false, without effect, if the last view wants the pages of all page slots, or the page is in place.
    ///
    /// # Errors
    /// The Gaussians are not those of the page in number or degree or are not finite, or a Vulkan call failed.
    pub fn place(&mut self, page: u32, gaussians: &Gaussians) -> Result<bool, RenderError> {
        let refused = |what: String| {
            Err(RenderError::Option { option: "the background's pages", reason: format!("page {page} {what}") })
        };
        let Some(rows) = self.pages.get(page as usize).map(Page::rows) else {
            return refused(format!("is none of {}", self.pages.len()));
        };
        let degree = self.device.counts.background_sh_degree;
        if (gaussians.len(), gaussians.sh_degree) != (rows as usize, degree) {
            let (len, of_degree) = (gaussians.len(), gaussians.sh_degree);
            return refused(format!("has {len} Gaussians of SH degree {of_degree}, not {rows} of {degree}"));
        }
        if let Some(i) = (0..gaussians.len()).find(|&i| !gaussians.is_finite(i)) {
            return refused(format!("has a number that is not finite in row {i}"));
        }
        let Some((slot, before)) = self.slots.take(page) else { return Ok(false) };
        if let Some(before) = before {
            self.show_stand_ins(before, false);
        }
        let first = self.first_slot + slot * self.slot_rows;
        if let Err(error) = self.write(first as usize, gaussians) {
            self.upload.recorder.abandon();
            self.slots.release(page);
            return Err(error);
        }
        self.show_stand_ins(page, true);
        let mut row = first;
        let Page { blocks, levels, .. } = self.pages[page as usize].clone();
        for block in blocks {
            let count = self.table.block_counts[block];
            self.show(self.first_rows[0] as usize + block, row, count);
            row += count;
        }
        for level in levels {
            let PagedLevel { count, stands_in, .. } = self.table.levels[level];
            if !stands_in {
                self.show(self.first_rows[1] as usize + level, row, count);
                row += count;
            }
        }
        Ok(true)
    }

    /// The finest stand-in of each block of a page.
    fn finest_stand_ins(&self, page: &Page) -> impl Iterator<Item = (usize, PagedLevel)> + '_ {
        let levels = page.levels.clone().map(|l| self.table.levels[l]).filter(|level| level.stands_in);
        let mut last = None;
        levels.filter_map(move |level| {
            (last.replace(level.block) != Some(level.block)).then_some((level.block as usize, level))
        })
    }

    /// Makes a row of the instance table show `count` rows of the background.
    fn show(&mut self, index: usize, first: u32, count: u32) {
        let posed = self.posed;
        let degree = self.device.counts.background_sh_degree;
        let in_bands = [1, 2, 3].map(|l| first + if posed.sh_degree >= l { posed.len as u32 } else { 0 });
        self.device.change_row(index, |row| {
            (row.first_source, row.source_count) = (posed.len as u32 + first, count);
            (row.first_in_band, row.sh_degree) = (in_bands, degree);
        });
    }

    /// Sets the cells of the rows of a page: with `there`, those of all its levels. Without, nothing of the page is shown, and the
    /// finest stand-in of each block is at full detail.
    fn show_stand_ins(&mut self, page: u32, there: bool) {
        let Page { blocks, levels, .. } = self.pages[page as usize].clone();
        let [first_block, first_level] = self.first_rows.map(|row| row as usize);
        let mut finest = vec![NO_NEXT_CELL; blocks.len()];
        for l in levels.clone().rev() {
            let PagedLevel { block, cell, stands_in, .. } = self.table.levels[l];
            let next = std::mem::replace(&mut finest[block as usize - blocks.start], cell);
            let is_finest_stand_in = stands_in && {
                let before = l.checked_sub(1).map(|before| self.table.levels[before]);
                before.is_none_or(|before| before.block != block || !before.stands_in)
            };
            self.device.change_row(first_level + l, |row| {
                (row.cell, row.next_cell) = (if is_finest_stand_in && !there { 0.0 } else { cell }, next);
                if !stands_in && !there {
                    row.source_count = 0;
                }
            });
        }
        for (block, next) in blocks.zip(finest) {
            self.device.change_row(first_block + block, |row| {
                row.next_cell = next;
                if !there {
                    row.source_count = 0;
                }
            });
        }
    }

    /// Writes rows of the background, from `first` on.
    fn write(&mut self, first: usize, gaussians: &Gaussians) -> Result<(), RenderError> {
        let cloud = InstancedScene::from_cloud(gaussians.clone());
        let precision = self.device.precision;
        let packed = match precision {
            DevicePrecision::F32 => PackedScene::default(),
            _ => PackedScene::new(&cloud, &[], precision)?,
        };
        let posed = self.posed;
        let before = |parameter: Parameter| {
            first + parameter.source_rows([posed, CloudSize::default()]).map_or(0, |rows| rows[0])
        };
        let Upload { recorder, floats, words, last } = &mut self.upload;
        if let Some(ticket) = last.take() {
            recorder.wait(ticket)?;
        }
        let gpu = recorder.gpu().clone();
        let most = self.slot_rows as usize;
        let mut staged = 0;
        for (parameter, buffer) in self.device.parameters.scalars_mut() {
            let is_f32 = precision == DevicePrecision::F32 || parameter == Parameter::Means;
            let values = cloud.parameter(parameter);
            if !is_f32 || values.is_empty() {
                continue;
            }
            if floats.len() == staged {
                floats.push(Buffer::for_upload(&gpu, "page", most * parameter.width())?);
            }
            floats[staged].write_mapped(&values)?;
            recorder.copy_to(&floats[staged], values.len(), buffer, before(parameter) * parameter.width())?;
            staged += 1;
        }
        staged = 0;
        for array in self.device.packed.arrays(&packed) {
            if array.words.is_empty() {
                continue;
            }
            if words.len() == staged {
                words.push(Buffer::for_upload(&gpu, "page", most * array.row_halves / 2)?);
            }
            words[staged].write_mapped(array.words)?;
            let first = before(array.parameter) * array.row_halves / 2;
            recorder.copy_to(&words[staged], array.words.len(), array.buffer, first)?;
            staged += 1;
        }
        *last = Some(recorder.submit()?);
        Ok(())
    }
}
