//! Learned perceptual image patch similarity, version 0.1 (Zhang, Isola, Efros, Shechtman, Wang 2018,
//! arXiv:1801.03924).
//!
//! Both pictures go through a network trained on ImageNet. After every network block, the features at each position are
//! scaled to unit length over the channels; the squared differences, weighted per channel by a trained linear head, are
//! averaged over the positions, and the averages of all blocks are added.
//!
//! The user supplies the trained weights ([`weights`]). A pair of 800x450 takes about 1 s with alex and squeeze, and 16
//! s of CPU time with vgg.

#[cfg(test)]
mod fixture;
mod layers;
mod network;
pub mod weights;

use std::path::Path;

use rayon::prelude::*;

use crate::pair::PicturePair;
use instgs_io::IoError;
use layers::FeatureMap;
pub use network::Net;
use network::{Block, smallest_side};

/// Added to the length of a feature vector before dividing by it.
const LENGTH_EPSILON: f64 = 1e-10;
/// Mean and standard deviation per channel of the networks' training images, for values in -1..=1.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

/// How pictures are fed to the network. The two give different values: reports name the range used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum InputRange {
    /// Scaled to -1..=1, as in LPIPS training; used by the InstGS paper's `evaluate.py`.
    #[default]
    MinusOneToOne,
    /// Left at 0..=1; used by the 3DGS paper's `metrics.py`.
    ZeroToOne,
}

/// Why LPIPS could not be computed. Its text is one line for the user.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LpipsError {
    /// The weights could not be read.
    #[error(transparent)]
    Weights(#[from] IoError),
    /// The picture is so small that pooling leaves nothing of it.
    #[error("a picture of {width}x{height} is too small for LPIPS with {}, which needs {smallest}x{smallest}", net.name())]
    TooSmall {
        /// The network that was asked for.
        net: Net,
        /// Width of the picture, pixels.
        width: u32,
        /// Height of the picture, pixels.
        height: u32,
        /// Smallest side that the network accepts, pixels.
        smallest: u32,
    },
}

/// A network with its weights, ready to compare pictures.
#[derive(Clone, Debug)]
pub struct Lpips {
    net: Net,
    range: InputRange,
    blocks: Vec<Block>,
    smallest_side: u32,
}

impl Lpips {
    /// Reads a network's weights (see [`weights`]).
    ///
    /// # Errors
    /// No such file (with the command that makes it), a file of another network, or a tensor that is missing, has
    /// another shape or type, or is not finite; the error names the tensor.
    pub fn load(net: Net, range: InputRange, path: &Path) -> Result<Self, LpipsError> {
        if !path.exists() {
            let command = weights::conversion_command(net, path);
            return Err(IoError::new(path, "does not exist").advise(format!("make it with: {command}")).into());
        }
        let bytes = std::fs::read(path).map_err(|e| IoError::new(path, format!("cannot read: {e}")))?;
        Ok(Self::new(net, range, weights::parse(net, &bytes, path)?))
    }

    fn new(net: Net, range: InputRange, blocks: Vec<Block>) -> Self {
        let smallest_side = smallest_side(&blocks);
        Self { net, range, blocks, smallest_side }
    }

    /// Which network this is.
    pub fn net(&self) -> Net {
        self.net
    }

    /// The distance of two pictures: 0 if they are equal, about 1 if they have nothing in common; no unit.
    ///
    /// # Errors
    /// A side of the pictures is below the network's smallest side.
    pub fn distance(&self, pair: &PicturePair) -> Result<f64, LpipsError> {
        Ok(self.stage_distances(pair)?.iter().sum())
    }

    /// The terms of [`Lpips::distance`], one per network block: 5, or 7 for squeeze.
    ///
    /// # Errors
    /// The same as [`Lpips::distance`].
    pub fn stage_distances(&self, pair: &PicturePair) -> Result<Vec<f64>, LpipsError> {
        let (width, height, smallest) = (pair.width(), pair.height(), self.smallest_side);
        if width.min(height) < smallest {
            return Err(LpipsError::TooSmall { net: self.net, width, height, smallest });
        }
        let input = |pixels| network_input(pixels, (width, height), self.range);
        let (mut a, mut b) = (input(pair.render()), input(pair.target()));
        let mut distances = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            // Sequentially: each block needs the memory, and each uses all cores.
            a = block.apply(a);
            b = block.apply(b);
            distances.push(mean_distance(&a, &b, &block.head));
        }
        Ok(distances)
    }
}

/// The picture as the network's input features.
fn network_input(pixels: &[[f32; 3]], (width, height): (u32, u32), range: InputRange) -> FeatureMap {
    let ranged = |v: f32| match range {
        InputRange::MinusOneToOne => 2.0 * v - 1.0,
        InputRange::ZeroToOne => v,
    };
    let scaled = |rgb: &[f32; 3]| -> [f32; 3] { std::array::from_fn(|c| (ranged(rgb[c]) - SHIFT[c]) / SCALE[c]) };
    let values = pixels.iter().flat_map(scaled).collect();
    FeatureMap { width: width as usize, height: height as usize, channels: 3, values }
}

/// Mean over the positions of the weighted squared difference of the normalised features.
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
