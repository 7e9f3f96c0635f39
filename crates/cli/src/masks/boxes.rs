//! `masks --boxes`: makes masks from boxes around objects and a trained plain cloud.

use std::path::{Path, PathBuf};

use clap::Args;

use super::unfinished::marked;
use crate::progress_lines::LabelLines;
use instgs_console::args::open_scene;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::{IoError, View, read_boxes, with_view_names};
use instgs_objects::pipeline::write_masks_from_boxes;
use instgs_objects::segment::boxes::{BoxOptions, BoxReport};
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::InstancedScene;

/// Flags of `masks --boxes` and its scene.
#[derive(Args)]
#[command(next_help_heading = "With --boxes")]
pub(super) struct BoxArgs {
    /// The trained scene: .ply, .spz, .sog, .splat, .glb or .instgs
    #[arg(long, value_name = "PLY", conflicts_with_all = ["prompt", "masks"])]
    scene: Option<PathBuf>,
    /// Keep the ground or support that an object stands on, where a box contains some of it
    #[arg(long, conflicts_with_all = ["prompt", "masks"])]
    keep_support: bool,
    /// Width at which boxes in photos are rendered, that of the scene's training; 0 = the photos' own [default: 0]
    #[arg(long, value_name = "W", conflicts_with_all = ["prompt", "masks"])]
    width: Option<u32>,
}

impl BoxArgs {
    fn options(&self, render: RenderOptions) -> BoxOptions {
        let width = self.width.filter(|&width| width > 0);
        BoxOptions { leave_out_support: !self.keep_support, width, render, ..BoxOptions::default() }
    }
}

/// Writes the masks of all views into the folder `out`.
pub(super) fn make(
    views: &[View],
    boxes: &Path,
    args: &BoxArgs,
    out: &Path,
    device_args: &DeviceArgs,
    printer: &Printer,
) -> Result<BoxReport, CliError> {
    let Some(scene) = &args.scene else {
        let what = "--boxes needs a trained scene: give it with --scene (train --method 3dgs makes one)";
        return Err(CliError::msg(what));
    };
    let (path, boxes) = (boxes, with_view_names(read_boxes(boxes)?, views));
    if boxes.objects.is_empty() && !views.iter().any(|view| boxes.views.contains_key(&view.camera.name)) {
        let first = boxes.views.keys().next().map(|name| format!(" (it has some of {name})")).unwrap_or_default();
        let error = IoError::new(path, format!("has no box in the world and none in a photo of the data set{first}"));
        return Err(error.advise("a view has the name of its photo, with or without the ending").into());
    }
    let scene = open_scene(scene, printer)?.scene;
    let options = args.options(RenderOptions::of(&scene));
    let cloud = InstancedScene::from_cloud(scene.flatten());
    let gpu = device::open(device_args.choice())?;
    let mut lines = LabelLines::new(printer);
    let report = marked(out, || Ok(write_masks_from_boxes(&gpu, &cloud, views, &boxes, &options, out, &mut lines)?));
    drop(lines);
    let report = report?;
    device::check_validation(&gpu)?;
    report.notes.iter().for_each(|note| printer.warning(note));
    Ok(report)
}

pub(super) fn print(report: &BoxReport, printer: &Printer) {
    let mut table = Table::default();
    table.row(["object", "category", "boxes", "Gaussians", "support left out", "views"].map(String::from));
    for object in &report.objects {
        table.row([
            object.id.to_string(),
            object.category.clone().unwrap_or_else(|| "-".into()),
            grouped(object.boxes as u64),
            grouped(object.gaussians as u64),
            object.support.map_or("-".into(), |count| grouped(count as u64)),
            grouped(object.views as u64),
        ]);
    }
    printer.line(table);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_width_of_0_is_that_of_the_photos() {
        let width = |width| BoxArgs { scene: None, keep_support: false, width }.options(RenderOptions::default()).width;
        assert_eq!([None, Some(0), Some(400)].map(width), [None, None, Some(400)]);
    }
}
