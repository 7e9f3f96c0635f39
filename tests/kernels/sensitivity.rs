//! The sensitivity that `--pack small` rounds by, against central differences of the twin's pictures.

use instgs_train::measure_sensitivity;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Camera, InstancedScene, Parameter};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::{add_rare_offsets, random_case};

/// Probes: the estimate of one value has a relative deviation of sqrt(2 / 600) = 6 %.
const PROBES: usize = 600;

/// The number at `(row, value)` of a parameter.
fn number(scene: &mut InstancedScene, parameter: Parameter, row: usize, value: usize) -> &mut f32 {
    let templates = scene.templates.len();
    let own = scene.own.len();
    let (cloud, local) = match row {
        row if row < templates => (&mut scene.templates, row),
        row if row < templates + own => (&mut scene.own, row - templates),
        row => (&mut scene.background, row.saturating_sub(templates + own)),
    };
    let coefficients = cloud.sh_coefficients();
    match parameter {
        Parameter::Means => &mut cloud.means[local][value],
        Parameter::LogScales => &mut cloud.log_scales[local][value],
        Parameter::OpacityLogits => &mut cloud.opacity_logits[local],
        Parameter::Quats => &mut cloud.quats[local][value],
        Parameter::Sh0 => &mut cloud.sh[local * coefficients][value],
        Parameter::OffsetMeans => &mut scene.offsets.means[row][value],
        Parameter::OffsetShDc => &mut scene.offsets.sh_dc[row][value],
        Parameter::OffsetOpacityLogits => &mut scene.offsets.opacity_logits[row],
        Parameter::OffsetLogScales => &mut scene.offsets.log_scales[row][value],
        Parameter::OffsetQuats => &mut scene.offsets.quats[row][value],
        other => panic!("{other:?} is not looked at"),
    }
}

/// Mean squared derivative of the twin's picture.
fn squared_derivative(scene: &InstancedScene, camera: &Camera, parameter: Parameter, row: usize, value: usize) -> f64 {
    // Smaller steps see more of the jumps where an alpha falls below 1/255, which have no derivative.
    let step = if matches!(parameter, Parameter::Means | Parameter::OffsetMeans) { 1e-3 } else { 8e-3 };
    let moved = |by: f32| {
        let mut scene = scene.clone();
        let number = number(&mut scene, parameter, row, value);
        *number += by;
        let at = f64::from(*number);
        (instgs_reference::render(&scene, camera, &instgs_reference::RenderOptions::default()).color, at)
    };
    let ((high, at_high), (low, at_low)) = (moved(step), moved(-step));
    let pairs = high.as_flattened().iter().zip(low.as_flattened());
    let squares: f64 = pairs.map(|(a, b)| ((a - b) / (at_high - at_low)).powi(2)).sum();
    squares / (3.0 * high.len() as f64)
}

#[test]
fn sensitivity_is_the_squared_derivative_of_pictures() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(3);
    add_rare_offsets(&mut Rng::new(4), &mut case.scene, u64::MAX);
    let (scene, camera) = (&case.scene, &case.camera);
    let cameras = vec![camera.clone(); PROBES];
    let mut views = 0;
    let measured = measure_sensitivity(&gpu, scene, &cameras, || views += 1).unwrap();
    assert!(views == PROBES && measured.fits(scene));
    let parameters = [
        (Parameter::Means, 3),
        (Parameter::LogScales, 3),
        (Parameter::OpacityLogits, 1),
        (Parameter::Quats, 4),
        (Parameter::Sh0, 3),
        (Parameter::OffsetMeans, 3),
        (Parameter::OffsetShDc, 3),
        (Parameter::OffsetOpacityLogits, 1),
        (Parameter::OffsetLogScales, 3),
        (Parameter::OffsetQuats, 4),
    ];
    let mut rng = Rng::new(5);
    for (parameter, width) in parameters {
        let rows = &measured.rows[parameter];
        let (mut want, mut got) = (0.0, 0.0);
        // Those that show most say most.
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by(|&a, &b| rows[b].total_cmp(&rows[a]));
        let picked = order.iter().take(4).copied().chain((0..4).map(|_| rng.index(rows.len())));
        for row in picked.collect::<Vec<_>>() {
            let of_value = |value| squared_derivative(scene, camera, parameter, row, value);
            want += (0..width).map(of_value).sum::<f64>() / width as f64;
            got += f64::from(rows[row]);
        }
        println!("{parameter:?}: measured {got:.4e}, differences {want:.4e}");
        assert!(want > 0.0 && (got / want - 1.0).abs() < 0.15, "{parameter:?}: {got} {want}");
    }
    let again = measure_sensitivity(&gpu, scene, &cameras[..5], || ()).unwrap();
    assert_eq!(again, measure_sensitivity(&gpu, scene, &cameras[..5], || ()).unwrap());
    assert!(measure_sensitivity(&gpu, scene, &[], || ()).is_err());
    assert_silent(&gpu);
}
