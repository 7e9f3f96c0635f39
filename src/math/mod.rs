//! L0: mathematics without state: spherical harmonics, covariances, similarities, bounds, seeded random numbers.

pub mod covariance;
pub mod rng;
pub mod sh;
pub mod similarity;
