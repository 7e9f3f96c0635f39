//! The backward passes: golden gradients, random scenes against the twin, overflow, determinism.

use std::collections::BTreeSet;

use instgs_reference::View;
use instgs_reference::finite_diff::Tensor;
use instgs_reference::gather_gradients::{CloudGradient, SceneGradient, scene_gradient};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Gaussians, InstancedScene};

use crate::common::golden::{GoldenCase, golden_cases};
use crate::common::gpu::{assert_silent, gpu};
use crate::common::gpu_gradients::GradientRunner;
use crate::common::random_scene::{RandomCase, random_case, rare_case};
use crate::common::tensor::TensorComparison;

/// Golden tensors, summed over cameras: relative L2 at most 1e-3.
fn gradients(cases: &[GoldenCase]) {
    let Some(gpu) = gpu() else { return };
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    type Values = fn(&CloudGradient) -> &[f64];
    let tensors: [(&str, Values); 5] = [
        ("means", |g| g.means.as_flattened()),
        ("quats", |g| g.quats.as_flattened()),
        ("log_scales", |g| g.log_scales.as_flattened()),
        ("opacity_logits", |g| &g.opacity_logits),
        ("sh", |g| g.sh.as_flattened()),
    ];
    let mut worst: (f64, String) = (0.0, String::new());
    for case in cases {
        let views: Vec<CloudGradient> = case
            .views
            .iter()
            .map(|v| runner.run(&case.scene, &v.camera, &v.options, &v.cotangents).gradient.background)
            .collect();
        for (name, values) in tensors {
            let sum: Vec<f64> =
                (0..values(&views[0]).len()).map(|i| views.iter().map(|view| values(view)[i]).sum()).collect();
            let comparison = TensorComparison::new(&format!("{}: {name}", case.name), &sum, values(&case.gradient));
            println!("{}: {:.2e}", comparison.name, comparison.relative_l2);
            if comparison.relative_l2 > worst.0 {
                worst = (comparison.relative_l2, comparison.name.clone());
            }
            comparison.check(1e-3).unwrap();
        }
    }
    println!("golden gradients: worst {worst:?}");
    assert_silent(&gpu);
}

#[test]
fn golden_gradients() {
    gradients(&golden_cases());
}

/// Random cotangents, zero where the twin calls a pixel fragile.
pub(crate) fn cotangents(case: &RandomCase) -> Vec<[f64; 4]> {
    let mut rng = Rng::new(case.seed).fork(77);
    let robust = instgs_reference::render(&case.scene, &case.camera, &case.options).robust;
    let draw = |rng: &mut Rng| -> [f64; 4] { std::array::from_fn(|_| f64::from(rng.normal() as f32)) };
    robust.iter().map(|&r| if r { draw(&mut rng) } else { [0.0; 4] }).collect()
}

/// All tensors but those by transforms.
pub(crate) fn compare(got: &SceneGradient, want: &SceneGradient) -> Vec<TensorComparison> {
    let tensors = Tensor::ALL.iter().filter(|t| !matches!(t, Tensor::WorldFromTemplate));
    tensors.map(|t| TensorComparison::new(&format!("{t:?}"), t.of(got), t.of(want))).collect()
}

/// A plain cloud of the same Gaussians.
fn flattened(case: &RandomCase) -> RandomCase {
    RandomCase { scene: InstancedScene::from_cloud(case.scene.flatten()), ..case.clone() }
}

/// 100 random scenes, half of them plain clouds, a quarter with rare offsets, against the twin: relative L2 per tensor at most 1e-3.
#[test]
fn random_scenes_against_the_twin() {
    let Some(gpu) = gpu() else { return };
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    let mut worst: Vec<(String, f64, u64)> = Vec::new();
    let mut failures = Vec::new();
    for seed in 0..100 {
        let case = match seed % 4 {
            0 => random_case(seed),
            2 => rare_case(seed / 4),
            _ => flattened(&random_case(seed)),
        };
        let cotangents = cotangents(&case);
        // Every fourth run starts from a buffer that is too small.
        runner.set_intersections(if seed % 4 == 3 { 1 } else { 1 << 16 });
        let view = View::device(&case.camera, &case.options);
        let want = scene_gradient(&case.scene, &view, &cotangents);
        let got = runner.run(&case.scene, &case.camera, &case.options, &cotangents);
        for comparison in compare(&got.gradient, &want) {
            match worst.iter_mut().find(|(name, ..)| *name == comparison.name) {
                Some(known) if known.1 < comparison.relative_l2 => (known.1, known.2) = (comparison.relative_l2, seed),
                Some(_) => {}
                None => worst.push((comparison.name.clone(), comparison.relative_l2, seed)),
            }
            if let Err(e) = comparison.check(1e-3) {
                failures.push(format!("seed {seed}: {e}"));
            }
        }
    }
    for (name, error, seed) in &worst {
        println!("{name}: {error:.2e} (seed {seed})");
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    assert_silent(&gpu);
}

/// In scenes with own Gaussians, the statistics of a template's Gaussian are the sum of those of its records, if every instance
/// has some. One run of records may serve two instances.
#[test]
fn statistics_of_records_add_up() {
    let Some(gpu) = gpu() else { return };
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    let mut seen = 0;
    for seed in (0..40).filter(|seed: &u64| !seed.is_multiple_of(3)) {
        let case = rare_case(seed);
        let scene = &case.scene;
        let got = runner.run(scene, &case.camera, &case.options, &cotangents(&case));
        assert!(!scene.own.is_empty() && got.record_statistics.len() == scene.offsets.len(), "seed {seed}");
        for (template, range) in scene.template_ranges.iter().enumerate() {
            let users = scene.instances.iter().filter(|i| i.template as usize == template);
            let Some(runs) = users.map(|i| i.first_offset).collect::<Option<BTreeSet<u32>>>() else { continue };
            for local in 0..range.count {
                let [sum, views, _] = got.screen_statistics[(range.first + local) as usize];
                let of_records = runs.iter().map(|first| got.record_statistics[(first + local) as usize]);
                let [by_record, in_views] = of_records.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
                assert!(
                    (sum - by_record).abs() <= 1e-5 * sum.abs() && views == in_views,
                    "seed {seed}: {sum} {by_record}"
                );
                seen += u32::from(views > 1.0);
            }
        }
    }
    assert!(seen > 100, "{seen}");
    assert_silent(&gpu);
}

/// Buffers that were too small change nothing in the result, bit by bit; nor do repeats.
#[test]
fn overflow_and_repeats_give_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let own = Variant::for_training(gpu.caps());
    for seed in [2, 9, 16] {
        let case = random_case(seed);
        let cotangents = cotangents(&case);
        let run = |runner: &mut GradientRunner| runner.run(&case.scene, &case.camera, &case.options, &cotangents);
        let mut runner = GradientRunner::new(&gpu, own);
        let want = run(&mut runner);
        assert_eq!(want.redone, 0);
        assert!(run(&mut runner).gradient == want.gradient, "seed {seed}: repeated");
        let mut small = GradientRunner::new(&gpu, own);
        small.set_intersections(1);
        let got = run(&mut small);
        assert!(got.redone > 0 && got.gradient == want.gradient, "seed {seed}: redone {} times", got.redone);
    }
    assert_silent(&gpu);
}

/// The other way to sum over lanes, tiles of several blocks, and work-groups as on GPUs agree with the twin as well.
#[test]
fn variants_agree_with_the_twin() {
    let Some(gpu) = gpu() else { return };
    let own = Variant::for_training(gpu.caps());
    for variant in [
        Variant { transpose_moments: !own.transpose_moments, ..own },
        Variant { tile_size: 16, ..own },
        Variant { stage_splats: !own.stage_splats, transpose_moments: false, backward_splats_unrolled: 2, ..own },
        Variant { blend_workgroup_size: 4 * own.subgroup_size, ..own },
        Variant { workgroup_size: 256.min(gpu.caps().max_workgroup_subgroups * own.subgroup_size), ..own },
    ] {
        let mut runner = GradientRunner::new(&gpu, variant);
        for seed in [4, 5] {
            let case = random_case(seed);
            let cotangents = cotangents(&case);
            let want = scene_gradient(&case.scene, &View::device(&case.camera, &case.options), &cotangents);
            let got = runner.run(&case.scene, &case.camera, &case.options, &cotangents);
            for comparison in compare(&got.gradient, &want) {
                comparison.check(1e-3).unwrap_or_else(|e| panic!("{variant:?}, seed {seed}: {e}"));
            }
        }
    }
    assert_silent(&gpu);
}

/// A gradient of another scene, camera or cotangent is seen.
#[test]
fn the_comparison_fails_on_planted_errors() {
    let Some(gpu) = gpu() else { return };
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    let case = random_case(4);
    let cotangents = cotangents(&case);
    let want = scene_gradient(&case.scene, &View::device(&case.camera, &case.options), &cotangents);
    let mut fails = |case: &RandomCase, cotangents: &[[f64; 4]]| {
        let got = runner.run(&case.scene, &case.camera, &case.options, cotangents);
        compare(&got.gradient, &want).iter().any(|c| c.check(1e-3).is_err())
    };
    assert!(!fails(&case, &cotangents));
    let mut shifted = case.clone();
    shifted.camera.cx += 0.01;
    assert!(fails(&shifted, &cotangents));
    let alpha_lost: Vec<[f64; 4]> = cotangents.iter().map(|c| [c[0], c[1], c[2], 0.0]).collect();
    assert!(fails(&case, &alpha_lost));
    assert_silent(&gpu);
}

/// An empty scene and one Gaussian that is not seen: zeros, no messages.
#[test]
fn nothing_to_see_gives_zeros() {
    let Some(gpu) = gpu() else { return };
    let mut runner = GradientRunner::new(&gpu, Variant::for_training(gpu.caps()));
    let mut case = random_case(1);
    let pixels = (case.camera.width * case.camera.height) as usize;
    case.scene = InstancedScene::from_cloud(Gaussians {
        sh_degree: 1,
        means: vec![[f32::NAN; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[0.0; 3]],
        opacity_logits: vec![0.0],
        sh: vec![[0.0; 3]; 4],
    });
    let got = runner.run(&case.scene, &case.camera, &case.options, &vec![[1.0; 4]; pixels]);
    assert!(got.gradient.background == CloudGradient::zeros(&case.scene.background));
    let empty = InstancedScene::default();
    runner.run(&empty, &case.camera, &case.options, &vec![[1.0; 4]; pixels]);
    assert_silent(&gpu);
}

/// The same checks on the larger files.
mod shared_golden {
    use crate::common::golden::shared_golden_cases;

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn gradients() {
        super::gradients(&shared_golden_cases());
    }
}
