//! Registration. Finds which objects of a labelled cloud are alike, and the pose of each: groups with poses, from
//! masks alone.
//!
//! An object's opaque, small Gaussians give points evenly spread on its surface (`sample`, `surface`), with normals
//! (`normals`) and FPFH features (`fpfh`). The object of a group with most Gaussians is the reference. Poses of every
//! other object start from matched features (`global`) and from turns about the up axis, and are refined from coarse to
//! fine by ICP (`icp`, `hypotheses`). Near ties are decided by colour and by rendered pictures (`check`, `verify`,
//! `decide`). Then every object is aligned with all others of its group (`together`, `unions`) by point-to-plane steps (`plane`),
//! and rival poses are compared once more (`members`). Repeating the registration with halves of the Gaussians gives
//! standard deviations of each pose (`spread`). [`register()`] forms the groups and reports every object;
//! [`polished()`] refines given poses.
//!
//! Accuracy on surfaces, trained clouds and coarse clouds: `docs/notes/objects.md`.

mod alike;
mod cells;
pub mod check;
mod color;
mod compare;
mod decide;
pub mod error;
pub mod find;
mod fpfh;
mod global;
mod groups;
mod hypotheses;
mod icp;
mod members;
mod normals;
pub mod options;
mod outcome;
mod outline;
mod plane;
mod polish;
pub mod pose;
pub mod report;
mod sample;
mod spread;
mod surface;
mod together;
mod unions;
pub mod verify;

pub use check::{Agreement, PoseCheck};
pub use error::RegisterError;
pub use find::{
    Against, FindError, FindInput, FindOptions, FindProgress, Found, FoundObject, RejectedPlace, find_alike,
};
pub use groups::{RegisterInput, Registered, register};
pub use instgs_vk::scene::up_direction;
pub use options::RegisterOptions;
pub use polish::polished;
pub use report::{InstanceRegistration, Verdict};
pub use sample::MIN_SURFACE_GAUSSIANS;
pub use spread::PoseUncertainty;
pub use verify::{PhotoOfView, RenderCheck};
