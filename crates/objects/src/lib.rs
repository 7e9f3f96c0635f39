//! Repeated objects in a trained scene: which Gaussians belong to which ([`segment`]), which objects are alike and their
//! poses ([`register`]), and the template that a group of them shares ([`template`]). [`pipeline`] does all of it, from
//! photos and masks to an instanced scene, training included.

pub mod pipeline;
pub mod register;
pub mod segment;
pub mod template;
