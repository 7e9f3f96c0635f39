//! Small valid files, made by code: what writers of this project make, and by hand what only other programs write.

pub mod clouds;
pub mod data_sets;
pub mod masks;
pub mod pictures;
pub mod runs;
pub mod scenes;
