//! The sensitivity that `--pack small` rounds by, against central differences of the twin's pictures.

use instgs_train::{TrainError, measure_sensitivity};
use instgs_vk::math::log_covariance::{Shape, log_covariance, nearest_shape};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::offset_runs::sources_of_records;
use instgs_vk::scene::{Camera, InstancedScene, Parameter, SourceRange};

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

/// Adds to the shape of a Gaussian in one coordinate of the logarithm of its covariance; returns by how much.
fn widen(quat: &mut [f32; 4], log_scales: &mut [f32; 3], coordinate: usize, by: f32) -> f64 {
    let shape = |quat: &[f32; 4], log_scales: &[f32; 3]| Shape {
        quat: quat.map(f64::from),
        log_scales: log_scales.map(f64::from),
    };
    let start = shape(quat, log_scales);
    let mut wanted = log_covariance(&start);
    wanted[coordinate] += f64::from(by);
    let moved = nearest_shape(&wanted, start.quat);
    let length = start.quat.iter().map(|v| v * v).sum::<f64>().sqrt();
    *quat = moved.quat.map(|v| (length * v) as f32);
    *log_scales = moved.log_scales.map(|v| v as f32);
    log_covariance(&shape(quat, log_scales))[coordinate] - log_covariance(&start)[coordinate]
}

/// Adds to the shape of an offset record; returns by how much.
fn widen_record(scene: &mut InstancedScene, record: usize, coordinate: usize, by: f32) -> f64 {
    let (sources, _) = sources_of_records(&scene.offset_runs(), scene.offsets.len());
    let Some(source) = sources[record].map(|row| row as usize) else { return f64::from(by) };
    let (quat, sizes) = (scene.templates.quats[source], scene.templates.log_scales[source]);
    let mut sum: [f32; 4] = std::array::from_fn(|i| quat[i] + scene.offsets.quats[record][i]);
    let mut wider: [f32; 3] = std::array::from_fn(|i| sizes[i] + scene.offsets.log_scales[record][i]);
    let moved = widen(&mut sum, &mut wider, coordinate, by);
    scene.offsets.quats[record] = std::array::from_fn(|i| sum[i] - quat[i]);
    scene.offsets.log_scales[record] = std::array::from_fn(|i| wider[i] - sizes[i]);
    moved
}

/// Adds to the shape of a source Gaussian and to those of all records that belong to it; returns by how much.
fn widen_source(scene: &mut InstancedScene, row: usize, coordinate: usize, by: f32) -> f64 {
    let runs = scene.offset_runs();
    let (sources, _) = sources_of_records(&runs, scene.offsets.len());
    let records = (0..sources.len()).filter(|&record| sources[record] == Some(row as u32));
    let sums: Vec<(usize, [f32; 4], [f32; 3])> = records
        .map(|record| {
            let mut sum: [f32; 4] =
                std::array::from_fn(|i| scene.templates.quats[row][i] + scene.offsets.quats[record][i]);
            let mut wider: [f32; 3] =
                std::array::from_fn(|i| scene.templates.log_scales[row][i] + scene.offsets.log_scales[record][i]);
            widen(&mut sum, &mut wider, coordinate, by);
            (record, sum, wider)
        })
        .collect();
    let (templates, own) = (scene.templates.len(), scene.own.len());
    let (cloud, local) = match row {
        row if row < templates => (&mut scene.templates, row),
        row if row < templates + own => (&mut scene.own, row - templates),
        row => (&mut scene.background, row - templates - own),
    };
    let moved = widen(&mut cloud.quats[local], &mut cloud.log_scales[local], coordinate, by);
    for (record, sum, wider) in sums {
        scene.offsets.quats[record] = std::array::from_fn(|i| sum[i] - scene.templates.quats[row][i]);
        scene.offsets.log_scales[record] = std::array::from_fn(|i| wider[i] - scene.templates.log_scales[row][i]);
    }
    moved
}

/// Mean squared derivative of the twin's picture by what `change` adds to, which returns how much that was.
fn squared_difference(
    scene: &InstancedScene,
    camera: &Camera,
    step: f32,
    change: impl Fn(&mut InstancedScene, f32) -> f64,
) -> f64 {
    let moved = |by: f32| {
        let mut scene = scene.clone();
        let at = change(&mut scene, by);
        (instgs_reference::render(&scene, camera, &instgs_reference::RenderOptions::default()).color, at)
    };
    let ((high, at_high), (low, at_low)) = (moved(step), moved(-step));
    let pairs = high.as_flattened().iter().zip(low.as_flattened());
    let squares: f64 = pairs.map(|(a, b)| ((a - b) / (at_high - at_low)).powi(2)).sum();
    squares / (3.0 * high.len() as f64)
}

/// Mean squared derivative of the twin's picture by a parameter.
fn squared_derivative(scene: &InstancedScene, camera: &Camera, parameter: Parameter, row: usize, value: usize) -> f64 {
    // Smaller steps see more of the jumps where an alpha falls below 1/255, which have no derivative.
    let step = if matches!(parameter, Parameter::Means | Parameter::OffsetMeans) { 1e-3 } else { 8e-3 };
    squared_difference(scene, camera, step, |scene, by| {
        let number = number(scene, parameter, row, value);
        let before = f64::from(*number);
        *number += by;
        f64::from(*number) - before
    })
}

/// Rows that show most, which say most, and some others.
fn picked(shown: &[f32], rng: &mut Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..shown.len()).collect();
    order.sort_by(|&a, &b| shown[b].total_cmp(&shown[a]));
    order.iter().take(4).copied().chain((0..4).map(|_| rng.index(shown.len()))).collect()
}

#[test]
fn sensitivity_is_the_squared_derivative_of_pictures() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(3);
    add_rare_offsets(&mut Rng::new(4), &mut case.scene, u64::MAX);
    let (scene, camera) = (&case.scene, &case.camera);
    let cameras = vec![camera.clone(); PROBES];
    let mut views = 0;
    let measured = measure_sensitivity::<TrainError>(&gpu, scene, &cameras, || {
        views += 1;
        Ok(())
    })
    .unwrap();
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
        for row in picked(rows, &mut rng) {
            let of_value = |value| squared_derivative(scene, camera, parameter, row, value);
            want += (0..width).map(of_value).sum::<f64>() / width as f64;
            got += f64::from(rows[row]);
        }
        println!("{parameter:?}: measured {got:.4e}, differences {want:.4e}");
        assert!(want > 0.0 && (got / want - 1.0).abs() < 0.15, "{parameter:?}: {got} {want}");
    }
    // What changes a shape, of what is behind and of offsets.
    type Change = fn(&mut InstancedScene, usize, usize, f32) -> f64;
    let of_shapes: [(&str, &[[f32; 6]], Change); 2] = [
        ("shapes", &measured.source_shapes, widen_source),
        ("shapes of offsets", &measured.offset_shapes, widen_record),
    ];
    for (name, rows, change) in of_shapes {
        let shown: Vec<f32> = rows.iter().map(|row| row.iter().sum()).collect();
        let (mut want, mut got) = ([0.0; 6], [0.0; 6]);
        for row in picked(&shown, &mut rng) {
            for coordinate in 0..6 {
                want[coordinate] +=
                    squared_difference(scene, camera, 8e-3, |scene, by| change(scene, row, coordinate, by));
                got[coordinate] += f64::from(rows[row][coordinate]);
            }
        }
        println!("{name}: measured {got:.4?}, differences {want:.4?}");
        for (coordinate, (got, want)) in got.iter().zip(want).enumerate() {
            assert!(want > 0.0 && (got / want - 1.0).abs() < 0.25, "{name}, {coordinate}: {got} {want}");
        }
        let [got, want] = [got, want].map(|sums| sums.iter().sum::<f64>());
        assert!((got / want - 1.0).abs() < 0.15, "{name}: {got} {want}");
    }
    let again = measure_sensitivity::<TrainError>(&gpu, scene, &cameras[..5], || Ok(())).unwrap();
    assert_eq!(again, measure_sensitivity::<TrainError>(&gpu, scene, &cameras[..5], || Ok(())).unwrap());
    assert!(measure_sensitivity::<TrainError>(&gpu, scene, &[], || Ok(())).is_err());
    // Whoever calls it can end it after any view.
    let mut views = 0;
    let stopped = measure_sensitivity::<TrainError>(&gpu, scene, &cameras[..5], || {
        views += 1;
        if views == 2 { Err(TrainError::NoViews) } else { Ok(()) }
    });
    assert!(matches!(stopped, Err(TrainError::NoViews)));
    assert_eq!(views, 2);
    assert_silent(&gpu);
}

/// Copies of an instance share its offsets: each says how much it shows, and the order of threads says nothing.
#[test]
fn what_copies_share_has_the_sum_over_them() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(3);
    add_rare_offsets(&mut Rng::new(4), &mut case.scene, u64::MAX);
    let original = case.scene.instances.iter().find(|instance| instance.first_offset.is_some()).unwrap().clone();
    let (first, records) = (original.first_offset.unwrap() as usize, case.scene.offsets.len());
    let count = case.scene.template_ranges[original.template as usize].count as usize;
    let mut shared = case.scene.clone();
    let mut copy = original.clone();
    let moved = Similarity::from_parts(glam::DMat3::IDENTITY, 1.0, glam::DVec3::new(0.3, 0.1, 0.2));
    copy.world_from_template = moved.after(&copy.world_from_template);
    shared.instances.push(copy);
    if let Some(&matrix) = shared.color_from_template.first() {
        shared.color_from_template.push(matrix);
    }
    if !shared.own_ranges.is_empty() {
        shared.own_ranges.push(SourceRange::default());
    }
    let unshared = shared.with_unshared_offsets(usize::MAX);
    assert_eq!(unshared.offsets.len(), records + count);
    let cameras = vec![case.camera.clone(); 5];
    let [of_shared, of_unshared] =
        [&shared, &*unshared].map(|scene| measure_sensitivity::<TrainError>(&gpu, scene, &cameras, || Ok(())).unwrap());
    assert!(of_shared.fits(&shared));
    let last = unshared.instances.last().unwrap().first_offset.unwrap() as usize;
    let before =
        unshared.instances.iter().position(|instance| instance.world_from_template == original.world_from_template);
    let own = unshared.instances[before.unwrap()].first_offset.unwrap() as usize;
    for parameter in [Parameter::OffsetMeans, Parameter::OffsetShDc, Parameter::OffsetOpacityLogits] {
        let (of, parts) = (&of_shared.rows[parameter], &of_unshared.rows[parameter]);
        assert!((0..count).any(|i| parts[own + i] > 0.0) && (0..count).any(|i| parts[last + i] > 0.0));
        for i in 0..count {
            assert_eq!(of[first + i], parts[own + i] + parts[last + i], "{parameter:?} {i}");
        }
    }
    assert_eq!(of_shared.rows[Parameter::Means], of_unshared.rows[Parameter::Means]);
    assert_silent(&gpu);
}

/// Of many copies only some are measured with their offsets, and stand for the others.
#[test]
fn what_many_copies_share_has_about_the_sum_over_all() {
    let Some(gpu) = gpu() else { return };
    let mut case = random_case(3);
    add_rare_offsets(&mut Rng::new(4), &mut case.scene, u64::MAX);
    let scene = &mut case.scene;
    let original = scene.instances.iter().find(|instance| instance.first_offset.is_some()).unwrap().clone();
    scene.instances = vec![original];
    (scene.own_ranges, scene.color_from_template, scene.groups) = Default::default();
    scene.own = scene.own.filtered(|_| false);
    let mut rng = Rng::new(5);
    for _ in 0..31 {
        let mut copy = scene.instances[0].clone();
        let aside = Similarity::from_parts(glam::DMat3::IDENTITY, 1.0, 0.2 * rng.normal_vector());
        copy.world_from_template = aside.after(&copy.world_from_template);
        scene.instances.push(copy);
    }
    let cameras = vec![case.camera.clone(); 5];
    let total = |scene: &InstancedScene| -> f32 {
        let of = measure_sensitivity::<TrainError>(&gpu, scene, &cameras, || Ok(())).unwrap();
        of.rows[Parameter::OffsetShDc].iter().sum()
    };
    let ratio = total(scene) / total(&scene.with_unshared_offsets(usize::MAX));
    // Which copies are measured is chance: 8 of 32 alone have 0.15 here.
    assert!((0.4..2.5).contains(&ratio), "{ratio}");
    assert_silent(&gpu);
}
