//! The table of figures by kernel as Markdown, and its place in a page.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use instgs_console::table::grouped;
use instgs_io::{IoError, atomic_write, read_bytes};

use crate::figures::{DeviceFigures, Figure, Figures};

/// What stands in a page before and after the table.
const BEGIN: &str = "<!-- table: written by tools/isa --write-table -->\n";
const END: &str = "<!-- end of table -->\n";

/// A row per kernel, the worst of its specialisations, and a column per family.
pub fn markdown(families: &BTreeMap<String, DeviceFigures>) -> String {
    let drivers: BTreeSet<&str> = families.values().map(|device| device.driver.as_str()).collect();
    let mut out = format!("Driver: {}.\n\n| kernel |", drivers.into_iter().collect::<Vec<_>>().join(", "));
    let by_family: Vec<_> = families.values().map(DeviceFigures::by_kernel).collect();
    for (name, device) in families {
        let _ = write!(out, " {name}, {} lanes |", device.subgroup_size);
    }
    let _ = writeln!(out, "\n|---|{}", "---|".repeat(families.len()));
    let kernels: BTreeSet<&str> = by_family.iter().flat_map(|kernels| kernels.keys().copied()).collect();
    for kernel in kernels {
        let cells = by_family.iter().map(|kernels| kernels.get(kernel).map_or("-".into(), cell));
        let _ = writeln!(out, "| {kernel} | {} |", cells.collect::<Vec<_>>().join(" | "));
    }
    out
}

/// Registers, waves, bytes and cost; in bold what was spilled, if anything was.
fn cell(figures: &Figures) -> String {
    let text = |figure| figures.get(&figure).map_or("-".into(), |&value| grouped(value));
    let shown = [Figure::Registers, Figure::Waves, Figure::CodeBytes, Figure::Cost].map(text).join(" / ");
    match figures.get(&Figure::Spills) {
        Some(&spills) if spills > 0 => format!("{shown}, **{} spilled**", grouped(spills)),
        _ => shown,
    }
}

/// Writes the table to a file; in a page that has a place for it, only that changes.
///
/// # Errors
/// A page whose place for the table does not end, or a file that cannot be read or written.
pub fn write(path: &Path, table: &str) -> Result<(), IoError> {
    let page = match path.exists() {
        true => String::from_utf8(read_bytes(path)?).map_err(|_| IoError::new(path, "is not UTF-8 text"))?,
        false => format!("{BEGIN}{END}"),
    };
    let page = with_table(&page, table).ok_or_else(|| {
        let places = format!("has no place for the table: a line {} and, below, {}", BEGIN.trim(), END.trim());
        IoError::new(path, places).advise("add both, or name another file")
    })?;
    atomic_write(path, |out| out.write_all(page.as_bytes()))
}

/// The page with another table; `None` if it has no place for one.
fn with_table(page: &str, table: &str) -> Option<String> {
    let (before, rest) = page.split_once(BEGIN)?;
    let (_, after) = rest.split_once(END)?;
    Some(format!("{before}{BEGIN}\n{table}\n{END}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::KernelFigures;

    fn row(specialisation: &str, figures: &[(Figure, u64)]) -> KernelFigures {
        KernelFigures {
            kernel: "tile_blend".into(),
            specialisation: specialisation.into(),
            subgroup_sizes: vec![32],
            figures: figures.iter().copied().collect(),
            unknown: BTreeMap::new(),
        }
    }

    #[test]
    fn a_row_has_the_worst_of_the_specialisations() {
        let kernels = vec![
            row("TRAINING=0", &[(Figure::Registers, 96), (Figure::Waves, 16), (Figure::CodeBytes, 12_492)]),
            row("TRAINING=1", &[(Figure::Registers, 90), (Figure::Waves, 12), (Figure::Spills, 1_000)]),
        ];
        let (device, driver) = ("a device".into(), "radv 1".into());
        let figures = DeviceFigures { device, driver, subgroup_size: 32, seconds: 1.0, kernels };
        let table = markdown(&BTreeMap::from([("gfx1100".to_owned(), figures)]));
        let expected = "Driver: radv 1.\n\n| kernel | gfx1100, 32 lanes |\n|---|---|\n\
                        | tile_blend | 96 / 12 / 12,492 / -, **1,000 spilled** |\n";
        assert_eq!(table, expected);
    }

    #[test]
    fn only_the_tables_place_in_a_page_changes() {
        let page = format!("Before.\n{BEGIN}old\n{END}After.\n");
        let new = with_table(&page, "new\n").unwrap();
        assert_eq!(new, format!("Before.\n{BEGIN}\nnew\n\n{END}After.\n"));
        assert_eq!(with_table(&new, "new\n").as_deref(), Some(&new[..]));
        assert_eq!(with_table("Before.\n", "new\n"), None);
    }
}
