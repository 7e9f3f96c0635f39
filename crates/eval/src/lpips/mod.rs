//! Learned perceptual image patch similarity, version 0.1 (Zhang, Isola, Efros, Shechtman, Wang 2018,
//! arXiv:1801.03924).
//!
//! Both pictures go through a network trained on ImageNet. After every stage, each place's features are scaled to unit
//! length over the channels; the squared differences, weighted per channel by a trained linear head, are averaged over
//! the places, and the stages' averages added up.
//!
//! The trained weights are the user's ([`weights`]). A pair of 800x450 takes alex 0.4 to 1.1 s, squeeze 0.4 to 0.8 s and
//! vgg 10 to 30 s (16 s of CPU time) on 2 cores with AVX-512 that other work shared.

#[cfg(test)]
mod fixture;
mod layers;
mod network;
pub mod weights;

use std::path::Path;

use rayon::prelude::*;

use crate::pair::PicturePair;
use crate::io::IoError;
use layers::FeatureMap;
pub use network::Net;
use network::{Stage, smallest_side};

/// Added to a feature vector's length before the division by it.
const LENGTH_EPSILON: f64 = 1e-10;
/// Mean and standard deviation per channel of the networks' training pictures, for pictures in -1..=1.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// How pictures are fed to the network. Figures of the two differ: name the one used beside a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum InputRange {
    /// Scaled to -1..=1, as LPIPS was trained: the InstGS paper's `evaluate.py`.
    #[default]
    MinusOneToOne,
    /// Left at 0..=1: what the 3DGS paper's `metrics.py` does.
    ZeroToOne,
}

/// Why LPIPS has no number. One line for the user.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LpipsError {
    /// The weights could not be read.
    #[error(transparent)]
    Weights(#[from] IoError),
    /// A picture so small that pooling leaves nothing of it.
    #[error("a picture of {width}x{height} is too small for LPIPS with {}, which needs {smallest}x{smallest}", net.name())]
    TooSmall {
        /// The network.
        net: Net,
        /// The picture's width.
        width: u32,
        /// The picture's height.
        height: u32,
        /// Smallest side.
        smallest: u32,
    },
}

/// A network with its weights, ready to compare pictures.
#[derive(Clone, Debug)]
pub struct Lpips {
    net: Net,
    range: InputRange,
    stages: Vec<Stage>,
    smallest_side: u32,
}

impl Lpips {
    /// Reads a network's weights (see [`weights`]).
    ///
    /// # Errors
    /// No such file (with the command that makes it), a file of another network, or a tensor that is missing, of another
    /// shape or type, or not finite, by name.
    pub fn load(net: Net, range: InputRange, path: &Path) -> Result<Self, LpipsError> {
        if !path.exists() {
            let command = weights::conversion_command(net, path);
            return Err(IoError::new(path, "does not exist").advise(format!("make it with: {command}")).into());
        }
        let bytes = std::fs::read(path).map_err(|e| IoError::new(path, format!("cannot read: {e}")))?;
        Ok(Self::new(net, range, weights::parse(net, &bytes, path)?))
    }

    fn new(net: Net, range: InputRange, stages: Vec<Stage>) -> Self {
        let smallest_side = smallest_side(&stages);
        Self { net, range, stages, smallest_side }
    }

    /// Which network this is.
    pub fn net(&self) -> Net {
        self.net
    }

    /// The distance of two pictures: 0 if they are equal, about 1 if they have nothing in common; no unit.
    ///
    /// # Errors
    /// A picture below the network's smallest side.
    pub fn distance(&self, pair: &PicturePair) -> Result<f64, LpipsError> {
        Ok(self.stage_distances(pair)?.iter().sum())
    }

    /// The parts of [`Lpips::distance`], one per stage: 5, or 7 for squeeze.
    ///
    /// # Errors
    /// As [`Lpips::distance`].
    pub fn stage_distances(&self, pair: &PicturePair) -> Result<Vec<f64>, LpipsError> {
        let (width, height, smallest) = (pair.width(), pair.height(), self.smallest_side);
        if width.min(height) < smallest {
            return Err(LpipsError::TooSmall { net: self.net, width, height, smallest });
        }
        let input = |pixels| network_input(pixels, (width, height), self.range);
        let (mut a, mut b) = (input(pair.render()), input(pair.target()));
        let mut distances = Vec::with_capacity(self.stages.len());
        for stage in &self.stages {
            // One after the other: a stage needs the memory, and each uses all cores.
            a = stage.apply(a);
            b = stage.apply(b);
            distances.push(mean_distance(&a, &b, &stage.head));
        }
        Ok(distances)
    }
}

/// The picture as the network's first features.
fn network_input(pixels: &[[f32; 3]], (width, height): (u32, u32), range: InputRange) -> FeatureMap {
    let ranged = |v: f32| match range {
        InputRange::MinusOneToOne => 2.0 * v - 1.0,
        InputRange::ZeroToOne => v,
    };
    let scaled = |rgb: &[f32; 3]| -> [f32; 3] { std::array::from_fn(|c| (ranged(rgb[c]) - SHIFT[c]) / SCALE[c]) };
    let values = pixels.iter().flat_map(scaled).collect();
    FeatureMap { width: width as usize, height: height as usize, channels: 3, values }
}

/// Mean over the places of the weighted squared difference of the unit features.
fn mean_distance(a: &FeatureMap, b: &FeatureMap, head: &[f32]) -> f64 {
    let row_len = a.width * a.channels;
    let row_sum = |(a, b): (&[f32], &[f32])| -> f64 {
        let places = a.chunks_exact(head.len()).zip(b.chunks_exact(head.len()));
        places.map(|(a, b)| place_distance(a, b, head)).sum()
    };
    let sums: Vec<f64> = a.values.par_chunks(row_len).zip(b.values.par_chunks(row_len)).map(row_sum).collect();
    sums.iter().sum::<f64>() / (a.width * a.height) as f64
}

fn place_distance(a: &[f32], b: &[f32], head: &[f32]) -> f64 {
    let length = |v: &[f32]| v.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt() + LENGTH_EPSILON;
    let (length_a, length_b) = (length(a), length(b));
    let weighted = |((&a, &b), &w): ((&f32, &f32), &f32)| {
        f64::from(w) * (f64::from(a) / length_a - f64::from(b) / length_b).powi(2)
    };
    a.iter().zip(b).zip(head).map(weighted).sum()
}
