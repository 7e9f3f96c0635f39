//! L5: procedural scenes, made by code alone, the same bits for the same build and platform.
//!
//! [`embedded_scene`] is the scene of `instgs-vk demo`: a paddock with racing cars, all instances of one template.
//! Modules: [`surface`] spreads points evenly over surfaces and makes flat Gaussians of them, [`shading`] bakes light
//! into spherical harmonics, [`occlusion`] and [`ground_map`] bake shadows, [`car`] and [`livery`] are the template and
//! its variations, [`ground`], [`markings`] and [`props`] the background.

pub mod car;
pub mod embedded;
pub mod ground;
pub mod ground_map;
pub mod livery;
pub mod markings;
pub mod occlusion;
pub mod props;
pub mod shading;
pub mod surface;

pub use embedded::{SKY_COLOR, WORLD_UP, embedded_scene, embedded_views};
