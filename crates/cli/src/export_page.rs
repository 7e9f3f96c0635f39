//! `instgs-vk export --to X.html`: what a page needs besides the scene.

use std::path::Path;

use instgs_console::{CliError, Printer};
use instgs_io::small::SmallPlan;
use instgs_io::{Pack, PageOptions, RunFolder, read_cameras, write_page};
use instgs_vk::scene::{Camera, InstancedScene};

use super::export::ExportArgs;
use instgs_console::args::Triple;

/// Writes the page of a scene. It begins at the first training view if the scene lies in its run's folder.
pub(super) fn write(
    args: &ExportArgs,
    scene: &InstancedScene,
    pack: Pack,
    plan: Option<&SmallPlan>,
    printer: &Printer,
) -> Result<(), CliError> {
    let cameras = cameras_beside(&args.scene, printer);
    let usual = PageOptions::of_views(scene, pack, &cameras);
    let up = args.up.map_or(usual.up, Triple::direction);
    Ok(write_page(&args.to, scene, &PageOptions { small: plan, up, ..usual })?)
}

/// The training views of the run that a scene lies in; none if there is no such file, or none that can be read.
fn cameras_beside(scene: &Path, printer: &Printer) -> Vec<Camera> {
    let file = RunFolder::new(scene.parent().unwrap_or(Path::new("."))).cameras();
    if !file.is_file() {
        return Vec::new();
    }
    read_cameras(&file).unwrap_or_else(|error| {
        printer.warning(format_args!("{error}: the page begins with the whole scene"));
        Vec::new()
    })
}
