//! L5: training: configuration, initialisation, steps, densification, checkpoints, reports.
//!
//! Plain data, no device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! (what happened), [`report`] (what came out), [`interrupt`] (Ctrl-C). Checkpoints are [`crate::io::checkpoint`].

pub mod config;
pub mod device_state;
pub mod initial;
pub mod step_runner;
pub mod strategy;
pub mod view_order;
pub mod view_store;
