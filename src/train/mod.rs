//! L5: training: configuration, initialisation, steps, densification, checkpoints, reports.
//!
//! Plain data, no device: [`config`] (what to do at which step), [`view_order`] (which view a step uses), [`events`]
//! and [`event_log`] (what happened), [`report`] (what came out), [`interrupt`] (Ctrl-C). Checkpoint files are
//! [`crate::io::checkpoint`].

pub mod config;
mod data_doubts;
pub mod device_state;
pub mod error;
pub mod event_log;
pub mod events;
pub mod given;
pub mod grouped;
pub mod initial;
pub mod interrupt;
pub mod made_masks;
pub mod mask_check;
pub mod mask_source;
pub mod memory;
pub mod merged;
pub mod prepare;
pub mod report;
pub mod segmented;
pub mod stage_pictures;
mod start;
pub mod state_file;
pub mod step_runner;
pub mod strategy;
pub mod trainer;
pub mod view_order;
pub mod view_store;
pub mod views;

pub use error::TrainError;
pub use grouped::{Grouped, registered};
pub use made_masks::{masks_from_prompt, write_masks_from_boxes};
pub use mask_check::check_masks;
pub use mask_source::MaskSource;
pub use merged::{Merged, merged};
pub use prepare::{Prepared, prepare};
pub use segmented::{Segmented, segmented};
pub use start::leave_out_masked;
pub use trainer::{TrainJob, Trained, eval_options, train};
