//! Names of the tensors of `.instgs` files that have their background in pages.

/// Group of the finer levels of all pages.
pub(crate) const FINE: &str = "page_fine";
/// Group of the stand-ins.
pub(crate) const STAND_INS: &str = "page_stand_in";
/// Gaussians of each block, `u32[B]`.
pub(crate) const BLOCK_COUNTS: &str = "page.block_counts";
/// Ball of each block, `f32[B, 5]`: centre, radius, largest standard deviation.
pub(crate) const BLOCK_BALLS: &str = "page.block_balls";
/// Balls of each 256 Gaussians of the blocks, `f32[_, 5]`.
pub(crate) const BLOCK_CHUNKS: &str = "page.block_chunks";
/// Levels, `u32[L, 3]`: block, Gaussians, 1 if it is a stand-in.
pub(crate) const LEVELS: &str = "page.levels";
/// Cell of each level, `f32[L]`.
pub(crate) const LEVEL_CELLS: &str = "page.level_cells";
/// Balls of each 256 Gaussians of the levels, `f32[_, 5]`.
pub(crate) const LEVEL_CHUNKS: &str = "page.level_chunks";

/// All tensors of the table.
pub(crate) const TABLE: [&str; 6] = [BLOCK_COUNTS, BLOCK_BALLS, BLOCK_CHUNKS, LEVELS, LEVEL_CELLS, LEVEL_CHUNKS];

/// True for the name of a tensor that belongs to pages.
pub(crate) fn is_of_pages(tensor: &str) -> bool {
    let group = tensor.split_once('.').map(|(group, _)| group);
    group.is_some_and(|group| group == "page" || group == FINE || group == STAND_INS)
}
