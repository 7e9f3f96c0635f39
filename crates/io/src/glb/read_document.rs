//! The JSON part of a glTF 2.0 file, as far as clouds of Gaussians need it. Field names are glTF's.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3};
use serde::Deserialize;

/// The whole document.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Document {
    pub(super) asset: Asset,
    /// Extensions without which the file means something else.
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: usize,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<BufferView>,
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Asset {
    pub(super) generator: String,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) nodes: Vec<usize>,
}

/// A node; its transform is the matrix, or else scale, then rotation (x, y, z, w), then translation.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) name: Option<String>,
    pub(super) mesh: Option<usize>,
    pub(super) children: Vec<usize>,
    /// Extensions, for instance for instances.
    pub(super) extensions: BTreeMap<String, serde_json::Value>,
    matrix: Option<Box<[f64; 16]>>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

impl Node {
    /// The transform from the node's frame to its parent's; not finite if its rotation is zero.
    pub(super) fn parent_from_node(&self) -> DMat4 {
        if let Some(matrix) = &self.matrix {
            return DMat4::from_cols_array(matrix);
        }
        let rotation = self.rotation.map_or(DQuat::IDENTITY, |xyzw| DQuat::from_array(xyzw).normalize());
        let scale = self.scale.map_or(DVec3::ONE, DVec3::from_array);
        let translation = self.translation.map_or(DVec3::ZERO, DVec3::from_array);
        DMat4::from_scale_rotation_translation(scale, rotation, translation)
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
    /// Whatever programs keep there.
    extras: serde_json::Value,
}

impl Mesh {
    /// The number of the template that the mesh is an instance of, if this program wrote it.
    pub(super) fn template(&self) -> Option<u64> {
        self.extras.get("instgs_template")?.as_u64()
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    /// Accessors by semantic.
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) extensions: PrimitiveExtensions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_gaussian_splatting")]
    pub(super) splats: Option<Splats>,
}

/// The extension's object.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Splats {
    pub(super) kernel: String,
    pub(super) color_space: String,
    /// Extensions of the extension, for instance for compression.
    pub(super) extensions: BTreeMap<String, serde_json::Value>,
}

/// Elements in a buffer view.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) element: String,
    pub(super) sparse: Option<serde_json::Value>,
}

/// A range of a buffer.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
    /// Extensions, for instance for compression.
    pub(super) extensions: BTreeMap<String, serde_json::Value>,
}

/// Bytes: the binary chunk, or those that a URI names.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
}
