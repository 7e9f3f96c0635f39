//! How good masks from boxes are: boxes are made from a data set's true masks, the plain cloud of a trained run is carved
//! by them, and the masks of it are compared with the true ones:
//! `cargo run --release --example masks_from_boxes -- DATA PLY [OUT] [--world] [--no-ids] [--missing=0.1] [--jitter=0.05]
//! [--views=5] [--no-support]`.
//!
//! DATA has masks whose ids are the same in all views; PLY is a cloud trained on it. With OUT the masks are left there.
//! `--world` takes boxes in the world instead (around the Gaussians that the true masks label, a tenth larger and to
//! below the ground), `--no-ids` boxes without ids, `--missing` leaves out a part of them, `--jitter` moves every edge by
//! up to a part of the box's size, `--views` has boxes in so many views only.

#![allow(clippy::print_stdout, reason = "an example prints")]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use instgs_vk::gpu::{Gpu, GpuOptions};
use instgs_vk::io::masks::Mask;
use instgs_vk::io::{MaskFolder, Split, View, load_scene, read_views, write_boxes, write_mask};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Boxes, Camera, InstancedScene, ObjectBox, ViewBox};
use instgs_vk::segment::boxes::draw_masks;
use instgs_vk::segment::{BoxOptions, LabelOptions, SegmentError, label, masks_from_boxes};

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Objects of fewer pixels in a view get no box there.
const LEAST_PIXELS: usize = 12;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let flag = |name: &str| arguments.iter().any(|a| a == name);
    let number = |name: &str| -> Option<f64> { arguments.iter().find_map(|a| a.strip_prefix(name)?.parse().ok()) };
    let paths: Vec<&Path> = arguments.iter().filter(|a| !a.starts_with("--")).map(Path::new).collect();
    let cloud = load_scene(paths[1])?.scene;
    let views: Vec<View> = read_views(paths[0])?.split(Split::Train).cloned().collect();
    let folder = MaskFolder::open(&paths[0].join("masks"))?;
    let masks =
        views.iter().map(|v| folder.of_view(v)?.ok_or("a view has no mask".into())).collect::<Outcome<Vec<Mask>>>()?;
    let gpu = Gpu::open(&GpuOptions::default())?;
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera.clone()).collect();
    let of_view = |v: usize| Ok::<_, SegmentError>(Some(masks[v].clone()));
    let truth = label(&gpu, &cloud, &cameras, of_view, &LabelOptions::default(), |_| Ok(()))?.instance_of_gaussian;

    let boxes = if flag("--world") {
        Boxes { objects: world_boxes(&cloud, &truth, &folder.categories), ..Boxes::default() }
    } else {
        let mut rng = Rng::new(7);
        let (missing, jitter) = (number("--missing=").unwrap_or(0.0), number("--jitter=").unwrap_or(0.0));
        let every = number("--views=").map_or(1, |count| (views.len() as f64 / count).ceil() as usize);
        let mut of_views = BTreeMap::new();
        for (view, mask) in views.iter().zip(&masks).step_by(every) {
            let mut list = view_boxes(mask, &folder.categories, !flag("--no-ids"));
            list.retain(|_| !rng.chance(missing));
            list.iter_mut().for_each(|b| b.box_px = jittered(b.box_px, jitter, &mut rng));
            of_views.insert(view.camera.name.clone(), list);
        }
        Boxes { views: of_views, ..Boxes::default() }
    };

    let mut bound = Overlaps::default();
    let labels: Vec<u16> = truth.iter().map(|&label| label as u16).collect();
    let options = BoxOptions { leave_out_support: !flag("--no-support"), ..BoxOptions::default() };
    draw_masks::<SegmentError>(&gpu, &cloud, &labels, &views, options.width, &options.render, |v, mask| {
        bound.add(&masks[v], mask);
        Ok(())
    })?;
    bound.print("true labels");

    let mut found = Overlaps::default();
    let mut drawn = Vec::new();
    let result = masks_from_boxes::<SegmentError>(
        &gpu,
        &cloud,
        &views,
        &boxes,
        &options,
        |v, mask| {
            found.add(&masks[v], mask);
            drawn.push(mask.clone());
            Ok(())
        },
        |_| Ok(()),
    )?;
    found.print("from boxes");
    let right = truth.iter().zip(&result.labels).filter(|(a, b)| **a != 0 && **a == u32::from(**b)).count();
    let either = truth.iter().zip(&result.labels).filter(|(a, b)| **a != 0 || **b != 0).count();
    println!("Gaussians: {right} of {either} as by true masks");
    for object in &result.report.objects {
        println!("{object:?}");
    }
    result.report.notes.iter().for_each(|note| println!("note: {note}"));
    println!("{:.1} s", result.report.seconds);
    if let Some(out) = paths.get(2) {
        write(out, &views, &drawn, &boxes)?;
    }
    Ok(())
}

/// Boxes around the pixels of every id.
fn view_boxes(mask: &Mask, categories: &BTreeMap<u32, String>, with_ids: bool) -> Vec<ViewBox> {
    let mut found: BTreeMap<u16, ([f64; 4], usize)> = BTreeMap::new();
    for (i, &id) in mask.ids.iter().enumerate().filter(|(_, id)| **id != 0) {
        let (x, y) = ((i % mask.width as usize) as f64, (i / mask.width as usize) as f64);
        let (b, count) = found.entry(id).or_insert(([x, y, x, y], 0));
        *b = [b[0].min(x), b[1].min(y), b[2].max(x + 1.0), b[3].max(y + 1.0)];
        *count += 1;
    }
    let large = found.into_iter().filter(|(_, (_, count))| *count >= LEAST_PIXELS);
    large
        .map(|(id, (box_px, _))| ViewBox {
            id: with_ids.then_some(u32::from(id)),
            category: categories.get(&u32::from(id)).cloned(),
            score: None,
            box_px,
        })
        .collect()
}

fn jittered(b: [f64; 4], part: f64, rng: &mut Rng) -> [f64; 4] {
    let size = [b[2] - b[0], b[3] - b[1]];
    std::array::from_fn(|k| b[k] + if part > 0.0 { rng.range(-part, part) * size[k % 2] } else { 0.0 })
}

/// Boxes along the world's axes around what the true masks label, strays left out.
fn world_boxes(cloud: &InstancedScene, truth: &[u32], categories: &BTreeMap<u32, String>) -> Vec<ObjectBox> {
    let means = &cloud.background.means;
    let of_object = |(&id, category): (&u32, &String)| {
        let own: Vec<[f32; 3]> = means.iter().zip(truth).filter(|(_, label)| **label == id).map(|(m, _)| *m).collect();
        let bound = |k: usize, part: f64| {
            let mut values: Vec<f32> = own.iter().map(|mean| mean[k]).collect();
            values.sort_by(f32::total_cmp);
            f64::from(values[((values.len() - 1) as f64 * part) as usize])
        };
        let low = DVec3::from_array([0, 1, 2].map(|k| bound(k, 0.01)));
        let high = DVec3::from_array([0, 1, 2].map(|k| bound(k, 0.99)));
        let size = 1.1 * (high - low);
        Some(ObjectBox {
            id,
            category: Some(category.clone()),
            center: 0.5 * (low + high),
            size,
            world_from_box: DQuat::IDENTITY,
        })
        .filter(|_| own.len() > 1)
    };
    categories.iter().filter_map(of_object).collect()
}

fn write(out: &Path, views: &[View], masks: &[Mask], boxes: &Boxes) -> Outcome<()> {
    let masks_folder: PathBuf = out.join("masks");
    std::fs::create_dir_all(&masks_folder)?;
    write_boxes(&out.join("boxes.json"), boxes)?;
    for (view, mask) in views.iter().zip(masks) {
        write_mask(&masks_folder.join(format!("{}.png", view.camera.name)), mask)?;
    }
    Ok(())
}

/// Pixels that true and found ids have in common.
#[derive(Default)]
struct Overlaps {
    common: BTreeMap<(u16, u16), u64>,
}

impl Overlaps {
    fn add(&mut self, truth: &Mask, found: &Mask) {
        for (&known, &id) in truth.ids.iter().zip(&found.ids) {
            *self.common.entry((known, id)).or_default() += 1;
        }
    }

    /// Intersection by union of every true id and the id that most of its pixels have, over all views.
    fn print(&self, what: &str) {
        let sum = |of: &dyn Fn(u16, u16) -> bool| -> u64 {
            self.common.iter().filter(|((a, b), _)| of(*a, *b)).map(|(_, n)| n).sum()
        };
        let mut ids: Vec<u16> = self.common.keys().map(|(known, _)| *known).filter(|id| *id != 0).collect();
        ids.dedup();
        let mut texts = Vec::new();
        let mut total = 0.0;
        for &id in &ids {
            let of_id = self.common.iter().filter(|((known, other), _)| *known == id && *other != 0);
            let best = of_id.max_by_key(|(_, n)| **n).map_or(0, |((_, other), _)| *other);
            let both = if best == 0 { 0 } else { sum(&|a, b| a == id && b == best) };
            let either = sum(&|a, b| a == id || (b == best && best != 0));
            total += both as f64 / either as f64;
            texts.push(format!("{:.2}", both as f64 / either as f64));
        }
        println!("{what}: mean IoU {:.3} of {} objects [{}]", total / ids.len() as f64, ids.len(), texts.join(" "));
    }
}
