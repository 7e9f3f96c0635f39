//! L5: training: configuration, initialisation, steps, densification, checkpoints, reports.
//!
//! Plain data, no device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! and [`event_log`] (what happened), [`report`] (what came out), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`crate::io::checkpoint`].

pub mod config;
pub mod event_log;
pub mod events;
pub mod interrupt;
pub mod report;
pub mod view_order;
