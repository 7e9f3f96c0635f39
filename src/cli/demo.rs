//! `instgs-vk demo`: the whole story on a data set made by code: photos, a plain cloud, templates and instances, a table
//! and pictures side by side.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::args::create_folder;
use super::compare::{Comparison, SeedResult, compare, names};
use super::device::{self, DeviceArgs};
use super::error::CliError;
use super::printer::Printer;
use super::train::Session;
use crate::eval::Evaluated;
use crate::io::picture_png::write_png;
use crate::synth::dataset;
use crate::train::config::{ConfigBuilder, TrainConfig};
use crate::train::interrupt::Interrupt;

/// Steps of the plain cloud, of the joint phase, and the most Gaussians: a few minutes on two CPU cores.
const QUICK: [&str; 3] = ["steps=700", "joint.steps=400", "max_gaussians=40000"];
/// Timed frames of each scene.
const FRAMES: u32 = 18;
/// Test views in the picture.
const SHOWN: usize = 4;
/// What differences are multiplied by, so that they can be seen.
const DIFFERENCE_GAIN: f32 = 4.0;

/// The whole story on a made-up car park: photos, 3DGS, templates and instances, a table and pictures side by side.
///
/// Renders a data set of eight racing cars (DIR/data), trains a plain cloud, finds the cars by their masks, registers them to
/// each other and makes them instances of one template, trains both on for the same time (DIR/compare), and writes
/// DIR/pictures.png: photo, 3DGS, InstGS, and the difference of the latter to the photo. What is there already is not done
/// again.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk demo --out out/demo")]
pub(super) struct DemoArgs {
    /// Folder for data, runs and pictures; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// What the demo found.
#[derive(Debug, Serialize)]
pub(super) struct DemoReport {
    /// The data set.
    data: PathBuf,
    /// Rows of the table.
    results: Vec<SeedResult>,
    /// Photos and renderings.
    pictures: PathBuf,
    /// The instanced scene.
    scene: PathBuf,
    /// Wall time of all of it.
    seconds: f64,
}

pub(super) fn run_command(args: &DemoArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let started = Instant::now();
    let interrupt = Interrupt::on_ctrl_c().map_err(|e| CliError::Other(e.to_string()))?;
    let gpu = device::open(device_args.choice())?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    create_folder(&args.out)?;
    let data = args.out.join("data");
    make_data(&data, printer)?;
    let comparison = Comparison {
        config: config()?,
        data: data.clone(),
        out: args.out.join("compare"),
        seeds: vec![0],
        frames: FRAMES,
        more_steps: None,
        same_bytes: true,
    };
    let mut grid = Grid::default();
    let results = compare(&session, &comparison, &mut |name, view| grid.add(name, view))?;
    device::check_validation(&gpu)?;
    let report = DemoReport {
        pictures: args.out.join("pictures.png"),
        scene: comparison.out.join("seed_0/instgs/scene.instgs"),
        data,
        results,
        seconds: started.elapsed().as_secs_f64(),
    };
    grid.write(&report.pictures)?;
    if args.json {
        return printer.json(&report);
    }
    printer.line("");
    printer.line(format_args!("photo, 3DGS, InstGS, difference x{DIFFERENCE_GAIN}: {}", report.pictures.display()));
    printer.line(format_args!("the instanced scene: {}; try instgs-vk edit on it", report.scene.display()));
    printer.line(format_args!("{:.0} s in all", report.seconds));
    Ok(())
}

/// Renders the photos, unless they are there.
fn make_data(folder: &Path, printer: &Printer) -> Result<(), CliError> {
    let options = dataset::Options::default();
    if folder.join("groups.json").is_file() {
        return Ok(());
    }
    printer.line("a data set of eight racing cars, ray-traced");
    let mut progress = printer.progress("synth", u64::from(options.views));
    dataset::write("cars", folder, &options, &mut |done| progress.advance_to(u64::from(done), ""))?;
    Ok(())
}

fn config() -> Result<TrainConfig, CliError> {
    let mut builder = ConfigBuilder::new().file("instgs_quick")?;
    for assignment in QUICK {
        builder = builder.set(assignment)?;
    }
    Ok(builder.finish()?)
}

/// Test views side by side: a row a view.
#[derive(Default)]
struct Grid {
    rows: Vec<GridRow>,
}

/// A view: photo, 3DGS, InstGS.
struct GridRow {
    name: String,
    size: (u32, u32),
    photo: Vec<[f32; 3]>,
    renders: Vec<Vec<[f32; 3]>>,
}

impl Grid {
    /// Takes the renderings of the two scenes that are shown.
    fn add(&mut self, scene: &str, view: &Evaluated<'_>) {
        if ![names::SAME_TIME, names::OURS].contains(&scene) {
            return;
        }
        let render = view.pair.render().to_vec();
        if let Some(row) = self.rows.iter_mut().find(|row| row.name == view.name) {
            row.renders.push(render);
        } else if self.rows.len() < SHOWN {
            let size = (view.pair.width(), view.pair.height());
            let photo = view.pair.target().to_vec();
            self.rows.push(GridRow { name: view.name.into(), size, photo, renders: vec![render] });
        }
    }

    /// Writes the picture: columns photo, 3DGS, InstGS, and how InstGS differs from the photo.
    fn write(&self, path: &Path) -> Result<(), CliError> {
        let Some(&GridRow { size: (width, height), .. }) = self.rows.first() else { return Ok(()) };
        let columns = 4;
        let mut pixels = Vec::new();
        for row in self.rows.iter().filter(|row| row.size == (width, height) && row.renders.len() == 2) {
            let difference: Vec<[f32; 3]> =
                row.photo.iter().zip(&row.renders[1]).map(|(a, b)| differ(*a, *b)).collect();
            for y in 0..height as usize {
                let line = y * width as usize..(y + 1) * width as usize;
                for picture in [&row.photo, &row.renders[0], &row.renders[1], &difference] {
                    pixels.extend(picture[line.clone()].iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0) as u8));
                }
            }
        }
        let rows = pixels.len() as u32 / (3 * columns * width);
        Ok(write_png(path, &pixels, (columns * width, rows))?)
    }
}

/// Amplified difference of two colours.
fn differ(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| DIFFERENCE_GAIN * (a[c] - b[c]).abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{Metrics, PicturePair};

    /// Two views of 2x1 pixels: four columns, a row each; a view that only one scene has is left out.
    #[test]
    fn pictures_stand_side_by_side() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("grid.png");
        let mut grid = Grid::default();
        let target = [[0.5f32; 3]; 2];
        for (scene, value) in [(names::START, 0.0f32), (names::SAME_TIME, 0.25), (names::OURS, 0.625)] {
            let views: &[&str] = if scene == names::OURS { &["a", "b", "c"] } else { &["a", "b"] };
            for name in views {
                let pair = PicturePair::new((2, 1), &[[value; 3]; 2], &target, None)?;
                let metrics = Metrics::of(&pair, None)?;
                grid.add(scene, &Evaluated { name, pair: &pair, metrics, visible: 1 });
            }
        }
        grid.write(&path)?;
        let picture = image::open(&path)?.into_rgb8();
        assert_eq!(picture.dimensions(), (8, 2));
        let row: Vec<u8> = (0..8).map(|x| picture.get_pixel(x, 1).0[0]).collect();
        assert_eq!(row, [127, 127, 63, 63, 159, 159, 127, 127]);
        Ok(())
    }
}
