//! The training pictures on the device: all of them if they fit, else the first ones permanently and the others in
//! turn, decoded ahead by worker threads. A picture of the others is copied to the device by the step that uses it, so that
//! nothing waits for the copy. Where memory runs out, pictures that stay give way to what cannot be streamed.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

use instgs_io::view_image::{IGNORED, LoadedView, ViewImage};
use instgs_io::{IoError, View};
use instgs_vk::gpu::staging::upload;
use instgs_vk::gpu::{Buffer, Gpu, Recorder};
use instgs_vk::scene::Camera;

use super::error::TrainError;
use super::view_order::ViewOrder;
use super::view_store::{PrefetchLimits, Prefetcher, load_all};

/// A training picture on the device.
pub struct DeviceView {
    /// The camera, of the picture's size.
    pub camera: Camera,
    /// RGBA of 8 bits each, row by row from the top; the meaning of the last byte is in `instgs_io::view_image`.
    pub targets: Buffer<u32>,
}

/// Streamed pictures that stay on the device: those of the steps in flight, in case they are repeated, and the next.
const STREAMED: usize = 4;

/// A picture that is on the device for a few steps.
struct Streamed {
    index: usize,
    view: DeviceView,
    /// The same pixels in memory that the host writes; `None` if the picture was on the device already.
    staging: Option<Buffer<u32>>,
    /// True once a step that copies the pixels to the device has been submitted.
    is_copied: bool,
}

/// Provides the steps with their pictures.
pub struct TrainViews {
    gpu: Arc<Gpu>,
    /// The first views, as many as fit the budget.
    resident: Vec<DeviceView>,
    /// The most recently used of the others.
    streamed: VecDeque<Streamed>,
    prefetcher: Option<Prefetcher>,
    count: usize,
    largest_px: [u32; 2],
    bytes: u64,
    /// A photo whose mask leaves nothing, and the number of such photos.
    hidden: Option<(PathBuf, usize)>,
    /// The files of the pictures, for those that are streamed; `None` if there are none.
    files: Option<Files>,
    /// The pictures of the last steps, the newest at the end.
    last_used: VecDeque<usize>,
    /// Number of pictures that stay since some gave way, if that has not been reported yet.
    given_way: Option<usize>,
}

/// Where pictures are decoded from, and in which order steps ask for them.
struct Files {
    views: Vec<View>,
    width: Option<u32>,
    seed: u64,
}

/// Which pictures are loaded, and in which order.
pub struct ViewsPlan<'a> {
    /// All training views of the data set.
    pub views: &'a [View],
    /// Width to downscale the pictures to, pixels.
    pub width: Option<u32>,
    /// Device memory that pictures may take, bytes.
    pub budget_bytes: u64,
    /// Seed of the order of views.
    pub seed: u64,
    /// Index of the first step that will ask for a view.
    pub first_step: u64,
}

impl TrainViews {
    /// Loads what fits the budget, and decodes every picture once, so that a damaged one is found now and not after
    /// hours. `on_loaded` is called after each.
    ///
    /// # Errors
    /// The first picture, in order, that cannot be read; the first error of `on_loaded`; the device fails.
    pub fn load(
        gpu: &Arc<Gpu>,
        plan: &ViewsPlan<'_>,
        on_loaded: &mut dyn FnMut() -> Result<(), IoError>,
    ) -> Result<Self, TrainError> {
        let mut out = Self {
            gpu: gpu.clone(),
            resident: Vec::new(),
            streamed: VecDeque::new(),
            prefetcher: None,
            count: plan.views.len(),
            largest_px: [0; 2],
            bytes: 0,
            hidden: None,
            files: Some(Files { views: plan.views.to_vec(), width: plan.width, seed: plan.seed }),
            last_used: VecDeque::new(),
            given_way: None,
        };
        let mut full = false;
        load_all::<TrainError>(plan.views, plan.width, PrefetchLimits::default(), &mut |index, loaded| {
            if loaded.image.rgba.iter().all(|pixel| pixel[3] == IGNORED) {
                let first = out.hidden.take().unwrap_or_else(|| (plan.views[index].image_path.clone(), 0));
                out.hidden = Some((first.0, first.1 + 1));
            }
            out.largest_px[0] = out.largest_px[0].max(loaded.image.width);
            out.largest_px[1] = out.largest_px[1].max(loaded.image.height);
            full |= out.bytes + loaded.image.bytes() > plan.budget_bytes;
            if !full {
                match device_view(gpu, &loaded).map_err(TrainError::from) {
                    Ok(view) => {
                        out.bytes += loaded.image.bytes();
                        out.resident.push(view);
                    }
                    // The state came first, and has grown. Steps want room, too, so that half of what fits gives way at once.
                    Err(error) if error.missing_bytes().is_some() => {
                        full = true;
                        out.resident.truncate(out.resident.len() / 2);
                        out.bytes = out.resident.iter().map(|view| view.targets.bytes()).sum();
                        out.given_way = Some(out.resident.len());
                    }
                    Err(error) => return Err(error),
                }
            }
            Ok(on_loaded()?)
        })?;
        if let Some((path, count)) = out.hidden.as_ref().filter(|(_, count)| *count == out.count) {
            let others =
                if *count > 1 { format!(", nor do those of the other {} photos", count - 1) } else { String::new() };
            let what = format!("its mask leaves nothing to train on{others}");
            let advice =
                "a mask of pixels that count is white where they do; take mask_path out, or leave --pixel-masks out";
            return Err(IoError::new(path, what).advise(advice).into());
        }
        if out.resident.len() < out.count {
            out.stream_from(plan.first_step);
        }
        Ok(out)
    }

    /// Begins to decode the pictures that do not stay, for the steps from `step` on.
    fn stream_from(&mut self, step: u64) {
        let Some(files) = &self.files else { return };
        let (resident, mut order) = (self.resident.len(), ViewOrder::new(files.seed, self.count));
        let sequence = (step..).map_while(move |step| order.view_at(step)).filter(move |&i| i >= resident);
        // On other devices, device memory is the machine's memory, which is already full.
        let limits = match self.gpu.caps().device_type {
            "discrete" => PrefetchLimits::with_cache(),
            _ => PrefetchLimits::default(),
        };
        self.prefetcher = Some(Prefetcher::new(files.views.clone(), files.width, sequence, limits));
    }

    /// Takes half of the pictures that stay off the device, at least one, and waits for the device, so that their memory is
    /// free; from `step` on, which is the next to be recorded, they are streamed. False if none stays, or they have no files.
    ///
    /// # Errors
    /// The device was lost while steps in flight were waited for.
    pub fn give_way(&mut self, step: u64) -> Result<bool, TrainError> {
        if self.resident.is_empty() || self.files.is_none() {
            return Ok(false);
        }
        self.gpu.wait_all()?;
        let kept = self.resident.len() / 2;
        for (index, view) in (kept..).zip(self.resident.split_off(kept)) {
            self.bytes -= view.targets.bytes();
            // Steps in flight may be repeated.
            if self.last_used.contains(&index) {
                self.streamed.push_back(Streamed { index, view, staging: None, is_copied: true });
            }
        }
        // The newest at the end, and those that no step in flight uses first.
        let used = |s: &Streamed| self.last_used.iter().rposition(|index| *index == s.index);
        self.streamed.make_contiguous().sort_by_key(used);
        while self.streamed.len() > STREAMED {
            self.streamed.pop_front();
        }
        self.stream_from(step);
        self.given_way = Some(kept);
        Ok(true)
    }

    /// What there is to say if pictures gave way since the last call.
    pub fn take_given_way(&mut self) -> Option<String> {
        let kept = self.given_way.take()?;
        Some(format!(
            "device memory is short: {kept} of {} photos stay on the device, the others are copied to it again and again",
            self.count
        ))
    }

    /// Has picture `index` ready to be recorded; waits until it is decoded. Steps ask in their order, from the first one on;
    /// the last few may be asked for again.
    ///
    /// # Errors
    /// The picture cannot be read, or is not the next of the sequence; the device's memory is full.
    pub fn prepare(&mut self, index: usize) -> Result<(), TrainError> {
        // A step that is recorded again counts once: a picture of a step in flight that were forgotten would be decoded again.
        if self.last_used.back() != Some(&index) {
            self.last_used.push_back(index);
        }
        if self.last_used.len() > STREAMED {
            self.last_used.pop_front();
        }
        if index < self.resident.len() {
            return Ok(());
        }
        if let Some(place) = self.place_of(index) {
            // The picture last used moves to the end, so that steps in flight find theirs again.
            self.streamed.make_contiguous()[place..].rotate_left(1);
            return Ok(());
        }
        let loaded = self.next_streamed(index)?;
        let pixels = pixels_of(&loaded);
        // The picture used least recently is that of a step long collected.
        let oldest = if self.streamed.len() < STREAMED { None } else { self.streamed.pop_front() };
        let (mut staging, targets) = match oldest {
            Some(Streamed { staging: Some(staging), view, .. }) if staging.len() == pixels.len() => {
                (staging, view.targets)
            }
            _ => {
                let staging = Buffer::for_upload(&self.gpu, "training picture on the host", pixels.len())?;
                (staging, Buffer::new(&self.gpu, "training picture", pixels.len())?)
            }
        };
        staging.write_mapped(&pixels)?;
        let view = DeviceView { camera: loaded.camera.clone(), targets };
        self.streamed.push_back(Streamed { index, view, staging: Some(staging), is_copied: false });
        Ok(())
    }

    /// Picture `index`, which was prepared; records its copy to the device if it is not there yet.
    ///
    /// # Errors
    /// [`TrainError::UnknownView`] if the picture is neither resident nor among the last that [`TrainViews::prepare`] was asked
    /// for; a copy that does not fit its buffer.
    pub fn record(&mut self, index: usize, recorder: &mut Recorder) -> Result<&DeviceView, TrainError> {
        if index < self.resident.len() {
            return Ok(&self.resident[index]);
        }
        let place = self.place_of(index).ok_or(TrainError::UnknownView(index))?;
        let Streamed { view, staging, is_copied, .. } = &mut self.streamed[place];
        if let (Some(staging), false) = (staging, *is_copied) {
            recorder.copy(staging, &mut view.targets, staging.bytes())?;
        }
        Ok(view)
    }

    /// The step that [`TrainViews::record`] was called for is submitted.
    pub fn submitted(&mut self, index: usize) {
        self.streamed.iter_mut().filter(|s| s.index == index).for_each(|s| s.is_copied = true);
    }

    fn place_of(&self, index: usize) -> Option<usize> {
        self.streamed.iter().position(|s| s.index == index)
    }

    fn next_streamed(&mut self, index: usize) -> Result<Arc<LoadedView>, TrainError> {
        for loaded in self.prefetcher.iter_mut().flatten() {
            let (found, view) = loaded?;
            if found == index {
                return Ok(view);
            }
        }
        Err(TrainError::NotPrefetched(index))
    }

    /// A warning if there are photos whose masks leave nothing to train on.
    pub fn without_pixels(&self) -> Option<String> {
        let (path, count) = self.hidden.as_ref()?;
        Some(format!("{}: its mask leaves nothing to train on; {count} such photos", path.display()))
    }

    /// Number of training views.
    pub fn len(&self) -> usize {
        self.count
    }

    /// True if there are no views.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Width and height that no picture exceeds.
    pub fn largest_px(&self) -> [u32; 2] {
        self.largest_px
    }

    /// Device bytes of the pictures that stay.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Number of pictures that stay on the device.
    pub fn resident(&self) -> usize {
        self.resident.len()
    }

    /// Makes the store from decoded pictures, for tests and tools.
    pub fn from_images(gpu: &Arc<Gpu>, images: &[LoadedView]) -> Result<Self, TrainError> {
        let resident = images.iter().map(|v| device_view(gpu, v)).collect::<Result<Vec<_>, _>>()?;
        let largest = |side: fn(&ViewImage) -> u32| images.iter().map(|v| side(&v.image)).max().unwrap_or(0);
        Ok(Self {
            gpu: gpu.clone(),
            count: resident.len(),
            bytes: images.iter().map(|v| v.image.bytes()).sum(),
            resident,
            streamed: VecDeque::new(),
            prefetcher: None,
            largest_px: [largest(|i| i.width), largest(|i| i.height)],
            hidden: None,
            files: None,
            last_used: VecDeque::new(),
            given_way: None,
        })
    }
}

fn device_view(gpu: &Arc<Gpu>, view: &LoadedView) -> Result<DeviceView, instgs_vk::gpu::GpuError> {
    Ok(DeviceView { camera: view.camera.clone(), targets: upload(gpu, "training picture", &pixels_of(view))? })
}

fn pixels_of(view: &LoadedView) -> Vec<u32> {
    view.image.rgba.iter().map(|p| u32::from_le_bytes(*p)).collect()
}
