//! Summary of a comparison: a table of medians over the seeds, and the differences below it.

use crate::gains::{BestOf, gain, gain_over_best, over_seeds, psnr, psnr_in_masks};
use crate::protocol::{DrawLimits, Row, SeedResult, names};
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

/// The same table as Markdown, and the claims below it.
pub(super) fn markdown(table: &[[String; 9]], claims: &[String]) -> String {
    let line = |cells: &[String; 9]| format!("| {} |\n", cells.join(" | "));
    let mut out = String::new();
    for (i, cells) in table.iter().enumerate() {
        out += &line(cells);
        if i == 0 {
            out += &format!("|---|{}\n", "---:|".repeat(8));
        }
    }
    out.push('\n');
    claims.iter().for_each(|claim| out += &format!("- {claim}\n"));
    out
}

/// The differences that claims are based on, one line each: first that to the better plain cloud, which counts.
pub(super) fn claims(results: &[SeedResult], limits: DrawLimits) -> Vec<String> {
    let of = if results.len() == 1 { "one seed".into() } else { format!("median of {} seeds", results.len()) };
    let against = |name: &str, other: &str, all: Option<f64>, in_masks: Option<f64>| {
        let in_masks = in_masks.map_or(String::new(), |masks| format!(", {masks:+.2} dB in the masks"));
        Some(format!("{name} against {other}: {:+.2} dB{in_masks}; {of}", all?))
    };
    let best_of = BestOf::of(results);
    let over_best = |figure: fn(&Row) -> Option<f64>| gain_over_best(results, figure);
    let mut out = Vec::new();
    out.extend(best_of.and_then(|best| against(names::OURS, best.name(), over_best(psnr), over_best(psnr_in_masks))));
    let mut pairs = vec![
        (names::OURS_F16, names::SAME_BYTES),
        (names::OURS_F16, names::OURS),
        (names::OURS_Q8, names::OURS),
        (names::OURS_SMALL, names::OURS),
    ];
    // Where one alone was measured, it is the better one, and is there already.
    if best_of == Some(BestOf::Both) {
        pairs.splice(0..0, [(names::OURS, names::SAME_TIME), (names::OURS, names::AT_ONCE)]);
    }
    let over = |name: &str, other: &str, figure: fn(&Row) -> Option<f64>| gain(results, name, other, figure);
    out.extend(
        pairs.iter().filter_map(|(name, other)| {
            against(name, other, over(name, other, psnr), over(name, other, psnr_in_masks))
        }),
    );
    out.extend(limits.text());
    out.extend(repeated_part(results, &of));
    if let Some(ratio) = over_seeds(results, |result| result.fps.map(|[ours, theirs]| ours / theirs)) {
        out.push(format!("frames per second: {ratio:.2}x those of 3DGS, same time; {of}"));
    }
    out
}

/// The sizes of the repeated part, medians over the seeds; `of` says of how many.
fn repeated_part(results: &[SeedResult], of: &str) -> Vec<String> {
    let over = |figure: &dyn Fn(&SeedResult) -> f64| over_seeds(results, |result| Some(figure(result)));
    let bytes = |figure: fn(&SeedResult) -> u64| over(&|r| figure(r) as f64).map(|median| grouped(median as u64));
    let ratio = |a: fn(&SeedResult) -> u64, b: fn(&SeedResult) -> u64| over(&|r| a(r) as f64 / b(r).max(1) as f64);
    let ply = |r: &SeedResult| r.repeated.ply;
    let replaced = |r: &SeedResult| r.replaced_ply;
    let f16 = |r: &SeedResult| r.repeated.f16;
    let q8 = |r: &SeedResult| r.repeated.q8;
    let repeated = || {
        Some(format!(
            "repeated part: {} bytes as .ply, {} as f16 ({:.1}x smaller), {} as q8 ({:.1}x); {of}",
            bytes(ply)?,
            bytes(f16)?,
            ratio(ply, f16)?,
            bytes(q8)?,
            ratio(ply, q8)?
        ))
    };
    let own = || {
        Some(format!(
            "the plain cloud's own Gaussians of these objects: {} bytes as .ply ({:.1}x those as f16, {:.1}x as q8); {of}",
            bytes(replaced)?,
            ratio(replaced, f16)?,
            ratio(replaced, q8)?
        ))
    };
    repeated().into_iter().chain(own()).collect()
}

/// Prints the table, and the claims below it.
pub(super) fn print_summary(table: &[[String; 9]], claims: &[String], printer: &Printer) {
    let mut text = Table::default();
    table.iter().for_each(|cells| text.row(cells.clone()));
    printer.line("");
    printer.line(text);
    claims.iter().for_each(|claim| printer.line(claim));
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::scene::RepeatedBytes;

    /// PSNRs of the cloud of the same time, that in one piece, that of the same bytes, and InstGS as f32 and f16.
    fn seed([time, once, same_bytes, ours, f16]: [f64; 5], repeated: RepeatedBytes) -> SeedResult {
        let row = |(name, psnr): (&str, f64)| Row { name: name.into(), psnr, ..Row::default() };
        let rows = [
            (names::SAME_TIME, time),
            (names::AT_ONCE, once),
            (names::SAME_BYTES, same_bytes),
            (names::OURS, ours),
            (names::OURS_F16, f16),
        ];
        let rows = rows.map(row).into_iter().collect();
        SeedResult { rows, repeated, replaced_ply: repeated.ply / 2, fps: Some([3.0, 2.0]), ..SeedResult::default() }
    }

    fn repeated(ply: u64, f16: u64, q8: u64) -> RepeatedBytes {
        RepeatedBytes { ply, f16, q8, ..RepeatedBytes::default() }
    }

    #[test]
    fn claims_are_medians_over_the_seeds_against_the_better_rival() {
        let seeds = [
            seed([20.0, 21.0, 18.0, 22.0, 21.5], repeated(9_000, 9_000, 9_000)),
            seed([20.5, 18.0, 18.0, 22.0, 21.5], repeated(1_000, 500, 250)),
            seed([19.0, 20.0, 18.0, 22.5, 21.5], repeated(4_000, 1_000, 400)),
        ];
        let lines = claims(&seeds, DrawLimits { plain: 10, instanced: 12 });
        let starts = |start: &str| lines.iter().filter(|line| line.starts_with(start)).count();
        // Less than against either of them over all seeds.
        assert_eq!(
            lines[0],
            "InstGS against the better 3DGS, of the same time or at once: +1.50 dB; median of 3 seeds"
        );
        assert_eq!(lines[1], "InstGS against 3DGS, same time: +2.00 dB; median of 3 seeds");
        assert_eq!(lines[2], "InstGS against 3DGS, same time at once: +2.50 dB; median of 3 seeds");
        assert_eq!(starts("InstGS, f16 against 3DGS, same bytes: +3.50 dB; "), 1, "{lines:?}");
        assert_eq!(starts("InstGS may draw up to 12 Gaussians"), 1, "{lines:?}");
        // Not those of the first seed, in which nothing was saved: the median of ratios 1, 2, 4 and 1, 4, 10.
        let repeated =
            "repeated part: 4,000 bytes as .ply, 1,000 as f16 (2.0x smaller), 400 as q8 (4.0x); median of 3 seeds";
        assert_eq!(starts(repeated), 1, "{lines:?}");
        let own = "the plain cloud's own Gaussians of these objects: 2,000 bytes as .ply (1.0x those as f16, 2.0x as q8); median";
        assert_eq!(starts(own), 1, "{lines:?}");
        assert_eq!(starts("frames per second: 1.50x"), 1);
        assert!(markdown(&summary(&seeds), &lines).contains("\n\n- InstGS against the better 3DGS"));
    }

    #[test]
    fn one_rival_is_named_and_not_said_twice() {
        let mut one = seed([20.0, 21.0, 18.0, 22.0, 21.5], RepeatedBytes::default());
        one.rows.retain(|row| row.name != names::AT_ONCE);
        let lines = claims(&[one], DrawLimits::default());
        assert_eq!(lines[0], "InstGS against 3DGS, same time: +2.00 dB; one seed");
        assert_eq!(lines.iter().filter(|line| line.contains("against 3DGS, same time")).count(), 1);
        assert!(!lines.iter().any(|line| line.contains("may draw")));
        assert!(claims(&[], DrawLimits::default()).is_empty());
    }
}
