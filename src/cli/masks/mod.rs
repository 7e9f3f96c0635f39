//! `instgs-vk masks`: masks of repeated objects, made from words or boxes, and a page to look them over.

use std::path::{Path, PathBuf};

use clap::Args;

use super::device::DeviceArgs;
use super::error::CliError;
use super::printer::Printer;
use crate::io::{MaskFolder, View, read_views};
use crate::train::stage_pictures::{REVIEW, review};

/// Makes masks of a dataset's photos, or looks over those there are.
///
/// DIR gets a page, review.html, that shows every view with its masks: look at it before training.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk masks --data cars --masks cars/masks --out cars_review")]
pub(super) struct MasksArgs {
    /// Dataset folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    source: SourceArgs,
    /// Folder for the masks and the page; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// Where masks come from.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct SourceArgs {
    /// Masks that are there already: only the page is made
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
}

pub(super) fn run(args: &MasksArgs, _device: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let views = read_views(&args.data)?.views;
    if let Some(masks) = &args.source.masks {
        super::args::create_folder(&args.out)?;
        write_page(&args.out, &views, &MaskFolder::open(masks)?, printer)?;
    }
    Ok(())
}

fn write_page(out: &Path, views: &[View], masks: &MaskFolder, printer: &Printer) -> Result<(), CliError> {
    let page = out.join(REVIEW);
    review(&page, views, masks, None)?;
    printer.line(format_args!("every view with its masks: {}", page.display()));
    Ok(())
}
