//! Writing `.spz` version 4, and what the format cannot hold.
//!
//! Axes are right-up-back, without extensions. Positions have as many fractional bits as their reach leaves of 24, at
//! most 23. Streams are compressed by zstd at level 12, as by the reference implementation.

use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;

use crate::atomic_write;
use crate::error::IoError;
use crate::plausible::check_written;
use crate::spz::{FLAG_ANTIALIAS, HEADER_BYTES_V4};
use crate::spz_codec;
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE};

/// Version that is written.
const VERSION: u32 = 4;
/// zstd level: that of the reference implementation.
const LEVEL: i32 = 12;
/// Most fractional bits of positions: of 24 bits one is the sign.
const MOST_FRACTIONAL_BITS: u32 = 23;
/// Largest magnitude of a position in units of its last bit.
const LARGEST_FIXED: f64 = 8_388_607.0;
/// The smallest and the largest log scale of the format.
const LOG_SCALES: [f64; 2] = [-10.0, 5.9375];
/// Half a step of log scales.
const HALF_LOG_STEP: f64 = 1.0 / 32.0;
/// A side below the smallest scale matters only in Gaussians whose largest side is less than 10 times the smallest scale; as a
/// logarithm.
const THIN_LOG: f64 = std::f64::consts::LN_10;
/// The largest magnitude of SH 0, with half a step: a byte of 0.5 + 0.15 c.
const LARGEST_SH_0: f64 = (255.5 / 255.0 - 0.5) / spz_codec::COLOUR_SCALE;

/// What became of Gaussians for which the format has no value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clamped {
    /// Number of Gaussians.
    pub gaussians: usize,
    /// The largest change of a value.
    pub farthest: f64,
}

impl Clamped {
    /// Counts a Gaussian whose values were changed by up to `change`, if that is more than 0.
    pub(crate) fn count(&mut self, change: f64) {
        if change > 0.0 {
            self.gaussians += 1;
            self.farthest = self.farthest.max(change);
        }
    }

    /// Counts a Gaussian that was moved, if that is by more than its own size. `largest` is its largest log scale.
    pub(crate) fn count_moved(&mut self, moved: f64, largest: f64) {
        self.count(if moved > largest.exp() { moved } else { 0.0 });
    }
}

/// Gaussians that an `.spz` file holds with other values than they have, beyond the steps of the format.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SpzLoss {
    /// Moved by rounding by more than their own size, scene units: the reach of the scene leaves no finer steps.
    pub positions: Clamped,
    /// Log scales outside -10..5.94. Thin sides of Gaussians more than 10 times as large as the smallest scale do not count:
    /// they stay thin.
    pub scales: Clamped,
    /// SH coefficients 0 beyond +-3.3.
    pub colours: Clamped,
    /// Higher SH coefficients beyond +-1.
    pub sh: Clamped,
}

impl SpzLoss {
    /// True if any Gaussian lost something.
    pub fn any(&self) -> bool {
        [self.positions, self.scales, self.colours, self.sh].iter().any(|clamped| clamped.gaussians > 0)
    }

    /// The loss of a cloud whose positions get that many fractional bits.
    fn of(cloud: &Gaussians, fractional_bits: u32) -> Self {
        let unit = f64::from(fractional_bits).exp2();
        let mut loss = Self::default();
        for i in 0..cloud.len() {
            let log_scales = cloud.log_scales[i].map(f64::from);
            let largest = log_scales.iter().fold(f64::NEG_INFINITY, |m, &s| m.max(s));
            let moved = cloud.means[i].map(f64::from).map(|v| (v * unit).round() / unit - v);
            let moved = DVec3::from(moved).length();
            loss.positions.count_moved(moved, largest);
            loss.scales.count(scale_change(log_scales, largest));
            let [dc, rest @ ..] = cloud.sh_of(i) else { continue };
            loss.colours.count(beyond(dc, LARGEST_SH_0));
            loss.sh.count(beyond(rest.as_flattened(), 1.0));
        }
        loss
    }
}

/// The largest change of a log scale, 0 if none matters.
fn scale_change(log_scales: [f64; 3], largest: f64) -> f64 {
    let [low, high] = LOG_SCALES;
    let too_large = largest - high;
    let smallest = log_scales.iter().fold(f64::INFINITY, |m, &s| m.min(s));
    let too_small = if largest < low + THIN_LOG { low - smallest } else { 0.0 };
    let change = too_large.max(too_small);
    if change > HALF_LOG_STEP { change } else { 0.0 }
}

/// By how much the largest magnitude exceeds the limit.
fn beyond(values: &[f32], limit: f64) -> f64 {
    values.iter().fold(0.0, |most: f64, &v| most.max(f64::from(v).abs() - limit))
}

/// Writes a version 4 file; returns what the format could not hold.
///
/// # Errors
/// A value is not finite, a position is beyond +-8.4e6 units, or the file cannot be written.
pub fn write_spz(path: &Path, cloud: &Gaussians, antialias: bool) -> Result<SpzLoss, IoError> {
    let bytes = spz_bytes(cloud, antialias, path)?;
    atomic_write(path, |out| out.write_all(&bytes))?;
    Ok(SpzLoss::of(cloud, fractional_bits(cloud, path)?))
}

/// The bytes that [`write_spz`] writes.
pub fn spz_bytes(cloud: &Gaussians, antialias: bool, path: &Path) -> Result<Vec<u8>, IoError> {
    if let Some(i) = (0..cloud.len()).find(|&i| !cloud.is_finite(i)) {
        return Err(IoError::new(path, format!("cannot write: Gaussian {i} has a value that is not finite")));
    }
    let splats = u32::try_from(cloud.len()).map_err(|_| IoError::new(path, "cannot write: more than 2^32 splats"))?;
    let bits = fractional_bits(cloud, path)?;
    let arrays = spz_codec::encode(cloud, bits);
    let pack = |array: &Vec<u8>| zstd::bulk::compress(array, LEVEL).map(|packed| (array.len() as u64, packed));
    let streams: std::io::Result<Vec<(u64, Vec<u8>)>> =
        arrays.par_iter().filter(|array| !array.is_empty()).map(pack).collect();
    let streams = streams.map_err(|e| IoError::os(path, "cannot write", &e))?;

    let degree = cloud.sh_degree.min(MAX_SH_DEGREE) as u8;
    let mut out = b"NGSP".to_vec();
    out.extend_from_slice(&VERSION.to_le_bytes());
    out.extend_from_slice(&splats.to_le_bytes());
    out.extend_from_slice(&[degree, bits as u8, u8::from(antialias) * FLAG_ANTIALIAS, streams.len() as u8]);
    // The table of contents follows the header.
    out.extend_from_slice(&(HEADER_BYTES_V4 as u32).to_le_bytes());
    out.resize(HEADER_BYTES_V4, 0);
    for (plain_bytes, packed) in &streams {
        out.extend_from_slice(&(packed.len() as u64).to_le_bytes());
        out.extend_from_slice(&plain_bytes.to_le_bytes());
    }
    streams.iter().for_each(|(_, packed)| out.extend_from_slice(packed));
    check_written(cloud.len(), out.len(), path)?;
    Ok(out)
}

/// The fractional bits of positions, as many as their reach allows.
fn fractional_bits(cloud: &Gaussians, path: &Path) -> Result<u32, IoError> {
    let reach = cloud.means.iter().flatten().fold(0.0f64, |m, &v| m.max(f64::from(v).abs()));
    let bits = (0..=MOST_FRACTIONAL_BITS).rev().find(|&b| reach * f64::from(b).exp2() < LARGEST_FIXED);
    bits.ok_or_else(|| {
        let what = format!("cannot write: a position of {reach:.3e} units is beyond SPZ's 24-bit range of 8.4e6");
        IoError::new(path, what).advise("scale the scene down")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spz::{SpzCloud, parse_spz};
    use instgs_samples::sample;

    fn parse(bytes: &[u8]) -> Result<SpzCloud, IoError> {
        parse_spz(bytes, Path::new("test.spz"))
    }

    fn normalised(q: [f32; 4]) -> [f64; 4] {
        let n = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        q.map(|v| f64::from(v) / n)
    }

    #[test]
    fn what_is_written_is_read_within_the_quantisation() -> Result<(), IoError> {
        for degree in 0..=3 {
            let cloud = sample(degree, 300);
            let bytes = spz_bytes(&cloud, degree == 2, Path::new("x.spz"))?;
            assert_eq!(bytes, spz_bytes(&cloud, degree == 2, Path::new("x.spz"))?, "the same bytes each time");
            assert_eq!((&bytes[..8], bytes[15]), (&b"NGSP\x04\0\0\0"[..], if degree > 0 { 6 } else { 5 }));
            let back = parse(&bytes)?;
            assert_eq!((back.antialias, back.notes.len()), (degree == 2, 0));
            let back = back.gaussians;
            assert_eq!((back.len(), back.sh_degree), (300, degree));
            for i in 0..300 {
                let near = |a: &[f32], b: &[f32], tolerance: f32, what: &str| {
                    for (x, y) in a.iter().zip(b) {
                        assert!((x - y).abs() <= tolerance, "{what} of {i}: {x} {y}");
                    }
                };
                // Up to 4.8 units: three bits before the point, 20 behind it.
                near(&back.means[i], &cloud.means[i], 0.5 / 1_048_576.0 + 1e-9, "mean");
                near(&back.log_scales[i], &cloud.log_scales[i], 0.5 / 16.0 + 1e-6, "scale");
                near(&back.sh_of(i)[0], &cloud.sh_of(i)[0], 0.5 / (255.0 * 0.15) + 1e-6, "dc");
                let rest = [&back, &cloud].map(|cloud| cloud.sh_of(i)[1..].as_flattened());
                near(rest[0], rest[1], 8.0 / 128.0 + 0.5 / 128.0 + 1e-6, "sh");
                let (a, b) = (normalised(back.quats[i]), normalised(cloud.quats[i]));
                assert!(a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>().abs() > 1.0 - 1e-5, "quat of {i}");
                let sigmoid = |l: f32| 1.0 / (1.0 + (-l).exp());
                assert!((sigmoid(back.opacity_logits[i]) - sigmoid(cloud.opacity_logits[i])).abs() < 0.51 / 255.0);
            }
        }
        Ok(())
    }

    #[test]
    fn an_empty_cloud_and_large_positions() -> Result<(), IoError> {
        let path = Path::new("x.spz");
        assert!(parse(&spz_bytes(&Gaussians::default(), false, path)?)?.gaussians.is_empty());
        let mut cloud = sample(0, 2);
        cloud.means[1] = [100_000.0, -5.0, 3.0];
        assert!((parse(&spz_bytes(&cloud, false, path)?)?.gaussians.means[1][0] - 100_000.0).abs() < 0.02);
        cloud.means[1][0] = 1e9;
        assert!(spz_bytes(&cloud, false, path).is_err());
        cloud.means[1][0] = f32::NAN;
        assert!(spz_bytes(&cloud, false, path).is_err());
        Ok(())
    }

    /// A scene of a millimetre keeps 23 bits behind the point.
    #[test]
    fn small_scenes_keep_their_positions() -> Result<(), IoError> {
        let mut cloud = sample(0, 50);
        cloud.means.iter_mut().flatten().for_each(|v| *v *= 1e-4);
        let back = parse(&spz_bytes(&cloud, false, Path::new("x.spz"))?)?.gaussians;
        let apart = |(a, b): (&f32, &f32)| f64::from(a - b).abs();
        let worst = back.means.as_flattened().iter().zip(cloud.means.as_flattened()).map(apart).fold(0.0, f64::max);
        assert!(worst <= 0.5001 / 8_388_608.0, "{worst}");
        Ok(())
    }

    #[test]
    fn what_does_not_fit_is_counted() {
        let mut cloud = sample(1, 5);
        assert!(!SpzLoss::of(&cloud, 12).any());
        cloud.log_scales[0] = [-11.0, -10.5, -10.0];
        // A flat Gaussian of usual size stays flat.
        cloud.log_scales[1] = [-87.0, -3.0, -3.0];
        cloud.log_scales[2][1] = 8.0;
        cloud.sh[0][2] = -5.0;
        (cloud.sh[4][0], cloud.sh[5][1], cloud.sh[10][0]) = (3.0, 2.0, -1.5);
        let loss = SpzLoss::of(&cloud, 12);
        let near = |clamped: Clamped, gaussians: usize, farthest: f64| {
            clamped.gaussians == gaussians && (clamped.farthest - farthest).abs() < 0.02
        };
        assert!(near(loss.scales, 2, 8.0 - 5.94), "{loss:?}");
        assert!(near(loss.colours, 1, 5.0 - 3.346), "{loss:?}");
        assert!(near(loss.sh, 2, 1.0), "{loss:?}");
        // The first Gaussian is smaller than the steps of positions, 1/4096.
        assert!(loss.any() && loss.positions.gaussians == 1, "{loss:?}");
        // Steps of a half move Gaussians of a hundredth by more than their size.
        cloud.log_scales = vec![[-4.6; 3]; 5];
        assert!(SpzLoss::of(&cloud, 1).positions.gaussians > 0);
    }
}
