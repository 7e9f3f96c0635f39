//! L0: mathematics without state: spherical harmonics, covariances, similarities, bounds, lens distortion, seeded random numbers.

pub mod covariance;
pub mod distortion;
pub mod rng;
pub mod sh;
pub mod similarity;
