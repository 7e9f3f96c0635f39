//! `instgs-vk masks`: makes masks of repeated objects from words or boxes, and a page to review them.

mod boxes;
mod prompt;

use std::path::{Path, PathBuf};

use clap::Args;

use self::boxes::BoxArgs;
use self::prompt::PromptArgs;
use instgs_console::args::create_folder;
use instgs_console::device::DeviceArgs;
use instgs_console::{CliError, Printer};
use instgs_io::{IoError, MaskFolder, RunFolder, View, read_views};
use instgs_report::stage_pictures::review;

/// Makes masks of a data set's photos, or a page to review existing masks.
///
/// DIR gets a page, review.html, that shows every view with its masks: look at it before training.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk masks --data park --prompt \"car. bench.\" --models models --out park_masks\n  \
    instgs-vk masks --data park --boxes boxes.json --scene runs/park/point_cloud.ply --out park_masks\n  \
    instgs-vk masks --data cars --masks cars/masks --out cars_review")]
pub(super) struct MasksArgs {
    /// Dataset folder with the photos
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    prompt: PromptArgs,
    #[command(flatten)]
    boxes: BoxArgs,
    /// Folder for the masks and the page; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// The source of the masks; exactly one flag is given.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct SourceArgs {
    /// What to detect in the photos, for instance "car. office chair."; needs --models
    #[arg(long, value_name = "TEXT")]
    prompt: Option<String>,
    /// Boxes around objects, in the world or in photos (boxes.json); needs --scene
    #[arg(long, value_name = "JSON")]
    boxes: Option<PathBuf>,
    /// Existing masks, as for train: only the page is made
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
}

/// The report on existing masks, printed with `--json`.
#[derive(serde::Serialize)]
struct PageReport {
    /// Number of views of the data set.
    views: usize,
    /// Path of the page that shows them.
    page: PathBuf,
}

pub(super) fn run(args: &MasksArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let views = read_views(&args.data)?.views;
    let source = &args.source;
    if let Some(masks) = &source.masks {
        let masks = MaskFolder::open(masks, &views)?;
        masks.notes.iter().for_each(|note| printer.warning(note));
        create_folder(&args.out)?;
        let page = write_page(&args.out, &views, &masks, printer)?;
        if args.json {
            return printer.json(&PageReport { views: views.len(), page });
        }
    } else if let Some(text) = &source.prompt {
        check_folder(&args.out, &views)?;
        let report = prompt::make(&views, text, &args.prompt, &args.out, printer)?;
        write_page(&args.out, &views, &MaskFolder::open(&args.out, &views)?, printer)?;
        if args.json {
            return printer.json(&report);
        }
        prompt::print(&report, printer);
    } else if let Some(path) = &source.boxes {
        check_folder(&args.out, &views)?;
        let report = boxes::make(&views, path, &args.boxes, &args.out, device_args, printer)?;
        write_page(&args.out, &views, &MaskFolder::open(&args.out, &views)?, printer)?;
        if args.json {
            return printer.json(&report);
        }
        boxes::print(&report, printer);
    }
    Ok(())
}

/// Refuses a folder that has masks: the ids of two sets of masks would be mixed up.
fn check_folder(out: &Path, views: &[View]) -> Result<(), CliError> {
    let has_masks = out.is_dir() && MaskFolder::open(out, views).is_ok();
    match has_masks {
        true => Err(IoError::new(out, "holds masks already").advise("choose another folder").into()),
        false => Ok(()),
    }
}

fn write_page(out: &Path, views: &[View], masks: &MaskFolder, printer: &Printer) -> Result<PathBuf, CliError> {
    let page = RunFolder::new(out).review();
    review(&page, views, masks, None)?;
    printer.line(format_args!("every view with its masks: {}", page.display()));
    Ok(page)
}
