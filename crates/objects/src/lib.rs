//! Repeated objects in a trained scene: which Gaussians belong to which ([`segment`]), which objects are alike and where each
//! stands ([`register`]), and the template that a group of them shares ([`template`]).

pub mod pipeline;
pub mod register;
pub mod segment;
pub mod template;

use instgs_detect as detect;
use instgs_io as io;
use instgs_train as train;
use instgs_vk::{gpu, math, render, scene};
