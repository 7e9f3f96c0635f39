//! L0: mathematics without state: spherical harmonics, covariances, eigenvectors, similarities, bounds, lens
//! distortion, nearest points, Morton order, planes, rotations in three numbers, seeded random numbers, order statistics,
//! number formatting.

pub mod covariance;
pub mod digits;
pub mod distortion;
pub mod eigen;
pub mod heat;
pub mod morton;
pub mod nearest;
pub mod plane;
pub mod rng;
pub mod sh;
pub mod similarity;
pub mod smallest_three;
pub mod statistics;
