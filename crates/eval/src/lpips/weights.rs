//! The user's file of trained weights: the tensors it must hold, its default path, and how to make it.
//!
//! Nothing is bundled: `tools/models/convert_lpips.py` makes the file from torchvision's and the lpips package's own
//! distributions. It is a safetensors file, F32 or F16, with the tensors under the names of these sources:
//! `features.N.weight` `[out, in, h, w]` and `features.N.bias` `[out]`; for fire modules `features.N.squeeze.*`,
//! `features.N.expand1x1.*` and `features.N.expand3x3.*`; and the heads `linK.model.1.weight` `[1, channels, 1, 1]`.
//! The metadata entry `net` names the network. Other tensors are ignored.

use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors};

use crate::lpips::layers::{Convolution, Window};
use crate::lpips::network::{Block, Layer, Net, Step};
use instgs_io::{IoError, Place};

const POINT: Window = Window { size: 1, stride: 1, padding: 0, ceil: false };
const SQUARE: Window = Window { size: 3, stride: 1, padding: 1, ceil: false };

/// The default path of a network's weights: `instgs-vk/lpips_NET.safetensors` in the user's data folder
/// (`XDG_DATA_HOME`, `APPDATA` on Windows, else `~/.local/share`); `None` if the system names no such folder.
pub fn user_weights_path(net: Net) -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let folder = variable("XDG_DATA_HOME")
        .or_else(|| variable("APPDATA"))
        .or_else(|| variable("HOME").map(|home| home.join(".local/share")))?;
    Some(folder.join("instgs-vk").join(format!("lpips_{}.safetensors", net.name())))
}

/// The command that makes a network's weight file, to be run in the repository.
pub fn conversion_command(net: Net, path: &Path) -> String {
    format!("python3 tools/models/convert_lpips.py --net {} --out {}", net.name(), path.display())
}

/// The network's blocks with the weights of the file at `path`, whose contents are `bytes`.
pub(super) fn parse(net: Net, bytes: &[u8], path: &Path) -> Result<Vec<Block>, IoError> {
    let malformed = |e| IoError::new(path, format!("is not a whole safetensors file: {e}"));
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
    let own_net = header.metadata().as_ref().and_then(|m| m.get("net"));
    if let Some(other) = own_net.filter(|other| *other != net.name()) {
        let error = IoError::new(path, format!("holds the weights of {other}, not of {}", net.name()));
        return Err(error.at(Place::Field("metadata net".into())));
    }
    let file = Tensors { path, tensors: SafeTensors::deserialize(bytes).map_err(malformed)? };
    build(net, |name, shape| file.floats(name, shape))
}

/// The network's blocks; `read` returns a tensor by name and shape.
pub(super) fn build<E>(net: Net, mut read: impl FnMut(&str, &[usize]) -> Result<Vec<f32>, E>) -> Result<Vec<Block>, E> {
    let mut channels = 3;
    let mut blocks = Vec::new();
    for (k, steps) in net.blocks().iter().enumerate() {
        let mut layers = Vec::with_capacity(steps.len());
        for &step in *steps {
            let mut convolution = |part: &str, inputs, outputs, window: Window| -> Result<Convolution, E> {
                let weights = read(&format!("{part}.weight"), &[outputs, inputs, window.size, window.size])?;
                let bias = read(&format!("{part}.bias"), &[outputs])?;
                Ok(Convolution::new(window, inputs, &weights, bias))
            };
            layers.push(match step {
                Step::Conv { index, outputs, window } => {
                    let inputs = std::mem::replace(&mut channels, outputs);
                    Layer::Conv(convolution(&format!("features.{index}"), inputs, outputs, window)?)
                }
                Step::Fire { index, squeeze, expand } => {
                    let inputs = std::mem::replace(&mut channels, 2 * expand);
                    let part = |name: &str| format!("features.{index}.{name}");
                    Layer::Fire {
                        squeeze: convolution(&part("squeeze"), inputs, squeeze, POINT)?,
                        expand: [
                            convolution(&part("expand1x1"), squeeze, expand, POINT)?,
                            convolution(&part("expand3x3"), squeeze, expand, SQUARE)?,
                        ],
                    }
                }
                Step::Pool(window) => Layer::Pool(window),
            });
        }
        blocks.push(Block { layers, head: read(&format!("lin{k}.model.1.weight"), &[1, channels, 1, 1])? });
    }
    Ok(blocks)
}

/// The tensors of a weight file.
struct Tensors<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl Tensors<'_> {
    fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, IoError> {
        let error = |what: String| IoError::new(self.path, what).at(Place::Tensor(name.into()));
        let view = self.tensors.tensor(name).map_err(|_| error("is missing".into()))?;
        if view.shape() != shape {
            return Err(error(format!("has the shape {:?}, not {shape:?}", view.shape())));
        }
        let data = view.data();
        let values: Vec<f32> = match view.dtype() {
            Dtype::F32 => data.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect(),
            Dtype::F16 => data.as_chunks::<2>().0.iter().map(|&b| half::f16::from_le_bytes(b).to_f32()).collect(),
            other => return Err(error(format!("has the type {other:?}, not F32 or F16"))),
        };
        if !values.iter().all(|v| v.is_finite()) {
            return Err(error("holds a value that is not finite".into()));
        }
        Ok(values)
    }
}
