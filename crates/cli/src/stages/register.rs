//! `instgs-vk register`: finds which objects of a labelled scene are alike, and the pose of each.

use std::path::{Path, PathBuf};

use clap::Args;

use super::SegmentsArgs;
use instgs_console::args::create_folder_of;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::Table;
use instgs_console::{CliError, Printer};
use instgs_io::write_groups;
use instgs_objects::pipeline::register_objects::warnings;
use instgs_objects::pipeline::{Message, register_objects};
use instgs_objects::register::InstanceRegistration;

/// Finds groups of objects that are alike, and the pose of each object, and writes them as groups.json.
///
/// Objects of one category are tried as one group; objects without a category form another. The object that was seen
/// best is the reference. An object that matches no other is rejected: it stays in the background. An object whose pose
/// is ambiguous is in its group, but should be checked.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk register --segments cars_segments --out cars_groups.json\n  \
    instgs-vk register --segments orchard_segments --out groups.json --similarity --json")]
pub(crate) struct RegisterArgs {
    #[command(flatten)]
    segments: SegmentsArgs,
    /// File to write, groups.json
    #[arg(long, value_name = "groups.json")]
    out: PathBuf,
    /// Objects of a group may differ in size (sets joint.refine_scales)
    #[arg(long)]
    similarity: bool,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(crate) json: bool,
}

/// The report printed with `--json`.
#[derive(serde::Serialize)]
struct Report<'a> {
    segments: &'a Path,
    out: &'a Path,
    groups: usize,
    instances: &'a [InstanceRegistration],
    warnings: Vec<String>,
    seconds: f64,
}

pub(crate) fn run(args: &RegisterArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let mut config = args.segments.config()?;
    if args.similarity {
        config = config.flag("--similarity", "joint.refine_scales", true)?;
    }
    let segments = args.segments.open(config.finish()?)?;
    create_folder_of(&args.out)?;
    let gpu = device::open(device_args.choice())?;
    let objects = segments.labels.consensus.objects.iter().filter(|object| object.gaussians > 0).count();
    printer.line(format_args!("registering {objects} objects"));
    let found =
        register_objects(&gpu, &segments.config, &segments.cloud, &segments.labels, &mut |_: Message<'_>| Ok(()))?;
    device::check_validation(&gpu)?;
    write_groups(&args.out, &found.groups)?;
    let mut told: Vec<String> = warnings(&found.registration).collect();
    if found.groups.is_empty() {
        told.push(format!("no two objects are alike: {} has no groups", args.out.display()));
    }
    told.iter().for_each(|text| printer.warning(text));
    let report = Report {
        segments: &args.segments.segments,
        out: &args.out,
        groups: found.groups.len(),
        instances: &found.registration,
        warnings: told,
        seconds: found.stages.iter().map(|stage| stage.seconds).sum(),
    };
    if args.json {
        return printer.json(&report);
    }
    printer.line(table(&found.registration));
    let in_groups = found.registration.iter().filter(|object| object.accepted).count();
    let out = args.out.display();
    printer.line(format_args!("{out}: {} groups with {in_groups} of {objects} objects", report.groups));
    Ok(())
}

/// One row for each object.
fn table(objects: &[InstanceRegistration]) -> Table {
    let mut table = Table::default();
    let head = ["group", "instance", "name", "verdict", "inliers", "RMSE", "photometric"].map(String::from);
    let row = |object: &InstanceRegistration| {
        let registered = |figure: String| if object.inliers > 0.0 { figure } else { "-".into() };
        [
            object.group.map_or("-".into(), |group| group.to_string()),
            object.instance.to_string(),
            object.name.clone().unwrap_or_else(|| "-".into()),
            object.verdict.name().into(),
            registered(format!("{:.3}", object.inliers)),
            registered(format!("{:.4}", object.rmse)),
            object.photometric.map_or("-".into(), |error| format!("{error:.4}")),
        ]
    };
    // Left-aligned text, in a column that the table would align to the right.
    let width = objects.iter().map(|object| object.note.chars().count()).max().unwrap_or(0);
    let mut with_note = |[a, b, c, d, e, f, g]: [String; 7], note: &str| {
        table.row([a, b, c, d, e, f, g, format!("{note:<width$}")]);
    };
    with_note(head, "note");
    objects.iter().for_each(|object| with_note(row(object), &object.note));
    table
}
