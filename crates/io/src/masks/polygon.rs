//! The pixels of polygons.

use super::shape::Span;

/// Corners in pixels from the picture's top left corner; the last one is joined to the first.
pub(super) type Polygon = Vec<[f64; 2]>;

/// Corners beyond that, in pixels, are errors of a file; what is nearer cannot overflow.
const FARTHEST_PX: f64 = 1e7;

/// One edge that is not level, from its upper to its lower end.
struct Edge {
    polygon: usize,
    top: f64,
    bottom: f64,
    x_at_top: f64,
    x_per_row: f64,
}

/// Checks that all corners are numbers that a picture can have.
///
/// # Errors
/// A corner that is farther than any picture reaches.
pub(super) fn check(polygon: &Polygon) -> Result<(), String> {
    match polygon.iter().flatten().find(|v| v.is_nan() || v.abs() > FARTHEST_PX) {
        Some(v) => Err(format!("has the coordinate {v:e}, which is in no picture")),
        None => Ok(()),
    }
}

/// Visits the pixels of a picture whose centres are in at least one polygon, as parts of rows that do not overlap. A polygon
/// that crosses itself has holes where it covers twice.
pub(super) fn for_each(polygons: &[Polygon], (width, height): (u32, u32), visit: &mut impl FnMut(Span)) {
    let mut edges: Vec<Edge> = polygons.iter().enumerate().flat_map(|(i, polygon)| edges_of(i, polygon)).collect();
    edges.sort_by(|a, b| a.top.total_cmp(&b.top));
    let bottom = edges.iter().map(|edge| edge.bottom).fold(f64::NEG_INFINITY, f64::max);
    let first = edges.first().map_or(0, |edge| edge.top.max(0.0) as u32);
    let rows = first..height.min(bottom.max(0.0).ceil() as u32);
    let (mut next, mut crossed): (usize, Vec<&Edge>) = (0, Vec::new());
    let mut crossings: Vec<(usize, f64)> = Vec::new();
    let mut parts: Vec<(u32, u32)> = Vec::new();
    for y in rows {
        let center = f64::from(y) + 0.5;
        while let Some(edge) = edges.get(next).filter(|edge| edge.top <= center) {
            crossed.push(edge);
            next += 1;
        }
        crossed.retain(|edge| edge.bottom > center);
        crossings.clear();
        let place = |edge: &&Edge| (edge.polygon, edge.x_at_top + (center - edge.top) * edge.x_per_row);
        crossings.extend(crossed.iter().map(place));
        crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        // A closed line crosses every row an even number of times.
        let column = |x: f64| ((x - 0.5).ceil().max(0.0) as u32).min(width);
        parts.clear();
        parts.extend(crossings.as_chunks::<2>().0.iter().map(|[a, b]| (column(a.1), column(b.1))));
        for_each_union(&mut parts, |from, to| visit(Span::Row { y, from, to }));
    }
}

/// The edges of a polygon, but for level ones, which no row crosses.
fn edges_of(number: usize, polygon: &Polygon) -> impl Iterator<Item = Edge> {
    let ends = polygon.iter().zip(polygon.iter().cycle().skip(1));
    ends.filter(|(a, b)| a[1] != b[1]).map(move |(a, b)| {
        let (upper, lower) = if a[1] < b[1] { (a, b) } else { (b, a) };
        let x_per_row = (lower[0] - upper[0]) / (lower[1] - upper[1]);
        Edge { polygon: number, top: upper[1], bottom: lower[1], x_at_top: upper[0], x_per_row }
    })
}

/// Visits the union of parts of a row, from left to right; they are sorted in place.
fn for_each_union(parts: &mut [(u32, u32)], mut visit: impl FnMut(u32, u32)) {
    parts.sort_unstable();
    let mut open: Option<(u32, u32)> = None;
    for &(from, to) in parts.iter().filter(|(from, to)| from < to) {
        match &mut open {
            Some((_, end)) if from <= *end => *end = to.max(*end),
            _ => {
                if let Some((from, to)) = open.replace((from, to)) {
                    visit(from, to);
                }
            }
        }
    }
    if let Some((from, to)) = open {
        visit(from, to);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture_of(polygons: &[Polygon], size: (u32, u32)) -> Vec<String> {
        let mut rows = vec![vec!['.'; size.0 as usize]; size.1 as usize];
        for_each(polygons, size, &mut |span| {
            if let Span::Row { y, from, to } = span {
                for x in from..to {
                    let pixel = &mut rows[y as usize][x as usize];
                    // A pixel that is visited twice is seen.
                    *pixel = if *pixel == '.' { '#' } else { '2' };
                }
            }
        });
        rows.into_iter().map(String::from_iter).collect()
    }

    #[test]
    fn pixels_are_those_whose_centres_are_inside() {
        let square = vec![[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]];
        assert_eq!(picture_of(std::slice::from_ref(&square), (6, 4)), ["......", ".###..", ".###..", "......"]);
        // The same square twice, and another that overlaps it: no pixel twice.
        let other = vec![[3.0, 2.0], [3.0, 9.0], [99.0, 9.0], [99.0, 2.0]];
        let both = picture_of(&[square.clone(), square, other], (6, 4));
        assert_eq!(both, ["......", ".###..", ".#####", "...###"]);
        let triangle = vec![[0.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        assert_eq!(picture_of(&[triangle], (4, 4)), ["....", "#...", "##..", "###."]);
        // Where two loops cross, the left and the right part are inside.
        let bow = vec![[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]];
        assert_eq!(picture_of(&[bow], (4, 4)), ["...#", "#.##", "#.##", "...#"]);
    }

    #[test]
    fn nothing_is_drawn_of_what_has_no_area() {
        for polygon in
            [vec![], vec![[1.0, 1.0]], vec![[0.0, 0.0], [3.0, 3.0]], vec![[-9.0, -9.0], [-5.0, -9.0], [-5.0, -2.0]]]
        {
            assert!(picture_of(&[polygon], (4, 4)).iter().all(|row| row == "...."));
        }
        assert!(check(&vec![[0.0, 1e300]]).is_err() && check(&vec![[f64::NAN, 0.0]]).is_err());
        assert!(check(&vec![[-5.0, 1e6]]).is_ok());
    }
}
