//! The search for objects similar to the one in the selected box, in the window: start, settings and results.

use crate::search::{Search, Searched, without_view_dependence};
use crate::window::Live;
use instgs_objects::segment::standing::Surroundings;

impl Live {
    /// Starts the search for objects similar to the one in the selected box.
    pub(in crate::window) fn find_rest(&mut self) {
        if self.input.boxing.is_searching() {
            return self.says("a search is running: Esc stops it");
        }
        let Some(listed) = self.input.boxing.list.chosen_box() else {
            return self.says("click an object first: F finds objects like it");
        };
        let [_, _, up] = self.camera.navigator.level_axes();
        let up = self.input.boxing.around.as_ref().map_or(up, Surroundings::up);
        let cloud = without_view_dependence(&self.session.viewer.scene().background);
        let (cameras, object) = (self.camera.data_views.list.clone(), listed.object.clone());
        self.input.boxing.search = Some(Search::start(cloud, cameras, object, up, self.input.boxing.other_sizes));
    }

    /// Sets whether searches also find objects of other sizes.
    pub(super) fn look_for_other_sizes(&mut self, other_sizes: bool) {
        if self.input.boxing.is_searching() {
            return self.says("a search is running: Esc stops it");
        }
        self.input.boxing.other_sizes = other_sizes;
        self.says(match other_sizes {
            true => "F also finds objects of half to twice the size",
            false => "F finds objects of the same size",
        });
    }

    /// Toggles whether searches also find objects of other sizes.
    pub(in crate::window) fn toggle_other_sizes(&mut self) {
        self.look_for_other_sizes(!self.input.boxing.other_sizes);
    }

    /// Requests a running search to stop.
    pub(in crate::window) fn stop_search(&self) {
        if let Some(search) = &self.input.boxing.search {
            search.stop();
        }
    }

    /// Takes the results of a search that has ended, unless a box is being changed.
    pub(in crate::window) fn take_found(&mut self) {
        if self.input.boxing.is_held() || self.input.boxing.list.is_live() {
            return;
        }
        let Some(search) = self.input.boxing.search.take_if(|search| search.has_ended()) else { return };
        let like = search.like();
        let words = match search.end() {
            Searched::Stopped => "the search was stopped".into(),
            Searched::Failed(reason) => reason,
            Searched::Found(found, seconds) => match self.input.boxing.list.take_found(like, found) {
                None => "the search's box was removed meanwhile".into(),
                Some(0) => format!("no other object is like the one in box {like} ({seconds:.1} s)"),
                Some(count) => {
                    format!("{count} found in {seconds:.1} s; Shift+click removes a wrong box; Ctrl+S saves")
                }
            },
        };
        self.says(words);
    }
}
