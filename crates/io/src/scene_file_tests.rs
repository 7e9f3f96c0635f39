use super::*;
use crate::scene_pack::{Pack, floats};
use crate::scene_write::{assemble, packed_scene_file_bytes, scene_file_bytes, u32s};
use instgs_samples::{sample, sample_scene, with_ablations, with_levels, with_low_sh_offsets, with_own};

#[test]
fn what_is_written_is_read_and_bytes_are_the_same_each_time() -> Result<(), IoError> {
    let path = Path::new("x.instgs");
    let cloud = InstancedScene::from_cloud(sample(1, 2));
    let mut colored = sample_scene();
    let matrix = |k: usize| [0, 1, 2].map(|r| [0, 1, 2, 3].map(|c| (100 * k + 10 * r + c) as f32));
    colored.color_from_template = (0..4).map(matrix).collect();
    let scenes = [
        sample_scene(),
        with_ablations(),
        with_low_sh_offsets(),
        colored,
        with_own(),
        with_levels(),
        InstancedScene::default(),
        cloud,
    ];
    for scene in scenes {
        let bytes = scene_file_bytes(&scene, path)?;
        for _ in 0..5 {
            let back = parse_scene_file(&bytes, path)?;
            assert_eq!(back, scene);
            assert_eq!(scene_file_bytes(&back, path)?, bytes);
        }
    }
    Ok(())
}

/// The sample's file with one change in its tensors or metadata.
fn changed(
    change: impl FnOnce(&mut BTreeMap<String, ForeignTensor>, &mut BTreeMap<String, String>),
) -> Result<InstancedScene, IoError> {
    changed_file(&sample_scene(), change)
}

/// A scene's file with one change in its tensors or metadata.
fn changed_file(
    scene: &InstancedScene,
    change: impl FnOnce(&mut BTreeMap<String, ForeignTensor>, &mut BTreeMap<String, String>),
) -> Result<InstancedScene, IoError> {
    let path = Path::new("x.instgs");
    let bytes = scene_file_bytes(scene, path)?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|e| IoError::new(path, e.to_string()))?;
    let views = SafeTensors::deserialize(&bytes).map_err(|e| IoError::new(path, e.to_string()))?;
    let mut metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    let mut tensors = views
        .iter()
        .map(|(n, v)| {
            (
                n.to_owned(),
                ForeignTensor { dtype: dtype_name(v.dtype()), shape: v.shape().to_vec(), bytes: v.data().to_vec() },
            )
        })
        .collect();
    change(&mut tensors, &mut metadata);
    parse_scene_file(&assemble(&metadata, &tensors, path)?, path)
}

#[test]
fn errors_name_the_tensor_and_the_reason() {
    let text = |result: Result<InstancedScene, IoError>| result.err().map(|e| e.to_string()).unwrap_or_default();
    let missing = text(changed(|t, _| drop(t.remove("template.quats"))));
    assert!(missing.contains("tensor template.quats: is missing"), "{missing}");
    let shape = text(changed(|t, _| drop(t.insert("offset.sh_dc".into(), floats(&[8, 2], &[0.0; 16])))));
    assert!(shape.contains("offset.sh_dc") && shape.contains("[8, 3]"), "{shape}");
    let dtype = text(changed(|t, _| drop(t.insert("background.means".into(), u32s(&[4, 3], 0..12)))));
    assert!(dtype.contains("background.means") && dtype.contains("U32"), "{dtype}");
    let pose =
        text(changed(|t, _| drop(t.insert("instance.world_from_template".into(), floats(&[4, 3, 4], &[0.0; 48])))));
    assert!(pose.contains("instance.world_from_template") && pose.contains("instance 0"), "{pose}");
    let index = text(changed(|t, _| drop(t.insert("instance.template".into(), u32s(&[4], [0, 1, 2, 0].into_iter())))));
    assert!(index.contains("instance.template"), "{index}");
    let bytes = |shape: &[usize]| ForeignTensor {
        dtype: "U8".into(),
        shape: shape.into(),
        bytes: vec![3; shape.iter().product()],
    };
    let lone = text(changed(|t, _| drop(t.insert("offset.range".into(), floats(&[3, 7, 2], &[0.0; 42])))));
    assert!(lone.contains("offset.range: is present, but no"), "{lone}");
    let bare = text(changed(|t, _| drop(t.insert("offset.sh_dc".into(), bytes(&[8, 3])))));
    assert!(bare.contains("offset.range: is missing"), "{bare}");
    let ranges = text(changed(|t, _| {
        t.insert("offset.sh_dc".into(), bytes(&[8, 3]));
        t.insert("offset.range".into(), floats(&[4, 7, 2], &[0.0; 56]));
    }));
    assert!(ranges.contains("offset.range") && ranges.contains("[3, 7, 2]"), "{ranges}");
    let packed = text(changed(|t, _| drop(t.insert("template.quats".into(), bytes(&[5, 4])))));
    assert!(packed.contains("template.quats: has the type U8"), "{packed}");
    let rest = text(changed(|t, _| drop(t.insert("offset.sh_rest".into(), floats(&[8, 4, 3], &[0.0; 96])))));
    assert!(rest.contains("offset.sh_rest") && rest.contains("[8, 8, 3]"), "{rest}");
    let colors = text(changed(|t, _| {
        drop(t.insert("instance.color_from_template".into(), floats(&[3, 3, 4], &[0.0; 36])));
    }));
    assert!(colors.contains("instance.color_from_template") && colors.contains("[4, 3, 4]"), "{colors}");
    let infinite = text(changed(|t, _| {
        drop(t.insert("instance.color_from_template".into(), floats(&[4, 3, 4], &[f32::INFINITY; 48])));
    }));
    assert!(infinite.contains("that of instance 0 is not finite"), "{infinite}");
    let levels =
        |change: fn(&mut BTreeMap<String, ForeignTensor>)| text(changed_file(&with_levels(), |t, _| change(t)));
    for (tensor, shape, values, reason) in [
        ("level.ranges", &[3, 2][..], &[0, 2, 2, 1, 3, 2][..], "level 2 has 2 Gaussians from 3, not some of 4 from 3"),
        ("level.ranges", &[3, 2], &[0, 2, 1, 1, 2, 1], "level 1 has 1 Gaussians from 1, not some of 4 from 2"),
        ("level.ranges", &[3, 2], &[0, u32::MAX, 1, 1, 2, 1], "level 0 has 4294967295 Gaussians from 0"),
        ("level.template_print", &[2, 2], &[0; 4], "has 2 rows where level.ranges has 3"),
    ] {
        let changed = text(changed_file(&with_levels(), |t, _| {
            drop(t.insert(tensor.into(), u32s(shape, values.iter().copied())));
        }));
        assert!(changed.contains(tensor) && changed.contains(reason), "{changed}");
    }
    let cells = levels(|t| drop(t.insert("level.cell".into(), floats(&[3], &[0.5, f32::NAN, 1.0]))));
    assert!(cells.contains("level.cell: that of level 1 is NaN"), "{cells}");
    let degree = levels(|t| drop(t.insert("level.sh".into(), floats(&[4, 1, 3], &[0.0; 12]))));
    assert!(degree.contains("level.sh: has degree 0 where template.sh has 2"), "{degree}");
    let lone = levels(|t| drop(t.remove("level.cell")));
    assert!(lone.contains("level.cell: is missing"), "{lone}");
    let own = |change: fn(&mut BTreeMap<String, ForeignTensor>)| text(changed_file(&with_own(), |t, _| change(t)));
    let unowned = own(|t| drop(t.remove("instance.own")));
    assert!(unowned.contains("instance.own: is missing"), "{unowned}");
    let beyond =
        own(|t| drop(t.insert("instance.own".into(), u32s(&[4, 2], [u32::MAX, 1, 0, 0, 0, 0, 0, 0].into_iter()))));
    assert!(beyond.contains("instance.own") && beyond.contains("end at 4294967296"), "{beyond}");
    let few = own(|t| drop(t.insert("instance.own".into(), u32s(&[2, 2], [0, 1, 0, 0].into_iter()))));
    assert!(few.contains("instance.own") && few.contains("2 entries where 4"), "{few}");
    let degree = own(|t| drop(t.insert("own.sh".into(), floats(&[3, 1, 3], &[0.0; 9]))));
    assert!(degree.contains("own.sh") && degree.contains("degree 0 where template.sh has 2"), "{degree}");
    let part = own(|t| drop(t.remove("own.quats")));
    assert!(part.contains("own.quats: is missing"), "{part}");
    let orphan = text(changed(|t, _| drop(t.remove("offset.means"))));
    assert!(orphan.contains("offset.means: is missing"), "{orphan}");
    assert!(text(changed(|_, m| drop(m.remove("format")))).contains("metadata format"));
    assert!(text(changed(|_, m| drop(m.insert("format".into(), "instgs/6".into())))).contains("newer version"));
    assert!(text(changed(|_, m| drop(m.insert("antialias".into(), "yes".into())))).contains("antialias"));
    for bad in ["wide", "0", "-1", "NaN", "inf"] {
        assert!(
            text(changed(|_, m| drop(m.insert("dilation_px2".into(), bad.into())))).contains("dilation_px2"),
            "{bad}"
        );
    }
    for bad in ["here", "-1", "NaN", "inf"] {
        assert!(text(changed(|_, m| drop(m.insert("near".into(), bad.into())))).contains("metadata near"), "{bad}");
    }
    assert!(text(changed(|_, m| drop(m.insert("groups".into(), "[{}]".into())))).contains("groups"));
}

/// Only a near plane that is not the usual one takes bytes, so that files of before stay as they were.
#[test]
fn the_near_plane_comes_back() -> Result<(), IoError> {
    let path = Path::new("x.instgs");
    let usual = sample_scene();
    let close = InstancedScene { near_plane: NearPlane(0.015), ..usual.clone() };
    for pack in [Pack::F32, Pack::F16, Pack::Small] {
        let bytes = packed_scene_file_bytes(&close, pack, path)?;
        assert_eq!(parse_scene_file(&bytes, path)?.near_plane, NearPlane(0.015), "{pack:?}");
    }
    let bytes = packed_scene_file_bytes(&usual, Pack::F32, path)?;
    assert!(!bytes.windows(6).any(|text| text == b"\"near\""));
    assert_eq!(parse_scene_file(&bytes, path)?.near_plane, NearPlane::default());
    Ok(())
}

/// Poses say how many instances there are. Both forms have all that a reader looks at before it allocates.
#[test]
fn coded_poses_that_claim_more_rows_than_their_bytes_make_plausible_are_refused() {
    const ROWS: u64 = 500_000_000;
    let numbers: u16 = 12;
    // One part, no flags; its columns, step, largest step and kind; the centres.
    let mut coded = [&ROWS.to_le_bytes()[..], &numbers.to_le_bytes(), &[1, 0], &numbers.to_le_bytes()].concat();
    coded.extend([1.0f32; 2].map(f32::to_le_bytes).as_flattened());
    coded.push(0);
    coded.extend([0u8; 4 * 12]);
    // Rows, numbers in each, rows in a block; then as many bytes as so many rows need in the table of format 2.
    let table =
        [&ROWS.to_le_bytes()[..], &u32::from(numbers).to_le_bytes(), &256u32.to_le_bytes(), &[0; 8000]].concat();
    for (suffix, bytes) in [(CODED, coded), (SUFFIX, table)] {
        let what = format!("claims {ROWS} rows in {} bytes, more than is plausible", bytes.len());
        let name = format!("instance.world_from_template{suffix}");
        let place = format!("tensor {name}: ");
        let refused = changed(|tensors, _| {
            tensors.remove("instance.world_from_template");
            tensors.insert(name, ForeignTensor { dtype: "U8".into(), shape: vec![bytes.len()], bytes });
        });
        let text = refused.err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains(&place) && text.contains(&what), "{text}");
    }
}

#[test]
fn optional_parts_may_be_absent_and_halves_are_read() -> Result<(), IoError> {
    let scene = changed(|tensors, metadata| {
        tensors.retain(|n, _| n.starts_with("background."));
        metadata.retain(|n, _| n == "format");
        for tensor in tensors.values_mut() {
            tensor.dtype = "F16".into();
            tensor.bytes = tensor
                .bytes
                .as_chunks::<4>()
                .0
                .iter()
                .flat_map(|&b| half::f16::from_f32(f32::from_le_bytes(b)).to_le_bytes())
                .collect();
        }
    })?;
    assert!(scene.instances.is_empty() && scene.templates.is_empty() && scene.pixel_filter == PixelFilter::default());
    let want = sample_scene().background;
    assert!((scene.background.means[3][2] - want.means[3][2]).abs() < 2e-3);
    Ok(())
}
