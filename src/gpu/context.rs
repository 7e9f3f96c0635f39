//! The open device: instance, device, queue, memory and pipelines.

use std::ffi::CString;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ash::{ext, vk};
use gpu_allocator::vulkan::Allocation;
use raw_window_handle::RawDisplayHandle;

use super::buffer::BufferMemory;
use super::caps::DeviceCaps;
use super::device::{OwnedDevice, RawDevice, check_features, queue_family_properties};
use super::error::GpuError;
use super::faults::{Fate, Faults};
use super::instance::{OwnedInstance, choose_device, enumerate};
use super::memory::{Memory, MemoryUse};
use super::pipeline::PipelineStore;
use super::statistics::DriverStatistics;
use super::timeline::{SubmissionCounts, Ticket, Timeline};
use super::tuning::Tuning;
use super::validation::ValidationMessages;

/// Selects one of the machine's devices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first discrete device, else the first integrated, virtual or CPU device.
    #[default]
    Best,
    /// Index in the list that `instgs-vk info` prints.
    Index(usize),
    /// A part of the device's name, case-insensitive.
    Name(String),
}

impl std::str::FromStr for DeviceChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Name(text.into()), Self::Index))
    }
}

/// Options for opening a device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Selects the device to open.
    pub device: DeviceChoice,
    /// Load the validation layers with synchronization validation; an error if they are not installed.
    pub validation: bool,
    /// The display whose windows the device is to draw into; without one it draws into buffers only.
    pub display: Option<RawDisplayHandle>,
    /// Ask the driver what it made of every pipeline, for [`Gpu::compiled_pipelines`]; an error if it does not say.
    pub pipeline_statistics: bool,
    /// Pretend that kernels may bind at most this many storage buffers, to test that limit.
    pub most_storage_buffers: Option<u32>,
    /// Pretend that a binding has at most this many bytes, to test how large scenes behave on such a device.
    pub most_binding_bytes: Option<u64>,
    /// Numbers that replace those that are picked for the device.
    pub tuning: Tuning,
    /// Faults to plant, to test what becomes of them.
    pub faults: Option<Arc<Faults>>,
}

/// Calls its argument, once and before it returns, while nobody else uses the queue.
pub type QueueLock = Arc<dyn Fn(&mut dyn FnMut()) + Send + Sync>;

/// The buffers that a submission uses.
struct InFlight {
    ticket: Ticket,
    buffers: Vec<Arc<BufferMemory>>,
}

/// The open device, shared by everything that allocates or submits.
///
/// [`Gpu::open`] creates an instance and a device and destroys them; [`Gpu::from_raw`] uses those of the caller.
// Fields are dropped in this order: objects of the device before the device, and the device before its instance.
pub struct Gpu {
    pub(super) pipelines: PipelineStore,
    pub(super) timeline: Timeline,
    pub(super) memory: Memory,
    in_flight: Mutex<Vec<InFlight>>,
    /// Number of the latest recording.
    recordings: AtomicU64,
    queue: Mutex<vk::Queue>,
    queue_lock: Option<QueueLock>,
    queue_family: u32,
    /// Number of valid bits in a timestamp; 0 = the queue has no timestamps.
    pub(super) timestamp_bits: u32,
    debug_names: Option<ext::debug_utils::Device>,
    /// What the driver says of pipelines, if the device was opened for it.
    pub(super) statistics: Option<DriverStatistics>,
    caps: DeviceCaps,
    messages: ValidationMessages,
    faults: Option<Arc<Faults>>,
    physical: vk::PhysicalDevice,
    pub(super) device: ash::Device,
    instance: ash::Instance,
    /// `None` if the device is the caller's.
    _owned_device: Option<OwnedDevice>,
    /// `None` if the instance is the caller's.
    _owned_instance: Option<OwnedInstance>,
    /// Keeps the Vulkan loader library loaded.
    entry: ash::Entry,
}

/// The parts of a [`Gpu`] under construction.
struct Parts {
    own: OwnParts,
    raw: RawDevice,
    caps: DeviceCaps,
    timestamp_bits: u32,
}

/// What only a device has that this crate has opened itself. Fields are dropped in this order if construction fails.
#[derive(Default)]
struct OwnParts {
    device: Option<OwnedDevice>,
    instance: Option<OwnedInstance>,
    debug_names: Option<ext::debug_utils::Device>,
    statistics: Option<DriverStatistics>,
    faults: Option<Arc<Faults>>,
}

impl Gpu {
    /// Opens a device with an instance of its own.
    ///
    /// # Errors
    /// No loader, no matching device, a missing feature, or no validation layers although they were asked for. A device
    /// that binds too few storage buffers for a kernel is opened; the first pipeline that needs more is the error.
    pub fn open(options: &GpuOptions) -> Result<Arc<Self>, GpuError> {
        let owned = OwnedInstance::new(options, &ValidationMessages::default())?;
        let (entry, instance) = (owned.entry.clone(), owned.instance.clone());
        let (physical, mut caps) = choose_device(&instance, &options.device)?;
        caps.max_storage_bytes = caps.max_storage_bytes.min(options.most_binding_bytes.unwrap_or(u64::MAX));
        caps.max_storage_buffers = caps.max_storage_buffers.min(options.most_storage_buffers.unwrap_or(u32::MAX));
        caps.tuning = options.tuning.clone();
        let opened = OwnedDevice::new(&instance, physical, &caps, options)?;
        let device = opened.device.clone();
        let (queue_family, timestamp_bits) = (opened.queue_family, opened.timestamp_bits);
        // SAFETY: the family was requested with one queue at device creation.
        let queue = unsafe { device.get_device_queue(queue_family, 0) };
        let debug_names = options.validation.then(|| ext::debug_utils::Device::new(&instance, &device));
        let statistics = options.pipeline_statistics.then(|| DriverStatistics::new(&instance, &device));
        let raw = RawDevice { entry, instance, physical, device, queue, queue_family, queue_lock: None };
        let faults = options.faults.clone();
        let own = OwnParts { device: Some(opened), instance: Some(owned), debug_names, statistics, faults };
        Self::assemble(Parts { own, raw, caps, timestamp_bits })
    }

    /// Uses a device of the caller's. Nothing of it is destroyed here.
    ///
    /// # Errors
    /// The device does not offer what this crate needs (what was enabled cannot be checked), or memory is exhausted.
    ///
    /// # Safety
    /// - The handles belong together: `physical` is of `instance`, `device` was made from `physical`, `queue` is of `device`
    ///   and of family `queue_family`, which does compute. The instance was made for Vulkan 1.3 or later.
    /// - The device was created with what [`RawDevice::required_features`] and [`RawDevice::required_extensions`] name. It
    ///   may have more.
    /// - Instance and device live until the last `Arc` of the returned value is gone. Everything that this crate makes
    ///   from it (buffers, renderers, scenes ...) holds one.
    /// - If `queue_lock` is `None`, the caller uses the queue only while no call into this crate runs that submits
    ///   (everything that uploads, downloads or renders; `record_into_image` does not). Else the lock is as
    ///   [`QueueLock`] says, and the caller holds the same lock when it uses the queue.
    pub unsafe fn from_raw(raw: RawDevice) -> Result<Arc<Self>, GpuError> {
        // SAFETY: `physical` is of `instance`, which is for Vulkan 1.3 (the caller's promise).
        let version = unsafe { raw.instance.get_physical_device_properties(raw.physical) }.api_version;
        if version < vk::API_VERSION_1_3 {
            let feature = "Vulkan 1.3".into();
            return Err(GpuError::MissingFeature { device: "of the caller".into(), feature });
        }
        let caps = DeviceCaps::read(&raw.instance, raw.physical);
        check_features(&raw.instance, raw.physical, &caps)?;
        let families = queue_family_properties(&raw.instance, raw.physical);
        let family = families.get(raw.queue_family as usize);
        let Some(family) = family.filter(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE)) else {
            return Err(GpuError::MissingFeature { device: caps.name, feature: "compute on the queue given".into() });
        };
        let timestamp_bits = family.timestamp_valid_bits;
        Self::assemble(Parts { own: OwnParts::default(), raw, caps, timestamp_bits })
    }

    fn assemble(parts: Parts) -> Result<Arc<Self>, GpuError> {
        let memory = Memory::new(&parts.raw.instance, &parts.raw.device, parts.raw.physical)?;
        let timeline = Timeline::new(&parts.raw.device);
        let messages = parts.own.instance.as_ref().map(OwnedInstance::messages).unwrap_or_default();
        let RawDevice { entry, instance, physical, device, queue, queue_family, queue_lock } = parts.raw;
        let gpu = Self {
            pipelines: PipelineStore::default(),
            timeline,
            memory,
            in_flight: Mutex::default(),
            recordings: AtomicU64::new(0),
            queue: Mutex::new(queue),
            queue_lock,
            queue_family,
            timestamp_bits: parts.timestamp_bits,
            debug_names: parts.own.debug_names,
            statistics: parts.own.statistics,
            caps: parts.caps,
            messages,
            faults: parts.own.faults,
            physical,
            device,
            instance,
            _owned_device: parts.own.device,
            _owned_instance: parts.own.instance,
            entry,
        };
        gpu.set_memory_budget(u64::MAX);
        Ok(Arc::new(gpu))
    }

    /// Limits and features of all devices of this machine, in the order of `DeviceChoice::Index`.
    pub fn list() -> Result<Vec<DeviceCaps>, GpuError> {
        let owned = OwnedInstance::new(&GpuOptions::default(), &ValidationMessages::default())?;
        Ok(enumerate(&owned.instance)?.into_iter().map(|(_, caps)| caps).collect())
    }

    /// Limits and features of the device.
    pub fn caps(&self) -> &DeviceCaps {
        &self.caps
    }

    /// Messages of the validation layers so far (empty unless opened with validation).
    pub fn validation_messages(&self) -> &ValidationMessages {
        &self.messages
    }

    /// Device memory, bytes: allocated now, and the peak since the last `reset_memory_peak`.
    pub fn memory_usage(&self) -> (u64, u64) {
        self.memory.usage()
    }

    /// Starts a new peak measurement.
    pub fn reset_memory_peak(&self) {
        self.memory.reset_peak();
    }

    /// Limits the total of allocations, bytes, existing ones included. `u64::MAX` = no limit but the device's.
    pub fn set_memory_budget(&self, bytes: u64) {
        self.memory.set_budget(bytes.min(self.planned_heap_bytes()));
    }

    /// The smaller of the limit that was set and the largest device-local heap, bytes.
    pub fn memory_budget(&self) -> u64 {
        self.memory.budget().min(self.device_heap_bytes())
    }

    /// Bytes of the largest device-local heap.
    pub fn device_heap_bytes(&self) -> u64 {
        // SAFETY: `physical` belongs to `instance`.
        let properties = unsafe { self.instance.get_physical_device_memory_properties(self.physical) };
        let heaps = &properties.memory_heaps[..properties.memory_heap_count as usize];
        let local = heaps.iter().filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        local.map(|h| h.size).max().unwrap_or(0).min(self.planned_heap_bytes())
    }

    /// Bytes of the only heap, if a test plans one.
    fn planned_heap_bytes(&self) -> u64 {
        self.faults.as_ref().and_then(|faults| faults.heap_bytes()).unwrap_or(u64::MAX)
    }

    /// What becomes of the next submission, as far as faults are planned for it.
    pub(super) fn fate_of_submission(&self) -> Fate {
        let Some(faults) = &self.faults else { return Fate::Runs };
        // The device that is lost refuses everything from then on.
        if self.timeline.is_lost() { Fate::Refused } else { faults.submission() }
    }

    /// Submissions and host waits since the device was opened.
    pub fn submission_counts(&self) -> SubmissionCounts {
        self.timeline.counts()
    }

    /// The loader's functions.
    pub fn raw_entry(&self) -> &ash::Entry {
        &self.entry
    }

    /// The instance. It must not be destroyed unless it is the caller's own.
    pub fn raw_instance(&self) -> &ash::Instance {
        &self.instance
    }

    /// The physical device.
    pub fn raw_physical_device(&self) -> vk::PhysicalDevice {
        self.physical
    }

    /// The device. It must not be destroyed unless it is the caller's own, and objects made from it must be destroyed before
    /// the last `Arc` of `self` is gone if it is not.
    pub fn raw_device(&self) -> &ash::Device {
        &self.device
    }

    /// Family index of the queue that everything is submitted to.
    pub fn queue_family(&self) -> u32 {
        self.queue_family
    }

    /// Runs `work` with the queue while nothing else uses it. `work` must not submit through this crate: that would
    /// deadlock.
    ///
    /// # Errors
    /// The caller's [`QueueLock`] returned without calling its argument.
    pub fn with_queue<R>(&self, work: impl FnOnce(vk::Queue) -> R) -> Result<R, GpuError> {
        // A panic in another thread leaves the handle intact.
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(lock) = &self.queue_lock else { return Ok(work(*queue)) };
        let (mut work, mut result) = (Some(work), None);
        lock(&mut || {
            if let Some(work) = work.take() {
                result = Some(work(*queue));
            }
        });
        result.ok_or(GpuError::QueueLock)
    }

    /// Blocks until a submission has finished.
    pub fn wait(&self, ticket: Ticket) -> Result<(), GpuError> {
        self.wait_for(ticket).map_err(GpuError::vulkan("waiting for the device"))
    }

    /// Waits like [`Gpu::wait`]; the error is Vulkan's result code.
    pub(super) fn wait_for(&self, ticket: Ticket) -> Result<(), vk::Result> {
        let waited = self.timeline.wait(ticket);
        self.release_finished();
        waited
    }

    /// True if a submission has finished, or never will because the device is lost.
    pub fn is_over(&self, ticket: Ticket) -> bool {
        self.timeline.is_over(ticket)
    }

    /// Blocks until everything submitted by this crate has finished.
    pub fn wait_all(&self) -> Result<(), GpuError> {
        self.wait(self.timeline.last())
    }

    /// A number that no other recording has; 1 or more.
    pub(super) fn next_recording(&self) -> u64 {
        self.recordings.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// Keeps the buffers of a submission until it has finished.
    pub(super) fn keep_until(&self, ticket: Ticket, buffers: Vec<Arc<BufferMemory>>) {
        let mut in_flight = self.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        in_flight.push(InFlight { ticket, buffers });
    }

    /// Releases the buffers of finished submissions.
    pub(super) fn release_finished(&self) {
        let mut in_flight = self.in_flight.lock().unwrap_or_else(PoisonError::into_inner);
        if in_flight.is_empty() {
            return;
        }
        let finished = self.timeline.finished();
        let over: Vec<InFlight> = in_flight.extract_if(.., |submission| submission.ticket <= finished).collect();
        drop(in_flight);
        over.into_iter().for_each(|submission| drop(submission.buffers));
    }

    /// Allocates device memory. If there is not enough, waits until submissions release theirs and tries again.
    pub(super) fn allocate(
        &self,
        name: &str,
        requirements: vk::MemoryRequirements,
        memory_use: MemoryUse,
    ) -> Result<Allocation, GpuError> {
        self.release_finished();
        if self.faults.as_ref().is_some_and(|faults| faults.refuses_allocation()) {
            let (name, bytes) = (name.into(), requirements.size);
            return Err(GpuError::OutOfMemory { name, bytes, missing: bytes, reason: "a test refuses it".into() });
        }
        match self.memory.allocate(name, requirements, memory_use) {
            Err(GpuError::OutOfMemory { .. }) if !self.is_over(self.timeline.last()) => {
                self.wait_all()?;
                self.memory.allocate(name, requirements, memory_use)
            }
            allocated => allocated,
        }
    }

    /// True if the device was opened with validation.
    pub(super) fn is_debugged(&self) -> bool {
        self.debug_names.is_some()
    }

    /// Names a Vulkan object for debuggers and validation messages.
    pub(crate) fn set_name<H: vk::Handle>(&self, object: H, name: &str) {
        let (Some(debug), Ok(name)) = (&self.debug_names, CString::new(name)) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the object was created from this device. A failure to name it has no consequence.
        let _ = unsafe { debug.set_debug_utils_object_name(&info) };
    }
}

impl Drop for Gpu {
    fn drop(&mut self) {
        // A lost device returns an error here; destruction is then allowed as well. Other queues of a caller's device
        // do not use these objects.
        let _ = self.wait_all();
        // SAFETY: buffers, pipelines and recorders hold an Arc of self, so none is left, and all submissions are over.
        unsafe { self.pipelines.destroy(&self.device) };
    }
}
