//! Converts the device's state to a checkpoint and back, bit by bit: parameters, moments, densification statistics.

use std::path::Path;
use std::sync::Arc;

use instgs_io::IoError;
use instgs_io::checkpoint::{Checkpoint, OF_NO_USE};
use instgs_vk::gpu::interface::constants::NO_OFFSET;
use instgs_vk::gpu::staging::{download, write};
use instgs_vk::gpu::{Buffer, Gpu};
use instgs_vk::optim::POSE_VALUES;
use instgs_vk::scene::source_layout::{CloudSize, InstanceSource};
use instgs_vk::scene::{InstancedScene, Owner, Parameter, SourceLayout, SourceRange};

use super::device_state::{DeviceState, zeros};
use super::error::TrainError;
use super::exposures;

/// Metadata key of the SH degree.
const SH_DEGREE: &str = "sh_degree";

/// Metadata key of the number of template Gaussians, which growth changes.
const TEMPLATE_GAUSSIANS: &str = "template_gaussians";

/// Metadata key: densification after the last step is still to be done.
const DUE: &str = "densification_due";

/// Metadata key of the number of steps that were done when the densification statistics were last zero.
const STATISTICS_SINCE: &str = "statistics_since";

/// Tensor of the transforms of instances.
const POSES: &str = "parameter.world_from_template";

/// Tensors of the layout, which growth changes: first Gaussian and number of each template, and the first offset record of
/// each instance, `NO_OFFSET` if it has none.
const TEMPLATE_RANGES: &str = "layout.template_ranges";
const FIRST_OFFSETS: &str = "layout.first_offset";

/// Tensor of the own Gaussians of each instance, first and number, in scenes that have any.
const OWN_RANGES: &str = "layout.own";

/// Numbers of a transform: 3 rows of 4 columns.
const POSE_NUMBERS: usize = 12;

/// A flat buffer of the state: the name of its tensor, its shape (items, numbers per item), and its contents.
type Flat<'a, B> = (String, [usize; 2], B);

/// Every buffer that training changes, writable: the same list serves writing and reading.
fn buffers(state: &mut DeviceState) -> Vec<Flat<'_, &mut Buffer<f32>>> {
    let (sources, posed) = (state.source_count(), state.scene.posed_instances() as usize);
    let records = state.scene.counts.rows[Parameter::OffsetMeans][0];
    let own_may_grow = state.scene.traits(0).own_may_grow;
    let (scene, moments) = (&mut state.scene, &mut state.moments);
    let mut out: Vec<Flat<'_, &mut Buffer<f32>>> = Vec::new();
    for (parameter, values, moment) in scene.parameters.scalars_mut().zip(moments.parameters.each_mut()) {
        let rows = scene.counts.rows[parameter].iter().sum();
        let present = match parameter.owner() {
            Owner::Source => true,
            Owner::ShBand(l) => l <= scene.sh_degree,
            Owner::Offset | Owner::Instance => rows > 0,
        };
        if present {
            let (name, width) = (parameter.name(), parameter.width());
            out.push((format!("parameter.{name}"), [rows, width], values));
            out.push((format!("moment.{name}"), [rows, 2 * width], moment.scalars_mut()));
        }
    }
    if posed > 0 {
        out.push(("moment.poses".into(), [posed, 2 * POSE_VALUES], moments.poses.scalars_mut()));
    }
    let gradients = &mut state.gradients;
    out.push(("statistics.screen".into(), [sources, 3], gradients.screen_statistics.scalars_mut()));
    if own_may_grow {
        out.push(("statistics.records".into(), [records, 2], gradients.record_statistics.scalars_mut()));
    }
    out
}

/// Makes a checkpoint of a scene in training after `step` finished steps. The device must be idle. `due` records that
/// the densification after that step has not been done.
pub fn to_checkpoint(gpu: &Arc<Gpu>, state: &mut DeviceState, step: u64, due: bool) -> Result<Checkpoint, TrainError> {
    let mut out = Checkpoint { step, ..Checkpoint::default() };
    out.metadata.insert(SH_DEGREE.into(), state.scene.sh_degree.to_string());
    if let Some(since) = state.statistics_since {
        out.metadata.insert(STATISTICS_SINCE.into(), since.to_string());
    }
    if due {
        out.metadata.insert(DUE.into(), "true".into());
    }
    for (name, shape, buffer) in buffers(state) {
        out.put(&name, &shape, download(gpu, buffer, shape[0] * shape[1])?);
    }
    if let Some(exposures) = &mut state.exposures {
        exposures::put(gpu, exposures, &mut out)?;
    }
    let posed = state.scene.posed_instances() as usize;
    if posed > 0 {
        let instances = download(gpu, &state.scene.instances, state.scene.posed_rows() as usize)?;
        let of_instance = |k| instances[state.scene.rows_of(k).start].world_from_template.as_flattened().to_vec();
        let transforms = (0..posed).flat_map(of_instance).collect();
        out.put::<f32>(POSES, &[posed, POSE_NUMBERS], transforms);
        let flat = |ranges: &[SourceRange]| -> Vec<u32> { ranges.iter().flat_map(|r| [r.first, r.count]).collect() };
        let (template_ranges, own_ranges) = (&state.layout.template_ranges, &state.layout.own_ranges);
        out.put(TEMPLATE_RANGES, &[template_ranges.len(), 2], flat(template_ranges));
        if !own_ranges.is_empty() {
            out.put(OWN_RANGES, &[own_ranges.len(), 2], flat(own_ranges));
        }
        let firsts: Vec<u32> = state.layout.instances.iter().map(|i| i.first_offset.unwrap_or(NO_OFFSET)).collect();
        out.put(FIRST_OFFSETS, &[posed], firsts);
        out.metadata.insert(TEMPLATE_GAUSSIANS.into(), state.layout.templates.len.to_string());
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
/// The checkpoint does not contain its SH degree.
pub fn size_of_cloud(checkpoint: &Checkpoint, path: &Path) -> Result<(u32, usize), IoError> {
    let degree = checkpoint.metadata.get(SH_DEGREE).and_then(|text| text.parse().ok()).filter(|d| *d <= 3);
    let missing = || IoError::new(path, "has no sh_degree from 0 to 3").advise(OF_NO_USE);
    let degree: u32 = degree.ok_or_else(missing)?;
    Ok((degree, checkpoint.tensors.get("parameter.opacity_logits").map_or(0, |t| t.values.len())))
}

/// True if the checkpoint is of a scene with instances.
pub fn has_instances(checkpoint: &Checkpoint) -> bool {
    checkpoint.tensors.get(POSES).is_some_and(|poses| !poses.values.is_empty())
}

/// Makes the device state from a checkpoint of a plain cloud; `path` is for messages.
///
/// # Errors
/// A tensor that is missing or has another shape; more Gaussians than the device can hold.
pub fn from_checkpoint(
    gpu: &Arc<Gpu>,
    checkpoint: Checkpoint,
    path: &Path,
    chunk_size: u32,
) -> Result<DeviceState, TrainError> {
    let (degree, count) = size_of_cloud(&checkpoint, path)?;
    let mut state = DeviceState::new(gpu, &InstancedScene::from_cloud(zeros(count, degree)), chunk_size)?;
    restore(gpu, &mut state, checkpoint, path)?;
    Ok(state)
}

/// The layout of the scene in a checkpoint. `start` is that of the scene that training started from: versions that did
/// not change it wrote none.
///
/// # Errors
/// The tensors of the layout do not fit each other or the instances of `start`.
fn layout_of(checkpoint: &mut Checkpoint, start: &SourceLayout, path: &Path) -> Result<SourceLayout, IoError> {
    let values = |name: &str| checkpoint.tensors.get(name).map_or(0, |t| t.values.len());
    let (sources, offsets) = (values("parameter.opacity_logits"), values("parameter.offset_means") / 3);
    let fail = |name: &str| Err(IoError::new(path, format!("{name} does not fit the scene")).advise(OF_NO_USE));
    if start.instances.is_empty() {
        let Some(background) = sources.checked_sub(start.posed().len) else { return fail("opacity_logits") };
        return Ok(SourceLayout { background: CloudSize { len: background, ..start.background }, ..start.clone() });
    }
    if !checkpoint.tensors.contains_key(TEMPLATE_RANGES) {
        return Ok(start.clone());
    }
    let templates = checkpoint.metadata.get(TEMPLATE_GAUSSIANS).and_then(|text| text.parse().ok());
    let templates: Option<usize> = templates.filter(|&templates| templates <= sources);
    let template_ranges = take_ranges(checkpoint, TEMPLATE_RANGES, path)?;
    let own_ranges = if checkpoint.tensors.contains_key(OWN_RANGES) {
        take_ranges(checkpoint, OWN_RANGES, path)?
    } else {
        Vec::new()
    };
    let firsts: Vec<u32> = checkpoint.take(FIRST_OFFSETS, &[], path)?;
    let Some(templates) = templates else { return fail(TEMPLATE_GAUSSIANS) };
    let ends_within = |first: u32, count: u32, end: usize| u64::from(first) + u64::from(count) <= end as u64;
    let fit = template_ranges.iter().all(|range| ends_within(range.first, range.count, templates));
    if !fit || template_ranges.len() != start.template_ranges.len() {
        return fail(TEMPLATE_RANGES);
    }
    let source = |(instance, &first): (&InstanceSource, &u32)| InstanceSource {
        first_offset: (first != NO_OFFSET).then_some(first),
        ..*instance
    };
    let instances: Vec<InstanceSource> = start.instances.iter().zip(&firsts).map(source).collect();
    let count_of = |instance: &InstanceSource| template_ranges[instance.template as usize].count;
    let fits = |instance: &InstanceSource| {
        instance.first_offset.is_none_or(|first| ends_within(first, count_of(instance), offsets))
    };
    let own = packed_len(&own_ranges);
    // A scene whose templates have died away has no offsets left.
    let same_kind = (offsets == 0) == (start.offsets == 0) || offsets == 0 && templates == 0;
    if firsts.len() != start.instances.len() || !same_kind || !instances.iter().all(fits) {
        return fail(FIRST_OFFSETS);
    }
    let background = own.and_then(|own| sources.checked_sub(templates + own));
    let (Some(own), Some(background), true) = (own, background, own_ranges.len() == start.own_ranges.len()) else {
        return fail(OWN_RANGES);
    };
    Ok(SourceLayout {
        templates: CloudSize { len: templates, ..start.templates },
        own,
        background: CloudSize { len: background, ..start.background },
        template_ranges,
        instances,
        own_ranges,
        offsets,
    })
}

fn take_ranges(checkpoint: &mut Checkpoint, name: &str, path: &Path) -> Result<Vec<SourceRange>, IoError> {
    let values: Vec<u32> = checkpoint.take(name, &[2], path)?;
    Ok(values.as_chunks().0.iter().map(|&[first, count]| SourceRange { first, count }).collect())
}

/// Number of Gaussians of ranges that follow each other without a gap, as training lays them out.
fn packed_len(ranges: &[SourceRange]) -> Option<usize> {
    ranges
        .iter()
        .try_fold(0, |end: u32, range| (range.first == end).then(|| end.checked_add(range.count)).flatten())
        .map(|end| end as usize)
}

/// Puts a checkpoint's values into a state of the same instances, and changes its layout to the checkpoint's; `path` is
/// for messages.
///
/// # Errors
/// A tensor that is missing or has another shape.
pub fn restore(
    gpu: &Arc<Gpu>,
    state: &mut DeviceState,
    mut checkpoint: Checkpoint,
    path: &Path,
) -> Result<(), TrainError> {
    state.statistics_since = checkpoint.metadata.get(STATISTICS_SINCE).and_then(|text| text.parse().ok());
    let layout = layout_of(&mut checkpoint, &state.layout, path)?;
    if layout != state.layout {
        state.relayout_undefined(gpu, layout)?;
    }
    for (name, [count, width], buffer) in buffers(state) {
        let values: Vec<f32> = checkpoint.take(&name, &[width], path)?;
        if values.len() != count * width {
            let what = format!("tensor {name} has {} numbers, not {count} times {width}", values.len());
            return Err(IoError::new(path, what).advise(OF_NO_USE).into());
        }
        write(gpu, buffer, &values)?;
    }
    let posed = state.scene.posed_instances() as usize;
    if posed > 0 {
        let values: Vec<f32> = checkpoint.take(POSES, &[POSE_NUMBERS], path)?;
        if values.len() != posed * POSE_NUMBERS {
            let what = format!("tensor {POSES} has {} numbers, not {posed} times {POSE_NUMBERS}", values.len());
            return Err(IoError::new(path, what).advise(OF_NO_USE).into());
        }
        // The entry of the background is included and does not change.
        let mut instances = download(gpu, &state.scene.instances, state.scene.instance_count as usize)?;
        for (k, values) in values.chunks_exact(POSE_NUMBERS).enumerate() {
            for instance in &mut instances[state.scene.rows_of(k)] {
                instance.world_from_template.as_flattened_mut().copy_from_slice(values);
            }
        }
        write(gpu, &mut state.scene.instances, &instances)?;
    }
    Ok(())
}
