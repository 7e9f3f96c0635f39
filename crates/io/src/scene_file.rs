//! `.instgs`: instanced scenes as a safetensors file.
//!
//! Reads F32 and F16 tensors, offsets in U8 ([`crate::scene_pack`]), coded clouds and offsets ([`crate::small`], formats 3 to 5)
//! and clouds in the coded tables of older versions (`scene_small.rs`, format 2). Unknown tensors and metadata are kept and
//! written again. Writing is in [`crate::scene_write`].

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use crate::error::{IoError, Place};
use crate::pages;
use crate::ply::dilation_of;
use crate::read_bytes;
use crate::scene_pack::{CHANNELS, OffsetRanges, segments};
use crate::scene_small::{SUFFIX, TableError, small_shape, small_values};
use crate::small::{
    CODED, LOG_COVARIANCES, PRECISION, RowClasses, coded_shape, decoded_classes, decoded_values, is_plausible,
    offset_shapes_from, shapes_from,
};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};
use instgs_vk::scene::instanced_scene::{ForeignTensor, Group, Instance, InstancedScene, SourceRange};
use instgs_vk::scene::lod::FittedLevel;
use instgs_vk::scene::lod::pages::{PageTable, PagedLevel};
use instgs_vk::scene::offsets::Offsets;
use instgs_vk::scene::{NearPlane, PixelFilter};

pub(crate) const FORMAT: &str = "instgs/1";
/// Format of files with coded tables, which older versions wrote.
pub(crate) const FORMAT_TABLES: &str = "instgs/2";
/// Format of files with coded fields; older versions report that they cannot read it.
pub(crate) const FORMAT_CODED: &str = "instgs/5";
/// Coded fields of older versions, which have sizes and rotations apart.
const OLDER_CODED: [&str; 2] = ["instgs/3", "instgs/4"];
/// Value of `instance.first_offset` for an instance without offsets.
pub(crate) const NO_OFFSET: u32 = u32::MAX;

/// Reads an `.instgs` file. Values may be non-finite (see [`crate::load_scene`]).
///
/// # Errors
/// The file cannot be read, a tensor is missing or inconsistent, or an index or transform is invalid.
pub fn read_scene_file(path: &Path) -> Result<InstancedScene, IoError> {
    parse_scene_file(&read_bytes(path)?, path)
}

/// Parses the bytes of an `.instgs` file; `path` is only used in messages.
pub fn parse_scene_file(bytes: &[u8], path: &Path) -> Result<InstancedScene, IoError> {
    let malformed = |e| IoError::damaged(path, format!("is not a whole safetensors file: {e}"));
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
    let tensors = SafeTensors::deserialize(bytes).map_err(malformed)?;
    let metadata = header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    // Pages repeat what the background has, in an order and with levels that are the file's alone.
    let is_scene = |(name, _): &(&str, TensorView<'_>)| !pages::is_of_pages(name);
    let tensors = tensors.iter().filter(is_scene).map(|(name, view)| (name.to_owned(), view)).collect();
    scene_of(tensors, metadata, path)
}

/// The scene in the tensors and metadata of a file; `path` is only used in messages.
pub(crate) fn scene_of(
    left: BTreeMap<String, TensorView<'_>>,
    mut metadata: BTreeMap<String, String>,
    path: &Path,
) -> Result<InstancedScene, IoError> {
    let field = |name: &str, what: String| IoError::new(path, what).at(Place::Field(format!("metadata {name}")));
    match metadata.remove("format").as_deref() {
        Some(FORMAT | FORMAT_TABLES | FORMAT_CODED) => {}
        Some(older) if OLDER_CODED.contains(&older) => {}
        Some(other) if other.starts_with("instgs/") => {
            return Err(field("format", format!("{other} is none of {FORMAT} to {FORMAT_CODED}"))
                .advise("this file needs a newer version of instgs-vk"));
        }
        _ => return Err(field("format", format!("is missing or not \"{FORMAT}\": this is not an instgs scene"))),
    }
    let mut reader = Reader { path, left, classes: BTreeMap::new() };

    let mut scene = InstancedScene {
        templates: reader.cloud("template")?,
        own: reader.cloud("own")?,
        background: reader.cloud("background")?,
        source: metadata.remove("source").unwrap_or_default(),
        pixel_filter: PixelFilter {
            antialias: match metadata.remove("antialias").as_deref() {
                None | Some("false") => false,
                Some("true") => true,
                Some(other) => return Err(field("antialias", format!("is \"{other}\", not \"true\" or \"false\""))),
            },
            dilation_px2: match metadata.remove("dilation_px2") {
                None => PixelFilter::default().dilation_px2,
                Some(text) => dilation_of(&text)
                    .ok_or_else(|| field("dilation_px2", format!("is \"{text}\", not a number from 1e-6 to 1e6")))?,
            },
        },
        near_plane: match metadata.remove("near") {
            None => NearPlane::default(),
            Some(text) => text
                .parse()
                .ok()
                .map(NearPlane)
                .filter(|near| near.is_valid())
                .ok_or_else(|| field("near", format!("is \"{text}\", not a number from 0 on")))?,
        },
        groups: match metadata.remove("groups") {
            None => Vec::new(),
            Some(text) => serde_json::from_str::<Vec<Group>>(&text).map_err(|e| field("groups", e.to_string()))?,
        },
        ..InstancedScene::default()
    };
    if let Some(degree) = metadata.remove("sh_degree") {
        // The shapes of the tensors define the degree; the string is informative and must not contradict them.
        if degree.parse() != Ok(scene.sh_degree()) && !(scene.templates.is_empty() && scene.background.is_empty()) {
            return Err(field(
                "sh_degree",
                format!("is \"{degree}\", but the tensors have degree {}", scene.sh_degree()),
            ));
        }
    }
    scene.template_ranges = reader.ranges("template.ranges")?;
    scene.instances = reader.instances()?;
    let colors = reader.optional("instance.color_from_template", &[3, 4], scene.instances.len())?;
    scene.color_from_template = colors.as_chunks().0.as_chunks().0.to_vec();
    scene.own_ranges = reader.ranges("instance.own")?;
    scene.offsets = reader.offsets(&scene)?;
    let offset_shapes = reader.shapes("offset", scene.offsets.len())?;
    scene.fitted_levels = reader.levels()?;
    scene.validate().map_err(|e| IoError::new(path, e.reason).at(Place::Tensor(e.tensor)))?;
    if let Some(values) = offset_shapes {
        let shapes = offset_shapes_from(&values, &scene.templates, &scene.offset_runs());
        let (quats, log_scales) = shapes.ok_or_else(|| {
            let tensor = Place::Tensor(format!("offset.{LOG_COVARIANCES}"));
            IoError::new(path, "has records that belong to several Gaussians of templates").at(tensor)
        })?;
        scene.offsets = Offsets { quats, log_scales, ..scene.offsets };
    }
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

/// The table of a background in pages, from the tensors whose names begin with `page.`; `path` is only used in messages.
pub(crate) fn page_table_of(left: BTreeMap<String, TensorView<'_>>, path: &Path) -> Result<PageTable, IoError> {
    let mut reader = Reader { path, left, classes: BTreeMap::new() };
    // Coded forms, which could claim any number of rows, are none of them.
    if let Some(other) = reader.left.keys().find(|name| !pages::TABLE.contains(&name.as_str())) {
        return Err(reader.error(other, "is no tensor of a table of pages"));
    }
    let block_counts = reader.u32s(pages::BLOCK_COUNTS, &[])?;
    let levels = reader.u32s(pages::LEVELS, &[3])?;
    let levels: &[[u32; 3]] = levels.as_chunks().0;
    let cells = reader.floats(pages::LEVEL_CELLS, &[], Some(levels.len()))?;
    let level = |(&[block, count, stands_in], cell): (&[u32; 3], f32)| match stands_in {
        0 | 1 => Ok(PagedLevel { block, count, stands_in: stands_in == 1, cell }),
        other => Err(other),
    };
    let levels = levels.iter().zip(cells).map(level).collect::<Result<Vec<_>, u32>>();
    let table = PageTable {
        block_balls: reader.vectors(pages::BLOCK_BALLS, Some(block_counts.len()))?,
        block_chunks: reader.vectors(pages::BLOCK_CHUNKS, None)?,
        level_chunks: reader.vectors(pages::LEVEL_CHUNKS, None)?,
        levels: levels.map_err(|other| reader.error(pages::LEVELS, format!("has {other} where 0 or 1 is expected")))?,
        block_counts,
    };
    table.check().map_err(|e| reader.error(&format!("page.{}", e.field), e.reason))?;
    Ok(table)
}

/// The tensors that have not been read yet.
struct Reader<'a> {
    path: &'a Path,
    left: BTreeMap<String, TensorView<'a>>,
    /// Classes of precision of the groups that have coded fields.
    classes: BTreeMap<String, RowClasses>,
}

impl<'a> Reader<'a> {
    fn error(&self, tensor: &str, what: impl Into<String>) -> IoError {
        IoError::new(self.path, what).at(Place::Tensor(tensor.into()))
    }

    fn is_u8(&self, name: &str) -> bool {
        self.left.get(name).is_some_and(|t| t.dtype() == Dtype::U8)
    }

    /// The tensor in whichever form it has: as it is, or coded.
    fn form_of(&self, name: &str) -> Option<(String, &TensorView<'a>)> {
        let forms = [name.to_owned(), format!("{name}{CODED}"), format!("{name}{SUFFIX}")];
        forms.into_iter().find_map(|form| self.left.get(&form).map(|view| (form, view)))
    }

    /// Number of rows of a tensor and of values in a row, whatever its form; `None` if it does not exist.
    fn shape_of(&self, name: &str) -> Result<Option<(usize, usize)>, IoError> {
        let Some((form, view)) = self.form_of(name) else { return Ok(None) };
        let shape = match &form[name.len()..] {
            "" => {
                let shape = view.shape();
                Ok((
                    shape.first().copied().unwrap_or(0),
                    shape.iter().skip(1).fold(1usize, |all, &side| all.saturating_mul(side)),
                ))
            }
            CODED => coded_shape(view.data()),
            _ => small_shape(view.data()),
        };
        shape.map(Some).map_err(|error| self.error(&form, error.to_string()))
    }

    /// True if any of the tensors exists.
    fn any(&self, names: &[&str]) -> bool {
        names.iter().any(|name| self.form_of(name).is_some())
    }

    /// Takes a tensor of shape `[rows, inner...]`; `rows` is checked if given. Returns its type, bytes and number of
    /// rows.
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
        if let Some((coded, view)) = self.take_coded(name)? {
            let data = view.data();
            let is_table = coded.ends_with(SUFFIX);
            let fail = |error: TableError| IoError::new(self.path, error.to_string()).at(Place::Tensor(coded.clone()));
            let (has_rows, width) = if is_table { small_shape(data) } else { coded_shape(data) }.map_err(fail)?;
            let want = inner.iter().product::<usize>();
            if width != want || rows.is_some_and(|rows| rows != has_rows) {
                let rows = rows.map_or("N".into(), |rows| rows.to_string());
                let what = format!("has {has_rows} rows of {width} numbers, not {rows} of {want}");
                return Err(self.error(&coded, what));
            }
            // Positions say how many rows the other tensors of a group have, and poses how many instances there are: neither must
            // claim more memory than the file's size makes plausible.
            let group = name.split('.').next().unwrap_or_default();
            if (rows.is_none() || name.ends_with(".means")) && !is_plausible(group, has_rows, data.len()) {
                return Err(fail(TableError::Implausible { rows: has_rows, bytes: data.len() }));
            }
            let is_quats = name.ends_with(".quats") && !name.starts_with("offset.");
            if is_table {
                return small_values(data, is_quats).map_err(fail);
            }
            self.read_classes(group, has_rows)?;
            return decoded_values(data, &self.classes[group], is_quats).map_err(fail);
        }
        let (dtype, data, _) = self.take(name, inner, rows)?;
        match dtype {
            Dtype::F32 => Ok(data.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()),
            Dtype::F16 => Ok(data.as_chunks::<2>().0.iter().map(|&b| half::f16::from_le_bytes(b).to_f32()).collect()),
            other => Err(self.error(name, format!("has the type {}, not F32 or F16", dtype_name(other)))),
        }
    }

    /// Reads the classes of precision of a group of so many rows, if that has not been done.
    fn read_classes(&mut self, group: &str, rows: usize) -> Result<(), IoError> {
        if self.classes.contains_key(group) {
            return Ok(());
        }
        let name = format!("{group}.{PRECISION}");
        let classes = match self.take_coded(&name)? {
            None => RowClasses::default(),
            Some((coded, view)) => {
                let fail = |error: TableError| self.error(&coded, error.to_string());
                let (has_rows, width) = coded_shape(view.data()).map_err(fail)?;
                if (has_rows, width) != (rows, 2) {
                    return Err(self.error(&coded, format!("has {has_rows} rows of {width} numbers, not {rows} of 2")));
                }
                decoded_classes(view.data()).map_err(fail)?
            }
        };
        self.classes.insert(group.to_owned(), classes);
        Ok(())
    }

    /// Takes the coded tensor that replaces a tensor, with its name.
    fn take_coded(&mut self, name: &str) -> Result<Option<(String, TensorView<'a>)>, IoError> {
        let mut forms = [CODED, SUFFIX].into_iter().map(|suffix| format!("{name}{suffix}"));
        let Some(coded) = forms.find(|form| self.left.contains_key(form)) else { return Ok(None) };
        if self.left.contains_key(name) {
            return Err(self.error(&coded, format!("is present together with {name}")));
        }
        let Some(view) = self.left.remove(&coded) else { return Ok(None) };
        if view.dtype() != Dtype::U8 {
            return Err(self.error(&coded, format!("has the type {}, not U8", dtype_name(view.dtype()))));
        }
        Ok(Some((coded, view)))
    }

    fn vectors<const D: usize>(&mut self, name: &str, rows: Option<usize>) -> Result<Vec<[f32; D]>, IoError> {
        Ok(in_rows(self.floats(name, &[D], rows)?))
    }

    /// Takes a tensor of integers; empty if it is absent.
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

    /// Takes a tensor of ranges, first and count; empty if it is absent.
    fn ranges(&mut self, name: &str) -> Result<Vec<SourceRange>, IoError> {
        let values = self.u32s(name, &[2])?;
        Ok(values.as_chunks().0.iter().map(|&[first, count]| SourceRange { first, count }).collect())
    }

    fn cloud(&mut self, group: &str) -> Result<Gaussians, IoError> {
        let [means, quats, log_scales, shapes, logits, sh] =
            ["means", "quats", "log_scales", LOG_COVARIANCES, "opacity_logits", "sh"].map(|f| format!("{group}.{f}"));
        if !self.any(&[&means, &quats, &log_scales, &shapes, &logits, &sh]) {
            return Ok(Gaussians::default());
        }
        let means = self.vectors::<3>(&means, None)?;
        let n = Some(means.len());
        let coefficients = match self.left.get(&sh) {
            Some(tensor) => Some(tensor.shape().to_vec()),
            None => self.shape_of(&sh)?.map(|(rows, width)| vec![rows, width / 3, if width % 3 == 0 { 3 } else { 0 }]),
        };
        let degree = match coefficients.as_deref() {
            Some(&[_, c, 3]) => (0..=MAX_SH_DEGREE).find(|&d| sh_coefficients(d) == c),
            _ => None,
        };
        let Some(sh_degree) = degree else {
            let what = coefficients
                .map_or("is missing".into(), |s| format!("has the shape {s:?}, not [N, C, 3] with C = 1, 4, 9 or 16"));
            return Err(self.error(&sh, what));
        };
        let (quats, log_scales) = match self.shapes(group, means.len())? {
            Some(log_covariances) => shapes_from(&log_covariances),
            None => (self.vectors::<4>(&quats, n)?, self.vectors::<3>(&log_scales, n)?),
        };
        Ok(Gaussians {
            sh_degree,
            quats,
            log_scales,
            opacity_logits: self.floats(&logits, &[], n)?,
            sh: in_rows(self.floats(&sh, &[sh_coefficients(sh_degree), 3], n)?),
            means,
        })
    }

    /// The logarithms of a group's covariances, six numbers a row; `None` if it has sizes and rotations apart.
    fn shapes(&mut self, group: &str, rows: usize) -> Result<Option<Vec<f32>>, IoError> {
        let name = format!("{group}.{LOG_COVARIANCES}");
        let Some((form, _)) = self.form_of(&name) else { return Ok(None) };
        for other in ["quats", "log_scales"].map(|field| format!("{group}.{field}")) {
            if let Some((other, _)) = self.form_of(&other) {
                return Err(self.error(&form, format!("is present together with {other}")));
            }
        }
        let values = self.floats(&name, &[6], Some(rows))?;
        match values.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(self.error(&form, format!("has a number that is not finite in row {}", at / 6))),
            None => Ok(Some(values)),
        }
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

    /// Optimised levels of detail, as ranges of one cloud.
    fn levels(&mut self) -> Result<Vec<FittedLevel>, IoError> {
        const RANGES: &str = "level.ranges";
        const CELLS: &str = "level.cell";
        const PRINTS: &str = "level.template_print";
        if !self.any(&[RANGES, CELLS, PRINTS, "level.means"]) {
            return Ok(Vec::new());
        }
        let cloud = self.cloud("level")?;
        let ranges = self.ranges(RANGES)?;
        let cells = self.floats(CELLS, &[], Some(ranges.len()))?;
        let prints = self.u32s(PRINTS, &[2])?;
        let prints: &[[u32; 2]] = prints.as_chunks().0;
        if prints.len() != ranges.len() {
            let what = format!("has {} rows where {RANGES} has {}", prints.len(), ranges.len());
            return Err(self.error(PRINTS, what));
        }
        // One after another, so that a file cannot claim more Gaussians than it has.
        let mut end = 0;
        for (l, range) in ranges.iter().enumerate() {
            let SourceRange { first, count } = *range;
            if first as usize != end || cloud.len() - end < count as usize {
                let what =
                    format!("level {l} has {count} Gaussians from {first}, not some of {} from {end}", cloud.len());
                return Err(self.error(RANGES, what));
            }
            end += count as usize;
        }
        let level = |((range, &cell), &[low, high]): ((&SourceRange, &f32), &[u32; 2])| FittedLevel {
            template_print: u64::from(high) << 32 | u64::from(low),
            cell,
            gaussians: cloud.range(*range),
        };
        Ok(ranges.iter().zip(&cells).zip(prints).map(level).collect())
    }

    /// The offsets of a scene whose templates and instances have been read.
    fn offsets(&mut self, scene: &InstancedScene) -> Result<Offsets, IoError> {
        const MEANS: &str = "offset.means";
        const SH_DC: &str = "offset.sh_dc";
        const LOGITS: &str = "offset.opacity_logits";
        const RANGE: &str = "offset.range";
        const SH_REST: &str = "offset.sh_rest";
        const LOG_SCALES: &str = "offset.log_scales";
        const QUATS: &str = "offset.quats";
        let shapes = format!("offset.{LOG_COVARIANCES}");
        if !self.any(&[MEANS, SH_DC, LOGITS, RANGE, SH_REST, LOG_SCALES, QUATS, &shapes]) {
            return Ok(Offsets::default());
        }
        let Some((m, _)) = self.shape_of(MEANS)? else {
            return Err(self.error(MEANS, "is missing"));
        };
        let ranges = match ([MEANS, SH_DC, LOGITS].iter().any(|name| self.is_u8(name)), self.left.contains_key(RANGE)) {
            (false, false) => None,
            (false, true) => return Err(self.error(RANGE, "is present, but no offset tensor is U8")),
            (true, _) => {
                let segments = segments(&scene.instances, &scene.template_ranges, m);
                let values = self.floats(RANGE, &[CHANNELS, 2], Some(segments.len()))?;
                Some(OffsetRanges::from_values(segments, &values))
            }
        };
        // Of any degree up to the templates'; another shape is an error.
        let mut of_degrees = (0..=scene.templates.sh_degree).map(|degree| sh_coefficients(degree) - 1);
        let stored = self.shape_of(SH_REST)?.map(|(_, numbers)| numbers / 3);
        let rest = of_degrees.find(|&rest| Some(rest) == stored).unwrap_or(scene.templates.sh_coefficients() - 1);
        Ok(Offsets {
            means: in_rows(self.channels(MEANS, &[3], m, &ranges, 0)?),
            sh_dc: in_rows(self.channels(SH_DC, &[3], m, &ranges, 3)?),
            opacity_logits: self.channels(LOGITS, &[], m, &ranges, 6)?,
            sh_rest: in_rows(self.optional(SH_REST, &[rest, 3], m)?),
            log_scales: in_rows(self.optional(LOG_SCALES, &[3], m)?),
            quats: in_rows(self.optional(QUATS, &[4], m)?),
        })
    }

    /// Offsets stored as floats, or as bytes of the q8 channels from `first`.
    fn channels(
        &mut self,
        name: &str,
        inner: &[usize],
        rows: usize,
        ranges: &Option<OffsetRanges>,
        first: usize,
    ) -> Result<Vec<f32>, IoError> {
        match ranges.as_ref().filter(|_| self.is_u8(name)) {
            None => self.floats(name, inner, Some(rows)),
            Some(ranges) => {
                let (_, bytes, _) = self.take(name, inner, Some(rows))?;
                Ok(ranges.unpack(&bytes, inner.iter().product(), first))
            }
        }
    }

    /// Takes a tensor of floats; empty if it is absent.
    fn optional(&mut self, name: &str, inner: &[usize], rows: usize) -> Result<Vec<f32>, IoError> {
        if self.form_of(name).is_some() { self.floats(name, inner, Some(rows)) } else { Ok(Vec::new()) }
    }
}

/// The values as rows of D, where they are: a copy of a large scene's SH coefficients takes a twentieth of the time to load it.
fn in_rows<const D: usize>(values: Vec<f32>) -> Vec<[f32; D]> {
    // A capacity that is no multiple of D needs a copy.
    bytemuck::try_cast_vec(values).unwrap_or_else(|(_, values)| values.as_chunks().0.to_vec())
}

/// Name of an element type in safetensors.
fn dtype_name(dtype: Dtype) -> String {
    match serde_json::to_value(dtype) {
        Ok(serde_json::Value::String(name)) => name,
        _ => format!("{dtype:?}"),
    }
}

#[cfg(test)]
#[path = "scene_file_tests.rs"]
pub(crate) mod tests;
