//! Which Gaussians of a trained cloud belong to which object, from masks of its views.
//!
//! [`sweep`] renders how much each Gaussian contributes to each mask of each view. Where mask ids differ from view to
//! view, [`mod@consensus`] finds which masks show the same object. [`label()`] assigns each Gaussian to the object
//! whose masks hold most of its weight ([`votes`]); Gaussians that no view shows take the label of their neighbours
//! ([`unseen`]), and stray groups can be dropped ([`strays`]). Without masks, [`boxes`] makes them from boxes, and
//! [`standing`] fits a box around the object at a point of the world. [`accuracy`] compares labels with known ones.

pub mod accuracy;
pub mod boxes;
mod components;
pub mod consensus;
pub mod error;
mod ground_plane;
pub mod id_table;
pub mod label;
pub mod standing;
pub mod strays;
pub mod sweep;
pub mod unseen;
pub mod votes;

pub use boxes::{BoxMasks, BoxOptions, BoxReport, masks_from_boxes};
pub use consensus::report::{ConsensusReport, ObjectReport};
pub use consensus::{Consensus, ConsensusOptions, consensus};
pub use error::SegmentError;
pub use id_table::IdTable;
pub use label::{InstanceStats, LabelOptions, LabelProgress, Labels, label, label_views};
pub use sweep::{KEPT_BYTES, ViewContributions, ViewEntries};
