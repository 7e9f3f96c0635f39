//! L5: training: configuration, initialisation, steps, densification, checkpoints.
//!
//! Plain data, no device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! and [`event_log`] (what happened), [`facts`] (what came out), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`instgs_io::checkpoint`]. Nothing here knows of masks and objects: what makes a plain cloud an instanced scene is
//! [`instgs_objects::pipeline`].

pub mod config;
mod data_doubts;
pub mod device_state;
pub mod error;
pub mod event_log;
pub mod events;
pub mod facts;
pub mod given;
pub mod initial;
pub mod interrupt;
pub mod memory;
pub mod observer;
mod start;
pub mod state_file;
pub mod step_runner;
pub mod strategy;
pub mod trainer;
pub mod view_order;
pub mod view_store;
pub mod views;

pub use error::TrainError;
pub use observer::{TrainMessage, TrainObserver};
pub use start::leave_out_masked;
pub use trainer::{TrainJob, Trained, eval_options, train};
