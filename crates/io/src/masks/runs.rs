//! Run-length masks as COCO has them: lengths of runs, column by column from the top left, the first one outside.

use super::shape::Span;

/// A mask as lengths of runs, which are outside and inside in turn and fill its pixels exactly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Runs {
    counts: Vec<u32>,
    width: u32,
    height: u32,
}

impl Runs {
    /// Runs of a mask of `width` by `height` pixels.
    ///
    /// # Errors
    /// The lengths do not add up to its pixels.
    pub(super) fn new(counts: Vec<u32>, (width, height): (u32, u32)) -> Result<Self, String> {
        let (have, want) = (counts.iter().map(|&n| u64::from(n)).sum::<u64>(), u64::from(width) * u64::from(height));
        if have != want {
            return Err(format!("its runs have {have} pixels, and its size of {width}x{height} has {want}"));
        }
        Ok(Self { counts, width, height })
    }

    /// Runs from the text that pycocotools writes: each length in groups of 5 bits, lowest first, one character for a group
    /// from `0` on, 32 more if another group follows. From the fourth on lengths are differences to the one two before.
    ///
    /// # Errors
    /// A character that is none of its 64, a length outside of 0 to 2^32 - 1, or those of [`Self::new`].
    pub(super) fn of_text(text: &str, size: (u32, u32)) -> Result<Self, String> {
        let mut counts: Vec<u32> = Vec::new();
        let mut bytes = text.bytes().enumerate();
        while let Some(first) = bytes.next() {
            let (mut value, mut shift, mut next) = (0i64, 0u32, Some(first));
            loop {
                let Some((at, byte)) = next else { return Err("its text of runs ends within a length".into()) };
                let group = byte.checked_sub(b'0').filter(|&group| group < 64 && shift <= 35);
                let group = group.ok_or_else(|| format!("character {} of its runs is none of COCO's code", at + 1))?;
                value |= i64::from(group & 31) << shift;
                shift += 5;
                if group & 32 == 0 {
                    // The sign is the highest bit of the last group.
                    if group & 16 != 0 {
                        value -= 1 << shift;
                    }
                    break;
                }
                next = bytes.next();
            }
            let before = if counts.len() > 2 { i64::from(counts[counts.len() - 2]) } else { 0 };
            let length = u32::try_from(value + before);
            counts.push(length.map_err(|_| format!("its run {} has the length {}", counts.len(), value + before))?);
        }
        Self::new(counts, size)
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of the pixels inside.
    pub(super) fn area(&self) -> u64 {
        self.counts.iter().skip(1).step_by(2).map(|&n| u64::from(n)).sum()
    }

    /// Visits the pixels inside, as parts of columns.
    pub(super) fn for_each(&self, visit: &mut impl FnMut(Span)) {
        let height = u64::from(self.height);
        let mut at = 0u64;
        for (k, &count) in self.counts.iter().enumerate() {
            let end = at + u64::from(count);
            // Without pixels all lengths are 0, so that the height divides nothing.
            while k % 2 == 1 && at < end {
                let (x, y) = (at / height, at % height);
                let to = (y + end - at).min(height);
                visit(Span::Column { x: x as u32, from: y as u32, to: to as u32 });
                at += to - y;
            }
            at = end;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture of 9x6 pixels whose runs the tests have.
    const PICTURE: [&str; 6] = ["........#", "..###....", "..#.#....", "..###....", ".........", "#########"];
    const COUNTS: [u32; 26] = [5, 1, 5, 1, 1, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 3, 1, 1, 5, 1, 5, 1, 5, 2, 4, 1];

    fn picture_of(runs: &Runs) -> Vec<String> {
        let mut rows = vec![vec!['.'; runs.width as usize]; runs.height as usize];
        runs.for_each(&mut |span| match span {
            Span::Column { x, from, to } => (from..to).for_each(|y| rows[y as usize][x as usize] = '#'),
            Span::Row { .. } => rows.clear(),
        });
        rows.into_iter().map(String::from_iter).collect()
    }

    /// The text is what pycocotools 2.0.11 wrote for the picture.
    #[test]
    fn lists_and_text_are_the_picture_that_pycocotools_had() -> Result<(), String> {
        let list = Runs::new(COUNTS.to_vec(), (9, 6))?;
        assert_eq!((picture_of(&list), list.area()), (PICTURE.map(String::from).into(), 18));
        assert_eq!(Runs::of_text("5150L20N000000020N400001OO", (9, 6))?, list);
        // Lengths of several characters, of 400x300 pixels.
        let large =
            "`Ym0`Ym0od>[oROoPDiGjbM00000000000000000000000000000000000000000000000000000000000000000000000000000XXm0";
        let large = Runs::of_text(large, (400, 300))?;
        assert_eq!((large.area(), &large.counts[..6]), (31_083, &[30_000, 30_000, 15_007, 283, 2750, 20][..]));
        Ok(())
    }

    #[test]
    fn damaged_runs_are_named() {
        let of = |text: &str| Runs::of_text(text, (9, 6)).err().unwrap_or_default();
        assert!(of("5150L20N00000002").contains("54"), "{}", of("5150L20N00000002"));
        assert!(of("51 0").contains("character 3") && of("Po").contains("within a length"), "{}", of("Po"));
        assert!(of("oooooooooo0").contains("character 9") && of("O").contains("length -1"), "{}", of("O"));
        assert!(Runs::new(vec![u32::MAX; 3], (9, 6)).is_err() && Runs::new(vec![0, 0], (0, 5)).is_ok());
    }
}
