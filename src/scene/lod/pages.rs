//! The background in pages, for scenes that are larger than memory.
//!
//! A page is a run of neighbouring blocks: their Gaussians at full detail and their finer levels. The coarser levels of each
//! block are its *stand-ins*: they are always in memory, and the finest of them is drawn for all of the block while its page is
//! not there. So pages may come in any order, and none of them leaves a hole.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::scene::bound::Bound;
use crate::scene::{Gaussians, SourceRange};

use super::blocks::{CHUNK, MOST, block_order};
use super::{NO_NEXT_CELL, TemplateLevel, merged_ladder};

/// Blocks of a page: with SH of degree 3 in f16 about 2 MB, which a disk reads in some ten times the time it takes to find them.
pub const BLOCKS_PER_PAGE: usize = 16;
/// Levels of at most this part of their block's Gaussians are stand-ins: together they are about an eighth of the scene.
const STAND_IN_PART: usize = 16;

/// A background in the order of its blocks, with levels and the table that says where they are.
#[derive(Clone, Debug, PartialEq)]
pub struct PagedBackground {
    /// The background, block by block.
    pub full: Gaussians,
    /// The finer levels of all blocks, in the order of the table.
    pub fine: Gaussians,
    /// The stand-ins of all blocks, in the order of the table.
    pub stand_ins: Gaussians,
    /// Where they are.
    pub table: PageTable,
}

/// A ball of [`Bound`] in f32: centre, radius, largest standard deviation.
pub type Ball = [f32; 5];

/// What is known of a background without its Gaussians: where they are, and how far they reach.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PageTable {
    /// Gaussians of each block at full detail.
    pub block_counts: Vec<u32>,
    /// Ball of each block at full detail.
    pub block_balls: Vec<Ball>,
    /// Balls of the chunks of 256 Gaussians of the blocks, block by block.
    pub block_chunks: Vec<Ball>,
    /// Levels, block by block, the finest first.
    pub levels: Vec<PagedLevel>,
    /// Balls of the chunks of 256 Gaussians of the levels, level by level.
    pub level_chunks: Vec<Ball>,
}

/// A level of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PagedLevel {
    /// Index of the block.
    pub block: u32,
    /// Its Gaussians.
    pub count: u32,
    /// True if it is always in memory.
    pub stands_in: bool,
    /// Side of the merged cells, scene units; [`NO_NEXT_CELL`] for a copy of a block that cannot be merged, which is drawn only
    /// while the block's page is not there.
    pub cell: f32,
}

/// What is wrong with a [`PageTable`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct PageTableError {
    /// The field of the table.
    pub field: &'static str,
    /// What is wrong with it.
    pub reason: String,
}

/// A ball around balls.
pub(crate) fn ball_around(balls: &[Ball]) -> Ball {
    let center = |ball: &Ball| Vec3::from_slice(ball).as_dvec3();
    let middle = balls.iter().map(center).sum::<DVec3>() / balls.len().max(1) as f64;
    let middle = middle.as_vec3();
    let reach = |ball: &Ball| center(ball).distance(middle.as_dvec3()) + f64::from(ball[3]);
    let radius = balls.iter().map(reach).fold(0.0, f64::max) * 1.000_001;
    let sigma_max = balls.iter().fold(0.0, |most, ball| ball[4].max(most));
    [middle.x, middle.y, middle.z, radius as f32, sigma_max]
}

/// Chunks of `count` Gaussians.
pub fn chunks_of(count: u32) -> usize {
    count.div_ceil(CHUNK as u32) as usize
}

impl PagedBackground {
    /// Cuts a background into blocks and makes their levels by merging.
    pub fn of(background: &Gaussians) -> Self {
        let sh_degree = background.sh_degree;
        let empty = || Gaussians { sh_degree, ..Gaussians::default() };
        let (order, blocks) = block_order(background);
        let mut full = Gaussians::with_capacity(sh_degree, background.len());
        order.iter().for_each(|&i| full.push_from(background, i as usize));
        let ladder = |&block: &SourceRange| merged_ladder(&full.range(block));
        let ladders: Vec<Vec<TemplateLevel>> = blocks.par_iter().map(ladder).collect();
        let (mut fine, mut stand_ins, mut table) = (empty(), empty(), PageTable::default());
        for (b, (&block, levels)) in blocks.iter().zip(&ladders).enumerate() {
            table.block_counts.push(block.count);
            table.block_balls.push(ball_of(&full, block));
            table.block_chunks.extend(chunk_balls(&full, block));
            let copy = full.range(block);
            let few = |level: &TemplateLevel| level.merged.len() * STAND_IN_PART <= block.count as usize;
            // The coarsest level stands in if none is small; without levels the block itself does.
            let first = levels.iter().position(few).unwrap_or(levels.len().saturating_sub(1));
            let merged = levels.iter().map(|level| (level.rung.cell, &level.merged));
            let alone = levels.is_empty().then_some((NO_NEXT_CELL, &copy));
            for (l, (cell, gaussians)) in merged.chain(alone).enumerate() {
                let (stands_in, count) = (l >= first, gaussians.len() as u32);
                let of = if stands_in { &mut stand_ins } else { &mut fine };
                let range = SourceRange { first: of.len() as u32, count };
                of.append(gaussians);
                table.level_chunks.extend(chunk_balls(of, range));
                table.levels.push(PagedLevel { block: b as u32, count, stands_in, cell });
            }
        }
        Self { full, fine, stand_ins, table }
    }
}

fn ball_of(cloud: &Gaussians, range: SourceRange) -> Ball {
    let Bound { center, radius, sigma_max } = Bound::of(cloud, range.first as usize, range.count as usize);
    let [x, y, z] = center.as_vec3().to_array();
    [x, y, z, crate::scene::bound::round_up(radius), crate::scene::bound::round_up(sigma_max)]
}

fn chunk_balls(cloud: &Gaussians, range: SourceRange) -> impl Iterator<Item = Ball> + '_ {
    (0..range.count).step_by(CHUNK).map(move |start| {
        let count = (range.count - start).min(CHUNK as u32);
        ball_of(cloud, SourceRange { first: range.first + start, count })
    })
}

/// A page of a background: where its parts are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// Its blocks.
    pub blocks: std::ops::Range<usize>,
    /// The levels of its blocks, stand-ins included.
    pub levels: std::ops::Range<usize>,
    /// Its rows of the background at full detail.
    pub full: SourceRange,
    /// Its rows of the finer levels.
    pub fine: SourceRange,
}

impl Page {
    /// Number of its Gaussians.
    pub fn rows(&self) -> u32 {
        self.full.count + self.fine.count
    }
}

impl PageTable {
    /// Number of Gaussians of the background, of finer levels, and of stand-ins.
    pub fn rows(&self) -> [u64; 3] {
        let of = |stands_in: bool| {
            self.levels.iter().filter(|level| level.stands_in == stands_in).map(|level| u64::from(level.count)).sum()
        };
        [self.block_counts.iter().map(|&count| u64::from(count)).sum(), of(false), of(true)]
    }

    /// The pages, which follow each other without gaps.
    pub fn pages(&self) -> Vec<Page> {
        let mut pages = Vec::with_capacity(self.block_counts.len().div_ceil(BLOCKS_PER_PAGE));
        let (mut full, mut fine, mut level) = (0, 0, 0);
        for first in (0..self.block_counts.len()).step_by(BLOCKS_PER_PAGE) {
            let blocks = first..(first + BLOCKS_PER_PAGE).min(self.block_counts.len());
            let levels = level..level + self.levels[level..].partition_point(|l| (l.block as usize) < blocks.end);
            let of_full = self.block_counts[blocks.clone()].iter().sum();
            let of_fine = self.levels[levels.clone()].iter().filter(|l| !l.stands_in).map(|l| l.count).sum();
            level = levels.end;
            pages.push(Page {
                blocks,
                levels,
                full: SourceRange { first: full, count: of_full },
                fine: SourceRange { first: fine, count: of_fine },
            });
            (full, fine) = (full + of_full, fine + of_fine);
        }
        pages
    }

    /// Checks a table that was read from a file.
    ///
    /// # Errors
    /// The first thing that is wrong: counts out of range, levels out of order, a block without stand-in, numbers that are not
    /// finite, or more Gaussians than 2^32 - 1.
    pub fn check(&self) -> Result<(), PageTableError> {
        let fail = |field, reason: String| Err(PageTableError { field, reason });
        let blocks = self.block_counts.len();
        if let Some(b) = self.block_counts.iter().position(|&count| count == 0 || count as usize > MOST) {
            return fail("block_counts", format!("block {b} has {} Gaussians, not 1 to {MOST}", self.block_counts[b]));
        }
        let mut next = 0;
        for (l, level) in self.levels.iter().enumerate() {
            let (block, before) = (level.block as usize, l.checked_sub(1).map(|before| self.levels[before]));
            let goes_on = before.is_some_and(|before| before.block as usize == block);
            if !goes_on && (block != next || before.is_some_and(|before| !before.stands_in)) || block >= blocks {
                return fail(
                    "levels",
                    format!("level {l} is of block {block}, where the stand-in of block {next} is missing"),
                );
            }
            next = block + 1;
            if level.count == 0 || level.count > self.block_counts[block] {
                return fail(
                    "levels",
                    format!("level {l} has {} Gaussians of {}", level.count, self.block_counts[block]),
                );
            }
            if !(level.cell > 0.0 && level.cell <= NO_NEXT_CELL)
                || goes_on
                    && before.is_some_and(|before| before.cell >= level.cell || before.stands_in && !level.stands_in)
            {
                return fail("levels", format!("level {l} is not coarser than the level before it"));
            }
        }
        if next != blocks || self.levels.last().is_some_and(|level| !level.stands_in) {
            return fail("levels", format!("the stand-in of block {} is missing", next.min(blocks.saturating_sub(1))));
        }
        let of_blocks: usize = self.block_counts.iter().map(|&count| chunks_of(count)).sum();
        let of_levels: usize = self.levels.iter().map(|level| chunks_of(level.count)).sum();
        for (field, balls, count) in [
            ("block_balls", &self.block_balls, blocks),
            ("block_chunks", &self.block_chunks, of_blocks),
            ("level_chunks", &self.level_chunks, of_levels),
        ] {
            if balls.len() != count {
                return fail(field, format!("has {} balls, not {count}", balls.len()));
            }
            let is_ball = |ball: &Ball| ball.iter().all(|v| v.is_finite()) && ball[3] >= 0.0 && ball[4] >= 0.0;
            if let Some(at) = balls.iter().position(|ball| !is_ball(ball)) {
                return fail(field, format!("ball {at} is not finite, or has a size below 0"));
            }
        }
        match self.rows().into_iter().sum::<u64>() {
            rows if rows >= u64::from(u32::MAX) => {
                fail("block_counts", format!("{rows} Gaussians are more than 2^32 - 2"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Small Gaussians on a wavy ground, and one that is larger than all cells.
    fn ground(count: usize) -> Gaussians {
        let mut rng = Rng::new(7);
        let mut cloud = Gaussians::with_capacity(1, count);
        for i in 0..count {
            let (x, y) = (rng.range(-10.0, 10.0), rng.range(-10.0, 10.0));
            cloud.means.push([x as f32, y as f32, (x.sin() * y.cos()) as f32]);
            cloud.quats.push([1.0, 0.1, 0.0, 0.0]);
            cloud.log_scales.push([if i == 5 { 6.0 } else { -3.0 }; 3]);
            cloud.opacity_logits.push(rng.range(-1.0, 3.0) as f32);
            (0..4).for_each(|_| cloud.sh.push([rng.range(-1.0, 1.0) as f32; 3]));
        }
        cloud
    }

    #[test]
    fn pages_cover_the_background_and_stand_ins_are_few() {
        let cloud = ground(30_000);
        let paged = PagedBackground::of(&cloud);
        paged.table.check().unwrap();
        let rows = paged.table.rows();
        assert_eq!(rows, [&paged.full, &paged.fine, &paged.stand_ins].map(|cloud| cloud.len() as u64));
        assert_eq!(rows[0], 30_000);
        assert!(rows[2] > 0 && rows[2] * 5 < rows[0], "{rows:?}");
        let pages = paged.table.pages();
        assert_eq!(pages.len(), paged.table.block_counts.len().div_ceil(BLOCKS_PER_PAGE));
        let ends = pages.iter().fold((0, 0), |(full, fine), page| {
            assert_eq!((page.full.first, page.fine.first), (full, fine));
            (full + page.full.count, fine + page.fine.count)
        });
        assert_eq!((u64::from(ends.0), u64::from(ends.1)), (rows[0], rows[1]));
        // Full detail is the background in another order.
        let sorted = |cloud: &Gaussians| {
            let mut means: Vec<[u32; 3]> = cloud.means.iter().map(|m| m.map(f32::to_bits)).collect();
            means.sort_unstable();
            means
        };
        assert_eq!(sorted(&paged.full), sorted(&cloud));
    }

    #[test]
    fn what_cannot_be_merged_stands_in_for_itself() {
        let mut cloud = ground(10);
        cloud.log_scales.fill([6.0; 3]);
        let PagedBackground { stand_ins, fine, table, full } = PagedBackground::of(&cloud);
        table.check().unwrap();
        assert_eq!((stand_ins, fine.len()), (full, 0));
        assert_eq!(table.levels[0].cell, NO_NEXT_CELL);
        let none = PagedBackground::of(&Gaussians::default());
        none.table.check().unwrap();
        assert!(none.table.pages().is_empty());
    }

    #[test]
    fn damaged_tables_are_refused() {
        let table = PagedBackground::of(&ground(3000)).table;
        let broken = |change: fn(&mut PageTable)| {
            let mut table = table.clone();
            change(&mut table);
            table.check().map_err(|error| error.field)
        };
        assert_eq!(broken(|_| ()), Ok(()));
        assert_eq!(broken(|t| t.block_counts[1] = 0), Err("block_counts"));
        assert_eq!(broken(|t| t.block_counts[1] = 513), Err("block_counts"));
        assert_eq!(broken(|t| t.levels[0].block = 1), Err("levels"));
        assert_eq!(broken(|t| t.levels.iter_mut().for_each(|l| l.stands_in = false)), Err("levels"));
        assert_eq!(
            broken(|t| {
                t.levels.pop();
            }),
            Err("levels")
        );
        assert_eq!(broken(|t| t.levels.clear()), Err("levels"));
        assert_eq!(broken(|t| t.levels[0].count = 600), Err("levels"));
        assert_eq!(broken(|t| t.levels[0].cell = f32::NAN), Err("levels"));
        assert_eq!(broken(|t| t.levels[1].cell = t.levels[0].cell), Err("levels"));
        assert_eq!(broken(|t| t.levels.last_mut().unwrap().block = 900), Err("levels"));
        assert_eq!(
            broken(|t| {
                t.block_balls.pop();
            }),
            Err("block_balls")
        );
        assert_eq!(broken(|t| t.block_chunks[0][3] = -1.0), Err("block_chunks"));
        assert_eq!(broken(|t| t.level_chunks[0][0] = f32::INFINITY), Err("level_chunks"));
    }
}
