//! `meta.json` of `.sog` files.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{IoError, Place};

/// Name of the file.
pub(super) const META: &str = "meta.json";
/// The version that is read and written.
const VERSION: u64 = 2;
/// Most entries of a codebook: indices are bytes.
pub(super) const CODEBOOK_LEN: usize = 256;
/// First word of the generator of files of this program.
const GENERATOR: &str = "instgs-vk";
/// Name of the splat model that compensates opacities, in files of splat-transform from 3.2 on.
const ANTIALIASED: &str = "antialiased";

/// The whole file. Unknown fields are ignored, as the format asks.
#[derive(Deserialize, Serialize)]
pub(super) struct Meta {
    pub(super) version: u32,
    #[serde(default)]
    pub(super) asset: Asset,
    /// Number of Gaussians.
    pub(super) count: u32,
    /// The flag of opacity compensation in the format's specification.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) antialias: bool,
    /// How the cloud was trained: `default`, `antialiased` or `2dgs`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<String>,
    pub(super) means: Means,
    pub(super) scales: Coded,
    pub(super) quats: Plain,
    pub(super) sh0: Coded,
    #[serde(rename = "shN", default, skip_serializing_if = "Option::is_none")]
    pub(super) sh_rest: Option<Palette>,
}

/// The program that wrote the file.
#[derive(Default, Deserialize, Serialize)]
pub(super) struct Asset {
    #[serde(default)]
    pub(super) generator: String,
}

/// Positions: the range of their logarithms by axis, images of the low and of the high bytes.
#[derive(Deserialize, Serialize)]
pub(super) struct Means {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    pub(super) files: [String; 2],
}

/// An image of indices into a codebook.
#[derive(Deserialize, Serialize)]
pub(super) struct Coded {
    codebook: Vec<Option<f32>>,
    pub(super) files: [String; 1],
}

/// An image of values.
#[derive(Deserialize, Serialize)]
pub(super) struct Plain {
    pub(super) files: [String; 1],
}

/// Entries of SH coefficients above 0, and which one each Gaussian has.
#[derive(Deserialize, Serialize)]
pub(super) struct Palette {
    /// Number of entries.
    pub(super) count: u32,
    /// The SH degree.
    pub(super) bands: u32,
    codebook: Vec<Option<f32>>,
    /// The image of entries and that of labels.
    pub(super) files: [String; 2],
}

impl Coded {
    pub(super) fn new(codebook: &[f32], file: &str) -> Self {
        Self { codebook: codebook.iter().copied().map(Some).collect(), files: [file.to_owned()] }
    }

    /// The values of the codebook of the given field.
    pub(super) fn values(&self, field: &str, path: &Path) -> Result<Vec<f32>, IoError> {
        values(&self.codebook, field, path)
    }
}

impl Palette {
    pub(super) fn new(count: usize, bands: u32, codebook: &[f32], files: [&str; 2]) -> Self {
        let codebook = codebook.iter().copied().map(Some).collect();
        Self { count: count as u32, bands, codebook, files: files.map(str::to_owned) }
    }

    /// The values of the codebook.
    pub(super) fn values(&self, path: &Path) -> Result<Vec<f32>, IoError> {
        values(&self.codebook, "shN", path)
    }
}

/// The values of a codebook. Files exist whose first one is missing (null); readers of the format agree on its value.
fn values(codebook: &[Option<f32>], field: &str, path: &Path) -> Result<Vec<f32>, IoError> {
    let fail = |what: String| IoError::new(path, what).at(Place::Field(format!("{field}.codebook")));
    if codebook.len() > CODEBOOK_LEN {
        return Err(fail(format!("has {} values, more than {CODEBOOK_LEN}", codebook.len())));
    }
    let first = match codebook {
        [None, Some(second), .., Some(last)] => Some(second + (second - last) / 255.0),
        _ => None,
    };
    let value = |(i, value): (usize, &Option<f32>)| {
        let known = value.or(if i == 0 { first } else { None });
        known.ok_or_else(|| fail(format!("value {i} is missing")))
    };
    codebook.iter().enumerate().map(value).collect()
}

impl Meta {
    /// The file of a cloud.
    pub(super) fn new(count: u32, antialias: bool, means: Means, scales: Coded, quats: Plain, sh0: Coded) -> Self {
        Self {
            version: VERSION as u32,
            asset: Asset { generator: format!("{GENERATOR} {}", env!("CARGO_PKG_VERSION")) },
            count,
            antialias,
            model: antialias.then(|| ANTIALIASED.to_owned()),
            means,
            scales,
            quats,
            sh0,
            sh_rest: None,
        }
    }

    /// Parses the file; `path` is only used in messages.
    ///
    /// # Errors
    /// It is no JSON, of another version, or a field is missing or of another type.
    pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Self, IoError> {
        let fail = |what: String, field: &str| IoError::new(path, what).at(Place::Field(field.to_owned()));
        let invalid = |e: serde_json::Error| fail(format!("cannot be used: {e}"), META);
        let value: serde_json::Value = serde_json::from_slice(bytes).map_err(invalid)?;
        match value.get("version") {
            None if value.get("means").is_some() => {
                let error = fail("has no version: this is SOG version 1, only 2 is read".into(), META);
                return Err(error.advise("convert it with splat-transform"));
            }
            Some(version) if version.as_u64() != Some(VERSION) => {
                return Err(fail(format!("SOG version {version} is not known, only {VERSION}"), "version"));
            }
            _ => {}
        }
        serde_json::from_value(value).map_err(invalid)
    }

    /// Whether opacities are compensated for small Gaussians.
    pub(super) fn is_compensated(&self) -> bool {
        self.antialias || self.model.as_deref() == Some(ANTIALIASED)
    }

    /// Whether this program wrote the file.
    pub(super) fn is_own(&self) -> bool {
        self.asset.generator.split(' ').next() == Some(GENERATOR)
    }

    /// All images that the file names.
    pub(super) fn files(&self) -> impl Iterator<Item = &str> {
        let single = [&self.scales.files, &self.quats.files, &self.sh0.files].into_iter().flatten();
        let rest = self.sh_rest.iter().flat_map(|palette| &palette.files);
        self.means.files.iter().chain(single).chain(rest).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coded(codebook: Vec<Option<f32>>) -> Coded {
        Coded { codebook, files: ["x".into()] }
    }

    #[test]
    fn a_missing_first_value_follows_from_the_others() -> Result<(), IoError> {
        let path = Path::new("x.sog");
        let mut codebook: Vec<Option<f32>> = (0..256).map(|i| Some(i as f32)).collect();
        codebook[0] = None;
        let values = coded(codebook.clone()).values("scales", path)?;
        assert!(
            (values[0] - (1.0 - 254.0 / 255.0)).abs() < 1e-6
                && values[1..].iter().zip(1..).all(|(v, i)| *v == i as f32)
        );
        codebook[7] = None;
        let text = coded(codebook).values("scales", path).unwrap_err().to_string();
        assert!(text.contains("scales.codebook: value 7 is missing"), "{text}");
        assert!(coded(vec![Some(0.0); 257]).values("scales", path).is_err());
        assert_eq!(coded(Vec::new()).values("scales", path)?, Vec::<f32>::new());
        Ok(())
    }

    #[test]
    fn other_versions_are_named() {
        let text = |json: &str| Meta::parse(json.as_bytes(), Path::new("x.sog")).err().map(|e| e.to_string());
        let has = |json: &str, part: &str| assert!(text(json).is_some_and(|t| t.contains(part)), "{:?}", text(json));
        has("{\"means\": {}}", "version 1, only 2 is read; convert it");
        has("{\"version\": 3}", "version: SOG version 3");
        has("{\"version\": 2}", "meta.json: cannot be used: missing field `count`");
        has("{", "meta.json: cannot be used");
    }
}
