//! Plots of the evidence: lines as SVG for a page, bars for a terminal.

use super::tables::{frame_ratio, gain, psnr};
use super::{Part, SceneResult};
use crate::bench::comparison::names;
use crate::train::report::chart::{Chart, Look, Series};

/// Width of the longest bar, characters.
const BAR: f64 = 24.0;

/// File name without extension, and the drawing.
pub type Plot = (&'static str, String);

/// Every plot that the measured scenes have something for.
pub fn all(scenes: &[SceneResult]) -> Vec<Plot> {
    let mut points: Vec<(&SceneResult, f64)> =
        scenes.iter().filter(|s| s.part == Part::Scaling).map(|s| (s, s.instances as f64)).collect();
    points.sort_by(|a, b| a.1.total_cmp(&b.1));
    let of = |figure: &dyn Fn(&SceneResult) -> Option<f64>| -> Vec<(f64, f64)> {
        points.iter().filter_map(|&(scene, instances)| Some((instances, figure(scene)?))).collect()
    };
    let mean_over_seeds = |scene: &SceneResult, figure: &dyn Fn(&crate::bench::comparison::SeedResult) -> f64| {
        (!scene.seeds.is_empty()).then(|| scene.seeds.iter().map(figure).sum::<f64>() / scene.seeds.len() as f64)
    };
    let ratio = |bytes: fn(&crate::scene::RepeatedBytes) -> u64| {
        of(&|scene| mean_over_seeds(scene, &|s| s.repeated.ply as f64 / bytes(&s.repeated).max(1) as f64))
    };
    let (f16, q8) = (ratio(|r| r.f16), ratio(|r| r.q8));
    let (time, bytes) = (of(&|s| gain(s, names::SAME_TIME, psnr)), of(&|s| gain(s, names::SAME_BYTES, psnr)));
    let frames = of(&frame_ratio);
    let chart = |title: &'static str, series: Vec<Series<'_>>, level: Option<(f64, &'static str)>| {
        Chart { title, over: "instances", series, marks: (&[], ""), level, from_zero: false }.svg_file()
    };
    let series = |name: &'static str, points| Series { name, points, look: Look::Dots };
    [
        (
            "scaling_bytes",
            chart("Repeated part: times smaller than .ply", vec![series("f16", &f16), series("q8", &q8)], None),
        ),
        (
            "scaling_psnr",
            chart(
                "dB above 3DGS",
                vec![series("of the same time", &time), series("of the same bytes", &bytes)],
                Some((0.0, "as good")),
            ),
        ),
        (
            "scaling_fps",
            chart("Frames per second over those of 3DGS", vec![series("same time", &frames)], Some((1.0, "as fast"))),
        ),
    ]
    .into_iter()
    .filter_map(|(name, svg)| Some((name, svg?)))
    .collect()
}

/// A line for each scene, with a bar from zero: how far InstGS is above 3DGS of the same time, dB.
pub fn bars(scenes: &[SceneResult]) -> Vec<String> {
    let values: Vec<(&str, f64)> =
        scenes.iter().filter_map(|s| Some((s.name.as_str(), gain(s, names::SAME_TIME, psnr)?))).collect();
    let longest = values.iter().map(|(_, v)| v.abs()).fold(f64::MIN_POSITIVE, f64::max);
    let name_width = values.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let line = |&(name, value): &(&str, f64)| {
        let length = (BAR * value.abs() / longest).round() as usize;
        let (left, right) =
            if value < 0.0 { ("#".repeat(length), String::new()) } else { (String::new(), "#".repeat(length)) };
        let width = BAR as usize;
        format!("{name:name_width$} {value:+6.2} {left:>width$}|{right}").trim_end().to_owned()
    };
    values.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::comparison::{Row, SeedResult};
    use crate::scene::RepeatedBytes;

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
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0], format!("a     +0.50 {}|{}", " ".repeat(24), "#".repeat(12)));
        assert_eq!(lines[1], format!("long  -1.00 {}|", "#".repeat(24)));
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
    }
}
