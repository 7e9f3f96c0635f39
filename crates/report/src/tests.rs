//! Tests of `report.json` by its names, and of the page by its structure, with synthetic data.

use std::f64::consts::TAU;

use super::*;
use instgs_objects::template::{GroupReport, InstanceReport};
use instgs_train::config::Method;
use instgs_train::facts::{Bytes, Counts, DatasetFacts, MemoryUse, StageTime, TrainFacts, ViewMetrics};
use instgs_vk::math::rng::Rng;

fn quality(psnr: f64) -> Metrics {
    Metrics { psnr, ssim: 0.5 + psnr / 80.0, lpips: Some(0.5 - psnr / 80.0), psnr_exposed: None }
}

/// A synthetic photo of coloured waves, and a rendering with noise of the given strength.
fn picture(name: &str, noise: f64) -> ViewPicture {
    let (width, height) = (540, 360);
    let mut rng = Rng::new(5);
    let (mut truth, mut render) = (Vec::new(), Vec::new());
    for i in 0..width * height {
        let (x, y) = (f64::from(i % width) / f64::from(width), f64::from(i / width) / f64::from(height));
        for c in 0..3u32 {
            let wave = 0.5 + 0.4 * (TAU * (x * f64::from(c + 1) + y * y * 2.0)).sin();
            truth.push((255.0 * wave) as u8);
            render.push((255.0 * (wave + noise * x * rng.normal()).clamp(0.0, 1.0)) as u8);
        }
    }
    let [truth, render] = [truth, render].map(|pixels| Rgb8 { width, height, pixels });
    ViewPicture::new(name, quality(24.0), &truth, &render).expect("two pictures of one size")
}

/// Views and losses of the ten steps before a report, all with this loss.
fn view_losses(step: u64, loss: Option<f64>) -> Vec<(u32, f32)> {
    (step - 10..step).map(|s| ((s % 43) as u32, loss.unwrap_or_default() as f32)).collect()
}

fn events(steps: u64) -> Vec<Event> {
    let (mut rng, mut gaussians) = (Rng::new(1), 40_000);
    let mut events = Vec::new();
    for step in (10..=steps).step_by(10) {
        let t = step as f64 / steps as f64;
        let dip = if (3000..3600).contains(&step) { 4.0 } else { 0.0 };
        let psnr = 12.0 + 13.0 * (1.0 - (-5.0 * t).exp()) - dip + rng.normal();
        let mean_loss = Some(0.25 * (-4.0 * t).exp() + 0.01);
        let view_losses = view_losses(step, mean_loss);
        let (loss, l1) = (0.25 * (-4.0 * t).exp() + 0.02 * rng.uniform(), 0.05);
        let (ssim, steps_per_second, seconds) = (0.8, 9.0 - 3.0 * t + 0.2 * rng.normal(), step as f64 / 8.0);
        events.push(Event::Step {
            step,
            loss,
            mean_loss,
            view_losses,
            l1,
            ssim,
            psnr,
            gaussians,
            steps_per_second,
            seconds,
        });
        if step % 100 == 0 && step > 500 && step < 5000 {
            gaussians += 1500;
            let (cloned, split, pruned, own, relocated) = (1000, 600, 700, 0, 0);
            events.push(Event::Densified { step, cloned, split, pruned, own, relocated, gaussians });
        }
        if step == 3000 {
            events.push(Event::OpacityReset { step, to: 0.01 });
        }
        if step % 1000 == 0 {
            let psnr = 11.0 + 12.0 * (1.0 - (-5.0 * t).exp());
            events.push(Event::Evaluated { step, views: 3, psnr, ssim: 0.8, lpips: None });
        }
    }
    events
}

fn sample() -> ReportData {
    let memory = |name: &str, bytes, per: &str, count| MemoryUse {
        name: name.into(),
        bytes,
        per: per.into(),
        count,
        bytes_each: bytes as f64 / count as f64,
    };
    let passes =
        [("preprocess", 4.1), ("radix_sort_scatter", 2.2), ("tile_blend", 31.0), ("tile_blend_backward", 62.4)];
    let report = RunReport {
        method: "3dgs".into(),
        steps: 7000,
        seconds: 905.2,
        steps_per_second: 8.1,
        stages: [("load", 2.1), ("train", 890.0), ("eval", 13.1)]
            .map(|(n, seconds)| StageTime { name: n.into(), seconds })
            .into(),
        passes_ms: passes.map(|(name, ms)| (name.into(), ms)).into(),
        eval: Some(quality(23.8)),
        gaussians: Counts { background: 106_000, expanded: 106_000, ..Counts::default() },
        bytes: Bytes {
            file: 25_016_000,
            host: 25_016_000,
            device_scene: 26_000_000,
            scene_on_host: 0,
            device_peak: 912_000_000,
        },
        device: "llvmpipe <LLVM 15>".into(),
        version: "0.1.0".into(),
        host_fraction: 0.021,
        memory_explained: vec![
            memory("parameters, gradients, Adam", 400_000_000, "Gaussian", 424_000),
            memory("intersections", 384_000_000, "intersection", 16_000_000),
            memory("training pictures", 97_200_000, "pixel", 32_400_000),
        ],
        views: vec![
            ViewMetrics { name: "a.png".into(), metrics: quality(22.1) },
            ViewMetrics { name: "<b>&\"c\".png".into(), metrics: Metrics { lpips: None, ..quality(25.5) } },
        ],
        dataset: DatasetFacts {
            path: "data/fox & co".into(),
            train_views: 43,
            test_views: 7,
            width: 270,
            height: 480,
            ..DatasetFacts::default()
        },
        ..RunReport::default()
    };
    let pictures = vec![picture("a.png", 0.05), picture("<b>&\"c\".png", 0.2)];
    ReportData { report, events: events(7000), pictures, ..ReportData::default() }
}

/// Checks that every tag is closed in order and returns the names of all that were opened.
pub(super) fn tags(html: &str) -> Vec<String> {
    let body = html.strip_prefix("<!DOCTYPE html>\n").expect("a doctype");
    let (mut open, mut all) = (Vec::new(), Vec::new());
    for piece in body.split('<').skip(1) {
        let (tag, text) = piece.split_once('>').expect("a > for each <");
        let name = tag.split([' ', '/']).next().unwrap_or_default();
        assert!(!text.contains('>') || matches!(name, "style" | "script"), "a stray > in {text}");
        assert!(tag.matches('"').count().is_multiple_of(2), "quotes of <{tag}>");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "</{name}>");
            continue;
        }
        all.push(name.to_owned());
        if !tag.ends_with('/') {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?} stay open");
    all
}

#[test]
fn the_page_is_well_formed_self_contained_and_whole() {
    let html = html(&sample(), Path::new("report.html")).unwrap();
    let tags = tags(&html);
    let count = |name: &str| tags.iter().filter(|t| *t == name).count();
    assert_eq!((count("svg"), count("img"), count("table")), (4, 6, 4));
    assert_eq!((count("script"), count("link"), count("iframe")), (1, 0, 0));
    // The page loads nothing: no addresses except data, no imports.
    assert_eq!(html.matches("src=\"").count(), html.matches("src=\"data:image/png;base64,").count());
    // What is written, without the pictures: their characters may come in any order.
    let words: Vec<&str> =
        html.split("base64,").map(|part| part.split_once("\" alt").map_or(part, |(_, text)| text)).collect();
    for elsewhere in ["http", "url(", "@import"] {
        assert!(words.iter().all(|text| !text.contains(elsewhere)), "{elsewhere}");
    }
    assert!(html.contains("&lt;b&gt;&amp;&quot;c&quot;.png") && !html.contains("<b>&"));
    assert!(html.contains("prefers-color-scheme: dark"));
    for want in ["23.80 dB", "106\u{202F}000", "15 min 05 s", "tile_blend_backward", "opacity reset", "steps = 30000"] {
        assert!(html.contains(want), "{want}");
    }
    assert!(words.into_iter().all(|text| !text.contains("NaN") && !text.contains("inf")), "a number that is none");
}

/// Each test view's pictures are in the page without scripts too; the script finds them by their view.
#[test]
fn photo_and_rendering_are_two_pictures_with_names() {
    let html = html(&sample(), Path::new("report.html")).unwrap();
    let name = "&lt;b&gt;&amp;&quot;c&quot;.png";
    let (_, view) = html.split_once(&format!("<div class=\"trio\" data-view=\"{name}\">")).expect("the view");
    for caption in ["photograph", "rendering"] {
        let alt = format!("width=\"540\" height=\"360\" alt=\"{name}: {caption}\"/>");
        assert!(view.contains(&alt), "{alt}");
    }
    let script = include_str!("compare.js");
    assert!(script.contains(".trio[data-view]") && !script.contains(['<', '&']), "no well-formed XML");
}

#[test]
fn the_scene_is_a_frame_before_the_curves() {
    let page = "<!DOCTYPE html>\n<p title=\"a\">\"1 < 2\" && it's</p>";
    let data = ReportData { scene: Some(SceneView::Page(page.into())), ..sample() };
    let html = html(&data, Path::new("report.html")).unwrap();
    assert_eq!(tags(&html).iter().filter(|tag| *tag == "iframe").count(), 1);
    let held = "srcdoc=\"&lt;!DOCTYPE html&gt;\n&lt;p title=&quot;a&quot;&gt;&quot;1 &lt; 2&quot; &amp;&amp; it&#39;s&lt;/p&gt;\">";
    assert!(html.find(held).expect("the page within") < html.find("<h2>Curves</h2>").expect("curves"));
}

#[test]
fn a_report_of_nothing_is_a_page_too() {
    let html = html(&ReportData::default(), Path::new("report.html")).unwrap();
    let tags = tags(&html);
    assert!(
        !tags.contains(&"script".to_owned())
            && !tags.contains(&"svg".to_owned())
            && !tags.contains(&"table".to_owned()),
        "{tags:?}"
    );
}

fn group(name: Option<&str>, match_distance: f64) -> GroupReport {
    let instance = |id, gaussians, is_usable| InstanceReport {
        id,
        gaussians,
        non_finite: 0,
        is_usable,
        lacking: 3,
        own: 0,
        match_distance: is_usable.then_some(match_distance),
    };
    GroupReport {
        template_id: 4,
        name: name.map(str::to_owned),
        template: Some(0),
        instances: vec![instance(11, 3200, true), instance(12, 1100, true), instance(13, 17, false)],
        gaussians_per_instance: (1100, 2150.0, 3200),
        template_gaussians: 3111,
        match_distance,
    }
}

/// A run in two phases. The joint phase begins far above the plain cloud's final loss, about 0.0147, and falls below it
/// after about half of its steps.
pub(super) fn two_phases() -> ReportData {
    let plain = sample();
    // Without pictures, so the text may contain any letters.
    let mut data = ReportData { pictures: Vec::new(), ..sample() };
    data.vanilla_events = plain.events;
    data.events = events(2000);
    for event in &mut data.events {
        if let Event::Step { step, mean_loss, view_losses: losses, .. } = event {
            *mean_loss = Some(0.05 * (-(*step as f64) / 600.0).exp() + 0.005);
            *losses = view_losses(*step, *mean_loss);
        }
    }
    let stage = |name: &str, seconds| StageTime { name: name.into(), seconds };
    let report = &mut data.report;
    report.method = "instgs".into();
    report.steps = 2000;
    report.config.train.method = Method::Instanced;
    report.config.train.joint.steps = 2000;
    report.stages =
        vec![stage("3dgs: train", 875.0), stage("segment", 30.0), stage("register", 4.7), stage("merge", 5.5)];
    report.eval = Some(quality(24.1));
    report.gaussians =
        Counts { template: 6222, offsets: 74_664, background: 20_000, expanded: 94_664, ..Counts::default() };
    report.bytes = Bytes { file: 10_000_000, host: 12_508_000, ..report.bytes };
    report.groups = vec![group(Some("<car> & co"), 0.031), group(None, 0.236)];
    report.repeated = Some(RepeatedBytes { ply: 18_516_672, f32: 3_558_984, f16: 1_816_824, q8: 1_294_176 });
    report.joint_match = JointMatch::of(&data.vanilla_events, &data.events, report.dataset.train_views);
    report.vanilla = Some(Box::new(plain.report));
    data
}

#[test]
fn a_run_in_two_phases_shows_both() {
    let data = two_phases();
    let html = html(&data, Path::new("report.html")).unwrap();
    let tags = tags(&html);
    let count = |name: &str| tags.iter().filter(|t| *t == name).count();
    assert_eq!((count("svg"), count("table")), (4, 7));
    let found = data.report.joint_match.expect("a match");
    // 0.05 exp(-step / 600) falls to 0.0097 near step 980, 122.5 s of 875.
    assert!((110.0..150.0).contains(&found.seconds) && (0.12..0.18).contains(&found.fraction_of_vanilla), "{found:?}");
    let sentence = format!("after {:.1} s ({:.1} % of", found.seconds, 100.0 * found.fraction_of_vanilla);
    for want in [
        &*sentence,
        "from masks to templates took 40.2 s",
        "plain cloud of 7\u{202F}000 steps, then joint phase of 2\u{202F}000 steps ·",
        "Loss over training time",
        "joint phase begins at 915.2",
        "the plain cloud&#39;s final loss: 0.0",
        "<td>23.80 dB</td><td>24.10 dB</td><td>+0.30 dB</td>",
        "<td>file</td><td>23.9 MiB</td><td>9.5 MiB</td><td>× 0.400</td>",
        "<td>scene on the host, f32</td><td>23.9 MiB</td><td>11.9 MiB</td><td>× 0.500</td>",
        "<td>Gaussians stored</td><td>106\u{202F}000</td><td>26\u{202F}222</td><td>× 0.247</td>",
        "<td>Gaussians expanded</td><td>106\u{202F}000</td><td>94\u{202F}664</td><td>× 0.893</td>",
        "<td>training, each phase</td><td>14 min 35 s</td><td>4 min 10 s</td><td>× 0.286</td>",
        "<td>&lt;car&gt; &amp; co</td><td>3</td><td>2</td><td>1\u{202F}100</td><td>2150.0</td><td>3\u{202F}200</td>",
        "<td>0.031</td></tr>",
        "<p>&lt;car&gt; &amp; co: object 13 has only 17 Gaussians; it is shown as the template</p>",
        "<td>group 4</td>",
        "<td><span class=\"warn\">poor: 0.236</span></td>",
        "<td>the same with --pack q8</td><td>1.2 MiB</td><td>× 0.070</td>",
    ] {
        assert!(html.contains(want), "{want}");
    }
    assert!(!html.contains("Loss</b>") && !html.contains("NaN"));
    assert_eq!(html.matches("expect ghosts").count(), 1, "of the poor group alone");
}

#[test]
fn a_joint_phase_that_stays_behind_is_told() {
    let mut data = two_phases();
    data.report.joint_match = None;
    let html = html(&data, Path::new("report.html")).unwrap();
    assert!(html.contains("did not reach the plain cloud's final loss") && !html.contains("until the plain cloud"));
    // Two reports of ten steps say nothing.
    data.events.retain(|event| event.step() <= 20);
    let html = super::html(&data, Path::new("report.html")).unwrap();
    assert!(html.contains("was not measured") && !html.contains("did not reach"));
}

/// The report of a scene given with `--init`, of which only the file is known.
#[test]
fn a_given_cloud_has_no_curves() {
    let mut data = two_phases();
    data.vanilla_events.clear();
    data.report.joint_match = None;
    let plain = RunReport { gaussians: sample().report.gaussians, eval: None, ..RunReport::default() };
    data.report.vanilla = Some(Box::new(plain));
    let html = html(&data, Path::new("report.html")).unwrap();
    tags(&html);
    assert!(html.contains("from a given plain cloud, joint phase of 2\u{202F}000 steps"));
    assert!(html.contains("Loss</b>") && !html.contains("final loss") && !html.contains("over training time"));
    assert!(html.contains("<td>training, each phase</td><td>–</td><td>4 min 10 s</td><td>–</td>"));
    assert!(html.contains("<td>PSNR, test views</td><td>– dB</td><td>24.10 dB</td><td>– dB</td>"));
}

#[test]
fn bad_numbers_and_empty_lists_of_two_phases_make_a_page() {
    let mut data = two_phases();
    for event in data.events.iter_mut().chain(&mut data.vanilla_events) {
        if let Event::Step { loss, mean_loss, view_losses, psnr, seconds, .. } = event {
            view_losses.clear();
            (*loss, *mean_loss, *psnr, *seconds) = (f64::NAN, Some(f64::INFINITY), f64::NAN, f64::NAN);
        }
    }
    let report = &mut data.report;
    report.stages[1].seconds = f64::NAN;
    report.eval = Some(Metrics { psnr: f64::INFINITY, ssim: f64::NAN, lpips: Some(f64::NAN), psnr_exposed: None });
    (report.seconds, report.groups[0].match_distance) = (f64::NAN, f64::NAN);
    report.groups[1].instances.clear();
    report.groups[1].template = None;
    report.joint_match = JointMatch::of(&data.vanilla_events, &data.events, 0);
    assert_eq!(report.joint_match, None);
    report.joint_match = Some(JointMatch { seconds: f64::NAN, ..JointMatch::default() });
    let page = html(&data, Path::new("report.html")).unwrap();
    tags(&page);
    assert!(!page.contains("NaN") && !page.contains("inf"));
    assert!(page.contains("it stays in the background"));
    data.vanilla_events.clear();
    data.events.clear();
    data.report = RunReport { vanilla: Some(Box::default()), ..RunReport::default() };
    tags(&html(&data, Path::new("report.html")).unwrap());
}

#[test]
fn the_json_of_two_phases_reads_back_and_older_ones_too() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let report = two_phases().report;
    write_json(&RunFolder::new(folder.path()), &report)?;
    let text = std::fs::read_to_string(folder.path().join("report.json"))?;
    assert_eq!(serde_json::from_str::<RunReport>(&text)?, report);
    let mut value: serde_json::Value = serde_json::from_str(&text)?;
    let names: Vec<&str> = value["joint_match"].as_object().ok_or("an object")?.keys().map(String::as_str).collect();
    assert_eq!(names, ["fraction_of_vanilla", "loss", "seconds"]);
    assert!(value["vanilla"]["joint_match"].is_null() && value["repeated"]["q8"] == 1_294_176);
    let object = value.as_object_mut().ok_or("an object")?;
    assert!(object.remove("joint_match").is_some() && object.remove("repeated").is_some());
    let decay_steps = value["config"]["rates"].as_object_mut().and_then(|rates| rates.remove("decay_steps"));
    assert!(decay_steps.is_some());
    let offsets = value["config"]["offsets"].as_object_mut().ok_or("an object")?;
    assert!(offsets.remove("sh_degree").is_some() && offsets.insert("sh_rest".into(), true.into()).is_none());
    let old: RunReport = serde_json::from_value(value)?;
    let mut config = report.config.clone();
    config.train.rates.decay_steps = 0;
    config.train.offsets.sh_degree = 3;
    assert_eq!(old, RunReport { joint_match: None, repeated: None, config, ..report });
    Ok(())
}

/// A run of a version that left no `trained.json` goes on all the same.
#[test]
fn a_report_has_the_facts_of_its_training() -> Result<(), Box<dyn std::error::Error>> {
    let report = sample().report;
    let facts: TrainFacts = serde_json::from_str(&serde_json::to_string(&report)?)?;
    assert_eq!((facts.steps, &facts.stages, facts.eval), (report.steps, &report.stages, report.eval));
    assert_eq!((facts.gaussians, facts.bytes, facts.seed), (report.gaussians, report.bytes, report.seed));
    assert_eq!((facts.memory_explained, facts.views), (report.memory_explained, report.views));
    assert_eq!((facts.passes_ms.len(), facts.dataset), (report.passes_ms.len(), report.dataset));
    Ok(())
}

#[test]
fn the_json_has_the_contracts_names_and_reads_back() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let data = sample();
    write(&RunFolder::new(folder.path()), &data)?;
    assert!(folder.path().join("report.html").exists());
    let text = std::fs::read_to_string(folder.path().join("report.json"))?;
    let value: serde_json::Value = serde_json::from_str(&text)?;
    for key in ["method", "steps", "seconds", "steps_per_second", "device", "seed", "version", "registration"] {
        assert!(!value[key].is_null(), "{key}");
    }
    assert_eq!(value["stages"][1]["name"], "train");
    assert_eq!(value["passes_ms"]["tile_blend"], 31.0);
    assert_eq!(value["eval"]["psnr"], 23.8);
    assert_eq!(
        value["gaussians"],
        serde_json::json!({"template":0,"offsets":0,"background":106_000,"expanded":106_000})
    );
    let sizes =
        serde_json::json!({"file":25_016_000,"host":25_016_000,"device_scene":26_000_000,"device_peak":912_000_000});
    assert_eq!(value["bytes"], sizes);
    assert_eq!(value["views"][0]["psnr"], 22.1);
    assert!(value.get("vanilla").is_none() && value["registration"] == serde_json::json!([]));
    let back: RunReport = serde_json::from_str(&text)?;
    assert_eq!(back, data.report);
    // The passes have the order of a step, not of the alphabet.
    assert!(text.find("radix_sort_scatter") < text.find("tile_blend") && text.find("preprocess") < text.find("radix"));
    Ok(())
}

#[test]
fn numbers_that_are_none_are_written_as_null_and_read() -> Result<(), Box<dyn std::error::Error>> {
    let (psnr, nan) = (f64::INFINITY, f64::NAN);
    let eval = Some(Metrics { psnr, ssim: 1.0, lpips: None, psnr_exposed: Some(psnr + 0.5) });
    let text = serde_json::to_string(&RunReport { eval, steps_per_second: nan, ..RunReport::default() })?;
    let back: RunReport = serde_json::from_str(&text)?;
    assert!(back.steps_per_second.is_nan() && back.eval.is_some_and(|q| q.psnr.is_nan() && q.ssim == 1.0));
    Ok(())
}

#[test]
fn a_view_with_a_faulty_picture_is_named() {
    let mut data = sample();
    data.pictures[1].render.pixels.pop();
    let error = html(&data, Path::new("r.html")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.starts_with("r.html: picture <b>&\"c\".png: ") && error.contains("480x320"), "{error}");
    let picture = |width| Rgb8 { width, height: 1, pixels: vec![0; 3 * width as usize] };
    let error = ViewPicture::new("a", quality(20.0), &picture(2), &picture(1)).err().map(|e| e.to_string());
    assert_eq!(error.as_deref(), Some("the photograph has 2x1 pixels, the rendering 1x1"));
}

/// PSNR with exposures is a column where it was measured.
#[test]
fn exposures_have_a_column_where_there_are_any() {
    let mut data = sample();
    let page = |data: &ReportData| html(data, Path::new("report.html")).unwrap();
    assert!(!page(&data).contains("with exposures"));
    data.report.views[1].metrics.psnr_exposed = Some(27.25);
    data.report.eval = data.report.eval.map(|mean| Metrics { psnr_exposed: Some(26.5), ..mean });
    let page = page(&data);
    assert!(page.contains("<th>PSNR with exposures, dB</th>"));
    for row in ["</td><td>–</td></tr>", "<td>–</td><td>27.25</td></tr>", "</td><td>26.50</td></tr>"] {
        assert!(page.contains(row), "{row}");
    }
}
