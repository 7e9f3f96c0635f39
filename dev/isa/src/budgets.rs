//! Budgets of kernels (`configs/isa.toml`), and which of them figures break.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};
use std::path::Path;

use instgs_io::{IoError, read_bytes};
use instgs_vk::gpu::interface::ALL_SHADERS;
use serde::{Deserialize, Serialize};

use crate::figures::{DeviceFigures, Figure, Figures, KernelFigures};

/// A limit on each of some figures: waves at least, all else at most.
pub type Budget = Figures;

/// The file of budgets.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Budgets {
    /// For every kernel on every family.
    pub every: Budget,
    /// By kernel, on every family; instead of `every`, figure by figure.
    pub kernels: BTreeMap<String, Budget>,
    /// By family of GPUs; instead of both.
    pub families: BTreeMap<String, FamilyBudgets>,
    /// What breaks its budget today, by kernel.
    pub known: BTreeMap<String, Known>,
}

/// Budgets on one family of GPUs.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FamilyBudgets {
    /// For every kernel.
    pub every: Budget,
    /// By kernel; instead of all others.
    pub kernels: BTreeMap<String, Budget>,
}

/// Broken budgets of a kernel that are put up with for now, but may get no worse.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Why, and what would mend it.
    pub why: String,
    /// The limits for now, by family: only of figures that break their budgets.
    pub families: BTreeMap<String, Budget>,
}

/// An entry of [`Budgets::known`] that nothing needs any more.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Mended {
    /// Stem of the kernel's file.
    pub kernel: String,
    /// Family of GPUs.
    pub family: String,
    /// The figure that keeps its budget.
    pub figure: Figure,
}

impl Display for Mended {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Self { kernel, family, figure } = self;
        write!(f, "{kernel} on {family}: {figure} keeps its budget now, so take it out of known.{kernel}")
    }
}

/// A figure beyond its limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Stem of the kernel's file.
    pub kernel: String,
    /// See [`KernelFigures::specialisation`].
    pub specialisation: String,
    /// Family of GPUs.
    pub family: String,
    /// What is beyond its limit.
    pub figure: Figure,
    /// Its value; `None` if the driver does not give it.
    pub value: Option<u64>,
    /// The limit.
    pub budget: u64,
}

impl Display for Violation {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        let Self { kernel, specialisation, family, figure, value, budget } = self;
        let of = if specialisation.is_empty() { String::new() } else { format!(" ({specialisation})") };
        let bound = if figure.is_floor() { "at least" } else { "at most" };
        match value {
            Some(value) => write!(f, "{kernel}{of} on {family}: {figure} {value}, budget {bound} {budget}"),
            None => write!(f, "{kernel}{of} on {family}: the driver gives no {figure}, budget {bound} {budget}"),
        }
    }
}

/// What figures do to budgets.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verdict {
    /// Limits that are broken, beyond what is known.
    pub violations: Vec<Violation>,
    /// Limits that are broken within what is known.
    pub known: Vec<Violation>,
    /// What is known and no longer broken.
    pub mended: Vec<Mended>,
}

impl Budgets {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// A file that cannot be read or is not TOML; unknown keys, kernels, figures or families.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let text = String::from_utf8(read_bytes(path)?).map_err(|_| IoError::new(path, "is not UTF-8 text"))?;
        Self::parse(&text).map_err(|what| IoError::new(path, what))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let budgets: Self = toml::from_str(text).map_err(|e| {
            let line = e.span().and_then(|s| text.get(..s.start)).map_or(1, |t| 1 + t.matches('\n').count());
            format!("line {line}: {}", e.message().lines().collect::<Vec<_>>().join(" "))
        })?;
        budgets.check()?;
        Ok(budgets)
    }

    /// A kernel that was renamed must not lose its budget unnoticed.
    fn check(&self) -> Result<(), String> {
        let exist: BTreeSet<&str> = ALL_SHADERS.iter().map(|shader| shader.name).collect();
        let of_families = self.families.values().flat_map(|family| family.kernels.keys());
        let named = self.kernels.keys().chain(of_families).chain(self.known.keys());
        if let Some(unknown) = named.into_iter().find(|name| !exist.contains(name.as_str())) {
            return Err(format!("there is no kernel {unknown}: name one of glsl/*.comp"));
        }
        let mut known = self.known.values().flat_map(|known| known.families.keys());
        match known.find(|family| !self.families.contains_key(*family)) {
            Some(family) => Err(format!("known: there is no family {family}: add families.{family}")),
            None => Ok(()),
        }
    }

    /// The limits of a kernel on a family: those of the most special entry that has the figure.
    fn of(&self, kernel: &str, family: &str) -> Budget {
        let family = self.families.get(family);
        let entries = [
            Some(&self.every),
            self.kernels.get(kernel),
            family.map(|f| &f.every),
            family.and_then(|f| f.kernels.get(kernel)),
        ];
        entries.into_iter().flatten().flatten().map(|(&figure, &limit)| (figure, limit)).collect()
    }

    /// Compares the figures of all families with the budgets.
    pub fn judge(&self, families: &BTreeMap<String, DeviceFigures>) -> Verdict {
        let rows = families.iter().flat_map(|(family, device)| device.kernels.iter().map(move |row| (family, row)));
        let (known, violations) = rows
            .flat_map(|(family, row)| broken(row, family, &self.of(&row.kernel, family)))
            .partition(|violation| self.is_known(violation));
        let mut verdict = Verdict { violations, known, mended: Vec::new() };
        verdict.mended = self.mended(families, &verdict);
        verdict
    }

    fn is_known(&self, violation: &Violation) -> bool {
        let Violation { kernel, family, figure, value, .. } = violation;
        let limit = self.known.get(kernel).and_then(|known| known.families.get(family)?.get(figure));
        matches!((value, limit), (Some(value), Some(limit)) if keeps(*figure, *value, *limit))
    }

    /// Of the families that were looked at: the others say nothing.
    fn mended(&self, families: &BTreeMap<String, DeviceFigures>, verdict: &Verdict) -> Vec<Mended> {
        let mut out = Vec::new();
        for (kernel, known) in &self.known {
            for (family, limits) in known.families.iter().filter(|(family, _)| families.contains_key(*family)) {
                for &figure in limits.keys() {
                    let one = Mended { kernel: kernel.clone(), family: family.clone(), figure };
                    if !verdict.violations.iter().chain(&verdict.known).any(|v| v.is_about(&one)) {
                        out.push(one);
                    }
                }
            }
        }
        out
    }
}

impl Violation {
    fn is_about(&self, Mended { kernel, family, figure }: &Mended) -> bool {
        (&self.kernel, &self.family, &self.figure) == (kernel, family, figure)
    }
}

/// True if the value is within the limit.
fn keeps(figure: Figure, value: u64, limit: u64) -> bool {
    if figure.is_floor() { value >= limit } else { value <= limit }
}

/// The limits that a pipeline breaks.
fn broken(row: &KernelFigures, family: &str, budget: &Budget) -> Vec<Violation> {
    let violation = |(&figure, &budget): (&Figure, &u64)| {
        let value = row.figures.get(&figure).copied();
        let kept = value.is_some_and(|value| keeps(figure, value, budget));
        let (kernel, specialisation) = (row.kernel.clone(), row.specialisation.clone());
        (!kept).then(|| Violation { kernel, specialisation, family: family.into(), figure, value, budget })
    };
    budget.iter().filter_map(violation).collect()
}

#[cfg(test)]
#[path = "budgets_tests.rs"]
mod tests;
