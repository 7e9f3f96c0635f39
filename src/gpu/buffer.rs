//! Typed storage buffers in device-local or host-visible memory.

use std::marker::PhantomData;
use std::ops::Range;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ash::vk;
use gpu_allocator::vulkan::Allocation;

use super::context::Gpu;
use super::error::{BUFFER_LIMIT, GpuError, STORAGE_LIMIT};
use super::memory::MemoryUse;
use super::timeline::Ticket;

/// Elements of `T` in device memory (or host-visible memory, for staging). Dropping it never waits: the memory is freed when
/// every submission that uses it has finished, and every recording that uses it has been submitted or abandoned.
// repr(C): buffers of all element types have the same layout, so that `scalars` may reinterpret one as another.
#[repr(C)]
pub struct Buffer<T> {
    inner: Arc<BufferMemory>,
    marker: PhantomData<T>,
}

/// The Vulkan buffer behind a [`Buffer`]: shared by the recordings and submissions that use it, freed with the last.
pub(crate) struct BufferMemory {
    gpu: Arc<Gpu>,
    handle: vk::Buffer,
    allocation: Option<Allocation>,
    memory_use: MemoryUse,
    bytes: u64,
    name: String,
    /// Number of the last recording that keeps this buffer (see `Recorder::keep`).
    last_recording: AtomicU64,
    /// Ticket of the last submission that uses this buffer; 0 = none.
    last_ticket: AtomicU64,
}

impl BufferMemory {
    pub(crate) fn handle(&self) -> vk::Buffer {
        self.handle
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Size of the elements, without padding.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    pub(crate) fn is_of(&self, gpu: &Arc<Gpu>) -> bool {
        Arc::ptr_eq(&self.gpu, gpu)
    }

    /// Notes that `recording` keeps this buffer; true if it did so before. Numbers of recordings are never reused.
    pub(crate) fn is_kept_by(&self, recording: u64) -> bool {
        // Two recorders that use the buffer in turn each keep it more than once, which is harmless.
        let kept = self.last_recording.load(Ordering::Relaxed) == recording;
        if !kept {
            self.last_recording.store(recording, Ordering::Relaxed);
        }
        kept
    }

    /// Notes that a submission uses this buffer.
    pub(crate) fn submitted(&self, ticket: Ticket) {
        self.last_ticket.fetch_max(ticket.0, Ordering::SeqCst);
    }

    /// Host address of the first byte, once no submission uses the buffer any more; `None` if it is not
    /// host-visible, or the wait failed.
    fn mapped_when_idle(&self) -> Option<NonNull<u8>> {
        let mapped = self.allocation.as_ref()?.mapped_ptr()?;
        match self.gpu.wait_for(Ticket(self.last_ticket.load(Ordering::SeqCst))) {
            // A lost device no longer touches the memory either.
            Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST) => Some(mapped.cast()),
            Err(_) => None,
        }
    }
}

impl Drop for BufferMemory {
    fn drop(&mut self) {
        // SAFETY: the recordings and submissions that use the handle share this value, and the last of them is gone.
        unsafe { self.gpu.device.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            self.gpu.memory.free(allocation, self.memory_use);
        }
    }
}

/// A run of bytes of a buffer, which a dispatch binds instead of the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferPart {
    pub(super) buffer: vk::Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Where a buffer lives that kernels read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Home {
    /// In device memory, which is fast to read and may be too small.
    #[default]
    Device,
    /// In host memory: kernels read it over the bus. It does not count against the budget of device memory.
    Host,
}

impl Home {
    fn memory_use(self) -> MemoryUse {
        match self {
            Self::Device => MemoryUse::Device,
            Self::Host => MemoryUse::DeviceOnHost,
        }
    }
}

/// Parts begin at multiples of this: the largest `minStorageBufferOffsetAlignment` that Vulkan allows.
pub const PART_ALIGNMENT: u64 = 256;

/// Runs of rows of `row_bytes` bytes, a multiple of 4, that a binding has room for: together all `rows`, and one empty run if there
/// are none. All but the last end at a multiple of [`PART_ALIGNMENT`] bytes.
pub fn bound_runs(gpu: &Gpu, rows: usize, row_bytes: u64) -> impl Iterator<Item = Range<usize>> + use<> {
    const ROWS: u64 = PART_ALIGNMENT / 4;
    let at_once = (gpu.caps().max_storage_bytes / row_bytes / ROWS * ROWS).max(ROWS);
    let at_once = usize::try_from(at_once).unwrap_or(usize::MAX).min(rows.max(1));
    (0..rows.div_ceil(at_once).max(1)).map(move |k| k * at_once..rows.min((k + 1) * at_once))
}

/// Kernels access four elements at a time, even beyond the last one: 16 bytes of f32, or 32 of Adam's pairs of moments.
fn padded_bytes(bytes: u64) -> u64 {
    bytes.next_multiple_of(32)
}

impl<T: bytemuck::NoUninit> Buffer<T> {
    /// A device-local storage buffer with undefined contents. `len` 0 is made 1, since Vulkan has no empty buffers.
    ///
    /// # Errors
    /// The buffer is larger than a storage binding may be, or memory is exhausted; the error names the buffer.
    pub fn new(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::for_use(gpu, name, len, MemoryUse::Device)
    }

    /// The same as [`Buffer::new`], but it may be larger than a binding: then dispatches bind parts of it. It lives at `home`.
    ///
    /// # Errors
    /// The buffer is larger than the device allows, or memory is exhausted; the error names the buffer.
    pub fn in_parts(gpu: &Arc<Gpu>, name: &str, len: usize, home: Home) -> Result<Self, GpuError> {
        Self::within(gpu, name, len, home.memory_use(), (gpu.caps().max_buffer_bytes, BUFFER_LIMIT))
    }

    /// The same as [`Buffer::new`], at `home`.
    ///
    /// # Errors
    /// The same errors as [`Buffer::new`].
    pub fn at(gpu: &Arc<Gpu>, name: &str, len: usize, home: Home) -> Result<Self, GpuError> {
        Self::for_use(gpu, name, len, home.memory_use())
    }

    /// A host-visible buffer that the host writes and the device reads.
    pub fn for_upload(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::for_use(gpu, name, len, MemoryUse::Upload)
    }

    /// A host-visible buffer that the device writes and the host reads.
    pub fn for_readback(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::for_use(gpu, name, len, MemoryUse::Readback)
    }

    fn for_use(gpu: &Arc<Gpu>, name: &str, len: usize, memory_use: MemoryUse) -> Result<Self, GpuError> {
        Self::within(gpu, name, len, memory_use, (gpu.caps().max_storage_bytes, STORAGE_LIMIT))
    }

    /// A buffer of at most `limit` bytes, and what Vulkan calls this limit.
    fn within(
        gpu: &Arc<Gpu>,
        name: &str,
        len: usize,
        memory_use: MemoryUse,
        (limit, limit_name): (u64, &'static str),
    ) -> Result<Self, GpuError> {
        let bytes = (len.max(1) as u64).saturating_mul(size_of::<T>() as u64);
        if bytes > limit {
            return Err(GpuError::BufferTooLarge { name: name.into(), bytes, limit, limit_name });
        }
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(padded_bytes(bytes)).usage(usage);
        // SAFETY: a valid create-info; the handle is destroyed when `memory` is dropped.
        let handle = unsafe { gpu.device.create_buffer(&info, None) }.map_err(GpuError::vulkan(name))?;
        let mut memory = BufferMemory {
            gpu: gpu.clone(),
            handle,
            allocation: None,
            memory_use,
            bytes,
            name: name.into(),
            last_recording: AtomicU64::new(0),
            last_ticket: AtomicU64::new(0),
        };
        // SAFETY: the handle was just created by this device.
        let requirements = unsafe { gpu.device.get_buffer_memory_requirements(handle) };
        let allocation = memory.allocation.insert(gpu.allocate(name, requirements, memory_use)?);
        // SAFETY: memory and offset come from the allocator for these requirements, and are bound once.
        let bound = unsafe { gpu.device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) };
        bound.map_err(GpuError::vulkan(name))?;
        gpu.set_name(handle, name);
        Ok(Self { inner: Arc::new(memory), marker: PhantomData })
    }

    /// The part from byte `first`, a multiple of [`PART_ALIGNMENT`], up to byte `end` or the end of the buffer. If that is
    /// empty, it is the beginning of the buffer: a binding cannot be empty.
    ///
    /// # Panics
    /// If `first` is not such a multiple.
    pub fn part(&self, first: u64, end: u64) -> BufferPart {
        assert!(first.is_multiple_of(PART_ALIGNMENT), "{}: a part from byte {first}", self.name());
        let end = end.min(self.padded_bytes()).next_multiple_of(4);
        let (offset, bytes) = if first < end { (first, end - first) } else { (0, self.padded_bytes().min(32)) };
        BufferPart { buffer: self.handle(), offset, bytes }
    }

    /// Bytes that kernels may touch: the elements and their padding.
    pub fn padded_bytes(&self) -> u64 {
        padded_bytes(self.inner.bytes)
    }

    /// Number of elements, 1 or more.
    pub fn len(&self) -> usize {
        self.inner.bytes as usize / size_of::<T>()
    }

    /// Always false: buffers have at least one element.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Size of the elements, bytes, without padding.
    pub fn bytes(&self) -> u64 {
        self.inner.bytes
    }

    /// The name that the buffer was created with.
    pub fn name(&self) -> &str {
        self.inner.name()
    }

    /// The Vulkan buffer, with usage `STORAGE_BUFFER`, `INDIRECT_BUFFER`, `TRANSFER_SRC` and `TRANSFER_DST`. It is destroyed
    /// with `self` unless a recording or submission of this crate uses it.
    pub fn handle(&self) -> vk::Buffer {
        self.inner.handle()
    }

    /// The shared part, which recordings keep.
    pub(crate) fn inner(&self) -> &Arc<BufferMemory> {
        &self.inner
    }

    /// The mapped bytes of a host-visible buffer; waits for the submissions that use it.
    pub(crate) fn mapped(&self) -> Option<&[u8]> {
        let first = self.inner.mapped_when_idle()?;
        // SAFETY: the allocation is mapped, has at least `bytes` bytes and lives as long as `self`. The device is done
        // with them (command buffers of the caller's are checked before the bytes are read) and stays so while the
        // slice lives: callers, all of this crate, do not submit in between. The host writes only through `&mut self`.
        Some(unsafe { std::slice::from_raw_parts(first.as_ptr(), self.bytes() as usize) })
    }

    /// The mapped bytes of a host-visible buffer, writable; waits for the submissions that use it.
    pub(crate) fn mapped_mut(&mut self) -> Option<&mut [u8]> {
        let first = self.inner.mapped_when_idle()?;
        // SAFETY: as in `mapped`; `self` is the only way to the bytes on the host, and is borrowed mutably.
        Some(unsafe { std::slice::from_raw_parts_mut(first.as_ptr(), self.bytes() as usize) })
    }
}

impl<T: bytemuck::NoUninit> Buffer<T> {
    /// Writes `data` to the start of a buffer made with [`Buffer::for_upload`]; waits for the submissions that use it.
    ///
    /// # Errors
    /// The buffer is not in memory that the host can write, or the device failed.
    ///
    /// # Panics
    /// If `data` is longer than the buffer.
    pub fn write_mapped(&mut self, data: &[T]) -> Result<(), GpuError> {
        assert!(data.len() <= self.len(), "{}: {} elements into {}", self.name(), data.len(), self.len());
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let Some(mapped) = self.mapped_mut() else { return Err(GpuError::not_mapped(self.name())) };
        mapped[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

impl<T: bytemuck::AnyBitPattern + bytemuck::NoUninit> Buffer<T> {
    /// Element `index` of a buffer made with [`Buffer::for_readback`], once the copy into it is done; zeros for any other buffer.
    pub fn read_mapped(&self, index: usize) -> T {
        let first = index * size_of::<T>();
        let bytes = self.mapped().and_then(|all| all.get(first..first + size_of::<T>()));
        bytes.map_or_else(T::zeroed, bytemuck::pod_read_unaligned)
    }

    /// The first `len` elements of a buffer made with [`Buffer::for_readback`], or all if it has fewer; waits for the
    /// submissions that use it. Empty for any other buffer.
    pub fn read_all_mapped(&self, len: usize) -> Vec<T> {
        let bytes = self.mapped().unwrap_or_default();
        bytes.chunks_exact(size_of::<T>()).take(len).map(bytemuck::pod_read_unaligned).collect()
    }
}

/// An element type that is made of f32 alone.
pub trait Floats: bytemuck::Pod {}
impl Floats for f32 {}
impl<const N: usize> Floats for [f32; N] where [f32; N]: bytemuck::Pod {}

impl<T: Floats> Buffer<T> {
    /// The buffer as flat f32 values, for kernels that treat all parameters alike.
    pub fn scalars(&self) -> &Buffer<f32> {
        // SAFETY: `Buffer` is repr(C), holds no T, and counts bytes; both types are f32 arrays in memory.
        unsafe { &*std::ptr::from_ref(self).cast() }
    }

    /// The same as [`Buffer::scalars`], writable.
    pub fn scalars_mut(&mut self) -> &mut Buffer<f32> {
        // SAFETY: as in `scalars`; the borrow of self lasts as long as the result.
        unsafe { &mut *std::ptr::from_mut(self).cast() }
    }
}

impl<T: Floats> Buffer<T> {
    /// The buffer as vectors of four f32. The last vector may reach into the padding, whose contents are undefined.
    pub fn quads(&self) -> &Buffer<[f32; 4]> {
        // SAFETY: as in `scalars`.
        unsafe { &*std::ptr::from_ref(self).cast() }
    }

    /// The same as [`Buffer::quads`], writable.
    pub fn quads_mut(&mut self) -> &mut Buffer<[f32; 4]> {
        // SAFETY: as in `scalars_mut`.
        unsafe { &mut *std::ptr::from_mut(self).cast() }
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        // Memory that this buffer shares only with finished submissions is freed now instead of at some later time.
        self.inner.gpu.release_finished();
    }
}
