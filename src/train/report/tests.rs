//! `report.json` by its names; the page by its structure, with made-up data.

use std::f64::consts::TAU;

use super::*;
use crate::math::rng::Rng;

fn quality(psnr: f64) -> Quality {
    Quality { psnr, ssim: 0.5 + psnr / 80.0, lpips: Some(0.5 - psnr / 80.0) }
}

/// A photograph of coloured waves, and a rendering with noise of the given strength.
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
    let rgb = |pixels| Rgb8 { width, height, pixels };
    ViewPicture { name: name.into(), metrics: quality(24.0), ground_truth: rgb(truth), render: rgb(render) }
}

fn events(steps: u64) -> Vec<Event> {
    let (mut rng, mut gaussians) = (Rng::new(1), 40_000);
    let mut events = Vec::new();
    for step in (10..=steps).step_by(10) {
        let t = step as f64 / steps as f64;
        let dip = if (3000..3600).contains(&step) { 4.0 } else { 0.0 };
        let psnr = 12.0 + 13.0 * (1.0 - (-5.0 * t).exp()) - dip + rng.normal();
        let (loss, l1) = (0.25 * (-4.0 * t).exp() + 0.02 * rng.uniform(), 0.05);
        let (ssim, steps_per_second, seconds) = (0.8, 9.0 - 3.0 * t + 0.2 * rng.normal(), step as f64 / 8.0);
        events.push(Event::Step { step, loss, l1, ssim, psnr, gaussians, steps_per_second, seconds });
        if step % 100 == 0 && step > 500 && step < 5000 {
            gaussians += 1500;
            let (cloned, split, pruned, relocated) = (1000, 600, 700, 0);
            events.push(Event::Densified { step, cloned, split, pruned, relocated, gaussians });
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
            .map(|(n, seconds)| Stage { name: n.into(), seconds })
            .into(),
        passes_ms: passes.map(|(name, ms)| (name.into(), ms)).into(),
        eval: Some(quality(23.8)),
        gaussians: Counts { background: 106_000, expanded: 106_000, ..Counts::default() },
        bytes: Bytes { file: 25_016_000, host: 25_016_000, device_scene: 26_000_000, device_peak: 912_000_000 },
        device: "llvmpipe <LLVM 15>".into(),
        version: "0.1.0".into(),
        host_fraction: 0.021,
        memory_explained: vec![
            memory("parameters, gradients, Adam", 400_000_000, "Gaussian", 424_000),
            memory("intersections", 384_000_000, "intersection", 16_000_000),
            memory("training pictures", 97_200_000, "pixel", 32_400_000),
        ],
        views: vec![
            ViewMetrics { name: "a.png".into(), quality: quality(22.1) },
            ViewMetrics { name: "<b>&\"c\".png".into(), quality: Quality { lpips: None, ..quality(25.5) } },
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
    ReportData { report, events: events(7000), pictures }
}

/// Checks that every tag is closed in order and returns the names of all that were opened.
fn tags(html: &str) -> Vec<String> {
    let body = html.strip_prefix("<!DOCTYPE html>\n").expect("a doctype");
    let (mut open, mut all) = (Vec::new(), Vec::new());
    for piece in body.split('<').skip(1) {
        let (tag, text) = piece.split_once('>').expect("a > for each <");
        assert!(!text.contains('>') || open.last() == Some(&"style"), "a stray > in {text}");
        assert!(tag.matches('"').count().is_multiple_of(2), "quotes of <{tag}>");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "</{name}>");
            continue;
        }
        let name = tag.split([' ', '/']).next().unwrap_or_default();
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
    assert_eq!((count("script"), count("link"), count("iframe")), (0, 0, 0));
    // Nothing is fetched: no addresses but data, no imports.
    assert_eq!(html.matches("src=\"").count(), html.matches("src=\"data:image/png;base64,").count());
    assert!(!html.contains("http") && !html.contains("url(") && !html.contains("@import"));
    assert!(html.contains("&lt;b&gt;&amp;&quot;c&quot;.png") && !html.contains("<b>&"));
    assert!(html.contains("prefers-color-scheme: dark"));
    for want in ["23.80 dB", "106\u{202F}000", "15 min 05 s", "tile_blend_backward", "opacity reset", "steps = 30000"] {
        assert!(html.contains(want), "{want}");
    }
    let words = html.split("base64,").map(|part| part.split_once("\" alt").map_or(part, |(_, text)| text));
    assert!(words.into_iter().all(|text| !text.contains("NaN") && !text.contains("inf")), "a number that is none");
}

#[test]
fn a_report_of_nothing_is_a_page_too() {
    let html = html(&ReportData::default(), Path::new("report.html")).unwrap();
    let tags = tags(&html);
    assert!(!tags.contains(&"svg".to_owned()) && !tags.contains(&"table".to_owned()), "{tags:?}");
}

#[test]
fn instances_and_the_vanilla_scene_get_their_tables() {
    let mut data = sample();
    data.report.gaussians.template = 500;
    data.report.vanilla = Some(Box::new(sample().report));
    data.report.registration = vec![Registration { instance: 7, inliers: 0.25, ..Registration::default() }];
    let html = html(&data, Path::new("report.html")).unwrap();
    assert_eq!(tags(&html).iter().filter(|t| *t == "table").count(), 6);
    assert!(html.contains("vanilla, where it started") && html.contains("<td>0.250</td>"));
}

#[test]
fn the_json_has_the_contracts_names_and_reads_back() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let data = sample();
    write(folder.path(), &data)?;
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
    // The order of the passes is that of a step, not of the alphabet.
    assert!(text.find("radix_sort_scatter") < text.find("tile_blend") && text.find("preprocess") < text.find("radix"));
    Ok(())
}

#[test]
fn numbers_that_are_none_are_written_as_null_and_read() -> Result<(), Box<dyn std::error::Error>> {
    let (psnr, nan) = (f64::INFINITY, f64::NAN);
    let eval = Some(Quality { psnr, ssim: 1.0, lpips: None });
    let text = serde_json::to_string(&RunReport { eval, steps_per_second: nan, ..RunReport::default() })?;
    let back: RunReport = serde_json::from_str(&text)?;
    assert!(back.steps_per_second.is_nan() && back.eval.is_some_and(|q| q.psnr.is_nan() && q.ssim == 1.0));
    Ok(())
}

#[test]
fn a_view_whose_pictures_differ_in_size_is_named() {
    let mut data = sample();
    data.pictures[1].render = Rgb8 { width: 1, height: 1, pixels: vec![0; 3] };
    let error = html(&data, Path::new("r.html")).err().map(|e| e.to_string()).unwrap_or_default();
    assert_eq!(error, "r.html: picture <b>&\"c\".png: the photograph has 540x360 pixels, the rendering 1x1");
}

/// To look at: `cargo test --lib report_sample -- --ignored`.
#[test]
#[ignore = "writes /tmp/report_sample.html to be looked at"]
fn report_sample() {
    std::fs::write("/tmp/report_sample.html", html(&sample(), Path::new("x")).unwrap()).unwrap();
}
