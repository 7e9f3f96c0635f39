//! Prints a measurement of frames as tables.

use std::path::Path;

use instgs_console::Printer;
use instgs_console::table::{Table, grouped};
use instgs_eval::bench::{Report, SceneReport};

/// Prints the report as tables.
pub fn print_report(report: &Report, printer: &Printer) {
    let scene = &report.scene;
    let [width, height] = scene.resolution;
    let cameras = scene.cameras.len();
    printer.line(format_args!("{} ({})", scene.device, scene.driver));
    printer.line(format_args!("{width}x{height}, {} frames from {cameras} cameras", scene.frames));
    printer.line(main_table(report));
    printer.line("");
    printer.line(passes_table(report));
    if cameras > 1 {
        printer.line("");
        printer.line(cameras_table(report));
    }
}

/// One row per figure: its name, the scene, and the other scene and the ratio if there is one.
fn main_table(report: &Report) -> Table {
    let mut table = Table::default();
    let mut row = |name: &str, cell: &dyn Fn(&SceneReport) -> String, ratio: Option<f64>| {
        let against = report.against.as_ref().map(cell).unwrap_or_default();
        let ratio = ratio.map(|r| format!("{r:.2}x")).unwrap_or_default();
        table.row([name.into(), cell(&report.scene), against, ratio]);
    };
    let ratio = report.ratio;
    let file_name =
        |s: &SceneReport| Path::new(&s.scene).file_name().map_or(s.scene.clone(), |n| n.to_string_lossy().into());
    row("", &file_name, None);
    row("numbers on the device", &|s| s.device_precision.name().into(), None);
    row("ms, median", &|s| format!("{:.2}", s.ms.median), None);
    row("ms, p10 - p90", &|s| format!("{:.2} - {:.2}", s.ms.p10, s.ms.p90), None);
    row("frames per second", &|s| format!("{:.2}", s.fps), ratio.map(|r| r.fps));
    row("file bytes", &|s| grouped(s.bytes.file), ratio.map(|r| r.file));
    row("host tensor bytes", &|s| grouped(s.bytes.host), ratio.map(|r| r.host));
    row("device scene bytes", &|s| grouped(s.bytes.device_scene), ratio.map(|r| r.device_scene));
    if [Some(&report.scene), report.against.as_ref()].into_iter().flatten().any(|s| s.bytes.scene_on_host > 0) {
        row("  of them in host memory", &|s| grouped(s.bytes.scene_on_host), None);
    }
    row("device peak bytes", &|s| grouped(s.bytes.device_peak), None);
    row("template Gaussians", &|s| grouped(s.gaussians.scene.template), None);
    row("offset records", &|s| grouped(s.gaussians.scene.offsets), None);
    row("instances' own Gaussians", &|s| grouped(s.gaussians.scene.own), None);
    row("background Gaussians", &|s| grouped(s.gaussians.scene.background), None);
    row("expanded Gaussians", &|s| grouped(s.gaussians.scene.expanded), None);
    row("  of them hidden by instances", &|s| grouped(s.gaussians.scene.hidden), None);
    row("visible, mean", &|s| grouped(s.gaussians.visible), None);
    row("intersections, mean", &|s| grouped(s.gaussians.intersections), None);
    row("slabs, most", &|s| s.slabs.to_string(), None);
    table
}

fn passes_table(report: &Report) -> Table {
    let mut table = Table::default();
    table.row(["pass, ms".into(), "scene".into(), report.against.as_ref().map_or("", |_| "against").into()]);
    let of = |scene: &SceneReport, pass: &str| {
        scene.passes_ms.iter().find(|(name, _)| *name == pass).map(|(_, ms)| format!("{ms:.2}")).unwrap_or_default()
    };
    for (pass, ms) in &report.scene.passes_ms {
        let against = report.against.as_ref().map(|scene| of(scene, pass)).unwrap_or_default();
        table.row([(*pass).into(), format!("{ms:.2}"), against]);
    }
    table
}

fn cameras_table(report: &Report) -> Table {
    let mut table = Table::default();
    let header = ["camera", "ms, median", "visible", "intersections", ""].map(String::from);
    table.row(header);
    for (i, camera) in report.scene.cameras.iter().enumerate() {
        let against = report.against.as_ref().map(|s| format!("against {:.2}", s.cameras[i].ms.median));
        table.row([
            camera.name.clone(),
            format!("{:.2}", camera.ms.median),
            grouped(camera.visible),
            grouped(camera.intersections),
            against.unwrap_or_default(),
        ]);
    }
    table
}
