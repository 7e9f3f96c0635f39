//! Captures that are too large for one machine: [`split()`] divides a data set into blocks, each a data set of its own, and
//! [`join()`] makes one scene of the blocks' trained scenes, with one template per kind of object. Only files lie between the
//! two, so any engine can train the blocks: `docs/large_scenes.md`.
//!
//! The [`Plan`] says which part of the ground each block owns (`plan`, `cell`). It is made of the points that training views
//! show (`divide`). A block's data set ([`split()`]) holds the views that show it, its points with a margin, and fewer and
//! fewer points farther away (`far`). [`join()`] takes each block's background where the block owns the ground, keeps every
//! object once (`join::objects`), matches the blocks' templates by registration (`join::kinds`), and removes background that
//! shows an object which another block found (`join::seams`).

mod cell;
mod divide;
mod error;
mod far;
mod job_list;
pub mod join;
mod links;
mod plan;
mod shares;
pub mod split;

pub use cell::{Cell, Ground};
pub use divide::{DivideOptions, Division, divide};
pub use error::BlocksError;
pub use job_list::{JOBS, job_lines, write_jobs};
pub use join::{JoinInput, JoinReport, Joined, join};
pub use plan::{Block, PLAN, Plan, block_of};
pub use split::split;
