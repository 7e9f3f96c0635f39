//! The f64 backward twins against the golden files of an independent implementation, and proof that this can fail.

mod common;

use common::golden::{GoldenCase, GoldenView, golden_cases, golden_losses};
use common::tensor::TensorComparison;
use instgs_vk::reference::View;
use instgs_vk::reference::gather_gradients::{CloudGradient, gather_gradients, source_gradients, splat_gradients};
use instgs_vk::reference::image_loss::{ImageLoss, ImagePair, image_loss};
use instgs_vk::reference::preprocess_instance_expand::SourceGaussian;
use instgs_vk::reference::tile_blend_backward::SplatGradient;

/// The five tensors of a case, summed over its cameras, against the golden ones; `spoil` changes our views.
fn compare_parameters(case: &GoldenCase, spoil: impl Fn(&mut View)) -> Vec<TensorComparison> {
    let views: Vec<CloudGradient> = case
        .views
        .iter()
        .map(|golden| {
            let mut view = View::exact(&golden.camera, &golden.options);
            spoil(&mut view);
            let per_source = source_gradients(&case.sources, &view, &golden.cotangents);
            gather_gradients(&case.scene, &per_source).background
        })
        .collect();
    let sum = |values: fn(&CloudGradient) -> &[f64]| -> Vec<f64> {
        (0..values(&views[0]).len()).map(|i| views.iter().map(|view| values(view)[i]).sum()).collect()
    };
    let tensors: [(&str, fn(&CloudGradient) -> &[f64]); 5] = [
        ("means", |g| g.means.as_flattened()),
        ("quats", |g| g.quats.as_flattened()),
        ("log_scales", |g| g.log_scales.as_flattened()),
        ("opacity_logits", |g| &g.opacity_logits),
        ("sh", |g| g.sh.as_flattened()),
    ];
    let compare = |(name, values): (&str, fn(&CloudGradient) -> &[f64])| {
        TensorComparison::new(&format!("{}: {name}", case.name), &sum(values), values(&case.gradient))
    };
    tensors.map(compare).into()
}

/// The three tensors of a camera that the blend's backward pass makes.
fn compare_splats(golden: &GoldenView, sources: &[SourceGaussian]) -> Vec<TensorComparison> {
    let view = View::exact(&golden.camera, &golden.options);
    let splats: Vec<SplatGradient> =
        splat_gradients(sources, &view, &golden.cotangents).into_iter().map(Option::unwrap_or_default).collect();
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

#[test]
fn golden_parameter_gradients() {
    for case in golden_cases() {
        for comparison in compare_parameters(&case, |_| ()) {
            eprintln!("FIGURE {} {:e}", comparison.name, comparison.relative_l2);
            comparison.check(1e-3).unwrap();
        }
    }
}

#[test]
fn golden_splat_gradients() {
    for case in golden_cases() {
        for golden in &case.views {
            for comparison in compare_splats(golden, &case.sources) {
                eprintln!("FIGURE {} {:e}", comparison.name, comparison.relative_l2);
                comparison.check(1e-3).unwrap();
            }
        }
    }
}

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
            eprintln!("FIGURE loss {error:e}");
            assert!(error.abs() < 1e-5, "{error:e}");
        }
    }
}
