//! Objects and props of the scenes. Each has a mesh builder in its own frame (z up, origin on the ground below the
//! centre, metres) and a look.

pub mod car;
pub mod furniture;
pub mod goods;
pub mod props;
pub mod seat;
pub mod tree;
pub mod window;
