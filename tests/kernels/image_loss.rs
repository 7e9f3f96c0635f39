//! The image loss against its twin and the golden files.
