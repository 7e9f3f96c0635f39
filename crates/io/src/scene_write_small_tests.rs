//! `--pack small` in files: precision, size, what does not fit the format, older formats, and damage.

use super::tests::{difference, path, repeated, scenes, through};
use super::*;
use crate::scene_file::parse_scene_file;
use crate::small::{Sensitivity, SmallPlan};
use glam::DMat3;
use instgs_samples::sample;
use instgs_samples::{sample_scene, with_ablations, with_low_sh_offsets, with_own};
use instgs_vk::math::covariance::covariance;
use instgs_vk::math::log_covariance::{Shape, log_covariance};
use instgs_vk::math::opponent::opponent_from_rgb;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::instanced_scene::SourceRange;
use instgs_vk::scene::parameters::{Owner, Parameter, ParameterSet};

/// Largest difference between the rotations of two lists of quaternions, as an angle, radians.
fn turned(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let angle = |(a, b): (&[f32; 4], &[f32; 4])| {
        let [a, b] =
            [a, b].map(|q| glam::DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into()).normalize());
        a.angle_between(b).min(a.angle_between(-b))
    };
    a.iter().zip(b).map(angle).fold(0.0, f64::max)
}

/// The scene in the order of its small file: the background along a Morton curve, unless there are unknown tensors.
fn in_file_order(scene: &InstancedScene) -> InstancedScene {
    let mut out = scene.clone();
    if scene.foreign_tensors.is_empty() {
        let order = instgs_vk::math::morton::morton_order(&scene.background.means);
        out.background = Gaussians::with_capacity(scene.background.sh_degree, scene.background.len());
        order.into_iter().for_each(|i| out.background.push_from(&scene.background, i as usize));
    }
    out
}

/// The coordinates of the logarithms of a cloud's covariances.
fn log_covariances(cloud: &Gaussians) -> Vec<f32> {
    let of = |(quat, log_scales): (&[f32; 4], &[f32; 3])| {
        log_covariance(&Shape { quat: quat.map(f64::from), log_scales: log_scales.map(f64::from) }).map(|v| v as f32)
    };
    cloud.quats.iter().zip(&cloud.log_scales).flat_map(of).collect()
}

/// Colours as they are rounded.
fn opponent(rgb: &[[f32; 3]]) -> Vec<f32> {
    rgb.iter().flat_map(|&rgb| opponent_from_rgb(rgb)).collect()
}

/// The covariances of all expanded Gaussians of templates, instance by instance.
fn expanded_covariances(scene: &InstancedScene) -> Vec<DMat3> {
    let mut out = Vec::new();
    for instance in &scene.instances {
        let range = scene.template_ranges[instance.template as usize];
        for local in 0..range.count {
            let row = (range.first + local) as usize;
            let record = instance.first_offset.map(|first| (first + local) as usize);
            let [of_quat, of_size] =
                [scene.offsets.quats.len(), scene.offsets.log_scales.len()].map(|n| record.filter(|_| n > 0));
            let quat: [f64; 4] = std::array::from_fn(|i| {
                f64::from(scene.templates.quats[row][i] + of_quat.map_or(0.0, |record| scene.offsets.quats[record][i]))
            });
            let size: [f64; 3] = std::array::from_fn(|i| {
                f64::from(
                    scene.templates.log_scales[row][i]
                        + of_size.map_or(0.0, |record| scene.offsets.log_scales[record][i]),
                )
            });
            out.push(covariance(quat, size.into()));
        }
    }
    out
}

/// Largest difference of two lists of covariances, as a part of the larger number in each.
fn covariance_difference(a: &[DMat3], b: &[DMat3]) -> f64 {
    assert_eq!(a.len(), b.len());
    let most = |m: DMat3| m.to_cols_array().iter().fold(0.0f64, |most, v| most.max(v.abs()));
    a.iter().zip(b).map(|(&a, &b)| most(a - b) / most(a)).fold(0.0, f64::max)
}

#[test]
fn small_keeps_half_a_step() -> Result<(), IoError> {
    for scene in scenes() {
        let back = through(&scene, Pack::Small)?;
        assert_eq!(
            (&back.instances, &back.groups, &back.foreign_tensors, &back.template_ranges, &back.own_ranges),
            (&scene.instances, &scene.groups, &scene.foreign_tensors, &scene.template_ranges, &scene.own_ranges)
        );
        let want = in_file_order(&scene);
        let clouds = [(&want.templates, &back.templates), (&want.own, &back.own), (&want.background, &back.background)];
        for (a, b) in clouds {
            assert_eq!((a.sh_degree, a.len()), (b.sh_degree, b.len()));
            // Half a step, plus the rounding of f32.
            assert!(difference(&log_covariances(a), &log_covariances(b), 1.0) <= 0.05001);
            assert!(difference(&a.opacity_logits, &b.opacity_logits, 1.0) <= 0.05001);
            assert!(difference(&opponent(&a.sh), &opponent(&b.sh), 1.0) <= 0.01001);
            // The step is a sixteenth of the Gaussian's size, to the nearest power of two of the usual one.
            let size = a.log_scales.iter().map(|s| (s.iter().sum::<f32>() / 3.0).exp()).fold(0.0, f32::max);
            let most = size / 32.0 * std::f32::consts::SQRT_2 * 1.001;
            assert!(difference(a.means.as_flattened(), b.means.as_flattened(), 1.0) <= most);
        }
        let (a, b) = (&want.offsets, &back.offsets);
        assert_eq!(a.len(), b.len());
        assert!(difference(&opponent(&a.sh_dc), &opponent(&b.sh_dc), 1.0) <= 0.02001);
        assert!(difference(&a.opacity_logits, &b.opacity_logits, 1.0) <= 0.1001);
        assert!(difference(&opponent(&a.sh_rest), &opponent(&b.sh_rest), 1.0) <= 0.02001);
        // Template's and offset's error together: up to 0.15 in each of six coordinates.
        let error = covariance_difference(&expanded_covariances(&want), &expanded_covariances(&back));
        assert!(error < 0.25, "{error}");
    }
    Ok(())
}

/// Two components may be equally large, and quaternions longer or shorter than f32 has squares of.
#[test]
fn offsets_turn_templates_of_any_rotation_the_same_way() -> Result<(), IoError> {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let quats = [
        [1.0, 0.0, 0.0, 0.0],
        [half, -half, 0.0, 0.0],
        [0.5, -0.5, -0.5, 0.5],
        [0.0, 0.0, -3.0, 0.0],
        [2e38; 4],
        [1e-30; 4],
    ];
    let mut scene = repeated(1, orders.len() * quats.len());
    let n = scene.templates.len();
    (scene.offsets.quats, scene.offsets.log_scales) = (vec![[0.0; 4]; n], vec![[0.0; 3]; n]);
    for (i, quat) in quats.iter().enumerate() {
        for (k, order) in orders.iter().enumerate() {
            let row = i * orders.len() + k;
            scene.templates.quats[row] = *quat;
            scene.templates.log_scales[row] = order.map(|place| [-2.0, -3.0, -4.0][place]);
            // About 50 degrees.
            let length = quat.iter().fold(0.0f32, |most, v| most.max(v.abs()));
            scene.offsets.quats[row] = [0.0, 0.3 * length, 0.2 * length, -0.3 * length];
            scene.offsets.log_scales[row] = [0.3, -0.2, 0.1];
        }
    }
    let back = through(&scene, Pack::Small)?;
    let error = covariance_difference(&expanded_covariances(&scene), &expanded_covariances(&back));
    assert!(error < 0.25, "{error}");
    Ok(())
}

/// Rotations that cannot be normalised keep all rotations of templates and their offsets as they are.
#[test]
fn a_rotation_without_length_leaves_the_others_right() -> Result<(), IoError> {
    let mut scene = with_ablations();
    scene.foreign_tensors.clear();
    // A Gaussian of the template that no record belongs to.
    scene.templates.push_from(&scene.templates.clone(), 0);
    *scene.templates.quats.last_mut().expect("is there") = [0.0; 4];
    scene.template_ranges.push(SourceRange { first: scene.templates.len() as u32 - 1, count: 1 });
    scene.templates.quats[0] = scene.templates.quats[0].map(|v| -3.0 * v);
    let back = through(&scene, Pack::Small)?;
    assert_eq!(back.templates.quats, scene.templates.quats);
    let error = covariance_difference(&expanded_covariances(&scene), &expanded_covariances(&back));
    assert!(error < 0.25, "{error}");
    Ok(())
}

#[test]
fn shapes_of_shared_and_unused_records_come_back() -> Result<(), IoError> {
    let (n, mut rng) = (6, Rng::new(9));
    let mut scene = repeated(4, n);
    let offsets = &mut scene.offsets;
    offsets.quats = (0..offsets.means.len()).map(|_| std::array::from_fn(|_| 0.1 * rng.normal() as f32)).collect();
    offsets.log_scales = (0..offsets.means.len()).map(|_| std::array::from_fn(|_| 0.2 * rng.normal() as f32)).collect();
    // Two instances share records, one has none: the records of 1 and 3 are unused.
    scene.instances[1].first_offset = Some(0);
    scene.instances[3].first_offset = None;
    let names = |scene: &InstancedScene| -> Result<String, IoError> {
        let bytes = packed_scene_file_bytes(scene, Pack::Small, path())?;
        let (header_bytes, _) = safetensors::SafeTensors::read_metadata(&bytes).expect("a header");
        Ok(String::from_utf8_lossy(&bytes[..8 + header_bytes]).into_owned())
    };
    let back = through(&scene, Pack::Small)?;
    assert!(names(&scene)?.contains("offset.log_covariances.coded"));
    let error = covariance_difference(&expanded_covariances(&scene), &expanded_covariances(&back));
    assert!(error < 0.25, "{error}");
    assert!(back.offsets.quats[n..2 * n].iter().flatten().all(|&v| v == 0.0));
    assert!(back.offsets.log_scales[3 * n..].iter().flatten().all(|&v| v == 0.0));
    // Axes are near those of the template, so that offsets are small.
    let most = back.offsets.quats.iter().flatten().fold(0.0f32, |most, v| most.max(v.abs()));
    assert!(most < 0.5, "{most}");
    // A record of two Gaussians is no difference to one: those stay as they are, and what they belong to.
    scene.instances[1].first_offset = Some(1);
    let back = through(&scene, Pack::Small)?;
    assert!(names(&scene)?.contains("offset.quats"));
    assert_eq!((&back.offsets.quats, &back.templates.quats), (&scene.offsets.quats, &scene.templates.quats));
    // A file that says so all the same is refused.
    scene.instances[1].first_offset = Some(0);
    let mut bytes = packed_scene_file_bytes(&scene, Pack::Small, path())?;
    let (header_bytes, metadata) = safetensors::SafeTensors::read_metadata(&bytes).expect("a header");
    let at = 8 + header_bytes + metadata.info("instance.first_offset").expect("is there").data_offsets.0;
    bytes[at + 4..at + 8].copy_from_slice(&1u32.to_le_bytes());
    let error = parse_scene_file(&bytes, path()).expect_err("is wrong").to_string();
    assert!(error.contains("offset.log_covariances") && error.contains("several Gaussians"), "{error}");
    // One of the two arrays without the other stays as it is, too.
    scene.instances[1].first_offset = Some(0);
    scene.offsets.quats.clear();
    let back = through(&scene, Pack::Small)?;
    assert_eq!((&back.offsets.quats, &back.offsets.log_scales), (&scene.offsets.quats, &scene.offsets.log_scales));
    Ok(())
}

/// Files of another program may have logarithms of covariances as they are, and wrong ones.
#[test]
fn wrong_logarithms_of_covariances_are_named() -> Result<(), IoError> {
    let scene = InstancedScene::from_cloud(sample(0, 5));
    let bytes = packed_scene_file_bytes(&scene, Pack::F32, path())?;
    let tensors = safetensors::SafeTensors::deserialize(&bytes).expect("a file");
    let shapes: Vec<u8> = log_covariances(&scene.background).iter().flat_map(|v| v.to_le_bytes()).collect();
    let with = |shapes: &[u8], rows: usize, left_out: &[&str]| {
        let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, vec![rows, 6], shapes).expect("fits");
        let others = tensors.iter().filter(|(name, _)| !left_out.contains(name));
        let all: Vec<_> = others
            .map(|(name, view)| (name.to_owned(), view))
            .chain([("background.log_covariances".into(), view)])
            .collect();
        let metadata = [("format".to_owned(), "instgs/5".to_owned())].into();
        parse_scene_file(&safetensors::serialize(all, Some(metadata)).expect("serialises"), path())
    };
    let others = ["background.quats", "background.log_scales"];
    let back = with(&shapes, 5, &others)?.background;
    assert!(difference(&log_covariances(&back), &log_covariances(&scene.background), 1.0) < 1e-5);
    let error = |result: Result<InstancedScene, IoError>| result.expect_err("is wrong").to_string();
    assert!(error(with(&shapes, 5, &[])).contains("together with background.quats"));
    assert!(error(with(&shapes[..96], 4, &others)).contains("not [5, 6]"));
    let mut poisoned = shapes.clone();
    poisoned[24..28].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(error(with(&poisoned, 5, &others)).contains("not finite in row 1"));
    // Finite but enormous: no panic, whatever comes.
    poisoned[24..28].copy_from_slice(&f32::MAX.to_le_bytes());
    assert_eq!(with(&poisoned, 5, &others)?.background.len(), 5);
    Ok(())
}

/// A scene whose sensitivity differs from row to row, and is the same for all values of a row.
fn sensitive(scene: &InstancedScene) -> Sensitivity {
    let clouds = [&scene.templates, &scene.own, &scene.background];
    let rows = |parameter: Parameter| match parameter.owner() {
        Owner::Source => scene.source_len(),
        Owner::ShBand(l) => clouds.iter().filter(|cloud| l <= cloud.sh_degree).map(|cloud| cloud.len()).sum(),
        Owner::Offset => scene.offsets.array(parameter).map_or(0, |array| array.flat().len() / parameter.width()),
        Owner::Instance => 0,
    };
    // 0 for every 50th row, which no view sees.
    let of = |row: usize| if row % 50 == 49 { 0.0 } else { 1e-3 * 4f32.powi((row % 7) as i32) };
    Sensitivity {
        rows: ParameterSet::from_fn(|parameter| (0..rows(parameter)).map(of).collect()),
        source_shapes: (0..scene.source_len()).map(|row| [of(row); 6]).collect(),
        offset_shapes: (0..scene.offsets.quats.len()).map(|row| [of(row); 6]).collect(),
    }
}

/// By sensitivity, the mean squared error of pictures between two scenes.
fn predicted_error(sensitivity: &Sensitivity, a: &InstancedScene, b: &InstancedScene) -> f64 {
    let squares = |x: &[f32], y: &[f32], rows: &[f32]| {
        let width = x.len() / rows.len();
        let pairs = x.iter().zip(y).enumerate();
        pairs.map(|(i, (x, y))| f64::from(rows[i / width]) * (f64::from(*x) - f64::from(*y)).powi(2)).sum::<f64>()
    };
    let [x, y] = [&a.background, &b.background];
    let of_shapes: Vec<f32> = sensitivity.source_shapes.iter().map(|row| row[0]).collect();
    squares(&log_covariances(x), &log_covariances(y), &of_shapes)
        + squares(&x.opacity_logits, &y.opacity_logits, &sensitivity.rows[Parameter::OpacityLogits])
        + squares(x.means.as_flattened(), y.means.as_flattened(), &sensitivity.rows[Parameter::Means])
}

#[test]
fn small_is_as_precise_as_pictures_need() -> Result<(), IoError> {
    let mut rng = Rng::new(11);
    let mut cloud = sample(0, 3000);
    cloud.log_scales.iter_mut().flatten().for_each(|v| *v = (rng.normal() - 3.0) as f32);
    cloud.opacity_logits.iter_mut().for_each(|v| *v = 2.0 * rng.normal() as f32);
    cloud.means.iter_mut().flatten().for_each(|v| *v = 4.0 * rng.normal() as f32);
    let mut scene = InstancedScene::from_cloud(cloud);
    // Keeps the order of the background.
    let marker = ForeignTensor { dtype: "U8".into(), shape: vec![1], bytes: vec![7] };
    scene.foreign_tensors.insert("marker".into(), marker);
    let sensitivity = sensitive(&scene);
    let packed = |psnr| -> Result<(usize, InstancedScene), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(path(), "no folder", &e))?;
        let file = folder.path().join("x.instgs");
        let options = SmallOptions { sensitivity: &sensitivity, picture_psnr_db: psnr };
        crate::write_small_scene_file(&file, &scene, &options)?;
        let bytes = crate::read_bytes(&file)?;
        Ok((bytes.len(), parse_scene_file(&bytes, path())?))
    };
    let mut last = usize::MAX;
    for psnr in [60.0, 50.0, 40.0] {
        let (bytes, back) = packed(psnr)?;
        assert!(bytes < last, "{psnr} {bytes} {last}");
        last = bytes;
        // Colours have the rest of the error.
        let error = predicted_error(&sensitivity, &scene, &back);
        let most = 10f64.powf(-psnr / 10.0);
        assert!((0.3..1.05).contains(&(error / most)), "{psnr} {}", error / most);
    }
    // Rows that count more are more precise.
    let (_, back) = packed(50.0)?;
    let error = |of: usize| {
        let rows = (0..scene.background.len()).filter(|row| row % 50 != 49 && row % 7 == of);
        rows.map(|row| (scene.background.means[row][0] - back.background.means[row][0]).abs()).fold(0.0, f32::max)
    };
    assert!(error(0) > 20.0 * error(6), "{} {}", error(0), error(6));
    // A sensitivity of another scene is refused.
    let mut fewer = scene.clone();
    fewer.background.opacity_logits.pop();
    let options = SmallOptions { sensitivity: &Sensitivity::default(), picture_psnr_db: 50.0 };
    let refused = crate::write_small_scene_file(path(), &scene, &options).expect_err("does not fit").to_string();
    assert!(refused.contains("another scene"), "{refused}");
    Ok(())
}

/// A plan may be that of an earlier state of the scene, and says what a file of it would hold, row by row.
#[test]
fn a_plan_rounds_as_its_file_does() -> Result<(), IoError> {
    let folder = tempfile::tempdir().map_err(|e| IoError::os(path(), "no folder", &e))?;
    let file = folder.path().join("x.instgs");
    let cloud = InstancedScene::from_cloud(sample(1, 400));
    // Own Gaussians and a background in another order.
    let mut reordered = with_own().with_packed_own().into_owned();
    reordered.foreign_tensors.clear();
    for before in [with_own(), with_ablations(), with_low_sh_offsets(), reordered, cloud, InstancedScene::default()] {
        let sensitivity = sensitive(&before);
        let options = SmallOptions { sensitivity: &sensitivity, picture_psnr_db: 60.0 };
        if before == InstancedScene::default() {
            assert!(SmallPlan::new(&before, &options, path()).is_err());
            continue;
        }
        let plan = SmallPlan::new(&before, &options, path())?;
        let mut scene = before.clone();
        scene.background.means.iter_mut().for_each(|mean| mean[0] = 0.5 - mean[0]);
        scene.templates.sh.iter_mut().for_each(|sh| sh[1] += 0.1);
        let rounded = plan.rounded(&scene, path())?;
        write_planned_scene_file(&file, &scene, &plan)?;
        let mut stored = parse_scene_file(&crate::read_bytes(&file)?, path())?;
        // A file has the background in the order that it had when it was planned.
        if before.foreign_tensors.is_empty() {
            let order = instgs_vk::math::morton::morton_order(&before.background.means);
            let place = |i: u32| order.iter().position(|&at| at == i).map_or(0, |place| place as u32);
            stored.background.reorder(&(0..order.len() as u32).map(place).collect::<Vec<_>>());
        }
        assert_eq!((&rounded.templates, &rounded.background), (&stored.templates, &stored.background));
        assert_eq!(rounded.offsets, stored.offsets);
        // Their order in the file is that of their instances, and within these along a curve.
        let sorted = |cloud: &Gaussians| {
            let mut rows: Vec<_> = (0..cloud.len()).map(|i| (cloud.means[i], cloud.sh_of(i).to_vec())).collect();
            rows.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
            rows
        };
        assert_eq!(sorted(&rounded.own), sorted(&stored.own));
        let clouds = [(&rounded.own, &scene.own), (&rounded.background, &scene.background)];
        for (rounded, scene) in clouds {
            assert!(difference(&rounded.opacity_logits, &scene.opacity_logits, 1.0) <= 0.5);
            assert!(difference(rounded.means.as_flattened(), scene.means.as_flattened(), 1.0) <= 0.2);
        }
        // Of a scene with other rows it cannot be the plan.
        for change in [
            |cloud: &mut Gaussians| *cloud = Gaussians::default(),
            |cloud: &mut Gaussians| cloud.append(&cloud.clone()),
        ] {
            let mut other = scene.clone();
            change(&mut other.background);
            let refused = write_planned_scene_file(&file, &other, &plan).expect_err("does not fit").to_string();
            assert!(refused.contains("another scene"), "{refused}");
        }
    }
    Ok(())
}

#[test]
fn small_files_of_older_versions_are_read() -> Result<(), IoError> {
    // Written with `export --pack small` from small_tables.ply by versions 0.1.0 of 2026-11-25 (format 2) and 2026-11-27 (3).
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fixtures"));
    let cloud = crate::read_ply(&folder.join("small_tables.ply"))?;
    let want = in_file_order(&InstancedScene::from_cloud(cloud)).background;
    for name in ["small_tables.instgs", "small_coded.instgs"] {
        let back = crate::read_scene_file(&folder.join(name))?.background;
        assert_eq!((want.len(), want.sh_degree), (back.len(), back.sh_degree), "{name}");
        assert!(difference(want.sh.as_flattened(), back.sh.as_flattened(), 1.0) <= 0.01001, "{name}");
        assert!(difference(want.log_scales.as_flattened(), back.log_scales.as_flattened(), 1.0) <= 0.02501, "{name}");
        assert!(turned(&want.quats, &back.quats) < 2.0 * 0.0028 * 3.0f64.sqrt() * 1.5, "{name}");
        let size = want.log_scales.iter().map(|s| (s.iter().sum::<f32>() / 3.0).exp()).fold(0.0, f32::max);
        assert!(difference(want.means.as_flattened(), back.means.as_flattened(), 1.0) <= size / 22.0, "{name}");
    }
    Ok(())
}

/// Format 4, which has templates, offsets of shapes and own Gaussians: written by the version of 2026-11-27 from these scenes.
#[test]
fn small_scenes_of_format_4_are_read() -> Result<(), IoError> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fixtures"));
    for (name, scene) in [("small_ablations_4.instgs", with_ablations()), ("small_own_4.instgs", with_own())] {
        let back = crate::read_scene_file(&folder.join(name))?;
        let want = in_file_order(&scene);
        assert_eq!((&back.instances, &back.own_ranges), (&want.instances, &want.own_ranges), "{name}");
        let clouds = [(&want.templates, &back.templates), (&want.own, &back.own), (&want.background, &back.background)];
        for (a, b) in clouds {
            assert_eq!((a.sh_degree, a.len()), (b.sh_degree, b.len()), "{name}");
            assert!(difference(&opponent(&a.sh), &opponent(&b.sh), 1.0) <= 0.01001, "{name}");
            assert!(difference(&a.opacity_logits, &b.opacity_logits, 1.0) <= 0.05001, "{name}");
            // Half a step of a size is 0.025; a turn of an ellipsoid moves its logarithm by as much as its axes differ.
            assert!(difference(&log_covariances(a), &log_covariances(b), 1.0) < 0.2, "{name}");
        }
        assert!(difference(&opponent(&want.offsets.sh_dc), &opponent(&back.offsets.sh_dc), 1.0) <= 0.02001, "{name}");
        let error = covariance_difference(&expanded_covariances(&want), &expanded_covariances(&back));
        assert!(error < 0.25, "{name}: {error}");
    }
    Ok(())
}

#[test]
fn a_table_that_claims_too_many_rows_is_refused() {
    // All values equal: 30 million rows in some hundred bytes.
    let mut scene = InstancedScene::from_cloud(Gaussians::with_capacity(0, 0));
    let cloud = sample(0, 1);
    for _ in 0..60_000 {
        scene.background.push_from(&cloud, 0);
    }
    let bytes = packed_scene_file_bytes(&scene, Pack::Small, path()).expect("written");
    // What does not look like a scene keeps its positions as floats, and comes back.
    assert!(bytes.len() > 12 * 60_000);
    assert_eq!(parse_scene_file(&bytes, path()).expect("read").background.means, scene.background.means);
}

#[test]
fn small_keeps_what_has_no_place_in_a_table() -> Result<(), IoError> {
    let mut scene = sample_scene();
    scene.foreign_tensors.clear();
    scene.templates.sh[3][1] = f32::NAN;
    scene.templates.quats[2] = [0.0; 4];
    scene.templates.means[1][0] = 3e30;
    scene.templates.log_scales[0][0] = f32::NEG_INFINITY;
    let back = through(&scene, Pack::Small)?.templates;
    assert!(difference(back.sh.as_flattened(), scene.templates.sh.as_flattened(), 1.0) == 0.0);
    assert_eq!((&back.quats, &back.log_scales), (&scene.templates.quats, &scene.templates.log_scales));
    assert!((back.means[1][0] - 3e30).abs() < 1e26);
    Ok(())
}

/// The steps of positions follow what is seen of a Gaussian, not how thin a sheet is: a log scale of -87.3 is that of 2D Gaussians.
#[test]
fn positions_of_flat_gaussians_are_no_finer_than_those_of_thin_ones() -> Result<(), IoError> {
    let positions = |thinnest: f32| -> Result<Vec<u8>, IoError> {
        let mut cloud = sample(0, 50);
        cloud.log_scales.fill([-3.0, thinnest, -3.5]);
        let bytes = packed_scene_file_bytes(&InstancedScene::from_cloud(cloud), Pack::Small, path())?;
        let tensors = safetensors::SafeTensors::deserialize(&bytes).expect("a file");
        Ok(tensors.tensor("background.means.coded").expect("is there").data().to_vec())
    };
    let thin = positions(-11.0)?;
    assert!(positions(crate::LEAST_LOG_SCALE)? == thin && positions(f32::NEG_INFINITY)? == thin);
    assert!(positions(-5.0)? != thin, "a thousandth of the longest axis is not reached");
    Ok(())
}

#[test]
fn small_is_a_quarter_of_halves_or_less() -> Result<(), IoError> {
    // Colours and sizes with the noise of trained clouds (standard deviations of SH 0.03, of log sizes 1).
    let mut rng = Rng::new(8);
    let mut cloud = sample(3, 4000);
    cloud.sh.iter_mut().flatten().for_each(|v| *v = (0.03 * rng.normal()) as f32);
    cloud.log_scales.iter_mut().flatten().for_each(|v| *v = (rng.normal() - 3.0) as f32);
    cloud.quats.iter_mut().flatten().for_each(|v| *v = rng.normal() as f32);
    cloud.opacity_logits.iter_mut().for_each(|v| *v = rng.normal() as f32);
    cloud.means.iter_mut().flatten().for_each(|v| *v = rng.uniform() as f32);
    let scene = InstancedScene::from_cloud(cloud);
    let bytes = |pack| packed_scene_file_bytes(&scene, pack, path()).map(|bytes| bytes.len());
    let (f16, small) = (bytes(Pack::F16)?, bytes(Pack::Small)?);
    assert!(4 * small < f16, "{small} {f16}");
    Ok(())
}

#[test]
fn damaged_tables_are_named() -> Result<(), IoError> {
    let mut scene = repeated(2, 30);
    (scene.offsets.quats, scene.offsets.log_scales) = (vec![[0.1, 0.0, 0.2, 0.0]; 60], vec![[0.1, 0.0, -0.1]; 60]);
    let bytes = packed_scene_file_bytes(&scene, Pack::Small, path())?;
    let names = [
        "template.means",
        "template.log_covariances",
        "template.opacity_logits",
        "template.sh",
        "offset.log_covariances",
        "offset.means",
    ];
    let (header_bytes, metadata) = safetensors::SafeTensors::read_metadata(&bytes).expect("a header");
    for name in names {
        let name = format!("{name}.coded");
        let at = 8 + header_bytes + metadata.info(&name).expect("is there").data_offsets.0;
        // Rows, width, and number of parts.
        for offset in [0, 8, 10] {
            let mut other = bytes.clone();
            other[at + offset] ^= 1;
            let error = parse_scene_file(&other, path()).expect_err("is damaged").to_string();
            assert!(error.contains(&name[..name.find('.').unwrap_or(0)]), "{error}");
        }
    }
    let text = String::from_utf8_lossy(&bytes[..header_bytes]).into_owned();
    assert!(text.contains("instgs/5"), "{text}");
    Ok(())
}
