//! Occupancy grid for fast lookups: cells that contain a point, and their neighbours.

use glam::{DVec3, IVec3, Vec3};

/// Cells along an edge of a block, a power of two; only occupied blocks are stored.
const EDGE: i32 = 8;
/// Number of cells in a block.
const BLOCK: usize = (EDGE * EDGE * EDGE) as usize;
/// Points farther from the origin than this many cells are dropped: a limit of 64 MB of blocks and at least 75 sizes of
/// an object.
const FARTHEST: i32 = 1024;
/// Value of a cell that contains a point.
const HELD: u8 = 3;
/// Value of a cell next to one that contains a point.
const BESIDE: u8 = 2;

/// A sparse occupancy grid about the origin.
pub(super) struct Field {
    cell: f64,
    /// First cell, the lowest corner of the first block.
    low: IVec3,
    /// Number of blocks along each axis.
    blocks: IVec3,
    /// By block: its index in `values`; 0 is the shared empty block.
    index: Vec<u32>,
    values: Vec<[u8; BLOCK]>,
}

impl Field {
    /// Occupancy of `points` in cells with the given edge, scene units.
    pub(super) fn new(points: &[DVec3], cell: f64) -> Self {
        let most = IVec3::splat(FARTHEST);
        let near = |c: &IVec3| c.cmpgt(-most).all() && c.cmplt(most).all();
        let cells: Vec<IVec3> = points.iter().map(|p| (*p / cell).floor().as_ivec3()).filter(near).collect();
        let wider = |(low, high): (IVec3, IVec3), c: &IVec3| (low.min(*c), high.max(*c));
        let (low, high) = cells.iter().fold((IVec3::ZERO, IVec3::ZERO), wider);
        let (low, blocks) = (low - 1, (high - low + 3 + EDGE - 1) / EDGE);
        let index = vec![0; blocks.element_product() as usize];
        let mut out = Self { cell, low, blocks, index, values: vec![[0; BLOCK]] };
        for c in cells {
            for k in 0..27 {
                let step = IVec3::new(k % 3, k / 3 % 3, k / 9) - 1;
                out.raise(c + step - low, if step == IVec3::ZERO { HELD } else { BESIDE });
            }
        }
        out
    }

    /// Raises the value of a cell, counted from the first one, to at least `value`.
    fn raise(&mut self, c: IVec3, value: u8) {
        let (block, inside) = self.place(c);
        if self.index[block] == 0 {
            self.index[block] = self.values.len() as u32;
            self.values.push([0; BLOCK]);
        }
        let cell = &mut self.values[self.index[block] as usize][inside];
        *cell = (*cell).max(value);
    }

    /// Block of a cell, counted from the first one, and its index in the block.
    fn place(&self, c: IVec3) -> (usize, usize) {
        let (block, inside) = (c / EDGE, c & (EDGE - 1));
        (
            ((block.z * self.blocks.y + block.y) * self.blocks.x + block.x) as usize,
            ((inside.z * EDGE + inside.y) * EDGE + inside.x) as usize,
        )
    }

    /// Edge of a cell, scene units.
    pub(super) fn cell(&self) -> f64 {
        self.cell
    }

    /// A point in cells from the lowest corner, as [`Field::at`] takes it. Differences of points are vectors in cells.
    pub(super) fn in_cells(&self, p: DVec3) -> Vec3 {
        (p / self.cell - self.low.as_dvec3()).as_vec3()
    }

    /// 1 if a point is in the same cell, 2/3 if one is in a neighbouring cell, else 0.
    pub(super) fn at(&self, p: Vec3) -> f32 {
        let end = (self.blocks * EDGE).as_vec3();
        // Written out, because a call of `floor` is slower than all the rest.
        if !(p.x >= 0.0 && p.y >= 0.0 && p.z >= 0.0 && p.x < end.x && p.y < end.y && p.z < end.z) {
            return 0.0;
        }
        let (block, inside) = self.place(IVec3::new(p.x as i32, p.y as i32, p.z as i32));
        f32::from(self.values[self.index[block] as usize][inside]) / f32::from(HELD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// Compared with a search of all points, also outside of their bounds and far beyond the grid.
    #[test]
    fn cells_know_what_is_in_and_beside_them() {
        let mut rng = Rng::new(1);
        let points: Vec<DVec3> = (0..60).map(|_| 3.0 * rng.normal_vector()).chain([DVec3::X * 1e9]).collect();
        let field = Field::new(&points, 0.5);
        let cell = |p: DVec3| (p / 0.5).floor();
        for _ in 0..4000 {
            let p = 6.0 * rng.normal_vector();
            let nearest = points.iter().map(|q| (cell(*q) - cell(p)).abs().max_element()).fold(9.0, f64::min);
            let want = [1.0, 2.0 / 3.0, 0.0][nearest.min(2.0) as usize];
            assert_eq!(field.at(field.in_cells(p)), want, "{p}");
        }
        assert_eq!(field.at(field.in_cells(DVec3::X * 1e9)), 0.0);
        assert_eq!(field.at(Vec3::NAN), 0.0);
        assert_eq!(Field::new(&[], 1.0).at(Vec3::ZERO), 0.0);
    }
}
