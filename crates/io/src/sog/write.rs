//! Writes `.sog` files.
//!
//! Gaussians are in Morton order, so that neighbours in the images are neighbours in space. Scales, base colours and the
//! entries of the palette get a codebook each. Images of values without alpha have three channels. The archive's entries are
//! stored, since WebP is compressed. The same cloud gives the same bytes.

use std::path::Path;

use glam::{DVec3, Vec3};

use super::archive;
use super::codebook::Codebook;
use super::image::{Image, MAX_SIDE};
use super::meta::{Coded, META, Means, Meta, Palette, Plain};
use super::palette::{Rows, palette};
use super::read::{ENTRIES_PER_ROW, FIRST_TAG, position_of};
use crate::atomic_write;
use crate::error::IoError;
use crate::plausible::check_written;
use crate::spz::Clamped;
use instgs_vk::math::covariance::{normalised_quat, sigmoid};
use instgs_vk::math::morton::morton_order;
use instgs_vk::scene::Gaussians;

/// Sides of images are multiples of that, as in other programs' files.
const SIDE_STEP: usize = 4;
/// The smallest size of a palette, and how often it is doubled at most: up to 65536 entries.
const LEAST_ENTRIES: usize = 1024;
const MOST_DOUBLINGS: u32 = 6;

/// What was written as `.sog`, into one file or several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WrittenSog {
    /// Number of Gaussians.
    pub gaussians: u64,
    /// Length of the files, bytes.
    pub bytes: u64,
    /// Gaussians that rounding moved by more than their own size, scene units.
    pub moved: Clamped,
}

/// Writes a `.sog` file; `antialias` says whether opacities are compensated.
///
/// # Errors
/// The cloud is empty, has a value that is not finite or more Gaussians than an image has pixels, or the file cannot be
/// written.
pub fn write_sog(path: &Path, cloud: &Gaussians, antialias: bool) -> Result<WrittenSog, IoError> {
    let bytes = sog_bytes(cloud, antialias, path)?;
    atomic_write(path, |out| out.write_all(&bytes))?;
    Ok(WrittenSog { gaussians: cloud.len() as u64, bytes: bytes.len() as u64, moved: moved(cloud) })
}

/// The Gaussians of a finite cloud that a file holds elsewhere, by more than their own size.
fn moved(cloud: &Gaussians) -> Clamped {
    let steps = PositionSteps::of(&cloud.means);
    let mut out = Clamped::default();
    for (mean, log_scales) in cloud.means.iter().zip(&cloud.log_scales) {
        let held = position_of(steps.codes(*mean), &steps.mins, &steps.maxs);
        let moved = (DVec3::from(held) - Vec3::from(*mean).as_dvec3()).length();
        out.count_moved(moved, log_scales.iter().fold(f64::NEG_INFINITY, |m, &s| m.max(s.into())));
    }
    out
}

/// The steps that positions are rounded to: even ones of their logarithms, by axis.
struct PositionSteps {
    mins: [f64; 3],
    maxs: [f64; 3],
}

impl PositionSteps {
    fn of(means: &[[f32; 3]]) -> Self {
        let (mut mins, mut maxs) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for mean in means {
            for (k, &v) in mean.iter().enumerate() {
                (mins[k], maxs[k]) = (mins[k].min(log_of(v)), maxs[k].max(log_of(v)));
            }
        }
        Self { mins, maxs }
    }

    fn codes(&self, mean: [f32; 3]) -> [u16; 3] {
        std::array::from_fn(|k| {
            let along = (log_of(mean[k]) - self.mins[k]) / (self.maxs[k] - self.mins[k]).max(f64::MIN_POSITIVE);
            (along * 65535.0).round().clamp(0.0, 65535.0) as u16
        })
    }
}

/// The bytes that [`write_sog`] writes.
pub fn sog_bytes(cloud: &Gaussians, antialias: bool, path: &Path) -> Result<Vec<u8>, IoError> {
    if cloud.is_empty() {
        return Err(IoError::new(path, "cannot write: .sog has no empty clouds").advise("use .ply or .instgs"));
    }
    if let Some(i) = (0..cloud.len()).find(|&i| !cloud.is_finite(i)) {
        return Err(IoError::new(path, format!("cannot write: Gaussian {i} has a value that is not finite")));
    }
    let writer = Writer::new(cloud, path)?;
    let (means, low, high) = writer.means();
    let (scales, scale_image) = writer.scales();
    let (sh0, sh0_image) = writer.base_colours();
    let quats = Plain { files: ["quats.webp".to_owned()] };
    let mut meta = Meta::new(cloud.len() as u32, antialias, means, scales, quats, sh0);
    let mut images = vec![
        ("means_l.webp", low),
        ("means_u.webp", high),
        ("scales.webp", scale_image),
        ("quats.webp", writer.quats()),
        ("sh0.webp", sh0_image),
    ];
    if cloud.sh_degree > 0 {
        let (palette, entries, labels) = writer.rest();
        meta.sh_rest = Some(palette);
        images.extend([("shN_centroids.webp", entries), ("shN_labels.webp", labels)]);
    }
    let json = serde_json::to_vec(&meta).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    let mut files = vec![(META, json)];
    for (name, image) in images {
        files.push((name, image.encode(path)?));
    }
    let bytes = archive::stored(&files).ok_or_else(|| {
        IoError::new(path, "cannot write: more than the 4 GiB that an archive can hold").advise("keep it as .instgs")
    })?;
    check_written(cloud.len(), bytes.len(), path)?;
    Ok(bytes)
}

/// Logarithm of a coordinate with its sign, which positions are stored by.
fn log_of(coordinate: f32) -> f64 {
    let v = f64::from(coordinate);
    v.signum() * v.abs().ln_1p()
}

/// Number of palette entries for that many Gaussians: 1024 times a power of two, as in splat-transform.
fn palette_size(gaussians: usize) -> usize {
    let doublings = (gaussians / LEAST_ENTRIES).max(1).ilog2().min(MOST_DOUBLINGS);
    (LEAST_ENTRIES << doublings).min(gaussians)
}

/// A cloud that becomes images.
struct Writer<'a> {
    cloud: &'a Gaussians,
    /// The Gaussians in the order of pixels.
    order: Vec<usize>,
    width: usize,
    height: usize,
}

impl<'a> Writer<'a> {
    fn new(cloud: &'a Gaussians, path: &Path) -> Result<Self, IoError> {
        let count = cloud.len();
        let width = ((count as f64).sqrt().ceil() as usize).next_multiple_of(SIDE_STEP);
        let height = count.div_ceil(width).next_multiple_of(SIDE_STEP);
        if width.max(height) > MAX_SIDE || u32::try_from(count).is_err() {
            let what = format!("cannot write: {count} Gaussians are more than the pixels of an image");
            return Err(IoError::new(path, what).advise("keep it as .instgs"));
        }
        let order = morton_order(&cloud.means).into_iter().map(|i| i as usize).collect();
        Ok(Self { cloud, order, width, height })
    }

    /// An image with a pixel for every Gaussian.
    fn image(&self, has_alpha: bool, pixel: impl Fn(usize) -> [u8; 4]) -> Image {
        let mut image = Image::zeros(self.width, self.height, has_alpha);
        self.order.iter().enumerate().for_each(|(place, &i)| image.set(place, pixel(i)));
        image
    }

    /// Ranges of positions, and their images of low and high bytes.
    fn means(&self) -> (Means, Image, Image) {
        let steps = PositionSteps::of(&self.cloud.means);
        let byte = |which: usize| {
            self.image(false, |i| {
                let [x, y, z] = steps.codes(self.cloud.means[i]).map(u16::to_le_bytes);
                [x[which], y[which], z[which], 255]
            })
        };
        let files = ["means_l.webp", "means_u.webp"].map(str::to_owned);
        (Means { mins: steps.mins, maxs: steps.maxs, files }, byte(0), byte(1))
    }

    fn scales(&self) -> (Coded, Image) {
        let log_scales = &self.cloud.log_scales;
        let codebook = Codebook::of(log_scales.as_flattened());
        let image = self.image(false, |i| {
            let [x, y, z] = log_scales[i].map(|s| codebook.index(s));
            [x, y, z, 255]
        });
        (Coded::new(codebook.values(), "scales.webp"), image)
    }

    /// Codebook of SH coefficients 0, and the image of their indices and the opacities.
    fn base_colours(&self) -> (Coded, Image) {
        let cloud = self.cloud;
        let values: Vec<f32> = (0..cloud.len()).flat_map(|i| cloud.sh_of(i)[0]).collect();
        let codebook = Codebook::of(&values);
        let image = self.image(true, |i| {
            let [r, g, b] = cloud.sh_of(i)[0].map(|v| codebook.index(v));
            let opacity = sigmoid(f64::from(cloud.opacity_logits[i]));
            [r, g, b, (255.0 * opacity).round() as u8]
        });
        (Coded::new(codebook.values(), "sh0.webp"), image)
    }

    fn quats(&self) -> Image {
        self.image(true, |i| {
            let quat = normalised_quat(self.cloud.quats[i].map(f64::from));
            let largest = (1..4).fold(0, |best, k| if quat[k].abs() > quat[best].abs() { k } else { best });
            let scale = quat[largest].signum() * std::f64::consts::SQRT_2 * 127.5;
            let mut others = (0..4).filter(|&k| k != largest).map(|k| (quat[k] * scale + 127.5).round() as u8);
            let mut other = || others.next().unwrap_or(0);
            [other(), other(), other(), FIRST_TAG + largest as u8]
        })
    }

    /// The palette of SH coefficients above 0, the image of its entries and that of labels.
    fn rest(&self) -> (Palette, Image, Image) {
        let cloud = self.cloud;
        let per_entry = cloud.sh_coefficients() - 1;
        let mut rows = Rows::new(3 * per_entry);
        self.order.iter().for_each(|&i| rows.push(cloud.sh_of(i)[1..].as_flattened()));
        let palette = palette(&rows, palette_size(cloud.len()));
        let count = palette.entries.len();
        let entry = |k: usize| &palette.entries.row(k)[..3 * per_entry];
        let codebook = Codebook::of(&(0..count).flat_map(entry).copied().collect::<Vec<f32>>());

        let mut entries = Image::zeros(ENTRIES_PER_ROW * per_entry, count.div_ceil(ENTRIES_PER_ROW), false);
        for k in 0..count {
            for (c, rgb) in entry(k).as_chunks::<3>().0.iter().enumerate() {
                let [r, g, b] = rgb.map(|v| codebook.index(v));
                entries.set(k * per_entry + c, [r, g, b, 255]);
            }
        }
        let mut labels = Image::zeros(self.width, self.height, false);
        for (place, label) in palette.labels.iter().enumerate() {
            let [low, high] = label.to_le_bytes();
            labels.set(place, [low, high, 0, 255]);
        }
        let files = ["shN_centroids.webp", "shN_labels.webp"];
        (Palette::new(count, cloud.sh_degree, codebook.values(), files), entries, labels)
    }
}
