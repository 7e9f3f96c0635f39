//! `instgs-vk export --to X.html`: what a page needs besides the scene.

use instgs_console::{CliError, Printer};
use instgs_io::page::cameras_beside;
use instgs_io::small::SmallPlan;
use instgs_io::{Pack, PageOptions, write_page};
use instgs_vk::scene::InstancedScene;

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
    let cameras = cameras_beside(&args.scene).unwrap_or_else(|error| {
        printer.warning(format_args!("{error}: the page begins with the whole scene"));
        Vec::new()
    });
    let usual = PageOptions::of_views(scene, pack, &cameras);
    let up = args.up.map_or(usual.up, Triple::direction);
    Ok(write_page(&args.to, scene, &PageOptions { small: plan, up, ..usual })?)
}
