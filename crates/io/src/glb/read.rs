//! Reading `.glb`: the meshes of binary glTF 2.0 that have `KHR_gaussian_splatting`, as a scene.
//!
//! Meshes of one template, and meshes that are placed several times, become instances (`read_scene.rs`). Colours are taken as they are: those of
//! `lin_rec709_display` are noted. Vertex colours, other meshes and data outside of the file are not read. A file that requires
//! an extension which is not read is refused; what it may be shown without is left out.
//!
//! glTF has y up and z to the viewer, scenes here are right-down-front: they are turned by 180 degrees about x (files of
//! splat-transform about z, as it turns clouds of .ply). In files of
//! this program the root node has turned the scene's up to +y; its rotation is left out, which restores the scene's frame.

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DMat4, DVec3};

use super::document::SPLATS;
use super::read_document::{Document, Primitive, Splats};
use super::read_scene::{Part, scene_of};
use super::read_values::{Attributes, Values};
use super::{BINARY_CHUNK, GENERATOR, JSON_CHUNK, MAGIC, ROOT, VERSION};
use crate::bytes::Cursor;
use crate::error::{IoError, Place};
use crate::read_bytes;
use instgs_vk::scene::InstancedScene;

/// Extensions that a file may require: those of Gaussians, and of attributes in few bits, whose components are all read.
const READ_EXTENSIONS: [&str; 2] = [SPLATS, "KHR_mesh_quantization"];
/// Part of the names of extensions for compression, and what to do about them.
const COMPRESSION: &str = "compression";
const WITHOUT_COMPRESSION: &str = "write them without compression, or as .spz";
/// Extension of a node whose mesh is placed many times.
const MANY_PLACES: &str = "EXT_mesh_gpu_instancing";

/// How PlayCanvas' converter calls itself.
const SPLAT_TRANSFORM: &str = "splat-transform";

/// The kernel and the colours that scenes here have.
const KERNEL: &str = "ellipse";
const COLOUR_SPACE: &str = "srgb_rec709_display";

/// The contents of a `.glb` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GlbScene {
    /// The scene, in right-down-front axes.
    pub scene: InstancedScene,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

/// Reads the Gaussians of a `.glb` file.
///
/// # Errors
/// The file cannot be read, is damaged, has no Gaussians but other meshes, has them compressed or outside of the file, or
/// requires an extension that is not read.
pub fn read_glb(path: &Path) -> Result<GlbScene, IoError> {
    parse_glb(&read_bytes(path)?, path)
}

/// Parses the bytes of a `.glb` file; `path` is only used in messages.
pub fn parse_glb(bytes: &[u8], path: &Path) -> Result<GlbScene, IoError> {
    let (json, binary) = chunks(bytes, path)?;
    let invalid = |e: serde_json::Error| IoError::damaged(path, format!("has a JSON part that cannot be used: {e}"));
    let document: Document = serde_json::from_slice(json).map_err(invalid)?;
    check_required(&document, path)?;
    let mut notes = Vec::new();
    let parts = parts(&document, json.len(), &mut notes, path)?;
    if parts.is_empty() && document.meshes.iter().any(|mesh| !mesh.primitives.is_empty()) {
        let error = IoError::new(path, format!("has no placed mesh with {SPLATS}"));
        return Err(error.advise("this is a scene of triangles or points, not of Gaussians"));
    }
    let values = Values { document: &document, binary, path, scales_are_logs: false };
    let scene = scene_of(&parts, &values, &mut notes)?;
    Ok(GlbScene { scene, notes })
}

/// The JSON and the binary chunk of the container; the latter is empty if there is none.
fn chunks<'a>(bytes: &'a [u8], path: &'a Path) -> Result<(&'a [u8], &'a [u8]), IoError> {
    const WHAT: &str = "the GLB header";
    let mut cursor = Cursor::new(bytes, path);
    if cursor.u32(WHAT)? != MAGIC {
        return Err(IoError::new(path, "is not a GLB file: it does not start with glTF").at(Place::Byte(0)));
    }
    let version = cursor.u32(WHAT)?;
    if version != VERSION {
        return Err(cursor.error(format!("GLB version {version} is not known, only {VERSION}")));
    }
    let length = cursor.u32(WHAT)?;
    if u64::from(length) > bytes.len() as u64 {
        return Err(cursor.error(format!("ends early: the header claims {length} bytes, {} are there", bytes.len())));
    }
    let mut chunk = |kind: u32, name: &str| -> Result<&'a [u8], IoError> {
        let bytes = cursor.u32(name)? as usize;
        if cursor.u32(name)? != kind {
            return Err(cursor.error(format!("is not {name}")));
        }
        cursor.take(bytes, name)
    };
    let json = chunk(JSON_CHUNK, "the JSON chunk")?;
    // Header and a chunk of JSON may be all.
    let rest = bytes.len() - json.len() - 20;
    let binary: &[u8] = if rest < 8 { &[] } else { chunk(BINARY_CHUNK, "the binary chunk")? };
    Ok((json, binary))
}

/// Checks that a file requires no extension that is not read, but for those of other things than Gaussians: how triangles look, and
/// lamps.
fn check_required(document: &Document, path: &Path) -> Result<(), IoError> {
    const OF_OTHER_THINGS: [&str; 3] = ["KHR_materials_", "KHR_texture_", "KHR_lights_"];
    let mut required = document.extensions_required.iter();
    let is_in_the_way = |name: &&String| {
        !READ_EXTENSIONS.contains(&name.as_str()) && !OF_OTHER_THINGS.iter().any(|begin| name.starts_with(begin))
    };
    let Some(name) = required.find(is_in_the_way) else { return Ok(()) };
    let what = format!("requires the extension {name}, which is not read");
    let error = IoError::new(path, what).at(Place::Field("extensionsRequired".into()));
    Err(error.advise(if name.contains(COMPRESSION) {
        WITHOUT_COMPRESSION
    } else {
        "write it without that, or as .ply or .spz"
    }))
}

/// Adds a note, once.
fn note(notes: &mut Vec<String>, what: String) {
    if !notes.contains(&what) {
        notes.push(what);
    }
}

/// All meshes of Gaussians that the scene places, at most `most`, in the order of nodes: a node before its children.
fn parts(document: &Document, most: usize, notes: &mut Vec<String>, path: &Path) -> Result<Vec<Part>, IoError> {
    let fail = |what: &str, field: String| IoError::new(path, what).at(Place::Field(field));
    let roots = roots(document);
    let own_root = own_root(document, &roots);
    // Both turns put y up; PlayCanvas turns clouds of .ply about z, so that this restores the frame of their cameras.
    let about_z = document.asset.generator.starts_with(SPLAT_TRANSFORM);
    let half_turn = DMat4::from_scale(if about_z { DVec3::new(-1.0, -1.0, 1.0) } else { DVec3::new(1.0, -1.0, -1.0) });
    let mut open: Vec<(usize, DMat4)> = roots.iter().rev().map(|&root| (root, half_turn)).collect();
    let mut visited = vec![false; document.nodes.len()];
    let mut out = Vec::new();
    while let Some((index, scene_from_parent)) = open.pop() {
        let field = || format!("nodes[{index}]");
        let (Some(node), Some(visited)) = (document.nodes.get(index), visited.get_mut(index)) else {
            return Err(fail("does not exist", field()));
        };
        if std::mem::replace(visited, true) {
            return Err(fail("has two parents", field()));
        }
        let is_own_root = own_root == Some(index);
        let scene_from_part = if is_own_root { DMat4::IDENTITY } else { scene_from_parent * node.parent_from_node() };
        if let Some(mesh) = node.mesh {
            let found = document.meshes.get(mesh);
            let found = found.ok_or_else(|| fail("names a mesh that does not exist", field()))?;
            for primitive in &found.primitives {
                if let Some(attributes) = attributes(primitive, mesh, notes, path)? {
                    out.push(Part { scene_from_part, attributes, template: found.template() });
                    if node.extensions.contains_key(MANY_PLACES) {
                        let what = "has meshes of Gaussians in many places by";
                        note(notes, format!("{what} {MANY_PLACES}, which is not read: each is placed once"));
                    }
                }
                // Nodes and primitives take bytes each; their product is no scene.
                if out.len() > most {
                    return Err(fail("places more meshes than its JSON part has bytes", field()));
                }
            }
        }
        open.extend(node.children.iter().rev().map(|&child| (child, scene_from_part)));
    }
    Ok(out)
}

/// The nodes of the scene that have no parent; those of the file if it has no scene.
fn roots(document: &Document) -> Vec<usize> {
    if let Some(scene) = document.scenes.get(document.scene) {
        return scene.nodes.clone();
    }
    let children: BTreeSet<usize> = document.nodes.iter().flat_map(|node| node.children.iter().copied()).collect();
    (0..document.nodes.len()).filter(|node| !children.contains(node)).collect()
}

/// The root node of a file of this program.
fn own_root(document: &Document, roots: &[usize]) -> Option<usize> {
    let &[root] = roots else { return None };
    let name = document.nodes.get(root)?.name.as_deref();
    (document.asset.generator.starts_with(GENERATOR) && name == Some(ROOT)).then_some(root)
}

/// The accessors of a primitive, `None` if it has no Gaussians.
fn attributes(
    primitive: &Primitive,
    mesh: usize,
    notes: &mut Vec<String>,
    path: &Path,
) -> Result<Option<Attributes>, IoError> {
    let Some(Splats { kernel, color_space, extensions }) = &primitive.extensions.splats else { return Ok(None) };
    let fail = |what: String| IoError::new(path, what).at(Place::Field(format!("meshes[{mesh}]")));
    if let Some(name) = extensions.keys().find(|name| name.contains(COMPRESSION)) {
        let error = fail(format!("has Gaussians compressed by {name}, which is not read"));
        return Err(error.advise(WITHOUT_COMPRESSION));
    }
    if !kernel.is_empty() && kernel != KERNEL {
        note(notes, format!("has Gaussians of the kernel {kernel:?}, which are drawn as ellipses"));
    }
    if !color_space.is_empty() && color_space != COLOUR_SPACE {
        note(notes, format!("has colours of the space {color_space:?}, which are shown as if they were sRGB"));
    }
    Attributes::find(|name| primitive.attributes.get(name).copied()).map(Some).map_err(fail)
}
