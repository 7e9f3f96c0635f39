//! Faults that tests plant: a device that is lost, memory that runs out. They stand in the program that users run, since what they
//! test is that program; without a plan they cost one branch for each submission and allocation.

use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use super::error::GpuError;

/// The environment variable with a plan for all devices of the process, for instance `lost=12` or `refused=7,heap=64`.
const VARIABLE: &str = "INSTGS_FAULTS";

/// Which calls fail; the default is none. As text: `lost=N`, `dies=N`, `refused=N` and `heap=MIB`, between commas.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FaultPlan {
    /// The submission that is refused because the device is lost, counted from 1.
    pub lost_at: Option<u64>,
    /// The submission that is accepted and kills the device: the wait for it says so.
    pub dies_in: Option<u64>,
    /// The allocation that is refused for want of memory, counted from 1.
    pub refused_at: Option<u64>,
    /// Bytes of the only heap.
    pub heap_bytes: Option<u64>,
}

/// A text that is no plan.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is none of lost=N, dies=N, refused=N and heap=MIB")]
pub struct FaultPlanError(pub String);

impl FromStr for FaultPlan {
    type Err = FaultPlanError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut plan = Self::default();
        for part in text.split(',') {
            let error = || FaultPlanError(part.to_owned());
            let (key, value) = part.split_once('=').ok_or_else(error)?;
            let number = value.parse::<u64>().ok().filter(|n| (1..1 << 40).contains(n)).ok_or_else(error)?;
            match key {
                "lost" => plan.lost_at = Some(number),
                "dies" => plan.dies_in = Some(number),
                "refused" => plan.refused_at = Some(number),
                "heap" => plan.heap_bytes = Some(number << 20),
                _ => return Err(error()),
            }
        }
        Ok(plan)
    }
}

/// What becomes of a submission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    /// It is accepted and runs.
    Runs,
    /// It is refused: the device is lost.
    Refused,
    /// It is accepted and never ends: the device is lost meanwhile.
    Dies,
}

/// A plan and what was counted so far, over all devices that are opened with it: a fault happens once, and a device that is opened
/// after a loss works.
#[derive(Debug, Default)]
pub struct Faults {
    plan: FaultPlan,
    submissions: AtomicU64,
    allocations: AtomicU64,
}

impl Faults {
    /// Nothing is counted yet.
    pub fn new(plan: FaultPlan) -> Arc<Self> {
        Arc::new(Self { plan, ..Self::default() })
    }

    /// The faults that the environment variable `INSTGS_FAULTS` plans, the same ones each time; `None` if it is not set.
    ///
    /// # Errors
    /// Its text is no plan.
    pub fn of_environment() -> Result<Option<Arc<Self>>, GpuError> {
        static PLANNED: OnceLock<Result<Option<Arc<Faults>>, FaultPlanError>> = OnceLock::new();
        let planned = PLANNED.get_or_init(|| {
            let text = std::env::var(VARIABLE).ok();
            text.map(|text| text.parse().map(Self::new)).transpose()
        });
        planned.clone().map_err(|error| GpuError::Faults(format!("{VARIABLE}: {error}")))
    }

    /// Submissions and allocations so far.
    pub fn counts(&self) -> (u64, u64) {
        (self.submissions.load(Ordering::Relaxed), self.allocations.load(Ordering::Relaxed))
    }

    /// Bytes of the only heap, if they are limited.
    pub(super) fn heap_bytes(&self) -> Option<u64> {
        self.plan.heap_bytes
    }

    /// Counts a submission.
    pub(super) fn submission(&self) -> Fate {
        let number = Some(self.submissions.fetch_add(1, Ordering::Relaxed) + 1);
        match number {
            _ if number == self.plan.lost_at => Fate::Refused,
            _ if number == self.plan.dies_in => Fate::Dies,
            _ => Fate::Runs,
        }
    }

    /// Counts an allocation; true if it is to be refused.
    pub(super) fn refuses_allocation(&self) -> bool {
        Some(self.allocations.fetch_add(1, Ordering::Relaxed) + 1) == self.plan.refused_at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_are_read_and_faults_happen_once() {
        let plan: FaultPlan = "lost=2,refused=1,heap=64".parse().unwrap();
        let want = FaultPlan { lost_at: Some(2), refused_at: Some(1), heap_bytes: Some(64 << 20), dies_in: None };
        assert_eq!(plan, want);
        for text in ["", "lost", "lost=0", "lost=x", "killed=3", "lost=1,"] {
            assert!(text.parse::<FaultPlan>().is_err(), "{text}");
        }
        let faults = Faults::new(plan);
        assert_eq!([(); 3].map(|()| faults.submission()), [Fate::Runs, Fate::Refused, Fate::Runs]);
        assert_eq!([(); 2].map(|()| faults.refuses_allocation()), [true, false]);
        assert_eq!(Faults::new("dies=1".parse().unwrap()).submission(), Fate::Dies);
        assert_eq!(faults.counts(), (3, 2));
    }
}
