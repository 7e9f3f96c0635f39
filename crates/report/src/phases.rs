//! The parts of the page about a run in two phases: a plain cloud, then templates and instances.

use super::chart::{Chart, Look, Series};
use super::curves::{Curves, Over};
use super::format::{bytes, count, duration, escape, fixed, signed};
use super::joint_match::{final_loss, is_measured};
use super::run_report::RunReport;
use super::table::table;
use super::training_clock::training_seconds;
use super::{RepeatedBytes, ReportData};
use instgs_objects::pipeline::is_preparation;
use instgs_objects::template::{GroupReport, POOR_MATCH};
use instgs_train::events::Event;
use instgs_train::facts::Metrics;

/// The steps of both phases; `joint` is the text for those of the joint phase.
pub(super) fn steps(vanilla: &RunReport, joint: &str) -> String {
    match vanilla.steps {
        0 => format!("from a given plain cloud, joint phase of {joint}"),
        steps => format!("plain cloud of {} steps, then joint phase of {joint}", count(steps)),
    }
}

/// Loss and PSNR of both phases over training time.
pub(super) fn charts(data: &ReportData) -> String {
    let vanilla_seconds = training_seconds(&data.vanilla_events);
    let begin = vanilla_seconds + between_seconds(&data.report);
    let plain = Curves::of(&data.vanilla_events, Over::Time(0.0));
    let joint = Curves::of(&data.events, Over::Time(begin));
    let test_psnr = [&plain.test_psnr[..], &joint.test_psnr[..]].concat();
    let series = |name, points, look| Series { name, points, look };
    let chart = |title, series, level, from_zero| {
        Chart { title, over: "training time, s", series, marks: (&[begin], "joint phase begins"), level, from_zero }
            .html()
    };
    let level = final_loss(&data.vanilla_events, data.report.dataset.train_views);
    [
        chart(
            "Loss over training time",
            vec![series("plain cloud", &plain.loss, Look::Noisy), series("joint", &joint.loss, Look::Noisy)],
            level.map(|loss| (loss, "the plain cloud's final loss")),
            true,
        ),
        chart(
            "PSNR over training time, dB",
            vec![
                series("plain cloud, training view", &plain.train_psnr, Look::Noisy),
                series("joint, training view", &joint.train_psnr, Look::Noisy),
                series("test views", &test_psnr, Look::Dots),
            ],
            None,
            false,
        ),
    ]
    .concat()
}

/// Seconds from the end of the plain cloud's training to the joint phase, without loading and evaluation.
fn between_seconds(report: &RunReport) -> f64 {
    report
        .stages
        .iter()
        .filter(|stage| is_preparation(stage))
        .map(|stage| stage.seconds)
        .filter(|s| s.is_finite())
        .sum()
}

/// Whether and when the joint phase reached the plain cloud's loss on the training views; empty without its log.
pub(super) fn verdict(data: &ReportData) -> String {
    let Some(loss) = final_loss(&data.vanilla_events, data.report.dataset.train_views) else { return String::new() };
    let loss = fixed(loss, 4);
    let text = match &data.report.joint_match {
        Some(found) => format!(
            "The joint phase reached the plain cloud's final loss ({loss}) after {} s ({} % of the plain cloud's training \
             time); from masks to templates took {} s before it.",
            fixed(found.seconds, 1),
            fixed(100.0 * found.fraction_of_vanilla, 1),
            fixed(between_seconds(&data.report), 1)
        ),
        None if is_measured(&data.vanilla_events, &data.events) => {
            format!("The joint phase did not reach the plain cloud's final loss ({loss}).")
        }
        None => format!(
            "Whether the joint phase reached the plain cloud's final loss ({loss}) was not measured: too few of its steps are in \
             the log."
        ),
    };
    let how = "Losses are compared with those of the plain cloud's last look at the same views, over 30 steps.";
    format!("<p>{text} <span class=\"soft\">{how}</span></p>\n")
}

/// The instanced scene compared with the cloud it was made from.
pub(super) fn beside(data: &ReportData) -> String {
    let report = &data.report;
    let Some(plain) = report.vanilla.as_deref() else { return String::new() };
    let mut rows = qualities(plain.eval.as_ref(), report.eval.as_ref());
    let mut sizes = |name: &str, plain: u64, instanced: u64, show: fn(u64) -> String| {
        let shown = |v: u64| if v > 0 { show(v) } else { "–".into() };
        rows.push(vec![name.into(), shown(plain), shown(instanced), ratio(plain as f64, instanced as f64)]);
    };
    let (g, b) = ([&plain.gaussians, &report.gaussians], [&plain.bytes, &report.bytes]);
    sizes("file", b[0].file, b[1].file, bytes);
    sizes("scene on the host, f32", b[0].host, b[1].host, bytes);
    sizes("scene on the device", b[0].device_scene, b[1].device_scene, bytes);
    sizes("device memory, peak", b[0].device_peak, b[1].device_peak, bytes);
    sizes("Gaussians stored", g[0].stored(), g[1].stored(), count);
    sizes("of them in templates", g[0].template, g[1].template, count);
    sizes("of them instances' own", g[0].own, g[1].own, count);
    sizes("of them in the background", g[0].background, g[1].background, count);
    sizes("offset records", g[0].offsets, g[1].offsets, count);
    sizes("Gaussians expanded", g[0].expanded, g[1].expanded, count);
    sizes("of them hidden by instances", g[0].hidden, g[1].hidden, count);
    let mut times = |name: &str, plain: f64, instanced: f64| {
        let shown = [plain, instanced].map(duration);
        rows.push([vec![name.into()], shown.into(), vec![ratio(plain, instanced)]].concat());
    };
    let trained = |events: &[Event]| if events.is_empty() { f64::NAN } else { training_seconds(events) };
    times("training, each phase", trained(&data.vanilla_events), trained(&data.events));
    times("all stages until then", plain.seconds, report.seconds);
    table(&["", "plain cloud", "instanced", "instanced against plain"], &rows, None)
}

/// Table rows of quality, with differences.
fn qualities(plain: Option<&Metrics>, instanced: Option<&Metrics>) -> Vec<Vec<String>> {
    let row = |name: &str, of: fn(&Metrics) -> f64, decimals: usize, unit: &str| {
        let [plain, instanced] = [plain, instanced].map(|quality| quality.map_or(f64::NAN, of));
        let difference = signed(instanced - plain, decimals);
        let shown = [fixed(plain, decimals), fixed(instanced, decimals), difference].map(|v| format!("{v}{unit}"));
        [vec![name.to_owned()], shown.into()].concat()
    };
    let mut rows = vec![
        row("PSNR, test views", |quality| quality.psnr, 2, " dB"),
        row("SSIM", |quality| quality.ssim, 4, ""),
        row("LPIPS", |quality| quality.lpips.unwrap_or(f64::NAN), 4, ""),
    ];
    // Without test views or network weights there are no numbers.
    rows.retain(|row| row[1..3].iter().any(|cell| !cell.starts_with('–')));
    rows
}

/// The ratio of two values; a dash if it has no meaning.
fn ratio(plain: f64, instanced: f64) -> String {
    if plain > 0.0 && instanced > 0.0 { format!("× {}", fixed(instanced / plain, 3)) } else { "–".into() }
}

/// The groups after merging, and the bytes that instancing saves.
pub(super) fn groups(report: &RunReport) -> String {
    let rows: Vec<_> = report.groups.iter().map(group).collect();
    let names =
        ["group", "instances", "usable", "Gaussians each: fewest", "mean", "most", "template", "match distance"];
    let notes: String = report.groups.iter().flat_map(notes).map(|note| format!("<p>{note}</p>\n")).collect();
    [table(&names, &rows, None), notes, report.repeated.as_ref().map_or(String::new(), repeated)].concat()
}

fn name(group: &GroupReport) -> String {
    group.name.as_deref().map_or_else(|| format!("group {}", group.template_id), escape)
}

fn group(group: &GroupReport) -> Vec<String> {
    let usable = group.instances.iter().filter(|instance| instance.is_usable).count();
    let (fewest, mean, most) = group.gaussians_per_instance;
    let whole = |v: usize| count(v as u64);
    let distance = fixed(group.match_distance, 3);
    vec![
        name(group),
        whole(group.instances.len()),
        whole(usable),
        whole(fewest),
        fixed(mean, 1),
        whole(most),
        whole(group.template_gaussians),
        if group.is_poor_match() { warning(&format!("poor: {distance}")) } else { distance },
    ]
}

/// Remarks on a group that the table has no column for.
fn notes(group: &GroupReport) -> Vec<String> {
    let name = name(group);
    if let Some(why) = group.left_out() {
        return vec![warning(&format!("{name}: {why}"))];
    }
    let mut out = Vec::new();
    if group.is_poor_match() {
        let good = fixed(POOR_MATCH, 2);
        out.push(warning(&format!("{name}: not alike, or posed wrongly (good is below {good}): expect ghosts")));
    }
    if group.is_single() {
        out.push(format!("{name}: only one object is usable; sharing gains nothing"));
    }
    let as_template = group.instances.iter().filter(|instance| !instance.is_usable);
    out.extend(as_template.map(|instance| {
        let own = count(instance.gaussians as u64);
        format!("{name}: object {} has only {own} Gaussians; it is shown as the template", instance.id)
    }));
    out
}

fn warning(text: &str) -> String {
    format!("<span class=\"warn\">{text}</span>")
}

fn repeated(repeated: &RepeatedBytes) -> String {
    let row = |name: &str, size: u64| vec![name.into(), bytes(size), ratio(repeated.ply as f64, size as f64)];
    let rows = [
        row("separate copies as .ply", repeated.ply),
        row("templates, offsets, instances with --pack f32", repeated.f32),
        row("the same with --pack f16", repeated.f16),
        row("the same with --pack q8", repeated.q8),
    ];
    table(&["the repeated part, counted", "bytes", "against .ply"], &rows, None)
}
