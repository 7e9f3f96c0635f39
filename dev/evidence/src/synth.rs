//! `instgs-vk synth`: generates data sets with known truth.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use instgs_console::args::parse_size;
use instgs_console::{CliError, Printer};
use instgs_synth::dataset::{self, ObjectCount, Options, PoseNoise, RECIPES, Truth};

/// Renders photos of a procedural scene with repeated objects, with their masks, depths, poses and cameras.
///
/// Writes images, masks with categories, depth (view-space z), cameras with a split (every eighth view is for test),
/// points3d.ply and groups.json with the exact poses to DIR. The same options give the same bytes.
#[derive(Args)]
#[command(after_help = after_help())]
pub(super) struct SynthArgs {
    /// Name of the scene, see below
    name: String,
    /// Folder for the data set; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of views to render
    #[arg(long, value_name = "N", default_value_t = 48, value_parser = clap::value_parser!(u32).range(2..=i64::from(dataset::MAX_VIEWS)))]
    views: u32,
    /// Size of the pictures, pixels
    #[arg(long, value_name = "WxH", default_value = "320x180", value_parser = parse_size)]
    size: (u32, u32),
    /// Seed of all random choices
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Number of objects [default: see below]
    #[arg(long, value_name = "K")]
    instances: Option<u32>,
    /// Fraction of the differences between objects of a kind: 0 = all look like the first, 1 = full differences
    #[arg(long, value_name = "SHARE", default_value_t = 1.0)]
    differences: f64,
    /// Cameras on a line towards the scene's centre, from FAR to NEAR metres, instead of around it; split as usual
    #[arg(long, value_name = "FAR:NEAR", value_parser = parse_flight)]
    flight: Option<(f64, f64)>,
    /// Also writes groups_noisy.json: every pose rotated by DEGREES and shifted by PART of the object's size; scales
    /// that differ change by half of PART
    #[arg(long, value_name = "DEGREES:PART", value_parser = parse_pose_noise)]
    pose_noise: Option<PoseNoise>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

fn after_help() -> String {
    let mut text = String::from("Scenes (objects: default, fewest to most):\n");
    for recipe in &RECIPES {
        let ObjectCount { usual: own, least, most } = recipe.instances;
        text += &format!("  {:<10} {} ({own}, {least} to {most})\n", recipe.name, recipe.about);
    }
    text + "\nExamples:\n  \
        instgs-vk synth cars --out data/cars\n  \
        instgs-vk synth orchard --out data/orchard --views 96 --size 800x450 --pose-noise 2:0.02"
}

fn parse_flight(text: &str) -> Result<(f64, f64), String> {
    let number =
        |text: &str| text.trim().parse().ok().filter(|d| (dataset::MIN_FLIGHT..=dataset::MAX_FLIGHT).contains(d));
    let ends = text.split_once(':').and_then(|(from, to)| Some((number(from)?, number(to)?)));
    let (least, most) = (dataset::MIN_FLIGHT, dataset::MAX_FLIGHT);
    ends.ok_or_else(|| format!("want FAR:NEAR, distances of {least} to {most} metres, for instance 60:6"))
}

fn parse_pose_noise(text: &str) -> Result<PoseNoise, String> {
    let number = |text: &str, most: f64| text.trim().parse().ok().filter(|v| (0.0..=most).contains(v));
    let parts = text.split_once(':').and_then(|(d, p)| Some((number(d, 180.0)?, number(p, 1.0)?)));
    let (degrees, part) = parts.ok_or("want DEGREES:PART, 0 to 180 and 0 to 1, for instance 2:0.02")?;
    Ok(PoseNoise { degrees, part })
}

#[derive(serde::Serialize)]
struct Made {
    name: String,
    out: String,
    views: usize,
    size: (u32, u32),
    seed: u64,
    groups: Vec<MadeGroup>,
    points: usize,
    triangles: usize,
    seconds: f64,
}

#[derive(serde::Serialize)]
struct MadeGroup {
    name: String,
    instances: usize,
}

pub(super) fn run(args: &SynthArgs, printer: &Printer) -> Result<(), CliError> {
    let options = Options {
        views: args.views,
        size: args.size,
        seed: args.seed,
        instances: args.instances,
        differences: args.differences,
        flight: args.flight,
        pose_noise: args.pose_noise,
    };
    let start = Instant::now();
    let mut progress = printer.progress("synth", args.views.into());
    let mut on_view = |done: u32| {
        progress.advance_to(done.into(), "");
        Ok(())
    };
    let truth = dataset::write::<CliError>(&args.name, &args.out, &options, &mut on_view)?;
    drop(progress);
    let report = report(args, &truth, start.elapsed().as_secs_f64());
    if args.json {
        return printer.json(&report);
    }
    let groups: Vec<String> = report.groups.iter().map(|g| format!("{} x {}", g.instances, g.name)).collect();
    let (width, height) = args.size;
    printer.line(format_args!(
        "{}: {} views of {width}x{height}, {}, {} points, {:.1} s",
        report.out,
        report.views,
        groups.join(", "),
        report.points,
        report.seconds
    ));
    Ok(())
}

fn report(args: &SynthArgs, truth: &Truth, seconds: f64) -> Made {
    let group = |g: &instgs_vk::scene::PosedGroup| MadeGroup {
        name: g.name.clone().unwrap_or_default(),
        instances: g.instances.len(),
    };
    Made {
        name: args.name.clone(),
        out: args.out.display().to_string(),
        views: truth.cameras.len(),
        size: args.size,
        seed: args.seed,
        groups: truth.groups.iter().map(group).collect(),
        points: truth.points,
        triangles: truth.triangles,
        seconds,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_has_two_ends() {
        assert_eq!(parse_flight("60:6.5"), Ok((60.0, 6.5)));
        for bad in ["", "60", "60:", "0:5", "60:nan", "1e9:5", "1:2:3"] {
            assert!(parse_flight(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn pose_noise_is_two_numbers() {
        assert_eq!(parse_pose_noise("2:0.02"), Ok(PoseNoise { degrees: 2.0, part: 0.02 }));
        for bad in ["", "2", "2:", ":1", "2:2", "-1:0", "181:0", "nan:0", "1:2:3"] {
            assert!(parse_pose_noise(bad).is_err(), "{bad}");
        }
    }
}
