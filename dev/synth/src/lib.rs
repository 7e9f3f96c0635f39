//! L5: procedural scenes, made by code alone, the same bits for the same build and platform.
//!
//! [`dataset`] makes photos of scenes whose truth is known. Modules: [`surface`] spreads points evenly over surfaces,
//! [`car`] and [`livery`] are a racing car and its variations, [`shading`] encodes colours.

pub mod car;
pub mod dataset;
pub mod livery;
pub mod shading;
pub mod surface;
