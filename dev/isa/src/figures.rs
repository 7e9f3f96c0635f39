//! The figures that drivers of all vendors give of a kernel, under one name each.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};

use instgs_vk::gpu::{CompiledPipeline, DeviceCaps, Executable};
use serde::{Deserialize, Serialize};

/// A static property of a kernel's machine code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Figure {
    /// Vector registers of a lane.
    Registers,
    /// Values that were moved out of registers for want of room.
    Spills,
    /// Memory of a lane for what does not fit registers, bytes.
    ScratchBytes,
    /// Subgroups that a SIMD unit (AMD), a multiprocessor (NVIDIA) or a core (Adreno) can hold at once.
    Waves,
    /// Length of the machine code, bytes.
    CodeBytes,
    /// Instructions in the code, not how often they run.
    Instructions,
    /// The driver's estimate of the time that a subgroup takes, in cycles; only comparable within a driver.
    Cost,
}

/// All figures, and what drivers call them: of RADV (AMD), NVK (NVIDIA), ANV (Intel), Turnip (Adreno) and NVIDIA's own driver, in
/// this order where they differ, and last ANV's names in newer versions of Mesa. Names are compared without case, and several that
/// one driver gives are added.
const NAMES: [(Figure, &[&str]); 7] = [
    (Figure::Registers, &["vgprs", "number of gprs", "registers used", "register count"]),
    (Figure::Spills, &["spilled vgprs", "spilled sgprs", "spills to memory", "spill count", "spills"]),
    (Figure::ScratchBytes, &["scratch size", "slm size", "scratch memory size", "stack size"]),
    (Figure::Waves, &["subgroups per simd", "max warps/sm", "max waves per core"]),
    (Figure::CodeBytes, &["code size", "binary size"]),
    (Figure::Instructions, &["instructions", "instruction count"]),
    (Figure::Cost, &["inverse throughput", "static cycle count", "cycle count", "cycles"]),
];

/// What says nothing: of every kernel NVIDIA's driver 580 gives 64 GiB.
const MEANINGLESS: [&str; 1] = ["local memory size"];

impl Figure {
    /// True if a budget is a floor; else it is a ceiling.
    pub(crate) fn is_floor(self) -> bool {
        self == Self::Waves
    }

    /// The worse of two values.
    fn worse(self, a: u64, b: u64) -> u64 {
        if self.is_floor() { a.min(b) } else { a.max(b) }
    }
}

impl Display for Figure {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Registers => "registers",
            Self::Spills => "spills",
            Self::ScratchBytes => "scratch_bytes",
            Self::Waves => "waves",
            Self::CodeBytes => "code_bytes",
            Self::Instructions => "instructions",
            Self::Cost => "cost",
        })
    }
}

/// Values of those figures that a driver gives.
pub type Figures = BTreeMap<Figure, u64>;

/// Bytes in the driver's unit of the code's length: Turnip counts instructions' halves.
fn code_unit(driver: &str) -> u64 {
    if driver.to_lowercase().contains("turnip") { 4 } else { 1 }
}

/// The figure that a driver's name stands for.
fn figure_of(name: &str) -> Option<Figure> {
    let name = name.to_lowercase();
    NAMES.iter().find(|(_, names)| names.contains(&name.as_str())).map(|(figure, _)| *figure)
}

/// Figures of one piece of machine code, whose length is in units of `code_unit` bytes.
fn figures(executable: &Executable, code_unit: u64) -> Figures {
    let mut out = Figures::new();
    for (name, value) in &executable.statistics {
        if let Some(figure) = figure_of(name) {
            let unit = if figure == Figure::CodeBytes { code_unit } else { 1 };
            *out.entry(figure).or_default() += *value as u64 * unit;
        }
    }
    out
}

/// The largest values of statistics that are no figure, by the driver's names.
fn unknown(executables: &[Executable]) -> BTreeMap<String, f64> {
    let mut out = BTreeMap::new();
    for (name, value) in executables.iter().flat_map(|piece| &piece.statistics) {
        if figure_of(name).is_none() && !MEANINGLESS.contains(&name.to_lowercase().as_str()) {
            let largest: &mut f64 = out.entry(name.clone()).or_insert(*value);
            *largest = largest.max(*value);
        }
    }
    out
}

/// Figures where each is the worst of several pieces of code.
pub(crate) fn worst<'a>(all: impl IntoIterator<Item = &'a Figures>) -> Figures {
    let mut out = Figures::new();
    for (&figure, &value) in all.into_iter().flatten() {
        out.entry(figure).and_modify(|worst| *worst = figure.worse(*worst, value)).or_insert(value);
    }
    out
}

/// One kernel with one set of specialisation constants, as a driver compiled it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct KernelFigures {
    /// Stem of the kernel's file.
    pub kernel: String,
    /// Those constants, as NAME=VALUE, in which pipelines of this kernel differ; empty if there is one pipeline.
    pub specialisation: String,
    /// Lanes per subgroup of each piece of machine code.
    pub subgroup_sizes: Vec<u32>,
    /// The worst of the pieces of machine code.
    pub figures: Figures,
    /// What the driver says under names that are unknown here, the largest of the pieces.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub unknown: BTreeMap<String, f64>,
}

/// All pipelines on one device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceFigures {
    /// The driver's name of the device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// The lanes per subgroup that the program takes.
    pub subgroup_size: u32,
    /// How long all compilations took, seconds.
    pub seconds: f64,
    /// By kernel.
    pub kernels: Vec<KernelFigures>,
}

impl DeviceFigures {
    /// Figures of all pipelines that a device has compiled in `seconds`.
    pub(crate) fn new(caps: &DeviceCaps, subgroup_size: u32, seconds: f64, compiled: &[CompiledPipeline]) -> Self {
        let unit = code_unit(&caps.driver);
        let one = |pipeline: &CompiledPipeline| {
            let others = compiled.iter().filter(|other| other.kernel == pipeline.kernel);
            let pieces: Vec<Figures> = pipeline.executables.iter().map(|piece| figures(piece, unit)).collect();
            KernelFigures {
                kernel: pipeline.kernel.into(),
                specialisation: specialisation(&pipeline.constants, others.map(|other| &other.constants[..])),
                subgroup_sizes: pipeline.executables.iter().map(|piece| piece.subgroup_size).collect(),
                figures: worst(&pieces),
                unknown: unknown(&pipeline.executables),
            }
        };
        let (device, driver) = (caps.name.clone(), caps.driver.clone());
        Self { device, driver, subgroup_size, seconds, kernels: compiled.iter().map(one).collect() }
    }

    /// The figures of each kernel, each the worst of its specialisations.
    pub(crate) fn by_kernel(&self) -> BTreeMap<&str, Figures> {
        let names: BTreeSet<&str> = self.kernels.iter().map(|k| k.kernel.as_str()).collect();
        let of = |name| self.kernels.iter().filter(move |k| k.kernel == name).map(|k| &k.figures);
        names.into_iter().map(|name| (name, worst(of(name)))).collect()
    }
}

/// Those of `own` constants that have another value, or none, in one of `all` pipelines of the kernel.
fn specialisation<'a>(own: &[(String, u32)], all: impl Iterator<Item = &'a [(String, u32)]> + Clone) -> String {
    let differs = |constant: &&(String, u32)| all.clone().any(|other| !other.contains(constant));
    let texts: Vec<String> = own.iter().filter(differs).map(|(name, value)| format!("{name}={value}")).collect();
    texts.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn executable(statistics: &[(&str, f64)]) -> Executable {
        let statistics = statistics.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        Executable { name: "code".into(), subgroup_size: 32, statistics }
    }

    #[test]
    fn drivers_names_become_figures_and_unknown_ones_stand_beside_them() {
        let amd = executable(&[("VGPRs", 96.0), ("Spilled VGPRs", 3.0), ("Spilled SGPRs", 2.0), ("Hash", 7.0)]);
        assert_eq!(figures(&amd, 1), Figures::from([(Figure::Registers, 96), (Figure::Spills, 5)]));
        assert_eq!(unknown(&[amd, executable(&[("Hash", 9.0)])]), BTreeMap::from([("Hash".to_owned(), 9.0)]));
        let nvidia = executable(&[("Number of GPRs", 64.0), ("Max warps/SM", 32.0)]);
        assert_eq!(figures(&nvidia, 1), Figures::from([(Figure::Registers, 64), (Figure::Waves, 32)]));
        let names =
            [("Register Count", 56.0), ("Binary Size", 23040.0), ("Stack Size", 0.0), ("Local Memory Size", 7e10)];
        let own = executable(&names);
        let expected = [(Figure::Registers, 56), (Figure::ScratchBytes, 0), (Figure::CodeBytes, 23040)];
        assert_eq!((figures(&own, 1), unknown(&[own])), (Figures::from(expected), BTreeMap::new()));
        let adreno = executable(&[("Code size", 50.0), ("Instruction Count", 25.0)]);
        let unit = code_unit("turnip Mesa driver Mesa 25.0.7");
        assert_eq!(figures(&adreno, unit), Figures::from([(Figure::CodeBytes, 200), (Figure::Instructions, 25)]));
    }

    #[test]
    fn the_worst_has_the_fewest_waves_and_the_most_of_all_else() {
        let a = Figures::from([(Figure::Waves, 16), (Figure::CodeBytes, 100)]);
        let b = Figures::from([(Figure::Waves, 8), (Figure::CodeBytes, 90), (Figure::Spills, 1)]);
        let expected = Figures::from([(Figure::Waves, 8), (Figure::CodeBytes, 100), (Figure::Spills, 1)]);
        assert_eq!(worst([&a, &b]), expected);
    }

    #[test]
    fn a_specialisation_names_what_differs() {
        let constants = |training| vec![("WORKGROUP_SIZE".to_owned(), 128), ("TRAINING".to_owned(), training)];
        let all = [constants(0), constants(1)];
        assert_eq!(specialisation(&all[1], all.iter().map(|c| &c[..])), "TRAINING=1");
        assert_eq!(specialisation(&all[1], all[1..].iter().map(|c| &c[..])), "");
    }

    #[test]
    fn figures_have_the_same_names_in_files_and_messages() {
        for (figure, _) in NAMES {
            assert_eq!(serde_json::to_string(&figure).unwrap(), format!("\"{figure}\""));
        }
    }
}
