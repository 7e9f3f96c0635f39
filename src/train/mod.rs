//! L5: training: configuration, initialisation, steps, densification, checkpoints, reports.
//!
//! Plain data, no device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! and [`event_log`] (what happened), [`report`] (what came out), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`crate::io::checkpoint`].

pub mod config;
pub mod device_state;
pub mod event_log;
pub mod events;
pub mod initial;
pub mod interrupt;
pub mod report;
pub mod step_runner;
pub mod view_order;
pub mod view_store;
