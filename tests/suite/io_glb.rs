//! `.glb` files as another program reads them: the crate `gltf` checks the document and rebuilds the world from nodes and
//! accessors, and the result is compared with `InstancedScene::flatten`.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf::Gltf;
use instgs_io::write_glb;
use instgs_vk::math::covariance::covariance;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, Instance, InstancedScene, Offsets, SourceRange};

const PREFIX: &str = "KHR_gaussian_splatting:";

/// A Gaussian as a viewer would place it in the scene's world (below the root node).
struct WorldSplat {
    mean: DVec3,
    covariance: DMat3,
    opacity: f64,
    /// In the frame of the node, as stored.
    sh: Vec<[f32; 3]>,
    node_rotation: DMat3,
}

/// Reads all splats below the root node with the crate `gltf`, whose validation must pass. It knows no semantics of
/// extensions, but any that begin with an underscore: the prefix is replaced by one of the same length.
fn read_world(bytes: &[u8]) -> (DMat4, Vec<WorldSplat>) {
    let container = gltf::Glb::from_slice(bytes).unwrap();
    let underscores = "_".repeat(PREFIX.len());
    let json = std::str::from_utf8(&container.json).unwrap().replace(PREFIX, &underscores);
    let renamed = gltf::Glb { json: json.into_bytes().into(), ..container };
    let gltf = Gltf::from_slice(&renamed.to_vec().unwrap()).unwrap();
    assert_eq!(gltf.extensions_used().collect::<Vec<_>>(), ["KHR_gaussian_splatting"]);
    assert_eq!(gltf.extensions_required().count(), 0);
    let root = gltf.default_scene().unwrap().nodes().next().unwrap();
    let mut out = Vec::new();
    for node in root.children() {
        read_node(&node, DMat4::IDENTITY, gltf.blob.as_deref().unwrap(), &mut out);
    }
    (matrix(&root), out)
}

fn matrix(node: &gltf::Node) -> DMat4 {
    let (t, r, s) = node.transform().decomposed();
    DMat4::from_scale_rotation_translation(
        DVec3::from_array(s.map(f64::from)),
        DQuat::from_array(r.map(f64::from)),
        DVec3::from_array(t.map(f64::from)),
    )
}

fn read_node(node: &gltf::Node, world_from_parent: DMat4, blob: &[u8], out: &mut Vec<WorldSplat>) {
    let world_from_node = world_from_parent * matrix(node);
    let (_, rotation, _) = world_from_node.to_scale_rotation_translation();
    let node_rotation = DMat3::from_quat(rotation);
    let linear = DMat3::from_mat4(world_from_node);
    let primitive = node.mesh().unwrap().primitives().next().unwrap();
    assert_eq!(primitive.mode(), gltf::mesh::Mode::Points);
    let splats = primitive.extension_value("KHR_gaussian_splatting").unwrap();
    assert_eq!(
        (splats["kernel"].as_str(), splats["colorSpace"].as_str()),
        (Some("ellipse"), Some("srgb_rec709_display"))
    );
    let attributes: BTreeMap<String, Vec<Vec<f32>>> =
        primitive.attributes().map(|(semantic, a)| (name_of(&semantic), elements(&a, blob))).collect();
    let (positions, scales) = (&attributes["POSITION"], &attributes["SCALE"]);
    let bounds = primitive.bounding_box();
    for (i, position) in positions.iter().enumerate() {
        let position: [f32; 3] = position.as_slice().try_into().unwrap();
        assert!((0..3).all(|k| (bounds.min[k]..=bounds.max[k]).contains(&position[k])));
        let [x, y, z, w] = attributes["ROTATION"][i].as_slice().try_into().unwrap();
        assert!((f64::from(x * x + y * y + z * z + w * w) - 1.0).abs() < 1e-6);
        let log_scales = DVec3::from_slice(&scales[i].iter().map(|&s| f64::from(s).ln()).collect::<Vec<_>>());
        let local = covariance([w, x, y, z].map(f64::from), log_scales);
        let degrees = (0..=3).take_while(|d| attributes.contains_key(&format!("SH_DEGREE_{d}_COEF_0")));
        let names = degrees.flat_map(|d: u32| (0..=2 * d).map(move |c| format!("SH_DEGREE_{d}_COEF_{c}")));
        out.push(WorldSplat {
            mean: world_from_node.transform_point3(DVec3::from_array(position.map(f64::from))),
            covariance: linear * local * linear.transpose(),
            opacity: f64::from(attributes["OPACITY"][i][0]),
            sh: names.map(|name| attributes[&name][i].as_slice().try_into().unwrap()).collect(),
            node_rotation,
        });
    }
    node.children().for_each(|child| read_node(&child, world_from_node, blob, out));
}

fn name_of(semantic: &gltf::Semantic) -> String {
    match semantic {
        gltf::Semantic::Extras(name) => name.trim_start_matches('_').to_owned(),
        other => other.to_string(),
    }
}

fn elements(accessor: &gltf::Accessor, blob: &[u8]) -> Vec<Vec<f32>> {
    assert_eq!(accessor.data_type(), gltf::accessor::DataType::F32);
    let width = accessor.dimensions().multiplicity();
    let begin = accessor.view().unwrap().offset() + accessor.offset();
    let data = &blob[begin..begin + 4 * width * accessor.count()];
    let floats: Vec<f32> = data.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    floats.chunks_exact(width).map(<[f32]>::to_vec).collect()
}

/// A cloud whose values all differ.
fn cloud(sh_degree: u32, count: usize, seed: f32) -> Gaussians {
    let wave = |k: usize| (seed + k as f32 * 1.7).sin();
    let mut out = Gaussians::with_capacity(sh_degree, count);
    for i in 0..count {
        let k = 31 * i;
        out.means.push([wave(k), wave(k + 1), 2.0 * wave(k + 2)]);
        out.quats.push([2.0 + wave(k + 3), wave(k + 4), wave(k + 5), wave(k + 6)]);
        out.log_scales.push([wave(k + 7) - 3.0, wave(k + 8) - 3.0, wave(k + 9) - 3.0]);
        out.opacity_logits.push(3.0 * wave(k + 10));
        out.sh.extend((0..sh_coefficients(sh_degree)).map(|c| [wave(k + c), wave(k + c + 11), wave(k + c + 12)]));
    }
    out
}

/// Templates of 7 and 5, five instances (offsets, none, offsets, shared offsets, none), a background of 9 with less SH.
fn scene() -> InstancedScene {
    let values = cloud(0, 19, 5.0);
    let tilted = |k: f64| DMat3::from_axis_angle(DVec3::new(1.0, k, -0.5).normalize(), 0.8 + k);
    let instance = |k: u32, template, first_offset| Instance {
        template,
        world_from_template: Similarity::from_parts(
            tilted(f64::from(k)),
            0.5 + 0.4 * f64::from(k),
            DVec3::new(f64::from(k), -2.0, 0.3 * f64::from(k)),
        ),
        first_offset,
    };
    InstancedScene {
        templates: cloud(3, 12, 1.0),
        template_ranges: vec![SourceRange { first: 0, count: 7 }, SourceRange { first: 7, count: 5 }],
        instances: vec![
            instance(0, 0, Some(0)),
            instance(1, 1, None),
            instance(2, 0, Some(7)),
            instance(3, 0, Some(7)),
            instance(4, 1, Some(14)),
        ],
        offsets: Offsets {
            means: values.means.iter().map(|m| m.map(|v| 0.1 * v)).collect(),
            sh_dc: values.sh,
            opacity_logits: values.opacity_logits,
            ..Offsets::default()
        },
        background: cloud(1, 9, 3.0),
        ..InstancedScene::default()
    }
}

/// The scene with own Gaussians, of which the third and fourth instance have the same.
fn with_own(scene: InstancedScene) -> InstancedScene {
    let range = |first, count| SourceRange { first, count };
    let own_ranges = vec![range(0, 3), range(0, 0), range(3, 2), range(3, 2), range(5, 1)];
    InstancedScene { own: cloud(3, 6, 0.5), own_ranges, ..scene }
}

/// The largest differences of means, covariances, opacities and colours from the flattened scene, seen from one side.
fn differences(splats: &[WorldSplat], flat: &Gaussians) -> [f64; 4] {
    assert_eq!(splats.len(), flat.len());
    let wide = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let direction = DVec3::new(0.3, -0.5, 0.8).normalize();
    let colour = |sh: &[[f32; 3]], direction| instgs_vk::math::sh::eval_sh(sh.len().isqrt() as u32 - 1, sh, direction);
    let mut worst = [0f64; 4];
    for (i, splat) in splats.iter().enumerate() {
        let want = covariance(flat.quats[i].map(f64::from), wide(flat.log_scales[i]));
        let apart = (splat.covariance - want).to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let opacity = 1.0 / (1.0 + f64::from(-flat.opacity_logits[i]).exp());
        let seen = colour(&splat.sh, splat.node_rotation.transpose() * direction);
        let now = [
            splat.mean.distance(wide(flat.means[i])),
            apart,
            (splat.opacity - opacity).abs(),
            seen.distance(colour(flat.sh_of(i), direction)),
        ];
        worst = std::array::from_fn(|k| worst[k].max(now[k]));
    }
    worst
}

fn written(scene: &InstancedScene, up: DVec3) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.glb");
    write_glb(&path, scene, up).unwrap();
    std::fs::read(path).unwrap()
}

/// What differs is f32 rounding of poses, attributes and the flattened cloud (coordinates up to 9). Measured: means 3.3e-7,
/// covariances 1e-8, opacities 3e-8, colours 5.4e-7.
#[test]
fn another_reader_rebuilds_the_flattened_scene() {
    let scene = with_own(scene());
    let bytes = written(&scene, DVec3::NEG_Y);
    assert_eq!(written(&scene, DVec3::NEG_Y), bytes, "the same bytes each time");
    let (root, splats) = read_world(&bytes);
    let worst = differences(&splats, &scene.flatten());
    assert!(worst.iter().all(|&w| w < 3e-6), "{worst:?}");
    assert!((root.transform_vector3(DVec3::NEG_Y) - DVec3::Y).length() < 1e-6);
    // The comparison sees a changed offset.
    let mut other = scene.clone();
    other.offsets.means[9][1] += 1e-3;
    let worst = differences(&splats, &other.flatten());
    assert!(worst[0] > 1e-4 && worst[1] < 3e-6, "{worst:?}");
}

/// 7 + 5 shared rows of scale, rotation and SH 1 to 3, four meshes of 28 bytes a Gaussian, the background.
#[test]
fn an_instance_with_offsets_costs_28_bytes_a_gaussian() {
    let bytes = written(&scene(), DVec3::Z);
    let container = gltf::Glb::from_slice(&bytes).unwrap();
    let shared = 12 * (12 + 16 + 15 * 12);
    let bytes_before = shared + 28 * (7 + 5 + 7 + 5) + 9 * (28 + 28 + 3 * 12);
    assert_eq!(container.bin.unwrap().len(), bytes_before);
    // Own Gaussians cost what a plain cloud's do, once if instances share them.
    let bytes = written(&with_own(scene()), DVec3::Z);
    let container = gltf::Glb::from_slice(&bytes).unwrap();
    assert_eq!(container.bin.unwrap().len(), bytes_before + 6 * (28 + 28 + 15 * 12));
}

#[test]
fn offsets_of_shape_and_sh_are_in_the_file() {
    (1..=3).for_each(offsets_are_in_the_file);
}

/// A scene with offsets of shape, and of SH up to a degree, looks in its file as with these added to its template.
fn offsets_are_in_the_file(sh_degree: u32) {
    let mut scene = scene();
    scene.instances.truncate(1);
    scene.background = Gaussians::default();
    scene.offsets.log_scales = vec![[0.2, -0.1, 0.0]; 19];
    scene.offsets.quats = vec![[0.1, 0.3, 0.0, -0.2]; 19];
    let rest = sh_coefficients(sh_degree) - 1;
    scene.offsets.sh_rest = vec![[0.5, 0.0, -0.5]; 19 * rest];
    // The same scene with the offsets added to the template.
    let mut baked = scene.clone();
    baked.offsets = Offsets { log_scales: Vec::new(), quats: Vec::new(), sh_rest: Vec::new(), ..baked.offsets };
    let templates = &mut baked.templates;
    let add = |a: &mut f32, b: f32| *a += b;
    templates.log_scales.iter_mut().for_each(|s| s.iter_mut().zip([0.2, -0.1, 0.0]).for_each(|(a, b)| add(a, b)));
    templates.quats.iter_mut().for_each(|q| q.iter_mut().zip([0.1, 0.3, 0.0, -0.2]).for_each(|(a, b)| add(a, b)));
    for (c, sh) in templates.sh.iter_mut().enumerate().filter(|(c, _)| (1..=rest).contains(&(c % 16))) {
        assert!(c > 0);
        sh.iter_mut().zip([0.5, 0.0, -0.5]).for_each(|(a, b)| add(a, b));
    }
    let (_, splats) = read_world(&written(&scene, DVec3::NEG_Y));
    let worst = differences(&splats, &baked.flatten());
    assert!(worst.iter().all(|&w| w < 3e-6), "degree {sh_degree}: {worst:?}");
}

#[test]
fn a_failed_write_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.glb");
    let mut scene = scene();
    scene.templates.means[3][0] = f32::NAN;
    let text = write_glb(&path, &scene, DVec3::Y).unwrap_err().to_string();
    assert!(text.contains("instance 0: POSITION of Gaussian 3 is not finite"), "{text}");
    assert!(
        !path.exists() && write_glb(Path::new("/no/such/folder/x.glb"), &InstancedScene::default(), DVec3::Y).is_err()
    );
}
