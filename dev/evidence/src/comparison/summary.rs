//! Summary of a comparison: a table of medians over the seeds, and the differences below it.

use crate::protocol::{Row, SeedResult, names};
use instgs_console::Printer;
use instgs_console::table::{Table, grouped};
use instgs_vk::math::statistics::median;

/// Medians over the seeds for each row: name, PSNR, in masks, SSIM, seconds, file bytes, host bytes, Gaussians.
pub(super) fn summary(results: &[SeedResult]) -> Vec<[String; 9]> {
    let head = ["", "PSNR", "in masks", "SSIM", "train s", "file bytes", "host bytes", "Gaussians", "frames/s"];
    let mut table = vec![head.map(String::from)];
    let Some(first) = results.first() else { return table };
    for (i, row) in first.rows.iter().enumerate() {
        let of = |figure: &dyn Fn(&Row) -> f64| median(&results.iter().map(|r| figure(&r.rows[i])).collect::<Vec<_>>());
        let place = [names::OURS, names::SAME_TIME].iter().position(|name| *name == row.name);
        let fps: Vec<f64> = place.map_or(Vec::new(), |p| results.iter().filter_map(|r| Some(r.fps?[p])).collect());
        table.push([
            row.name.clone(),
            format!("{:.2}", of(&|r| r.psnr)),
            format!("{:.2}", of(&|r| r.psnr_in_masks.unwrap_or(f64::NAN))),
            format!("{:.4}", of(&|r| r.ssim)),
            format!("{:.0}", of(&|r| r.seconds)),
            grouped(of(&|r| r.file_bytes as f64) as u64),
            grouped(of(&|r| r.host_bytes as f64) as u64),
            grouped(of(&|r| r.gaussians as f64) as u64),
            if fps.is_empty() { String::new() } else { format!("{:.2}", median(&fps)) },
        ]);
    }
    table
}

/// The same table as Markdown.
pub(super) fn markdown(table: &[[String; 9]]) -> String {
    let line = |cells: &[String; 9]| format!("| {} |\n", cells.join(" | "));
    let mut out = String::new();
    for (i, cells) in table.iter().enumerate() {
        out += &line(cells);
        if i == 0 {
            out += &format!("|---|{}\n", "---:|".repeat(8));
        }
    }
    out
}

/// The difference of `figure` between row `name` and row `other`, median over the seeds; `None` if a row is missing.
fn gain(results: &[SeedResult], name: &str, other: &str, figure: fn(&Row) -> Option<f64>) -> Option<f64> {
    let of = |r: &SeedResult, name: &str| r.rows.iter().find(|row| row.name == name).and_then(figure);
    let gains: Option<Vec<f64>> = results.iter().map(|r| Some(of(r, name)? - of(r, other)?)).collect();
    gains.filter(|g| !g.is_empty()).map(|g| median(&g))
}

/// Prints the table, and the differences that claims are based on.
pub(super) fn print_summary(table: &[[String; 9]], results: &[SeedResult], printer: &Printer) {
    let mut text = Table::default();
    table.iter().for_each(|cells| text.row(cells.clone()));
    printer.line("");
    printer.line(text);
    for (name, other) in [
        (names::OURS, names::SAME_TIME),
        (names::OURS, names::SAME_BYTES),
        (names::OURS_F16, names::OURS),
        (names::OURS_Q8, names::OURS),
        (names::OURS_SMALL, names::OURS),
    ] {
        if let Some(all) = gain(results, name, other, |row| Some(row.psnr)) {
            let in_masks = gain(results, name, other, |row| row.psnr_in_masks);
            let in_masks = in_masks.map_or(String::new(), |masks| format!(", {masks:+.2} dB in the masks"));
            let of = if results.len() == 1 { "one seed".into() } else { format!("median of {} seeds", results.len()) };
            printer.line(format_args!("{name} against {other}: {all:+.2} dB{in_masks}; {of}"));
        }
    }
    if let Some(result) = results.first() {
        let repeated = result.repeated;
        let ratio = |bytes: u64| repeated.ply as f64 / bytes.max(1) as f64;
        printer.line(format_args!(
            "repeated part: {} bytes as .ply, {} as f16 ({:.1}x smaller), {} as q8 ({:.1}x)",
            grouped(repeated.ply),
            grouped(repeated.f16),
            ratio(repeated.f16),
            grouped(repeated.q8),
            ratio(repeated.q8)
        ));
        let ratio = |bytes: u64| result.replaced_ply as f64 / bytes.max(1) as f64;
        printer.line(format_args!(
            "the plain cloud's own Gaussians of these objects: {} bytes as .ply ({:.1}x those as f16, {:.1}x as q8)",
            grouped(result.replaced_ply),
            ratio(repeated.f16),
            ratio(repeated.q8)
        ));
    }
    let fps: Vec<f64> = results.iter().filter_map(|r| r.fps.map(|f| f[0] / f[1])).collect();
    if !fps.is_empty() {
        let ratio = median(&fps);
        printer.line(format_args!("frames per second: {ratio:.2}x those of 3DGS, same time"));
    }
}
