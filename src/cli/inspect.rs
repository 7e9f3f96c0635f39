//! `instgs-vk inspect`: where a scene's bytes go, in the file, on the host and on the device.

use std::path::{Path, PathBuf};

use clap::Args;
use safetensors::SafeTensors;

use super::args::open_scene;
use super::error::CliError;
use super::printer::Printer;
use super::table::{Table, grouped};
use crate::io::IoError;
use crate::render::device_scene::{PlannedBytes, planned_bytes};
use crate::scene::InstancedScene;
use crate::scene::gaussians::sh_coefficients;

/// Gaussians per chunk that the device figures are for: the usual work-group size (`instgs-vk info` shows it).
const CHUNK_SIZE: u32 = 256;
/// 3x4 transform, template index, first offset, all of 4 bytes.
const INSTANCE_BYTES: u64 = 56;

/// Explains every byte of a scene: in its file, as tensors on the host, and on the device; and how far instancing
/// shrinks each group, beside the bound that its number of instances sets.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk inspect room.instgs\n  instgs-vk inspect room.ply --json")]
pub(super) struct InspectArgs {
    /// Scene: .instgs, .ply, .spz or .splat
    #[arg(value_name = "S")]
    scene: PathBuf,
    /// Report as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Inspection {
    scene: String,
    source: String,
    sh_degree: u32,
    antialias: bool,
    dropped_non_finite: usize,
    gaussians: Counts,
    bytes: Bytes,
    /// What the file holds; sums to `bytes.file`.
    file_parts: Vec<FilePart>,
    host_parts: HostParts,
    device_parts: PlannedBytes,
    /// All groups and the background: the flattened scene's .ply by this file.
    flattened_ply_bytes: u64,
    shrink: f64,
    groups: Vec<GroupReport>,
}

#[derive(serde::Serialize)]
struct Counts {
    template: u64,
    offsets: u64,
    background: u64,
    expanded: u64,
    instances: u64,
}

#[derive(serde::Serialize)]
struct Bytes {
    file: u64,
    host: u64,
    device_scene: u64,
}

#[derive(serde::Serialize)]
struct FilePart {
    name: String,
    /// Element type and shape of a tensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    layout: Option<String>,
    bytes: u64,
}

/// f32 tensors; sum to `bytes.host`.
#[derive(serde::Serialize)]
struct HostParts {
    templates: u64,
    background: u64,
    offsets: u64,
    instances: u64,
    template_ranges: u64,
}

#[derive(serde::Serialize)]
struct GroupReport {
    template: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    gaussians: u64,
    instances: u64,
    instances_with_offsets: u64,
    expanded: u64,
    /// Template, offsets and instances as this file stores them.
    stored_bytes: u64,
    flattened_ply_bytes: u64,
    /// flattened_ply_bytes / stored_bytes.
    shrink: f64,
    /// What K instances with offsets can reach against .ply, by how the file is packed (DESIGN section 7).
    bound: Bound,
}

#[derive(serde::Serialize)]
struct Bound {
    f32: f64,
    f16: f64,
    q8: f64,
}

/// Bytes of a Gaussian in a .ply: position, normal, SH, opacity, scale, rotation as floats. 248 for SH 3.
fn ply_row_bytes(sh_degree: u32) -> u64 {
    4 * (14 + 3 * sh_coefficients(sh_degree) as u64)
}

impl Bound {
    /// For `instances` copies: .ply rows by one template row and an offset record each. f16 keeps means in f32:
    /// for SH 3, 248 K / (124 + 14 K).
    fn of(instances: u64, sh_degree: u32) -> Self {
        let k = instances as f64;
        let values = (11 + 3 * sh_coefficients(sh_degree)) as f64;
        let flattened = ply_row_bytes(sh_degree) as f64 * k;
        let half_row = 2.0 * values + 6.0;
        Self {
            f32: flattened / (4.0 * values + 28.0 * k),
            f16: flattened / (half_row + 14.0 * k),
            q8: flattened / (half_row + 7.0 * k),
        }
    }
}

pub(super) fn run(args: &InspectArgs, printer: &Printer) -> Result<(), CliError> {
    let loaded = open_scene(&args.scene, printer)?;
    let file_parts = file_parts(&args.scene, loaded.file_bytes)?;
    let scene = &loaded.scene;
    let device_parts = planned_bytes(scene, CHUNK_SIZE);
    let flattened_ply_bytes = scene.expanded_len() * ply_row_bytes(scene.sh_degree());
    let report = Inspection {
        scene: args.scene.display().to_string(),
        source: scene.source.clone(),
        sh_degree: scene.sh_degree(),
        antialias: scene.antialias,
        dropped_non_finite: loaded.dropped_non_finite,
        gaussians: Counts {
            template: scene.templates.len() as u64,
            offsets: scene.offsets.len() as u64,
            background: scene.background.len() as u64,
            expanded: scene.expanded_len(),
            instances: scene.instances.len() as u64,
        },
        bytes: Bytes { file: loaded.file_bytes, host: scene.tensor_bytes(), device_scene: device_parts.total() },
        host_parts: HostParts {
            templates: scene.templates.tensor_bytes(),
            background: scene.background.tensor_bytes(),
            offsets: scene.offsets.tensor_bytes(),
            instances: INSTANCE_BYTES * scene.instances.len() as u64,
            template_ranges: 8 * scene.template_ranges.len() as u64,
        },
        device_parts,
        flattened_ply_bytes,
        shrink: ratio(flattened_ply_bytes, loaded.file_bytes),
        groups: groups(scene, &file_parts),
        file_parts,
    };
    if args.json {
        return printer.json(&report);
    }
    print(&report, printer);
    Ok(())
}

fn ratio(a: u64, b: u64) -> f64 {
    if b == 0 { 0.0 } else { a as f64 / b as f64 }
}

/// The file's tensors, or what there is to tell of other formats.
fn file_parts(path: &Path, file_bytes: u64) -> Result<Vec<FilePart>, CliError> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let whole = |name: &str| FilePart { name: name.into(), layout: None, bytes: file_bytes };
    let read = || std::fs::read(path).map_err(|e| IoError::new(path, format!("cannot read: {e}")));
    Ok(match ending.as_str() {
        "instgs" => tensor_parts(&read()?, path)?,
        "ply" => {
            const END: &[u8] = b"end_header";
            let bytes = read()?;
            // The header ends with the line break after its last word.
            let end = bytes.windows(END.len()).position(|w| w == END).map_or(0, |at| at + END.len());
            let header = bytes[end..].iter().position(|&b| b == b'\n').map_or(end, |at| end + at + 1) as u64;
            let part = |name: &str, bytes| FilePart { name: name.into(), layout: None, bytes };
            vec![part("header", header), part("vertices", file_bytes - header)]
        }
        "splat" => vec![whole("records of 32 bytes")],
        _ => vec![whole("compressed Gaussians")],
    })
}

fn tensor_parts(bytes: &[u8], path: &Path) -> Result<Vec<FilePart>, CliError> {
    let (_, metadata) = SafeTensors::read_metadata(bytes)
        .map_err(|e| IoError::new(path, format!("is not a whole safetensors file: {e}")))?;
    let mut tensors: Vec<_> = metadata.tensors().into_iter().collect();
    tensors.sort_by(|a, b| (a.1.data_offsets, &a.0).cmp(&(b.1.data_offsets, &b.0)));
    let tensor_part = |(name, info): (String, &safetensors::tensor::TensorInfo)| FilePart {
        name,
        layout: Some(format!("{:?} {:?}", info.dtype, info.shape)),
        bytes: (info.data_offsets.1 - info.data_offsets.0) as u64,
    };
    let mut parts: Vec<FilePart> = tensors.into_iter().map(tensor_part).collect();
    let data: u64 = parts.iter().map(|p| p.bytes).sum();
    parts.insert(0, FilePart { name: "header".into(), layout: None, bytes: bytes.len() as u64 - data });
    Ok(parts)
}

fn groups(scene: &InstancedScene, file_parts: &[FilePart]) -> Vec<GroupReport> {
    let stored = |prefix: &str| file_parts.iter().filter(|p| p.name.starts_with(prefix)).map(|p| p.bytes).sum::<u64>();
    let ranges_bytes = 8 * scene.template_ranges.len() as u64;
    // Per template Gaussian and offset record as stored; ranges and instance tables are small and always of 4 bytes.
    let template_row = ratio(stored("template.").saturating_sub(ranges_bytes), scene.templates.len() as u64);
    let offset_row = ratio(stored("offset."), scene.offsets.len() as u64);
    let group = |(template, range): (usize, &crate::scene::TemplateRange)| {
        let members = scene.instances.iter().filter(|i| i.template as usize == template);
        let instances = members.clone().count() as u64;
        let mut runs: Vec<u32> = members.filter_map(|i| i.first_offset).collect();
        let instances_with_offsets = runs.len() as u64;
        runs.sort_unstable();
        runs.dedup();
        let gaussians = u64::from(range.count);
        let rows = gaussians as f64 * (template_row + offset_row * runs.len() as f64);
        let stored_bytes = rows.round() as u64 + INSTANCE_BYTES * instances + 8;
        let flattened_ply_bytes = gaussians * instances * ply_row_bytes(scene.sh_degree());
        GroupReport {
            template,
            name: scene.groups.iter().find(|g| g.template_id as usize == template).and_then(|g| g.name.clone()),
            gaussians,
            instances,
            instances_with_offsets,
            expanded: gaussians * instances,
            stored_bytes,
            flattened_ply_bytes,
            shrink: ratio(flattened_ply_bytes, stored_bytes),
            bound: Bound::of(instances, scene.sh_degree()),
        }
    };
    scene.template_ranges.iter().enumerate().map(group).collect()
}

fn print(report: &Inspection, printer: &Printer) {
    let Inspection { gaussians, bytes, host_parts, device_parts, .. } = report;
    let antialias = if report.antialias { ", antialias" } else { "" };
    let source = if report.source.is_empty() { String::new() } else { format!(", source: {}", report.source) };
    printer.line(format_args!("{}: SH degree {}{antialias}{source}", report.scene, report.sh_degree));
    let mut table = Table::default();
    let mut section = |title: &str, total: u64, rows: &[(String, u64)]| {
        table.row([title.into(), grouped(total)]);
        rows.iter().for_each(|(name, value)| table.row([format!("  {name}"), grouped(*value)]));
    };
    let named = |rows: &[(&str, u64)]| rows.iter().map(|(name, value)| ((*name).into(), *value)).collect::<Vec<_>>();
    section(
        "expanded Gaussians",
        gaussians.expanded,
        &named(&[
            ("in templates", gaussians.template),
            ("instances", gaussians.instances),
            ("offset records", gaussians.offsets),
            ("background", gaussians.background),
        ]),
    );
    let file_rows: Vec<(String, u64)> = report
        .file_parts
        .iter()
        .map(|p| (p.layout.as_ref().map_or(p.name.clone(), |layout| format!("{} {layout}", p.name)), p.bytes))
        .collect();
    section("file bytes", bytes.file, &file_rows);
    section(
        "host tensor bytes (f32)",
        bytes.host,
        &named(&[
            ("templates", host_parts.templates),
            ("background", host_parts.background),
            ("offsets", host_parts.offsets),
            ("instances", host_parts.instances),
            ("template ranges", host_parts.template_ranges),
        ]),
    );
    section(
        "device scene bytes",
        bytes.device_scene,
        &named(&[
            ("templates", device_parts.templates),
            ("background", device_parts.background),
            ("offsets", device_parts.offsets),
            ("instances", device_parts.instances),
            ("chunk bounds", device_parts.chunks),
            ("unused", device_parts.unused),
        ]),
    );
    section("flattened .ply rows", report.flattened_ply_bytes, &[]);
    printer.line(table);
    printer.line(format_args!("this file is {:.2}x smaller than the flattened .ply", report.shrink));
    if !report.groups.is_empty() {
        printer.line("");
        printer.line(groups_table(&report.groups));
    }
}

fn groups_table(groups: &[GroupReport]) -> Table {
    let mut table = Table::default();
    let header =
        ["group", "Gaussians", "instances", "with offsets", "stored bytes", "shrinks by", "bound f32", "f16", "q8"];
    table.row(header.map(String::from));
    for group in groups {
        let times = |value: f64| format!("{value:.2}x");
        table.row([
            group.name.clone().unwrap_or_else(|| format!("template {}", group.template)),
            grouped(group.gaussians),
            grouped(group.instances),
            grouped(group.instances_with_offsets),
            grouped(group.stored_bytes),
            times(group.shrink),
            times(group.bound.f32),
            times(group.bound.f16),
            times(group.bound.q8),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    /// DESIGN section 7: K = 8: 8.4 and 11.0 (q8), K = 64: 15.6.
    #[test]
    fn bounds_are_those_of_the_design() {
        assert_eq!(ply_row_bytes(3), 248);
        let near = |a: f64, b: f64| (a - b).abs() < 0.05;
        assert!(near(Bound::of(8, 3).f16, 8.4) && near(Bound::of(8, 3).q8, 11.0) && near(Bound::of(64, 3).f16, 15.6));
    }
}
