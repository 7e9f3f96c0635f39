//! `.glb`: binary glTF 2.0 with `KHR_gaussian_splatting`. What is read stands in `read.rs`; what is written, here:
//! instances are not expanded.
//!
//! Every instance is a node with its `world_from_template` as rotation, scale and translation, and a mesh of points. The
//! meshes of a template share its accessors for scale, rotation and SH of degree 1 and more; each run of offsets has its
//! own position, opacity and SH of degree 0: 28 bytes per Gaussian; with offsets of shape scale and rotation, too: 56
//! bytes. These share no accessor, so a mesh's `extras` has the number of its template (`instgs_template`). Instances
//! without offsets, or with the same ones, share a mesh. Own Gaussians of an instance are a mesh of a node below the
//! instance's. The background is one more mesh. Viewers that support the extension rotate SH with the node, as the renderer
//! here does with instances, so the picture equals that of the expanded scene. They need not support sharing between
//! meshes.
//!
//! glTF is right-handed with y up; scenes keep the axes of their training data, mostly with y down (COLMAP). The
//! vertices keep the scene's axes, and the root node rotates its `up` to +y: the scene is upright in a viewer, and its
//! world frame is one level below the root. For -y this is a half turn about x, the usual step from OpenCV's axes to
//! OpenGL's.
//!
//! Scale is linear, opacity is after the sigmoid, rotations are unit quaternions (x, y, z, w), SH are raw coefficients
//! in INRIA's order and signs, which the extension uses. Colours are marked `srgb_rec709_display`: the values of the
//! sRGB photos that they were fitted to. The extension cannot express opacity compensation (`antialias`) or templates
//! without instances. The fallback `COLOR_0` for viewers without the extension is omitted: it would cost 4 bytes per
//! Gaussian.

mod document;
mod meshes;
mod read;
mod read_document;
mod read_scene;
#[cfg(test)]
mod read_tests;
mod read_values;

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::atomic_write;
use crate::error::{IoError, Place};
use crate::glb::document::{Buffer, Document, Node, SPLATS};
use crate::glb::meshes::MeshWriter;
use instgs_vk::math::covariance::quat_from_rotation;
use instgs_vk::scene::instanced_scene::{Instance, InstancedScene, SceneError, SourceRange};

pub use read::{GlbScene, parse_glb, read_glb};

/// Magic number of a GLB file, "glTF".
const MAGIC: u32 = 0x4654_6C67;
/// Version of the container format.
const VERSION: u32 = 2;
/// Type of the first chunk, "JSON".
const JSON_CHUNK: u32 = 0x4E4F_534A;
/// Type of the second chunk, "BIN" and a zero.
const BINARY_CHUNK: u32 = 0x004E_4942;
/// First word of the generator of files of this program.
const GENERATOR: &str = "instgs-vk";
/// Name of the root node.
const ROOT: &str = "world";
/// Name of the node that holds the background's mesh.
const BACKGROUND: &str = "background";

/// Writes the scene as `.glb`; `up` is the world direction that becomes glTF's +y, of any length but zero.
///
/// # Errors
/// An inconsistent scene, a value that is not finite, or more than the container's limit of 4 GiB.
pub fn write_glb(path: &Path, scene: &InstancedScene, up: DVec3) -> Result<(), IoError> {
    let (json, binary) = chunks(path, scene, up)?;
    let chunk_bytes = |chunk: &[u8]| if chunk.is_empty() { 0 } else { 8 + chunk.len() as u64 };
    let total = 12 + chunk_bytes(&json) + chunk_bytes(&binary);
    let total = u32::try_from(total).map_err(|_| too_large(path, total))?;
    atomic_write(path, |out| {
        for word in [MAGIC, VERSION, total] {
            out.write_all(&word.to_le_bytes())?;
        }
        for (kind, chunk) in [(JSON_CHUNK, &json), (BINARY_CHUNK, &binary)] {
            if !chunk.is_empty() {
                out.write_all(&(chunk.len() as u32).to_le_bytes())?;
                out.write_all(&kind.to_le_bytes())?;
                out.write_all(chunk)?;
            }
        }
        Ok(())
    })
}

/// Size of the Gaussian data in a valid scene's `.glb`, bytes: nearly the length of the file.
pub fn glb_data_bytes(scene: &InstancedScene) -> u64 {
    let scene = &*scene.with_colors_in_offsets();
    let offsets = &scene.offsets;
    let own_rest = 12 * offsets.rest_coefficients() as u64;
    let shared_rest = 12 * (scene.templates.sh_coefficients() as u64 - 1) - own_rest;
    // Bytes per Gaussian, and whether each run of offsets has its own: position, opacity and SH 0; scale; rotation;
    // other SH with offsets and without.
    let attributes = [
        (28, true),
        (12, !offsets.log_scales.is_empty()),
        (16, !offsets.quats.is_empty()),
        (own_rest, true),
        (shared_rest, false),
    ];
    let accessor_bytes = |(bytes, owned): (u64, bool)| -> u64 {
        let key = |i: &Instance| (i.template, i.first_offset.filter(|_| owned));
        let accessors: BTreeSet<_> = scene.instances.iter().map(key).collect();
        let count = |template: u32| u64::from(scene.template_ranges[template as usize].count);
        accessors.iter().map(|&(template, _)| bytes * count(template)).sum()
    };
    let own: BTreeSet<SourceRange> = scene.own_ranges.iter().copied().collect();
    let own: u64 = own.iter().map(|range| u64::from(range.count)).sum();
    let own_bytes = own * (44 + 12 * scene.own.sh_coefficients() as u64);
    attributes.into_iter().map(accessor_bytes).sum::<u64>() + own_bytes + scene.background.tensor_bytes()
}

/// The JSON and the binary chunk, both padded to 4 bytes; the latter is empty if the scene is.
fn chunks(path: &Path, scene: &InstancedScene, up: DVec3) -> Result<(Vec<u8>, Vec<u8>), IoError> {
    let invalid = |e: SceneError| IoError::new(path, format!("cannot write: {}", e.reason)).at(Place::Tensor(e.tensor));
    scene.validate().map_err(invalid)?;
    // The format has no colour matrices.
    let scene = &*scene.with_colors_in_offsets();
    let data_bytes = glb_data_bytes(scene);
    // The size is checked before the chunk is built.
    let fits = u32::try_from(data_bytes).ok().and_then(|bytes| usize::try_from(bytes).ok());
    let data_bytes = fits.ok_or_else(|| too_large(path, data_bytes))?;
    let up_to_y = up_to_y(up).ok_or_else(|| IoError::new(path, "cannot write: the up direction has no length"))?;

    let mut writer = MeshWriter::new(scene, data_bytes);
    let nodes =
        nodes(&mut writer, scene, up_to_y).map_err(|what| IoError::new(path, format!("cannot write: {what}")))?;
    let MeshWriter { mut document, binary, .. } = writer;
    document.nodes = nodes;
    finish(&mut document, binary.len());
    let mut json = serde_json::to_vec(&document).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    // The container pads JSON with spaces. The binary data are 4-byte floats and need no padding.
    json.resize(json.len().next_multiple_of(4), b' ');
    Ok((json, binary))
}

fn finish(document: &mut Document, binary_bytes: usize) {
    if !document.meshes.is_empty() {
        document.extensions_used.push(SPLATS);
    }
    if binary_bytes > 0 {
        document.buffers.push(Buffer { byte_length: binary_bytes });
    }
}

fn too_large(path: &Path, bytes: u64) -> IoError {
    IoError::new(path, format!("cannot write: {bytes} bytes are more than the 4 GiB a .glb can hold"))
        .advise("keep it as .instgs")
}

/// All nodes: the root, the instances in file order, and the background. A child node behind an instance holds its own
/// Gaussians, if it has any.
fn nodes(writer: &mut MeshWriter, scene: &InstancedScene, up_to_y: DMat3) -> Result<Vec<Node>, String> {
    let root = Node { name: ROOT.into(), rotation: Some(xyzw(up_to_y)), ..Node::default() };
    let mut nodes = vec![root];
    let mut children = Vec::with_capacity(scene.instances.len() + 1);
    for (k, (instance, label)) in scene.instances.iter().zip(scene.instance_labels()).enumerate() {
        let kind = label.group.and_then(|g| scene.groups[g].name.clone());
        let kind = kind.unwrap_or_else(|| format!("template {}", instance.template));
        let placement = &instance.world_from_template;
        let mesh = writer.instance_mesh(instance, &kind).map_err(|e| format!("instance {k}: {e}"))?;
        let own = writer.own_mesh(scene.own_range(k), &format!("{kind}, own"));
        let own = own.map_err(|e| format!("own Gaussians of instance {k}: {e}"))?;
        children.push(nodes.len());
        let name = label.id.map_or_else(|| format!("instance {k}"), |id| format!("{kind} {id}"));
        let below = own.map(|own| Node { name: format!("{name}, own"), mesh: Some(own), ..Node::default() });
        nodes.push(Node {
            name,
            mesh,
            rotation: Some(xyzw(placement.rotation())),
            scale: Some([placement.scale() as f32; 3]),
            translation: Some(placement.translation().as_vec3().to_array()),
            children: below.iter().map(|_| nodes.len() + 1).collect(),
        });
        nodes.extend(below);
    }
    if let Some(mesh) = writer.background_mesh().map_err(|e| format!("background: {e}"))? {
        children.push(nodes.len());
        nodes.push(Node { name: BACKGROUND.into(), mesh: Some(mesh), ..Node::default() });
    }
    nodes[0].children = children;
    Ok(nodes)
}

fn xyzw(rotation: DMat3) -> [f32; 4] {
    let [w, x, y, z] = quat_from_rotation(rotation);
    [x, y, z, w].map(|c| c as f32)
}

/// The rotation that maps `up` to +y and keeps the x axis if possible; `None` if `up` is zero or not finite.
pub(crate) fn up_to_y(up: DVec3) -> Option<DMat3> {
    let up = up.try_normalize()?;
    let side = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Z };
    let right = (side - side.dot(up) * up).normalize();
    Some(DMat3::from_cols(right, up, right.cross(up)).transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;
    use instgs_vk::scene::gaussians::Gaussians;

    fn document(scene: &InstancedScene) -> serde_json::Value {
        let (json, binary) = chunks(Path::new("x.glb"), scene, DVec3::NEG_Y).unwrap();
        assert_eq!(binary.len() as u64, glb_data_bytes(scene));
        assert!(json.len().is_multiple_of(4) && binary.len().is_multiple_of(4));
        serde_json::from_slice(&json).unwrap()
    }

    #[test]
    fn up_becomes_y() {
        assert_eq!(up_to_y(DVec3::NEG_Y).unwrap(), DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        for up in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::new(1.0, -2.0, 3.0)] {
            let rotation = up_to_y(up).unwrap();
            assert!((rotation * up.normalize() - DVec3::Y).length() < 1e-15, "{up}");
            assert!(
                (rotation.determinant() - 1.0).abs() < 1e-14
                    && (rotation.transpose() * rotation - DMat3::IDENTITY)
                        .to_cols_array()
                        .iter()
                        .all(|v| v.abs() < 1e-15)
            );
        }
        assert!(up_to_y(DVec3::ZERO).is_none() && up_to_y(DVec3::NAN).is_none());
    }

    #[test]
    fn instances_share_what_they_do_not_own() {
        let mut scene = sample_scene();
        let json = document(&scene);
        let attribute = |json: &serde_json::Value, mesh: usize, name: &str| {
            json["meshes"][mesh]["primitives"][0]["attributes"][name].as_u64().unwrap()
        };
        // Instances 0 and 2 have template 0 with offsets, 1 and 3 template 1, instance 1 without offsets.
        assert_eq!(json["meshes"].as_array().unwrap().len(), 5);
        for shared in [
            "KHR_gaussian_splatting:SCALE",
            "KHR_gaussian_splatting:ROTATION",
            "KHR_gaussian_splatting:SH_DEGREE_2_COEF_4",
        ] {
            assert_eq!(attribute(&json, 0, shared), attribute(&json, 2, shared));
            assert_ne!(attribute(&json, 0, shared), attribute(&json, 1, shared));
        }
        for own in ["POSITION", "KHR_gaussian_splatting:OPACITY", "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"] {
            assert_ne!(attribute(&json, 0, own), attribute(&json, 2, own));
        }
        let names: Vec<_> = json["nodes"].as_array().unwrap().iter().map(|n| n["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["world", "chair \"a\" 4", "instance 1", "chair \"a\" 9", "instance 3", "background"]);
        // The same template and offsets share a mesh.
        scene.instances[2].first_offset = Some(0);
        let json = document(&scene);
        assert_eq!((json["nodes"][1]["mesh"].as_u64(), json["nodes"][3]["mesh"].as_u64()), (Some(0), Some(0)));
        // With offsets of shape, each instance has its own scale and rotation too.
        scene.instances[2].first_offset = Some(3);
        scene.offsets.log_scales = vec![[0.1; 3]; 8];
        let json = document(&scene);
        let (scale, rotation) = ("KHR_gaussian_splatting:SCALE", "KHR_gaussian_splatting:ROTATION");
        assert_ne!(attribute(&json, 0, scale), attribute(&json, 2, scale));
        assert_eq!(attribute(&json, 0, rotation), attribute(&json, 2, rotation));
    }

    #[test]
    fn empty_scenes_and_templates_have_no_empty_arrays() {
        let json = document(&InstancedScene::default());
        assert_eq!(json["nodes"].as_array().unwrap().len(), 1);
        for key in ["meshes", "accessors", "bufferViews", "buffers", "extensionsUsed"] {
            assert!(json.get(key).is_none(), "{key}");
        }
        let mut scene = sample_scene();
        scene.template_ranges[1].count = 0;
        scene.background = Gaussians::default();
        let json = document(&scene);
        assert!(json["nodes"][2].get("mesh").is_none() && json["nodes"].as_array().unwrap().len() == 5);
    }

    #[test]
    fn what_cannot_be_written_is_named() {
        let text = |scene: &InstancedScene, up| {
            chunks(Path::new("x.glb"), scene, up).err().map(|e| e.to_string()).unwrap_or_default()
        };
        let mut scene = sample_scene();
        assert!(text(&scene, DVec3::ZERO).contains("up direction"));
        scene.templates.log_scales[1][0] = 89.0;
        let huge = text(&scene, DVec3::Y);
        assert!(huge.contains("instance 0") && huge.contains("SCALE of Gaussian 1 is not finite"), "{huge}");
        scene = sample_scene();
        scene.background.quats[2] = [0.0; 4];
        assert!(text(&scene, DVec3::Y).contains("background: KHR_gaussian_splatting:ROTATION of Gaussian 2"));
        scene.instances[0].template = 7;
        assert!(text(&scene, DVec3::Y).contains("instance.template"));
        assert!(too_large(Path::new("x.glb"), 1 << 33).to_string().contains("4 GiB"));
    }
}
