//! `instgs-vk compare`: trains an instanced scene and the plain clouds that it must be measured against, and measures.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::{Deserialize, Serialize};

mod runs;
mod summary;

use self::runs::{Runs, work_seconds};
use self::summary::{markdown, print_summary, summary};
use super::args::create_folder;
use super::bench::print_report;
use super::device::{self, DeviceArgs};
use super::error::CliError;
use super::inspect_groups::ply_row_bytes;
use super::printer::Printer;
use super::train::{Session, absolute};
use crate::bench::comparison::{Measure, MeasureError, Row};
use crate::bench::{self, Subject};
use crate::eval::Evaluated;
use crate::io::view_image::camera_at_width;
use crate::io::{Dataset, IoError, MaskFolder, Pack, Split, View, load_scene, read_views, write_scene_file_packed};
use crate::scene::{Camera, RepeatedBytes};
use crate::train::config::{ConfigBuilder, Method, TrainConfig};
use crate::train::eval_options;
use crate::train::interrupt::Interrupt;

/// Compares an instanced scene with plain clouds that had as much time, or may have as many bytes.
///
/// For each seed: the plain cloud and the instanced scene made of it; the cloud trained on for as long as the instanced
/// scene took in all; a cloud whose .ply is not larger than the instanced scene packed as f16, trained as long. All are
/// rendered from the test views by the same renderer. OUT gets seed_S/ with a run folder each, compare.json and
/// compare.md; what is there already is not trained again.
#[derive(Args)]
#[command(after_help = "Example:\n  \
    instgs-vk compare --data cars --out out/compare --config instgs_quick --seeds 0,1,2\n  \
    instgs-vk compare --data cars --groups cars/groups.json --out out/compare_given --config instgs_quick")]
pub(super) struct CompareArgs {
    /// Dataset folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// groups.json: which objects are alike, and where they stand [default: found from the masks]
    #[arg(long, value_name = "JSON")]
    groups: Option<PathBuf>,
    /// Folder with a PNG of object ids per image [default: DATA/masks]
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Folder for runs and results; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A preset or a TOML file
    #[arg(long, value_name = "F", default_value = "instgs")]
    config: String,
    /// One value of the configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seeds, one comparison each; figures are medians over them
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Timed frames of each scene; 0 = none
    #[arg(long, value_name = "N", default_value = "24")]
    frames: u32,
    /// Train the plain cloud on for N steps, instead of for the time that the instanced scene took: on a busy machine, or
    /// to get the same figures again
    #[arg(long, value_name = "N")]
    more_steps: Option<u64>,
    /// Leave out the cloud of as many bytes
    #[arg(long)]
    without_same_bytes: bool,
    /// Results as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// One seed's results.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SeedResult {
    pub(super) seed: u64,
    /// See [`names`].
    pub(super) rows: Vec<Row>,
    /// Frames per second of the instanced scene, and of the cloud that had the same time; measured in turn.
    pub(super) fps: Option<[f64; 2]>,
    /// (splat, tile) pairs of the same two, mean over the views.
    pub(super) intersections: Option<[u64; 2]>,
    /// Milliseconds a frame by pass of the same two.
    pub(super) passes_ms: Vec<(String, f64, f64)>,
    /// The repeated part of the scene.
    pub(super) repeated: RepeatedBytes,
    /// Warnings about groups and objects.
    pub(super) warnings: Vec<String>,
}

/// Names of rows, which are also those of the table.
pub(super) mod names {
    pub(in crate::cli) const START: &str = "3DGS, the start";
    pub(in crate::cli) const SAME_TIME: &str = "3DGS, same time";
    pub(in crate::cli) const SAME_BYTES: &str = "3DGS, same bytes";
    pub(in crate::cli) const OURS: &str = "InstGS";
    pub(in crate::cli) const OURS_F16: &str = "InstGS, f16";
    pub(in crate::cli) const OURS_Q8: &str = "InstGS, q8";
}

/// What is compared.
pub(super) struct Comparison {
    /// Dataset folder.
    pub(super) data: PathBuf,
    /// Folder for runs and results.
    pub(super) out: PathBuf,
    /// Of the instanced runs, the seed apart.
    pub(super) config: TrainConfig,
    /// One comparison each.
    pub(super) seeds: Vec<u64>,
    /// Timed frames; 0 = none.
    pub(super) frames: u32,
    /// Steps that the plain cloud is trained on; `None` = by the clock.
    pub(super) more_steps: Option<u64>,
    /// Train a cloud of as many bytes, too.
    pub(super) same_bytes: bool,
}

pub(super) fn run(args: &CompareArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let comparison = args.comparison()?;
    let interrupt = Interrupt::on_ctrl_c().map_err(|e| CliError::Other(e.to_string()))?;
    let gpu = device::open(device_args.choice())?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    let results = compare(&session, &comparison, &mut |_, _| ())?;
    device::check_validation(&gpu)?;
    if args.json { printer.json(&results) } else { Ok(()) }
}

impl CompareArgs {
    fn comparison(&self) -> Result<Comparison, CliError> {
        let mut builder = ConfigBuilder::new().file(&self.config)?;
        for assignment in &self.set {
            builder = builder.set(assignment)?;
        }
        if let Some(groups) = &self.groups {
            builder = builder.flag("--groups", "groups", absolute("--groups", groups)?)?;
        }
        if let Some(masks) = &self.masks {
            builder = builder.flag("--masks", "masks", absolute("--masks", masks)?)?;
        }
        // What a configuration takes as a seed is its own matter.
        for &seed in &self.seeds {
            builder = builder.flag("--seeds", "seed", as_i64(seed)?)?;
        }
        let config = TrainConfig { method: Method::Instanced, seed: 0, ..builder.finish()? };
        if !config.init_scene.is_empty() {
            let what = "compare trains its own plain cloud, of which it knows the time: leave out init_scene";
            return Err(CliError::Other(what.into()));
        }
        Ok(Comparison {
            data: self.data.clone(),
            out: self.out.clone(),
            config,
            seeds: self.seeds.clone(),
            frames: self.frames,
            more_steps: self.more_steps,
            same_bytes: !self.without_same_bytes,
        })
    }
}

fn as_i64(seed: u64) -> Result<i64, CliError> {
    i64::try_from(seed).map_err(|_| CliError::Other(format!("--seeds: {seed} is too large")))
}

/// Trains and measures for every seed; writes compare.json and compare.md and prints the table. `on_picture` gets the rows'
/// name and each test view of the first seed.
pub(super) fn compare(
    session: &Session<'_>,
    comparison: &Comparison,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<Vec<SeedResult>, CliError> {
    create_folder(&comparison.out)?;
    keep_config(comparison)?;
    let mut results = Vec::new();
    for (i, &seed) in comparison.seeds.iter().enumerate() {
        let mut first_only = |name: &str, view: &Evaluated<'_>| {
            if i == 0 {
                on_picture(name, view);
            }
        };
        results.push(compare_seed(session, comparison, seed, &mut first_only)?);
        session.printer.json_file(&comparison.out.join("compare.json"), &results)?;
    }
    let table = summary(&results);
    let markdown = markdown(&table);
    crate::io::atomic_write(&comparison.out.join("compare.md"), |out| out.write_all(markdown.as_bytes()))?;
    print_summary(&table, &results, session.printer);
    Ok(results)
}

/// Writes the configuration down; refuses a folder with runs of another one, which would be taken for results of this one.
fn keep_config(comparison: &Comparison) -> Result<(), CliError> {
    let path = comparison.out.join("config.toml");
    let text = comparison.config.to_toml()?;
    match std::fs::read(&path) {
        Ok(there) if there != text.as_bytes() => {
            let error = IoError::new(&path, "is of another comparison");
            Err(error.advise("repeat it with the same configuration, or choose another --out").into())
        }
        Ok(_) => Ok(()),
        Err(_) => Ok(crate::io::atomic_write(&path, |out| out.write_all(text.as_bytes()))?),
    }
}

fn compare_seed(
    session: &Session<'_>,
    comparison: &Comparison,
    seed: u64,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<SeedResult, CliError> {
    let printer = session.printer;
    let out = comparison.out.join(format!("seed_{seed}"));
    let config = TrainConfig { seed, ..comparison.config.clone() };
    let runs = Runs { session, data: &comparison.data, out: out.clone(), config };
    let config = &runs.config;
    printer.line(format_args!("seed {seed}: the instanced scene"));
    let ours = runs.train("instgs", config.clone())?;
    let vanilla = ours.vanilla.clone().unwrap_or_default();
    let vanilla_seconds = work_seconds(&vanilla);
    let more_seconds = work_seconds(&ours) - vanilla_seconds;
    let more = comparison.more_steps.unwrap_or((more_seconds * vanilla.steps_per_second).ceil() as u64).max(1);
    printer.line(format_args!("seed {seed}: 3DGS for the same time, {more} more steps"));
    let same_time = runs.continued("same_time", more)?;

    let instanced = load_scene(&out.join("instgs/scene.instgs"))?.scene;
    let packed = [("f16", Pack::F16), ("q8", Pack::Q8)];
    for (name, pack) in packed {
        write_scene_file_packed(&out.join(format!("{name}.instgs")), &instanced, pack)?;
    }
    let mut scenes = vec![
        (names::START, "instgs/vanilla/point_cloud.ply".to_owned(), vanilla_seconds, vanilla.steps),
        (names::SAME_TIME, "same_time/point_cloud.ply".into(), work_seconds(&same_time), same_time.steps),
    ];
    if comparison.same_bytes {
        let bytes_each = ply_row_bytes(instanced.templates.sh_degree);
        let most = u32::try_from(file_bytes(&out.join("f16.instgs"))? / bytes_each).unwrap_or(u32::MAX);
        printer.line(format_args!("seed {seed}: 3DGS of the same bytes, at most {most} Gaussians"));
        let capped = TrainConfig { max_gaussians: most, steps: same_time.steps, ..config.cloud_phase() };
        // Of another limit it is another run.
        let folder = format!("same_bytes_{most}");
        let capped = runs.train(&folder, capped)?;
        let file = format!("{folder}/point_cloud.ply");
        scenes.push((names::SAME_BYTES, file, work_seconds(&capped), capped.steps));
    }
    let (seconds, steps) = (work_seconds(&ours), vanilla.steps + ours.steps);
    for (name, file) in
        [(names::OURS, "instgs/scene.instgs"), (names::OURS_F16, "f16.instgs"), (names::OURS_Q8, "q8.instgs")]
    {
        scenes.push((name, file.into(), seconds, steps));
    }
    let views: Vec<View> = Dataset::split(&read_views(&comparison.data)?, Split::Test).cloned().collect();
    let given = (!config.masks.is_empty()).then(|| PathBuf::from(&config.masks));
    let masks = given.or_else(|| MaskFolder::default_for(&comparison.data));
    let masks = masks.map(|folder| MaskFolder::open(&folder)).transpose()?;
    let width = (config.width > 0).then_some(config.width);
    let options = eval_options(config);
    let measure = Measure { gpu: session.gpu, views: &views, width, options, masks: masks.as_ref() };
    let mut rows = Vec::new();
    for (name, file, seconds, steps) in scenes {
        let row = measure.row(name, &out.join(file), &mut |view| on_picture(name, view)).map_err(measure_failed)?;
        rows.push(Row { seconds, steps, ..row });
    }
    let mut result = SeedResult {
        seed,
        rows,
        fps: None,
        intersections: None,
        passes_ms: Vec::new(),
        repeated: RepeatedBytes::of(&instanced),
        warnings: ours.warnings,
    };
    if comparison.frames > 0 {
        let cameras: Vec<Camera> = views.iter().map(|v| camera_at_width(&v.camera, width)).collect();
        time(session, comparison, &out, &cameras, config, &mut result)?;
    }
    Ok(result)
}

fn file_bytes(path: &Path) -> Result<u64, CliError> {
    Ok(std::fs::metadata(path).map_err(|e| IoError::new(path, format!("cannot be read: {e}")))?.len())
}

fn measure_failed(error: MeasureError) -> CliError {
    CliError::Other(error.to_string())
}

/// Frame rates of the instanced scene and the cloud that had the same time, frame by frame in turn.
fn time(
    session: &Session<'_>,
    comparison: &Comparison,
    out: &Path,
    cameras: &[Camera],
    config: &TrainConfig,
    result: &mut SeedResult,
) -> Result<(), CliError> {
    let paths = [out.join("instgs/scene.instgs"), out.join("same_time/point_cloud.ply")];
    let loaded = [load_scene(&paths[0])?, load_scene(&paths[1])?];
    let options = eval_options(config);
    let subject = |i: usize| Subject {
        name: paths[i].display().to_string(),
        scene: &loaded[i].scene,
        file_bytes: loaded[i].file_bytes,
        options,
    };
    let frames = comparison.frames.max(cameras.len() as u32);
    let report = bench::run(session.gpu, &subject(0), Some(&subject(1)), cameras, frames, &mut |_| ())?;
    if let Some(against) = &report.against {
        result.fps = Some([report.scene.fps, against.fps]);
        result.intersections = Some([report.scene.gaussians.intersections, against.gaussians.intersections]);
        let of = |pass: &str| against.passes_ms.iter().find(|(name, _)| *name == pass).map_or(f64::NAN, |p| p.1);
        result.passes_ms = report.scene.passes_ms.iter().map(|(name, ms)| ((*name).into(), *ms, of(name))).collect();
    }
    print_report(&report, session.printer);
    Ok(())
}
