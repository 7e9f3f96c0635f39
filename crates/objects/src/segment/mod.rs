//! L4: which Gaussians of a trained cloud belong to which object, from masks of its views.
//!
//! [`sweep`] finds what each Gaussian adds to the pixels of each mask of each view. Where ids differ from view to view,
//! [`mod@consensus`] finds the objects. [`label()`] decides by what is inside of an object's masks ([`votes`]);
//! Gaussians that no view shows follow their neighbours ([`unseen`]), and stray ones can be left out ([`strays`]).
//! Without masks, [`boxes`] makes them from boxes, and [`standing`] puts a box around what stands at a place. [`accuracy`]
//! compares labels.

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
