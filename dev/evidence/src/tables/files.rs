//! Writes the files of the evidence.

use std::path::Path;

use crate::origin::Origin;
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
    page += &format!("{} {note}\n\n", measured_with(results));
    page += &limits(results);
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

/// The program and every device that results come from; with their scenes, if there are several.
fn measured_with(results: &[SceneResult]) -> String {
    let origins = grouped_by(results, |scene| Some(scene.origin.clone()));
    let one = origins.len() == 1;
    let text = |(origin, scenes): &(Origin, Vec<&str>)| {
        let scenes = if one { String::new() } else { format!(" ({})", scenes.join(", ")) };
        format!("instgs-vk {} on {}{scenes}", origin.program, origin.device)
    };
    format!("Measured with {}.", origins.iter().map(text).collect::<Vec<_>>().join("; "))
}

/// What scenes may draw, where instances may draw more than plain clouds: a paragraph for each limit, with its scenes.
fn limits(results: &[SceneResult]) -> String {
    let texts = grouped_by(results, |scene| scene.limits.text());
    texts.iter().map(|(text, scenes)| format!("{text}: {}.\n\n", scenes.join(", "))).collect()
}

/// Names of scenes by what `key` says of them, in the order in which it first occurs.
fn grouped_by<K: PartialEq>(results: &[SceneResult], key: impl Fn(&SceneResult) -> Option<K>) -> Vec<(K, Vec<&str>)> {
    let mut out: Vec<(K, Vec<&str>)> = Vec::new();
    for scene in results {
        let Some(of_scene) = key(scene) else { continue };
        match out.iter_mut().find(|(there, _)| *there == of_scene) {
            Some((_, names)) => names.push(&scene.name),
            None => out.push((of_scene, vec![&scene.name])),
        }
    }
    out
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    Ok(atomic_write(path, |file| file.write_all(bytes))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::DrawLimits;

    #[test]
    fn the_head_names_every_device_and_what_may_be_drawn() {
        let scene = |name: &str, device: &str, instanced| SceneResult {
            name: name.into(),
            origin: Origin { program: "0.1.0 (f)".into(), device: device.into() },
            limits: DrawLimits { plain: 10, instanced },
            ..SceneResult::default()
        };
        let one = [scene("a", "A", 10), scene("b", "A", 10)];
        assert_eq!(measured_with(&one), "Measured with instgs-vk 0.1.0 (f) on A.");
        assert_eq!(limits(&one), "");
        let several = [scene("a", "A", 12), scene("b", "B", 10), scene("c", "A", 12)];
        let want = "Measured with instgs-vk 0.1.0 (f) on A (a, c); instgs-vk 0.1.0 (f) on B (b).";
        assert_eq!(measured_with(&several), want);
        let text = limits(&several);
        assert!(text.starts_with("InstGS may draw up to 12 Gaussians") && text.ends_with(": a, c.\n\n"), "{text}");
    }
}
