//! Trains Gaussian scenes, plain or with templates and instances: configuration, start, steps, densification, checkpoints.
//!
//! Plain data, without a device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! and [`event_log`] (what happened), [`facts`] (what came out), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`instgs_io::checkpoint`]. Nothing here knows of masks and objects: what makes an instanced scene of a plain cloud is the
//! crate `instgs-objects`.

pub mod config;
mod data_doubts;
pub mod device_state;
pub mod error;
pub mod event_log;
pub mod events;
mod exposures;
pub mod facts;
mod finish;
mod finish_shapes;
pub mod given;
pub mod initial;
pub mod interrupt;
mod log_and_observer;
mod log_state;
pub mod memory;
pub mod observer;
pub mod pruning;
mod results;
mod resumed_log;
mod run_files;
mod same_data;
pub mod sensitivity;
mod shape_sensitivity;
mod start;
pub mod state_file;
pub mod step_runner;
pub mod strategy;
pub mod trainer;
pub mod view_order;
pub mod view_pictures;
pub mod view_store;
pub mod views;

pub use error::TrainError;
pub use finish::{FinishJob, Finished, finish};
pub use observer::{TrainMessage, TrainObserver};
pub use results::cameras_at_training_size;
pub use same_data::check_finished;
pub use sensitivity::{USUAL_PICTURE_PSNR_DB, measure_sensitivity, sensitivity_cameras, write_small};
pub use start::{first_count, leave_out_masked, no_training_views, put_pixel_masks, read_dataset, unused_masks};
pub use trainer::{TrainJob, Trained, train};
pub use view_pictures::{eval_options, evaluate_test_views};
