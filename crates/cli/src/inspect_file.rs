//! The purpose of every byte of a scene file.

use std::path::Path;

use safetensors::SafeTensors;
use safetensors::tensor::TensorInfo;

use instgs_console::CliError;
use instgs_io::scene_small::{SUFFIX, small_shape};
use instgs_io::small::{CODED, CodedStreams, LOG_COVARIANCES, coded_shape, coded_streams};
use instgs_io::{IoError, LoadedScene};

/// A range of bytes of the file.
#[derive(serde::Serialize)]
pub(super) struct FilePart {
    pub(super) name: String,
    /// Element type and shape, for a tensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) layout: Option<String>,
    /// What an entropy coded tensor's bytes are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) coded: Option<CodedStreams>,
    pub(super) bytes: u64,
    /// The first dimension of a tensor; for a coded table its number of rows.
    #[serde(skip)]
    pub(super) rows: u64,
    #[serde(skip)]
    pub(super) purpose: Purpose,
}

/// The purpose of a part of the file.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    Templates,
    Own,
    Background,
    Offsets,
    Instances,
    TemplateRanges,
    Levels,
    Pages,
    Foreign,
    Header,
}

/// Bytes of the file by purpose; their sum is `bytes.file`.
#[derive(Clone, Copy, serde::Serialize)]
pub(super) struct FileSums {
    pub(super) templates: u64,
    /// Gaussians that instances have of their own.
    pub(super) own: u64,
    pub(super) background: u64,
    /// Offset records, with the ranges of q8.
    pub(super) offsets: u64,
    pub(super) instances: u64,
    pub(super) template_ranges: u64,
    /// Optimised levels of detail of templates.
    pub(super) levels: u64,
    /// What a background in pages takes besides itself: its levels, and where everything is.
    pub(super) pages: u64,
    /// Tensors of names that this version does not know.
    pub(super) foreign: u64,
    /// Length field, names, metadata and padding.
    pub(super) header: u64,
}

impl FileSums {
    pub(super) fn of(parts: &[FilePart]) -> Self {
        let sum = |purpose| parts.iter().filter(|p| p.purpose == purpose).map(|p| p.bytes).sum();
        Self {
            templates: sum(Purpose::Templates),
            own: sum(Purpose::Own),
            background: sum(Purpose::Background),
            offsets: sum(Purpose::Offsets),
            instances: sum(Purpose::Instances),
            template_ranges: sum(Purpose::TemplateRanges),
            levels: sum(Purpose::Levels),
            pages: sum(Purpose::Pages),
            foreign: sum(Purpose::Foreign),
            header: sum(Purpose::Header),
        }
    }
}

fn plain(name: &str, purpose: Purpose, bytes: u64) -> FilePart {
    FilePart { name: name.into(), layout: None, coded: None, bytes, rows: 0, purpose }
}

/// The file's header and tensors, or the parts of other formats as far as known.
pub(super) fn file_parts(path: &Path, loaded: &LoadedScene) -> Result<Vec<FilePart>, CliError> {
    let file_bytes = loaded.file_bytes;
    let read = || std::fs::read(path).map_err(|e| IoError::new(path, format!("cannot read: {e}")));
    Ok(match loaded.format.as_str() {
        "instgs" => tensor_parts(&read()?, path)?,
        "ply" => {
            const END: &[u8] = b"end_header";
            let bytes = read()?;
            // The header ends with the line break after its last word.
            let end = bytes.windows(END.len()).position(|w| w == END).map_or(0, |at| at + END.len());
            let header = bytes[end..].iter().position(|&b| b == b'\n').map_or(end, |at| end + at + 1) as u64;
            let vertices = plain("vertices", Purpose::Background, bytes.len() as u64 - header);
            vec![plain("header", Purpose::Header, header), vertices]
        }
        "splat" => vec![plain("records of 32 bytes", Purpose::Background, file_bytes)],
        "glb" => vec![plain("JSON and accessors", Purpose::Background, file_bytes)],
        _ => vec![plain("compressed Gaussians", Purpose::Background, file_bytes)],
    })
}

/// The parts of an `.instgs` file; `path` is for messages only.
pub(super) fn tensor_parts(bytes: &[u8], path: &Path) -> Result<Vec<FilePart>, CliError> {
    /// The little-endian length of the header that a safetensors file begins with.
    const LENGTH_BYTES: usize = 8;
    let (header_bytes, metadata) = SafeTensors::read_metadata(bytes)
        .map_err(|e| IoError::new(path, format!("is not a whole safetensors file: {e}")))?;
    let json = &bytes[LENGTH_BYTES..][..header_bytes];
    let padding = json.iter().rev().take_while(|&&b| b == b' ').count();
    let mut parts = vec![
        plain("header length", Purpose::Header, LENGTH_BYTES as u64),
        plain("header JSON", Purpose::Header, (json.len() - padding) as u64),
        plain("header padding", Purpose::Header, padding as u64),
    ];
    let mut tensors: Vec<_> = metadata.tensors().into_iter().collect();
    tensors.sort_by(|a, b| (a.1.data_offsets, &a.0).cmp(&(b.1.data_offsets, &b.0)));
    let tensor_part = |(name, info): (String, &TensorInfo)| {
        let data = &bytes[LENGTH_BYTES + header_bytes..][info.data_offsets.0..info.data_offsets.1];
        let coded = name.ends_with(CODED).then(|| coded_streams(data)).flatten();
        FilePart {
            purpose: purpose_of(&name),
            layout: Some(coded.map_or_else(|| format!("{:?} {:?}", info.dtype, info.shape), layout_of)),
            coded,
            bytes: data.len() as u64,
            rows: rows_of(&name, info, data),
            name,
        }
    };
    parts.extend(tensors.into_iter().map(tensor_part));
    Ok(parts)
}

/// The shape of a coded tensor, and what its values take.
fn layout_of(streams: CodedStreams) -> String {
    let CodedStreams { rows, width, header_bytes, token_bytes, low_bytes } = streams;
    let bits = |bytes: usize| 8.0 * bytes as f64 / (rows * width).max(1) as f64;
    format!(
        "[{rows}, {width}], {:.2} bits a value entropy coded, {:.2} as they are, {header_bytes} bytes of tables",
        bits(token_bytes),
        bits(low_bytes)
    )
}

fn rows_of(name: &str, info: &TensorInfo, bytes: &[u8]) -> u64 {
    let coded = |shape: Result<(usize, usize), _>| shape.map_or(0, |(rows, _)| rows as u64);
    if name.ends_with(SUFFIX) {
        coded(small_shape(bytes))
    } else if name.ends_with(CODED) {
        coded(coded_shape(bytes))
    } else {
        info.shape.first().map_or(0, |&rows| rows as u64)
    }
}

fn purpose_of(tensor: &str) -> Purpose {
    const CLOUD: [&str; 7] = ["means", "quats", "log_scales", LOG_COVARIANCES, "opacity_logits", "sh", "precision"];
    const OFFSETS: [&str; 9] =
        ["means", "sh_dc", "opacity_logits", "sh_rest", "log_scales", "quats", LOG_COVARIANCES, "range", "precision"];
    const INSTANCES: [&str; 5] = ["template", "world_from_template", "first_offset", "color_from_template", "own"];
    const LEVELS: [&str; 3] = ["ranges", "cell", "template_print"];
    let name = [SUFFIX, CODED].iter().find_map(|suffix| tensor.strip_suffix(suffix)).unwrap_or(tensor);
    match name.split_once('.') {
        Some(("page", _)) => Purpose::Pages,
        Some(("page_fine" | "page_stand_in", field)) if CLOUD.contains(&field) => Purpose::Pages,
        Some(("template", "ranges")) => Purpose::TemplateRanges,
        Some(("template", field)) if CLOUD.contains(&field) => Purpose::Templates,
        Some(("level", field)) if CLOUD.contains(&field) || LEVELS.contains(&field) => Purpose::Levels,
        Some(("own", field)) if CLOUD.contains(&field) => Purpose::Own,
        Some(("background", field)) if CLOUD.contains(&field) => Purpose::Background,
        Some(("offset", field)) if OFFSETS.contains(&field) => Purpose::Offsets,
        Some(("instance", field)) if INSTANCES.contains(&field) => Purpose::Instances,
        _ => Purpose::Foreign,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_io::Pack;
    use instgs_io::scene_write::packed_scene_file_bytes;
    use instgs_samples::{with_ablations, with_levels, with_own};

    #[test]
    fn parts_add_up_to_the_file() -> Result<(), CliError> {
        let path = Path::new("x.instgs");
        let packs = [Pack::F32, Pack::F16, Pack::Q8, Pack::Small];
        let scenes = [with_ablations(), with_own(), with_levels()];
        for (pack, scene) in packs.iter().flat_map(|&pack| scenes.iter().map(move |scene| (pack, scene))) {
            let bytes = packed_scene_file_bytes(scene, pack, path)?;
            let parts = tensor_parts(&bytes, path)?;
            assert_eq!(parts.iter().map(|p| p.bytes).sum::<u64>(), bytes.len() as u64);
            let sums = FileSums::of(&parts);
            let coded: Vec<_> = parts.iter().filter_map(|part| Some((part, part.coded?))).collect();
            assert_eq!(coded.is_empty(), pack != Pack::Small);
            for (part, coded) in coded {
                let bytes = coded.header_bytes + coded.token_bytes + coded.low_bytes;
                assert_eq!((bytes as u64, coded.rows as u64), (part.bytes, part.rows), "{}", part.name);
            }
            let gaussians = sums.templates + sums.own + sums.background;
            assert_eq!(sums.own > 0, !scene.own.is_empty());
            assert_eq!(sums.levels > 0, !scene.fitted_levels.is_empty() && pack != Pack::Small);
            let tables = sums.offsets + sums.instances + sums.template_ranges + sums.levels;
            assert_eq!(gaussians + tables + sums.foreign + sums.header, bytes.len() as u64);
            // Two foreign tensors of 3 and 8 bytes.
            assert_eq!((sums.foreign, sums.instances), (11, scene.instance_bytes() * scene.instances.len() as u64));
        }
        Ok(())
    }

    #[test]
    fn pages_are_explained() -> Result<(), CliError> {
        let folder = tempfile::tempdir().map_err(|e| CliError::msg(e.to_string()))?;
        let path = folder.path().join("x.instgs");
        instgs_io::write_scene_file_in_pages(&path, &with_levels(), Pack::F16)?;
        let bytes = std::fs::read(&path).map_err(|e| CliError::msg(e.to_string()))?;
        let sums = FileSums::of(&tensor_parts(&bytes, &path)?);
        let clouds = sums.templates + sums.own + sums.background + sums.offsets;
        let others = sums.instances + sums.template_ranges + sums.levels + sums.pages;
        assert_eq!(clouds + others + sums.foreign + sums.header, bytes.len() as u64);
        assert_eq!(sums.foreign, 11);
        assert!(sums.pages > 0);
        Ok(())
    }
}
