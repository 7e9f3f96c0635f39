//! Tests of the projection twin: against numerical differentiation, and of the culling rules.

use std::f64::consts::PI;

use glam::{DMat2, DVec2, DVec3};

use super::*;
use crate::view::RenderOptions;
use instgs_vk::math::covariance::{logit, rotation_from_quat};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::camera::Camera;

fn random_view(rng: &mut Rng, options: &RenderOptions) -> View {
    let mut camera = Camera::look_at(
        "random",
        3.0 * rng.unit_vector(),
        0.3 * rng.unit_vector(),
        DVec3::new(0.1, 1.0, 0.2),
        0.9,
        (61, 47),
    );
    camera.fy *= rng.range(0.8, 1.2);
    camera.cx += rng.range(-15.0, 15.0);
    camera.cy += rng.range(-10.0, 10.0);
    View::exact(&camera, options)
}

fn random_source(rng: &mut Rng) -> SourceGaussian {
    let rotation = rotation_from_quat(rng.rotation_quat());
    SourceGaussian {
        flat_index: 0,
        instance: 0,
        local_index: 0,
        mean_template: 0.2 * rng.normal_vector(),
        quat: rng.rotation_quat().map(|c| 3.0 * c),
        log_scales: DVec3::new(rng.range(-6.0, -1.5), rng.range(-6.0, -1.5), rng.range(-6.0, -1.5)),
        opacity_logit: rng.range(-2.0, 4.0),
        sh: (0..16).map(|_| 0.3 * rng.normal_vector()).collect(),
        sh_degree: 3,
        world_from_template: Similarity::from_parts(rotation, rng.range(0.3, 3.0), 0.3 * rng.normal_vector()),
        color_from_template: None,
    }
}

/// Pixel position of a world point, straight from the pinhole model.
fn pixel_of(view: &View, world: DVec3) -> DVec2 {
    let v = view.view_from_world * world + view.world_origin_view;
    DVec2::new(view.focal_px.x * v.x / v.z + view.principal_px.x, view.focal_px.y * v.y / v.z + view.principal_px.y)
}

/// The 2D covariance from central differences of the projection along the Gaussian's three axis vectors: sum over axes
/// of (d pixel / d axis)(d pixel / d axis)^T. It uses the pinhole formula only, no Jacobian.
fn covariance_px_by_differences(view: &View, source: &SourceGaussian) -> DMat2 {
    let step = 1e-5;
    let center = mean_world(source);
    let rotation = rotation_from_quat(source.quat);
    (0..3).fold(DMat2::ZERO, |sum, axis| {
        let axis_world = source.world_from_template.linear() * (rotation.col(axis) * source.log_scales[axis].exp());
        let unit = axis_world.normalize();
        let d = (pixel_of(view, center + step * unit) - pixel_of(view, center - step * unit)) / (2.0 * step)
            * axis_world.length();
        sum + DMat2::from_cols(d * d.x, d * d.y)
    })
}

/// Largest relative difference (to the largest entry) between EWA and differences over Gaussians inside the slope
/// limits.
fn worst_projection_error(spoil_jacobian: bool) -> f64 {
    let mut rng = Rng::new(21);
    let mut worst: f64 = 0.0;
    let mut checked = 0;
    while checked < 1000 {
        let view = random_view(&mut rng, &RenderOptions::default());
        let source = random_source(&mut rng);
        let mean_view = view.view_from_world * mean_world(&source) + view.world_origin_view;
        let slope = mean_view.truncate() / mean_view.z;
        let inside = mean_view.z > 0.5 && slope.cmpgt(view.slope_min).all() && slope.cmplt(view.slope_max).all();
        if !inside {
            continue;
        }
        checked += 1;
        let point = if spoil_jacobian { DVec3::new(-mean_view.x, mean_view.y, mean_view.z) } else { mean_view };
        let [xx, xy, yy] = covariance_px(&view, point, covariance_world(&source));
        let want = covariance_px_by_differences(&view, &source);
        let difference = DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy)) - want;
        let largest = |m: DMat2| m.to_cols_array().iter().fold(0.0, |a: f64, v| a.max(v.abs()));
        worst = worst.max(largest(difference) / largest(want));
    }
    worst
}

/// EWA agrees with differences. Measured over 1000 pairs (view, Gaussian): 2.6e-10, the error of the differences.
#[test]
fn ewa_agrees_with_differences_of_the_pinhole_projection() {
    let worst = worst_projection_error(false);
    assert!(worst < 1e-7, "worst relative error {worst:e}");
}

#[test]
fn the_projection_check_fails_on_a_wrong_sign() {
    assert!(worst_projection_error(true) > 1e-2);
}

/// For a centred principal point, the clamp is 1.3 tan(fov / 2), as in the INRIA rasteriser. Measured: 0.
#[test]
fn a_centred_slope_limit_is_1_3_tan() {
    let camera = Camera::look_at("c", DVec3::ZERO, DVec3::Z, DVec3::Y, PI / 3.0, (80, 60));
    let view = View::exact(&camera, &RenderOptions::default());
    let limit = 1.3 * (PI / 6.0).tan();
    assert!((view.slope_max.y - limit).abs() < 1e-15 && (view.slope_min.y + limit).abs() < 1e-15);
    let far_off = DVec3::new(0.0, 10.0, 1.0);
    assert!((projection_jacobian(&view, far_off)[1].z + view.focal_px.y * limit).abs() < 1e-12);
}

/// Conic times dilated covariance is the identity, and the box touches the contour alpha = 1/255.
/// Measured over up to 500 splats: 3.6e-15 (inverse), 3.5e-14 (contour).
#[test]
fn conic_and_extent_fit_the_covariance() {
    let mut rng = Rng::new(5);
    for _ in 0..500 {
        let view = random_view(&mut rng, &RenderOptions::default());
        let source = random_source(&mut rng);
        let Some(splat) = project(&view, &source, &CullLimits::exact(&view)) else { continue };
        let mean_view = view.view_from_world * mean_world(&source) + view.world_origin_view;
        let [xx, xy, yy] = covariance_px(&view, mean_view, covariance_world(&source));
        let [a, b, c] = splat.conic;
        assert!((a * (xx + 0.3) + b * xy - 1.0).abs() < 1e-12 && (b * xy + c * (yy + 0.3) - 1.0).abs() < 1e-12);
        // The rightmost point of the contour lies at offset (h, h xy / xx').
        let h = splat.half_extent_px.x;
        let touch = splat.mean_px + DVec2::new(h, h * xy / (xx + 0.3));
        assert!((255.0 * splat.alpha_at(touch) - 1.0).abs() < 1e-12);
        assert!((splat.tau_ln - splat.sigma_at(touch)).abs() < 1e-12);
    }
}

/// The tight box is compared with every pixel of the image, and tiles with a scan without any box.
#[test]
fn boxes_and_tiles_miss_no_pixel() {
    let mut rng = Rng::new(6);
    let mut seen = 0;
    for _ in 0..300 {
        let view = random_view(&mut rng, &RenderOptions::default());
        let Some(splat) = project(&view, &random_source(&mut rng), &CullLimits::exact(&view)) else { continue };
        let (width, height, tile) = (view.width, view.height, 8);
        let mut want: Vec<u32> = (0..width * height)
            .filter(|p| splat.alpha_at(pixel_center(p % width, p / width)) >= ALPHA_MIN)
            .map(|p| p / width / tile * width.div_ceil(tile) + p % width / tile)
            .collect();
        want.sort_unstable();
        want.dedup();
        seen += want.len();
        assert_eq!(tiles_hit(&splat, tile, width, height), want);
    }
    assert!(seen > 1000, "only {seen} tiles");
}

#[test]
fn what_is_culled() {
    let camera = Camera::look_at("c", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (64, 48));
    let view = View::exact(&camera, &RenderOptions::default());
    let good = SourceGaussian {
        mean_template: DVec3::new(0.0, 0.0, 1.0),
        opacity_logit: 0.0,
        world_from_template: Similarity::IDENTITY,
        ..random_source(&mut Rng::new(1))
    };
    let drawn = |source: SourceGaussian| project(&view, &source, &CullLimits::exact(&view)).is_some();
    let at = |z: f64| SourceGaussian { mean_template: DVec3::new(0.0, 0.0, z), ..good.clone() };
    assert!(drawn(good.clone()));
    assert!(!drawn(at(-1.0)) && !drawn(at(0.2)) && drawn(at(0.2 + 1e-9)));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(!drawn(at(bad)), "depth {bad}");
        assert!(!drawn(SourceGaussian { mean_template: DVec3::new(bad, 0.0, 1.0), ..good.clone() }), "x {bad}");
        assert!(!drawn(SourceGaussian { sh: vec![DVec3::splat(bad); 16], ..good.clone() }), "colour {bad}");
        assert!(!drawn(SourceGaussian { quat: [bad, 0.0, 0.0, 0.0], ..good.clone() }), "quaternion {bad}");
    }
    assert!(!drawn(SourceGaussian { quat: [0.0; 4], ..good.clone() }));
    assert!(!drawn(SourceGaussian { opacity_logit: f64::NAN, ..good.clone() }));
    assert!(!drawn(SourceGaussian { log_scales: DVec3::splat(60.0), ..good.clone() }), "e^60 squared is not an f32");
    // Scales of zero leave only the dilation: a dot.
    assert!(drawn(SourceGaussian { log_scales: DVec3::NEG_INFINITY, ..good.clone() }));
    let least = |p: f64| SourceGaussian { opacity_logit: logit(p / 255.0), ..good.clone() };
    assert!(drawn(least(1.0 + 1e-9)) && !drawn(least(1.0 - 1e-9)));
}

/// The compensation is at most 1, is sqrt(det / det'), and has the floor 0.005. Measured: 2.3e-16.
#[test]
fn antialias_compensation() {
    let options = RenderOptions { antialias: true, ..RenderOptions::default() };
    let camera = Camera::look_at("c", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (64, 48));
    let view = View::exact(&camera, &options);
    let round = |sigma_px: f64| SourceGaussian {
        mean_template: DVec3::new(0.0, 0.0, 1.0),
        log_scales: DVec3::splat((sigma_px / view.focal_px.x).ln()),
        opacity_logit: logit(0.999),
        world_from_template: Similarity::IDENTITY,
        ..random_source(&mut Rng::new(1))
    };
    let opacity = |sigma_px: f64| project(&view, &round(sigma_px), &CullLimits::exact(&view)).unwrap().opacity;
    // On the view axis det / det' = (s^2 / (s^2 + 0.3))^2.
    for s in [0.5f64, 1.0, 4.0] {
        assert!((opacity(s) - 0.999 * s * s / (s * s + 0.3)).abs() < 1e-12);
    }
    assert!((opacity(1e-4) - 0.999 * 0.005).abs() < 1e-12);
}
