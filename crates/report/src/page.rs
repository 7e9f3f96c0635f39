//! The page, section by section. It is also well-formed XML, which the tests check.

use std::path::Path;

use super::chart::{Chart, Look, Series};
use super::curves::{Curves, Over};
use super::format::{bytes, count, duration, escape, fixed};
use super::phases;
use super::pictures::{DIFFERENCE_GAIN, exact_address};
use super::run_report::RunReport;
use super::stages as of_stages;
use super::table::{bar, table};
use super::{PictureError, ReportData, SceneView, ViewPicture};
use instgs_io::{IoError, Place};
use instgs_train::config::Method;
use instgs_train::facts::Metrics;

pub(super) fn page(data: &ReportData, path: &Path) -> Result<String, IoError> {
    let report = &data.report;
    let title = format!("{} · {}", report.method, report.dataset.path);
    let mut out = head_of(&title);
    out += &head(report);
    out += &tiles(report);
    out += &section("Warnings", &warnings(report));
    out += &section("The scene", &data.scene.as_ref().map(SceneView::html).unwrap_or_default());
    out += &section("Curves", &charts(data));
    out += &section("Beside the plain cloud", &phases::beside(data));
    out += &section("Groups", &phases::groups(report));
    let fail = |error: PictureError| IoError::new(path, error.to_string());
    let drawn = &data.stages;
    out += &section("Masks, objects and labels", &of_stages::segmentation(drawn).map_err(fail)?);
    out += &section("Registered poses", &of_stages::poses(drawn, report).map_err(fail)?);
    out += &section("Templates", &of_stages::templates(drawn).map_err(fail)?);
    out += &section("Pictures", &views(&data.pictures, path)?);
    out += &section("Test views", &view_table(report));
    out += &section("Instances", &registration(report));
    out += &section("Time", &stages(report));
    out += &section("A step, pass by pass", &passes(report));
    out += &section("Device memory", &memory(report));
    let config = report.config.to_toml().unwrap_or_default();
    let config =
        format!("<details><summary>Resolved configuration</summary><pre>{}</pre></details>\n", escape(&config));
    out += &section("Configuration", &config);
    if !data.pictures.is_empty() {
        out += &format!("<script>\n{}</script>\n", include_str!("compare.js"));
    }
    Ok(out + "</body>\n</html>\n")
}

/// The head of the page, from the first line to the start of the body.
pub(super) fn head_of(title: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n",
        escape(title),
        include_str!("page.css")
    )
}

/// A section with its heading; empty if the body is empty.
pub(super) fn section(title: &str, body: &str) -> String {
    if body.is_empty() { String::new() } else { format!("<section>\n<h2>{title}</h2>\n{body}</section>\n") }
}

fn head(report: &RunReport) -> String {
    let data = &report.dataset;
    let all = match report.config.train.method {
        Method::Gaussians => report.config.train.steps,
        Method::Instanced => report.config.train.joint.steps,
    };
    let planned = if report.steps < all { format!(" of {} (stopped early)", count(all)) } else { String::new() };
    let steps = format!("{} steps{planned}", count(report.steps));
    format!(
        "<h1>{}</h1>\n<p class=\"soft\">{}: {} training views, {} test views, {} × {} px · {} · seed {} · {} · \
         instgs-vk {}</p>\n",
        escape(&report.method),
        escape(&data.path),
        count(data.train_views),
        count(data.test_views),
        data.width,
        data.height,
        report.vanilla.as_deref().map_or(steps.clone(), |vanilla| phases::steps(vanilla, &steps)),
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
    let two_phases = report.vanilla.is_some();
    if two_phases {
        all.push(("Gaussians stored", count(report.gaussians.stored())));
    }
    all.push((if two_phases { "Gaussians expanded" } else { "Gaussians" }, count(report.gaussians.expanded)));
    all.push((if two_phases { "wall time, both phases" } else { "wall time" }, duration(report.seconds)));
    let speed = if two_phases { "steps per second, joint phase" } else { "steps per second" };
    // A finished run that is resumed takes no step.
    if report.steps_per_second > 0.0 {
        all.push((speed, fixed(report.steps_per_second, 2)));
    }
    all.extend(report.joint_match.map(|m| ("until the plain cloud's loss", duration(m.seconds))));
    all.push(("file", bytes(report.bytes.file)));
    all.push(("device memory, peak", bytes(report.bytes.device_peak)));
    let tiles =
        all.iter().map(|(name, value)| format!("<div class=\"tile\"><b>{value}</b><span>{name}</span></div>\n"));
    format!("<div class=\"tiles\">\n{}</div>\n", tiles.collect::<String>())
}

fn warnings(report: &RunReport) -> String {
    let line = |text: &String| format!("<p class=\"warn\">{}</p>\n", escape(text));
    report.warnings.iter().map(line).collect()
}

fn charts(data: &ReportData) -> String {
    let curves = Curves::of(&data.events, Over::Steps);
    let marks = (&curves.resets[..], "opacity reset");
    let series = |name, points, look| Series { name, points, look };
    let chart = |title, series, from_zero| Chart { title, over: "step", series, marks, level: None, from_zero }.html();
    let quality = match data.vanilla_events.is_empty() {
        true => [
            chart("Loss", vec![series("training views", &curves.loss, Look::Noisy)], true),
            chart(
                "PSNR, dB",
                vec![
                    series("training view", &curves.train_psnr, Look::Noisy),
                    series("test views", &curves.test_psnr, Look::Dots),
                ],
                false,
            ),
        ]
        .concat(),
        false => phases::charts(data),
    };
    let [gaussians, speed] = match data.report.vanilla {
        None => ["Gaussians", "Steps per second"],
        Some(_) => ["Gaussians stored, joint phase", "Steps per second, joint phase"],
    };
    let all = [
        quality,
        chart(gaussians, vec![series("in the scene", &curves.gaussians, Look::Line)], true),
        chart(speed, vec![series("wall time", &curves.steps_per_second, Look::Noisy)], true),
    ]
    .concat();
    if all.is_empty() { all } else { format!("<div class=\"charts\">\n{all}</div>\n{}", phases::verdict(data)) }
}

fn views(all: &[ViewPicture], path: &Path) -> Result<String, IoError> {
    let captions = ["photograph".to_owned(), "rendering".into(), format!("difference × {DIFFERENCE_GAIN}")];
    let mut out = String::new();
    for view in all {
        let place = || Place::Field(format!("picture {}", view.name));
        let fail = |error: PictureError| IoError::new(path, error.to_string()).at(place());
        let pictures = [&view.ground_truth, &view.render, &view.difference];
        let name = escape(&view.name);
        out += &format!(
            "<div class=\"view\"><h3>{name}<span>{}</span></h3>\n<div class=\"trio\" data-view=\"{name}\">\n",
            words(&view.metrics)
        );
        let [width, height] = view.size;
        for (caption, picture) in captions.iter().zip(pictures) {
            let address = exact_address(picture).map_err(fail)?;
            out += &format!(
                "<figure><img src=\"{address}\" width=\"{width}\" height=\"{height}\" alt=\"{name}: {caption}\"/>\
                 <figcaption>{caption}</figcaption></figure>\n"
            );
        }
        out += "</div></div>\n";
    }
    Ok(out)
}

fn words(quality: &Metrics) -> String {
    let lpips = quality.lpips.map(|v| format!(" · LPIPS {}", fixed(v, 4))).unwrap_or_default();
    let exposed = quality.psnr_exposed.map(|v| format!(" ({} with the photos' exposures)", fixed(v, 2)));
    let exposed = exposed.unwrap_or_default();
    format!("{} dB{exposed} · SSIM {}{lpips}", fixed(quality.psnr, 2), fixed(quality.ssim, 4))
}

fn view_table(report: &RunReport) -> String {
    let all = report.views.iter().map(|view| &view.metrics).chain(&report.eval);
    let exposed = all.into_iter().any(|quality| quality.psnr_exposed.is_some());
    let of = |value: Option<f64>, decimals| value.map_or("–".into(), |v| fixed(v, decimals));
    let cells = |name: &str, q: &Metrics| -> Vec<String> {
        let measured = [escape(name), fixed(q.psnr, 2), fixed(q.ssim, 4), of(q.lpips, 4)];
        measured.into_iter().chain(exposed.then(|| of(q.psnr_exposed, 2))).collect()
    };
    let rows: Vec<_> = report.views.iter().map(|view| cells(&view.name, &view.metrics)).collect();
    let mean = report.eval.as_ref().map(|quality| cells("mean", quality));
    let names = ["view", "PSNR, dB", "SSIM", "LPIPS"].into_iter().chain(exposed.then_some("PSNR with exposures, dB"));
    table(&names.collect::<Vec<_>>(), &rows, mean)
}

fn registration(report: &RunReport) -> String {
    let rows: Vec<_> = (report.registration.iter())
        .map(|r| {
            let group = r.group.map_or("–".into(), |group| group.to_string());
            let photometric = r.photometric.map_or("–".into(), |error| fixed(error, 4));
            let accepted = if r.accepted { "yes" } else { "no" };
            let name = escape(r.name.as_deref().unwrap_or("–"));
            let figures = [fixed(r.inliers, 3), fixed(r.rmse, 4), photometric, accepted.into(), escape(&r.note)];
            [vec![r.instance.to_string(), name, group], figures.into()].concat()
        })
        .collect();
    table(&["instance", "name", "group", "inliers", "RMSE", "photometric", "accepted", "why"], &rows, None)
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
