//! `instgs-vk bench --lod`: cost and savings of levels of detail, as a table.

use super::bench::{BenchArgs, options};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer, device};
use instgs_eval::bench::{LodReport, LodRow, LodSubject, LodView, run_lod};
use instgs_io::LoadedScene;
use instgs_io::view_image::load_view;
use instgs_vk::gpu::DeviceChoice;

pub(super) fn run(
    args: &BenchArgs,
    loaded: &LoadedScene,
    choice: DeviceChoice,
    printer: &Printer,
) -> Result<(), CliError> {
    let views = views(args, loaded, printer)?;
    let gpu = device::open(choice)?;
    args.memory.limit(&gpu);
    let mut progress = printer.progress("bench", args.frames.into());
    let options = options(args, &loaded.scene, args.precision.precision());
    let subject = LodSubject { name: args.scene.display().to_string(), scene: &loaded.scene, options };
    let report = run_lod(&gpu, &subject, &args.lod, &views, args.frames, &mut || progress.step(""))?;
    drop(progress);
    device::check_validation(&gpu)?;
    if args.json.write(&report, printer)? {
        print_report(&report, printer);
    }
    Ok(())
}

/// The first `--frames` cameras, with their photos if they come from a data set at its own size.
fn views(args: &BenchArgs, loaded: &LoadedScene, printer: &Printer) -> Result<Vec<LodView>, CliError> {
    let most = args.frames as usize;
    if let Some(views) = args.views.photos()? {
        let photo = |view: &instgs_io::View| {
            let loaded = load_view(view, None)?;
            Ok(LodView { camera: loaded.camera, photo: Some(loaded.image) })
        };
        return views.iter().take(most).map(photo).collect();
    }
    let near = args.look.options(&loaded.scene).near;
    let cameras = args.views.cameras(&args.scene, &loaded.scene, near, printer)?;
    Ok(cameras.into_iter().take(most).map(|camera| LodView { camera, photo: None }).collect())
}

fn print_report(report: &LodReport, printer: &Printer) {
    let [width, height] = report.resolution;
    let cameras = report.rows[0].cameras.len();
    printer.line(format_args!("{} ({})", report.device, report.driver));
    printer.line(format_args!("{width}x{height}, {} frames from {cameras} cameras, each in turn", report.frames));
    printer.line(main_table(report));
    if cameras > 1 {
        printer.line("");
        printer.line(cameras_table(report));
    }
}

fn db(value: Option<f64>) -> String {
    value.map(|v| format!("{v:.2}")).unwrap_or_default()
}

fn name(row: &LodRow) -> String {
    if row.lod_px == 0.0 { "full".into() } else { format!("{} px", row.lod_px) }
}

fn main_table(report: &LodReport) -> Table {
    let mut table = Table::default();
    let mut row = |name: &str, cell: &dyn Fn(&LodRow) -> String| {
        table.row(std::iter::once(name.into()).chain(report.rows.iter().map(cell)).collect::<Vec<String>>());
    };
    row("error", &name);
    row("PSNR to full, dB", &|r| db(r.psnr_to_full));
    if report.rows[0].psnr.is_some() {
        row("PSNR to photos, dB", &|r| db(r.psnr));
        row("loss, dB", &|r| db(r.psnr_loss));
    }
    row("ms, median", &|r| format!("{:.2}", r.ms.median));
    row("frames per second", &|r| format!("{:.2}", r.fps));
    row("by full", &|r| format!("{:.2}x", r.fps_ratio));
    row("chunks, mean", &|r| grouped(r.chunks));
    row("visible, mean", &|r| grouped(r.visible));
    row("intersections, mean", &|r| grouped(r.intersections));
    row("device scene bytes", &|r| grouped(r.device_scene_bytes));
    table
}

/// One row per camera: milliseconds, splats, and the cost at every error.
fn cameras_table(report: &LodReport) -> Table {
    let mut table = Table::default();
    let mut header = vec!["camera".to_string()];
    for row in &report.rows {
        let name = name(row);
        header.extend([format!("{name}: ms"), "visible".into()]);
        if row.lod_px > 0.0 {
            header.extend(["to full".into(), "loss".into()]);
        }
    }
    table.row(header);
    for (k, camera) in report.rows[0].cameras.iter().enumerate() {
        let mut cells = vec![camera.name.clone()];
        for row in &report.rows {
            let own = &row.cameras[k];
            cells.extend([format!("{:.1}", own.ms), grouped(own.visible)]);
            if row.lod_px > 0.0 {
                let loss = camera.psnr.zip(own.psnr).map(|(full, own)| full - own);
                cells.extend([db(own.psnr_to_full), db(loss)]);
            }
        }
        table.row(cells);
    }
    table
}
