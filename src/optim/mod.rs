//! L3: Adam on the device, one state per parameter buffer.

pub mod adam;

pub use adam::{Adam, MomentBuffer, zero_moments};
