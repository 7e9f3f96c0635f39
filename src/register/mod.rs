//! L4: which objects of a labelled cloud are alike, and where each stands: groups with poses, from masks alone.
//!
//! An object's opaque, small Gaussians give points on its surface, evenly spread (`sample`, `surface`), with normals
//! (`normals`) and features (`fpfh`). The object of a group with most of them is the reference. Poses of every other
//! start from matched features (`global`) and from turns about the up axis, and are refined from coarse to fine
//! (`icp`, `hypotheses`). Those that are nearly as good as the best are told apart by colour and by pictures
//! (`check`, `verify`, `decide`). Then every object is laid on what all others of its group show (`together`), with
//! steps from points to planes (`plane`), and rival poses are compared there once more (`members`). [`register()`]
//! forms the groups and says what became of every object.
//!
//! # What was measured
//!
//! Poses against the reference's. *Surfaces*: discs on the true surfaces that 40 cameras see, off by 0.3 % of the size and
//! tilted by 9 degrees (`tests/register.rs`): 8 cars, 20 seeds, all of 140 within 0.23 degrees and 0.15 % of the size; a hall
//! with 12 chairs, 2 tables and 4 vases, 16 seeds, all of 240 within 0.44 degrees and 0.23 %; none in doubt. *Trained*: the eight
//! cars of the demo, 434 to 860 opaque Gaussians each, 5.2 m, of many liveries, worst of seven:
//!
//! ```text
//! point to point, against the reference alone          2.7 degrees   1.4 %     (planes at the end: the same)
//! the same, then all together, tangential weight 1     0.95          1.4
//! all together, tangential weight 0.3                  0.88          0.9
//! all together, planes only (built in)                 0.51          0.8
//! the same, Gaussians of opacity above 0.5 only        179           -         (0.3 built in)
//! ```
//!
//! Cars trained for 600 steps only, 286 to 563 opaque Gaussians: 1.7 degrees and 0.9 %, of which 1.3 degrees are common to all:
//! the reference's own error. Chairs of a hall with 27 to 70 opaque Gaussians each: mostly within 1 degree and 2 %; those
//! with about 20, whose fainter ones count too, are up to 8 degrees off, not always in doubt.

mod alike;
pub mod check;
mod color;
mod compare;
mod decide;
pub mod error;
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
pub mod pose;
pub mod report;
mod sample;
mod spread;
mod surface;
mod together;
pub mod verify;

pub use check::{Agreement, PoseCheck};
pub use error::RegisterError;
pub use groups::{RegisterInput, Registered, register};
pub use normals::up_direction;
pub use options::RegisterOptions;
pub use report::{InstanceRegistration, Verdict};
pub use sample::MIN_SURFACE_GAUSSIANS;
pub use spread::PoseUncertainty;
pub use verify::{PhotoOfView, RenderCheck};
