//! Writes the files of the evidence.

use std::path::Path;

use crate::results::{SceneResult, plots, tables};
use instgs_console::args::create_folder;
use instgs_console::{CliError, Printer};
use instgs_io::atomic_write;

/// Writes tables.md, tables.json, a .csv for each table, and plots.
pub(super) fn write_all(out: &Path, results: &[SceneResult], note: &str, printer: &Printer) -> Result<(), CliError> {
    printer.json_file(&out.join("tables.json"), &results)?;
    let (tables_folder, plots_folder) = (out.join("tables"), out.join("plots"));
    create_folder(&tables_folder)?;
    create_folder(&plots_folder)?;
    let mut page = String::new();
    let device = results.first().map_or("", |scene| scene.device.as_str());
    let version = env!("CARGO_PKG_VERSION");
    page += &format!("Measured with instgs-vk {version} on {device}. {note}\n\n");
    for sheet in tables::all(results) {
        page += &sheet.markdown();
        page.push('\n');
        let csv = sheet.csv().map_err(|e| CliError::msg(format!("{}: {e}", sheet.key)))?;
        write(&tables_folder.join(format!("{}.csv", sheet.key)), &csv)?;
    }
    for (name, svg) in plots::all(results) {
        page += &format!("![{name}](plots/{name}.svg)\n\n");
        write(&plots_folder.join(format!("{name}.svg")), svg.as_bytes())?;
    }
    write(&out.join("tables.md"), page.as_bytes())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    Ok(atomic_write(path, |file| file.write_all(bytes))?)
}
