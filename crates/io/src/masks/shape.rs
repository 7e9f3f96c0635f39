//! The objects of one photo as shapes, and the mask that they make together.

use std::cmp::Reverse;

use super::Mask;
use super::polygon::{self, Polygon};
use super::runs::Runs;

/// Pixels of a row or a column of a picture, `to` not included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Span {
    /// Of the row `y`.
    Row { y: u32, from: u32, to: u32 },
    /// Of the column `x`.
    Column { x: u32, from: u32, to: u32 },
}

impl Span {
    fn pixels(self) -> u64 {
        let (Self::Row { from, to, .. } | Self::Column { from, to, .. }) = self;
        u64::from(to.saturating_sub(from))
    }
}

/// The pixels of an object in one photo.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Lengths of runs.
    Runs(Runs),
    /// What is in at least one of these.
    Polygons(Vec<Polygon>),
    /// A disk, pixels.
    Disk { center: [f64; 2], radius: f64 },
    /// Parts of rows (y, from, to), each pixel once.
    Rows(Vec<[u32; 3]>),
}

impl Shape {
    /// The pixels above 0 of a mask that lies in a picture with its corner at `left`, `top`.
    pub(super) fn of_mask(mask: &Mask, (left, top): (u32, u32)) -> Self {
        let mut rows = Vec::new();
        for (y, row) in (0u32..).zip(mask.ids.chunks_exact(mask.width.max(1) as usize)) {
            let mut x = 0u32;
            for run in row.chunk_by(|a, b| (*a == 0) == (*b == 0)) {
                let end = x + run.len() as u32;
                if run[0] != 0 {
                    rows.push([y, x, end].map(u64::from));
                }
                x = end;
            }
        }
        // What a corner far outside would make overflow lies in no picture.
        let moved = |[y, from, to]: [u64; 3]| [y + u64::from(top), from + u64::from(left), to + u64::from(left)];
        let fits = |row: [u64; 3]| {
            Some([u32::try_from(row[0]).ok()?, u32::try_from(row[1]).ok()?, u32::try_from(row[2]).ok()?])
        };
        Self::Rows(rows.into_iter().map(moved).filter_map(fits).collect())
    }

    /// Visits the pixels within a picture of this size, each once.
    fn for_each(&self, size: (u32, u32), visit: &mut impl FnMut(Span)) {
        match self {
            Self::Runs(runs) => runs.for_each(visit),
            Self::Polygons(polygons) => polygon::for_each(polygons, size, visit),
            Self::Disk { center: [x, y], radius } => {
                let row = |v: f64| (v.max(0.0) as u32).min(size.1);
                for at in row(y - radius)..row((y + radius).ceil()) {
                    let half = (radius * radius - (f64::from(at) + 0.5 - y).powi(2)).max(0.0).sqrt();
                    let column = |x: f64| ((x - 0.5).ceil().max(0.0) as u32).min(size.0);
                    visit(Span::Row { y: at, from: column(x - half), to: column(x + half) });
                }
            }
            Self::Rows(rows) => {
                for &[y, from, to] in rows.iter().filter(|row| row[0] < size.1) {
                    visit(Span::Row { y, from, to: to.min(size.0) });
                }
            }
        }
    }

    /// Number of its pixels in a picture of this size.
    fn area(&self, size: (u32, u32)) -> u64 {
        if let Self::Runs(runs) = self {
            return runs.area();
        }
        let mut area = 0;
        self.for_each(size, &mut |span| area += span.pixels());
        area
    }
}

/// How the pixels of masks lie on those of a photo: masks may be larger than it by a whole factor, as those of the full size
/// are beside photos of half the size. The pixel at the centre counts, so that no ids arise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    /// Width and height of the masks, pixels.
    size: (u32, u32),
    /// Width and height of the photo, pixels.
    photo: (u32, u32),
    /// The factor, at least 1.
    step: u32,
}

impl Grid {
    /// The grid of masks of one size on a photo of another; `None` if they do not match.
    pub(super) fn new(size: (u32, u32), photo: (u32, u32)) -> Option<Self> {
        let step = size.0.checked_div(photo.0).filter(|&step| step > 0)?;
        let matches = photo.0.checked_mul(step) == Some(size.0) && photo.1.checked_mul(step) == Some(size.1);
        matches.then_some(Self { size, photo, step })
    }

    /// The first pixel of the photo whose centre is at `at` or beyond, along one axis.
    fn first_from(self, at: u32) -> usize {
        at.saturating_sub(self.step / 2).div_ceil(self.step) as usize
    }

    /// The pixel of the photo whose centre is at `at`, if there is one.
    fn exactly(self, at: u32) -> Option<usize> {
        (at % self.step == self.step / 2).then_some((at / self.step) as usize)
    }

    fn paint(self, ids: &mut [u16], span: Span, id: u16) {
        let width = self.photo.0 as usize;
        match span {
            Span::Row { y, from, to } if from < to => {
                if let Some(j) = self.exactly(y) {
                    ids[j * width + self.first_from(from)..j * width + self.first_from(to)].fill(id);
                }
            }
            Span::Column { x, from, to } if from < to => {
                if let Some(i) = self.exactly(x) {
                    (self.first_from(from)..self.first_from(to)).for_each(|j| ids[j * width + i] = id);
                }
            }
            _ => {}
        }
    }
}

/// The mask of a photo from its objects, each an id and a shape. Where shapes overlap, the one with fewer pixels wins, of
/// equal ones the later: a wheel that is drawn upon a car stays, in whatever order they are listed.
pub(super) fn draw<'a>(objects: impl Iterator<Item = (u16, &'a Shape)>, grid: Grid) -> Mask {
    let mut by_area: Vec<(u64, u16, &Shape)> = objects.map(|(id, shape)| (shape.area(grid.size), id, shape)).collect();
    // Stable, so that equal ones stay in the order of the list.
    by_area.sort_by_key(|(area, ..)| Reverse(*area));
    let (width, height) = grid.photo;
    let mut ids = vec![0; width as usize * height as usize];
    for (_, id, shape) in by_area {
        shape.for_each(grid.size, &mut |span| grid.paint(&mut ids, span, id));
    }
    Mask { width, height, ids }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(from: f64, to: f64) -> Shape {
        Shape::Polygons(vec![vec![[from, from], [to, from], [to, to], [from, to]]])
    }

    fn drawn(objects: &[(u16, Shape)], size: (u32, u32), photo: (u32, u32)) -> Vec<u16> {
        let objects = objects.iter().map(|(id, shape)| (*id, shape));
        Grid::new(size, photo).map(|grid| draw(objects, grid).ids).unwrap_or_default()
    }

    #[test]
    fn the_smaller_shape_wins_and_of_equal_ones_the_later() {
        let want = [1, 1, 1, 1, 2, 2, 1, 2, 2];
        for objects in [[(1, square(0.0, 3.0)), (2, square(1.0, 3.0))], [(2, square(1.0, 3.0)), (1, square(0.0, 3.0))]]
        {
            assert_eq!(drawn(&objects, (3, 3), (3, 3)), want);
        }
        assert_eq!(drawn(&[(1, square(0.0, 1.0)), (2, square(0.0, 1.0))], (1, 1), (1, 1)), [2]);
    }

    /// Masks of three times the photo's size are what their reduction is.
    #[test]
    fn larger_masks_count_at_centres_like_reduced_ones() {
        let ids: Vec<u16> = (0..12 * 9u32).map(|i| u16::from((i * i / 7 + i) % 3 == 0)).collect();
        let mask = Mask { width: 12, height: 9, ids };
        let columns = |mask: &Mask| {
            let by_column = (0..mask.width).flat_map(|x| (0..mask.height).map(move |y| (x, y)));
            let inside: Vec<bool> = by_column.map(|(x, y)| mask.ids[(y * mask.width + x) as usize] != 0).collect();
            let mut counts = if inside[0] { vec![0] } else { vec![] };
            counts.extend(inside.chunk_by(|a, b| a == b).map(|run| run.len() as u32));
            Runs::new(counts, (mask.width, mask.height))
        };
        for (shape, name) in [(Shape::of_mask(&mask, (0, 0)), "rows"), (Shape::Runs(columns(&mask).unwrap()), "runs")] {
            assert_eq!(drawn(&[(1, shape)], (12, 9), (4, 3)), mask.resized(4, 3).ids, "{name}");
        }
        for (size, photo) in [((4, 3), (12, 9)), ((12, 8), (4, 3)), ((5, 5), (0, 0)), ((0, 0), (2, 2))] {
            assert_eq!(Grid::new(size, photo), None);
        }
    }

    #[test]
    fn disks_and_masks_off_the_picture_are_cut() {
        let disk = Shape::Disk { center: [2.0, 2.0], radius: 1.2 };
        assert_eq!(drawn(&[(1, disk)], (4, 4), (4, 4)), [0, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0]);
        let wide = Shape::Disk { center: [-3.0, 1.0], radius: 100.0 };
        assert_eq!(drawn(&[(1, wide)], (2, 2), (2, 2)), [1; 4]);
        let mask = Mask { width: 2, height: 1, ids: vec![5, 9] };
        let at = |x, y| drawn(&[(1, Shape::of_mask(&mask, (x, y)))], (2, 2), (2, 2));
        assert_eq!((at(1, 1), at(9, 0), at(0, u32::MAX)), (vec![0, 0, 0, 1], vec![0; 4], vec![0; 4]));
        assert_eq!(at(u32::MAX, 0), [0; 4]);
    }
}
