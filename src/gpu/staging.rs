//! Blocking uploads and read-backs outside the frame, through host-visible staging buffers.

use std::sync::Arc;

use super::buffer::Buffer;
use super::context::Gpu;
use super::error::GpuError;
use super::recorder::Recorder;

/// Most bytes that are copied at once: more staging memory would not make the copies faster.
const STAGING_BYTES: usize = 32 << 20;

/// Number of elements of a staging buffer for `len` of them.
fn staged<T>(gpu: &Gpu, len: usize) -> usize {
    let bytes = STAGING_BYTES.min(usize::try_from(gpu.caps().max_storage_bytes).unwrap_or(usize::MAX));
    len.min((bytes / size_of::<T>()).max(1))
}

/// A device buffer with the given contents.
pub fn upload<T: bytemuck::NoUninit>(gpu: &Arc<Gpu>, name: &str, data: &[T]) -> Result<Buffer<T>, GpuError> {
    let mut buffer = Buffer::new(gpu, name, data.len())?;
    write(gpu, &mut buffer, data)?;
    Ok(buffer)
}

/// Writes `data` to the start of `buffer`.
///
/// # Panics
/// If `data` is longer than the buffer.
pub fn write<T: bytemuck::NoUninit>(gpu: &Arc<Gpu>, buffer: &mut Buffer<T>, data: &[T]) -> Result<(), GpuError> {
    assert!(data.len() <= buffer.len(), "{}: {} elements into {}", buffer.name(), data.len(), buffer.len());
    if data.is_empty() {
        return Ok(());
    }
    let at_once = staged::<T>(gpu, data.len());
    let mut staging = Buffer::<T>::for_upload(gpu, "staging", at_once)?;
    let mut recorder = Recorder::new(gpu)?;
    for (k, part) in data.chunks(at_once).enumerate() {
        staging.write_mapped(part)?;
        recorder.copy_to(&staging, part.len(), buffer, k * at_once)?;
        let ticket = recorder.submit()?;
        recorder.wait(ticket)?;
    }
    Ok(())
}

/// The first `len` elements of a device buffer, or all if it has fewer. Waits for everything submitted before.
pub fn download<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    gpu: &Arc<Gpu>,
    buffer: &Buffer<T>,
    len: usize,
) -> Result<Vec<T>, GpuError> {
    download_from(gpu, buffer, 0, len)
}

/// The same as [`download`] for `len` elements from element `first` on; only these are copied.
pub fn download_from<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    gpu: &Arc<Gpu>,
    buffer: &Buffer<T>,
    first: usize,
    len: usize,
) -> Result<Vec<T>, GpuError> {
    let len = len.min(buffer.len().saturating_sub(first));
    if len == 0 {
        return Ok(Vec::new());
    }
    let at_once = staged::<T>(gpu, len);
    let mut readback = Buffer::<T>::for_readback(gpu, "readback", at_once)?;
    let mut recorder = Recorder::new(gpu)?;
    let mut out = Vec::with_capacity(len);
    while out.len() < len {
        let count = at_once.min(len - out.len());
        recorder.copy_from(buffer, first + out.len(), &mut readback, count)?;
        append_mapped(&mut recorder, &readback, count, &mut out)?;
    }
    Ok(out)
}

/// Single elements of a device buffer, by index. Waits for everything submitted before.
///
/// # Panics
/// If an index is out of range.
pub fn download_elements<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    gpu: &Arc<Gpu>,
    buffer: &Buffer<T>,
    indices: &[usize],
) -> Result<Vec<T>, GpuError> {
    if indices.is_empty() {
        return Ok(Vec::new());
    }
    let mut readback = Buffer::<T>::for_readback(gpu, "readback", indices.len())?;
    let mut recorder = Recorder::new(gpu)?;
    recorder.copy_elements(buffer, indices, &mut readback)?;
    let mut out = Vec::with_capacity(indices.len());
    append_mapped(&mut recorder, &readback, indices.len(), &mut out)?;
    Ok(out)
}

/// Appends the first `count` elements of a host-visible buffer after the recording has run.
fn append_mapped<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    recorder: &mut Recorder,
    readback: &Buffer<T>,
    count: usize,
    out: &mut Vec<T>,
) -> Result<(), GpuError> {
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    let mapped = readback.mapped().ok_or_else(|| GpuError::not_mapped("readback"))?;
    out.extend(mapped.chunks_exact(size_of::<T>()).take(count).map(bytemuck::pod_read_unaligned::<T>));
    Ok(())
}
