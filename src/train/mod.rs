//! L5: training: configuration, initialisation, steps, densification, checkpoints, reports.

pub mod initial;
pub mod view_store;
