//! The JSON part of a glTF 2.0 file, limited to what clouds of Gaussians need. Field names are glTF's.

use std::collections::BTreeMap;

use serde::Serialize;

/// Name of the extension for Gaussian splats.
pub(super) const SPLATS: &str = "KHR_gaussian_splatting";
/// glTF component type FLOAT.
const FLOAT: u32 = 5126;
/// glTF buffer view target ARRAY_BUFFER: vertex attributes.
const ARRAY_BUFFER: u32 = 34962;
/// glTF primitive mode POINTS.
const POINTS: u32 = 0;

/// The whole document. glTF forbids empty arrays, so they are omitted.
#[derive(Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) extensions_used: Vec<&'static str>,
    scene: u32,
    scenes: [Scene; 1],
    pub(super) nodes: Vec<Node>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) meshes: Vec<Mesh>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) accessors: Vec<Accessor>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Serialize)]
pub(super) struct Asset {
    version: &'static str,
    generator: &'static str,
}

impl Default for Asset {
    fn default() -> Self {
        Self { version: "2.0", generator: concat!("instgs-vk ", env!("CARGO_PKG_VERSION")) }
    }
}

/// The only scene; its root is node 0.
#[derive(Default, Serialize)]
struct Scene {
    nodes: [usize; 1],
}

/// The transform x -> rotation (scale x) + translation; missing parts are the identity.
#[derive(Default, Serialize)]
pub(super) struct Node {
    pub(super) name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mesh: Option<usize>,
    /// Quaternion (x, y, z, w).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rotation: Option<[f32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) scale: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) translation: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) children: Vec<usize>,
}

#[derive(Serialize)]
pub(super) struct Mesh {
    name: String,
    primitives: [Primitive; 1],
    #[serde(skip_serializing_if = "Option::is_none")]
    extras: Option<MeshExtras>,
}

/// What this program says of a mesh to itself, where glTF has a place for it.
#[derive(Serialize)]
struct MeshExtras {
    #[serde(rename = "instgs_template")]
    template: u32,
}

impl Mesh {
    /// A mesh of Gaussians; `attributes` maps semantics to accessors, and `template` is the number of the template, if it is an
    /// instance of one.
    pub(super) fn splats(name: String, attributes: BTreeMap<String, usize>, template: Option<u32>) -> Self {
        let extensions = BTreeMap::from([(SPLATS, SplatProperties::default())]);
        let extras = template.map(|template| MeshExtras { template });
        Self { name, primitives: [Primitive { attributes, mode: POINTS, extensions }], extras }
    }
}

#[derive(Serialize)]
struct Primitive {
    attributes: BTreeMap<String, usize>,
    mode: u32,
    extensions: BTreeMap<&'static str, SplatProperties>,
}

/// The extension's object. Colours are sRGB values, as in the training photos; projection and sorting are the only
/// values that the extension defines.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct SplatProperties {
    kernel: &'static str,
    color_space: &'static str,
    projection: &'static str,
    sorting_method: &'static str,
}

impl Default for SplatProperties {
    fn default() -> Self {
        Self {
            kernel: "ellipse",
            color_space: "srgb_rec709_display",
            projection: "perspective",
            sorting_method: "cameraDistance",
        }
    }
}

/// `count` elements of one buffer view, tightly packed floats.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    buffer_view: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    element: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<[f32; 3]>,
}

impl Accessor {
    /// All of a buffer view as elements of `N` floats; `bounds` (minimum and maximum) only where glTF requires them.
    pub(super) fn floats<const N: usize>(buffer_view: usize, count: usize, bounds: Option<[[f32; 3]; 2]>) -> Self {
        let element = match N {
            1 => "SCALAR",
            3 => "VEC3",
            _ => "VEC4",
        };
        let (min, max) = bounds.map_or((None, None), |[min, max]| (Some(min), Some(max)));
        Self { buffer_view, component_type: FLOAT, count, element, min, max }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    buffer: u32,
    byte_offset: usize,
    byte_length: usize,
    target: u32,
}

impl BufferView {
    /// Bytes of the binary chunk that hold one vertex attribute.
    pub(super) fn attribute(byte_offset: usize, byte_length: usize) -> Self {
        Self { buffer: 0, byte_offset, byte_length, target: ARRAY_BUFFER }
    }
}

/// The binary chunk as glTF's buffer.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: usize,
}
