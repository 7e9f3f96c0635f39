//! The three feature extractors as tables: the layers of torchvision's AlexNet (Krizhevsky 2014), VGG-16 (Simonyan,
//! Zisserman 2014) and SqueezeNet 1.1 (Iandola et al. 2016) up to the last ReLU that LPIPS uses.

use crate::lpips::layers::{Convolution, FeatureMap, Window, max_pool, side_by_side};

/// The network that extracts the features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Net {
    /// AlexNet: the fastest; used by the InstGS paper's `evaluate.py`.
    Alex,
    /// VGG-16: the slowest; used by the 3DGS paper's `metrics.py`.
    Vgg,
    /// SqueezeNet 1.1: the one with the smallest weight file.
    Squeeze,
}

impl Net {
    /// All networks, in the order of their variants.
    pub const ALL: [Self; 3] = [Self::Alex, Self::Vgg, Self::Squeeze];

    /// The name in files and options: `alex`, `vgg` or `squeeze`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Alex => "alex",
            Self::Vgg => "vgg",
            Self::Squeeze => "squeeze",
        }
    }

    /// The layers between consecutive comparison points, one slice per network block.
    pub(super) fn blocks(self) -> &'static [&'static [Step]] {
        match self {
            Self::Alex => ALEX,
            Self::Vgg => VGG,
            Self::Squeeze => SQUEEZE,
        }
    }
}

/// A layer without its weights. `index` is its number in torchvision's `features`, which is part of its tensors' names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Convolution followed by ReLU.
    Conv { index: usize, outputs: usize, window: Window },
    /// Fire module: 1x1 convolution to `squeeze` channels, then 1x1 and 3x3 convolutions to `expand` channels each.
    Fire { index: usize, squeeze: usize, expand: usize },
    /// Max pooling without padding.
    Pool(Window),
}

const fn window(size: usize, stride: usize, padding: usize) -> Window {
    Window { size, stride, padding, ceil: false }
}

const fn conv(index: usize, outputs: usize, size: usize, stride: usize, padding: usize) -> Step {
    Step::Conv { index, outputs, window: window(size, stride, padding) }
}

const fn conv3(index: usize, outputs: usize) -> Step {
    conv(index, outputs, 3, 1, 1)
}

const fn fire(index: usize, squeeze: usize, expand: usize) -> Step {
    Step::Fire { index, squeeze, expand }
}

const POOL3: Step = Step::Pool(window(3, 2, 0));
const POOL3_CEIL: Step = Step::Pool(Window { size: 3, stride: 2, padding: 0, ceil: true });
const POOL2: Step = Step::Pool(window(2, 2, 0));

const ALEX: &[&[Step]] = &[
    &[conv(0, 64, 11, 4, 2)],
    &[POOL3, conv(3, 192, 5, 1, 2)],
    &[POOL3, conv3(6, 384)],
    &[conv3(8, 256)],
    &[conv3(10, 256)],
];
const VGG: &[&[Step]] = &[
    &[conv3(0, 64), conv3(2, 64)],
    &[POOL2, conv3(5, 128), conv3(7, 128)],
    &[POOL2, conv3(10, 256), conv3(12, 256), conv3(14, 256)],
    &[POOL2, conv3(17, 512), conv3(19, 512), conv3(21, 512)],
    &[POOL2, conv3(24, 512), conv3(26, 512), conv3(28, 512)],
];
const SQUEEZE: &[&[Step]] = &[
    &[conv(0, 64, 3, 2, 0)],
    &[POOL3_CEIL, fire(3, 16, 64), fire(4, 16, 64)],
    &[POOL3_CEIL, fire(6, 32, 128), fire(7, 32, 128)],
    &[POOL3_CEIL, fire(9, 48, 192)],
    &[fire(10, 48, 192)],
    &[fire(11, 64, 256)],
    &[fire(12, 64, 256)],
];

/// A layer with its weights loaded.
#[derive(Clone, Debug)]
pub(super) enum Layer {
    Conv(Convolution),
    Fire { squeeze: Convolution, expand: [Convolution; 2] },
    Pool(Window),
}

impl Layer {
    pub(super) fn apply(&self, input: &FeatureMap) -> FeatureMap {
        match self {
            Self::Conv(convolution) => convolution.apply(input),
            Self::Fire { squeeze, expand: [one, three] } => side_by_side(&[one, three], &squeeze.apply(input)),
            Self::Pool(window) => max_pool(*window, input),
        }
    }

    /// Length of a line of `len` pixels after this layer.
    fn places(&self, len: usize) -> usize {
        match self {
            Self::Conv(convolution) => convolution.window.places(len),
            Self::Fire { .. } => len,
            Self::Pool(window) => window.places(len),
        }
    }
}

/// A network block: the layers up to a comparison point, and the weights of its channels.
#[derive(Clone, Debug)]
pub(super) struct Block {
    pub(super) layers: Vec<Layer>,
    /// The linear head: one weight per channel.
    pub(super) head: Vec<f32>,
}

impl Block {
    pub(super) fn apply(&self, input: FeatureMap) -> FeatureMap {
        self.layers.iter().fold(input, |features, layer| layer.apply(&features))
    }
}

/// The smallest side of a picture, pixels, that leaves every block at least one position.
pub(super) fn smallest_side(blocks: &[Block]) -> u32 {
    let last = |side: u32| blocks.iter().flat_map(|s| &s.layers).fold(side as usize, |len, layer| layer.places(len));
    (1..).find(|&side| last(side) > 0).unwrap_or(1)
}
