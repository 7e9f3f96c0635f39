//! `.instgs`: instanced scenes as a safetensors file (DESIGN section 5).
//!
//! Reads F32 and F16 tensors, writes F32. Tensors and metadata that this version does not know are kept and written
//! again; that includes the optional `offset.{sh_rest,log_scales,quats}`, which are not rendered.
//! Writing is in [`crate::io::scene_write`].

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::io::error::{IoError, Place};
use crate::io::read_bytes;
use crate::math::similarity::Similarity;
use crate::scene::gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};
use crate::scene::instanced_scene::{ForeignTensor, Group, Instance, InstancedScene, TemplateRange};
use crate::scene::offsets::Offsets;

pub(crate) const FORMAT: &str = "instgs/1";
/// `instance.first_offset` of an instance without offsets.
pub(crate) const NO_OFFSET: u32 = u32::MAX;
/// Reads an `.instgs` file. Values may be non-finite (see [`crate::io::load_scene`]); indices and transforms are checked.
pub fn read_scene_file(path: &Path) -> Result<InstancedScene, IoError> {
    parse_scene_file(&read_bytes(path)?, path)
}

/// Parses the bytes of an `.instgs` file; `path` is for messages only.
pub fn parse_scene_file(bytes: &[u8], path: &Path) -> Result<InstancedScene, IoError> {
    let malformed = |e| IoError::new(path, format!("is not a whole safetensors file: {e}"));
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
    let tensors = SafeTensors::deserialize(bytes).map_err(malformed)?;
    let mut metadata: BTreeMap<String, String> =
        header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    let field = |name: &str, what: String| IoError::new(path, what).at(Place::Field(format!("metadata {name}")));
    match metadata.remove("format").as_deref() {
        Some(FORMAT) => {}
        Some(other) if other.starts_with("instgs/") => {
            return Err(field("format", format!("{other} is not {FORMAT}"))
                .advise("this file needs a newer version of instgs-vk"));
        }
        _ => return Err(field("format", format!("is missing or not \"{FORMAT}\": this is no instgs scene"))),
    }
    let mut reader = Reader { path, left: tensors.iter().map(|(name, view)| (name.to_owned(), view)).collect() };
    if reader.left.contains_key("offset.range")
        || reader.left.values().any(|t| t.dtype() == Dtype::U8) && reader.is_u8("offset.means")
    {
        let error = reader.error("offset.means", "is packed with q8, which this version does not read");
        return Err(error.advise("this file needs a newer version of instgs-vk, or pack it with f16"));
    }

    let mut scene = InstancedScene {
        templates: reader.cloud("template")?,
        background: reader.cloud("background")?,
        source: metadata.remove("source").unwrap_or_default(),
        antialias: match metadata.remove("antialias").as_deref() {
            None | Some("false") => false,
            Some("true") => true,
            Some(other) => return Err(field("antialias", format!("is \"{other}\", not \"true\" or \"false\""))),
        },
        groups: match metadata.remove("groups") {
            None => Vec::new(),
            Some(text) => serde_json::from_str::<Vec<Group>>(&text).map_err(|e| field("groups", e.to_string()))?,
        },
        ..InstancedScene::default()
    };
    if let Some(degree) = metadata.remove("sh_degree") {
        // The shapes of the tensors decide; the string is for people and must only not contradict them.
        if degree.parse() != Ok(scene.sh_degree()) && !(scene.templates.is_empty() && scene.background.is_empty()) {
            return Err(field(
                "sh_degree",
                format!("is \"{degree}\", but the tensors have degree {}", scene.sh_degree()),
            ));
        }
    }
    scene.template_ranges = reader
        .u32s("template.ranges", &[2])?
        .as_chunks::<2>()
        .0
        .iter()
        .map(|&[first, count]| TemplateRange { first, count })
        .collect();
    scene.instances = reader.instances()?;
    scene.offsets = reader.offsets()?;
    scene.validate().map_err(|e| IoError::new(path, e.reason).at(Place::Tensor(e.tensor)))?;
    for (name, view) in reader.left {
        let foreign = ForeignTensor {
            dtype: dtype_name(view.dtype()),
            shape: view.shape().to_vec(),
            bytes: view.data().to_vec(),
        };
        scene.foreign_tensors.insert(name, foreign);
    }
    scene.foreign_metadata = metadata;
    Ok(scene)
}

/// The tensors not read yet.
struct Reader<'a> {
    path: &'a Path,
    left: BTreeMap<String, TensorView<'a>>,
}

impl Reader<'_> {
    fn error(&self, tensor: &str, what: impl Into<String>) -> IoError {
        IoError::new(self.path, what).at(Place::Tensor(tensor.into()))
    }

    fn is_u8(&self, name: &str) -> bool {
        self.left.get(name).is_some_and(|t| t.dtype() == Dtype::U8)
    }

    /// True if any tensor of the group is there: then all of them must be.
    fn any(&self, names: &[&str]) -> bool {
        names.iter().any(|n| self.left.contains_key(*n))
    }

    /// Takes a tensor of shape `[rows, inner...]`; `rows` is checked if given. Returns its rows and bytes.
    fn take(&mut self, name: &str, inner: &[usize], rows: Option<usize>) -> Result<(Dtype, Vec<u8>, usize), IoError> {
        let Some(view) = self.left.remove(name) else {
            return Err(self.error(name, "is missing"));
        };
        let shape = view.shape();
        let fits = shape.len() == inner.len() + 1 && shape[1..] == *inner && rows.is_none_or(|r| r == shape[0]);
        if !fits {
            let first = rows.map_or("N".into(), |r| r.to_string());
            let want: Vec<String> = std::iter::once(first).chain(inner.iter().map(usize::to_string)).collect();
            return Err(self.error(name, format!("has the shape {shape:?}, not [{}]", want.join(", "))));
        }
        Ok((view.dtype(), view.data().to_vec(), shape[0]))
    }

    fn floats(&mut self, name: &str, inner: &[usize], rows: Option<usize>) -> Result<Vec<f32>, IoError> {
        let (dtype, data, _) = self.take(name, inner, rows)?;
        match dtype {
            Dtype::F32 => Ok(data.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()),
            Dtype::F16 => Ok(data.as_chunks::<2>().0.iter().map(|&b| half::f16::from_le_bytes(b).to_f32()).collect()),
            other => Err(self.error(name, format!("has the type {}, not F32 or F16", dtype_name(other)))),
        }
    }

    fn vectors<const D: usize>(&mut self, name: &str, rows: Option<usize>) -> Result<Vec<[f32; D]>, IoError> {
        Ok(self.floats(name, &[D], rows)?.as_chunks::<D>().0.to_vec())
    }

    /// Empty if the tensor is absent.
    fn u32s(&mut self, name: &str, inner: &[usize]) -> Result<Vec<u32>, IoError> {
        if !self.left.contains_key(name) {
            return Ok(Vec::new());
        }
        let (dtype, data, _) = self.take(name, inner, None)?;
        if dtype != Dtype::U32 {
            return Err(self.error(name, format!("has the type {}, not U32", dtype_name(dtype))));
        }
        Ok(data.as_chunks::<4>().0.iter().map(|&b| u32::from_le_bytes(b)).collect())
    }

    fn cloud(&mut self, group: &str) -> Result<Gaussians, IoError> {
        let [means, quats, log_scales, logits, sh] =
            ["means", "quats", "log_scales", "opacity_logits", "sh"].map(|f| format!("{group}.{f}"));
        if !self.any(&[&means, &quats, &log_scales, &logits, &sh]) {
            return Ok(Gaussians::default());
        }
        let means = self.vectors::<3>(&means, None)?;
        let n = Some(means.len());
        let coefficients = self.left.get(&sh).map(|t| t.shape().to_vec());
        let degree = match coefficients.as_deref() {
            Some(&[_, c, 3]) => (0..=MAX_SH_DEGREE).find(|&d| sh_coefficients(d) == c),
            _ => None,
        };
        let Some(sh_degree) = degree else {
            let what = coefficients
                .map_or("is missing".into(), |s| format!("has the shape {s:?}, not [N, C, 3] with C = 1, 4, 9 or 16"));
            return Err(self.error(&sh, what));
        };
        Ok(Gaussians {
            sh_degree,
            quats: self.vectors::<4>(&quats, n)?,
            log_scales: self.vectors::<3>(&log_scales, n)?,
            opacity_logits: self.floats(&logits, &[], n)?,
            sh: self.floats(&sh, &[sh_coefficients(sh_degree), 3], n)?.as_chunks::<3>().0.to_vec(),
            means,
        })
    }

    fn instances(&mut self) -> Result<Vec<Instance>, IoError> {
        const POSES: &str = "instance.world_from_template";
        if !self.any(&["instance.template", POSES, "instance.first_offset"]) {
            return Ok(Vec::new());
        }
        let rows = self.floats(POSES, &[3, 4], None)?;
        let rows = rows.as_chunks::<4>().0.as_chunks::<3>().0;
        let templates = self.u32s("instance.template", &[])?;
        let firsts = self.u32s("instance.first_offset", &[])?;
        for (name, len) in [("instance.template", templates.len()), ("instance.first_offset", firsts.len())] {
            if len != rows.len() {
                return Err(self.error(name, format!("has {len} entries where {POSES} has {}", rows.len())));
            }
        }
        let mut instances = Vec::with_capacity(rows.len());
        for (k, rows) in rows.iter().enumerate() {
            let world_from_template =
                Similarity::from_rows(*rows).map_err(|e| self.error(POSES, format!("instance {k} {e}")))?;
            let first_offset = Some(firsts[k]).filter(|&f| f != NO_OFFSET);
            instances.push(Instance { template: templates[k], world_from_template, first_offset });
        }
        Ok(instances)
    }

    fn offsets(&mut self) -> Result<Offsets, IoError> {
        if !self.any(&["offset.means", "offset.sh_dc", "offset.opacity_logits"]) {
            return Ok(Offsets::default());
        }
        let means = self.vectors::<3>("offset.means", None)?;
        let m = Some(means.len());
        Ok(Offsets {
            sh_dc: self.vectors::<3>("offset.sh_dc", m)?,
            opacity_logits: self.floats("offset.opacity_logits", &[], m)?,
            means,
        })
    }
}

/// The name that safetensors files use for a type.
fn dtype_name(dtype: Dtype) -> String {
    match serde_json::to_value(dtype) {
        Ok(serde_json::Value::String(name)) => name,
        _ => format!("{dtype:?}"),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::io::ply::tests::sample;
    use crate::io::scene_write::{assemble, floats, scene_file_bytes, u32s};

    /// Two templates (3 and 2 Gaussians), four instances, 8 offset records, a background of 4.
    pub(crate) fn sample_scene() -> InstancedScene {
        let pose = |x: f32| {
            Similarity::from_rows([[0.0, -2.0, 0.0, x], [2.0, 0.0, 0.0, 1.0], [0.0, 0.0, 2.0, -x]])
                .unwrap_or(Similarity::IDENTITY)
        };
        let instance = |template, x, first_offset| Instance { template, world_from_template: pose(x), first_offset };
        let values = sample(0, 8);
        InstancedScene {
            templates: sample(2, 5),
            template_ranges: vec![TemplateRange { first: 0, count: 3 }, TemplateRange { first: 3, count: 2 }],
            instances: vec![
                instance(0, 0.0, Some(0)),
                instance(1, 1.0, None),
                instance(0, 2.0, Some(3)),
                instance(1, 3.0, Some(6)),
            ],
            offsets: Offsets { means: values.means, sh_dc: values.sh, opacity_logits: values.opacity_logits },
            background: sample(3, 4),
            antialias: true,
            groups: vec![Group { template_id: 0, name: Some("chair \"a\"".into()), instance_ids: vec![4, 9] }],
            source: "test".into(),
            foreign_tensors: BTreeMap::from([
                ("x.odd".into(), ForeignTensor { dtype: "U8".into(), shape: vec![3], bytes: vec![1, 2, 3] }),
                ("a.wide".into(), ForeignTensor { dtype: "I64".into(), shape: vec![1], bytes: vec![7; 8] }),
            ]),
            foreign_metadata: (0..9).map(|i| (format!("key{i}"), format!("value {i}"))).collect(),
        }
    }

    #[test]
    fn what_is_written_is_read_and_bytes_are_the_same_each_time() -> Result<(), IoError> {
        let path = Path::new("x.instgs");
        for scene in [sample_scene(), InstancedScene::default(), InstancedScene::from_cloud(sample(1, 2))] {
            let bytes = scene_file_bytes(&scene, path)?;
            for _ in 0..5 {
                let back = parse_scene_file(&bytes, path)?;
                assert_eq!(back, scene);
                assert_eq!(scene_file_bytes(&back, path)?, bytes);
            }
        }
        Ok(())
    }

    /// The sample's file with one change to its tensors or metadata.
    fn changed(
        change: impl FnOnce(&mut BTreeMap<String, ForeignTensor>, &mut BTreeMap<String, String>),
    ) -> Result<InstancedScene, IoError> {
        let path = Path::new("x.instgs");
        let bytes = scene_file_bytes(&sample_scene(), path)?;
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
        let index =
            text(changed(|t, _| drop(t.insert("instance.template".into(), u32s(&[4], [0, 1, 2, 0].into_iter())))));
        assert!(index.contains("instance.template"), "{index}");
        let q8 = text(changed(|t, _| drop(t.insert("offset.range".into(), floats(&[4, 7, 2], &[0.0; 56])))));
        assert!(q8.contains("newer version"), "{q8}");
        assert!(text(changed(|_, m| drop(m.remove("format")))).contains("metadata format"));
        assert!(text(changed(|_, m| drop(m.insert("format".into(), "instgs/2".into())))).contains("newer version"));
        assert!(text(changed(|_, m| drop(m.insert("antialias".into(), "yes".into())))).contains("antialias"));
        assert!(text(changed(|_, m| drop(m.insert("groups".into(), "[{}]".into())))).contains("groups"));
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
        assert!(scene.instances.is_empty() && scene.templates.is_empty() && !scene.antialias);
        let want = sample_scene().background;
        assert!((scene.background.means[3][2] - want.means[3][2]).abs() < 2e-3);
        Ok(())
    }
}
