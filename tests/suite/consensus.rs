//! Objects from masks whose ids differ from view to view, on clouds sampled from the true surfaces of synthetic scenes.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Quat, Vec3};
use instgs_io::masks::Mask;
use instgs_objects::segment::accuracy::{in_ids_of, mean_accuracy};
use instgs_objects::segment::{
    Consensus, ConsensusOptions, IdTable, KEPT_BYTES, LabelOptions, Labels, SegmentError, ViewContributions, consensus,
    label_views,
};
use instgs_synth::dataset::frame::Lens;
use instgs_synth::dataset::world::Point;
use instgs_synth::dataset::{Options, build};
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::scramble::{Scramble, Scrambled, scrambled};

const SIZE: (u32, u32) = (240, 135);
const VIEWS: u32 = 24;
/// A scene as its surfaces say.
struct Surfaces {
    cloud: InstancedScene,
    /// By Gaussian: object, 0 = none.
    labels: Vec<u32>,
    cameras: Vec<Camera>,
    masks: Vec<Mask>,
}

/// True masks, and one Gaussian for every cell of a grid in which a pixel shows something. `cell_sizes` are those of cells on
/// objects, and of others, over the scene's distance between lit points.
fn surfaces(name: &str, cell_sizes: [f32; 2]) -> Surfaces {
    let options = Options { views: VIEWS, size: SIZE, ..Options::default() };
    let scene = build(name, &options).unwrap();
    let cameras = scene.rig.cameras(VIEWS, SIZE, options.seed);
    let mut masks = Vec::new();
    let mut cells: BTreeMap<(u32, [i32; 3]), Point> = BTreeMap::new();
    let spacing = |id: u32| scene.light_spacing * cell_sizes[usize::from(id == 0)];
    for camera in &cameras {
        let lens = Lens::new(camera);
        let mut ids = vec![0; (SIZE.0 * SIZE.1) as usize];
        for (i, id_of_pixel) in (0..).zip(&mut ids) {
            let ray = lens.ray(f64::from(i % SIZE.0) + 0.5, f64::from(i / SIZE.0) + 0.5);
            let Some(hit) = scene.world.closest(&ray) else { continue };
            let id = scene.world.id_of(&hit);
            *id_of_pixel = id as u16;
            let point = scene.world.point(&ray, &hit, lens.footprint);
            let cell = point.position.to_array().map(|v| (v / spacing(id)).floor() as i32);
            cells.entry((id, cell)).or_insert(point);
        }
        masks.push(Mask { width: SIZE.0, height: SIZE.1, ids });
    }
    let mut cloud = Gaussians::with_capacity(0, 0);
    for (&(id, _), point) in &cells {
        cloud.means.push(point.position.to_array());
        let [x, y, z, w] = Quat::from_rotation_arc(Vec3::Z, point.normal).to_array();
        cloud.quats.push([w, x, y, z]);
        // Discs: four tenths of the spacing leave no holes, and they do not stick out over what stands before them.
        cloud.log_scales.push([0.4, 0.4, 0.04].map(|part: f32| (part * spacing(id)).ln()));
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([0.0; 3]);
    }
    let labels = cells.keys().map(|&(id, _)| id).collect();
    Surfaces { cloud: InstancedScene::from_cloud(cloud), labels, cameras, masks }
}

impl Surfaces {
    fn segment(&self, masks: &[Mask], options: &ConsensusOptions) -> (Consensus, Labels) {
        let gpu = gpu().unwrap();
        let mask_of_view = |view: usize| Ok::<_, SegmentError>(Some(masks[view].clone()));
        let render = RenderOptions::default();
        let mut views =
            ViewContributions::new(&gpu, &self.cloud, &self.cameras, mask_of_view, render, KEPT_BYTES).unwrap();
        let found = consensus(&mut views, &self.cloud.background, &BTreeMap::new(), options, |_| Ok(())).unwrap();
        let means = &self.cloud.background.means;
        let labels = label_views(&mut views, means, &found.table, &LabelOptions::default(), |_| Ok(())).unwrap();
        assert_eq!(views.rendered(), self.cameras.len(), "both use the same pictures");
        (found, labels)
    }

    /// Mean accuracy of the objects, against `truth`, over the Gaussians that the views show by more than a pixel.
    fn accuracy(&self, truth: &[u32], labels: &Labels) -> f64 {
        let seen: Vec<usize> = (0..self.labels.len()).filter(|&i| labels.weights_px[i] > 1.0).collect();
        let of = |all: &[u32]| seen.iter().map(|&i| all[i]).collect::<Vec<u32>>();
        let truth = of(truth);
        mean_accuracy(&truth, &in_ids_of(&truth, &of(&labels.instance_of_gaussian)))
    }

    /// Objects that have a mask in two views or more.
    fn objects(&self) -> BTreeSet<u16> {
        let mut views: BTreeMap<u16, usize> = BTreeMap::new();
        self.masks
            .iter()
            .flat_map(|mask| mask.ids_present().into_keys())
            .for_each(|id| *views.entry(id).or_default() += 1);
        views.into_iter().filter(|&(_, views)| views >= 2).map(|(id, _)| id).collect()
    }
}

/// By object found: the true object that most of its masks show.
fn truth_of_objects(found: &Consensus, scrambled: &Scrambled) -> Vec<u16> {
    let IdTable::PerView(table) = &found.table else { panic!("ids were kept") };
    let mut counts: BTreeMap<u16, BTreeMap<u16, usize>> = BTreeMap::new();
    for (of_id, truth) in table.iter().zip(&scrambled.truth) {
        for (id, object) in of_id {
            truth[id].iter().for_each(|&known| *counts.entry(*object).or_default().entry(known).or_default() += 1);
        }
    }
    let most = |counts: &BTreeMap<u16, usize>| counts.iter().max_by_key(|&(_, n)| n).map_or(0, |(&known, _)| known);
    counts.values().map(most).collect()
}

/// `right` is how accurate labels from the true ids are, at least. Against these, those from scrambled masks measured 0.989
/// and 0.998 on the cars, 0.917 and 0.958 in the hall.
fn every_object_is_recovered(name: &str, cell_sizes: [f32; 2], right: f64) {
    let Some(gpu) = gpu() else { return };
    let surfaces = surfaces(name, cell_sizes);
    let known: Vec<u16> = surfaces.objects().into_iter().collect();
    let of_objects = surfaces.labels.iter().filter(|&&id| id != 0).count();
    println!("{name}: {of_objects} of {} Gaussians are of objects", surfaces.labels.len());
    let (kept, of_true_ids) = surfaces.segment(&surfaces.masks, &ConsensusOptions::default());
    assert!(kept.report.ids_agree && kept.table == IdTable::Same, "{:?}", kept.report);
    let accuracy = surfaces.accuracy(&surfaces.labels, &of_true_ids);
    println!("{name}: true ids agree {:.3}, mAcc {accuracy:.4}", kept.report.agreement);
    assert!(accuracy >= right, "{accuracy}");
    for seed in 0..2 {
        let scrambled = scrambled(&surfaces.masks, Scramble::default(), seed);
        let (found, labels) = surfaces.segment(&scrambled.masks, &ConsensusOptions::default());
        let mut truth = truth_of_objects(&found, &scrambled);
        truth.sort_unstable();
        let accuracies = [&of_true_ids.instance_of_gaussian, &surfaces.labels].map(|t| surfaces.accuracy(t, &labels));
        let report = &found.report;
        println!(
            "{name} seed {seed}: {} of {} objects, agreement {:.3}, {} masks, {} merged, {} alone, mAcc {accuracies:.4?}",
            truth.len(),
            known.len(),
            report.agreement,
            report.masks,
            report.undersegmented,
            report.unassigned
        );
        assert_eq!(truth, known, "seed {seed}: every object once");
        assert!(accuracies[0] >= 0.9 && accuracies[1] >= right - 0.05, "seed {seed}: {accuracies:?}");
    }
    assert_silent(&gpu);
}

#[test]
fn every_car_is_recovered() {
    every_object_is_recovered("cars", [1.0, 6.0], 0.95);
}

/// Legs of chairs are thinner than their Gaussians are wide, which makes the labels worse, but not the objects.
#[test]
fn everything_in_the_hall_is_recovered() {
    every_object_is_recovered("hall", [0.4, 3.0], 0.75);
}
