//! Typed storage buffers.

use std::marker::PhantomData;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::Allocation;

use super::context::Gpu;
use super::error::GpuError;

/// Elements of `T` in device memory (or host-visible memory, for staging). Freed on drop, after the device is done.
// repr(C): buffers of all element types have the same layout, so that `scalars` may look at one as another.
#[repr(C)]
pub struct Buffer<T> {
    gpu: Arc<Gpu>,
    handle: vk::Buffer,
    allocation: Option<Allocation>,
    bytes: u64,
    name: String,
    marker: PhantomData<T>,
}

/// Kernels look at four elements at a time, whole or not: 16 bytes of f32, and 32 of Adam's pairs of moments.
fn padded_bytes(bytes: u64) -> u64 {
    bytes.next_multiple_of(32)
}

impl<T: bytemuck::NoUninit> Buffer<T> {
    /// A device-local storage buffer with undefined contents. `len` 0 is made 1, since Vulkan has no empty buffers.
    ///
    /// # Errors
    /// Larger than a storage binding may be, or out of memory; names the buffer.
    pub fn new(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::with_location(gpu, name, len, MemoryLocation::GpuOnly)
    }

    /// A host-visible buffer that the host writes and the device reads.
    pub fn for_upload(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::with_location(gpu, name, len, MemoryLocation::CpuToGpu)
    }

    /// A host-visible buffer that the device writes and the host reads.
    pub fn for_readback(gpu: &Arc<Gpu>, name: &str, len: usize) -> Result<Self, GpuError> {
        Self::with_location(gpu, name, len, MemoryLocation::GpuToCpu)
    }

    fn with_location(gpu: &Arc<Gpu>, name: &str, len: usize, location: MemoryLocation) -> Result<Self, GpuError> {
        let len = len.max(1);
        let bytes = len as u64 * size_of::<T>() as u64;
        let limit = gpu.caps().max_storage_bytes;
        if bytes > limit {
            return Err(GpuError::BufferTooLarge { name: name.into(), bytes, limit });
        }
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::INDIRECT_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(padded_bytes(bytes)).usage(usage);
        // SAFETY: a valid create-info; the handle is destroyed in drop.
        let handle = unsafe { gpu.device.create_buffer(&info, None) }.map_err(GpuError::vulkan(name))?;
        let mut buffer =
            Self { gpu: gpu.clone(), handle, allocation: None, bytes, name: name.into(), marker: PhantomData };
        // SAFETY: the handle is valid; on error below, drop destroys it.
        let requirements = unsafe { gpu.device.get_buffer_memory_requirements(handle) };
        let allocation = gpu.memory.allocate(name, requirements, location)?;
        // SAFETY: memory and offset come from the allocator for these requirements, and are bound once.
        let bound = unsafe { gpu.device.bind_buffer_memory(handle, allocation.memory(), allocation.offset()) };
        buffer.allocation = Some(allocation);
        bound.map_err(GpuError::vulkan(name))?;
        gpu.set_name(handle, name);
        Ok(buffer)
    }

    /// Bytes that kernels may touch: the elements and what pads them.
    pub fn padded_bytes(&self) -> u64 {
        padded_bytes(self.bytes)
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.bytes as usize / size_of::<T>()
    }

    /// Always false: buffers have at least one element.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Size in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The name it was made with.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The Vulkan buffer.
    pub(crate) fn handle(&self) -> vk::Buffer {
        self.handle
    }

    /// The mapped bytes of a host-visible buffer.
    pub(crate) fn mapped(&self) -> Option<&[u8]> {
        let bytes = self.bytes() as usize;
        self.allocation.as_ref().and_then(|a| a.mapped_slice()).map(|all| &all[..bytes])
    }

    /// The mapped bytes of a host-visible buffer, writable.
    pub(crate) fn mapped_mut(&mut self) -> Option<&mut [u8]> {
        let bytes = self.bytes() as usize;
        self.allocation.as_mut().and_then(|a| a.mapped_slice_mut()).map(|all| &mut all[..bytes])
    }
}

impl<T: bytemuck::AnyBitPattern + bytemuck::NoUninit> Buffer<T> {
    /// Element `index` of a buffer made with [`Buffer::for_readback`], once the copy into it is done; zeros for any other buffer.
    pub fn read_mapped(&self, index: usize) -> T {
        let first = index * size_of::<T>();
        let bytes = self.mapped().and_then(|all| all.get(first..first + size_of::<T>()));
        bytes.map_or_else(T::zeroed, bytemuck::pod_read_unaligned)
    }
}

/// An element type that is made of f32 alone.
pub trait Floats: bytemuck::Pod {}
impl Floats for f32 {}
impl<const N: usize> Floats for [f32; N] where [f32; N]: bytemuck::Pod {}

impl<T: Floats> Buffer<T> {
    /// The buffer as flat f32 values, for kernels that do not care what they mean.
    pub fn scalars(&self) -> &Buffer<f32> {
        // SAFETY: `Buffer` is repr(C), holds no T, and counts bytes; both types are f32 arrays in memory.
        unsafe { &*std::ptr::from_ref(self).cast() }
    }

    /// As [`Buffer::scalars`], writable.
    pub fn scalars_mut(&mut self) -> &mut Buffer<f32> {
        // SAFETY: as above; the borrow of self lasts as long as the result.
        unsafe { &mut *std::ptr::from_mut(self).cast() }
    }
}

impl<T: Floats> Buffer<T> {
    /// The buffer as vectors of four f32; the last one may reach beyond the contents, into memory that is the buffer's but
    /// holds nothing.
    pub fn quads(&self) -> &Buffer<[f32; 4]> {
        // SAFETY: as in `scalars`.
        unsafe { &*std::ptr::from_ref(self).cast() }
    }

    /// As [`Buffer::quads`], writable.
    pub fn quads_mut(&mut self) -> &mut Buffer<[f32; 4]> {
        // SAFETY: as in `scalars_mut`.
        unsafe { &mut *std::ptr::from_mut(self).cast() }
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        // A lost device returns an error here; destruction is then allowed as well.
        let _ = self.gpu.wait_all();
        // SAFETY: the device no longer uses the buffer, and nothing else owns the handle.
        unsafe { self.gpu.device.destroy_buffer(self.handle, None) };
        if let Some(allocation) = self.allocation.take() {
            self.gpu.memory.free(allocation);
        }
    }
}
