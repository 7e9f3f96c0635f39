//! Boxes around objects of a cloud: drawn by hand and found, which one is chosen, and what was there before each change.

use glam::DVec3;

use instgs_vk::scene::{Boxes, ObjectBox};

/// Changes that can be taken back.
const MOST_STEPS: usize = 200;
/// A found box whose centre is nearer to that of another box than this part of its own size is of the same object.
const SAME: f64 = 0.25;

/// Where a box is from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A click, or a file.
    Drawn,
    /// The search for what is like the box of this id.
    LikeBox(u32),
}

/// A box of the list.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedBox {
    /// What and where.
    pub object: ObjectBox,
    /// Where it is from.
    pub origin: Origin,
}

/// All that can be taken back.
#[derive(Clone, Debug, Default, PartialEq)]
struct State {
    boxes: Vec<ListedBox>,
    /// Index of the chosen one.
    chosen: Option<usize>,
}

/// The list of boxes of one cloud.
#[derive(Default)]
pub struct BoxList {
    now: State,
    undo: Vec<State>,
    redo: Vec<State>,
    /// What could be done again before a box was drawn last.
    redo_before_draw: Vec<State>,
    /// Before the change that goes on.
    before: Option<State>,
    /// The boxes as they were saved last.
    saved: Vec<ListedBox>,
    /// What else was in the file.
    rest: Boxes,
    /// The largest id that was ever given.
    last_id: u32,
}

impl BoxList {
    /// What was read from a file.
    pub fn from_file(file: Boxes) -> Self {
        let listed = |object: &ObjectBox| ListedBox { object: object.clone(), origin: Origin::Drawn };
        let boxes: Vec<ListedBox> = file.objects.iter().map(listed).collect();
        let rest = Boxes { objects: Vec::new(), views: file.views };
        Self { saved: boxes.clone(), now: State { boxes, chosen: None }, rest, ..Self::default() }
    }

    /// What goes to a file: the boxes, and what else was in the file they came from. Blanks that were typed around a
    /// category would make another one of it.
    pub fn to_file(&self) -> Boxes {
        let named = |listed: &ListedBox| {
            let category = listed.object.category.as_deref().map(|text| text.trim().to_owned());
            ObjectBox { category, ..listed.object.clone() }
        };
        Boxes { objects: self.now.boxes.iter().map(named).collect(), views: self.rest.views.clone() }
    }

    /// The boxes, in the order of the file.
    pub fn boxes(&self) -> &[ListedBox] {
        &self.now.boxes
    }

    /// Index of the chosen one.
    pub fn chosen(&self) -> Option<usize> {
        self.now.chosen
    }

    /// The chosen one.
    pub fn chosen_box(&self) -> Option<&ListedBox> {
        self.now.boxes.get(self.now.chosen?)
    }

    /// How many are drawn and found.
    pub fn counts(&self) -> [usize; 2] {
        let drawn = self.now.boxes.iter().filter(|listed| listed.origin == Origin::Drawn).count();
        [drawn, self.now.boxes.len() - drawn]
    }

    /// How many changes can be taken back and done again.
    pub fn steps(&self) -> [usize; 2] {
        [self.undo.len(), self.redo.len()]
    }

    /// True if boxes were changed since they were read or saved.
    pub fn is_unsaved(&self) -> bool {
        self.now.boxes != self.saved
    }

    /// The boxes were saved as they are.
    pub fn saved(&mut self) {
        self.finish();
        self.saved.clone_from(&self.now.boxes);
    }

    /// Chooses a box, or none.
    pub fn choose(&mut self, index: Option<usize>) {
        self.finish();
        self.now.chosen = index.filter(|&i| i < self.now.boxes.len());
    }

    /// The smallest of the boxes that a point of the world is in.
    pub fn containing(&self, point_world: DVec3) -> Option<usize> {
        let volume = |i: &usize| self.now.boxes[*i].object.size.element_product();
        let inside = (0..self.now.boxes.len()).filter(|&i| self.now.boxes[i].object.contains(point_world));
        inside.min_by(|a, b| volume(a).total_cmp(&volume(b)))
    }

    /// Adds a box by hand, under an id that no other had, and chooses it. It is of the last drawn box's category.
    pub fn draw(&mut self, object: ObjectBox) {
        self.finish();
        self.redo_before_draw = std::mem::take(&mut self.redo);
        self.begin();
        let last = self.now.boxes.iter().rev().find(|listed| listed.origin == Origin::Drawn);
        let category = object.category.clone().or_else(|| last.and_then(|listed| listed.object.category.clone()));
        let object = ObjectBox { id: self.unused_id(), category, ..object };
        self.now.boxes.push(ListedBox { object, origin: Origin::Drawn });
        self.now.chosen = Some(self.now.boxes.len() - 1);
        self.finish();
    }

    /// As if [`BoxList::draw`], which was the last change, had not been.
    pub fn undraw(&mut self) {
        if let Some(before) = self.undo.pop() {
            (self.now, self.redo) = (before, std::mem::take(&mut self.redo_before_draw));
        }
    }

    /// Takes what was found to be like the box `id` in place of what was found so before; what has a box already is left
    /// out. How many are new; `None` if there is no such box any more.
    pub fn take_found(&mut self, id: u32, found: Vec<ObjectBox>) -> Option<usize> {
        let index_of = |boxes: &[ListedBox], id: u32| boxes.iter().position(|listed| listed.object.id == id);
        let like = self.now.boxes[index_of(&self.now.boxes, id)?].object.clone();
        let chosen = self.chosen_box().map(|listed| listed.object.id);
        self.begin();
        self.now.boxes.retain(|listed| listed.origin != Origin::LikeBox(id));
        // What is chosen stays so, unless it was found before.
        let still = chosen.and_then(|chosen| index_of(&self.now.boxes, chosen));
        self.now.chosen = still.or_else(|| index_of(&self.now.boxes, id));
        let before = self.now.boxes.len();
        for object in found {
            let near = SAME * object.size.length();
            if self.now.boxes.iter().any(|listed| listed.object.center.distance(object.center) < near) {
                continue;
            }
            let object = ObjectBox { id: self.free_id(), category: like.category.clone(), ..object };
            self.now.boxes.push(ListedBox { object, origin: Origin::LikeBox(id) });
        }
        self.finish();
        Some(self.now.boxes.len() - before)
    }

    /// Changes the chosen box as part of a change that goes on. Its category is also that of what was found to be like it.
    pub fn change(&mut self, to: ObjectBox) {
        self.begin();
        let Some(chosen) = self.now.chosen.and_then(|i| self.now.boxes.get_mut(i)) else { return };
        let (id, category) = (chosen.object.id, to.category.clone());
        chosen.object = ObjectBox { id, ..to };
        for listed in self.now.boxes.iter_mut().filter(|listed| listed.origin == Origin::LikeBox(id)) {
            listed.object.category.clone_from(&category);
        }
    }

    /// Takes a box out.
    pub fn remove(&mut self, index: usize) {
        if index >= self.now.boxes.len() {
            return;
        }
        self.begin();
        self.now.boxes.remove(index);
        self.now.chosen = match self.now.chosen {
            Some(chosen) if chosen == index => None,
            Some(chosen) if chosen > index => Some(chosen - 1),
            other => other,
        };
        self.finish();
    }

    /// The chosen box as it was before the change that goes on, or is without one.
    pub fn chosen_before(&self) -> Option<&ObjectBox> {
        let state = self.before.as_ref().unwrap_or(&self.now);
        state.boxes.get(state.chosen?).map(|listed| &listed.object)
    }

    /// True while a change goes on.
    pub fn is_live(&self) -> bool {
        self.before.is_some()
    }

    /// Ends a change that goes on: one step. Without one it does nothing.
    pub fn finish(&mut self) {
        if let Some(before) = self.before.take().filter(|before| before.boxes != self.now.boxes) {
            self.undo.push(before);
            self.redo.clear();
            let gone = self.undo.len().saturating_sub(MOST_STEPS);
            self.undo.drain(..gone);
        }
    }

    /// Takes a change that goes on back, and forgets it.
    pub fn cancel(&mut self) {
        if let Some(before) = self.before.take() {
            self.now = before;
        }
    }

    /// Takes the last change back; false if there is none.
    pub fn undo(&mut self) -> bool {
        self.finish();
        let Some(before) = self.undo.pop() else { return false };
        self.redo.push(std::mem::replace(&mut self.now, before));
        true
    }

    /// Does again what was taken back last; false if there is nothing.
    pub fn redo(&mut self) -> bool {
        self.finish();
        let Some(after) = self.redo.pop() else { return false };
        self.undo.push(std::mem::replace(&mut self.now, after));
        true
    }

    fn begin(&mut self) {
        if self.before.is_none() {
            self.before = Some(self.now.clone());
        }
    }

    fn largest_id(&self) -> u32 {
        self.now.boxes.iter().map(|listed| listed.object.id).max().unwrap_or(0)
    }

    /// One that no box has.
    fn free_id(&mut self) -> u32 {
        let id = self.largest_id() + 1;
        self.last_id = self.last_id.max(id);
        id
    }

    /// One that no box has or had: a search may still be on its way for a box that was taken back.
    fn unused_id(&mut self) -> u32 {
        self.last_id = self.last_id.max(self.largest_id()) + 1;
        self.last_id
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use instgs_vk::scene::ViewBox;

    fn at(x: f64) -> ObjectBox {
        let center = DVec3::new(x, 0.0, 0.0);
        ObjectBox { id: 0, category: None, center, size: DVec3::ONE, world_from_box: DQuat::IDENTITY }
    }

    fn places(list: &BoxList) -> Vec<(u32, f64)> {
        list.boxes().iter().map(|listed| (listed.object.id, listed.object.center.x)).collect()
    }

    #[test]
    fn what_was_taken_back_gives_its_id_to_no_other() {
        let mut list = BoxList::default();
        list.draw(at(0.0));
        assert!(list.undo());
        list.draw(at(5.0));
        assert_eq!(list.take_found(1, vec![at(9.0)]), None, "the search was for the box that is gone");
        assert_eq!((list.boxes().len(), list.boxes()[0].object.id), (1, 2));
    }

    /// The first click of a double click is undone without a trace.
    #[test]
    fn what_is_undrawn_leaves_what_can_be_done_again() {
        let mut list = BoxList::default();
        list.draw(at(0.0));
        list.draw(at(5.0));
        assert!(list.undo());
        list.draw(at(9.0));
        list.undraw();
        assert_eq!((places(&list), list.steps()), (vec![(1, 0.0)], [1, 1]));
        assert!(list.redo() && places(&list) == [(1, 0.0), (2, 5.0)]);
    }

    #[test]
    fn what_is_drawn_and_found_can_be_taken_back() {
        let mut list = BoxList::default();
        list.draw(ObjectBox { category: Some("car".into()), ..at(0.0) });
        list.draw(at(5.0));
        assert_eq!(list.boxes()[1].object.category.as_deref(), Some("car"), "as the one before");
        list.choose(Some(0));
        // The box itself, one that has a box, and two new ones.
        assert_eq!(list.take_found(1, vec![at(0.1), at(5.1), at(10.0), at(15.0)]), Some(2));
        assert_eq!((places(&list), list.counts()), (vec![(1, 0.0), (2, 5.0), (3, 10.0), (4, 15.0)], [2, 2]));
        assert!(list.boxes().iter().all(|listed| listed.object.category.as_deref() == Some("car")));
        // Again, in place of what was found before.
        assert_eq!(list.take_found(1, vec![at(20.0)]), Some(1));
        assert_eq!(places(&list), [(1, 0.0), (2, 5.0), (3, 20.0)]);
        assert!(list.undo() && list.counts() == [2, 2]);
        assert_eq!(list.take_found(9, vec![at(20.0)]), None);
        list.remove(2);
        assert_eq!((places(&list), list.chosen()), (vec![(1, 0.0), (2, 5.0), (4, 15.0)], Some(0)));
        list.remove(0);
        assert_eq!((places(&list), list.chosen()), (vec![(2, 5.0), (4, 15.0)], None));
        while list.undo() {}
        assert!(list.boxes().is_empty() && !list.is_unsaved());
        while list.redo() {}
        assert_eq!(places(&list), [(2, 5.0), (4, 15.0)]);
        assert_eq!(list.steps(), [5, 0]);
    }

    #[test]
    fn a_drag_is_one_step_and_may_be_given_up() {
        let mut list = BoxList::default();
        list.draw(at(0.0));
        list.take_found(1, vec![at(9.0)]);
        for x in [1.0, 2.0] {
            list.change(ObjectBox { category: Some("vase".into()), ..at(x) });
            assert_eq!(list.chosen_before().map(|o| o.center.x), Some(0.0));
        }
        list.cancel();
        assert_eq!((places(&list), list.steps()[0]), (vec![(1, 0.0), (2, 9.0)], 2));
        list.change(ObjectBox { category: Some("vase ".into()), ..at(3.0) });
        list.finish();
        assert_eq!(list.to_file().objects[1].category.as_deref(), Some("vase"), "without what is typed around it");
        list.change(ObjectBox { category: Some("vase".into()), ..at(3.0) });
        list.finish();
        assert_eq!((places(&list), list.steps()[0]), (vec![(1, 3.0), (2, 9.0)], 4));
        assert_eq!(list.boxes()[1].object.category.as_deref(), Some("vase"));
        // A change that changes nothing is no step.
        list.change(list.boxes()[0].object.clone());
        list.finish();
        assert_eq!(list.steps()[0], 4);
        assert!(list.is_unsaved());
        list.saved();
        assert!(!list.is_unsaved() && list.undo() && list.is_unsaved());
    }

    #[test]
    fn a_file_keeps_what_is_not_of_the_list() {
        let view = ViewBox { id: None, category: None, score: None, box_px: [0.0, 0.0, 4.0, 4.0] };
        let views = [("a".to_owned(), vec![view])];
        let file = Boxes { objects: vec![ObjectBox { id: 7, ..at(1.0) }], views: views.into() };
        let mut list = BoxList::from_file(file.clone());
        assert_eq!((list.to_file(), list.is_unsaved(), list.chosen()), (file, false, None));
        list.draw(at(4.0));
        assert_eq!((places(&list), list.to_file().views.len()), (vec![(7, 1.0), (8, 4.0)], 1));
        assert_eq!((list.containing(DVec3::new(4.4, 0.0, 0.0)), list.containing(DVec3::ZERO)), (Some(1), None));
    }
}
