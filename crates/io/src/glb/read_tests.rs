//! Reading `.glb`: files of this program, of other programs, and damaged ones.

use std::path::Path;

use glam::{DMat3, DVec3};
use instgs_samples::{sample_scene, with_ablations, with_low_sh_offsets, with_own};
use instgs_vk::math::covariance::covariance;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::{eval_sh, widened};
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use instgs_vk::scene::{Gaussians, InstancedScene};

use super::read::{GlbScene, parse_glb};
use super::write_glb;
use crate::IoError;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn path() -> &'static Path {
    Path::new("x.glb")
}

fn written(scene: &InstancedScene, up: DVec3) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("x.glb");
    write_glb(&file, scene, up)?;
    Ok(std::fs::read(file)?)
}

fn assert_near(a: &[f32], b: &[f32], what: &str) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (x, y) in a.iter().zip(b) {
        assert!((x - y).abs() <= 1e-5 * (1.0 + y.abs()), "{what}: {x} {y}");
    }
}

fn assert_same_cloud(a: &Gaussians, b: &Gaussians) {
    assert_eq!((a.len(), a.sh_degree), (b.len(), b.sh_degree));
    assert_near(a.means.as_flattened(), b.means.as_flattened(), "means");
    assert_near(a.log_scales.as_flattened(), b.log_scales.as_flattened(), "log scales");
    assert_near(&a.opacity_logits, &b.opacity_logits, "opacity logits");
    assert_near(a.sh.as_flattened(), b.sh.as_flattened(), "SH");
    for (p, q) in a.quats.iter().zip(&b.quats) {
        let length = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>().sqrt();
        let dot: f32 = p.iter().zip(q).map(|(x, y)| x * y).sum();
        assert!((dot.abs() / (length(p) * length(q)) - 1.0).abs() < 1e-5, "{p:?} {q:?}");
    }
}

/// The same cloud, Gaussian by Gaussian, whatever direction was up.
#[test]
fn scenes_survive_writing_and_reading() -> Outcome {
    let coloured = InstancedScene {
        color_from_template: vec![SAME_COLOR.map(|row| row.map(|v| 0.8 * v + 0.05)); 4],
        ..sample_scene()
    };
    let low = with_low_sh_offsets();
    // As the defaults train: each instance has its own scales, rotations and all SH.
    let own_looks = InstancedScene { color_from_template: coloured.color_from_template.clone(), ..with_ablations() };
    for (scene, instances, records, degree) in [
        (sample_scene(), 4, 5, 0),
        (with_own(), 6, 5, 0),
        (low, 4, 5, 1),
        (coloured, 4, 5, 2),
        (with_ablations(), 4, 5, 2),
        (own_looks, 4, 5, 2),
    ] {
        for up in [DVec3::NEG_Y, DVec3::new(1.0, 2.0, -0.5)] {
            let GlbScene { scene: back, notes } = parse_glb(&written(&scene, up)?, path())?;
            assert!(notes.is_empty(), "{notes:?}");
            assert_eq!((back.instances.len(), back.offsets.len()), (instances, records));
            assert_eq!(back.offsets.sh_degree(), degree);
            let of_shape = if scene.offsets.quats.is_empty() { 0 } else { records };
            assert_eq!((back.offsets.quats.len(), back.offsets.log_scales.len()), (of_shape, of_shape));
            assert_same_cloud(&back.flatten(), &scene.flatten());
            // Once more: nothing is lost on the way.
            let again = parse_glb(&written(&back, up)?, path())?.scene;
            assert_same_cloud(&again.flatten(), &scene.flatten());
        }
    }
    assert_eq!(parse_glb(&written(&InstancedScene::default(), DVec3::Y)?, path())?, GlbScene::default());
    Ok(())
}

/// What was an instance stays one, if it is the only one of its template; meshes of one template that another program has changed
/// are templates of their own, and each template's Gaussians count.
#[test]
fn numbers_of_templates_are_obeyed() -> Outcome {
    let mut one = sample_scene();
    one.instances.truncate(1);
    let back = parse_glb(&written(&one, DVec3::NEG_Y)?, path())?.scene;
    assert_eq!((back.instances.len(), back.background.len()), (1, one.background.len()));
    assert_same_cloud(&back.flatten(), &one.flatten());
    // The same mesh as an instance of two templates.
    let of_templates = |count: usize| -> Result<Result<GlbScene, IoError>, Box<dyn std::error::Error>> {
        let joined = |part: &dyn Fn(usize) -> String| (0..count).map(part).collect::<Vec<_>>().join(",");
        let children = joined(&|k| (k + 1).to_string());
        let json = foreign_json(&format!("{{\"children\":[{children}]}},{}", joined(&|k| format!("{{\"mesh\":{k}}}"))));
        let mut document: serde_json::Value = serde_json::from_str(&json)?;
        let mesh = document["meshes"][0].clone();
        document["meshes"] = (0..count)
            .map(|template| {
                let mut mesh = mesh.clone();
                mesh["extras"] = serde_json::json!({"instgs_template": template});
                mesh
            })
            .collect();
        Ok(parse_glb(&container(&document.to_string(), &foreign_binary()), path()))
    };
    let scene = of_templates(2)??.scene;
    assert_eq!((scene.instances.len(), scene.template_ranges.len(), scene.templates.len()), (2, 2, 4));
    // Not all bytes of a file can be Gaussians of many templates.
    let error = of_templates(50)?.err().ok_or("too many are read")?;
    assert!(error.to_string().contains("claims 100 Gaussians"), "{error}");
    Ok(())
}

/// A container of the two chunks.
fn container(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = b"glTF".to_vec();
    for word in [2, total as u32, json.len() as u32] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    out.extend_from_slice(b"JSON");
    out.extend_from_slice(&json);
    out.extend_from_slice(&(binary.len() as u32).to_le_bytes());
    out.extend_from_slice(b"BIN\0");
    out.extend_from_slice(binary);
    out
}

/// Two Gaussians of SH degree 1 as other programs may write them: rows of 32 bytes of position (f32), rotation (i16), scale
/// (u8), opacity (u8) and two floats that are not used; behind the rows three floats each, for all SH coefficients alike.
fn foreign_binary() -> Vec<u8> {
    let mut out = Vec::new();
    for (position, rotation, scale, opacity) in [
        ([1.0f32, 2.0, 3.0], [0i16, 0, 0, 32767], [1u8, 2, 4], 128u8),
        ([-1.0, 0.5, 0.0], [0, 0, 23170, 23170], [3, 1, 2], 255),
    ] {
        position.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        rotation.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
        out.extend_from_slice(&scale);
        out.push(opacity);
        [0.5f32, -0.25].iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
    }
    [0.1f32, 0.2, 0.3, -0.1, -0.2, -0.3].iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
    out
}

const PREFIX: &str = "KHR_gaussian_splatting";

/// The document of [`foreign_binary`], whose nodes are given.
fn foreign_json(nodes: &str) -> String {
    let accessor = |view: u32, offset: u32, component: u32, normalized: bool, kind: &str| {
        format!(
            r#"{{"bufferView":{view},"byteOffset":{offset},"componentType":{component},"normalized":{normalized},"count":2,"type":"{kind}"}}"#
        )
    };
    let accessors = [
        accessor(0, 0, 5126, false, "VEC3"),
        accessor(0, 12, 5122, true, "VEC4"),
        accessor(0, 20, 5121, false, "VEC3"),
        accessor(0, 23, 5121, true, "SCALAR"),
        accessor(1, 0, 5126, false, "VEC3"),
    ];
    let first = (0..3).map(|c| format!(r#""{PREFIX}:SH_DEGREE_1_COEF_{c}":4"#)).collect::<Vec<_>>().join(",");
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{nodes}],
        "meshes":[{{"primitives":[{{"mode":0,"attributes":{{"POSITION":0,"{PREFIX}:ROTATION":1,"{PREFIX}:SCALE":2,
        "{PREFIX}:OPACITY":3,"{PREFIX}:SH_DEGREE_0_COEF_0":4,{first}}},
        "extensions":{{"{PREFIX}":{{"kernel":"ellipse","colorSpace":"srgb_rec709_display"}}}}}}]}}],
        "accessors":[{}],
        "bufferViews":[{{"buffer":0,"byteLength":64,"byteStride":32}},{{"buffer":0,"byteOffset":64,"byteLength":24}}],
        "buffers":[{{"byteLength":88}}]}}"#,
        accessors.join(",")
    )
}

fn foreign(nodes: &str) -> Result<GlbScene, IoError> {
    parse_glb(&container(&foreign_json(nodes), &foreign_binary()), path())
}

/// What [`foreign_binary`] shows below a matrix: means, covariances, and colour from one side.
fn check_foreign(cloud: &Gaussians, linear: DMat3, translation: DVec3, turn: DMat3) {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let raw = [
        (DVec3::new(1.0, 2.0, 3.0), [1.0, 0.0, 0.0, 0.0], DVec3::new(1.0, 2.0, 4.0), DVec3::new(0.1, 0.2, 0.3)),
        (DVec3::new(-1.0, 0.5, 0.0), [half, 0.0, 0.0, half], DVec3::new(3.0, 1.0, 2.0), DVec3::new(-0.1, -0.2, -0.3)),
    ];
    // From glTF's axes to those of scenes.
    let to_scene = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    assert_eq!((cloud.len(), cloud.sh_degree), (2, 1));
    for (i, (mean, quat, scale, sh)) in raw.into_iter().enumerate() {
        let want = to_scene * (linear * mean + translation);
        assert!((widened(cloud.means[i]) - want).length() < 1e-5, "{want} {:?}", cloud.means[i]);
        let map = to_scene * linear;
        let want = map * covariance(quat, DVec3::from_array(scale.to_array().map(f64::ln))) * map.transpose();
        let got = covariance(cloud.quats[i].map(f64::from), widened(cloud.log_scales[i]));
        let apart = (got - want).to_cols_array().iter().fold(0.0f64, |m, v| m.max(v.abs()));
        assert!(apart < 1e-3, "{apart} {want} {got}");
        let side = DVec3::new(0.6, 0.0, 0.8);
        let coefficients = vec![sh.as_vec3().to_array(); 4];
        let seen = eval_sh(1, &coefficients, (to_scene * turn).transpose() * side);
        assert!((eval_sh(1, cloud.sh_of(i), side) - seen).length() < 1e-5);
    }
    assert!(cloud.opacity_logits[0].abs() < 0.01 && cloud.opacity_logits[1] > 13.0, "{:?}", cloud.opacity_logits);
}

#[test]
fn packed_attributes_and_nodes_of_other_programs_are_read() -> Outcome {
    let quarter = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let plain = foreign(r#"{"mesh":0}"#)?;
    assert!(plain.notes.is_empty() && plain.scene.instances.is_empty());
    check_foreign(&plain.scene.background, DMat3::IDENTITY, DVec3::ZERO, DMat3::IDENTITY);
    // Translation, rotation and scale, below a matrix.
    let placed = r#"{"children":[1],"matrix":[2,0,0,0, 0,2,0,0, 0,0,2,0, 1,2,3,1]},
        {"mesh":0,"rotation":[0,0.70710678,0,0.70710678],"translation":[1,0,0],"scale":[0.5,0.5,0.5]}"#;
    check_foreign(&foreign(placed)?.scene.background, quarter, DVec3::new(3.0, 2.0, 3.0), quarter);
    // A node that stretches: turn after stretch.
    let stretched = r#"{"mesh":0,"rotation":[0,0.70710678,0,0.70710678],"scale":[1,2,3]}"#;
    let linear = quarter * DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0));
    check_foreign(&foreign(stretched)?.scene.background, linear, DVec3::ZERO, quarter);
    // Mirrored.
    let mirrored = foreign(r#"{"mesh":0,"scale":[-1,1,1]}"#)?;
    assert!(mirrored.scene.background.is_empty() && mirrored.notes[0].contains("1 meshes"), "{:?}", mirrored.notes);
    Ok(())
}

/// One negative scale in any mesh tells how those of all are written.
#[test]
fn negative_scales_are_logarithms_in_all_of_the_file() -> Outcome {
    let two = foreign_json(r#"{"children":[1,2]},{"mesh":0},{"mesh":1}"#);
    // A second mesh, whose scales are the same bytes as numbers with a sign.
    let second = two.replacen("\"meshes\":[{", "\"meshes\":[{\"primitives\":[]},{", 1);
    let begin = second.find("{\"primitives\":[{").ok_or("no mesh")?;
    let end = second.find("],\n        \"accessors\"").ok_or("no accessors")?;
    let mesh = &second[begin..end];
    let signed = r#"{"bufferView":0,"byteOffset":20,"componentType":5120,"count":2,"type":"VEC3"}"#;
    let json = second.replacen("{\"primitives\":[]}", &mesh.replace("SCALE\":2", "SCALE\":5"), 1).replacen(
        "],\n        \"bufferViews\"",
        &format!(",{signed}],\n        \"bufferViews\""),
        1,
    );
    let read = |first: u8| {
        let mut binary = foreign_binary();
        binary[20] = first;
        parse_glb(&container(&json, &binary), path())
    };
    let plain = read(1)?;
    assert!(plain.notes.is_empty(), "{:?}", plain.notes);
    assert_near(&plain.scene.background.log_scales[0], &[1.0, 2.0, 4.0].map(f32::ln), "scales");
    let logs = read(0xFF)?;
    assert!(logs.notes.len() == 1 && logs.notes[0].contains("logarithms"), "{:?}", logs.notes);
    assert_eq!(
        logs.scene.background.log_scales,
        [[-1.0, 2.0, 4.0], [3.0, 1.0, 2.0], [255.0, 2.0, 4.0], [3.0, 1.0, 2.0]]
    );
    Ok(())
}

#[test]
fn the_same_mesh_twice_is_a_template() -> Outcome {
    let GlbScene { scene, .. } = foreign(r#"{"children":[1,2]},{"mesh":0},{"mesh":0,"translation":[5,0,0]}"#)?;
    assert_eq!((scene.templates.len(), scene.instances.len(), scene.offsets.len()), (2, 2, 0));
    assert!(scene.background.is_empty() && scene.instances.iter().all(|i| i.first_offset.is_none()));
    let flat = scene.flatten();
    check_foreign(&flat.filtered(|i| i < 2), DMat3::IDENTITY, DVec3::ZERO, DMat3::IDENTITY);
    check_foreign(&flat.filtered(|i| i >= 2), DMat3::IDENTITY, DVec3::new(5.0, 0.0, 0.0), DMat3::IDENTITY);
    Ok(())
}

#[test]
fn errors_and_notes_name_what_is_wrong() -> Outcome {
    let json = foreign_json(r#"{"mesh":0}"#);
    let with = |from: &str, to: &str| {
        assert!(json.contains(from), "{from}");
        parse_glb(&container(&json.replacen(from, to, 1), &foreign_binary()), path())
    };
    for (from, to, want) in [
        ("\"count\":2", "\"count\":3", "do not fit"),
        ("\"count\":2", "\"count\":99999999999", "claims 99999999999 Gaussians in 88 bytes"),
        ("\"byteLength\":64", "\"byteLength\":89", "89 bytes from 0 on, of a binary chunk of 88"),
        ("{\"byteLength\":88}", "{\"uri\":\"a.bin\"}", "outside of the file's binary chunk; write it as one .glb"),
        ("\"type\":\"VEC3\"", "\"type\":\"VEC2\"", "accessors[0]: has elements VEC2, not VEC3"),
        ("\"componentType\":5126", "\"componentType\":5125", "component type 5125"),
        ("KHR_gaussian_splatting:OPACITY", "OPACITY", "has no attribute KHR_gaussian_splatting:OPACITY"),
        ("SH_DEGREE_1_COEF_1", "SH_DEGREE_1_COEF_7", "has no attribute KHR_gaussian_splatting:SH_DEGREE_1_COEF_1"),
        ("{\"mesh\":0}", "{\"mesh\":4}", "nodes[0]: names a mesh that does not exist"),
        ("{\"mesh\":0}", "{\"children\":[0]}", "nodes[0]: has two parents"),
        ("\"KHR_gaussian_splatting\":{", "\"other\":{", "has no placed mesh with KHR_gaussian_splatting; this is"),
        ("{\"kernel\"", "{\"extensions\":{\"X_compression\":{}},\"kernel\"", "compressed by X_compression"),
        ("\"asset\"", "\"asset\":", "JSON part that cannot be used"),
        (
            "\"asset\"",
            "\"extensionsRequired\":[\"KHR_gaussian_splatting\",\"EXT_mesh_gpu_instancing\"],\"asset\"",
            "extensionsRequired: requires the extension EXT_mesh_gpu_instancing, which is not read; write it without that",
        ),
        (
            "\"asset\"",
            "\"extensionsRequired\":[\"EXT_meshopt_compression\"],\"asset\"",
            "requires the extension EXT_meshopt_compression, which is not read; write them without compression",
        ),
    ] {
        let text = with(from, to).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains(want) && !text.contains('\n'), "{want}: {text}");
    }
    let fine = with("\"asset\"", r#""extensionsRequired":["KHR_mesh_quantization","KHR_gaussian_splatting"],"asset""#)?;
    assert_eq!(fine, foreign(r#"{"mesh":0}"#)?);
    // Where the extension is not required, a mesh is placed once, and the note comes once.
    let many = r#"{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}"#;
    let many = foreign(&format!(r#"{{"children":[1,2]}},{many},{many}"#))?;
    assert!(many.notes.len() == 1 && many.notes[0].contains("EXT_mesh_gpu_instancing"), "{:?}", many.notes);
    assert_eq!(many.scene.instances.len(), 2);
    let linear = with("srgb_rec709_display", "lin_rec709_display")?;
    assert!(linear.notes[0].contains("lin_rec709_display"), "{:?}", linear.notes);
    assert!(parse_glb(b"hello world!", path()).is_err_and(|e| e.to_string().contains("is not a GLB file")));
    Ok(())
}

#[test]
fn damage_is_an_error_or_another_scene() -> Outcome {
    let bytes = written(&with_own(), DVec3::NEG_Y)?;
    assert!((0..bytes.len()).step_by(7).all(|end| parse_glb(&bytes[..end], path()).is_err()));
    let json_end = 20 + bytes[12..16].iter().rev().fold(0, |sum, &byte| sum << 8 | usize::from(byte));
    let mut rng = Rng::new(2);
    for _ in 0..2000 {
        let mut damaged = bytes.clone();
        let at = rng.index(json_end);
        damaged[at] = b"0123456789,{}[]\"x"[rng.index(17)];
        if let Ok(read) = parse_glb(&damaged, path()) {
            assert_eq!(read.scene.validate(), Ok(()));
        }
    }
    Ok(())
}
