//! Scenes to draw: as a whole, or with a background in pages that are read as views want them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};

use crate::Printer;
use instgs_io::{IoError, LoadedScene, PagedFile, host_memory, load_scene, load_scene_to_draw};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::paged_scene::{PagedBytes, row_bytes};
use instgs_vk::render::{DeviceScene, PagedScene, PagesInView, RenderError, RenderOptions, Renderer};
use instgs_vk::scene::lod::pages::Page;
use instgs_vk::scene::{Camera, DevicePrecision, Gaussians, InstancedScene};

/// Reading a scene takes as many times the bytes of its numbers in f32: the file's, the scene's, and those to upload.
const HOST_COPIES: u64 = 3;
/// Pages get this part of the device's memory, or of its budget: the rest is for frames.
const PART_FOR_PAGES: f64 = 0.5;
/// Pages that are asked for at a time: the view may want others once they are there.
const ASKED_AT_ONCE: usize = 8;

/// A scene that was opened to be drawn.
pub enum OpenedScene {
    /// Templates, instances and the whole background are in host memory.
    Whole(Box<LoadedScene>),
    /// Its background stays in the file.
    InPages(Box<PagedFile>),
}

/// A scene in device memory that follows the views.
pub enum DrawnScene {
    /// Templates, instances and the whole background: views have nothing to ask for.
    Whole(Box<DeviceScene>),
    /// Templates and instances, and of the background what the last views wanted.
    InPages(Box<PagedView>),
}

/// Views that want more of the background than there is room for.
#[derive(Clone, Copy, Debug, Default)]
pub struct CoarserViews {
    drawn: usize,
    coarser: usize,
}

/// How much memory reading a scene may take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneMemory {
    /// Host memory, bytes; `None` = what is available.
    pub host_bytes: Option<u64>,
}

/// Why a scene in pages cannot be drawn, or not go on to be.
#[derive(Debug, thiserror::Error)]
pub enum FollowError {
    /// The file can no longer be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The device fails or has too little memory.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Not even two pages have room.
    #[error(
        "the scene needs {needed_mib} MiB of device memory for what is always there and two pages, and may take {budget_mib}: \
         give it more (--device-memory-mb)"
    )]
    NoRoom {
        /// Device memory for what is always there and two pages, MiB.
        needed_mib: u64,
        /// Device memory that pages may take, MiB: half of the device's, or of its budget.
        budget_mib: u64,
    },
}

impl OpenedScene {
    /// Opens a scene. It stays in pages if its file has them and reading all of it takes more host memory than there is. (What the
    /// device alone has too little memory for is drawn from the host's, without loss.)
    ///
    /// # Errors
    /// The file cannot be read, or is damaged.
    pub fn open(path: &Path, memory: SceneMemory) -> Result<Self, IoError> {
        Self::open_by(path, memory, load_scene_to_draw)
    }

    /// The same, by another function that reads a scene as a whole.
    fn open_by(
        path: &Path,
        memory: SceneMemory,
        load: fn(&Path) -> Result<LoadedScene, IoError>,
    ) -> Result<Self, IoError> {
        let whole = || load(path).map(|loaded| Self::Whole(Box::new(loaded)));
        match PagedFile::open(path) {
            Ok(Some(file)) if !memory.is_enough(&file.scene, file.source_len()) => Ok(Self::InPages(Box::new(file))),
            Ok(_) => whole(),
            // What is wrong with pages does not matter where the scene can be read without them.
            Err(of_pages) => whole().map_err(|_| of_pages),
        }
    }

    /// The scene; in pages, with stand-ins as its background.
    pub fn scene(&self) -> &InstancedScene {
        match self {
            Self::Whole(loaded) => &loaded.scene,
            Self::InPages(file) => &file.scene,
        }
    }

    /// Number of stored Gaussians, and of those after expanding; levels of detail aside.
    pub fn counts(&self) -> [u64; 2] {
        let scene = self.scene();
        let stored = match self {
            Self::Whole(_) => scene.source_len() as u64,
            Self::InPages(file) => file.source_len(),
        };
        [stored, scene.expanded_len() + stored - scene.source_len() as u64]
    }

    /// Length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        match self {
            Self::Whole(loaded) => loaded.file_bytes,
            Self::InPages(file) => file.file_bytes,
        }
    }

    /// Number of Gaussians that were dropped because a number is not finite.
    pub fn dropped_non_finite(&self) -> usize {
        match self {
            Self::Whole(loaded) => loaded.dropped_non_finite,
            Self::InPages(_) => 0,
        }
    }

    /// All warnings for the user, one line each.
    pub fn warnings(&self, memory: SceneMemory) -> Vec<String> {
        let Self::Whole(loaded) = self else { return Vec::new() };
        let mut warnings = loaded.warnings();
        let needed = needed_on_host(&loaded.scene, loaded.scene.source_len() as u64);
        if let Some(budget) = memory.host_bytes.filter(|&budget| budget < needed) {
            warnings.push(format!(
                "reading it takes some {} MiB of host memory, more than the {} of --host-memory-mb; of a file that instgs-vk \
                 export --pages writes, only what views want is read",
                needed >> 20,
                budget >> 20
            ));
        }
        warnings
    }

    /// Opens a scene as [`OpenedScene::open`] does, and prints warnings about its file.
    ///
    /// # Errors
    /// The file cannot be read, or is damaged.
    pub fn open_warned(path: &Path, memory: SceneMemory, printer: &Printer) -> Result<Self, IoError> {
        Self::open(path, memory).map(|opened| opened.warned(path, memory, printer))
    }

    /// The same with the background in the file's order, as training and the Python package evaluate it: Gaussians at the very
    /// same depth are blended in that order.
    ///
    /// # Errors
    /// The file cannot be read, or is damaged.
    pub fn open_to_measure(path: &Path, memory: SceneMemory, printer: &Printer) -> Result<Self, IoError> {
        Self::open_by(path, memory, load_scene).map(|opened| opened.warned(path, memory, printer))
    }

    fn warned(self, path: &Path, memory: SceneMemory, printer: &Printer) -> Self {
        for what in self.warnings(memory) {
            printer.warning(format_args!("{}: {what}", path.display()));
        }
        self
    }

    /// Uploads the scene, or what of it is always there, for a renderer.
    ///
    /// # Errors
    /// See [`FollowError`].
    pub fn upload(self, gpu: &Gpu, renderer: &Renderer, options: &RenderOptions) -> Result<DrawnScene, FollowError> {
        match self {
            Self::Whole(loaded) => Ok(DrawnScene::whole(renderer, &loaded.scene, options)?),
            Self::InPages(file) => Ok(DrawnScene::InPages(Box::new(PagedView::new(*file, gpu, renderer, options)?.0))),
        }
    }
}

impl CoarserViews {
    /// Counts a view that was drawn, as one with stand-ins if pages that it wants had no room.
    pub fn add(&mut self, pages: &PagesInView) {
        self.drawn += 1;
        self.coarser += usize::from(pages.without_room > 0);
    }

    /// Number of views in which stand-ins are seen.
    pub fn count(&self) -> usize {
        self.coarser
    }

    /// What the user should know about them.
    pub fn warning(&self) -> Option<String> {
        let Self { drawn, coarser } = self;
        (*coarser > 0).then(|| {
            format!(
                "{coarser} of {drawn} views want more of the background than there is room for, and are coarser in places; give \
                 them more memory (--device-memory-mb)"
            )
        })
    }
}

impl SceneMemory {
    /// True if it is enough for all of a scene with this number of stored Gaussians.
    fn is_enough(self, scene: &InstancedScene, gaussians: u64) -> bool {
        let available = self.host_bytes.or_else(host_memory::available_bytes).unwrap_or(u64::MAX);
        needed_on_host(scene, gaussians) <= available
    }
}

/// Bytes that reading a scene with this number of stored Gaussians takes.
fn needed_on_host(scene: &InstancedScene, gaussians: u64) -> u64 {
    let of_numbers = gaussians.saturating_mul(row_bytes(scene.sh_degree(), DevicePrecision::F32));
    HOST_COPIES.saturating_mul(of_numbers.saturating_add(scene.offsets.tensor_bytes()))
}

impl DrawnScene {
    /// Uploads all of a scene.
    ///
    /// # Errors
    /// The device has too little memory.
    pub fn whole(renderer: &Renderer, scene: &InstancedScene, options: &RenderOptions) -> Result<Self, RenderError> {
        Ok(Self::Whole(Box::new(renderer.upload_for(scene, options)?)))
    }

    /// Gets all that a view wants and there is room for, and waits for it.
    ///
    /// # Errors
    /// The file cannot be read, or a Vulkan call failed.
    pub fn follow(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, FollowError> {
        match self {
            Self::Whole(_) => Ok(PagesInView::default()),
            Self::InPages(view) => view.follow(camera, options),
        }
    }

    /// Gets what has been read meanwhile of what a view wants, without waiting, and asks for more of it. Returns what it lacks:
    /// stand-ins are drawn for that.
    ///
    /// # Errors
    /// The file cannot be read, or a Vulkan call failed.
    pub fn follow_ahead(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, FollowError> {
        match self {
            Self::Whole(_) => Ok(PagesInView::default()),
            Self::InPages(view) => view.follow_ahead(camera, options),
        }
    }

    /// Number of stored Gaussians of the background of `scene`, which is what is in host memory of this one.
    pub fn background_len(&self, scene: &InstancedScene) -> u64 {
        match self {
            Self::Whole(_) => scene.background.len() as u64,
            Self::InPages(view) => view.background,
        }
    }

    /// What was wrong with a page that [`DrawnScene::follow_ahead`] has left out since the last call.
    pub fn take_problem(&mut self) -> Option<String> {
        match self {
            Self::Whole(_) => None,
            Self::InPages(view) => view.problem.take(),
        }
    }

    /// The scene in device memory.
    pub fn device(&self) -> &DeviceScene {
        match self {
            Self::Whole(scene) => scene,
            Self::InPages(view) => view.scene.device(),
        }
    }

    /// The same, for changes of its instances.
    pub fn device_mut(&mut self) -> &mut DeviceScene {
        match self {
            Self::Whole(scene) => scene,
            Self::InPages(view) => view.scene.device_mut(),
        }
    }

    /// The file that the pages come from; `None` if all of the scene is there.
    pub fn paged_file(&self) -> Option<&Path> {
        match self {
            Self::Whole(_) => None,
            Self::InPages(view) => Some(&view.path),
        }
    }
}

/// A scene in pages, and the thread that reads them.
pub struct PagedView {
    scene: PagedScene,
    path: PathBuf,
    /// Number of stored Gaussians of the background.
    background: u64,
    /// To the thread, which ends with it.
    asks: Sender<(u32, Page)>,
    read: Receiver<(u32, Result<Gaussians, IoError>)>,
    /// Pages that were asked for and have not come.
    asked: BTreeSet<u32>,
    /// Pages that cannot be read or are damaged: their stand-ins stay.
    unreadable: BTreeSet<u32>,
    /// What was wrong with the last of them, until it has been shown.
    problem: Option<String>,
}

impl PagedView {
    /// Uploads what is always there of a scene, which is returned, too.
    ///
    /// # Errors
    /// See [`FollowError`].
    pub fn new(
        mut file: PagedFile,
        gpu: &Gpu,
        renderer: &Renderer,
        options: &RenderOptions,
    ) -> Result<(Self, InstancedScene), FollowError> {
        let (scene, table) = (std::mem::take(&mut file.scene), std::mem::take(&mut file.table));
        let background = table.rows()[0];
        let bytes = PagedBytes::of(&scene, &table, options.device_precision);
        let budget = (PART_FOR_PAGES * gpu.memory_budget() as f64) as u64;
        let slots = bytes.slots(budget, gpu.caps().max_buffer_bytes).ok_or(FollowError::NoRoom {
            needed_mib: (bytes.standing + 2 * bytes.slot).div_ceil(1 << 20),
            budget_mib: budget >> 20,
        })?;
        let path = file.path().to_path_buf();
        let on_device = renderer.upload_in_pages(&scene, table, slots, options)?;
        let (asks, asked_for) = channel::<(u32, Page)>();
        let (sender, read) = channel();
        std::thread::spawn(move || {
            for (page, place) in asked_for {
                if sender.send((page, file.read(&place))).is_err() {
                    return;
                }
            }
        });
        let (asked, unreadable, problem) = Default::default();
        Ok((Self { scene: on_device, path, background, asks, read, asked, unreadable, problem }, scene))
    }

    fn follow(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, FollowError> {
        let view = self.scene.in_view(camera, options);
        // One after the other: what was read waits in memory.
        for &page in &view.missing {
            self.ask(page);
            while self.asked.contains(&page) {
                self.take(self.read.recv().map_err(|_| self.gone())?)?;
            }
        }
        Ok(view)
    }

    fn follow_ahead(&mut self, camera: &Camera, options: &RenderOptions) -> Result<PagesInView, FollowError> {
        self.scene.in_view(camera, options);
        while let Ok((page, rows)) = self.read.try_recv() {
            match self.take((page, rows)) {
                // The device, not the file.
                Err(error @ FollowError::Render(RenderError::Gpu(_))) => return Err(error),
                Err(error) => {
                    self.unreadable.insert(page);
                    self.problem = Some(format!("{}: {error}", self.path.display()));
                }
                Ok(()) => {}
            }
        }
        let mut view = self.scene.in_view(camera, options);
        view.missing.retain(|page| !self.unreadable.contains(page));
        for &page in &view.missing {
            if self.asked.len() < ASKED_AT_ONCE {
                self.ask(page);
            }
        }
        Ok(view)
    }

    fn ask(&mut self, page: u32) {
        if self.asked.insert(page) {
            // A thread that is gone is noticed where its pages are awaited.
            drop(self.asks.send((page, self.scene.pages()[page as usize].clone())));
        }
    }

    /// Places a page that was read, unless the view no longer wants it and has no room.
    fn take(&mut self, (page, rows): (u32, Result<Gaussians, IoError>)) -> Result<(), FollowError> {
        self.asked.remove(&page);
        self.scene.place(page, &rows?)?;
        Ok(())
    }

    fn gone(&self) -> IoError {
        IoError::new(&self.path, "can no longer be read: the thread that reads it is gone")
    }
}
