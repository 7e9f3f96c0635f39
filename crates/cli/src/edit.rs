//! `instgs-vk edit`: copies, moves, recolours, removes and adds instances, and lists them.

use std::path::PathBuf;

use clap::Args;

use super::edit_flags::Operations;
use instgs_console::args::{Triple, create_folder_of, open_scene, orbit_of, parse_up};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::{ExportFormat, ExportedScene, IoError, Pack, packing_lost, save_scene};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{EditOutcome, apply, template_centres};

/// Changes the instances of a scene and writes it to a new file. K selects instances by index (--list shows them; 0,3,4
/// selects three), as id:N (mask id), group:NAME or template:N; the last two select all instances of a kind.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk edit room.instgs --list\n  \
    instgs-vk edit room.instgs --duplicate 3 by=1.2,0,0 yaw=90 --recolour id:7 rgb=0.2,-0.1,0 --out room2.instgs\n  \
    instgs-vk edit room.instgs --delete group:lamp --scatter template=0 count=20 point=0,1,0 extent=8,8 distance=1 --out hall.instgs")]
pub(super) struct EditArgs {
    /// Scene to edit, .instgs
    #[arg(value_name = "S")]
    scene: PathBuf,
    #[command(flatten)]
    operations: Operations,
    /// File to write, .instgs; may be the same as the scene
    #[arg(long, value_name = "S2", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// List the instances, after the operations if there are any
    #[arg(long)]
    list: bool,
    /// Axis of yaw, and default normal of planes [default: as for render's --orbit]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    up: Option<Triple>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Edited {
    scene: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    out: Option<String>,
    operations: Vec<Done>,
    instances: usize,
    offset_records: usize,
    /// Number of Gaussians after expanding instances.
    gaussians: u64,
    /// Size of the written file.
    #[serde(skip_serializing_if = "Option::is_none")]
    bytes: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    list: Option<Vec<Listed>>,
}

#[derive(serde::Serialize)]
struct Done {
    operation: &'static str,
    #[serde(flatten)]
    outcome: EditOutcome,
}

#[derive(serde::Serialize)]
struct Listed {
    index: usize,
    id: Option<u32>,
    group: Option<String>,
    template: u32,
    /// Centre of the instance, world units.
    centre: [f64; 3],
    scale: f64,
    gaussians: u32,
    /// One of "none", "own" and "shared".
    offsets: &'static str,
}

pub(super) fn run(args: &EditArgs, printer: &Printer) -> Result<(), CliError> {
    if args.operations.is_empty() && args.out.is_some() {
        return Err(CliError::msg("edit: no operation is given; --help lists them, --list shows the instances"));
    }
    if !args.operations.is_empty() && args.out.is_none() {
        return Err(CliError::msg("edit: name the file for the changed scene with --out"));
    }
    let mut scene = open_scene(&args.scene, printer)?.scene;
    let up = orbit_of(&args.scene, &scene, args.up).up;
    let operations = edit(&mut scene, args, up, printer)?;
    let mut bytes = None;
    if let Some(out) = &args.out {
        // The file may be the scene's own.
        let lost = packing_lost(&args.scene);
        create_folder_of(out)?;
        save_scene(out, &scene)?;
        let notes = ExportedScene::default().notes(out, &scene, ExportFormat::Instgs(Pack::F32));
        notes.iter().chain(&lost).for_each(|note| printer.warning(note));
        bytes = std::fs::metadata(out).ok().map(|file| file.len());
    }
    let report = Edited {
        scene: args.scene.display().to_string(),
        out: args.out.as_ref().map(|out| out.display().to_string()),
        operations,
        instances: scene.instances.len(),
        offset_records: scene.offsets.len(),
        gaussians: scene.expanded_len(),
        bytes,
        list: args.list.then(|| list(&scene)),
    };
    if args.json {
        return printer.json(&report);
    }
    print(&report, printer);
    Ok(())
}

fn edit(
    scene: &mut InstancedScene,
    args: &EditArgs,
    up: glam::DVec3,
    printer: &Printer,
) -> Result<Vec<Done>, CliError> {
    let mut done = Vec::new();
    for edit in args.operations.edits(up).map_err(CliError::msg)? {
        let outcome = apply(scene, &edit).map_err(|e| IoError::new(&args.scene, format!("--{e}")))?;
        outcome.warnings.iter().for_each(|warning| printer.warning(format_args!("--{}: {warning}", edit.name())));
        done.push(Done { operation: edit.name(), outcome });
    }
    Ok(done)
}

fn list(scene: &InstancedScene) -> Vec<Listed> {
    let centres = template_centres(scene);
    let mut runs: Vec<u32> = scene.instances.iter().filter_map(|i| i.first_offset).collect();
    runs.sort_unstable();
    let users = |first: u32| runs.partition_point(|&r| r <= first) - runs.partition_point(|&r| r < first);
    let labels = scene.instance_labels();
    let listed = |(index, instance): (usize, &instgs_vk::scene::Instance)| {
        let template = instance.template as usize;
        Listed {
            index,
            id: labels[index].id,
            group: labels[index].group.and_then(|g| scene.groups[g].name.clone()),
            template: instance.template,
            centre: instance.world_from_template.transform_point(centres[template]).to_array(),
            scale: instance.world_from_template.scale(),
            gaussians: scene.template_ranges[template].count + scene.own_range(index).count,
            offsets: match instance.first_offset {
                None => "none",
                Some(first) if users(first) > 1 => "shared",
                Some(_) => "own",
            },
        }
    };
    scene.instances.iter().enumerate().map(listed).collect()
}

fn print(report: &Edited, printer: &Printer) {
    for Done { operation, outcome } in &report.operations {
        let part = |verb: &str, indices: &[usize]| match indices {
            [] => None,
            [one] => Some(format!("{verb} instance {one}")),
            [first, .., last] => Some(format!("{verb} {} instances, {first} to {last}", grouped(indices.len() as u64))),
        };
        let parts = [("changed", &outcome.changed), ("added", &outcome.added), ("removed", &outcome.removed)];
        let parts: Vec<String> = parts.iter().filter_map(|(verb, indices)| part(verb, indices)).collect();
        let what = if parts.is_empty() { "changed no instance".to_owned() } else { parts.join(", ") };
        printer.line(format_args!("{operation}: {what}"));
    }
    if let Some(list) = &report.list {
        printer.line(table(list));
    }
    let (instances, gaussians) = (grouped(report.instances as u64), grouped(report.gaussians));
    let file = report.out.as_ref().unwrap_or(&report.scene);
    let bytes = report.bytes.map(|bytes| format!(", {} bytes", grouped(bytes))).unwrap_or_default();
    printer.line(format_args!("{file}: {instances} instances, {gaussians} Gaussians expanded{bytes}"));
}

fn table(list: &[Listed]) -> Table {
    let mut table = Table::default();
    table.row(["instance", "id", "group", "template", "centre", "scale", "Gaussians", "offsets"].map(String::from));
    for row in list {
        let [x, y, z] = row.centre;
        table.row([
            row.index.to_string(),
            row.id.map_or_else(|| "-".into(), |id| id.to_string()),
            row.group.clone().unwrap_or_else(|| "-".into()),
            row.template.to_string(),
            format!("{x:.3},{y:.3},{z:.3}"),
            format!("{:.4}", row.scale),
            grouped(u64::from(row.gaussians)),
            row.offsets.into(),
        ]);
    }
    table
}
