//! Which page of a background is in which page slot of device memory; here a *slot* for short.

/// Slots for pages, all of the same size.
pub(super) struct PageSlots {
    /// By slot, its page.
    page_in: Vec<Option<u32>>,
    /// By page, its slot.
    slot_of: Vec<Option<u32>>,
    /// By page, the number of the view that last wanted it; 0 = none has.
    last_wanted: Vec<u64>,
    /// Number of views so far.
    views: u64,
}

impl PageSlots {
    /// Empty slots for a number of pages.
    pub(super) fn new(slots: u32, pages: usize) -> Self {
        let (page_in, slot_of) = (vec![None; slots as usize], vec![None; pages]);
        Self { page_in, slot_of, last_wanted: vec![0; pages], views: 0 }
    }

    /// Number of slots.
    pub(super) fn len(&self) -> usize {
        self.page_in.len()
    }

    /// Begins a view that wants these pages, at most as many as there are slots; returns those without a slot, in their order.
    pub(super) fn want(&mut self, pages: &[u32]) -> Vec<u32> {
        self.views += 1;
        pages.iter().for_each(|&page| self.last_wanted[page as usize] = self.views);
        pages.iter().copied().filter(|&page| self.slot_of[page as usize].is_none()).collect()
    }

    /// Gives a page without slot one: an empty one, or that of the page that was wanted longest ago, which is returned and has
    /// none from then on. `None` if the last view wants the pages of all slots, or the page has a slot.
    pub(super) fn take(&mut self, page: u32) -> Option<(u32, Option<u32>)> {
        if self.slot_of[page as usize].is_some() {
            return None;
        }
        let age = |slot: &usize| self.page_in[*slot].map_or(0, |page| self.last_wanted[page as usize]);
        let slot = (0..self.page_in.len()).min_by_key(age).filter(|slot| age(slot) < self.views)?;
        let before = self.page_in[slot].replace(page);
        if let Some(before) = before {
            self.slot_of[before as usize] = None;
        }
        self.slot_of[page as usize] = Some(slot as u32);
        Some((slot as u32, before))
    }

    /// Takes its slot from a page that could not be written.
    pub(super) fn release(&mut self, page: u32) {
        if let Some(slot) = self.slot_of[page as usize].take() {
            self.page_in[slot as usize] = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_that_was_wanted_longest_ago_goes() {
        let mut slots = PageSlots::new(2, 5);
        assert_eq!(slots.want(&[3, 1]), [3, 1]);
        assert_eq!(slots.take(3), Some((0, None)));
        assert_eq!(slots.take(3), None);
        assert_eq!(slots.take(1), Some((1, None)));
        // Both are wanted by this view.
        assert_eq!(slots.take(0), None);
        assert_eq!(slots.want(&[1, 0]), [0]);
        assert_eq!(slots.take(0), Some((0, Some(3))));
        assert_eq!(slots.want(&[3, 4]), [3, 4]);
        assert_eq!(slots.take(3), Some((0, Some(0))));
        assert_eq!(slots.take(4), Some((1, Some(1))));
        slots.release(4);
        assert_eq!(slots.want(&[3, 4]), [4]);
        assert_eq!(slots.take(4), Some((1, None)));
        assert!(slots.want(&[]).is_empty());
        assert_eq!(PageSlots::new(0, 3).take(2), None);
    }
}
