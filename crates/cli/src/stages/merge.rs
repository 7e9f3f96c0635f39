//! `instgs-vk merge`: makes one template per group, and the offsets of its objects.

use std::path::{Path, PathBuf};

use clap::Args;

use super::SegmentsArgs;
use crate::progress_lines::group_lines;
use instgs_console::args::create_folder_of;
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer};
use instgs_io::{read_groups, save_scene};
use instgs_objects::pipeline::build_templates;
use instgs_objects::pipeline::build_templates::warnings;
use instgs_objects::template::GroupReport;
use instgs_train::facts::Counts;

/// Merges the objects of each group of a segmented scene into a template, instances with offsets, and a background.
///
/// The result is the scene that the joint phase of train --method instgs starts from; it is not trained yet. Objects in
/// no group stay in the background. The sections template and offsets of the configuration control the merge.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk merge --segments cars_segments --groups cars_groups.json --out cars.instgs\n  \
    instgs-vk merge --segments cars_segments --groups cars/groups.json --out cars.instgs --set template.source=single")]
pub(crate) struct MergeArgs {
    #[command(flatten)]
    segments: SegmentsArgs,
    /// File of the groups of alike objects with their poses
    #[arg(long, value_name = "groups.json")]
    groups: PathBuf,
    /// Scene to write, .instgs
    #[arg(long, value_name = "X.instgs")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(crate) json: bool,
}

/// The report printed with `--json`.
#[derive(serde::Serialize)]
struct Report<'a> {
    segments: &'a Path,
    out: &'a Path,
    instances: usize,
    gaussians: Counts,
    /// Number of Gaussians left out because they hardly contribute to any view.
    hardly_seen: u64,
    groups: &'a [GroupReport],
    warnings: Vec<String>,
}

pub(crate) fn run(args: &MergeArgs, printer: &Printer) -> Result<(), CliError> {
    let segments = args.segments.open(args.segments.config()?.finish()?)?;
    let groups = read_groups(&args.groups)?;
    create_folder_of(&args.out)?;
    printer.line(format_args!("merging {} groups", groups.len()));
    let mut config = segments.config.clone();
    config.pipeline.groups = Some(args.groups.clone());
    let found = build_templates(&segments.cloud, &segments.labels, &groups, &config)?;
    save_scene(&args.out, &found.scene)?;
    let report = Report {
        segments: &args.segments.segments,
        out: &args.out,
        instances: found.scene.instances.len(),
        gaussians: Counts::of(&found.scene),
        hardly_seen: found.hardly_seen,
        groups: &found.groups,
        warnings: warnings(&found.groups),
    };
    report.warnings.iter().for_each(|text| printer.warning(text));
    if args.json {
        return printer.json(&report);
    }
    group_lines(&found.groups, printer);
    let Counts { template, offsets, own, background, .. } = report.gaussians;
    let own = if own > 0 { format!("{} of instances' own, ", grouped(own)) } else { String::new() };
    printer.line(format_args!(
        "{}: {} instances, {} Gaussians of templates, {} offset records, {own}{} of the background, {} hardly seen left out",
        args.out.display(),
        report.instances,
        grouped(template),
        grouped(offsets),
        grouped(background),
        grouped(report.hardly_seen)
    ));
    Ok(())
}
