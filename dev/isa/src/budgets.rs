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
    /// What breaks its budget today.
    pub known: Vec<Known>,
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

/// A broken budget that is put up with for now, but may get no worse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Stem of the kernel's file.
    pub kernel: String,
    /// Family of GPUs.
    pub family: String,
    /// The figure that breaks its budget.
    pub figure: Figure,
    /// The limit for now.
    pub value: u64,
    /// Why, and what would mend it.
    pub why: String,
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
    /// Entries of `known` that nothing needs any more.
    pub mended: Vec<Known>,
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
        let named = self.kernels.keys().chain(of_families).chain(self.known.iter().map(|k| &k.kernel));
        if let Some(unknown) = named.into_iter().find(|name| !exist.contains(name.as_str())) {
            return Err(format!("there is no kernel {unknown}: name one of glsl/*.comp"));
        }
        match self.known.iter().find(|known| !self.families.contains_key(&known.family)) {
            Some(known) => Err(format!("known: there is no family {}: add families.{0}", known.family)),
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
            .partition(|violation| self.known.iter().any(|known| known.covers(violation)));
        let mut verdict = Verdict { violations, known, mended: Vec::new() };
        let breaks = |known: &&Known| !verdict.violations.iter().chain(&verdict.known).any(|v| known.is_about(v));
        // A family that was not looked at says nothing.
        let looked_at = self.known.iter().filter(|known| families.contains_key(&known.family));
        verdict.mended = looked_at.filter(breaks).cloned().collect();
        verdict
    }
}

impl Known {
    fn is_about(&self, violation: &Violation) -> bool {
        (&self.kernel, &self.family, self.figure) == (&violation.kernel, &violation.family, violation.figure)
    }

    fn covers(&self, violation: &Violation) -> bool {
        self.is_about(violation) && violation.value.is_some_and(|value| keeps(self.figure, value, self.value))
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
