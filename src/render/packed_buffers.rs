//! A packed scene in device memory.

use std::sync::Arc;

use crate::gpu::interface::constants::{CODED_CHANNELS, RECORDS_PER_RANGE};
use crate::gpu::staging::{upload, write};
use crate::gpu::{Buffer, BufferPart, Gpu, GpuError, Home};
use crate::scene::{DevicePrecision, InstancedScene, Owner, Parameter, ParameterSet};

use super::device_scene::PlannedBytes;
use super::packed_scene::PackedScene;
use super::source_windows::SourceWindow;

/// A buffer for every array of [`PackedScene`], in its order. An array without elements has one that is unused, since Vulkan
/// has no empty buffers; scenes in f32 have only such.
#[allow(missing_docs, reason = "each field is the array of the same name")]
pub struct PackedBuffers {
    pub shapes: Buffer<u32>,
    pub quats: Buffer<u32>,
    pub sh: [Buffer<u32>; 4],
    pub offsets: [Buffer<u32>; 4],
    pub offset_sh_rest: Buffer<u32>,
    pub offset_ranges: Buffer<f32>,
}

/// The parameters in [`PackedBuffers::shapes`].
const SHAPES: [Parameter; 2] = [Parameter::LogScales, Parameter::OpacityLogits];

/// Number of buffers.
const BUFFERS: u64 = 12;

impl PackedBuffers {
    /// Uploads a packed scene to buffers at `home`, with room behind it for `spare` rows of every parameter.
    ///
    /// # Errors
    /// A buffer exceeds the device's limits; the error names it.
    pub fn upload(
        gpu: &Arc<Gpu>,
        scene: &PackedScene,
        spare: &ParameterSet<usize>,
        home: Home,
    ) -> Result<Self, GpuError> {
        let [sh0, sh1, sh2, sh3] = &scene.sh;
        let [means, sh_dc, log_scales, quats] = &scene.offsets;
        let of_sources = |name: &str, words: &[u32], parameters: &[Parameter]| -> Result<Buffer<u32>, GpuError> {
            let more = (spare[parameters[0]] * row_halves(parameters) as usize).div_ceil(2);
            let mut buffer = Buffer::in_parts(gpu, name, words.len() + more, home)?;
            write(gpu, &mut buffer, words)?;
            Ok(buffer)
        };
        let of_offsets = |name: &str, words: &[u32]| -> Result<Buffer<u32>, GpuError> {
            let mut buffer = Buffer::at(gpu, name, words.len(), home)?;
            write(gpu, &mut buffer, words)?;
            Ok(buffer)
        };
        Ok(Self {
            shapes: of_sources("packed shapes", &scene.shapes, &SHAPES)?,
            quats: of_sources("packed quats", &scene.quats, &[Parameter::Quats])?,
            sh: [
                of_sources("packed SH band 0", sh0, &[Parameter::Sh0])?,
                of_sources("packed SH band 1", sh1, &[Parameter::Sh1])?,
                of_sources("packed SH band 2", sh2, &[Parameter::Sh2])?,
                of_sources("packed SH band 3", sh3, &[Parameter::Sh3])?,
            ],
            offsets: [
                of_offsets("packed offsets of means", means)?,
                of_offsets("packed offsets of SH 0", sh_dc)?,
                of_offsets("packed offsets of scales", log_scales)?,
                of_offsets("packed offsets of quats", quats)?,
            ],
            offset_sh_rest: of_offsets("packed offsets of SH", &scene.offset_sh_rest)?,
            offset_ranges: upload(gpu, "ranges of offsets", &scene.offset_ranges)?,
        })
    }

    /// What a window shows of the arrays of source Gaussians.
    pub fn parts(&self, window: &SourceWindow) -> Vec<BufferPart> {
        let bands = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];
        let part = |buffer: &Buffer<u32>, parameters: &[Parameter]| {
            window.part(buffer, parameters[0], row_halves(parameters) * WORD / 2)
        };
        let of_bands = self.sh.iter().zip(bands).map(|(buffer, band)| part(buffer, &[band]));
        let others = [part(&self.shapes, &SHAPES), part(&self.quats, &[Parameter::Quats])];
        others.into_iter().chain(of_bands).collect()
    }

    /// The arrays of source Gaussians of a packed cloud, with the buffers that hold such arrays.
    pub(super) fn arrays<'a>(&'a mut self, cloud: &'a PackedScene) -> [PackedArray<'a>; 6] {
        let bands = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];
        let [s0, s1, s2, s3] = &mut self.sh;
        let array = |buffer, words, parameters: &[Parameter]| PackedArray {
            buffer,
            words,
            row_halves: row_halves(parameters) as usize,
            parameter: parameters[0],
        };
        [
            array(&mut self.shapes, &cloud.shapes, &SHAPES),
            array(&mut self.quats, &cloud.quats, &[Parameter::Quats]),
            array(s0, &cloud.sh[0], &bands[..1]),
            array(s1, &cloud.sh[1], &bands[1..2]),
            array(s2, &cloud.sh[2], &bands[2..3]),
            array(s3, &cloud.sh[3], &bands[3..]),
        ]
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        let of_words = [&self.shapes, &self.quats, &self.offset_sh_rest];
        let words = of_words.into_iter().chain(&self.sh).chain(&self.offsets);
        words.map(Buffer::bytes).sum::<u64>() + self.offset_ranges.bytes()
    }
}

/// An array of a packed cloud, and the buffer for such arrays.
pub(super) struct PackedArray<'a> {
    /// The buffer.
    pub(super) buffer: &'a mut Buffer<u32>,
    /// The array's words.
    pub(super) words: &'a [u32],
    /// Numbers of 16 bits in a row.
    pub(super) row_halves: usize,
    /// A parameter with as many rows.
    pub(super) parameter: Parameter,
}

/// True if a packed scene keeps the parameter in f32.
pub(super) const fn stays_f32(parameter: Parameter) -> bool {
    matches!(parameter, Parameter::Means | Parameter::ColorFromTemplate)
}

/// Bytes of the packed arrays of a scene, by content, without a device.
pub(super) fn planned_packed_bytes(scene: &InstancedScene, precision: DevicePrecision) -> PlannedBytes {
    let mut out = PlannedBytes::default();
    if precision == DevicePrecision::F32 {
        return PlannedBytes { unused: BUFFERS * WORD, ..out };
    }
    let rows = scene.parameter_rows();
    let codes = precision == DevicePrecision::Q8;
    // The arrays that hold the parameters: whole words, and one where there is nothing.
    let arrays: [&[Parameter]; BUFFERS as usize - 1] = [
        &[Parameter::LogScales, Parameter::OpacityLogits],
        &[Parameter::Quats],
        &[Parameter::Sh0],
        &[Parameter::Sh1],
        &[Parameter::Sh2],
        &[Parameter::Sh3],
        &[Parameter::OffsetMeans, Parameter::OffsetOpacityLogits],
        &[Parameter::OffsetShDc],
        &[Parameter::OffsetLogScales],
        &[Parameter::OffsetQuats],
        &[Parameter::OffsetShRest],
    ];
    for parameters in arrays {
        let (owner, [posed, of_background]) = (parameters[0].owner(), rows[parameters[0]].map(|rows| rows as u64));
        let coded = codes && owner == Owner::Offset && parameters[0] != Parameter::OffsetShRest;
        let row_bytes = if coded { WORD } else { row_halves(parameters) * WORD / 2 };
        let of_own = if posed == 0 || owner == Owner::Offset { 0 } else { scene.own.len() as u64 };
        let [posed, of_background, of_own] = [posed, of_background, of_own].map(|rows| rows * row_bytes);
        if owner == Owner::Offset {
            out.offsets += posed;
        } else {
            (out.templates, out.own) = (out.templates + posed - of_own, out.own + of_own);
            out.background += of_background;
        }
        let whole = (posed + of_background).next_multiple_of(WORD).max(WORD);
        out.unused += whole - posed - of_background;
    }
    let records = if codes { scene.offsets.len() as u64 } else { 0 };
    let ranges = records.div_ceil(RECORDS_PER_RANGE.into()) * 2 * u64::from(CODED_CHANNELS) * WORD;
    out.offsets += ranges;
    out.unused += if ranges == 0 { WORD } else { 0 };
    out
}

/// Bytes of a word, and of an f32.
const WORD: u64 = 4;

/// Numbers of 16 bits that a row has of some parameters. A quaternion of a source Gaussian is three codes.
fn row_halves(parameters: &[Parameter]) -> u64 {
    let halves = |parameter: &Parameter| if *parameter == Parameter::Quats { 3 } else { parameter.width() as u64 };
    parameters.iter().map(halves).sum()
}
