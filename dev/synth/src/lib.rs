//! L5: procedural scenes, made by code alone, the same bits for the same build and platform.
//!
//! [`embedded_scene`] is a paddock with racing cars, all instances of one template: a whole scene without training.
//! Modules: [`surface`] spreads points evenly over surfaces and makes flat Gaussians of them, [`shading`] bakes light
//! into spherical harmonics, [`occlusion`] and [`ground_map`] bake shadows, [`car`] and [`livery`] are the template and
//! its variations, [`ground`], [`markings`] and [`props`] the background. [`scale`] makes the
//! scale test's field of instances. [`dataset`] makes photos of scenes whose truth is known.

use instgs_io as io;
use instgs_vk::{math, scene};

pub mod car;
pub mod dataset;
pub mod embedded;
pub mod ground;
pub mod ground_map;
pub mod livery;
pub mod markings;
pub mod occlusion;
pub mod props;
pub mod scale;
pub mod shading;
pub mod surface;

pub use embedded::embedded_scene;
