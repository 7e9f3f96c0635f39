//! All readers.

mod clouds;
mod data_sets;
mod masks;
mod pictures;
mod planted;
mod runs;
mod scenes;

use crate::Target;

/// Every reader, in the order in which they are run.
pub fn all() -> Vec<Target> {
    [clouds::TARGETS, scenes::TARGETS, data_sets::TARGETS, masks::TARGETS, pictures::TARGETS, runs::TARGETS].concat()
}

/// The target of that name: one of [`all`], or one with a planted fault, by which this crate is tested.
pub fn named(name: &str) -> Option<Target> {
    all().into_iter().chain(planted::TARGETS.iter().copied()).find(|target| target.name == name)
}
