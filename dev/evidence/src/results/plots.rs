//! Plots of the evidence: line charts as SVG, bars for a terminal.

use super::tables::frame_ratio;
use super::{Part, SceneResult};
use crate::gains::{BestOf, gain, gain_over_best, over_seeds, psnr};
use crate::protocol::names;
use instgs_report::chart::{Chart, Look, Series};
use instgs_vk::scene::RepeatedBytes;

/// Width of the longest bar, characters.
const BAR: f64 = 24.0;

/// File name without extension, and the SVG text.
pub type Plot = (&'static str, String);

/// Every plot for which the measured scenes have data.
pub fn all(scenes: &[SceneResult]) -> Vec<Plot> {
    let scaling = Axis::of(scenes, Part::Scaling, "instances", |scene| scene.instances as f64);
    let differences = Axis::of(scenes, Part::Differences, "share of the differences", |scene| scene.differences);
    let best = |scene: &SceneResult| gain_over_best(&scene.seeds, psnr);
    let bytes = |scene: &SceneResult| gain(&scene.seeds, names::OURS_F16, names::SAME_BYTES, psnr);
    let (f16, q8) = (|s: &SceneResult| times_smaller(s, |r| r.f16), |s: &SceneResult| times_smaller(s, |r| r.q8));
    let above =
        |axis: &Axis<'_>| -> [Line<'_>; 2] { [(axis.best_name(), &best), ("of the same bytes, both f16", &bytes)] };
    let as_good = Some((0.0, "as good"));
    [
        ("scaling_bytes", scaling.drawn("Repeated part: times smaller than .ply", &[("f16", &f16), ("q8", &q8)], None)),
        ("scaling_psnr", scaling.drawn("dB above 3DGS", &above(&scaling), as_good)),
        (
            "scaling_fps",
            scaling.drawn(
                "Frames per second over those of 3DGS",
                &[("same time", &frame_ratio)],
                Some((1.0, "as fast")),
            ),
        ),
        ("differences_psnr", differences.drawn("dB above 3DGS", &above(&differences), as_good)),
    ]
    .into_iter()
    .filter_map(|(name, svg)| Some((name, svg?)))
    .collect()
}

/// Name of a curve, and its value for a scene.
type Line<'a> = (&'static str, &'a dyn Fn(&SceneResult) -> Option<f64>);

/// Scenes sorted by a quantity.
struct Axis<'a> {
    name: &'static str,
    /// Scenes with the quantity, ascending.
    points: Vec<(&'a SceneResult, f64)>,
}

impl<'a> Axis<'a> {
    fn of(scenes: &'a [SceneResult], part: Part, name: &'static str, at: fn(&SceneResult) -> f64) -> Self {
        let of_part = scenes.iter().filter(|scene| scene.part == part);
        let mut points: Vec<(&SceneResult, f64)> = of_part.map(|scene| (scene, at(scene))).collect();
        points.sort_by(|a, b| a.1.total_cmp(&b.1));
        Self { name, points }
    }

    /// Legend of the plain cloud that the instanced scene has to beat.
    fn best_name(&self) -> &'static str {
        match BestOf::of(self.points.iter().flat_map(|(scene, _)| &scene.seeds)) {
            Some(BestOf::Both) => "the better of the same time and at once",
            Some(BestOf::AtOnce) => "of the same time at once",
            Some(BestOf::Mixed) => "the better of those measured",
            Some(BestOf::SameTime) | None => "of the same time",
        }
    }

    /// Draws a chart as SVG; `None` without points.
    fn drawn(&self, title: &str, lines: &[Line<'_>], level: Option<(f64, &str)>) -> Option<String> {
        let curve = |figure: &dyn Fn(&SceneResult) -> Option<f64>| -> Vec<(f64, f64)> {
            self.points.iter().filter_map(|&(scene, at)| Some((at, figure(scene)?))).collect()
        };
        let curves: Vec<_> = lines.iter().map(|(name, figure)| (*name, curve(figure))).collect();
        let series = curves.iter().map(|(name, points)| Series { name, points, look: Look::Dots }).collect();
        Chart { title, over: self.name, series, marks: (&[], ""), level, from_zero: false }.svg_file()
    }
}

/// Size of the repeated part as .ply over its packed size, median over the seeds.
fn times_smaller(scene: &SceneResult, bytes: fn(&RepeatedBytes) -> u64) -> Option<f64> {
    over_seeds(&scene.seeds, |seed| Some(seed.repeated.ply as f64 / bytes(&seed.repeated).max(1) as f64))
}

/// A heading that names the rival, and one line per scene with a bar from zero: PSNR of InstGS above that of the better plain
/// cloud, dB. Where scenes have rivals that differ, each line names its own.
pub fn bars(scenes: &[SceneResult]) -> Vec<String> {
    let of_all = BestOf::of(scenes.iter().flat_map(|scene| &scene.seeds));
    let name_of = |scene: &SceneResult| match BestOf::of(&scene.seeds) {
        Some(best) if of_all == Some(BestOf::Mixed) => format!("{} ({})", scene.name, best.short()),
        _ => scene.name.clone(),
    };
    let values: Vec<(String, f64)> =
        scenes.iter().filter_map(|scene| Some((name_of(scene), gain_over_best(&scene.seeds, psnr)?))).collect();
    let longest = values.iter().map(|(_, v)| v.abs()).fold(f64::MIN_POSITIVE, f64::max);
    let name_width = values.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let line = |(name, value): &(String, f64)| {
        let length = (BAR * value.abs() / longest).round() as usize;
        let (left, right) =
            if *value < 0.0 { ("#".repeat(length), String::new()) } else { (String::new(), "#".repeat(length)) };
        let width = BAR as usize;
        format!("{name:name_width$} {value:+6.2} {left:>width$}|{right}").trim_end().to_owned()
    };
    let heading = of_all.map(|best| format!("InstGS above (+) or below (-) {}, dB:", best.name()));
    heading.into_iter().chain(values.iter().map(line)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::{Row, SeedResult};

    fn scene(name: &str, instances: u64, above: f64) -> SceneResult {
        let row = |name: &str, psnr| Row { name: name.into(), psnr, ..Row::default() };
        let repeated = RepeatedBytes { ply: 10 * instances, f16: 10, q8: 5, ..RepeatedBytes::default() };
        let rows = vec![row(names::SAME_TIME, 20.0), row(names::OURS, 20.0 + above)];
        let seeds = vec![SeedResult { rows, repeated, ..SeedResult::default() }];
        SceneResult { name: name.into(), instances, part: Part::Scaling, seeds, ..SceneResult::default() }
    }

    #[test]
    fn bars_grow_to_both_sides_of_zero() {
        let lines = bars(&[scene("a", 2, 0.5), scene("long", 4, -1.0), SceneResult::default()]);
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0], "InstGS above (+) or below (-) 3DGS, same time, dB:");
        assert_eq!(lines[1], format!("a     +0.50 {}|{}", " ".repeat(24), "#".repeat(12)));
        assert_eq!(lines[2], format!("long  -1.00 {}|", "#".repeat(24)));
        assert!(bars(&[]).is_empty());
    }

    #[test]
    fn bars_are_above_the_better_rival_and_say_which_it_is() {
        let mut other = scene("b", 4, 0.5);
        other.seeds[0].rows.push(Row { name: names::AT_ONCE.into(), psnr: 20.25, ..Row::default() });
        let lines = bars(std::slice::from_ref(&other));
        assert!(lines[0].contains("the better 3DGS, of the same time or at once"), "{lines:?}");
        assert!(lines[1].starts_with("b  +0.25"), "{lines:?}");
        let lines = bars(&[scene("a", 2, 0.5), other]);
        assert!(lines[0].contains("that was measured"), "{lines:?}");
        assert!(
            lines[1].starts_with("a (same time)  +0.50") && lines[2].starts_with("b (both)       +0.25"),
            "{lines:?}"
        );
    }

    /// A seed in which nothing was saved does not move the curve.
    #[test]
    fn points_are_medians_over_the_seeds() {
        let mut one = scene("a", 2, 0.5);
        let repeated = |ply| RepeatedBytes { ply, f16: 10, ..RepeatedBytes::default() };
        one.seeds = [10, 20, 900].map(|ply| SeedResult { repeated: repeated(ply), ..SeedResult::default() }).into();
        assert_eq!(times_smaller(&one, |r| r.f16), Some(2.0));
        assert_eq!(times_smaller(&SceneResult::default(), |r| r.f16), None);
    }

    #[test]
    fn plots_are_drawings_by_themselves_and_left_out_without_points() {
        assert!(all(&[]).is_empty());
        let plots = all(&[scene("b", 8, 0.1), scene("a", 2, 0.2)]);
        let names: Vec<&str> = plots.iter().map(|p| p.0).collect();
        // Nothing was timed, and there is no cloud of the same bytes.
        assert_eq!(names, ["scaling_bytes", "scaling_psnr"]);
        let svg = &plots[0].1;
        assert!(svg.starts_with("<svg xmlns=") && svg.contains("<style>") && svg.contains("f16"), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(plots[1].1.contains("of the same time<"), "{}", plots[1].1);
    }
}
