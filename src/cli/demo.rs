//! `instgs-vk demo`: an instanced scene and its flattened self, side by side: pictures, table, report.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;

use super::args::create_folder;
use super::bench::print_report;
use super::device::{self, DeviceArgs};
use super::error::CliError;
use super::picture_files::{self, Format};
use super::printer::Printer;
use super::render::picture;
use crate::bench::{self, Report, Stage, Subject};
use crate::gpu::Gpu;
use crate::io::{load_scene, save_scene, write_ply};
use crate::render::{Picture, RenderOptions, Renderer};
use crate::scene::trajectory::Orbit;
use crate::scene::{Camera, InstancedScene};
use crate::synth::{SKY_COLOR, embedded_scene, embedded_views};

/// Timed frames of each scene for every view.
const FRAMES_PER_VIEW: u32 = 2;

/// The whole story on the embedded scene: instanced and flattened, pictures, frame rates, bytes.
///
/// Writes DIR/scene.instgs, DIR/flattened.ply, pictures of both in DIR/instanced and DIR/flattened, and DIR/report.json.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk demo --out out/demo")]
pub(super) struct DemoArgs {
    /// Folder for scenes, pictures and report; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// Views of the circle around the scene.
const ORBIT_VIEWS: u32 = 8;
/// Picture size.
const SIZE: (u32, u32) = (640, 360);

pub(super) fn run_command(args: &DemoArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let scene = &embedded_scene();
    let mut cameras = Orbit::around(scene, None).cameras(ORBIT_VIEWS, SIZE);
    cameras.extend(embedded_views(SIZE));
    let gpu = device::open(device_args.choice())?;
    let report = run(&gpu, scene, &cameras, SKY_COLOR, &args.out, printer)?;
    device::check_validation(&gpu)?;
    if args.json { printer.json(&report) } else { Ok(()) }
}

/// What the demo found.
#[derive(Debug, serde::Serialize)]
pub struct DemoReport {
    /// Instanced against flattened.
    #[serde(flatten)]
    pub bench: Report,
    /// Between the two scenes' pictures over all views, dB; `null` if they are equal bit by bit.
    pub psnr: Option<f64>,
    /// The pictures.
    pub pictures: Vec<PathBuf>,
}

/// Saves `scene` as `out/scene.instgs` and flattened as `out/flattened.ply`, renders both to
/// `out/instanced` and `out/flattened`, measures them side by side, prints the comparison and writes `out/report.json`.
///
/// # Errors
/// A file that cannot be written, or a device that cannot render.
pub fn run(
    gpu: &Arc<Gpu>,
    scene: &InstancedScene,
    cameras: &[Camera],
    background: [f32; 3],
    out: &Path,
    printer: &Printer,
) -> Result<DemoReport, CliError> {
    let (scene_path, flattened_path) = (out.join("scene.instgs"), out.join("flattened.ply"));
    create_folder(out)?;
    save_scene(&scene_path, scene)?;
    write_ply(&flattened_path, &scene.flatten())?;
    // From here on, what the files hold.
    let instanced = load_scene(&scene_path)?;
    let flattened = load_scene(&flattened_path)?;
    // A .ply does not say that its scene is antialiased.
    let options = RenderOptions { antialias: scene.antialias, background, ..RenderOptions::default() };
    let frames = FRAMES_PER_VIEW * cameras.len() as u32;

    let mut renders = Renders { gpu, cameras, options, printer };
    let (mut pictures, from_instanced) = renders.all(&instanced.scene, &out.join("instanced"))?;
    let (more, from_flattened) = renders.all(&flattened.scene, &out.join("flattened"))?;
    pictures.extend(more);
    let psnr = psnr(&from_instanced, &from_flattened);

    let mut progress = printer.progress("bench", frames.into());
    let mut on_event = |stage| {
        if stage == Stage::Timed {
            progress.step("");
        }
    };
    let subject =
        |path: &Path, scene, file_bytes| Subject { name: path.display().to_string(), scene, file_bytes, options };
    let first = subject(&scene_path, &instanced.scene, instanced.file_bytes);
    let second = subject(&flattened_path, &flattened.scene, flattened.file_bytes);
    let bench = bench::run(gpu, &first, Some(&second), cameras, frames, &mut on_event)?;
    drop(progress);

    let report = DemoReport { bench, psnr, pictures };
    print_report(&report.bench, printer);
    printer.line("");
    match psnr {
        Some(psnr) => printer.line(format_args!("PSNR between the two scenes' pictures: {psnr:.1} dB")),
        None => printer.line("the two scenes' pictures are equal"),
    }
    let report_path = out.join("report.json");
    printer.json_file(&report_path, &report)?;
    report.pictures.iter().for_each(|path| printer.line(path.display()));
    printer.line(report_path.display());
    Ok(report)
}

/// What all pictures of the demo share.
struct Renders<'a> {
    gpu: &'a Arc<Gpu>,
    cameras: &'a [Camera],
    options: RenderOptions,
    printer: &'a Printer,
}

impl Renders<'_> {
    /// Renders every view to PNGs in `folder`; returns the files and the float pictures.
    fn all(&mut self, scene: &InstancedScene, folder: &Path) -> Result<(Vec<PathBuf>, Vec<Picture>), CliError> {
        create_folder(folder)?;
        let place = || folder.display();
        let mut renderer = Renderer::new(self.gpu).map_err(CliError::render(place()))?;
        let device_scene = renderer.upload(scene).map_err(CliError::render(place()))?;
        let mut progress = self.printer.progress("render", self.cameras.len() as u64);
        let (mut files, mut pictures) = (Vec::new(), Vec::new());
        for camera in self.cameras {
            let picture =
                picture(&mut renderer, &device_scene, camera, &self.options).map_err(CliError::render(place()))?;
            let names = picture_files::write(folder, &camera.name, &picture, Format::Png, false)?;
            files.extend(names.iter().map(|name| folder.join(name)));
            progress.step(folder.join(&names[0]).display());
            pictures.push(picture);
        }
        Ok((files, pictures))
    }
}

/// Peak signal-to-noise ratio of colours clamped to 0..1, over all pictures at once; `None` = no difference.
fn psnr(a: &[Picture], b: &[Picture]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0u64);
    for (p, q) in a.iter().flat_map(|p| &p.colors).zip(b.iter().flat_map(|p| &p.colors)) {
        for c in 0..3 {
            let difference = f64::from(p[c].clamp(0.0, 1.0)) - f64::from(q[c].clamp(0.0, 1.0));
            sum += difference * difference;
            count += 1;
        }
    }
    (sum > 0.0).then(|| -10.0 * (sum / count as f64).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn psnr_by_hand() {
        let picture = |v: f32| Picture { width: 1, height: 1, colors: vec![[v, v, v, 0.0]], depths: vec![0.0] };
        assert_eq!(psnr(&[picture(0.5)], &[picture(0.5)]), None);
        assert!(psnr(&[picture(0.5)], &[picture(0.6)]).is_some_and(|v| (v - 20.0).abs() < 1e-4));
        assert!(psnr(&[picture(2.0)], &[picture(-1.0)]).is_some_and(|v| v.abs() < 1e-9));
    }
}
