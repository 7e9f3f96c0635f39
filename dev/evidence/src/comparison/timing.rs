//! Measures the frame rates of two scenes, frame by frame in turn.

use super::Runs;
use crate::protocol::SeedResult;
use instgs_cli::bench_report::print_report;
use instgs_console::CliError;
use instgs_eval::bench::{self, Subject};
use instgs_io::load_scene;
use instgs_train::eval_options;
use instgs_vk::scene::Camera;

/// Measures the frame rates of the instanced scene and the cloud of the same time, frame by frame in turn.
pub(super) fn time(runs: &Runs<'_>, frames: u32, cameras: &[Camera], result: &mut SeedResult) -> Result<(), CliError> {
    let paths = [runs.folder("instgs").scene(), runs.folder("same_time").point_cloud()];
    let loaded = [load_scene(&paths[0])?, load_scene(&paths[1])?];
    let options = eval_options(&runs.config.train);
    let subject =
        |i: usize| Subject::whole(paths[i].display().to_string(), &loaded[i].scene, loaded[i].file_bytes, options);
    let frames = frames.max(cameras.len() as u32);
    let report = bench::run::<CliError>(runs.session.gpu, subject(0), Some(subject(1)), cameras, frames, &mut |_| ())?;
    if let Some(against) = &report.against {
        result.fps = Some([report.scene.fps, against.fps]);
        result.intersections = Some([report.scene.gaussians.intersections, against.gaussians.intersections]);
        let of = |pass: &str| against.passes_ms.iter().find(|(name, _)| *name == pass).map_or(f64::NAN, |p| p.1);
        result.passes_ms = report.scene.passes_ms.iter().map(|(name, ms)| ((*name).into(), *ms, of(name))).collect();
    }
    print_report(&report, runs.session.printer);
    Ok(())
}
