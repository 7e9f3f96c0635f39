//! The device's state as a checkpoint and back: parameters, moments, densification statistics. Bits are kept.

use std::path::Path;
use std::sync::Arc;

use crate::gpu::staging::{download, write};
use crate::gpu::{Buffer, Gpu};
use crate::io::IoError;
use crate::io::checkpoint::Checkpoint;
use crate::scene::InstancedScene;

use super::device_state::{DeviceState, zeros};
use super::error::TrainError;

/// Metadata key of the SH degree.
const SH_DEGREE: &str = "sh_degree";

/// Metadata key that says that densification after the last step is still due.
const DUE: &str = "densification_due";

/// A flat buffer of the state: its tensor's name, numbers per source Gaussian, and contents.
type Flat<'a, B> = (String, usize, B);

fn parameters(state: &DeviceState) -> Vec<Flat<'_, &Buffer<f32>>> {
    let s = &state.scene;
    let mut out: Vec<Flat<'_, &Buffer<f32>>> = vec![
        ("parameter.means".into(), 3, s.means.scalars()),
        ("parameter.quats".into(), 4, s.quats.scalars()),
        ("parameter.log_scales".into(), 3, s.log_scales.scalars()),
        ("parameter.opacity_logits".into(), 1, &s.opacity_logits),
        ("statistics.screen".into(), 3, state.gradients.screen_statistics.scalars()),
    ];
    let m = &state.moments;
    for (name, width, buffer) in [
        ("means", 3, &m.means),
        ("quats", 4, &m.quats),
        ("log_scales", 3, &m.log_scales),
        ("opacity_logits", 1, &m.opacity_logits),
    ] {
        out.push((format!("moment.{name}"), 2 * width, buffer.scalars()));
    }
    for l in 0..=s.sh_degree as usize {
        let width = 3 * (2 * l + 1);
        out.push((format!("parameter.sh_band_{l}"), width, s.sh_bands[l].scalars()));
        out.push((format!("moment.sh_band_{l}"), 2 * width, m.sh_bands[l].scalars()));
    }
    out
}

fn parameters_mut(state: &mut DeviceState) -> Vec<Flat<'_, &mut Buffer<f32>>> {
    let s = &mut state.scene;
    let degree = s.sh_degree as usize;
    let m = &mut state.moments;
    let mut out: Vec<Flat<'_, &mut Buffer<f32>>> = vec![
        ("parameter.means".into(), 3, s.means.scalars_mut()),
        ("parameter.quats".into(), 4, s.quats.scalars_mut()),
        ("parameter.log_scales".into(), 3, s.log_scales.scalars_mut()),
        ("parameter.opacity_logits".into(), 1, &mut s.opacity_logits),
        ("statistics.screen".into(), 3, state.gradients.screen_statistics.scalars_mut()),
        ("moment.means".into(), 6, m.means.scalars_mut()),
        ("moment.quats".into(), 8, m.quats.scalars_mut()),
        ("moment.log_scales".into(), 6, m.log_scales.scalars_mut()),
        ("moment.opacity_logits".into(), 2, m.opacity_logits.scalars_mut()),
    ];
    for (l, (band, moment)) in s.sh_bands.iter_mut().zip(&mut m.sh_bands).enumerate().take(degree + 1) {
        let width = 3 * (2 * l + 1);
        out.push((format!("parameter.sh_band_{l}"), width, band.scalars_mut()));
        out.push((format!("moment.sh_band_{l}"), 2 * width, moment.scalars_mut()));
    }
    out
}

/// A plain cloud in training as a checkpoint after `step` finished steps. The device must be idle. `due` says that the
/// densification after that step has not been done.
pub fn to_checkpoint(gpu: &Arc<Gpu>, state: &DeviceState, step: u64, due: bool) -> Result<Checkpoint, TrainError> {
    let count = state.source_count;
    let mut out = Checkpoint { step, ..Checkpoint::default() };
    out.metadata.insert(SH_DEGREE.into(), state.scene.sh_degree.to_string());
    if due {
        out.metadata.insert(DUE.into(), "true".into());
    }
    for (name, width, buffer) in parameters(state) {
        out.put(&name, &[count, width], download(gpu, buffer, count * width)?);
    }
    Ok(out)
}

/// True if the checkpoint was written before the densification after its last step.
pub fn densification_is_due(checkpoint: &Checkpoint) -> bool {
    checkpoint.metadata.contains_key(DUE)
}

/// SH degree and number of Gaussians of a checkpoint of a plain cloud; `path` is for messages.
///
/// # Errors
/// It does not say its degree.
pub fn size_of_cloud(checkpoint: &Checkpoint, path: &Path) -> Result<(u32, usize), IoError> {
    let degree = checkpoint.metadata.get(SH_DEGREE).and_then(|text| text.parse().ok()).filter(|d| *d <= 3);
    let degree: u32 = degree.ok_or_else(|| IoError::new(path, "has no sh_degree from 0 to 3"))?;
    Ok((degree, checkpoint.tensors.get("parameter.opacity_logits").map_or(0, |t| t.values.len())))
}

/// The state of a checkpoint of a plain cloud; `path` is for messages.
///
/// # Errors
/// A tensor that is missing or has another shape; more Gaussians than the device can hold.
pub fn from_checkpoint(
    gpu: &Arc<Gpu>,
    mut checkpoint: Checkpoint,
    path: &Path,
    chunk_size: u32,
) -> Result<DeviceState, TrainError> {
    let (degree, count) = size_of_cloud(&checkpoint, path)?;
    let mut state = DeviceState::new(gpu, &InstancedScene::from_cloud(zeros(count, degree)), chunk_size)?;
    for (name, width, buffer) in parameters_mut(&mut state) {
        let values: Vec<f32> = checkpoint.take(&name, &[width], path)?;
        if values.len() != count * width {
            let what = format!("tensor {name} has {} numbers, not {count} times {width}", values.len());
            return Err(IoError::new(path, what).into());
        }
        write(gpu, buffer, &values)?;
    }
    Ok(state)
}
