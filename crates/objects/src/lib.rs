//! Repeated objects in a trained scene: which Gaussians belong to which ([`segment`]), which objects are alike and where each
//! stands ([`register`]), and the template that a group of them shares ([`template`]). [`pipeline`] does all of it, training included: from photos and masks
//! to an instanced scene.

pub mod pipeline;
pub mod register;
pub mod segment;
pub mod template;
