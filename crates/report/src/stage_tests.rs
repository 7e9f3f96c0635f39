//! Tests of the sections about the stages, with synthetic pictures.

use std::path::Path;

use super::tests::{tags, two_phases};
use super::*;
use instgs_objects::register::{InstanceRegistration, Verdict};

fn grey(level: u8) -> Rgb8 {
    Rgb8 { width: 4, height: 3, pixels: vec![level; 36] }
}

fn registered(instance: u32, verdict: Verdict, note: &str) -> InstanceRegistration {
    InstanceRegistration {
        instance,
        group: verdict.is_accepted().then_some(4),
        name: None,
        gaussians: 900,
        inliers: 0.93,
        rmse: 0.0321,
        relative_rmse: 0.0064,
        photometric: Some(0.0517),
        uncertainty: None,
        slight: false,
        accepted: verdict.is_accepted(),
        verdict,
        note: note.into(),
    }
}

/// Three posed objects, one of them without Gaussians, and one in no group; the second view has no mask.
fn staged() -> ReportData {
    let mut data = two_phases();
    let tile = |id: u32, overlap| OverlayTile {
        id,
        color: [230, 25, id as u8],
        own: Some(grey(10)),
        over: vec![grey(20), grey(30)],
        overlap,
    };
    let bare = OverlayTile { id: 13, ..OverlayTile::default() };
    let alone = OverlayTile { over: Vec::new(), ..tile(40, None) };
    let view = |name: &str, mask: Option<Rgb8>| StageView {
        name: name.into(),
        photo: grey(1),
        given: mask.clone(),
        objects: mask,
        labels: grey(2),
    };
    let template = TemplatePictures {
        name: "<car>".into(),
        gaussians: 3111,
        instances: 3,
        merged: vec![grey(3), grey(4)],
        trained: vec![grey(5), grey(6)],
    };
    data.stages = StagePictures {
        notes: vec!["5 masks were not used & so on.".into()],
        objects: (1..=40).map(|id| ObjectColor { id, name: Some("<car>".into()), color: [1, 2, 255] }).collect(),
        views: vec![view("a", Some(grey(9))), view("<b>", None)],
        overlays: vec![
            GroupOverlay {
                name: "<car>".into(),
                tiles: vec![tile(11, None), tile(12, Some(0.873)), bare],
                left_out: 7,
            },
            GroupOverlay { name: "in no group".into(), tiles: vec![alone], left_out: 2 },
        ],
        groups_left_out: 3,
        templates: vec![template, TemplatePictures::default()],
        templates_left_out: 1000,
    };
    data.report.registration = vec![
        registered(11, Verdict::Reference, "most of its surface was seen"),
        registered(12, Verdict::Ambiguous, "another pose is only <2 % less likely"),
        registered(40, Verdict::Rejected, "too small"),
    ];
    data
}

#[test]
fn every_stage_is_shown_and_escaped() {
    let page = html(&staged(), Path::new("report.html")).unwrap();
    let tags = tags(&page);
    let count = |name: &str| tags.iter().filter(|tag| *tag == name).count();
    // Two views with two and four pictures, three tiles with pictures, one template.
    assert_eq!(count("img"), 6 + (3 + 3 + 1) + 4);
    for want in [
        "<h2>Masks, objects and labels</h2>",
        "5 masks were not used &amp; so on.",
        "background:#0102ff\"></i>&lt;car&gt; 36</span>",
        "<span>and 4 more</span>",
        "masks as given: the view has none",
        "<h2>Registered poses</h2>",
        "<h3>&lt;car&gt;<span>7 more are not shown; these fit worst</span></h3>",
        "<b>object 11</b> the reference</p>",
        "<b>object 12</b> <span class=\"warn\">in doubt</span></p>",
        "outline 87 % · surface 93 % · RMSE 0.0321 (0.6 % of its size) · colours 0.052</p>",
        "another pose is only &lt;2 % less likely</p>",
        "<b>object 13</b> </p>",
        "It has no Gaussians.",
        "<b>object 40</b> <span class=\"warn\">rejected</span></p>",
        "<h3>in no group<span>2 more are not shown</span></h3>",
        ">3 smaller groups are not shown.</p>",
        "<h2>Templates</h2>",
        ">1\u{202F}000 more templates are not shown.</p>",
        "<h3>&lt;car&gt;<span>3\u{202F}111 Gaussians, 3 instances</span></h3>",
        "after the joint phase, from behind",
    ] {
        assert!(page.contains(want), "{want}");
    }
    assert!(!page.contains("object 37") && page.matches("RMSE 0.0").count() == 1, "of the posed one alone");
}

/// With --groups nothing was registered; the other run's pictures could not be made.
#[test]
fn given_groups_and_no_pictures_make_a_page() {
    let mut data = staged();
    data.report.registration.clear();
    let page = html(&data, Path::new("report.html")).unwrap();
    tags(&page);
    assert!(page.contains("<b>object 12</b> </p>") && page.contains(">outline 87 %</p>"));
    assert!(!page.contains("RMSE 0"));
    data.stages = StagePictures::default();
    let page = html(&data, Path::new("report.html")).unwrap();
    tags(&page);
    for title in ["Masks, objects", "Registered poses", "Templates</h2>"] {
        assert!(!page.contains(title), "{title}");
    }
}

#[test]
fn a_picture_that_is_none_is_named() {
    let mut data = staged();
    data.stages.views[0].labels.pixels.pop();
    let error = html(&data, Path::new("r.html")).err().map(|e| e.to_string()).unwrap_or_default();
    assert_eq!(error, "r.html: a, labelled Gaussians: 35 bytes are no picture of 4x3 pixels");
}
