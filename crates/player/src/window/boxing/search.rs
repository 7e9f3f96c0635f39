//! The search for objects similar to the one in the selected box, in the window: start, settings and results.

use crate::search::{Search, Searched, without_view_dependence};
use crate::texts;
use crate::window::Live;

impl Live {
    /// Starts the search for objects similar to the one in the selected box.
    pub(in crate::window) fn find_rest(&mut self) {
        if self.input.boxing.is_searching() {
            return self.says(texts::IS_SEARCHING);
        }
        if self.session.viewer.is_in_pages() {
            return self.says(texts::IN_PAGES);
        }
        let Some(listed) = self.input.boxing.list.chosen_box() else {
            return self.says(texts::CLICK_FIRST);
        };
        let [_, _, up] = self.camera.navigator.level_axes();
        let up = self.input.boxing.around.as_ref().map_or(up, |(_, around)| around.up());
        let cloud = without_view_dependence(&self.session.viewer.scene().background);
        let (cameras, object) = (self.camera.data_views.list.clone(), listed.object.clone());
        self.input.boxing.search = Some(Search::start(cloud, cameras, object, up, self.input.boxing.other_sizes));
    }

    /// Sets whether searches also find objects of other sizes.
    pub(super) fn look_for_other_sizes(&mut self, other_sizes: bool) {
        if self.input.boxing.is_searching() {
            return self.says(texts::IS_SEARCHING);
        }
        self.input.boxing.other_sizes = other_sizes;
        self.says(match other_sizes {
            true => texts::FINDS_OTHER_SIZES,
            false => texts::FINDS_SAME_SIZE,
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
            Searched::Stopped => texts::SEARCH_STOPPED.into(),
            Searched::Failed(reason) => reason,
            Searched::Found(found, seconds) => match self.input.boxing.list.take_found(like, found) {
                None => texts::SEARCH_BOX_GONE.into(),
                Some(0) => texts::none_found(like, seconds),
                Some(count) => texts::found(count, seconds),
            },
        };
        self.says(words);
    }
}
