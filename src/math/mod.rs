//! L0: mathematics without state: spherical harmonics, covariances and their logarithms, eigenvectors, similarities, bounds, lens
//! distortion, nearest points, Morton order, opponent colours, planes, rotations in three numbers, seeded random numbers,
//! order statistics, number formatting.

pub mod covariance;
pub mod digits;
pub mod distortion;
pub mod eigen;
pub mod halves;
pub mod heat;
pub mod log_covariance;
pub mod morton;
pub mod nearest;
pub mod opponent;
pub mod plane;
pub mod rng;
pub mod sh;
pub mod similarity;
pub mod smallest_three;
pub mod statistics;
