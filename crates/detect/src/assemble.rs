//! The masks of one view as one picture of ids.

use crate::io::Mask;

/// Paints masks over each other: where they overlap, the one with fewer pixels lies in front, of equally large ones the
/// one that came first. So a vase stays visible on its table, and the order in which masks come says nothing, except
/// between equals.
#[derive(Clone, Debug)]
pub struct MaskPainter {
    size: (usize, usize),
    /// One more than the index of the mask each pixel shows, 0 for none.
    shown: Vec<u16>,
    /// Pixels of each mask, whether shown or not.
    areas: Vec<usize>,
}

/// What became of the masks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Painted {
    /// The picture.
    pub mask: Mask,
    /// The id of each mask; 0 of those that show nowhere.
    pub ids: Vec<u16>,
    /// Masks without a pixel.
    pub empty: usize,
    /// Masks that others cover wholly.
    pub covered: usize,
}

impl MaskPainter {
    /// An empty picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { size: (width, height), shown: vec![0; width * height], areas: Vec::new() }
    }

    /// Adds a mask: its pixels are those whose logits are above 0, row by row.
    pub fn add(&mut self, logits: &[f32]) {
        let area = logits.iter().filter(|l| **l > 0.0).count();
        self.areas.push(area);
        // With more masks than ids there will be no picture.
        let Ok(own) = u16::try_from(self.areas.len()) else { return };
        for (shown, _) in self.shown.iter_mut().zip(logits).filter(|(_, logit)| **logit > 0.0) {
            if *shown == 0 || area < self.areas[usize::from(*shown) - 1] {
                *shown = own;
            }
        }
    }

    /// The picture with an id for each mask that shows, in the order they came: `used` ids are taken, the next is the
    /// first. `None` if ids run out.
    pub fn finish(self, used: usize) -> Option<Painted> {
        u16::try_from(self.areas.len()).ok()?;
        let mut pixels = vec![0usize; self.areas.len() + 1];
        self.shown.iter().for_each(|shown| pixels[usize::from(*shown)] += 1);
        let mut next = used;
        let mut ids = Vec::with_capacity(self.areas.len());
        for shown in &pixels[1..] {
            next += usize::from(*shown > 0);
            ids.push(if *shown > 0 { u16::try_from(next).ok()? } else { 0 });
        }
        let id = |shown: &u16| usize::from(*shown).checked_sub(1).map_or(0, |i| ids[i]);
        let painted = self.shown.iter().map(id).collect();
        let empty = self.areas.iter().filter(|a| **a == 0).count();
        let covered = ids.iter().filter(|id| **id == 0).count() - empty;
        let (width, height) = (self.size.0 as u32, self.size.1 as u32);
        Some(Painted { mask: Mask { width, height, ids: painted }, ids, empty, covered })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IN: f32 = 0.5;
    const OUT: f32 = -0.5;

    fn painted(masks: &[[f32; 6]], used: usize) -> Option<Painted> {
        let mut painter = MaskPainter::new(3, 2);
        masks.iter().for_each(|m| painter.add(m));
        painter.finish(used)
    }

    #[test]
    fn smaller_masks_lie_in_front_in_any_order() {
        let table = [IN; 6];
        let vase = [OUT, IN, IN, OUT, OUT, OUT];
        let flower = [OUT, OUT, IN, OUT, OUT, 0.0];
        for (masks, ids) in [([table, vase, flower], [1, 2, 3]), ([flower, vase, table], [3, 2, 1])] {
            let out = painted(&masks, 0);
            let want = [ids[0], ids[1], ids[2], ids[0], ids[0], ids[0]];
            assert_eq!(out.as_ref().map(|p| p.mask.ids.as_slice()), Some(want.as_slice()));
            assert_eq!(out.map(|p| (p.mask.width, p.mask.height, p.ids)), Some((3, 2, vec![1, 2, 3])));
        }
        // Of equal ones the first.
        let other = [OUT, OUT, IN, IN, OUT, OUT];
        assert_eq!(painted(&[vase, other], 6).map(|p| p.mask.ids), Some(vec![0, 7, 7, 8, 0, 0]));
    }

    #[test]
    fn masks_that_show_nowhere_have_no_id() {
        let left = [IN, OUT, OUT, OUT, OUT, OUT];
        let both = [IN, IN, OUT, OUT, OUT, OUT];
        let right = [OUT, IN, OUT, OUT, OUT, OUT];
        let out = painted(&[left, [OUT; 6], both, right], 0);
        assert_eq!(out.as_ref().map(|p| (p.ids.clone(), p.empty, p.covered)), Some((vec![1, 0, 0, 2], 1, 1)));
        assert_eq!(out.map(|p| p.mask.ids), Some(vec![1, 2, 0, 0, 0, 0]));
        assert_eq!(painted(&[], 9).map(|p| p.mask.ids), Some(vec![0; 6]));
    }

    #[test]
    fn ids_run_out_at_65535() {
        let (left, right) = ([IN, OUT, OUT, OUT, OUT, OUT], [OUT, IN, OUT, OUT, OUT, OUT]);
        assert_eq!(painted(&[left, right], 65533).map(|p| p.ids), Some(vec![65534, 65535]));
        assert_eq!(painted(&[left, right], 65534), None);
        assert_eq!(painted(&[[OUT; 6]], 65535).map(|p| p.ids), Some(vec![0]));
    }
}
