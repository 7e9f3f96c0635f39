//! Transfer commands of a [`Recorder`]: fill, copy and update.

use std::ops::Range;

use ash::vk;

use super::barrier::Access;
use super::buffer::Buffer;
use super::error::GpuError;
use super::recorder::Recorder;

/// Largest size of one update command, bytes: Vulkan's limit.
const MAX_UPDATE_BYTES: usize = 65536;

impl Recorder {
    /// Fills a whole buffer with one 32-bit value.
    pub fn fill<T: bytemuck::NoUninit>(&mut self, buffer: &mut Buffer<T>, value: u32) -> Result<(), GpuError> {
        self.begin()?;
        self.keep(buffer.inner(), "fill")?;
        self.accesses.clear();
        self.accesses.push((buffer.handle(), Access::COPY_WRITE));
        self.order();
        // SAFETY: the command buffer is recording, and the buffer has transfer usage and is kept.
        unsafe { self.gpu.device.cmd_fill_buffer(self.commands, buffer.handle(), 0, vk::WHOLE_SIZE, value) };
        Ok(())
    }

    /// Copies the first `bytes` bytes of one buffer to the start of another.
    ///
    /// # Panics
    /// If either buffer is shorter than `bytes`.
    pub fn copy<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        target: &mut Buffer<T>,
        bytes: u64,
    ) -> Result<(), GpuError> {
        let fits = bytes <= source.bytes() && bytes <= target.bytes();
        assert!(fits, "{} to {}: {bytes} bytes", source.name(), target.name());
        self.copy_regions(source, target, &[vk::BufferCopy { src_offset: 0, dst_offset: 0, size: bytes }])
    }

    /// Copies `count` elements of the source, from element `first` on, to the start of the target.
    ///
    /// # Panics
    /// If either buffer has too few elements.
    pub fn copy_from<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        first: usize,
        target: &mut Buffer<T>,
        count: usize,
    ) -> Result<(), GpuError> {
        let fits = first + count <= source.len() && count <= target.len();
        assert!(fits, "{}: {count} elements from element {first}", source.name());
        let size = size_of::<T>();
        let (src_offset, bytes) = ((first * size) as u64, (count * size) as u64);
        self.copy_regions(source, target, &[vk::BufferCopy { src_offset, dst_offset: 0, size: bytes }])
    }

    /// Copies the first `count` elements of the source to the target, from its element `first` on.
    ///
    /// # Panics
    /// If either buffer has too few elements.
    pub fn copy_to<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        count: usize,
        target: &mut Buffer<T>,
        first: usize,
    ) -> Result<(), GpuError> {
        let fits = first + count <= target.len() && count <= source.len();
        assert!(fits, "{}: {count} elements to element {first}", target.name());
        let size = size_of::<T>();
        let (dst_offset, bytes) = ((first * size) as u64, (count * size) as u64);
        self.copy_regions(source, target, &[vk::BufferCopy { src_offset: 0, dst_offset, size: bytes }])
    }

    /// Copies single elements of the source, by index, to the start of the target.
    ///
    /// # Panics
    /// If an index exceeds the source, or their number the target.
    pub fn copy_elements<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        indices: &[usize],
        target: &mut Buffer<T>,
    ) -> Result<(), GpuError> {
        assert!(indices.len() <= target.len() && indices.iter().all(|&i| i < source.len()), "{}", source.name());
        let size = size_of::<T>() as u64;
        let region = |(k, &i): (usize, &usize)| vk::BufferCopy {
            src_offset: i as u64 * size,
            dst_offset: k as u64 * size,
            size,
        };
        self.copy_regions(source, target, &indices.iter().enumerate().map(region).collect::<Vec<_>>())
    }

    /// Copies regions that both buffers hold.
    fn copy_regions<T: bytemuck::NoUninit>(
        &mut self,
        source: &Buffer<T>,
        target: &mut Buffer<T>,
        regions: &[vk::BufferCopy],
    ) -> Result<(), GpuError> {
        self.begin()?;
        self.keep(source.inner(), "copy")?;
        self.keep(target.inner(), "copy")?;
        self.accesses.clear();
        self.accesses.extend([(source.handle(), Access::COPY_READ), (target.handle(), Access::COPY_WRITE)]);
        self.order();
        // SAFETY: recording; both buffers hold the regions (the callers assert it) and are kept.
        unsafe { self.gpu.device.cmd_copy_buffer(self.commands, source.handle(), target.handle(), regions) };
        Ok(())
    }

    /// Writes runs of `elements` (ranges of indices) to the same indices of a buffer. The values travel in the command
    /// buffer: there is no staging buffer, and `elements` may change as soon as this returns. Takes a shared reference,
    /// since a scene is shared while it is drawn; barriers are those of any other write.
    ///
    /// # Panics
    /// If a run exceeds the elements or the buffer.
    pub fn update<T: bytemuck::NoUninit>(
        &mut self,
        target: &Buffer<T>,
        elements: &[T],
        runs: &[Range<usize>],
    ) -> Result<(), GpuError> {
        const { assert!(size_of::<T>().is_multiple_of(4), "updates are of whole 32-bit words") };
        if runs.is_empty() {
            return Ok(());
        }
        self.begin()?;
        self.keep(target.inner(), "update")?;
        self.accesses.clear();
        self.accesses.push((target.handle(), Access::COPY_WRITE));
        self.order();
        for run in runs {
            assert!(run.end <= target.len(), "{}: elements {run:?} of {}", target.name(), target.len());
            let bytes: &[u8] = bytemuck::cast_slice(&elements[run.clone()]);
            let first = (run.start * size_of::<T>()) as u64;
            for (k, part) in bytes.chunks(MAX_UPDATE_BYTES).enumerate() {
                let offset = first + (k * MAX_UPDATE_BYTES) as u64;
                // SAFETY: recording; the part lies in the buffer (asserted), is at most 65536 bytes, and offset and
                // length are multiples of 4, like the element's size.
                unsafe { self.gpu.device.cmd_update_buffer(self.commands, target.handle(), offset, part) };
            }
        }
        Ok(())
    }

    /// Prepares a command that the caller records by hand and that reads the whole of `source` by a copy, such as one
    /// into an image. Record it into the returned command buffer before any other command of this recorder; barriers
    /// for other resources that it uses are up to the caller.
    pub fn raw_copy<T: bytemuck::NoUninit>(&mut self, source: &Buffer<T>) -> Result<vk::CommandBuffer, GpuError> {
        self.begin()?;
        self.keep(source.inner(), "copy")?;
        self.accesses.clear();
        self.accesses.push((source.handle(), Access::COPY_READ));
        self.order();
        Ok(self.commands)
    }
}
