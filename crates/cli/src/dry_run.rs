//! `instgs-vk train --dry-run`: what a run would use.

use std::path::PathBuf;

use serde::Serialize;

use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_objects::pipeline::{
    Forecast, GroupForecast, MaskForecast, ObjectForecast, PipelineJob, StartForecast, forecast,
};
use instgs_train::config::{Method, Strategy};
use instgs_train::facts::MemoryUse;

#[derive(Serialize)]
struct DryRun {
    data: PathBuf,
    out: PathBuf,
    device: String,
    device_heap_bytes: u64,
    method: &'static str,
    train_views: usize,
    test_views: usize,
    /// Width and height of the smallest and the largest training picture, pixels.
    pictures_px: [[u32; 2]; 2],
    start: String,
    masks: Option<String>,
    /// Number of objects in the groups or masks, where it is known before.
    objects: Option<usize>,
    groups: Option<String>,
    /// Number of steps of the plain cloud; 0 if that is given.
    steps: u64,
    joint_steps: Option<u64>,
    strategy: &'static str,
    max_gaussians: u32,
    sh_degree: u32,
    seed: u64,
    /// Sum of `memory`: the pairs of splats and tiles and small buffers come on top.
    least_device_bytes: u64,
    memory: Vec<MemoryUse>,
    notes: Vec<String>,
}

/// Reports what the job would use; writes nothing.
///
/// # Errors
/// Those that the run would have before its first step, but for damaged photos.
pub(super) fn run(job: &PipelineJob, device_args: &DeviceArgs, json: bool, printer: &Printer) -> Result<(), CliError> {
    job.check_folders()?;
    let gpu = device::open(device_args.choice())?;
    let heap_bytes = gpu.device_heap_bytes();
    let found = forecast(job, heap_bytes)?;
    let report = report(job, gpu.caps().name.clone(), heap_bytes, found);
    if json {
        return printer.json(&report);
    }
    report.notes.iter().for_each(|note| printer.warning(note));
    print(&report, printer);
    Ok(())
}

fn report(job: &PipelineJob, device: String, device_heap_bytes: u64, found: Forecast) -> DryRun {
    let config = &job.config.train;
    let is_instanced = config.method == Method::Instanced;
    let objects = found.objects.as_ref();
    let groups = objects.and_then(|objects| objects.groups.as_ref());
    let mut notes = found.notes;
    let least_device_bytes = found.memory.iter().map(|used| used.bytes).sum();
    if least_device_bytes > device_heap_bytes {
        let (wanted, there) = (mebibytes(least_device_bytes), mebibytes(device_heap_bytes));
        notes.push(format!(
            "the device has {there} MiB, and a cloud of max_gaussians would use {wanted}: lower --max-gaussians if it may grow so far"
        ));
    }
    DryRun {
        data: job.data.clone(),
        out: job.out.clone(),
        device,
        device_heap_bytes,
        method: if is_instanced { "instgs" } else { "3dgs" },
        train_views: found.train_views,
        test_views: found.test_views,
        pictures_px: found.pictures_px,
        start: start_text(&found.start),
        masks: objects.map(|objects| mask_text(&objects.masks, found.train_views)),
        objects: objects.and_then(expected_objects),
        groups: groups.map(|GroupForecast { file, groups, .. }| format!("{groups} groups in {}", file.display())),
        steps: if is_instanced && config.init_scene.is_some() { 0 } else { config.steps },
        joint_steps: is_instanced.then_some(config.joint.steps),
        strategy: match config.strategy {
            Strategy::Densify => "densify",
            Strategy::Mcmc => "mcmc",
            Strategy::None => "none",
        },
        max_gaussians: config.max_gaussians,
        sh_degree: config.sh_degree,
        seed: config.seed,
        least_device_bytes,
        memory: found.memory,
        notes,
    }
}

/// The number of objects, where it is known before: of groups that are given, of boxes in the world, or of ids in masks.
fn expected_objects(objects: &ObjectForecast) -> Option<usize> {
    match (&objects.groups, &objects.masks) {
        (Some(groups), _) => Some(groups.instances),
        (None, MaskForecast::Boxes { in_world, in_photos: 0, .. }) => Some(*in_world),
        (None, MaskForecast::Folder { ids, most_in_view, .. }) if ids == most_in_view => Some(*ids),
        (None, _) => None,
    }
}

fn start_text(start: &StartForecast) -> String {
    match start {
        StartForecast::Points(count) => format!("{} points of the data set", grouped(*count as u64)),
        StartForecast::Random(count) => format!("{} random points", grouped(u64::from(*count))),
        StartForecast::Scene(path) => format!("the scene {}", path.display()),
    }
}

fn mask_text(masks: &MaskForecast, train_views: usize) -> String {
    match masks {
        MaskForecast::Folder { folder, views, most_in_view, ids } => format!(
            "{}: {views} of {train_views} training views have one, with up to {most_in_view} objects each and {ids} ids in all",
            folder.display()
        ),
        MaskForecast::Boxes { file, in_world, in_photos } => format!(
            "made from {} after the plain cloud: {in_world} boxes in the world, {in_photos} in training photos",
            file.display()
        ),
        MaskForecast::Prompt { prompt, models } => {
            format!("made from the words \"{prompt}\" by the models in {}", models.display())
        }
    }
}

fn print(report: &DryRun, printer: &Printer) {
    let row = |name: &str, value: String| printer.line(format_args!("{name:<16}{value}"));
    row("data", report.data.display().to_string());
    row("run folder", report.out.display().to_string());
    row("device", format!("{}, {} MiB", report.device, mebibytes(report.device_heap_bytes)));
    let size = |[width, height]: [u32; 2]| format!("{width}x{height}");
    let [smallest, largest] = report.pictures_px;
    let sizes = if smallest == largest { size(largest) } else { format!("{} to {}", size(smallest), size(largest)) };
    row("photos", format!("{} to train on, of {sizes} pixels; {} for test", report.train_views, report.test_views));
    row("start", report.start.clone());
    if let Some(masks) = &report.masks {
        row("masks", masks.clone());
        let expected =
            report.objects.map_or("known once masks of different photos are matched".into(), |n| n.to_string());
        row("objects", expected);
        row("groups", report.groups.clone().unwrap_or_else(|| "found by registration".into()));
    }
    let steps = grouped(report.steps);
    row(
        "steps",
        match report.joint_steps.map(grouped) {
            None => steps,
            Some(joint) if report.steps == 0 => format!("{joint} joint ones; the plain cloud is given"),
            Some(joint) => format!("{steps}, then {joint} joint ones"),
        },
    );
    let most = grouped(u64::from(report.max_gaussians));
    let DryRun { method, strategy, sh_degree, seed, .. } = report;
    row("Gaussians", format!("at most {most}, SH degree {sh_degree}, strategy {strategy}"));
    row("method, seed", format!("{method}, {seed}"));
    row("memory", format!("at least {} MiB of the device at {most} Gaussians:", mebibytes(report.least_device_bytes)));
    let mut table = Table::default();
    for MemoryUse { name, bytes, per, count, bytes_each } in &report.memory {
        let each = format!("{} x {bytes_each:.0} bytes a {per}", grouped(*count));
        table.row([format!("  {name}"), format!("{:.1} MiB", *bytes as f64 / f64::from(1 << 20)), each]);
    }
    printer.line(table);
    printer.line("nothing was written; without --dry-run the run starts");
}

fn mebibytes(bytes: u64) -> String {
    grouped(bytes.div_ceil(1 << 20))
}
