//! Things that the scenes are made of. Each has a mesh builder in its own frame (z up, origin on the ground below the
//! middle, metres) and a look.

pub mod car;
pub mod furniture;
pub mod props;
pub mod tree;
pub mod window;
