//! Scenes to draw: as a whole, or with a background in pages that are read as views want them.

use std::path::Path;

use instgs_io::{LoadedScene, PagedFile, host_memory};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::paged_scene::{PagedBytes, row_bytes};
use instgs_vk::render::{DeviceScene, PagedScene, PagesInView, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, DevicePrecision, InstancedScene};

use crate::args::{MemoryArgs, open_scene_to_draw};
use crate::{CliError, Printer, failed_to_render};

/// Reading a scene takes as many times the bytes of its numbers in f32: the file's, the scene's, and those to upload.
const HOST_COPIES: u64 = 3;
/// Pages get this part of the device's memory, or of its budget: the rest is for frames.
const PART_FOR_PAGES: f64 = 0.5;

/// A scene that was opened to be drawn.
pub enum OpenedScene {
    /// All of it is in host memory.
    Whole(Box<LoadedScene>),
    /// Its background stays in the file.
    InPages(Box<PagedFile>),
}

/// A scene in device memory that follows the views.
pub enum DrawnScene {
    /// All of it.
    Whole(DeviceScene),
    /// What the last view wants of the background.
    InPages(Box<PagedView>),
}

/// A scene in pages, and the file that they come from.
pub struct PagedView {
    scene: PagedScene,
    file: PagedFile,
}

impl OpenedScene {
    /// Opens a scene. It stays in pages if its file has them and it needs more memory than there is, of the host or of the
    /// device, or than the flags allow.
    ///
    /// # Errors
    /// The file cannot be read, or is damaged.
    pub fn open(
        path: &Path,
        memory: &MemoryArgs,
        precision: DevicePrecision,
        gpu: &Gpu,
        printer: &Printer,
    ) -> Result<Self, CliError> {
        let file = PagedFile::open(path)?;
        let has_pages = file.is_some();
        if let Some(file) = file.filter(|file| !is_enough(file, memory, precision, gpu)) {
            return Ok(Self::InPages(Box::new(file)));
        }
        let loaded = open_scene_to_draw(path, printer)?;
        let needed = HOST_COPIES * bytes_of(&loaded.scene, loaded.scene.source_len() as u64, DevicePrecision::F32);
        if let Some(budget) = memory.host_budget().filter(|&budget| !has_pages && budget < needed) {
            printer.warning(format_args!(
                "{}: took some {} MiB of host memory, and --host-memory-mb is {}; of a file that instgs-vk export --pages writes, \
                 only what views want is read",
                path.display(),
                needed >> 20,
                budget >> 20
            ));
        }
        Ok(Self::Whole(Box::new(loaded)))
    }

    /// The scene; in pages, with stand-ins as its background.
    pub fn scene(&self) -> &InstancedScene {
        match self {
            Self::Whole(loaded) => &loaded.scene,
            Self::InPages(file) => &file.scene,
        }
    }

    /// Number of Gaussians that were dropped because a number is not finite.
    pub fn dropped_non_finite(&self) -> usize {
        match self {
            Self::Whole(loaded) => loaded.dropped_non_finite,
            Self::InPages(_) => 0,
        }
    }

    /// Uploads the scene, or what of it is always there, for a renderer.
    ///
    /// # Errors
    /// The device's memory, or its budget, is too small.
    pub fn upload(self, gpu: &Gpu, renderer: &Renderer, options: &RenderOptions) -> Result<DrawnScene, CliError> {
        let file = match self {
            Self::Whole(loaded) => {
                let uploaded = renderer.upload_for(&loaded.scene, options);
                return Ok(DrawnScene::Whole(uploaded.map_err(failed_to_render("the scene"))?));
            }
            Self::InPages(file) => *file,
        };
        let bytes = PagedBytes::of(&file.scene, &file.table, options.device_precision);
        let budget = (PART_FOR_PAGES * gpu.memory_budget() as f64) as u64;
        let Some(slots) = bytes.slots(budget) else {
            return Err(CliError::msg(format!(
                "the scene needs {} MiB of device memory for what is always there and two pages, and may take {}: give it more \
                 (--device-memory-mb)",
                (bytes.standing + 2 * bytes.slot).div_ceil(1 << 20),
                budget >> 20
            )));
        };
        let scene = renderer
            .upload_in_pages(&file.scene, file.table.clone(), slots, options)
            .map_err(failed_to_render("the scene"))?;
        Ok(DrawnScene::InPages(Box::new(PagedView { scene, file })))
    }
}

/// True if there is memory for all of a scene.
fn is_enough(file: &PagedFile, memory: &MemoryArgs, precision: DevicePrecision, gpu: &Gpu) -> bool {
    let on_host = HOST_COPIES * bytes_of(&file.scene, file.source_len(), DevicePrecision::F32);
    let on_device = bytes_of(&file.scene, file.source_len(), precision);
    let host = memory.host_budget().or_else(host_memory::available_bytes).unwrap_or(u64::MAX);
    on_host <= host && on_device as f64 <= PART_FOR_PAGES * gpu.memory_budget() as f64
}

/// Bytes of the numbers of a scene of so many stored Gaussians.
fn bytes_of(scene: &InstancedScene, gaussians: u64, precision: DevicePrecision) -> u64 {
    gaussians.saturating_mul(row_bytes(scene.sh_degree(), precision)).saturating_add(scene.offsets.tensor_bytes())
}

impl DrawnScene {
    /// Reads what a view lacks; all of it, if there is room. Returns how many of the pages that it wants are not there: stand-ins
    /// are drawn for them.
    ///
    /// # Errors
    /// The file cannot be read, or a Vulkan call failed.
    pub fn follow(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, CliError> {
        match self {
            Self::Whole(_) => Ok(PagesInView::default()),
            Self::InPages(view) => view.follow(camera, options),
        }
    }

    /// The scene in device memory.
    pub fn device(&self) -> &DeviceScene {
        match self {
            Self::Whole(scene) => scene,
            Self::InPages(view) => view.scene.device(),
        }
    }
}

impl PagedView {
    fn follow(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, CliError> {
        let view = self.scene.in_view(camera, options);
        for &page in &view.missing {
            let rows = self.file.read(&self.scene.pages()[page as usize])?;
            self.scene.place(page, &rows).map_err(failed_to_render("the scene"))?;
        }
        Ok(view)
    }
}
