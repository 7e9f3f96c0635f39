//! Masks from boxes on a synthetic cloud whose objects are known: three balls on the ground, close enough that their boxes
//! overlap in pictures.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::PathBuf;

use glam::{DQuat, DVec3};
use instgs_io::masks::Mask;
use instgs_io::{MaskFolder, Split, View, write_mask};
use instgs_objects::segment::boxes::{BoxSource, draw_masks};
use instgs_objects::segment::{BoxMasks, BoxOptions, SegmentError, masks_from_boxes};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Boxes, Camera, Gaussians, InstancedScene, ObjectBox, ViewBox};

use crate::common::gpu::{assert_silent, gpu};

/// Ids of the balls: sparse, and not in order.
const BALLS: [u16; 3] = [300, 5, 20_000];
const RADIUS: f64 = 0.5;
const SIZE: (u32, u32) = (120, 90);
const VIEWS: usize = 12;
/// Gaussians of a ball, all at its surface.
const OF_BALL: usize = 500;

struct Synthetic {
    cloud: InstancedScene,
    /// By Gaussian: id, 0 = ground.
    labels: Vec<u16>,
    views: Vec<View>,
}

fn middle(ball: usize) -> DVec3 {
    let turn = TAU * ball as f64 / 3.0;
    DVec3::new(0.75 * turn.cos(), 0.75 * turn.sin(), RADIUS)
}

fn synthetic() -> Synthetic {
    let mut rng = Rng::new(3);
    let mut places: Vec<DVec3> = Vec::new();
    for ball in 0..BALLS.len() {
        places.extend((0..OF_BALL).map(|_| middle(ball) + RADIUS * rng.unit_vector()));
    }
    places.extend((0..3000).map(|_| DVec3::new(rng.range(-2.5, 2.5), rng.range(-2.5, 2.5), -0.03)));
    let mut labels: Vec<u16> = BALLS.iter().flat_map(|&id| [id; OF_BALL]).collect();
    labels.resize(places.len(), 0);
    let mut cloud = Gaussians::with_capacity(0, places.len());
    for place in places {
        cloud.means.push(place.as_vec3().to_array());
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([0.04f32.ln(); 3]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([0.0; 3]);
    }
    let view = |i: usize| {
        let turn = TAU * (i as f64 + 0.3) / VIEWS as f64;
        let height = if i.is_multiple_of(2) { 1.2 } else { 2.5 };
        let eye = DVec3::new(3.6 * turn.cos(), 3.6 * turn.sin(), height);
        let camera = Camera::look_at(&format!("view_{i}"), eye, DVec3::new(0.0, 0.0, 0.4), DVec3::Z, 0.8, SIZE);
        View { camera, image_path: PathBuf::new(), split: Split::Train, distortion: None, mask_path: None }
    };
    Synthetic { cloud: InstancedScene::from_cloud(cloud), labels, views: (0..VIEWS).map(view).collect() }
}

impl Synthetic {
    /// The box around a ball in a view.
    fn view_box(&self, view: usize, ball: usize, with_id: bool) -> ViewBox {
        let camera = &self.views[view].camera;
        let of_ball = self.labels.iter().zip(&self.cloud.background.means).filter(|(id, _)| **id == BALLS[ball]);
        let mut box_px = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for (_, mean) in of_ball {
            let [x, y] = camera.pixel_of(DVec3::from_array(mean.map(f64::from))).unwrap();
            box_px = [box_px[0].min(x), box_px[1].min(y), box_px[2].max(x), box_px[3].max(y)];
        }
        // Gaussians are seen for two deviations of a pixel and a half.
        box_px = [box_px[0] - 3.0, box_px[1] - 3.0, box_px[2] + 3.0, box_px[3] + 3.0];
        let id = with_id.then_some(u32::from(BALLS[ball]));
        ViewBox { id, category: Some("ball".into()), score: None, box_px }
    }

    fn boxes(&self, with_id: bool, is_there: impl Fn(usize, usize) -> bool) -> Boxes {
        let of_view = |view: usize| {
            let list = (0..BALLS.len()).filter(|&ball| is_there(view, ball));
            (self.views[view].camera.name.clone(), list.map(|ball| self.view_box(view, ball, with_id)).collect())
        };
        Boxes { views: (0..VIEWS).map(of_view).collect(), ..Boxes::default() }
    }

    fn run(&self, boxes: &Boxes, options: &BoxOptions) -> Result<(BoxMasks, Vec<Mask>), SegmentError> {
        let gpu = gpu().unwrap();
        let mut masks = Vec::new();
        let mut steps = Vec::new();
        let sink = |view: usize, mask: &Mask| {
            assert_eq!(view, masks.len(), "masks come in order");
            masks.push(mask.clone());
            Ok(())
        };
        let progress = |at: instgs_objects::segment::LabelProgress| {
            steps.push((at.done, at.total));
            Ok(())
        };
        let found = masks_from_boxes(&gpu, &self.cloud, &self.views, boxes, options, sink, progress)?;
        let total = steps.last().map_or(0, |step| step.1);
        assert_eq!(steps, (1..=total).map(|done| (done, total)).collect::<Vec<_>>());
        Ok((found, masks))
    }

    /// Masks of labels, as good as masks of this cloud can be.
    fn drawn(&self, labels: &[u16]) -> Vec<Mask> {
        let mut masks = Vec::new();
        let keep = |_: usize, mask: &Mask| {
            masks.push(mask.clone());
            Ok::<_, SegmentError>(())
        };
        draw_masks(&gpu().unwrap(), &self.cloud, labels, &self.views, None, &BoxOptions::default().render, keep)
            .unwrap();
        masks
    }

    fn right(&self, labels: &[u16]) -> f64 {
        let right = self.labels.iter().zip(labels).filter(|(a, b)| a == b).count();
        right as f64 / labels.len() as f64
    }

    /// Gaussians of the ground that have a label.
    fn ground(&self, labels: &[u16]) -> usize {
        self.labels.iter().zip(labels).filter(|(known, label)| **known == 0 && **label != 0).count()
    }
}

/// Mean over ids of common pixels by those of either.
fn overlap(truth: &[Mask], found: &[Mask]) -> f64 {
    let pixels = |id: u16| {
        let pairs = truth.iter().zip(found).flat_map(|(a, b)| a.ids.iter().zip(&b.ids));
        pairs.fold((0, 0), |(both, either), (a, b)| {
            (both + usize::from(*a == id && *b == id), either + usize::from(*a == id || *b == id))
        })
    };
    BALLS.iter().map(|&id| pixels(id)).map(|(both, either)| both as f64 / either as f64).sum::<f64>() / 3.0
}

#[test]
fn boxes_with_ids_carve_the_objects() {
    let Some(gpu) = gpu() else { return };
    let synthetic = synthetic();
    // Two views have no boxes, and the second ball none in three more.
    let boxes = synthetic.boxes(true, |view, ball| view > 1 && (ball != 1 || view > 4));
    let (found, masks) = synthetic.run(&boxes, &BoxOptions::default()).unwrap();
    let truth = synthetic.drawn(&synthetic.labels);
    let (right, overlap_px) = (synthetic.right(&found.labels), overlap(&truth, &masks));
    println!("right {right:.4}, masks {overlap_px:.3}, ground {}", synthetic.ground(&found.labels));
    assert!(right >= 0.97 && overlap_px >= 0.93, "{right} {overlap_px}");
    let objects = &found.report.objects;
    assert_eq!(objects.iter().map(|o| o.id).collect::<Vec<_>>(), [5, 300, 20_000]);
    assert_eq!(objects.iter().map(|o| o.boxes).collect::<Vec<_>>(), [7, 10, 10]);
    assert!(objects.iter().all(|o| o.source == BoxSource::Photos && o.views == VIEWS && o.support.is_some()));
    assert_eq!(found.categories, BALLS.iter().map(|&id| (u32::from(id), "ball".into())).collect());
    assert!(found.report.notes.is_empty(), "{:?}", found.report.notes);
    assert_eq!(masks.iter().filter(|m| (m.width, m.height) == SIZE).count(), VIEWS);

    let (with_ground, _) =
        synthetic.run(&boxes, &BoxOptions { leave_out_support: false, ..BoxOptions::default() }).unwrap();
    let [left, all] = [&found, &with_ground].map(|f| synthetic.ground(&f.labels));
    assert!(left * 4 < all, "{left} of {all} Gaussians of the ground are left");
    let half = BoxOptions { width: Some(60), ..BoxOptions::default() };
    let (carved_small, masks) = synthetic.run(&boxes, &half).unwrap();
    let right = synthetic.right(&carved_small.labels);
    assert!(right >= 0.94 && masks[0].width == SIZE.0, "at half the width: {right}");
    assert_silent(&gpu);
}

#[test]
fn boxes_without_ids_are_joined_first() {
    let Some(gpu) = gpu() else { return };
    let synthetic = synthetic();
    let mut boxes = synthetic.boxes(false, |view, ball| !(view + 5 * ball).is_multiple_of(10));
    // A box that no other view agrees with, and one of another kind where a ball is.
    let stray = ViewBox { id: None, category: Some("ball".into()), score: None, box_px: [2.0, 2.0, 9.0, 7.0] };
    let other = ViewBox { category: Some("cone".into()), ..synthetic.view_box(3, 1, false) };
    boxes.views.get_mut("view_3").unwrap().extend([stray, other]);
    let (found, masks) = synthetic.run(&boxes, &BoxOptions::default()).unwrap();
    let joined: usize = found.report.objects.iter().map(|o| o.boxes).sum();
    assert_eq!(found.report.objects.iter().map(|o| o.id).collect::<Vec<_>>(), [1, 2, 3], "{:?}", found.report);
    assert!(found.report.objects.iter().all(|o| o.source == BoxSource::Joined));
    let all: usize = boxes.views.values().map(Vec::len).sum();
    let note = found.report.notes.join(" ");
    assert!(joined + 4 >= all && joined <= all - 2, "{joined} of {all}");
    assert!(note.contains(&format!("{} boxes without an id", all - joined)), "{note}");
    // In the ids of the truth: each found one is the ball that has most of its Gaussians.
    let mut ball_of: BTreeMap<u16, BTreeMap<u16, usize>> = BTreeMap::new();
    for (&label, &known) in found.labels.iter().zip(&synthetic.labels).filter(|(label, _)| **label != 0) {
        *ball_of.entry(label).or_default().entry(known).or_default() += 1;
    }
    let renamed = |id: u16| ball_of.get(&id).map_or(0, |n| *n.iter().max_by_key(|(_, n)| **n).unwrap().0);
    let labels: Vec<u16> = found.labels.iter().map(|&id| renamed(id)).collect();
    let masks: Vec<Mask> =
        masks.into_iter().map(|m| Mask { ids: m.ids.iter().map(|&id| renamed(id)).collect(), ..m }).collect();
    let truth = synthetic.drawn(&synthetic.labels);
    let (right, overlap_px) = (synthetic.right(&labels), overlap(&truth, &masks));
    println!("{joined} of {all} boxes joined; right {right:.4}, masks {overlap_px:.3}");
    assert!(right >= 0.97 && overlap_px >= 0.93, "{right} {overlap_px}");
    assert_silent(&gpu);
}

/// A box as a person draws it: larger than the ball, and into the ground.
fn world_box(ball: usize) -> ObjectBox {
    ObjectBox {
        id: u32::from(BALLS[ball]),
        category: None,
        center: middle(ball) - DVec3::Z * 0.1,
        size: DVec3::new(1.3, 1.25, 1.4),
        world_from_box: DQuat::from_rotation_z(TAU * ball as f64 / 3.0),
    }
}

#[test]
fn boxes_in_the_world_take_what_is_in_them_but_the_ground() {
    let Some(gpu) = gpu() else { return };
    let synthetic = synthetic();
    let objects: Vec<ObjectBox> = (0..BALLS.len()).map(world_box).collect();
    let boxes = Boxes { objects, ..Boxes::default() };
    let (found, masks) = synthetic.run(&boxes, &BoxOptions::default()).unwrap();
    let truth = synthetic.drawn(&synthetic.labels);
    let (right, overlap_px) = (synthetic.right(&found.labels), overlap(&truth, &masks));
    println!("right {right:.4}, masks {overlap_px:.3}, ground {}", synthetic.ground(&found.labels));
    assert!(right >= 0.98 && overlap_px >= 0.95, "{right} {overlap_px}");
    assert!(found.report.objects.iter().all(|o| o.source == BoxSource::World && o.support.is_some_and(|n| n > 20)));
    assert!(found.categories.is_empty() && found.report.notes.is_empty(), "{:?}", found.report);

    let options = BoxOptions { leave_out_support: false, ..BoxOptions::default() };
    let (with_ground, _) = synthetic.run(&boxes, &options).unwrap();
    let [left, all] = [&found, &with_ground].map(|f| synthetic.ground(&f.labels));
    assert!(left == 0 && all > 100, "{left} of {all} Gaussians of the ground are left");

    // Boxes in photos say nothing new of an object that has one in the world; another object may have only those.
    let mut mixed = synthetic.boxes(true, |_, ball| ball < 2);
    mixed.objects = vec![world_box(0)];
    let (found, _) = synthetic.run(&mixed, &BoxOptions::default()).unwrap();
    let sources: Vec<(u32, BoxSource)> = found.report.objects.iter().map(|o| (o.id, o.source)).collect();
    assert_eq!(sources, [(5, BoxSource::Photos), (300, BoxSource::World)]);
    assert!(found.report.notes[0].starts_with("12 boxes in photos are of objects that have a box in the world"));
    assert_silent(&gpu);
}

#[test]
fn what_boxes_do_not_give_is_said() {
    let Some(gpu) = gpu() else { return };
    let synthetic = synthetic();
    let text = |boxes: &Boxes| synthetic.run(boxes, &BoxOptions::default()).unwrap_err().to_string();
    assert_eq!(text(&Boxes::default()), "no box is of an object in the world or in the views");
    let somewhere = synthetic.view_box(0, 0, true);
    let elsewhere = Boxes { views: [("photo_1".into(), vec![somewhere.clone()])].into(), ..Boxes::default() };
    assert!(text(&elsewhere).contains("photo_1"), "{}", text(&elsewhere));
    let mut bad = synthetic.boxes(true, |_, _| true);
    let outside = ViewBox { id: Some(8), box_px: [120.0, 3.0, 140.0, 9.0], ..somewhere.clone() };
    let sky = ViewBox { id: Some(9), box_px: [0.0, 0.0, 3.0, 3.0], ..somewhere };
    bad.views.get_mut("view_0").unwrap().extend([outside, sky]);
    bad.views.extend(elsewhere.views);
    bad.objects = vec![ObjectBox { id: 77, center: DVec3::new(0.0, 0.0, 50.0), ..world_box(0) }];
    let (found, _) = synthetic.run(&bad, &BoxOptions::default()).unwrap();
    let notes = found.report.notes.join("\n");
    for want in [
        "view view_0: the box [120",
        "1 boxes belong to 1 views",
        "photo_1",
        "object 77: no Gaussian",
        "object 9 (ball)",
    ] {
        assert!(notes.contains(want), "{notes}\nlacks {want}");
    }
    let options = BoxOptions { inside_part: 0.0, ..BoxOptions::default() };
    assert!(synthetic.run(&bad, &options).unwrap_err().to_string().starts_with("inside_part: 0"));
    assert_silent(&gpu);
}

/// Masks lie over the photos, so they have the photos' distortion; taking it away gives the pinhole's picture again.
#[test]
fn masks_of_distorted_photos_are_distorted() {
    let Some(gpu) = gpu() else { return };
    let mut synthetic = synthetic();
    let straight = synthetic.drawn(&synthetic.labels);
    let lens = Distortion { k1: -0.6, k2: 0.3, p1: 0.002, p2: -0.001, k3: 0.0, fisheye: None };
    synthetic.views.iter_mut().for_each(|view| view.distortion = Some(lens));
    let bent = synthetic.drawn(&synthetic.labels);
    let folder = tempfile::tempdir().unwrap();
    for (view, mask) in synthetic.views.iter().zip(&bent) {
        write_mask(&folder.path().join(format!("{}.png", view.camera.name)), mask).unwrap();
    }
    let masks = MaskFolder::open(folder.path(), &synthetic.views).unwrap();
    let again: Vec<Mask> = synthetic.views.iter().map(|view| masks.of_view(view).unwrap().unwrap()).collect();
    let overlaps = [&bent, &again].map(|masks| overlap(&straight, masks));
    println!("against the pinhole's: {:.3} distorted, {:.3} undistorted again", overlaps[0], overlaps[1]);
    assert!(overlaps[0] < 0.95 && overlaps[1] > 0.97, "{overlaps:?}");
    assert_silent(&gpu);
}
