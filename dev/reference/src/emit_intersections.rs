//! Twin of pass `emit_intersections`: one record (tile, splat) for every tile that a splat touches, splats in depth
//! order.

use crate::scan::exclusive_scan;

/// The records before the sort by tile, as two arrays of equal length.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Intersections {
    /// Row-major tile index of each record.
    pub tiles: Vec<u32>,
    /// Position of the record's splat in depth order.
    pub splats: Vec<u32>,
    /// Per splat, the index of its first record: the exclusive scan of the tile counts.
    pub first_of_splat: Vec<u32>,
}

/// Emits the records of `tiles_of_splat` (outer index: splat in depth order; inner: its tiles in ascending order).
pub fn emit_intersections(tiles_of_splat: &[Vec<u32>]) -> Intersections {
    let counts: Vec<u32> = tiles_of_splat.iter().map(|tiles| tiles.len() as u32).collect();
    let mut out = Intersections { first_of_splat: exclusive_scan(&counts).0, ..Intersections::default() };
    for (splat, tiles) in tiles_of_splat.iter().enumerate() {
        for &tile in tiles {
            out.tiles.push(tile);
            out.splats.push(splat as u32);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_follow_the_splats() {
        let out = emit_intersections(&[vec![1, 2], vec![], vec![0, 2]]);
        assert_eq!((out.tiles, out.splats, out.first_of_splat), (vec![1, 2, 0, 2], vec![0, 0, 2, 2], vec![0, 2, 2]));
    }
}
