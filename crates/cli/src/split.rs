//! `instgs-vk split`: divides a data set into blocks.

use std::path::PathBuf;

use clap::Args;

use instgs_blocks::{Block, DivideOptions, JOBS, job_lines, split, write_jobs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};

/// Divides a data set into blocks, each a data set of its own, for captures that are too large to be trained in one piece.
///
/// The ground is cut where it leaves each block the same number of points. A block gets the views that show it, with
/// references to the photos instead of copies, its points with a margin, and fewer and fewer points farther away. Train every
/// block with the same configuration, wherever you like; join then makes one scene of them.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk split city --blocks 4 --out city_blocks --emit-jobs -- --config instgs_quick --steps 5000\n  \
    parallel --jobs 2 < city_blocks/jobs.txt\n  \
    instgs-vk join city_blocks/*/run --out city.instgs --refine runs/city")]
pub(super) struct SplitArgs {
    /// Dataset folder with cameras and a point cloud
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Number of blocks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    blocks: u32,
    /// Folder for the blocks; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Margin on each side of a block, as a part of its extent
    #[arg(long, value_name = "PART", default_value_t = DivideOptions::default().overlap, value_parser = parse_part)]
    overlap: f64,
    /// A view is trained on in a block if at least this part of the points that it shows lies there or in its margin
    #[arg(long, value_name = "PART", default_value_t = DivideOptions::default().least_share, value_parser = parse_part)]
    least_share: f64,
    /// Write DIR/jobs.txt: the command that trains a block, one a line, which may be given again after it was stopped
    #[arg(long)]
    emit_jobs: bool,
    /// Arguments of train for these commands, behind --
    #[arg(last = true, value_name = "TRAIN", requires = "emit_jobs")]
    train: Vec<String>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

fn parse_part(text: &str) -> Result<f64, String> {
    let part: f64 = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if (0.0..=1.0).contains(&part) { Ok(part) } else { Err("must be from 0 to 1".into()) }
}

#[derive(serde::Serialize)]
struct Report<'a> {
    data: String,
    out: String,
    blocks: &'a [Block],
    #[serde(skip_serializing_if = "Option::is_none")]
    jobs: Option<String>,
}

pub(super) fn run(args: &SplitArgs, printer: &Printer) -> Result<(), CliError> {
    let options = DivideOptions { blocks: args.blocks as usize, overlap: args.overlap, least_share: args.least_share };
    let written = split(&args.data, &args.out, &options)?;
    written.notes.iter().for_each(|note| printer.warning(note));
    if args.emit_jobs {
        write_jobs(&written.folder, &job_lines(&written.plan, &written.folder, &args.train))?;
    }
    let report = Report {
        data: args.data.display().to_string(),
        out: args.out.display().to_string(),
        blocks: &written.plan.blocks,
        jobs: args.emit_jobs.then(|| args.out.join(JOBS).display().to_string()),
    };
    if args.json {
        return printer.json(&report);
    }
    let mut table = Table::default();
    table.row(["block", "training views", "test views", "points", "far points"].map(String::from));
    for block in report.blocks {
        let counts = [block.train_views, block.test_views, block.points, block.far_points];
        let [train, test, points, far] = counts.map(|count| grouped(count as u64));
        table.row([block.name.clone(), train, test, points, far]);
    }
    printer.line(table);
    match &report.jobs {
        Some(jobs) => printer.line(format_args!("{jobs}: {} commands", report.blocks.len())),
        None => printer.line(format_args!("{}: {} blocks", report.out, report.blocks.len())),
    }
    Ok(())
}
