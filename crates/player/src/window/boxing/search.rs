//! The search for what is like the chosen box, in the window: how it begins, what it looks for, and what it gives.

use crate::search::{Search, Searched, without_view_dependence};
use crate::window::Live;
use instgs_objects::segment::standing::Surroundings;

impl Live {
    /// Begins the search for what is like the chosen box.
    pub(in crate::window) fn find_rest(&mut self) {
        if self.boxing.is_searching() {
            return self.says("a search goes on: Esc stops it");
        }
        let Some(listed) = self.boxing.list.chosen_box() else {
            return self.says("click an object first: what is like it is looked for");
        };
        let [_, _, up] = self.navigator.level_axes();
        let up = self.boxing.around.as_ref().map_or(up, Surroundings::up);
        let cloud = without_view_dependence(&self.stage.scene().background);
        let (cameras, object) = (self.cameras.0.clone(), listed.object.clone());
        self.boxing.search = Some(Search::start(cloud, cameras, object, up, self.boxing.other_sizes));
    }

    /// What searches look for from now on.
    pub(super) fn look_for_other_sizes(&mut self, other_sizes: bool) {
        if self.boxing.is_searching() {
            return self.says("a search goes on: Esc stops it");
        }
        self.boxing.other_sizes = other_sizes;
        self.says(match other_sizes {
            true => "F finds objects of half to twice the size, too",
            false => "F finds objects of the same size",
        });
    }

    /// The other of the two.
    pub(in crate::window) fn toggle_other_sizes(&mut self) {
        self.look_for_other_sizes(!self.boxing.other_sizes);
    }

    /// Asks a search to stop, if there is one.
    pub(in crate::window) fn stop_search(&self) {
        if let Some(search) = &self.boxing.search {
            search.stop();
        }
    }

    /// Takes what a search has found, if it has ended; not while a box is being changed.
    pub(in crate::window) fn take_found(&mut self) {
        if self.boxing.is_held() || self.boxing.list.is_live() {
            return;
        }
        let Some(search) = self.boxing.search.take_if(|search| search.has_ended()) else { return };
        let like = search.like();
        let words = match search.end() {
            Searched::Stopped => "the search was stopped".into(),
            Searched::Failed(reason) => reason,
            Searched::Found(found, seconds) => match self.boxing.list.take_found(like, found) {
                None => "the box that was searched for is gone".into(),
                Some(0) => format!("nothing else is like box {like} ({seconds:.1} s)"),
                Some(count) => {
                    format!("{count} found in {seconds:.1} s; Shift+click takes away what is wrong; Ctrl+S saves")
                }
            },
        };
        self.says(words);
    }
}
