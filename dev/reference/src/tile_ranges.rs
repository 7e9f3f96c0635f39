//! Twin of pass `tile_ranges`: the range of each tile's records after the stable sort by tile.

/// Half-open range `[first, end)` of the sorted records per tile; `[0, 0)` for a tile without records. `sorted_tiles`
/// is ascending and its entries are below `tile_count`.
pub fn tile_ranges(sorted_tiles: &[u32], tile_count: u32) -> Vec<[u32; 2]> {
    let mut ranges = vec![[0, 0]; tile_count as usize];
    for (i, &tile) in sorted_tiles.iter().enumerate() {
        let starts = i == 0 || sorted_tiles[i - 1] != tile;
        if starts {
            ranges[tile as usize][0] = i as u32;
        }
        ranges[tile as usize][1] = i as u32 + 1;
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::tile_ranges;

    #[test]
    fn ranges_of_present_and_absent_tiles() {
        assert_eq!(tile_ranges(&[0, 0, 2, 3, 3, 3], 5), vec![[0, 2], [0, 0], [2, 3], [3, 6], [0, 0]]);
        assert_eq!(tile_ranges(&[], 2), vec![[0, 0], [0, 0]]);
    }
}
