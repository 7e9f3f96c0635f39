//! Training: configuration, initialisation, steps, densification, checkpoints.
//!
//! Without a device: [`config`] (values at each step), [`view_order`] (the view of each step), [`events`] and
//! [`event_log`] (what happened), [`facts`] (results), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`instgs_io::checkpoint`]. Nothing here knows of masks and objects: `instgs_objects::pipeline` turns a plain cloud
//! into an instanced scene.

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
