//! Reads `.sog` files and folders.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::path::Path;

use super::SogCloud;
use super::archive::Archive;
use super::image::Image;
use super::meta::{META, Means, Meta, Palette};
use crate::error::{IoError, Place};
use crate::host_memory::{available_bytes, check_reading, gaussian_bytes};
use crate::plausible::{AS_PLY, most_gaussians};
use crate::{logit_of_byte, read_bytes};
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE, sh_coefficients};

/// Most pixels per Gaussian, and beyond that: images are little larger than what they hold, but sides may be powers of two.
const MAX_PIXELS_PER_GAUSSIAN: u64 = 4;
const MAX_SPARE_PIXELS: u64 = 1 << 14;
/// Entries that labels of 16 bits can name.
const MAX_ENTRIES: u64 = 1 << 16;
/// Entries in a row of the palette's image.
pub(super) const ENTRIES_PER_ROW: usize = 64;
/// Alpha of a rotation whose largest component is w.
pub(super) const FIRST_TAG: u8 = 252;

/// True for a `meta.json`, and for a folder that has one: a `.sog` that is not packed.
pub fn is_unpacked(path: &Path) -> bool {
    path.file_name() == Some(OsStr::new(META)) || (path.is_dir() && path.join(META).is_file())
}

/// Reads a `.sog` file, the folder of one that is not packed, or that folder's `meta.json`.
///
/// # Errors
/// A file cannot be read, is damaged, or of another version.
pub fn read_sog(path: &Path) -> Result<SogCloud, IoError> {
    if !is_unpacked(path) {
        return parse_sog(&read_bytes(path)?, path);
    }
    let meta_path = if path.is_dir() { path.join(META) } else { path.to_owned() };
    let folder = meta_path.parent().unwrap_or(Path::new(""));
    let meta_bytes = read_bytes(&meta_path)?;
    let meta = Meta::parse(&meta_bytes, &meta_path)?;
    let file = |name: &str| -> Result<Cow<'_, [u8]>, IoError> {
        let is_plain = Path::new(name).file_name() == Some(OsStr::new(name));
        let outside = || {
            IoError::new(&meta_path, format!("names the file \"{name}\", which is not in its folder"))
                .advise("write names of files without folders there")
        };
        if is_plain { read_bytes(&folder.join(name)).map(Cow::Owned) } else { Err(outside()) }
    };
    let lengths = meta.files().map(|name| std::fs::metadata(folder.join(name)).map_or(0, |m| m.len()));
    let file_bytes = meta_bytes.len() as u64 + lengths.sum::<u64>();
    Reader { meta: &meta, file: &file, file_bytes, path: &meta_path }.cloud()
}

/// Parses the bytes of a `.sog` file; `path` is only used in messages.
pub fn parse_sog(bytes: &[u8], path: &Path) -> Result<SogCloud, IoError> {
    let archive = Archive::parse(bytes, path)?;
    let meta = Meta::parse(&archive.file(META)?, path)?;
    Reader { meta: &meta, file: &|name| archive.file(name), file_bytes: bytes.len() as u64, path }.cloud()
}

/// True for a packed file that this program wrote.
pub(super) fn is_own(path: &Path) -> bool {
    let meta = || {
        let bytes = read_bytes(path)?;
        Meta::parse(&Archive::parse(&bytes, path)?.file(META)?, path)
    };
    meta().is_ok_and(|meta| meta.is_own())
}

/// Returns the contents of a file by its name.
type FileByName<'b> = dyn Fn(&str) -> Result<Cow<'b, [u8]>, IoError> + 'b;

/// Decodes the images that a `meta.json` names.
struct Reader<'a, 'b> {
    meta: &'a Meta,
    /// The contents of a file by name.
    file: &'a FileByName<'b>,
    file_bytes: u64,
    path: &'a Path,
}

impl Reader<'_, '_> {
    fn cloud(&self) -> Result<SogCloud, IoError> {
        let meta = self.meta;
        let count = meta.count as usize;
        if u64::from(meta.count) > self.most_pixels() {
            let what = format!("claims {count} Gaussians in {} bytes, more than is plausible", self.file_bytes);
            return Err(IoError::new(self.path, what).at(Place::Field("count".into())).advise(AS_PLY));
        }
        let palette = meta.sh_rest.as_ref().filter(|palette| palette.bands > 0);
        let sh_degree = palette.map_or(0, |palette| palette.bands);
        if sh_degree > MAX_SH_DEGREE {
            return Err(self.fail(format!("SH degree {sh_degree} is not known, only 0 to 3"), "shN.bands"));
        }
        self.check_memory(sh_degree)?;
        // Grows with the images: they are checked first.
        let mut out = Gaussians { sh_degree, ..Gaussians::default() };
        out.means = self.means(&meta.means)?;
        out.quats = self.quats()?;
        let ([scales], scale_values) = (&meta.scales.files, meta.scales.values("scales", self.path)?);
        let image = self.image(scales)?;
        let log_scales = (0..count).map(|i| {
            let [x, y, z, _] = image.pixel(i);
            self.coded([x, y, z], &scale_values, "scales")
        });
        out.log_scales = log_scales.collect::<Result<_, IoError>>()?;
        let ([sh0], dc_values) = (&meta.sh0.files, meta.sh0.values("sh0", self.path)?);
        let image = self.image(sh0)?;
        let rest = palette.map(|palette| self.rest(palette)).transpose()?;
        out.sh.reserve_exact(count * sh_coefficients(sh_degree));
        for i in 0..count {
            let [r, g, b, alpha] = image.pixel(i);
            out.sh.push(self.coded([r, g, b], &dc_values, "sh0")?);
            if let Some(rest) = &rest {
                out.sh.extend_from_slice(rest.of(i, self)?);
            }
            out.opacity_logits.push(logit_of_byte(alpha));
        }
        Ok(SogCloud { gaussians: out, antialias: meta.is_compensated(), file_bytes: self.file_bytes })
    }

    fn fail(&self, what: String, field: &str) -> IoError {
        IoError::new(self.path, what).at(Place::Field(field.to_owned()))
    }

    /// Decodes an image that needs so many pixels.
    fn decoded(&self, name: &str, needed: u64) -> Result<Image, IoError> {
        // Few bytes can claim far more pixels than the Gaussians need.
        let most = self.most_pixels().min(MAX_PIXELS_PER_GAUSSIAN * needed + MAX_SPARE_PIXELS);
        Image::decode(&(self.file)(name)?, most, name, self.path)
    }

    /// The most pixels that are plausible in an image of the file: most have one for each Gaussian.
    fn most_pixels(&self) -> u64 {
        most_gaussians(self.file_bytes)
    }

    /// Checks memory for the cloud and its images, if the available one is known.
    fn check_memory(&self, sh_degree: u32) -> Result<(), IoError> {
        // With four images of four bytes a pixel.
        let bytes_each = gaussian_bytes(sh_degree) + 4 * 4;
        check_reading(self.path, "takes", u64::from(self.meta.count) * bytes_each, available_bytes())
    }

    /// An image with a pixel for every Gaussian.
    fn image(&self, name: &str) -> Result<Image, IoError> {
        let image = self.decoded(name, self.meta.count.into())?;
        if image.pixels() < self.meta.count as usize {
            let (width, height, count) = (image.width, image.height, self.meta.count);
            return Err(self.fail(format!("has {width}x{height} pixels, fewer than {count} Gaussians"), name));
        }
        Ok(image)
    }

    fn means(&self, means: &Means) -> Result<Vec<[f32; 3]>, IoError> {
        let [low, high] = &means.files;
        let (low, high) = (self.image(low)?, self.image(high)?);
        let mean = |i: usize| {
            let (low, high) = (low.pixel(i), high.pixel(i));
            let codes = std::array::from_fn(|k| u16::from_le_bytes([low[k], high[k]]));
            position_of(codes, &means.mins, &means.maxs).map(|v| v as f32)
        };
        Ok((0..self.meta.count as usize).map(mean).collect())
    }

    fn quats(&self) -> Result<Vec<[f32; 4]>, IoError> {
        let [name] = &self.meta.quats.files;
        let image = self.image(name)?;
        let quat = |i: usize| -> Result<[f32; 4], IoError> {
            let [r, g, b, tag] = image.pixel(i);
            let largest = tag.checked_sub(FIRST_TAG).map(usize::from);
            let largest =
                largest.ok_or_else(|| self.fail(format!("pixel {i} has the alpha {tag}, no rotation"), name))?;
            let others = [r, g, b].map(|byte| (f64::from(byte) / 127.5 - 1.0) * std::f64::consts::FRAC_1_SQRT_2);
            let squares: f64 = others.iter().map(|v| v * v).sum();
            let mut others = others.into_iter();
            let component = |k: usize| if k == largest { None } else { others.next() };
            let known: [Option<f64>; 4] = std::array::from_fn(component);
            Ok(known.map(|v| v.unwrap_or((1.0 - squares).max(0.0).sqrt()) as f32))
        };
        (0..self.meta.count as usize).map(quat).collect()
    }

    /// The values of a codebook at the given indices.
    fn coded(&self, indices: [u8; 3], codebook: &[f32], field: &str) -> Result<[f32; 3], IoError> {
        let [r, g, b] = indices.map(|i| codebook.get(usize::from(i)).copied());
        match (r, g, b) {
            (Some(r), Some(g), Some(b)) => Ok([r, g, b]),
            _ => {
                let most = indices.into_iter().max().unwrap_or(0);
                let what = format!("has {} values, but an image has index {most}", codebook.len());
                Err(self.fail(what, &format!("{field}.codebook")))
            }
        }
    }

    /// The palette, and the image of labels.
    fn rest(&self, palette: &Palette) -> Result<Rest, IoError> {
        let [entries, labels] = &palette.files;
        let per_entry = sh_coefficients(palette.bands) - 1;
        let image = self.decoded(entries, MAX_ENTRIES * per_entry as u64)?;
        if image.width != ENTRIES_PER_ROW * per_entry {
            let what = format!("is {} pixels wide, not {}", image.width, ENTRIES_PER_ROW * per_entry);
            return Err(self.fail(what, entries));
        }
        let codebook = palette.values(self.path)?;
        let count = (palette.count as usize).min(ENTRIES_PER_ROW * image.height);
        let value = |i: usize| {
            let [r, g, b, _] = image.pixel(i);
            self.coded([r, g, b], &codebook, "shN")
        };
        let values = (0..count * per_entry).map(value).collect::<Result<_, IoError>>()?;
        Ok(Rest { values, per_entry, labels: self.image(labels)? })
    }
}

/// SH coefficients above 0.
struct Rest {
    /// Those of all entries.
    values: Vec<[f32; 3]>,
    per_entry: usize,
    labels: Image,
}

impl Rest {
    /// The coefficients of a Gaussian.
    fn of(&self, i: usize, reader: &Reader<'_, '_>) -> Result<&[[f32; 3]], IoError> {
        let [low, high, _, _] = self.labels.pixel(i);
        let entry = usize::from(u16::from_le_bytes([low, high]));
        self.values.get(entry * self.per_entry..(entry + 1) * self.per_entry).ok_or_else(|| {
            let count = self.values.len() / self.per_entry;
            reader.fail(format!("Gaussian {i} has entry {entry}, but there are {count}"), "shN.files")
        })
    }
}

/// The position that its three numbers stand for, between the ends of the logarithms' ranges.
pub(super) fn position_of(codes: [u16; 3], mins: &[f64; 3], maxs: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let n = mins[k] + (maxs[k] - mins[k]) * (f64::from(codes[k]) / 65535.0);
        n.signum() * n.abs().exp_m1()
    })
}
