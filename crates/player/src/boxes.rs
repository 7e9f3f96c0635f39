//! The boxes around objects of a cloud: drawn and found boxes, the selected box, and the undo history.

use glam::DVec3;

use instgs_vk::scene::{Boxes, ObjectBox};

/// Largest number of changes that can be undone.
const MOST_STEPS: usize = 200;
/// A found box whose centre is closer to the centre of another box than this fraction of its own size contains the same
/// object.
const SAME: f64 = 0.25;

/// How a box came into the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Drawn with a click, or read from a file.
    Drawn,
    /// Found by the search for objects similar to the one in the box with this id.
    LikeBox(u32),
}

/// A box of the list and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedBox {
    /// The box: id, category, centre, size and rotation.
    pub object: ObjectBox,
    /// How the box came into the list.
    pub origin: Origin,
}

/// The state that undo and redo restore.
#[derive(Clone, Debug, Default, PartialEq)]
struct State {
    boxes: Vec<ListedBox>,
    /// Index of the selected box.
    chosen: Option<usize>,
}

/// The list of boxes of one cloud.
#[derive(Default)]
pub struct BoxList {
    now: State,
    undo: Vec<State>,
    redo: Vec<State>,
    /// The redo history before the last box was drawn, for [`BoxList::undraw`].
    redo_before_draw: Vec<State>,
    /// The state before the change that is in progress.
    before: Option<State>,
    /// The boxes as they were last saved.
    saved: Vec<ListedBox>,
    /// The other contents of the file.
    rest: Boxes,
    /// The largest id that was ever assigned.
    last_id: u32,
}

impl BoxList {
    /// The list with the boxes of a file.
    pub fn from_file(file: Boxes) -> Self {
        let listed = |object: &ObjectBox| ListedBox { object: object.clone(), origin: Origin::Drawn };
        let boxes: Vec<ListedBox> = file.objects.iter().map(listed).collect();
        let rest = Boxes { objects: Vec::new(), views: file.views };
        Self { saved: boxes.clone(), now: State { boxes, chosen: None }, rest, ..Self::default() }
    }

    /// The contents of the file to save: the boxes, and the other contents of the file they were read from. Categories
    /// are trimmed: a blank around a typed name would make it another category.
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

    /// Index of the selected box.
    pub fn chosen(&self) -> Option<usize> {
        self.now.chosen
    }

    /// The selected box, if there is one.
    pub fn chosen_box(&self) -> Option<&ListedBox> {
        self.now.boxes.get(self.now.chosen?)
    }

    /// Number of drawn boxes and of found boxes.
    pub fn counts(&self) -> [usize; 2] {
        let drawn = self.now.boxes.iter().filter(|listed| listed.origin == Origin::Drawn).count();
        [drawn, self.now.boxes.len() - drawn]
    }

    /// Number of changes that can be undone and redone.
    pub fn steps(&self) -> [usize; 2] {
        [self.undo.len(), self.redo.len()]
    }

    /// True if boxes were changed since they were read or saved.
    pub fn is_unsaved(&self) -> bool {
        self.now.boxes != self.saved
    }

    /// True if there are no boxes, and none that were saved and removed since.
    pub fn has_nothing_to_save(&self) -> bool {
        self.now.boxes.is_empty() && !self.is_unsaved()
    }

    /// Marks the boxes as saved in their present state.
    pub fn saved(&mut self) {
        self.finish();
        self.saved.clone_from(&self.now.boxes);
    }

    /// Selects a box, or none.
    pub fn choose(&mut self, index: Option<usize>) {
        self.finish();
        self.now.chosen = index.filter(|&i| i < self.now.boxes.len());
    }

    /// Index of the smallest box that contains a point in world coordinates.
    pub fn containing(&self, point_world: DVec3) -> Option<usize> {
        let volume = |i: &usize| self.now.boxes[*i].object.size.element_product();
        let inside = (0..self.now.boxes.len()).filter(|&i| self.now.boxes[i].object.contains(point_world));
        inside.min_by(|a, b| volume(a).total_cmp(&volume(b)))
    }

    /// Adds a box drawn by hand under an unused id and selects it. It gets the category of the last drawn box.
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

    /// Reverts [`BoxList::draw`], which must have been the last change, without a trace in the undo history.
    pub fn undraw(&mut self) {
        if let Some(before) = self.undo.pop() {
            (self.now, self.redo) = (before, std::mem::take(&mut self.redo_before_draw));
        }
    }

    /// Replaces the earlier results of the search for objects similar to box `id` by `found`; results that coincide
    /// with an existing box are dropped. Returns the number of new boxes; `None` if box `id` no longer exists.
    pub fn take_found(&mut self, id: u32, found: Vec<ObjectBox>) -> Option<usize> {
        let index_of = |boxes: &[ListedBox], id: u32| boxes.iter().position(|listed| listed.object.id == id);
        let like = self.now.boxes[index_of(&self.now.boxes, id)?].object.clone();
        let chosen = self.chosen_box().map(|listed| listed.object.id);
        self.begin();
        self.now.boxes.retain(|listed| listed.origin != Origin::LikeBox(id));
        // The selection is kept, unless it was an earlier result.
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

    /// Changes the selected box as part of a change in progress. A new category also applies to the boxes that were
    /// found from it.
    pub fn change(&mut self, to: ObjectBox) {
        self.begin();
        let Some(chosen) = self.now.chosen.and_then(|i| self.now.boxes.get_mut(i)) else { return };
        let (id, category) = (chosen.object.id, to.category.clone());
        chosen.object = ObjectBox { id, ..to };
        for listed in self.now.boxes.iter_mut().filter(|listed| listed.origin == Origin::LikeBox(id)) {
            listed.object.category.clone_from(&category);
        }
    }

    /// Removes a box from the list.
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

    /// The selected box before the change in progress, or as it is now if there is none.
    pub fn chosen_before(&self) -> Option<&ObjectBox> {
        let state = self.before.as_ref().unwrap_or(&self.now);
        state.boxes.get(state.chosen?).map(|listed| &listed.object)
    }

    /// True while a change is in progress.
    pub fn is_live(&self) -> bool {
        self.before.is_some()
    }

    /// Completes the change in progress as one undo step. Does nothing if there is none.
    pub fn finish(&mut self) {
        if let Some(before) = self.before.take().filter(|before| before.boxes != self.now.boxes) {
            self.undo.push(before);
            self.redo.clear();
            let gone = self.undo.len().saturating_sub(MOST_STEPS);
            self.undo.drain(..gone);
        }
    }

    /// Completes the change in progress as a part of the last undo step, if that changed the same box alone: a key that is held moves a
    /// box many times.
    pub fn finish_again(&mut self) {
        let others = |state: &State| {
            let chosen = state.chosen?;
            let others = state.boxes.iter().enumerate().filter(|(i, _)| *i != chosen).map(|(_, listed)| listed.clone());
            Some((state.boxes.get(chosen)?.object.id, others.collect::<Vec<_>>()))
        };
        let goes_on = self.redo.is_empty() && self.undo.last().is_some_and(|last| others(last) == others(&self.now));
        if goes_on {
            self.before = None;
        } else {
            self.finish();
        }
    }

    /// Reverts and drops the change in progress.
    pub fn cancel(&mut self) {
        if let Some(before) = self.before.take() {
            self.now = before;
        }
    }

    /// Undoes the last change; false if there is none.
    pub fn undo(&mut self) -> bool {
        self.finish();
        let Some(before) = self.undo.pop() else { return false };
        self.redo.push(std::mem::replace(&mut self.now, before));
        true
    }

    /// Redoes the change that was undone last; false if there is none.
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

    /// An id that no present box has.
    fn free_id(&mut self) -> u32 {
        let id = self.largest_id() + 1;
        self.last_id = self.last_id.max(id);
        id
    }

    /// An id that no box has or had: a search may still be running for a box whose drawing was undone.
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

    #[test]
    fn what_a_held_key_does_is_one_step() {
        let mut list = BoxList::default();
        list.draw(at(0.0));
        list.change(at(1.0));
        list.finish();
        for x in [2.0, 3.0] {
            list.change(at(x));
            list.finish_again();
        }
        assert!(places(&list) == [(1, 3.0)] && list.steps() == [2, 0] && !list.is_live());
        assert!(list.undo() && places(&list) == [(1, 0.0)]);
        // After a step that was undone, and on another box, it begins one of its own.
        list.change(at(7.0));
        list.finish_again();
        assert!(list.steps() == [2, 0] && list.undo() && places(&list) == [(1, 0.0)]);
        list.draw(at(5.0));
        for x in [6.0, 7.0] {
            list.change(at(x));
            list.finish_again();
        }
        assert_eq!((places(&list), list.steps()), (vec![(1, 0.0), (2, 7.0)], [3, 0]), "drawing is a step of its own");
        list.choose(Some(0));
        list.change(at(1.0));
        list.finish_again();
        assert_eq!(list.steps(), [4, 0]);
    }

    /// The first click of a double click is reverted and leaves the redo history as it was.
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
        // The box itself, a result that coincides with another box, and two new results.
        assert_eq!(list.take_found(1, vec![at(0.1), at(5.1), at(10.0), at(15.0)]), Some(2));
        assert_eq!((places(&list), list.counts()), (vec![(1, 0.0), (2, 5.0), (3, 10.0), (4, 15.0)], [2, 2]));
        assert!(list.boxes().iter().all(|listed| listed.object.category.as_deref() == Some("car")));
        // A second search replaces the results of the first.
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
        // A change to equal values is not an undo step.
        list.change(list.boxes()[0].object.clone());
        list.finish();
        assert_eq!(list.steps()[0], 4);
        assert!(list.is_unsaved());
        list.saved();
        assert!(!list.is_unsaved() && list.undo() && list.is_unsaved());
    }

    #[test]
    fn the_removal_of_all_boxes_is_saved() {
        let mut list = BoxList::default();
        list.draw(at(0.0));
        list.remove(0);
        assert!(list.has_nothing_to_save(), "a file never had it");
        list.draw(at(0.0));
        list.saved();
        list.remove(0);
        assert!(!list.has_nothing_to_save() && list.is_unsaved());
        list.saved();
        assert!(list.has_nothing_to_save());
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
