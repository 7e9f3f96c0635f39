//! The f64 backward twins against the golden files of an independent implementation, and proof that this can fail.

use crate::common::golden::{GoldenCase, GoldenView, golden_cases, golden_losses};
use crate::common::tensor::TensorComparison;
use glam::Vec3Swizzles;
use instgs_reference::View;
use instgs_reference::gather_gradients::{CloudGradient, gather_gradients, source_gradients, splat_gradients};
use instgs_reference::image_loss::{ImageLoss, ImagePair, image_loss};
use instgs_reference::tile_blend_backward::SplatGradient;

/// The five tensors of a case, summed over its cameras, against the golden ones; `spoil` changes our views and
/// cotangents.
fn compare_parameters(case: &GoldenCase, spoil: fn(&mut View, &mut [[f64; 4]])) -> Vec<TensorComparison> {
    type Values = fn(&CloudGradient) -> &[f64];
    let views: Vec<CloudGradient> = case
        .views
        .iter()
        .map(|golden| {
            let (mut view, mut cotangents) = (View::exact(&golden.camera, &golden.options), golden.cotangents.clone());
            spoil(&mut view, &mut cotangents);
            let per_source = source_gradients(&case.sources, &view, &cotangents);
            gather_gradients(&case.scene, &per_source).background
        })
        .collect();
    let sum = |values: Values| -> Vec<f64> {
        (0..values(&views[0]).len()).map(|i| views.iter().map(|view| values(view)[i]).sum()).collect()
    };
    let tensors: [(&str, Values); 5] = [
        ("means", |g| g.means.as_flattened()),
        ("quats", |g| g.quats.as_flattened()),
        ("log_scales", |g| g.log_scales.as_flattened()),
        ("opacity_logits", |g| &g.opacity_logits),
        ("sh", |g| g.sh.as_flattened()),
    ];
    let compare = |(name, values): (&str, Values)| {
        TensorComparison::new(&format!("{}: {name}", case.name), &sum(values), values(&case.gradient))
    };
    tensors.map(compare).into()
}

/// The three tensors of a camera that the blend's backward pass makes; `spoil` changes ours.
fn compare_splats(case: &GoldenCase, golden: &GoldenView, spoil: fn(&mut SplatGradient)) -> Vec<TensorComparison> {
    let view = View::exact(&golden.camera, &golden.options);
    let mut splats: Vec<SplatGradient> =
        splat_gradients(&case.sources, &view, &golden.cotangents).into_iter().map(Option::unwrap_or_default).collect();
    splats.iter_mut().for_each(spoil);
    let name = |tensor: &str| format!("{}: {tensor}", golden.camera.name);
    let got = |values: fn(&SplatGradient) -> Vec<f64>| -> Vec<f64> { splats.iter().flat_map(values).collect() };
    vec![
        TensorComparison::new(
            &name("means_px"),
            &got(|s| s.mean_px.to_array().into()),
            golden.grad_means_px.as_flattened(),
        ),
        TensorComparison::new(&name("conics"), &got(|s| s.conic.into()), golden.grad_conics.as_flattened()),
        TensorComparison::new(&name("colors"), &got(|s| s.color.to_array().into()), golden.grad_colors.as_flattened()),
    ]
}

/// The largest relative L2 error, all values finite.
fn worst(comparisons: &[TensorComparison]) -> f64 {
    comparisons.iter().for_each(|c| c.check(f64::INFINITY).unwrap());
    comparisons.iter().fold(0.0, |worst, c| worst.max(c.relative_l2))
}

/// 1e-3 is asked for; with ln(scale) and logit(opacity) in f64 it is rounding. Measured: 1.2e-12 (log_scales of
/// tiny_huge_200g_deg3), 1.4e-13 (aa_200g_deg3), all others below 1e-14.
fn parameter_gradients(cases: &[GoldenCase]) {
    for case in cases {
        for comparison in compare_parameters(case, |_, _| ()) {
            comparison.check(1e-11).unwrap();
        }
    }
}

#[test]
fn golden_parameter_gradients() {
    parameter_gradients(&golden_cases());
}

/// Per camera. Measured: 3.6e-14 (tiny_huge_200g_deg3).
fn gradients_of_splats(cases: &[GoldenCase]) {
    for case in cases {
        for golden in &case.views {
            for comparison in compare_splats(case, golden, |_| ()) {
                comparison.check(1e-12).unwrap();
            }
        }
    }
}

#[test]
fn golden_splat_gradients() {
    gradients_of_splats(&golden_cases());
}

/// Seen at 1e-3, which is what kernels in f32 are held to, by some tensor of every case the error applies to. Measured,
/// smallest of the cases: alpha's sign 0.33, background 0.59, dilation 2.5e-3, compensation 0.052; the spoiled splats
/// more than 0.1.
fn planted_errors_are_seen(cases: &[GoldenCase]) {
    type Spoil = fn(&mut View, &mut [[f64; 4]]);
    type SplatSpoil = fn(&mut SplatGradient);
    let spoils: [(&str, Spoil); 4] = [
        ("alpha's cotangent with the wrong sign", |_, cotangents| cotangents.iter_mut().for_each(|c| c[3] = -c[3])),
        ("background forgotten", |view, _| view.options.background = [0.0; 3]),
        ("dilation", |view, _| view.options.dilation += 0.01),
        ("compensation", |view, _| view.options.antialias = !view.options.antialias),
    ];
    for case in cases {
        for (name, spoil) in spoils {
            let black = case.views.iter().all(|view| view.options.background == [0.0; 3]);
            let error = worst(&compare_parameters(case, spoil));
            assert!(error > 1e-3 || (black && name.starts_with("background")), "{}: {name}: {error:e}", case.name);
        }
        let spoils: [(&str, SplatSpoil); 3] = [
            ("b counted half", |splat| splat.conic[1] *= 0.5),
            ("mean with the wrong sign", |splat| splat.mean_px.y = -splat.mean_px.y),
            ("channels swapped", |splat| splat.color = splat.color.zyx()),
        ];
        for (name, spoil) in spoils {
            let error = case.views.iter().map(|golden| worst(&compare_splats(case, golden, spoil))).fold(0.0, f64::max);
            assert!(error > 0.1, "{}: {name}: {error:e}", case.name);
        }
    }
}

#[test]
fn the_golden_comparison_fails_on_planted_errors() {
    planted_errors_are_seen(&golden_cases());
}

/// 1e-5 is asked for. Measured: 1.1e-15 (SSIM), gradients 6.6e-15.
#[test]
fn golden_image_losses() {
    for golden in golden_losses() {
        let pair = ImagePair {
            width: golden.width,
            height: golden.height,
            image: &golden.image,
            target: &golden.target,
            ignored: None,
        };
        let ImageLoss { l1, ssim, loss, gradient } = image_loss(&pair, 0.2);
        let comparison = TensorComparison::new("image", gradient.as_flattened(), golden.gradient.as_flattened());
        for error in [l1 - golden.l1, ssim - golden.ssim, loss - golden.loss, comparison.relative_l2] {
            assert!(error.abs() < 1e-12, "{error:e}");
        }
    }
}

/// The same checks on the larger files.
mod shared_golden {
    use crate::common::golden::shared_golden_cases;

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn parameter_gradients() {
        super::parameter_gradients(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn gradients_of_splats() {
        super::gradients_of_splats(&shared_golden_cases());
    }

    #[test]
    #[ignore = "needs ../shared/golden: 2.9 MB of further cases; tools/test runs it where they are"]
    fn planted_errors_are_seen() {
        super::planted_errors_are_seen(&shared_golden_cases());
    }
}
