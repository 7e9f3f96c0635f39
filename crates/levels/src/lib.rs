//! Levels of detail that hold: a level by merging is optimised until its pictures are those of its template.
//!
//! Merging keeps mass, mean, covariance and colour of the Gaussians in a cell of a grid, and knows nothing of which of them
//! hide which. So each level is trained, like a scene, against pictures of the template at full detail, of the size at which
//! the level is shown: where its cells are about a pixel wide. This is done once per template, and all instances share it;
//! their offsets for a level are still those by merging.
//!
//! `views` has the cameras, `fit` the training of one level, `template` that of all levels of a template.

mod fit;
mod template;
mod views;

pub use template::{FitOptions, LevelReport, fit_template};
