//! Writing `.instgs` files; reading and the format's description are in [`crate::scene_file`].

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::Dtype;

use crate::atomic_write;
use crate::error::{IoError, Place};
use crate::pages;
use crate::safetensors_header::{Entry, header};
use crate::scene_file::{FORMAT, FORMAT_CODED, NO_OFFSET};
use crate::scene_pack::{OffsetRanges, Pack, Underflow, fits_half, floats, halves, segments};
use crate::small::{SmallOptions, SmallPlan, coded_tensors};
use instgs_vk::scene::NearPlane;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::{ForeignTensor, InstancedScene};
use instgs_vk::scene::lod::pages::{PageTable, PagedBackground};
use instgs_vk::scene::offsets::Offsets;

/// Writes an `.instgs` file: all known tensors as F32 and U32, then the scene's unknown tensors and metadata. The same
/// scene gives the same bytes.
///
/// # Errors
/// The scene is inconsistent, or the file cannot be written.
pub fn write_scene_file(path: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    write_scene_file_packed(path, scene, Pack::F32)
}

/// Writes an `.instgs` file with packed values. A tensor whose values do not fit the format (not finite, beyond 65504,
/// or so small that f16 loses too many digits) stays F32.
pub fn write_scene_file_packed(path: &Path, scene: &InstancedScene, pack: Pack) -> Result<(), IoError> {
    let bytes = packed_scene_file_bytes(scene, pack, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_scene_file`] writes.
pub fn scene_file_bytes(scene: &InstancedScene, path: &Path) -> Result<Vec<u8>, IoError> {
    packed_scene_file_bytes(scene, Pack::F32, path)
}

/// The bytes that [`write_scene_file_packed`] writes.
pub fn packed_scene_file_bytes(scene: &InstancedScene, pack: Pack, path: &Path) -> Result<Vec<u8>, IoError> {
    file_bytes(scene, pack, Extra::None, path)
}

/// Writes an `.instgs` file whose background is in pages as well, for [`crate::PagedFile`]: in another order than that of the
/// scene, with its levels. Readers that know no pages see a scene like any other.
///
/// # Errors
/// The scene is inconsistent, `pack` is [`Pack::Small`], whose rows cannot be read one by one, or the file cannot be written.
pub fn write_scene_file_in_pages(path: &Path, scene: &InstancedScene, pack: Pack) -> Result<(), IoError> {
    let bytes = paged_scene_file_bytes(scene, pack, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_scene_file_in_pages`] writes.
pub fn paged_scene_file_bytes(scene: &InstancedScene, pack: Pack, path: &Path) -> Result<Vec<u8>, IoError> {
    if pack == Pack::Small {
        return Err(IoError::new(path, "cannot have pages: small files are coded as a whole").advise("use --pack f16"));
    }
    let PagedBackground { full, fine, stand_ins, table } = PagedBackground::of(&scene.background);
    let mut scene = InstancedScene { background: full, ..scene.clone() };
    // They may be parallel to the background, whose order is another one now.
    scene.foreign_tensors.retain(|name, _| !name.starts_with("background."));
    file_bytes(&scene, pack, Extra::Pages { fine: &fine, stand_ins: &stand_ins, table: &table }, path)
}

/// Writes an `.instgs` file packed as [`Pack::Small`], with the precision that the scene's pictures need.
///
/// # Errors
/// The scene is inconsistent, the sensitivity is of another scene, or the file cannot be written.
pub fn write_small_scene_file(path: &Path, scene: &InstancedScene, options: &SmallOptions<'_>) -> Result<(), IoError> {
    write_planned_scene_file(path, scene, &SmallPlan::new(scene, options, path)?)
}

/// Writes an `.instgs` file packed as [`Pack::Small`] by a plan, which may be that of an earlier state of the scene.
///
/// # Errors
/// The scene is inconsistent, the plan is of another one, or the file cannot be written.
pub fn write_planned_scene_file(path: &Path, scene: &InstancedScene, plan: &SmallPlan) -> Result<(), IoError> {
    let bytes = planned_scene_file_bytes(scene, plan, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_planned_scene_file`] writes.
pub(crate) fn planned_scene_file_bytes(
    scene: &InstancedScene,
    plan: &SmallPlan,
    path: &Path,
) -> Result<Vec<u8>, IoError> {
    file_bytes(scene, Pack::Small, Extra::Small(plan), path)
}

/// What a file takes besides the scene.
enum Extra<'a> {
    None,
    /// How [`Pack::Small`] rounds.
    Small(&'a SmallPlan),
    /// Pages of the background.
    Pages {
        fine: &'a Gaussians,
        stand_ins: &'a Gaussians,
        table: &'a PageTable,
    },
}

fn file_bytes(scene: &InstancedScene, pack: Pack, extra: Extra<'_>, path: &Path) -> Result<Vec<u8>, IoError> {
    scene
        .validate()
        .map_err(|e| IoError::new(path, format!("cannot write: {}", e.reason)).at(Place::Tensor(e.tensor)))?;
    let mut tensors = scene.foreign_tensors.clone();
    if let Extra::Pages { fine, stand_ins, table } = extra {
        put_cloud(&mut tensors, pages::FINE, fine, pack);
        put_cloud(&mut tensors, pages::STAND_INS, stand_ins, pack);
        put_page_table(&mut tensors, table);
    }
    if pack == Pack::Small {
        tensors.extend(match extra {
            Extra::Small(plan) => plan.tensors(scene, path)?,
            Extra::None | Extra::Pages { .. } => coded_tensors(scene),
        });
    } else {
        put_cloud(&mut tensors, "template", &scene.templates, pack);
        if !scene.own.is_empty() {
            put_cloud(&mut tensors, "own", &scene.own, pack);
        }
        put_cloud(&mut tensors, "background", &scene.background, pack);
        put_offsets(&mut tensors, scene, pack);
        put_levels(&mut tensors, scene, pack);
    }
    put_instances(&mut tensors, scene);

    let json_error = |e: serde_json::Error| IoError::new(path, format!("cannot write: {e}"));
    let mut metadata = scene.foreign_metadata.clone();
    metadata.insert("format".into(), if pack == Pack::Small { FORMAT_CODED } else { FORMAT }.into());
    metadata.insert("antialias".into(), scene.pixel_filter.antialias.to_string());
    if !scene.pixel_filter.has_usual_dilation() {
        metadata.insert("dilation_px2".into(), scene.pixel_filter.dilation_px2.to_string());
    }
    if scene.near_plane != NearPlane::default() {
        metadata.insert("near".into(), scene.near_plane.0.to_string());
    }
    metadata.insert("sh_degree".into(), scene.sh_degree().to_string());
    metadata.insert("source".into(), scene.source.clone());
    metadata.insert("groups".into(), serde_json::to_string(&scene.groups).map_err(json_error)?);
    assemble(&metadata, &tensors, path)
}

type Tensors = BTreeMap<String, ForeignTensor>;

fn small_floats(pack: Pack, shape: &[usize], values: &[f32], underflow: Underflow) -> ForeignTensor {
    if pack == Pack::F32 { floats(shape, values) } else { halves(shape, values, underflow) }
}

fn put_cloud(tensors: &mut Tensors, group: &str, cloud: &Gaussians, pack: Pack) {
    let n = cloud.len();
    let mut put = |name: &str, tensor| tensors.insert(format!("{group}.{name}"), tensor);
    let small = |shape: &[usize], values: &[f32]| small_floats(pack, shape, values, Underflow::Harmless);
    put("means", floats(&[n, 3], cloud.means.as_flattened()));
    // Quaternions of small length are still valid rotations and must not become 0.
    put("quats", small_floats(pack, &[n, 4], cloud.quats.as_flattened(), Underflow::Rows(4)));
    put("log_scales", small(&[n, 3], cloud.log_scales.as_flattened()));
    put("opacity_logits", small(&[n], &cloud.opacity_logits));
    put("sh", small(&[n, cloud.sh_coefficients(), 3], cloud.sh.as_flattened()));
}

fn put_instances(tensors: &mut Tensors, scene: &InstancedScene) {
    let (g, k) = (scene.template_ranges.len(), scene.instances.len());
    let mut put = |name: &str, tensor| tensors.insert(name.into(), tensor);
    put("template.ranges", u32s(&[g, 2], scene.template_ranges.iter().flat_map(|r| [r.first, r.count])));
    put("instance.template", u32s(&[k], scene.instances.iter().map(|i| i.template)));
    put("instance.first_offset", u32s(&[k], scene.instances.iter().map(|i| i.first_offset.unwrap_or(NO_OFFSET))));
    let poses: Vec<f32> = scene.instances.iter().flat_map(|i| i.world_from_template.rows()).flatten().collect();
    put("instance.world_from_template", floats(&[k, 3, 4], &poses));
    if !scene.own_ranges.is_empty() {
        put("instance.own", u32s(&[k, 2], scene.own_ranges.iter().flat_map(|r| [r.first, r.count])));
    }
    let colors = scene.color_from_template.as_flattened().as_flattened();
    if !colors.is_empty() {
        put("instance.color_from_template", floats(&[k, 3, 4], colors));
    }
}

/// The optimised levels of templates as they are; `--pack small` and pages have none.
fn put_levels(tensors: &mut Tensors, scene: &InstancedScene, pack: Pack) {
    let levels = scene.current_levels();
    if levels.is_empty() {
        return;
    }
    let mut cloud = Gaussians { sh_degree: scene.templates.sh_degree, ..Gaussians::default() };
    let mut ranges = Vec::with_capacity(levels.len());
    for level in &levels {
        ranges.push([cloud.len() as u32, level.gaussians.len() as u32]);
        cloud.append(&level.gaussians);
    }
    put_cloud(tensors, "level", &cloud, pack);
    let count = levels.len();
    let cells: Vec<f32> = levels.iter().map(|level| level.cell).collect();
    let prints = levels.iter().flat_map(|level| [level.template_print as u32, (level.template_print >> 32) as u32]);
    tensors.insert("level.ranges".into(), u32s(&[count, 2], ranges.into_iter().flatten()));
    tensors.insert("level.cell".into(), floats(&[count], &cells));
    tensors.insert("level.template_print".into(), u32s(&[count, 2], prints));
}

fn put_page_table(tensors: &mut Tensors, table: &PageTable) {
    let PageTable { block_counts, block_balls, block_chunks, levels, level_chunks } = table;
    let mut put = |name: &str, tensor| tensors.insert(name.into(), tensor);
    put(pages::BLOCK_COUNTS, u32s(&[block_counts.len()], block_counts.iter().copied()));
    let rows = levels.iter().flat_map(|level| [level.block, level.count, level.stands_in.into()]);
    put(pages::LEVELS, u32s(&[levels.len(), 3], rows));
    let cells: Vec<f32> = levels.iter().map(|level| level.cell).collect();
    put(pages::LEVEL_CELLS, floats(&[levels.len()], &cells));
    let balls =
        [(pages::BLOCK_BALLS, block_balls), (pages::BLOCK_CHUNKS, block_chunks), (pages::LEVEL_CHUNKS, level_chunks)];
    for (name, balls) in balls {
        put(name, floats(&[balls.len(), 5], balls.as_flattened()));
    }
}

fn put_offsets(tensors: &mut Tensors, scene: &InstancedScene, pack: Pack) {
    let Offsets { means, sh_dc, opacity_logits, sh_rest, log_scales, quats } = &scene.offsets;
    let m = scene.offsets.len();
    let mut ranges = OffsetRanges::empty(segments(&scene.instances, &scene.template_ranges, m));
    let mut any_bytes = false;
    let mut channels = |shape: &[usize], values: &[f32], first: usize, underflow: Underflow| {
        if pack != Pack::Q8 || !fits_half(values) {
            return small_floats(pack, shape, values, underflow);
        }
        any_bytes = true;
        ForeignTensor {
            dtype: "U8".into(),
            shape: shape.into(),
            bytes: ranges.pack(values, shape[1..].iter().product(), first),
        }
    };
    let mut put = |name: &str, tensor| tensors.insert(name.into(), tensor);
    // Positions are in scene units, which may be small as a whole.
    put("offset.means", channels(&[m, 3], means.as_flattened(), 0, Underflow::Rows(3 * m)));
    put("offset.sh_dc", channels(&[m, 3], sh_dc.as_flattened(), 3, Underflow::Harmless));
    put("offset.opacity_logits", channels(&[m], opacity_logits, 6, Underflow::Harmless));
    if any_bytes {
        put("offset.range", ranges.tensor());
    }
    let rest = scene.offsets.rest_coefficients();
    for (name, shape, values) in [
        ("offset.sh_rest", &[m, rest, 3][..], sh_rest.as_flattened()),
        ("offset.log_scales", &[m, 3], log_scales.as_flattened()),
        ("offset.quats", &[m, 4], quats.as_flattened()),
    ] {
        if !values.is_empty() {
            put(name, small_floats(pack, shape, values, Underflow::Harmless));
        }
    }
}

pub(crate) fn u32s(shape: &[usize], values: impl Iterator<Item = u32>) -> ForeignTensor {
    ForeignTensor { dtype: "U32".into(), shape: shape.into(), bytes: values.flat_map(u32::to_le_bytes).collect() }
}

/// The bytes of the file: tensors with the widest element type first, so that each is aligned to its type, then by
/// name.
pub(crate) fn assemble(
    metadata: &BTreeMap<String, String>,
    tensors: &BTreeMap<String, ForeignTensor>,
    path: &Path,
) -> Result<Vec<u8>, IoError> {
    let mut order = Vec::with_capacity(tensors.len());
    for (name, tensor) in tensors {
        let fail = |what: String| IoError::new(path, format!("cannot write: {what}")).at(Place::Tensor(name.clone()));
        let dtype: Dtype = serde_json::from_value(tensor.dtype.clone().into())
            .map_err(|_| fail(format!("{} is not a safetensors type", tensor.dtype)))?;
        let bits = tensor.shape.iter().try_fold(dtype.bitsize(), |n, &d| n.checked_mul(d));
        if bits != tensor.bytes.len().checked_mul(8) {
            return Err(fail(format!("{} bytes do not match shape and type", tensor.bytes.len())));
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

#[cfg(test)]
#[path = "scene_write_small_tests.rs"]
mod small_tests;
#[cfg(test)]
#[path = "scene_write_tests.rs"]
mod tests;
