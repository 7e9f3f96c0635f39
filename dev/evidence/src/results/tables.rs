//! The paper's tables for the measured scenes.

use super::sheet::{Cell, Sheet};
use super::{Part, SceneResult};
use crate::gains::{BestOf, gain, gain_over_best, over_seeds, psnr, psnr_in_masks};
use crate::protocol::{Row, SeedResult, names};
use instgs_vk::math::statistics::median;

/// Rows of a table of methods, in order.
const METHODS: [&str; 12] = [
    names::START,
    names::SAME_TIME,
    names::AT_ONCE,
    names::MCMC,
    names::SAME_BYTES,
    names::SPZ,
    names::SAME_TIME_SMALL,
    names::RIGID,
    names::OURS,
    names::OURS_F16,
    names::OURS_Q8,
    names::OURS_SMALL,
];
/// Published figures on Mip-NeRF 360: name, source, PSNR, SSIM, LPIPS, file size in MB (NaN: not published).
const PUBLISHED: [(&str, &str, [f64; 4]); 5] = [
    ("Instant-NGP (big)", "3DGS paper, 2023, table 1", [25.59, 0.699, 0.331, 48.0]),
    ("3DGS, 30,000 steps", "3DGS paper, 2023, table 1", [27.21, 0.815, 0.214, 734.0]),
    ("Compact 3DGS", "Lee et al. 2024, table 1", [27.08, 0.798, 0.247, 48.8]),
    ("Self-Organizing Gaussians", "Morgenstern et al. 2024, their repository", [27.08, 0.799, 0.230, 40.3]),
    ("Octree-GS", "Ren et al. 2024, by the survey 3DGS.zip", [28.05, 0.819, 0.217, f64::NAN]),
];
const MEGABYTE: f64 = 1e6;

/// Every table for which the measured scenes have data.
pub fn all(scenes: &[SceneResult]) -> Vec<Sheet> {
    let counted: Vec<&SceneResult> = of_part(scenes, Part::Scene);
    let mut out = Vec::new();
    for (synthetic, key, title) in
        [(true, "methods_synthetic", "Synthetic scenes"), (false, "methods_real", "Real and foreign scenes")]
    {
        let of_kind: Vec<&SceneResult> = counted.iter().copied().filter(|s| s.synthetic == synthetic).collect();
        if !of_kind.is_empty() {
            out.push(methods(key, title, &of_kind));
        }
    }
    out.extend(differences(&counted));
    out.extend(sizes(&counted));
    out.extend(passes(&counted));
    out.extend(segmentation(&counted));
    out.extend(ablations(scenes));
    out.extend(failure(&of_part(scenes, Part::Failure)));
    out.extend(scaling(&of_part(scenes, Part::Scaling)));
    out.extend(alike(&of_part(scenes, Part::Differences)));
    out.push(published());
    out
}

fn of_part(scenes: &[SceneResult], part: Part) -> Vec<&SceneResult> {
    scenes.iter().filter(|scene| scene.part == part).collect()
}

/// Median over the seeds of a figure of a row; `None` if a seed lacks it.
fn of_row(scene: &SceneResult, name: &str, figure: impl Fn(&Row) -> Option<f64>) -> Option<f64> {
    of_seed(scene, |seed| figure(seed.row(name)?))
}

/// Median over the seeds of a figure; `None` if a seed lacks it, or without seeds.
fn of_seed(scene: &SceneResult, figure: impl Fn(&SeedResult) -> Option<f64>) -> Option<f64> {
    over_seeds(&scene.seeds, figure)
}

/// How far the instanced scene is above the better plain cloud, dB; the same in the masks; and which clouds were there.
fn against_best(scene: &SceneResult) -> [Cell; 3] {
    let of = |figure| Cell::maybe(gain_over_best(&scene.seeds, figure), 2);
    [of(psnr), of(psnr_in_masks), BestOf::of(&scene.seeds).map_or(Cell::Empty, |best| best.short().into())]
}

/// Explains the columns of [`against_best`].
const BEST_NOTE: &str = "Best 3DGS is, for each seed and figure, the better of the cloud of the same time and that of as many \
                         steps at once; where only one was measured, as \"best of\" says, it is that one.";

/// dB of the instanced scene as f16 above 3DGS of the same bytes, f16 as well.
fn over_same_bytes(scene: &SceneResult) -> Cell {
    Cell::maybe(gain(&scene.seeds, names::OURS_F16, names::SAME_BYTES, psnr), 2)
}

/// Frames per second of the instanced scene over those of the cloud with the same training time.
pub(super) fn frame_ratio(scene: &SceneResult) -> Option<f64> {
    of_seed(scene, |seed| seed.fps.map(|[ours, theirs]| ours / theirs))
}

fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values: Option<Vec<f64>> = values.collect();
    values.filter(|v| !v.is_empty()).map(|v| v.iter().sum::<f64>() / v.len() as f64)
}

/// Table 1 of the paper: every method, mean over the scenes.
fn methods(key: &'static str, title: &str, scenes: &[&SceneResult]) -> Sheet {
    let mut rows = Vec::new();
    for method in METHODS {
        let of = |figure: fn(&Row) -> Option<f64>| mean(scenes.iter().map(|scene| of_row(scene, method, figure)));
        if of(psnr).is_none() {
            continue;
        }
        let place = [names::OURS, names::SAME_TIME].iter().position(|name| *name == method);
        let fps = |scene: &&SceneResult| of_seed(scene, |seed| Some(seed.fps?[place?]));
        rows.push(vec![
            method.into(),
            Cell::maybe(of(psnr), 2),
            Cell::maybe(of(|row| row.psnr_in_masks), 2),
            Cell::maybe(of(|row| Some(row.ssim)), 4),
            Cell::maybe(of(|row| row.lpips), 4),
            Cell::maybe(of(|row| Some(row.host_bytes as f64 / MEGABYTE)), 2),
            Cell::maybe(of(|row| Some(row.file_bytes as f64 / MEGABYTE)), 2),
            Cell::maybe(mean(scenes.iter().map(fps)), 2),
            Cell::maybe(of(|row| Some(row.seconds)), 0),
        ]);
    }
    Sheet {
        key,
        title: format!("{title}, means over {}", scenes.len()),
        note:
            "Test views. Host MB are the tensors handed to the device; frames per second are measured in turn for the \
               two scenes that had the same training time. A cell is empty where a scene lacks the figure."
                .into(),
        head: vec!["", "PSNR", "in masks", "SSIM", "LPIPS", "host MB", "file MB", "frames/s", "train s"],
        rows,
    }
}

/// Table 2 of the paper: every scene.
fn differences(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let over = |name: &str, figure| gain(&scene.seeds, names::OURS, name, figure);
        let against = |name: &str| Cell::maybe(over(name, psnr), 2);
        let [best, best_in_masks, best_of] = against_best(scene);
        vec![
            scene.name.clone().into(),
            Cell::maybe(of_row(scene, names::OURS, psnr), 2),
            best,
            best_in_masks,
            best_of,
            against(names::SAME_TIME),
            Cell::maybe(over(names::SAME_TIME, psnr_in_masks), 2),
            against(names::AT_ONCE),
            against(names::MCMC),
            over_same_bytes(scene),
            against(names::SPZ),
            against(names::RIGID),
            Cell::maybe(over(names::OURS_F16, psnr), 3),
            Cell::maybe(over(names::OURS_Q8, psnr), 3),
            Cell::maybe(over(names::OURS_SMALL, psnr), 3),
            Cell::maybe(frame_ratio(scene), 2),
        ]
    };
    let mut rows: Vec<Vec<Cell>> = scenes.iter().map(row).collect();
    if scenes.len() > 2 {
        rows.push(medians("median", &rows));
    }
    (!scenes.is_empty()).then(|| Sheet {
        key: "scenes",
        title: "Scene by scene: how far InstGS is above the others".into(),
        note: format!(
            "Test PSNR of InstGS, then by how many dB it is above each of the others (below where negative; medians over the \
             seeds of training), then frames per second over those of 3DGS of the same time. {BEST_NOTE} 3DGS of the same bytes \
             is as f16, and so is InstGS beside it."
        ),
        head: vec![
            "scene",
            "InstGS",
            "best 3DGS",
            "best, in masks",
            "best of",
            "same time",
            "same, in masks",
            "at once",
            "MCMC",
            "same bytes (f16)",
            ".spz",
            "rigid",
            "f16",
            "q8",
            "small",
            "x frames/s",
        ],
        rows,
    })
}

/// A row with the median of each numeric column.
fn medians(name: &str, rows: &[Vec<Cell>]) -> Vec<Cell> {
    let columns = rows.first().map_or(0, Vec::len);
    let of = |column: usize| {
        let mut decimals = 0;
        let values: Option<Vec<f64>> = (rows.iter())
            .map(|row| match row[column] {
                Cell::Number(value, d) => {
                    decimals = d;
                    Some(value)
                }
                _ => None,
            })
            .collect();
        Cell::maybe(values.map(|v| median(&v)), decimals)
    };
    std::iter::once(name.into()).chain((1..columns).map(of)).collect()
}

fn sizes(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let of = |figure: fn(&SeedResult) -> f64| of_seed(scene, |seed| Some(figure(seed)));
        let host = |name: &str| of_row(scene, name, |row| Some(row.host_bytes as f64));
        let file = |name: &str| of_row(scene, name, |row| Some(row.file_bytes as f64));
        let ratio = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a / b);
        vec![
            scene.name.clone().into(),
            Cell::Count(scene.instances),
            Cell::maybe(of(|s| s.repeated.ply as f64 / MEGABYTE), 2),
            Cell::maybe(of(|s| s.repeated.ply as f64 / s.repeated.f32.max(1) as f64), 2),
            Cell::maybe(of(|s| s.repeated.ply as f64 / s.repeated.f16.max(1) as f64), 2),
            Cell::maybe(of(|s| s.repeated.ply as f64 / s.repeated.q8.max(1) as f64), 2),
            Cell::maybe(of(|s| s.replaced_ply as f64 / s.repeated.f16.max(1) as f64), 2),
            Cell::maybe(of(|s| s.replaced_ply as f64 / s.repeated.q8.max(1) as f64), 2),
            Cell::maybe(ratio(host(names::SAME_TIME), host(names::OURS)), 2),
            Cell::maybe(ratio(file(names::SAME_TIME), file(names::OURS_F16)), 2),
            Cell::maybe(ratio(file(names::SAME_TIME), file(names::OURS_Q8)), 2),
            Cell::maybe(ratio(file(names::SAME_TIME), file(names::OURS_SMALL)), 2),
            Cell::maybe(ratio(file(names::SPZ), file(names::OURS_SMALL)), 2),
            Cell::maybe(ratio(file(names::SAME_TIME_SMALL), file(names::OURS_SMALL)), 2),
        ]
    };
    (!scenes.is_empty()).then(|| Sheet {
        key: "sizes",
        title: "How much smaller".into(),
        note: "The repeated part beside the same objects as .ply (the analytic bound is 248K/(124+14K) for K instances \
               with f16, 248K/(124+7K) with q8); beside the plain cloud's own Gaussians of the objects (templates may \
               have more than an object had); then the whole scene beside 3DGS of the same time: as the device gets it, \
               and as files (.ply beside ours); and small beside that cloud's .spz, and beside that cloud as small, too."
            .into(),
        head: vec![
            "scene",
            "instances",
            "repeated, .ply MB",
            "x f32",
            "x f16",
            "x q8",
            "own x f16",
            "own x q8",
            "scene x host",
            "scene x f16",
            "scene x q8",
            "scene x small",
            ".spz x small",
            "small x small",
        ],
        rows: scenes.iter().map(row).collect(),
    })
}

/// Time of each pass of a frame, mean over the scenes.
fn passes(scenes: &[&SceneResult]) -> Option<Sheet> {
    let seeds: Vec<&SeedResult> = scenes.iter().flat_map(|scene| &scene.seeds).collect();
    let first = seeds.iter().find(|seed| !seed.passes_ms.is_empty())?;
    let over = |figure: &dyn Fn(&SeedResult) -> Option<f64>| mean(seeds.iter().map(|seed| figure(seed)));
    let mut rows = Vec::new();
    for (pass, ..) in &first.passes_ms {
        let of = |seed: &SeedResult| seed.passes_ms.iter().find(|(name, ..)| name == pass).map(|p| (p.1, p.2));
        rows.push(vec![
            pass.clone().into(),
            Cell::maybe(over(&|seed| Some(of(seed)?.0)), 3),
            Cell::maybe(over(&|seed| Some(of(seed)?.1)), 3),
        ]);
    }
    let pairs = |i: usize| over(&|seed| Some(seed.intersections?[i] as f64));
    rows.push(vec!["(splat, tile) pairs".into(), Cell::maybe(pairs(0), 0), Cell::maybe(pairs(1), 0)]);
    Some(Sheet {
        key: "passes",
        title: "Where the time of a frame goes".into(),
        note: "Milliseconds by pass, means over scenes and seeds; the last row counts what is blended.".into(),
        head: vec!["pass", "InstGS", "3DGS, same time"],
        rows,
    })
}

/// The table of the paper's supplement.
fn segmentation(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let s = &scene.segmentation;
        let second = |i: usize| Cell::Number(s.seconds[i], 2);
        vec![
            scene.name.clone().into(),
            Cell::Count(s.gaussians),
            Cell::Count(s.objects),
            Cell::maybe(s.mean_accuracy, 4),
            Cell::Number(s.bytes as f64 / MEGABYTE, 2),
            second(0),
            second(1),
            second(2),
            second(3),
        ]
    };
    (!scenes.is_empty()).then(|| Sheet {
        key: "segmentation",
        title: "From masks to instances".into(),
        note: "mAcc: mean over the true objects of the part of their Gaussians that has their label; the truth is the object \
               of the nearest surface point. MB: what Gaussians add to the masks, kept in memory."
            .into(),
        head: vec!["scene", "Gaussians", "objects", "mAcc", "MB", "consensus s", "labels s", "register s", "merge s"],
        rows: scenes.iter().map(row).collect(),
    })
}

/// Figures 5 and 8 of the paper: one table for each kind of setting; all runs of a scene start from one plain cloud.
fn ablations(scenes: &[SceneResult]) -> Vec<Sheet> {
    const TABLES: [(&str, &str, &str); 5] = [
        ("offsets", "ablation_offsets", "Figure 5: what instances have of their own"),
        ("template", "ablation_template", "Figure 5: where the template comes from"),
        ("init", "ablation_init", "Figure 8: what offsets start from"),
        ("poses", "ablation_poses", "Whether poses are refined"),
        ("joint", "ablation_joint", "What the joint phase may do"),
    ];
    let mut out = Vec::new();
    for (table, key, title) in TABLES {
        let mut rows = Vec::new();
        for scene in scenes {
            for of_table in scene.ablations.iter().filter(|a| a.table == table) {
                let row = &of_table.row;
                rows.push(vec![
                    scene.name.clone().into(),
                    of_table.name.clone().into(),
                    Cell::Number(row.psnr, 2),
                    Cell::maybe(row.psnr_in_masks, 2),
                    Cell::Number(row.ssim, 4),
                    Cell::Number(row.host_bytes as f64 / MEGABYTE, 2),
                ]);
            }
        }
        if !rows.is_empty() {
            let (title, note) = (title.into(), String::new());
            out.push(Sheet {
                key,
                title,
                note,
                head: vec!["scene", "setting", "PSNR", "in masks", "SSIM", "host MB"],
                rows,
            });
        }
    }
    out
}

/// Figure 10 of the paper: objects that are not alike.
fn failure(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let warning = scene.seeds.first().and_then(|seed| seed.warnings.first()).cloned().unwrap_or_default();
        let [best, best_in_masks, best_of] = against_best(scene);
        vec![
            scene.name.clone().into(),
            Cell::maybe(of_row(scene, names::OURS, psnr), 2),
            best,
            best_in_masks,
            best_of,
            warning.into(),
        ]
    };
    (!scenes.is_empty()).then(|| Sheet {
        key: "failure",
        title: "Figure 10: objects that are not alike".into(),
        note: format!(
            "Groups are given, so that unlike objects have to share a template; the last column is what the user is told. \
             {BEST_NOTE}"
        ),
        head: vec!["scene", "PSNR", "against best 3DGS", "in masks", "best of", "warning"],
        rows: scenes.iter().map(row).collect(),
    })
}

/// Results over the number of instances.
fn scaling(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let megabytes = |name: &str| Cell::maybe(of_row(scene, name, |row| Some(row.file_bytes as f64 / MEGABYTE)), 2);
        let [best, _, best_of] = against_best(scene);
        vec![
            scene.name.clone().into(),
            Cell::Count(scene.instances),
            Cell::maybe(of_row(scene, names::OURS, psnr), 2),
            best,
            best_of,
            megabytes(names::SAME_TIME),
            megabytes(names::OURS_F16),
            Cell::maybe(of_seed(scene, |s| Some(s.repeated.ply as f64 / s.repeated.f16.max(1) as f64)), 2),
            Cell::maybe(frame_ratio(scene), 2),
        ]
    };
    (!scenes.is_empty()).then(|| Sheet {
        key: "scaling",
        title: "Over the number of instances".into(),
        note: format!(
            "The views and the budget of Gaussians stay, so that each object gets fewer pixels and Gaussians. {BEST_NOTE}"
        ),
        head: vec![
            "scene",
            "instances",
            "PSNR",
            "against best 3DGS",
            "best of",
            "3DGS file MB",
            "f16 file MB",
            "repeated x f16",
            "x frames/s",
        ],
        rows: scenes.iter().map(row).collect(),
    })
}

/// Results over the differences between instances.
fn alike(scenes: &[&SceneResult]) -> Option<Sheet> {
    let row = |scene: &&SceneResult| {
        let [best, best_in_masks, best_of] = against_best(scene);
        vec![
            scene.name.clone().into(),
            Cell::Number(scene.differences, 2),
            Cell::maybe(of_row(scene, names::OURS, psnr), 2),
            best,
            best_in_masks,
            best_of,
            over_same_bytes(scene),
            Cell::maybe(frame_ratio(scene), 2),
        ]
    };
    (!scenes.is_empty()).then(|| Sheet {
        key: "differences",
        title: "Over how much instances differ".into(),
        note: format!(
            "0 = all objects look as the first, 1 = paint, parts and all; dB above 3DGS. {BEST_NOTE} 3DGS of the same bytes is as \
             f16, and so is InstGS beside it."
        ),
        head: vec![
            "scene",
            "differences",
            "PSNR",
            "best 3DGS",
            "best, in masks",
            "best of",
            "same bytes (f16)",
            "x frames/s",
        ],
        rows: scenes.iter().map(row).collect(),
    })
}

/// Published results on other data, of which only the order of magnitude can be compared.
fn published() -> Sheet {
    let row = |&(name, source, [psnr, ssim, lpips, megabytes]): &(&str, &str, [f64; 4])| {
        vec![
            name.into(),
            Cell::Number(psnr, 2),
            Cell::Number(ssim, 3),
            Cell::Number(lpips, 3),
            Cell::maybe(Some(megabytes), 0),
            source.into(),
        ]
    };
    Sheet {
        key: "published",
        title: "Published by others, on other data (Mip-NeRF 360, LPIPS of VGG)".into(),
        note: "Not measured here, and not comparable with the tables above. No figures of the hierarchical 3DGS (Kerbl et al. \
               2024) on these scenes were found."
            .into(),
        head: vec!["", "PSNR", "SSIM", "LPIPS", "file MB", "source"],
        rows: PUBLISHED.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Ablation, Segmentation};
    use instgs_vk::scene::RepeatedBytes;

    /// Ours 30 dB plus `more`, all others 29 dB.
    fn scene(name: &str, part: Part, more: &[f64]) -> SceneResult {
        let row = |name: &str, psnr: f64| Row { name: name.into(), psnr, host_bytes: 2_000_000, ..Row::default() };
        let seed = |(seed, more): (u64, &f64)| SeedResult {
            seed,
            rows: vec![row(names::SAME_TIME, 29.0), row(names::OURS, 30.0 + more)],
            fps: Some([3.0, 2.0]),
            repeated: RepeatedBytes { ply: 800, f32: 400, f16: 100, q8: 50 },
            warnings: vec!["not alike".into()],
            ..SeedResult::default()
        };
        SceneResult {
            name: name.into(),
            synthetic: true,
            part,
            seeds: (0..).zip(more).map(seed).collect(),
            segmentation: Segmentation { mean_accuracy: Some(0.95), ..Segmentation::default() },
            ..SceneResult::default()
        }
    }

    fn sheet<'a>(sheets: &'a [Sheet], key: &str) -> Option<&'a Sheet> {
        sheets.iter().find(|s| s.key == key)
    }

    #[test]
    fn medians_over_seeds_then_means_over_scenes() {
        let scenes = [scene("a", Part::Scene, &[0.0, 0.1, 5.0]), scene("b", Part::Scene, &[0.3]), {
            let mut failed = scene("c", Part::Failure, &[-9.0]);
            let ablation = Ablation { table: "init".into(), name: "zero".into(), row: Row::default() };
            failed.ablations.push(ablation);
            failed
        }];
        let sheets = all(&scenes);
        let methods = sheet(&sheets, "methods_synthetic").map(Sheet::lines).unwrap_or_default();
        // (30.1 + 30.3) / 2; rows that no scene has are left out.
        assert_eq!((methods.len(), methods[2][..2].to_vec()), (3, vec![names::OURS.to_owned(), "30.20".into()]));
        assert!(sheet(&sheets, "methods_real").is_none() && sheet(&sheets, "scaling").is_none());
        let lines = sheet(&sheets, "scenes").map(Sheet::lines).unwrap_or_default();
        assert_eq!(lines[1][..6], ["a", "30.10", "1.10", "", "same time", "1.10"]);
        assert_eq!((lines.len(), lines[1][15].as_str()), (3, "1.50"));
        let failure = sheet(&sheets, "failure").map(Sheet::lines).unwrap_or_default();
        assert_eq!(failure[1], ["c", "21.00", "-8.00", "", "same time", "not alike"]);
        assert_eq!(sheet(&sheets, "ablation_init").map(|s| s.rows.len()), Some(1));
        assert_eq!(sheet(&sheets, "sizes").map(|s| s.rows[0][4].clone()), Some(Cell::Number(8.0, 2)));
    }

    /// The column with the given head, without it.
    fn column(sheet: Option<&Sheet>, head: &str) -> Vec<String> {
        let lines = sheet.map(Sheet::lines).unwrap_or_default();
        let place = lines.first().and_then(|heads| heads.iter().position(|h| h == head));
        lines.iter().skip(1).filter_map(|line| line.get(place?).cloned()).collect()
    }

    /// In every table the rival is the better plain cloud where both were measured; sizes compare the same encodings.
    #[test]
    fn the_rival_is_the_better_cloud_and_the_same_format() {
        let parts = [Part::Scene, Part::Failure, Part::Scaling, Part::Differences];
        let of_part = |part| {
            let mut scene = scene("a", part, &[0.0]);
            let row = |name: &str, psnr, file_bytes| Row { name: name.into(), psnr, file_bytes, ..Row::default() };
            scene.seeds[0].rows.extend([
                row(names::AT_ONCE, 29.75, 0),
                row(names::OURS_F16, 29.9, 0),
                row(names::SAME_BYTES, 28.9, 0),
                row(names::SAME_TIME_SMALL, 28.9, 900),
                row(names::OURS_SMALL, 29.9, 600),
            ]);
            scene
        };
        let sheets = all(&parts.map(of_part));
        for (key, head) in [
            ("scenes", "best 3DGS"),
            ("failure", "against best 3DGS"),
            ("scaling", "against best 3DGS"),
            ("differences", "best 3DGS"),
        ] {
            assert_eq!(column(sheet(&sheets, key), head), ["0.25"], "{key}");
            assert_eq!(column(sheet(&sheets, key), "best of"), ["both"], "{key}");
        }
        for key in ["scenes", "differences"] {
            assert_eq!(column(sheet(&sheets, key), "same bytes (f16)"), ["1.00"], "{key}");
        }
        assert_eq!(column(sheet(&sheets, "scenes"), "same time"), ["1.00"]);
        assert_eq!(column(sheet(&sheets, "sizes"), "small x small"), ["1.50"]);
    }

    #[test]
    fn a_figure_that_one_scene_lacks_is_left_empty() {
        let mut scenes = vec![scene("a", Part::Scene, &[0.0]), scene("b", Part::Scene, &[0.0])];
        scenes.push(scene("d", Part::Scene, &[0.3]));
        scenes[1].seeds[0].rows[1].psnr_in_masks = Some(20.0);
        let sheets = all(&scenes);
        let methods = sheet(&sheets, "methods_synthetic").map(|s| &s.rows[1][2]);
        assert_eq!(methods, Some(&Cell::Empty));
        // With three scenes there is a row of medians.
        let lines = sheet(&sheets, "scenes").map(Sheet::lines).unwrap_or_default();
        assert_eq!(lines[4][..3], ["median", "30.00", "1.00"]);
    }
}
