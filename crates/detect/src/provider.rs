//! Devices that run the models.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Execution provider of ONNX Runtime. All but the processor need a build of the runtime library that contains it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// The processor; every build of the runtime supports it.
    #[default]
    Cpu,
    /// Nvidia GPUs through CUDA.
    Cuda,
    /// Nvidia GPUs through TensorRT, which compiles graphs for the device; unsupported parts run on CUDA.
    TensorRt,
    /// AMD GPUs through ROCm.
    Rocm,
    /// Apple devices through Core ML.
    CoreMl,
    /// Any GPU on Windows through DirectML.
    DirectMl,
}

impl Provider {
    /// All providers, the processor first.
    pub const ALL: [Self; 6] = [Self::Cpu, Self::Cuda, Self::TensorRt, Self::Rocm, Self::CoreMl, Self::DirectMl];

    /// Name of the provider on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::Rocm => "rocm",
            Self::CoreMl => "coreml",
            Self::DirectMl => "directml",
        }
    }

    /// All names, for messages: "cpu, cuda, ...".
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl fmt::Display for Provider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is none of a [`Provider`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not one of {names}", names = Provider::names())]
pub struct UnknownProvider(String);

impl FromStr for Provider {
    type Err = UnknownProvider;

    fn from_str(name: &str) -> Result<Self, UnknownProvider> {
        let found = Self::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| UnknownProvider(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_and_others_are_listed() {
        for provider in Provider::ALL {
            assert_eq!(provider.name().parse(), Ok(provider));
        }
        let error = "gpu".parse::<Provider>().unwrap_err().to_string();
        assert_eq!(error, "\"gpu\" is not one of cpu, cuda, tensorrt, rocm, coreml, directml");
    }
}
