//! The f64 backward twins against central differences of the f64 renderer, over random instanced scenes, and proof that
//! this can fail.

use crate::common::random_scene::{RandomCase, rare_case};
use glam::{DVec2, DVec3};
use instgs_reference::finite_diff::{Cloud, FiniteDifferences, Tensor};
use instgs_reference::gather_gradients::{SceneGradient, scene_gradient, source_gradients};
use instgs_reference::preprocess_instance_expand::{CullLimits, sources};
use instgs_reference::preprocess_instance_expand_backward::projection_branches;
use instgs_reference::tile_blend::{ALPHA_MAX, blend_row_with_pairs, candidate_boxes};
use instgs_reference::{View, render_sources, splats_in_depth_order};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Parameter;

/// Seeds of `rare_case`; half of them have antialiasing.
const SEEDS: std::ops::Range<u64> = 0..30;
/// Entries of every tensor that are drawn per seed: half from all of it, half from where the twin's gradient is not 0.
const ENTRIES: usize = 40;
/// An error is relative to the entry, or to this fraction of the tensor's largest gradient if that is more: what
/// cancels to less has no more digits than that in a difference.
const FLOOR: f64 = 1e-3;

/// A case in f64 with cotangents: normal, 0 on pixels that are not robust.
struct Setup {
    case: RandomCase,
    view: View,
    cotangents: Vec<[f64; 4]>,
}

impl Setup {
    fn new(seed: u64) -> Self {
        let mut case = rare_case(seed);
        // Opaque enough that alpha meets its clamp and pixels end; left alone, the seeds below hold no clamped pair.
        case.scene.templates.opacity_logits.iter_mut().step_by(2).for_each(|logit| *logit += 6.0);
        let view = View::exact(&case.camera, &case.options);
        let mut rng = Rng::new(1000 + seed);
        let robust = render_sources(&sources(&case.scene), &view).robust;
        let cotangents =
            robust.iter().map(|&robust| [(); 4].map(|()| if robust { rng.normal() } else { 0.0 })).collect();
        Self { case, view, cotangents }
    }
}

/// What came out of one tensor.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    checked: usize,
    skipped: usize,
    worst: f64,
}

/// Compares `gradient` with central differences in `entries` entries of each of the tensors.
fn compare(setup: &Setup, gradient: &SceneGradient, tensors: &[Tensor], entries: usize) -> Vec<Tally> {
    let differences = FiniteDifferences::new(&setup.case.scene, &setup.view, &setup.cotangents);
    let mut rng = Rng::new(2000 + setup.case.seed);
    let tally_of = |&tensor: &Tensor| {
        let got = tensor.of(gradient);
        let largest = got.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let nonzero: Vec<usize> = (0..got.len()).filter(|&i| got[i] != 0.0).collect();
        let mut tally = Tally::default();
        for draw in 0..entries {
            let index = match draw % 2 {
                0 if !got.is_empty() => rng.index(got.len()),
                1 if !nonzero.is_empty() => nonzero[rng.index(nonzero.len())],
                _ => continue,
            };
            match differences.derivative(tensor, index) {
                Some(want) if want != got[index] => {
                    tally.checked += 1;
                    tally.worst = tally.worst.max((got[index] - want).abs() / want.abs().max(FLOOR * largest));
                }
                Some(_) => tally.checked += 1,
                None => tally.skipped += 1,
            }
        }
        tally
    };
    tensors.iter().map(tally_of).collect()
}

/// Worst of the seeds per tensor. Measured, of 640 to 1200 entries each: offsets of logits 4.0e-5, all others below 5e-6
/// (entries that cancel to the floor, where rounding shows, and splats just behind the near plane, where the step is long);
/// none skipped.
#[test]
fn twins_agree_with_central_differences() {
    let mut sums = [Tally::default(); Tensor::ALL.len()];
    for seed in SEEDS {
        let setup = Setup::new(seed);
        let gradient = scene_gradient(&setup.case.scene, &setup.view, &setup.cotangents);
        for (sum, tally) in sums.iter_mut().zip(compare(&setup, &gradient, &Tensor::ALL, ENTRIES)) {
            sum.checked += tally.checked;
            sum.skipped += tally.skipped;
            sum.worst = sum.worst.max(tally.worst);
        }
    }
    for (tensor, tally) in Tensor::ALL.iter().zip(sums) {
        assert!(tally.checked >= 500 && tally.skipped * 100 <= tally.checked, "{tensor:?}: {tally:?}");
        assert!(tally.worst <= 1e-4, "{tensor:?}: {tally:?}");
    }
}

/// The seeds above hold what is difficult, in Gaussians that contribute to the loss. Measured: 16 seeds with antialiasing,
/// 68 Gaussians with a clamped slope, 29 with the compensation at its floor, 1447 with a clamped channel, 60 pairs with a
/// clamped alpha.
#[test]
fn the_seeds_cover_every_clamp() {
    let (mut antialias, mut slope, mut floor, mut channel, mut alpha) = (0, 0, 0, 0, 0);
    for seed in SEEDS {
        let Setup { case, view, cotangents } = Setup::new(seed);
        antialias += usize::from(case.options.antialias);
        let all = sources(&case.scene);
        for (source, gradient) in all.iter().zip(source_gradients(&all, &view, &cotangents)) {
            if gradient.is_some_and(|g| g.sh.iter().any(|c| *c != DVec3::ZERO)) {
                let branches = projection_branches(&view, source);
                slope += usize::from(branches.slope_clamped.contains(&true));
                floor += usize::from(branches.compensation_floored);
                channel += usize::from(branches.channel_clamped.contains(&true));
            }
        }
        let splats = splats_in_depth_order(&all, &view, &CullLimits::exact(&view));
        let boxes = candidate_boxes(&view, &splats);
        let rows = (0..view.height).flat_map(|y| blend_row_with_pairs(&view, &splats, &boxes, y));
        alpha += rows.flat_map(|(_, pairs)| pairs).filter(|pair| pair.alpha_raw > ALPHA_MAX).count();
    }
    assert!((10..=20).contains(&antialias), "antialias in {antialias} of 30");
    assert!(slope >= 50 && floor >= 5 && channel >= 500, "slope {slope}, floor {floor}, channel {channel}");
    assert!(alpha >= 50, "{alpha} pairs with a clamped alpha");
}

fn true_gradient(setup: &Setup) -> SceneGradient {
    scene_gradient(&setup.case.scene, &setup.view, &setup.cotangents)
}

/// What the paper's public code does: the template gets the mean over its instances instead of the sum.
fn averaged_over_instances(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    let scene = &setup.case.scene;
    for (t, range) in scene.template_ranges.iter().enumerate() {
        let users = scene.instances.iter().filter(|instance| instance.template as usize == t).count() as f64;
        for i in range.first as usize..(range.first + range.count) as usize {
            out.templates.means[i] = out.templates.means[i].map(|v| v / users);
            out.templates.opacity_logits[i] /= users;
        }
    }
    out
}

/// Without A^T, that is in the world's frame.
fn offsets_in_the_world_frame(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    let scene = &setup.case.scene;
    for instance in &scene.instances {
        let range = scene.template_ranges[instance.template as usize];
        let back = instance.world_from_template.linear().transpose().inverse();
        for i in instance.first_offset.map_or(0..0, |first| first..first + range.count) {
            let gradient = &mut out.per_instance[Parameter::OffsetMeans].as_chunks_mut::<3>().0[i as usize];
            *gradient = (back * DVec3::from_array(*gradient)).to_array();
        }
    }
    out
}

/// Turned by the instance's rotation, that is by the world's axes.
fn poses_in_the_world_frame(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    for (instance, pose) in setup.case.scene.instances.iter().zip(&mut out.poses) {
        let turned = instance.world_from_template.rotation() * DVec3::new(pose[3], pose[4], pose[5]);
        pose[3..6].copy_from_slice(&turned.to_array());
    }
    out
}

/// dL/dA by columns.
fn transposed_transforms(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    for rows in &mut out.instances {
        let [[_, b, c, _], [d, _, f, _], [g, h, _, _]] = *rows;
        (rows[0][1], rows[0][2], rows[1][0], rows[1][2], rows[2][0], rows[2][1]) = (d, g, b, h, c, f);
    }
    out
}

/// Offsets that are not trained.
fn no_offset_logits(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    out.per_instance[Parameter::OffsetOpacityLogits].fill(0.0);
    out
}

/// The Jacobian's clamp forgotten.
fn slopes_not_clamped(setup: &Setup) -> SceneGradient {
    let view = View { slope_min: DVec2::NEG_INFINITY, slope_max: DVec2::INFINITY, ..setup.view.clone() };
    scene_gradient(&setup.case.scene, &view, &setup.cotangents)
}

/// The compensation left out, or put in.
fn compensation_switched(setup: &Setup) -> SceneGradient {
    let mut view = setup.view.clone();
    view.options.antialias = !view.options.antialias;
    scene_gradient(&setup.case.scene, &view, &setup.cotangents)
}

/// The quaternion's length forgotten.
fn unit_quaternions(setup: &Setup) -> SceneGradient {
    let mut out = true_gradient(setup);
    for (gradient, quat) in out.templates.quats.iter_mut().zip(&setup.case.scene.templates.quats) {
        let length = quat.iter().map(|c| c * c).sum::<f32>().sqrt();
        *gradient = gradient.map(|v| v * f64::from(length));
    }
    out
}

/// Wrong in one respect each, a gradient must be told apart, in the tensors named, in scenes that can show it.
/// Measured, of 10 seeds, in the order below: 0, 7, 9, 10, 8, 4, 10, 10, 10. (Some scenes have no template twice, no
/// offsets, or nothing beside the picture.)
#[test]
fn the_comparison_fails_on_planted_errors() {
    const CLOUD: Cloud = Cloud::Templates;
    type Plant = (&'static str, &'static [Tensor], fn(&Setup) -> SceneGradient);
    let plants: [Plant; 9] = [
        ("nothing", &Tensor::ALL, true_gradient),
        ("average", &[Tensor::Means(CLOUD), Tensor::OpacityLogits(CLOUD)], averaged_over_instances),
        ("world frame", &[Tensor::PerInstance(Parameter::OffsetMeans)], offsets_in_the_world_frame),
        ("transposed", &[Tensor::WorldFromTemplate], transposed_transforms),
        ("offset logits", &[Tensor::PerInstance(Parameter::OffsetOpacityLogits)], no_offset_logits),
        ("slopes", &[Tensor::LogScales(CLOUD)], slopes_not_clamped),
        ("compensation", &[Tensor::LogScales(CLOUD)], compensation_switched),
        ("quaternion", &[Tensor::Quats(CLOUD)], unit_quaternions),
        ("poses", &[Tensor::Poses], poses_in_the_world_frame),
    ];
    let setups: Vec<Setup> = (0..10).map(Setup::new).collect();
    let seen = |(_, tensors, plant): &Plant| {
        let wrong = |setup: &&Setup| {
            let tallies = compare(setup, &plant(setup), tensors, 12);
            tallies.iter().any(|tally| tally.worst > 1e-4)
        };
        setups.iter().filter(wrong).count()
    };
    let counts = plants.each_ref().map(seen);
    assert!(counts[0] == 0 && counts[1..].iter().all(|&count| count >= 2), "{counts:?}");
}
