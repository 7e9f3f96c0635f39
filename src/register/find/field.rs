//! Where points are, to be looked up fast: cells that hold a point, and their neighbours.

use glam::{DVec3, IVec3};

/// Cells of a block along an edge; blocks are stored where there is anything.
const EDGE: i32 = 8;
const BLOCK: usize = (EDGE * EDGE * EDGE) as usize;
/// Most blocks along an edge of the field: what is farther from the origin is not in it.
const MOST_BLOCKS: i32 = 256;
/// What a cell is worth that holds a point, and one beside such a cell.
const HELD: u8 = 3;
const BESIDE: u8 = 2;

/// A sparse grid of cells.
pub(super) struct Field {
    cell: f64,
    /// First block, in blocks.
    low: IVec3,
    /// Number of blocks.
    blocks: IVec3,
    /// By block: its place in `values`, or none.
    index: Vec<u32>,
    values: Vec<[u8; BLOCK]>,
}

impl Field {
    /// Of points about the origin.
    pub(super) fn new(points: &[DVec3], cell: f64) -> Self {
        let most = IVec3::splat(MOST_BLOCKS / 2 * EDGE - 1);
        let cells: Vec<IVec3> =
            points.iter().map(|p| (*p / cell).floor().as_ivec3()).filter(|c| c.abs().cmple(most).all()).collect();
        let wider = |(low, high): (IVec3, IVec3), c: &IVec3| (low.min(*c), high.max(*c));
        let (low, high) = cells.iter().fold((IVec3::ZERO, IVec3::ZERO), wider);
        let block = |c: IVec3| c.map(|v| v.div_euclid(EDGE));
        let low = block(low - 1);
        let blocks = block(high + 1) - low + 1;
        let count = (blocks.x * blocks.y * blocks.z) as usize;
        let mut out = Self { cell, low, blocks, index: vec![u32::MAX; count], values: Vec::new() };
        for c in cells {
            for x in -1..=1 {
                for y in -1..=1 {
                    for z in -1..=1 {
                        let step = IVec3::new(x, y, z);
                        out.raise(c + step, if step == IVec3::ZERO { HELD } else { BESIDE });
                    }
                }
            }
        }
        out
    }

    fn raise(&mut self, c: IVec3, value: u8) {
        let Some((block, inside)) = self.place(c) else { return };
        if self.index[block] == u32::MAX {
            self.index[block] = self.values.len() as u32;
            self.values.push([0; BLOCK]);
        }
        let cell = &mut self.values[self.index[block] as usize][inside];
        *cell = (*cell).max(value);
    }

    /// Block and place in it of a cell.
    fn place(&self, c: IVec3) -> Option<(usize, usize)> {
        let block = c.map(|v| v >> 3) - self.low;
        let is_inside = block.cmpge(IVec3::ZERO).all() && block.cmplt(self.blocks).all();
        let inside = c & (EDGE - 1);
        is_inside.then(|| {
            (
                ((block.z * self.blocks.y + block.y) * self.blocks.x + block.x) as usize,
                ((inside.z * EDGE + inside.y) * EDGE + inside.x) as usize,
            )
        })
    }

    /// Edge of a cell, scene units.
    pub(super) fn cell(&self) -> f64 {
        self.cell
    }

    /// 1 where a point is in the same cell, 2/3 where one is in a neighbouring cell, else 0.
    pub(super) fn at(&self, p: DVec3) -> f32 {
        let Some((block, inside)) = self.place((p / self.cell).floor().as_ivec3()) else { return 0.0 };
        match self.index[block] {
            u32::MAX => 0.0,
            at => f32::from(self.values[at as usize][inside]) / f32::from(HELD),
        }
    }
}
