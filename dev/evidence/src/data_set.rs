//! Data sets that commands generate.

use std::path::Path;

use instgs_console::{CliError, Printer};
use instgs_synth::dataset;

/// Renders a data set unless it exists.
pub(super) fn make_data(
    recipe: &str,
    folder: &Path,
    options: &dataset::Options,
    printer: &Printer,
) -> Result<(), CliError> {
    // The cameras are written last.
    if folder.join("transforms_test.json").is_file() {
        return Ok(());
    }
    printer.line(format_args!("photos of the scene {recipe}, ray-traced"));
    let mut progress = printer.progress("synth", u64::from(options.views));
    dataset::write::<CliError>(recipe, folder, options, &mut |done| {
        progress.advance_to(u64::from(done), "");
        Ok(())
    })?;
    Ok(())
}
