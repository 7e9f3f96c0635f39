//! Blocking uploads and read-backs outside the frame, through host-visible staging buffers.

use std::sync::Arc;

use super::buffer::Buffer;
use super::context::Gpu;
use super::error::GpuError;
use super::recorder::Recorder;

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
    let mut staging = Buffer::<T>::for_upload(gpu, "staging", data.len())?;
    staging.write_mapped(data)?;
    let mut recorder = Recorder::new(gpu)?;
    recorder.copy(&staging, buffer, size_of_val(data) as u64)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)
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
    let mut readback = Buffer::<T>::for_readback(gpu, "readback", len)?;
    let mut recorder = Recorder::new(gpu)?;
    recorder.copy_from(buffer, first, &mut readback)?;
    read_mapped(recorder, &readback)
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
    read_mapped(recorder, &readback)
}

/// The contents of a host-visible buffer after the recording has run.
fn read_mapped<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    mut recorder: Recorder,
    readback: &Buffer<T>,
) -> Result<Vec<T>, GpuError> {
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    let mapped = readback.mapped().ok_or_else(|| GpuError::not_mapped("readback"))?;
    Ok(mapped.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
}
