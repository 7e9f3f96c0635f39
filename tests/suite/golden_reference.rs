//! The f64 twin against the golden files, against itself on flattened scenes, its passes against each other, and proof
//! that these comparisons can fail.

use crate::common::golden::{GoldenCase, GoldenView, golden_cases};
use crate::common::random_scene::{RandomCase, random_case};
use crate::common::{ImageComparison, both_robust, single_channel};
use glam::{DMat3, DVec3};
use instgs_reference::cull_chunks::{CHUNK_SIZE, ChunkItem, visible_chunks};
use instgs_reference::emit_intersections::emit_intersections;
use instgs_reference::preprocess_instance_expand::{
    ALPHA_MIN, CullLimits, ProjectedSplat, SourceGaussian, pixel_center, project, sources, tiles_hit,
};
use instgs_reference::radix_sort::{depth_key, sort_pairs};
use instgs_reference::tile_ranges::tile_ranges;
use instgs_reference::{ReferenceImage, View, render, render_sources, splats_in_depth_order};
use instgs_vk::math::covariance::{quat_from_rotation, quat_multiply};
use instgs_vk::math::sh::ShRotation;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, InstancedScene};

/// Seeds of `random_case` that the tests below walk.
const SEEDS: std::ops::Range<u64> = 0..60;

/// The larger of the colour and alpha errors against a golden view on its robust pixels.
fn golden_error(image: &ReferenceImage, view: &GoldenView) -> f64 {
    let color = ImageComparison::new(&image.color, &view.color, &view.robust);
    let alpha = ImageComparison::new(&single_channel(&image.alpha), &view.alpha, &view.robust);
    color.check(f64::MAX).unwrap();
    alpha.check(f64::MAX).unwrap();
    color.max_abs_error.max(alpha.max_abs_error)
}

/// The worst of all views of all cases.
fn worst_golden(cases: &[GoldenCase], error: impl Fn(&GoldenCase, &GoldenView) -> f64) -> f64 {
    assert!(!cases.is_empty());
    cases.iter().flat_map(|case| case.views.iter().map(|view| error(case, view))).fold(0.0, f64::max)
}

/// With ln(scale) and logit(opacity) in f64. Measured: 4.9e-14 (tiny_huge_200g_deg3, first camera).
fn images_in_f64(cases: &[GoldenCase]) {
    let error = |case: &GoldenCase, view: &GoldenView| {
        let image = render_sources(&case.sources, &View::exact(&view.camera, &view.options));
        assert_eq!(image.n_contrib, view.n_contrib, "{}: pairs blended per pixel", view.camera.name);
        golden_error(&image, view)
    };
    let worst = worst_golden(cases, error);
    assert!(worst < 1e-12, "{worst:e}");
}

#[test]
fn golden_images_in_f64() {
    images_in_f64(&golden_cases());
}

/// With the scene as the renderer gets it, ln(scale) and logit(opacity) rounded to f32. Measured: 7.6e-8.
fn images_from_f32_scenes(cases: &[GoldenCase]) {
    let error =
        |case: &GoldenCase, view: &GoldenView| golden_error(&render(&case.scene, &view.camera, &view.options), view);
    let worst = worst_golden(cases, error);
    assert!(worst < 1e-6, "{worst:e}");
}

#[test]
fn golden_images_from_f32_scenes() {
    images_from_f32_scenes(&golden_cases());
}

/// Per Gaussian: centre, depth, conic, colour, opacity, relative to 1 + |value|. Measured: 3.6e-13.
fn splats(cases: &[GoldenCase]) {
    let error = |case: &GoldenCase, golden: &GoldenView| {
        let view = View::exact(&golden.camera, &golden.options);
        let limits = CullLimits { opacity_min: 0.0, ..CullLimits::exact(&view) };
        let mut worst: f64 = 0.0;
        for (i, source) in case.sources.iter().enumerate().filter(|(i, _)| golden.visible[*i]) {
            let splat = project(&view, source, &limits).expect("the golden generator draws it");
            let got =
                [&splat.mean_px.to_array()[..], &[splat.depth, splat.opacity], &splat.conic, &splat.color.to_array()]
                    .concat();
            let want = [
                &golden.means_px[i][..],
                &[golden.depths[i], golden.opacities[i]],
                &golden.conics[i],
                &golden.colors[i],
            ]
            .concat();
            worst = got.iter().zip(&want).fold(worst, |w, (g, v)| w.max((g - v).abs() / (1.0 + v.abs())));
        }
        worst
    };
    let worst = worst_golden(cases, error);
    assert!(worst < 1e-11, "{worst:e}");
}

#[test]
fn golden_splats() {
    splats(&golden_cases());
}

/// Our mask excludes nothing that golden's includes; the other way round 5 pixels of opaque_150g_deg3 differ, where
/// golden also looks at alpha near 1/255 behind the splat that ended the pixel, which cannot change it.
fn robust_masks(cases: &[GoldenCase]) {
    let (mut ours_only, mut golden_only) = (0, 0);
    for case in cases {
        for view in &case.views {
            let image = render(&case.scene, &view.camera, &view.options);
            for (&ours, &golden) in image.robust.iter().zip(&view.robust) {
                ours_only += usize::from(!ours && golden);
                golden_only += usize::from(ours && !golden);
            }
        }
    }
    assert!(ours_only == 0 && golden_only <= 5, "excluded by us only: {ours_only}, by golden only: {golden_only}");
}

#[test]
fn golden_robust_masks() {
    robust_masks(&golden_cases());
}

/// Planted errors of several kinds are seen at the tolerance of the test above, each in at least one view of every
/// case it applies to. Measured, smallest of the cases: half a pixel 0.088, quaternion 0.25, scale 3.2e-3, SH 0.032.
fn planted_errors_are_seen(cases: &[GoldenCase]) {
    for case in cases {
        let worst = |scene: &InstancedScene, shift_px: f64| {
            let error = |view: &GoldenView| {
                let mut camera = view.camera.clone();
                camera.cx += shift_px;
                golden_error(&render(scene, &camera, &view.options), view)
            };
            case.views.iter().map(error).fold(0.0, f64::max)
        };
        assert!(worst(&case.scene, 0.0) < 1e-6);
        assert!(worst(&case.scene, 0.5) > 1e-2, "{}: half a pixel", case.name);
        let spoiled = |spoil: fn(&mut Gaussians)| {
            let mut scene = case.scene.clone();
            spoil(&mut scene.background);
            worst(&scene, 0.0)
        };
        assert!(spoiled(|cloud| cloud.quats.iter_mut().for_each(|q| q[1] = -q[1])) > 1e-2, "{}: quaternion", case.name);
        assert!(spoiled(|cloud| cloud.log_scales.iter_mut().for_each(|s| s[0] += 0.01)) > 1e-3, "{}: scale", case.name);
        if case.scene.sh_degree() > 0 {
            let flip_y = |cloud: &mut Gaussians| {
                let per_gaussian = cloud.sh_coefficients();
                cloud.sh.iter_mut().skip(1).step_by(per_gaussian).for_each(|c| *c = c.map(|v| -v));
            };
            assert!(spoiled(flip_y) > 1e-2, "{}: sign of SH 1", case.name);
        }
    }
}

#[test]
fn the_golden_comparison_fails_on_planted_errors() {
    planted_errors_are_seen(&golden_cases());
}

/// Comparisons of colour, alpha and depth between a scene and a plain cloud seen by the same camera.
fn compare_with_cloud(case: &RandomCase, cloud: Gaussians) -> [ImageComparison; 3] {
    let instanced = render(&case.scene, &case.camera, &case.options);
    let flat = render(&InstancedScene::from_cloud(cloud), &case.camera, &case.options);
    let robust = both_robust(&instanced.robust, &flat.robust);
    let channel = |a: &[f64], b: &[f64]| ImageComparison::new(&single_channel(a), &single_channel(b), &robust);
    [
        ImageComparison::new(&instanced.color, &flat.color, &robust),
        channel(&instanced.alpha, &flat.alpha),
        channel(&instanced.depth, &flat.depth),
    ]
}

/// `flatten` rounds world-frame parameters to f32; compare `flattening_in_f64_is_exact`. Measured over seeds 0..60:
/// color 2.8e-6, alpha 4.2e-6, depth 5.1e-6 scene units; over seeds 0..200: 4.3e-6, 4.2e-6, 2.2e-5.
#[test]
fn a_flattened_scene_renders_to_the_same_image() {
    for seed in SEEDS {
        let case = random_case(seed);
        let comparisons = compare_with_cloud(&case, case.scene.flatten());
        for (comparison, (name, tolerance)) in
            comparisons.iter().zip([("color", 1e-5), ("alpha", 1e-5), ("depth", 5e-5)])
        {
            comparison.check(tolerance).unwrap_or_else(|reason| panic!("seed {seed}, {name}: {reason}"));
        }
    }
}

/// The formulas of `flatten` without its rounding to f32: means, rotations, scales and SH moved to the world in f64.
fn flattened_in_f64(scene: &InstancedScene) -> Vec<SourceGaussian> {
    let move_to_world = |source: SourceGaussian| {
        let placement = source.world_from_template;
        let rotation = quat_from_rotation(placement.rotation());
        SourceGaussian {
            mean_template: placement.transform_point(source.mean_template),
            quat: quat_multiply(rotation, source.quat),
            log_scales: source.log_scales + placement.scale().ln(),
            sh: ShRotation::new(placement.rotation()).rotate(&source.sh),
            world_from_template: Similarity::IDENTITY,
            ..source
        }
    };
    sources(scene).into_iter().map(move_to_world).collect()
}

/// What is left is that an f32 matrix is not quite a similarity, so transforms here are exact ones: rotations of the
/// cube times powers of two. Measured: 5.2e-15.
#[test]
fn flattening_in_f64_is_exact() {
    let mut worst: f64 = 0.0;
    for seed in SEEDS {
        let mut case = random_case(seed);
        for (k, instance) in case.scene.instances.iter_mut().enumerate() {
            let turn = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
            let quarter = DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z);
            let rotation = [turn, quarter, turn * quarter, quarter * turn * turn][k % 4];
            let scale = [0.5, 1.0, 2.0][k % 3];
            instance.world_from_template =
                Similarity::from_parts(rotation, scale, instance.world_from_template.translation());
        }
        let view = View::device(&case.camera, &case.options);
        let instanced = render(&case.scene, &case.camera, &case.options);
        let flat = render_sources(&flattened_in_f64(&case.scene), &view);
        let robust = both_robust(&instanced.robust, &flat.robust);
        let comparison = ImageComparison::new(&instanced.color, &flat.color, &robust);
        assert_eq!(comparison.non_finite, 0);
        worst = worst.max(comparison.max_abs_error);
    }
    assert!(worst < 1e-12, "{worst:e}");
}

/// Wrong in one respect each, the flattened cloud must be told apart in most scenes. (Not in all: some see few
/// instances, have SH degree 0 or no offsets.) Measured, of 60 seeds, in the order below: 49, 50, 60, 60.
#[test]
fn the_flatten_comparison_fails_on_planted_errors() {
    let seen = |flatten_wrongly: fn(&InstancedScene) -> Gaussians| {
        let wrong = |seed: &u64| {
            let case = random_case(*seed);
            compare_with_cloud(&case, flatten_wrongly(&case.scene))[0].max_abs_error > 1e-5
        };
        SEEDS.filter(wrong).count()
    };
    let sh_not_rotated = |scene: &InstancedScene| {
        let mut cloud = scene.flatten();
        let original = sources(scene);
        let count = cloud.sh_coefficients();
        for (i, source) in original.iter().enumerate() {
            for (c, value) in source.sh.iter().enumerate() {
                cloud.sh[i * count + c] = value.as_vec3().to_array();
            }
        }
        cloud
    };
    let no_offsets = |scene: &InstancedScene| {
        let mut bare = scene.clone();
        bare.instances.iter_mut().for_each(|instance| instance.first_offset = None);
        bare.flatten()
    };
    let template_scales = |scene: &InstancedScene| {
        let mut cloud = scene.flatten();
        for (log_scales, source) in cloud.log_scales.iter_mut().zip(sources(scene)) {
            *log_scales = source.log_scales.as_vec3().to_array();
        }
        cloud
    };
    let shifted_quats = |scene: &InstancedScene| {
        let mut cloud = scene.flatten();
        cloud.quats.rotate_right(scene.background.len().max(1));
        cloud
    };
    let counts = [seen(sh_not_rotated), seen(no_offsets), seen(template_scales), seen(shifted_quats)];
    assert!(counts.iter().all(|&count| count >= 30), "{counts:?}");
}

/// The passes chained as on the device: keys of f32 depths, stable sort, tiles, records, sort by tile, ranges. Every
/// pixel must find in its tile all splats with alpha >= 1/255, those that are blended in the order of the f64 twin.
#[test]
fn the_tiled_passes_keep_every_contribution_in_order() {
    const TILE: u32 = 8;
    for seed in SEEDS.step_by(4) {
        let case = random_case(seed);
        let view = View::device(&case.camera, &case.options);
        let (width, height) = (view.width, view.height);
        let visible: Vec<ProjectedSplat> =
            sources(&case.scene).iter().filter_map(|s| project(&view, s, &CullLimits::exact(&view))).collect();
        let keys: Vec<u32> = visible.iter().map(|s| depth_key(s.depth as f32)).collect();
        let (_, order) = sort_pairs(&keys, &(0..visible.len() as u32).collect::<Vec<_>>());
        let splats: Vec<&ProjectedSplat> = order.iter().map(|&i| &visible[i as usize]).collect();
        let tiles: Vec<Vec<u32>> = splats.iter().map(|s| tiles_hit(s, TILE, width, height)).collect();
        let records = emit_intersections(&tiles);
        let (sorted_tiles, sorted_splats) = sort_pairs(&records.tiles, &records.splats);
        let ranges = tile_ranges(&sorted_tiles, width.div_ceil(TILE) * height.div_ceil(TILE));

        let ReferenceImage { robust, n_contrib, .. } = render(&case.scene, &case.camera, &case.options);
        let exact = splats_in_depth_order(&sources(&case.scene), &view, &CullLimits::exact(&view));
        for pixel in (0..width * height).filter(|&p| robust[p as usize]) {
            let (x, y) = (pixel % width, pixel / width);
            let contributes = |s: &ProjectedSplat| s.alpha_at(pixel_center(x, y)) >= ALPHA_MIN;
            let [first, end] = ranges[(y / TILE * width.div_ceil(TILE) + x / TILE) as usize];
            let in_tile = sorted_splats[first as usize..end as usize].iter().map(|&i| splats[i as usize]);
            let mut found: Vec<u32> = in_tile.filter(|s| contributes(s)).map(|s| s.flat_index).collect();
            let mut want: Vec<u32> = exact.iter().filter(|s| contributes(s)).map(|s| s.flat_index).collect();
            // The order is safe up to the splat that ends the pixel; behind it only completeness counts.
            let blended = n_contrib[pixel as usize] as usize;
            assert_eq!(found[..blended], want[..blended], "order: seed {seed}, pixel {x} {y}");
            found.sort_unstable();
            want.sort_unstable();
            assert_eq!(found, want, "completeness: seed {seed}, pixel {x} {y}");
        }
    }
}

/// Against rendering every Gaussian alone: a chunk is visible if one of its Gaussians is blended somewhere.
#[test]
fn visible_chunks_are_those_that_draw_alone() {
    let (mut visible, mut hidden) = (0, 0);
    for seed in SEEDS.step_by(6) {
        let mut case = random_case(seed);
        // Several chunks per template and in the background.
        let copies = case.scene.templates.clone();
        (0..3).for_each(|_| case.scene.background.append(&copies));
        let view = View::device(&case.camera, &case.options);
        let all = sources(&case.scene);
        let mut want = Vec::new();
        for source in &all {
            let item = ChunkItem { row: source.instance, chunk: source.local_index / CHUNK_SIZE };
            let alone = render_sources(std::slice::from_ref(source), &view);
            if want.last() != Some(&item) && alone.n_contrib.iter().any(|&n| n > 0) {
                want.push(item);
            }
        }
        assert_eq!(visible_chunks(&case.scene, &case.camera, &case.options), want, "seed {seed}");
        let mut chunks: Vec<ChunkItem> =
            all.iter().map(|s| ChunkItem { row: s.instance, chunk: s.local_index / CHUNK_SIZE }).collect();
        chunks.dedup();
        visible += want.len();
        hidden += chunks.len() - want.len();
    }
    assert!(visible > 20 && hidden > 0, "{visible} visible and {hidden} hidden chunks: the test needs both");
}

/// Nothing to draw, and the smallest image.
#[test]
fn empty_scenes_and_one_pixel() {
    let mut case = random_case(0);
    let empty = render(&InstancedScene::default(), &case.camera, &case.options);
    let background = case.options.background.map(|v| f64::from(v as f32));
    assert!(empty.color.iter().all(|&c| c == background) && empty.alpha.iter().all(|&a| a == 0.0));
    assert!(empty.robust.iter().all(|&r| r) && empty.depth.iter().all(|&d| d == 0.0));
    case.camera = case.camera.resized(1, 1);
    let pixel = render(&case.scene, &case.camera, &case.options);
    assert_eq!((pixel.color.len(), pixel.n_contrib[0] > 0), (1, true));
}

/// The generator covers what it promises, over 200 seeds.
#[test]
fn random_cases_cover_what_they_promise() {
    let cases: Vec<RandomCase> = (0..200).map(random_case).collect();
    let share = |holds: &dyn Fn(&RandomCase) -> bool| cases.iter().filter(|case| holds(case)).count();
    for degree in 0..=3 {
        assert!(share(&|c| c.scene.templates.sh_degree == degree) >= 20, "templates of degree {degree}");
    }
    for instances in 1..=8 {
        assert!(share(&|c| c.scene.instances.len() == instances) >= 5, "{instances} instances");
    }
    assert!((60..140).contains(&share(&|c| c.scene.background.is_empty())));
    assert!((60..140).contains(&share(&|c| c.options.antialias)));
    let offsets = |c: &RandomCase| c.scene.instances.iter().filter(|i| i.first_offset.is_some()).count();
    assert!(
        share(&|c| offsets(c) > 0 && offsets(c) < c.scene.instances.len()) >= 50,
        "instances with and without offsets"
    );
    let behind = |c: &RandomCase| {
        let view = View::device(&c.camera, &c.options);
        sources(&c.scene)
            .iter()
            .filter(|s| project(&view, s, &CullLimits { near: 0.0, opacity_min: 0.0 }).is_none())
            .count()
    };
    assert!(share(&|c| behind(c) > 0) >= 40, "some behind the camera");
    let covered = |c: &RandomCase| render(&c.scene, &c.camera, &c.options).alpha.iter().filter(|&&a| a > 0.0).count();
    assert!(cases.iter().all(|c| covered(c) > 0), "no empty picture");
    assert_eq!(random_case(3).scene, cases[3].scene);
}

/// The same checks on the larger files.
mod shared_golden {
    use crate::common::golden::shared_golden_cases;

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn images_in_f64() {
        super::images_in_f64(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn images_from_f32_scenes() {
        super::images_from_f32_scenes(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn splats() {
        super::splats(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn robust_masks() {
        super::robust_masks(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn planted_errors_are_seen() {
        super::planted_errors_are_seen(&shared_golden_cases());
    }
}
