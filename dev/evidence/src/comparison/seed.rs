//! The comparison for one seed: its training runs, and the rows that are measured.

use std::path::{Path, PathBuf};

use super::runs::{Runs, Seen, work_seconds};
use super::same_bytes::most_gaussians;
use super::timing::time;
use super::{Comparison, Rival};
use crate::protocol::{Row, SeedResult, names};
use instgs_cli::training::Session;
use instgs_console::CliError;
use instgs_eval::Evaluated;
use instgs_io::view_image::camera_at_width;
use instgs_io::{IoError, Pack, View, load_scene, ply, write_scene_file_packed, write_spz};
use instgs_objects::pipeline::config::ConfigBuilder;
use instgs_report::{RunReport, final_steps_per_second};
use instgs_train::event_log::read_events;
use instgs_vk::scene::{Camera, RepeatedBytes};

/// A scene that becomes a row of the table.
struct Subject {
    name: &'static str,
    /// Path of the scene file.
    file: PathBuf,
    seconds: f64,
    steps: u64,
}

/// Trains what has not been trained yet, and measures all rows.
pub(super) fn compare_seed(
    session: &Session<'_>,
    comparison: &Comparison,
    views: &[View],
    seed: u64,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<SeedResult, CliError> {
    let printer = session.printer;
    let out = comparison.out.join(format!("seed_{seed}"));
    let mut config = comparison.config.clone();
    config.train.seed = seed;
    let runs = Runs { session, data: &comparison.data, out, config };
    printer.line(format_args!("seed {seed}: the instanced scene"));
    let ours = runs.train("instgs", runs.config.clone())?;
    let vanilla = ours.vanilla.clone().unwrap_or_default();
    let vanilla_seconds = work_seconds(&vanilla);
    let more_seconds = work_seconds(&ours) - vanilla_seconds;
    let log = read_events(&runs.folder("instgs").plain_cloud_run().events())?;
    let pace = final_steps_per_second(&log).unwrap_or(vanilla.steps_per_second);
    let more_steps_by_clock = (more_seconds * pace).ceil() as u64;
    let more = comparison.more_steps.unwrap_or(more_steps_by_clock).max(1);
    printer.line(format_args!("seed {seed}: 3DGS for the same time, {more} more steps"));
    let same_time = runs.continued("same_time", more)?;

    let instanced = load_scene(&runs.folder("instgs").scene())?.scene;
    for (name, pack) in [("f16", Pack::F16), ("q8", Pack::Q8)] {
        write_scene_file_packed(&runs.out.join(format!("{name}.instgs")), &instanced, pack)?;
    }
    runs.write_small("small", &instanced)?;
    let mut subjects = vec![
        Subject {
            name: names::START,
            file: runs.folder("instgs").plain_cloud_run().point_cloud(),
            seconds: vanilla_seconds,
            steps: vanilla.steps,
        },
        of_cloud(names::SAME_TIME, runs.folder("same_time").point_cloud(), &same_time),
    ];
    for &rival in &comparison.rivals {
        subjects.push(runs.rival(rival, &same_time)?);
    }
    let (seconds, steps) = (work_seconds(&ours), vanilla.steps + ours.steps);
    for (name, file) in [
        (names::OURS, runs.folder("instgs").scene()),
        (names::OURS_F16, runs.out.join("f16.instgs")),
        (names::OURS_Q8, runs.out.join("q8.instgs")),
        (names::OURS_SMALL, runs.out.join("small.instgs")),
    ] {
        subjects.push(Subject { name, file, seconds, steps });
    }
    let mut result = SeedResult {
        seed,
        repeated: RepeatedBytes::of(&instanced),
        replaced_ply: replaced_gaussians(&ours) * ply::row_bytes(instanced.templates.sh_degree),
        more_steps_by_clock,
        warnings: ours.warnings,
        ..SeedResult::default()
    };
    measure(&runs, comparison, views, &subjects, &mut result, on_picture)?;
    Ok(result)
}

/// Number of Gaussians of the plain cloud that became instances, without those left out as hardly visible.
fn replaced_gaussians(report: &RunReport) -> u64 {
    let shared = report.groups.iter().filter(|group| group.template.is_some());
    shared.flat_map(|group| &group.instances).map(|instance| instance.gaussians as u64).sum()
}

fn of_cloud(name: &'static str, file: PathBuf, report: &RunReport) -> Subject {
    let (seconds, steps) = (work_seconds(report), report.steps);
    Subject { name, file, seconds, steps }
}

impl Runs<'_> {
    /// Trains or writes the scene of a rival.
    fn rival(&self, rival: Rival, same_time: &RunReport) -> Result<Subject, CliError> {
        let (seed, printer) = (self.config.train.seed, self.session.printer);
        let mut as_long = self.config.cloud_alone();
        as_long.train.steps = same_time.steps;
        match rival {
            Rival::SameBytes => {
                let bytes = file_bytes(&self.out.join("f16.instgs"))?;
                let start = load_scene(&self.folder("instgs").plain_cloud_run().point_cloud())?.scene;
                let most = most_gaussians(bytes, &start)?;
                printer.line(format_args!("seed {seed}: 3DGS of the same bytes, at most {most} Gaussians"));
                // With another limit it is another run.
                let folder = format!("same_bytes_{most}");
                as_long.train.max_gaussians = most;
                let report = self.train(&folder, as_long)?;
                let cloud = load_scene(&self.folder(&folder).point_cloud())?.scene;
                let file = self.out.join("same_bytes.instgs");
                write_scene_file_packed(&file, &cloud, Pack::F16)?;
                // Values that f16 cannot hold are written as f32.
                if file_bytes(&file)? > bytes {
                    printer
                        .warning(format_args!("{}: has more than the {bytes} bytes of InstGS as f16", file.display()));
                }
                Ok(of_cloud(names::SAME_BYTES, file, &report))
            }
            Rival::AtOnce => {
                printer.line(format_args!("seed {seed}: 3DGS for the same time, in one piece"));
                let report = self.train("at_once", as_long)?;
                Ok(of_cloud(names::AT_ONCE, self.folder("at_once").point_cloud(), &report))
            }
            Rival::Mcmc => {
                printer.line(format_args!("seed {seed}: 3DGS-MCMC for the same time"));
                // With the start and the rates of its own preset, and the cap of the others.
                let own = ConfigBuilder::new().file("mcmc")?.finish()?.train;
                as_long.train.strategy = own.strategy;
                (as_long.train.init_opacity, as_long.train.init_scale) = (own.init_opacity, own.init_scale);
                as_long.train.rates.final_factor = own.rates.final_factor;
                let report = self.train("mcmc", as_long)?;
                Ok(of_cloud(names::MCMC, self.folder("mcmc").point_cloud(), &report))
            }
            Rival::Spz => {
                let cloud = load_scene(&self.folder("same_time").point_cloud())?.scene;
                let file = self.out.join("same_time.spz");
                write_spz(&file, &cloud.background, cloud.pixel_filter.antialias)?;
                Ok(of_cloud(names::SPZ, file, same_time))
            }
            Rival::Small => {
                let cloud = load_scene(&self.folder("same_time").point_cloud())?.scene;
                let file = self.write_small("same_time_small", &cloud)?;
                Ok(of_cloud(names::SAME_TIME_SMALL, file, same_time))
            }
            Rival::Rigid => {
                printer.line(format_args!("seed {seed}: copies without offsets"));
                let mut config = self.config.clone();
                let offsets = &mut config.train.offsets;
                (offsets.position, offsets.sh_dc, offsets.opacity) = (false, false, false);
                (offsets.sh_degree, offsets.covariance) = (0, false);
                config.train.joint.color_matrix_rate = 0.0;
                let report = self.variant("rigid", config)?;
                let steps = self.config.train.steps + report.steps;
                Ok(Subject {
                    name: names::RIGID,
                    file: self.folder("rigid").scene(),
                    seconds: work_seconds(&report),
                    steps,
                })
            }
        }
    }
}

/// Renders the test views of every scene, and times two of them.
fn measure(
    runs: &Runs<'_>,
    comparison: &Comparison,
    views: &[View],
    subjects: &[Subject],
    result: &mut SeedResult,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<(), CliError> {
    let masks = runs.masks(views)?;
    let measure = runs.measure(Seen { views, masks: masks.as_ref(), lpips: comparison.lpips.as_ref() });
    for Subject { name, file, seconds, steps } in subjects {
        let row = measure.row(name, file, &mut |view| on_picture(name, view))?;
        result.rows.push(Row { seconds: *seconds, steps: *steps, ..row });
    }
    if comparison.frames > 0 {
        let cameras: Vec<Camera> = views.iter().map(|v| camera_at_width(&v.camera, measure.width)).collect();
        time(runs, comparison.frames, &cameras, result)?;
    }
    Ok(())
}

fn file_bytes(path: &Path) -> Result<u64, CliError> {
    Ok(std::fs::metadata(path).map_err(|e| IoError::new(path, format!("cannot be read: {e}")))?.len())
}
