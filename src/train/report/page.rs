//! The page, section by section. Written so that it is also well-formed XML, which the tests check.

use std::path::Path;

use super::chart::{Chart, Look, Series};
use super::curves::Curves;
use super::format::{bytes, count, duration, escape, fixed};
use super::pictures::{self, DIFFERENCE_GAIN};
use super::run_report::{Quality, RunReport};
use super::{ReportData, ViewPicture};
use crate::io::{IoError, Place};

pub(super) fn page(data: &ReportData, path: &Path) -> Result<String, IoError> {
    let report = &data.report;
    let title = format!("{} · {}", report.method, report.dataset.path);
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n",
        escape(&title),
        include_str!("page.css")
    );
    out += &head(report);
    out += &tiles(report);
    out += &section("Curves", &charts(data));
    out += &section("Pictures", &views(&data.pictures, path)?);
    out += &section("Test views", &view_table(report));
    out += &section("Gaussians and sizes", &sizes(report));
    out += &section("Instances", &registration(report));
    out += &section("Time", &stages(report));
    out += &section("A step, pass by pass", &passes(report));
    out += &section("Device memory", &memory(report));
    let config = report.config.to_toml().unwrap_or_default();
    let config =
        format!("<details><summary>Resolved configuration</summary><pre>{}</pre></details>\n", escape(&config));
    out += &section("Configuration", &config);
    Ok(out + "</body>\n</html>\n")
}

/// Nothing for an empty body.
fn section(title: &str, body: &str) -> String {
    if body.is_empty() { String::new() } else { format!("<section>\n<h2>{title}</h2>\n{body}</section>\n") }
}

fn head(report: &RunReport) -> String {
    let data = &report.dataset;
    let planned = match report.steps < report.config.steps {
        true => format!(" of {} (stopped early)", count(report.config.steps)),
        false => String::new(),
    };
    format!(
        "<h1>{}</h1>\n<p class=\"soft\">{}: {} training views, {} test views, {} × {} px · {} steps{planned} · seed {} · {} · \
         instgs-vk {}</p>\n",
        escape(&report.method),
        escape(&data.path),
        count(data.train_views),
        count(data.test_views),
        data.width,
        data.height,
        count(report.steps),
        report.seed,
        escape(&report.device),
        escape(&report.version)
    )
}

fn tiles(report: &RunReport) -> String {
    let mut all = Vec::new();
    if let Some(quality) = &report.eval {
        all.push(("PSNR, test views", format!("{} dB", fixed(quality.psnr, 2))));
        all.push(("SSIM", fixed(quality.ssim, 4)));
        all.extend(quality.lpips.map(|lpips| ("LPIPS", fixed(lpips, 4))));
    }
    all.push(("Gaussians", count(report.gaussians.expanded)));
    all.push(("wall time", duration(report.seconds)));
    all.push(("steps per second", fixed(report.steps_per_second, 2)));
    all.push(("file", bytes(report.bytes.file)));
    all.push(("device memory, peak", bytes(report.bytes.device_peak)));
    let tiles =
        all.iter().map(|(name, value)| format!("<div class=\"tile\"><b>{value}</b><span>{name}</span></div>\n"));
    format!("<div class=\"tiles\">\n{}</div>\n", tiles.collect::<String>())
}

fn charts(data: &ReportData) -> String {
    let curves = Curves::of(&data.events);
    let marks = (&curves.resets[..], "opacity reset");
    let series = |name, points, look| Series { name, points, look };
    let chart = |title, series, from_zero| Chart { title, series, marks, from_zero }.html();
    let all = [
        chart("Loss", vec![series("training view", &curves.loss, Look::Noisy)], true),
        chart(
            "PSNR, dB",
            vec![
                series("training view", &curves.train_psnr, Look::Noisy),
                series("test views", &curves.test_psnr, Look::Dots),
            ],
            false,
        ),
        chart("Gaussians", vec![series("in the scene", &curves.gaussians, Look::Line)], true),
        chart("Steps per second", vec![series("wall time", &curves.steps_per_second, Look::Noisy)], true),
    ]
    .concat();
    if all.is_empty() { all } else { format!("<div class=\"charts\">\n{all}</div>\n") }
}

fn views(all: &[ViewPicture], path: &Path) -> Result<String, IoError> {
    let captions = ["photograph".to_owned(), "rendering".into(), format!("difference × {DIFFERENCE_GAIN}")];
    let mut out = String::new();
    for view in all {
        let fail = |what: String| IoError::new(path, what).at(Place::Field(format!("picture {}", view.name)));
        let addresses = pictures::addresses(&view.ground_truth, &view.render).map_err(fail)?;
        let name = escape(&view.name);
        out += &format!(
            "<div class=\"view\"><h3>{name}<span>{}</span></h3>\n<div class=\"trio\">\n",
            words(&view.metrics)
        );
        for (caption, address) in captions.iter().zip(&addresses) {
            out += &format!(
                "<figure><img src=\"{address}\" alt=\"{name}: {caption}\"/><figcaption>{caption}</figcaption></figure>\n"
            );
        }
        out += "</div></div>\n";
    }
    Ok(out)
}

fn words(quality: &Quality) -> String {
    let lpips = quality.lpips.map(|v| format!(" · LPIPS {}", fixed(v, 4))).unwrap_or_default();
    format!("{} dB · SSIM {}{lpips}", fixed(quality.psnr, 2), fixed(quality.ssim, 4))
}

fn view_table(report: &RunReport) -> String {
    let cells = |name: &str, q: &Quality| {
        vec![escape(name), fixed(q.psnr, 2), fixed(q.ssim, 4), q.lpips.map_or("–".into(), |v| fixed(v, 4))]
    };
    let rows: Vec<_> = report.views.iter().map(|view| cells(&view.name, &view.quality)).collect();
    let mean = report.eval.as_ref().map(|quality| cells("mean", quality));
    table(&["view", "PSNR, dB", "SSIM", "LPIPS"], &rows, mean)
}

/// Only where instances make it worth a table; the tiles have it otherwise.
fn sizes(report: &RunReport) -> String {
    if report.vanilla.is_none() && report.gaussians.template == 0 {
        return String::new();
    }
    let row = |name: &str, r: &RunReport| {
        let (g, b) = (&r.gaussians, &r.bytes);
        let counts = [g.template, g.offsets, g.background, g.expanded].map(count);
        let sizes = [b.file, b.host, b.device_scene, b.device_peak].map(bytes);
        let psnr = r.eval.as_ref().map_or("–".into(), |q| fixed(q.psnr, 2));
        [vec![escape(name)], counts.into(), sizes.into(), vec![psnr]].concat()
    };
    let mut rows = vec![row("this scene", report)];
    rows.extend(report.vanilla.as_deref().map(|vanilla| row("vanilla, where it started", vanilla)));
    let names = ["", "template", "offsets", "background", "expanded", "file", "host", "on device", "peak", "PSNR, dB"];
    table(&names, &rows, None)
}

fn registration(report: &RunReport) -> String {
    let rows: Vec<_> = (report.registration.iter())
        .map(|r| {
            let accepted = if r.accepted { "yes" } else { "no" };
            let figures = [fixed(r.inliers, 3), fixed(r.rmse, 4), fixed(r.photometric, 4), accepted.into()];
            [vec![r.instance.to_string(), r.group.to_string()], figures.into()].concat()
        })
        .collect();
    table(&["instance", "group", "inliers", "RMSE", "photometric", "accepted"], &rows, None)
}

fn stages(report: &RunReport) -> String {
    let rows: Vec<_> = report.stages.iter().map(|s| vec![escape(&s.name), duration(s.seconds)]).collect();
    let host =
        format!("<p class=\"soft\">Of a step, the host works {} %.</p>\n", fixed(100.0 * report.host_fraction, 1));
    let table = table(&["stage", "time"], &rows, Some(vec!["all".into(), duration(report.seconds)]));
    if table.is_empty() { table } else { table + &host }
}

fn passes(report: &RunReport) -> String {
    let total: f64 = report.passes_ms.iter().map(|(_, ms)| ms).sum();
    let longest = report.passes_ms.iter().map(|(_, ms)| *ms).fold(0.0, f64::max);
    let share = |ms: f64| if total > 0.0 { 100.0 * ms / total } else { 0.0 };
    let rows: Vec<_> = (report.passes_ms.iter())
        .map(|(name, ms)| vec![escape(name), fixed(*ms, 3), fixed(share(*ms), 1), bar(*ms, longest)])
        .collect();
    table(
        &["pass", "ms", "%", ""],
        &rows,
        Some(vec!["all".into(), fixed(total, 3), fixed(share(total), 1), String::new()]),
    )
}

fn memory(report: &RunReport) -> String {
    let all = &report.memory_explained;
    let largest = all.iter().map(|m| m.bytes).max().unwrap_or(0) as f64;
    let rows: Vec<_> = (all.iter())
        .map(|m| {
            let each = format!("{} B", fixed(m.bytes_each, if m.bytes_each.fract() == 0.0 { 0 } else { 1 }));
            let name = escape(&m.name);
            vec![name, bytes(m.bytes), each, escape(&m.per), count(m.count), bar(m.bytes as f64, largest)]
        })
        .collect();
    let sum = bytes(all.iter().map(|m| m.bytes).sum());
    let sum = [vec!["all".into(), sum], vec![String::new(); 4]].concat();
    table(&["use", "bytes", "each", "per", "count", ""], &rows, Some(sum))
}

/// Marks a cell that [`table`] draws as a bar.
const BAR: &str = "<i ";

fn bar(value: f64, largest: f64) -> String {
    let part = if largest > 0.0 { (100.0 * value / largest).clamp(0.0, 100.0) } else { 0.0 };
    format!("{BAR}style=\"width:{part:.1}%\"></i>")
}

/// Cells are HTML. Nothing if there are no rows.
fn table(names: &[&str], rows: &[Vec<String>], sum: Option<Vec<String>>) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let cell = |text: &String| {
        let class = if text.starts_with(BAR) { " class=\"bar\"" } else { "" };
        format!("<td{class}>{text}</td>")
    };
    let row =
        |class: &str, cells: &[String]| format!("<tr{class}>{}</tr>\n", cells.iter().map(cell).collect::<String>());
    let names: String = names.iter().map(|name| format!("<th>{name}</th>")).collect();
    let body: String = rows.iter().map(|cells| row("", cells)).collect();
    let sum = sum.map(|cells| row(" class=\"sum\"", &cells)).unwrap_or_default();
    format!(
        "<div class=\"wide\"><table>\n<thead><tr>{names}</tr></thead>\n<tbody>\n{body}{sum}</tbody></table></div>\n"
    )
}
