//! `instgs-vk inspect`: the use of a scene's bytes in the file, on the host and on the device.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;

use super::inspect_file::{FilePart, FileSums, file_parts};
use super::inspect_groups::{GroupReport, RANGE_BYTES, groups, groups_table, ratio};
use instgs_console::args::{PrecisionArgs, open_scene};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_eval::Counts;
use instgs_io::ply;
use instgs_vk::render::device_scene::{PlannedBytes, planned_bytes};
use instgs_vk::scene::{DevicePrecision, NearPlane, PixelFilter};

/// Gaussians per chunk in the figures for the device: the usual work-group size (`instgs-vk info` shows it).
const CHUNK_SIZE: u32 = 256;
/// Explains every byte of a scene: in its file, as tensors on the host, and on the device; and how much smaller
/// instancing makes each group, next to the bound that its number of instances sets.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk inspect room.instgs\n  instgs-vk inspect room.ply --json")]
pub(super) struct InspectArgs {
    /// Scene to inspect: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(value_name = "S")]
    scene: PathBuf,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Inspection {
    scene: String,
    source: String,
    sh_degree: u32,
    antialias: bool,
    dilation_px2: f32,
    /// Depth of the near plane, scene units.
    near: f32,
    dropped_non_finite: usize,
    gaussians: SceneCounts,
    bytes: Bytes,
    /// The file's bytes by purpose; their sum is `bytes.file`.
    file_sums: FileSums,
    /// The parts of the file from front to back; their sum is `bytes.file`.
    file_parts: Vec<FilePart>,
    host_parts: HostParts,
    /// Bytes on the device in `device_precision`; their sum is `bytes.device_scene`.
    device_parts: PlannedBytes,
    device_precision: DevicePrecision,
    /// That sum in every precision.
    device_scene_by_precision: BTreeMap<&'static str, u64>,
    /// Size of the flattened scene as .ply over that of this file, for all groups and the background.
    flattened_ply_bytes: u64,
    shrink: f64,
    groups: Vec<GroupReport>,
}

#[derive(serde::Serialize)]
struct SceneCounts {
    #[serde(flatten)]
    gaussians: Counts,
    instances: u64,
}

#[derive(serde::Serialize)]
struct Bytes {
    file: u64,
    host: u64,
    device_scene: u64,
}

/// Bytes of the f32 tensors; their sum is `bytes.host`.
#[derive(serde::Serialize)]
struct HostParts {
    templates: u64,
    own: u64,
    background: u64,
    offsets: u64,
    instances: u64,
    template_ranges: u64,
    levels: u64,
}

pub(super) fn run(args: &InspectArgs, printer: &Printer) -> Result<(), CliError> {
    let loaded = open_scene(&args.scene, printer)?;
    let file_parts = file_parts(&args.scene, &loaded)?;
    let scene = &loaded.scene;
    let device_precision = args.precision.precision();
    let device_parts = planned_bytes(scene, CHUNK_SIZE, device_precision);
    let device_scene_by_precision =
        DevicePrecision::ALL.map(|precision| (precision.name(), planned_bytes(scene, CHUNK_SIZE, precision).total()));
    let flattened_ply_bytes = (scene.expanded_len() - scene.hidden_len()) * ply::row_bytes(scene.sh_degree());
    let report = Inspection {
        scene: args.scene.display().to_string(),
        source: scene.source.clone(),
        sh_degree: scene.sh_degree(),
        antialias: scene.pixel_filter.antialias,
        dilation_px2: scene.pixel_filter.dilation_px2,
        near: scene.near_plane.0,
        dropped_non_finite: loaded.dropped_non_finite,
        gaussians: SceneCounts { gaussians: Counts::of(scene), instances: scene.instances.len() as u64 },
        bytes: Bytes { file: loaded.file_bytes, host: scene.tensor_bytes(), device_scene: device_parts.total() },
        host_parts: HostParts {
            templates: scene.templates.tensor_bytes(),
            own: scene.own.tensor_bytes(),
            background: scene.background.tensor_bytes(),
            offsets: scene.offsets.tensor_bytes(),
            instances: scene.instance_bytes() * scene.instances.len() as u64,
            template_ranges: RANGE_BYTES * scene.template_ranges.len() as u64,
            levels: scene.fitted_levels.iter().map(|level| level.gaussians.tensor_bytes()).sum(),
        },
        device_parts,
        device_precision,
        device_scene_by_precision: device_scene_by_precision.into(),
        flattened_ply_bytes,
        shrink: ratio(flattened_ply_bytes, loaded.file_bytes),
        groups: groups(scene, &file_parts),
        file_sums: FileSums::of(&file_parts),
        file_parts,
    };
    if args.json {
        return printer.json(&report);
    }
    print(&report, printer);
    Ok(())
}

fn print(report: &Inspection, printer: &Printer) {
    let SceneCounts { gaussians, instances } = &report.gaussians;
    let Inspection { bytes, file_sums, host_parts, device_parts, .. } = report;
    let antialias = if report.antialias { ", antialias" } else { "" };
    let filter = PixelFilter { dilation_px2: report.dilation_px2, antialias: report.antialias };
    let dilation =
        if filter.has_usual_dilation() { String::new() } else { format!(", dilation {} px^2", report.dilation_px2) };
    let source = if report.source.is_empty() { String::new() } else { format!(", source: {}", report.source) };
    let near =
        if report.near == NearPlane::default().0 { String::new() } else { format!(", near plane {}", report.near) };
    printer.line(format_args!("{}: SH degree {}{antialias}{dilation}{near}{source}", report.scene, report.sh_degree));
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
            ("instances", *instances),
            ("offset records", gaussians.offsets),
            ("instances' own", gaussians.own),
            ("background", gaussians.background),
            ("hidden by instances", gaussians.hidden),
        ]),
    );
    let file_rows: Vec<(String, u64)> = report
        .file_parts
        .iter()
        .map(|p| (p.layout.as_ref().map_or(p.name.clone(), |layout| format!("{} {layout}", p.name)), p.bytes))
        .collect();
    section(
        "file bytes",
        bytes.file,
        &named(&[
            ("templates", file_sums.templates),
            ("instances' own", file_sums.own),
            ("background", file_sums.background),
            ("offsets", file_sums.offsets),
            ("instances", file_sums.instances),
            ("template ranges", file_sums.template_ranges),
            ("levels of detail", file_sums.levels),
            ("pages", file_sums.pages),
            ("foreign tensors", file_sums.foreign),
            ("header", file_sums.header),
        ]),
    );
    section("file from front to back", bytes.file, &file_rows);
    section(
        "host tensor bytes (f32)",
        bytes.host,
        &named(&[
            ("templates", host_parts.templates),
            ("instances' own", host_parts.own),
            ("background", host_parts.background),
            ("offsets", host_parts.offsets),
            ("instances", host_parts.instances),
            ("template ranges", host_parts.template_ranges),
            ("levels of detail", host_parts.levels),
        ]),
    );
    section(
        &format!("device scene bytes ({})", report.device_precision.name()),
        bytes.device_scene,
        &named(&[
            ("templates", device_parts.templates),
            ("instances' own", device_parts.own),
            ("background", device_parts.background),
            ("offsets", device_parts.offsets),
            ("instances", device_parts.instances),
            ("chunk bounds", device_parts.chunks),
            ("unused", device_parts.unused),
        ]),
    );
    for (precision, total) in &report.device_scene_by_precision {
        section(&format!("device scene in {precision}"), *total, &[]);
    }
    section("flattened .ply rows", report.flattened_ply_bytes, &[]);
    printer.line(table);
    printer.line(format_args!("this file is {:.2}x smaller than the flattened .ply", report.shrink));
    if !report.groups.is_empty() {
        printer.line("");
        printer.line(groups_table(&report.groups));
    }
}
