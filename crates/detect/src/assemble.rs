//! Combines the masks of one view into an image of ids.

use instgs_io::Mask;

/// Paints masks over each other. Where masks overlap, the one with fewer pixels is in front, so that a vase stays
/// visible on its table; of equal sizes the first one is in front. Otherwise the order of masks does not matter.
#[derive(Clone, Debug)]
pub struct MaskPainter {
    size: (usize, usize),
    /// For each pixel, 1 + index of the mask that is in front, 0 for none.
    shown: Vec<u16>,
    /// Number of pixels of each mask, visible or not.
    areas: Vec<usize>,
}

/// Result of painting masks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Painted {
    /// Image with the id of the mask in front of each pixel.
    pub mask: Mask,
    /// Id of each mask; 0 for those that are not visible.
    pub ids: Vec<u16>,
    /// Number of masks without a pixel.
    pub empty: usize,
    /// Number of masks that are wholly covered by others.
    pub covered: usize,
}

impl MaskPainter {
    /// An empty image of the given size in pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { size: (width, height), shown: vec![0; width * height], areas: Vec::new() }
    }

    /// Adds a mask: the pixels whose logits are above 0, row by row.
    pub fn add(&mut self, logits: &[f32]) {
        let area = logits.iter().filter(|l| **l > 0.0).count();
        self.areas.push(area);
        // With more masks than ids [`Self::finish`] returns `None`.
        let Ok(own) = u16::try_from(self.areas.len()) else { return };
        for (shown, _) in self.shown.iter_mut().zip(logits).filter(|(_, logit)| **logit > 0.0) {
            if *shown == 0 || area < self.areas[usize::from(*shown) - 1] {
                *shown = own;
            }
        }
    }

    /// The image with ids for the visible masks in the order in which they were added, from `used` + 1 on. `None` if
    /// ids run out.
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
        // Of equal sizes the first one.
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
