//! Writing `.instgs` files; reading and the format's description are in [`crate::io::scene_file`].

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::Dtype;

use crate::io::atomic_write;
use crate::io::error::{IoError, Place};
use crate::io::safetensors_header::{Entry, header};
use crate::io::scene_file::{FORMAT, NO_OFFSET};
use crate::scene::instanced_scene::{ForeignTensor, InstancedScene};

/// Writes an `.instgs` file: all known tensors as F32 and U32, then what else the scene carries. The same scene gives
/// the same bytes.
pub fn write_scene_file(path: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    let bytes = scene_file_bytes(scene, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_scene_file`] writes.
pub fn scene_file_bytes(scene: &InstancedScene, path: &Path) -> Result<Vec<u8>, IoError> {
    scene
        .validate()
        .map_err(|e| IoError::new(path, format!("cannot write: {}", e.reason)).at(Place::Tensor(e.tensor)))?;
    let mut tensors = scene.foreign_tensors.clone();
    for (group, cloud) in [("template", &scene.templates), ("background", &scene.background)] {
        let n = cloud.len();
        let mut put = |name: &str, shape: &[usize], values: &[f32]| {
            tensors.insert(format!("{group}.{name}"), floats(shape, values));
        };
        put("means", &[n, 3], cloud.means.as_flattened());
        put("quats", &[n, 4], cloud.quats.as_flattened());
        put("log_scales", &[n, 3], cloud.log_scales.as_flattened());
        put("opacity_logits", &[n], &cloud.opacity_logits);
        put("sh", &[n, cloud.sh_coefficients(), 3], cloud.sh.as_flattened());
    }
    let (g, k, m) = (scene.template_ranges.len(), scene.instances.len(), scene.offsets.len());
    let mut put = |name: &str, tensor: ForeignTensor| tensors.insert(name.into(), tensor);
    put("template.ranges", u32s(&[g, 2], scene.template_ranges.iter().flat_map(|r| [r.first, r.count])));
    put("instance.template", u32s(&[k], scene.instances.iter().map(|i| i.template)));
    put("instance.first_offset", u32s(&[k], scene.instances.iter().map(|i| i.first_offset.unwrap_or(NO_OFFSET))));
    let poses: Vec<f32> = scene.instances.iter().flat_map(|i| i.world_from_template.rows()).flatten().collect();
    put("instance.world_from_template", floats(&[k, 3, 4], &poses));
    put("offset.means", floats(&[m, 3], scene.offsets.means.as_flattened()));
    put("offset.sh_dc", floats(&[m, 3], scene.offsets.sh_dc.as_flattened()));
    put("offset.opacity_logits", floats(&[m], &scene.offsets.opacity_logits));

    let json_error = |e: serde_json::Error| IoError::new(path, format!("cannot write: {e}"));
    let mut metadata = scene.foreign_metadata.clone();
    metadata.insert("format".into(), FORMAT.into());
    metadata.insert("antialias".into(), scene.antialias.to_string());
    metadata.insert("sh_degree".into(), scene.sh_degree().to_string());
    metadata.insert("source".into(), scene.source.clone());
    metadata.insert("groups".into(), serde_json::to_string(&scene.groups).map_err(json_error)?);
    assemble(&metadata, &tensors, path)
}

pub(crate) fn floats(shape: &[usize], values: &[f32]) -> ForeignTensor {
    ForeignTensor {
        dtype: "F32".into(),
        shape: shape.into(),
        bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    }
}

pub(crate) fn u32s(shape: &[usize], values: impl Iterator<Item = u32>) -> ForeignTensor {
    ForeignTensor { dtype: "U32".into(), shape: shape.into(), bytes: values.flat_map(u32::to_le_bytes).collect() }
}

/// The file: tensors with the widest element type first, so that each is aligned to its type, then by name.
pub(crate) fn assemble(
    metadata: &BTreeMap<String, String>,
    tensors: &BTreeMap<String, ForeignTensor>,
    path: &Path,
) -> Result<Vec<u8>, IoError> {
    let mut order = Vec::with_capacity(tensors.len());
    for (name, tensor) in tensors {
        let fail = |what: String| IoError::new(path, format!("cannot write: {what}")).at(Place::Tensor(name.clone()));
        let dtype: Dtype = serde_json::from_value(tensor.dtype.clone().into())
            .map_err(|_| fail(format!("{} is no safetensors type", tensor.dtype)))?;
        let bits = tensor.shape.iter().try_fold(dtype.bitsize(), |n, &d| n.checked_mul(d));
        if bits != tensor.bytes.len().checked_mul(8) {
            return Err(fail(format!("{} bytes are not what shape and type call for", tensor.bytes.len())));
        }
        order.push((std::cmp::Reverse(dtype.bitsize()), name, tensor));
    }
    order.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)));

    let entries = order.iter().map(|(_, name, tensor)| Entry {
        name,
        dtype: &tensor.dtype,
        shape: &tensor.shape,
        bytes: tensor.bytes.len(),
    });
    let mut out = header(metadata, entries).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    order.iter().for_each(|(_, _, tensor)| out.extend_from_slice(&tensor.bytes));
    Ok(out)
}
