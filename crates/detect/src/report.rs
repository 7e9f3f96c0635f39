//! Report of masks from a prompt: what was found, and what was dropped.

use std::ops::AddAssign;

use serde::Serialize;

use instgs_io::Mask;
use instgs_vk::scene::ViewBox;

/// Number of boxes that did not become masks, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Dropped {
    /// Above the box threshold, but without a phrase above the text threshold.
    pub unnamed: usize,
    /// Overlapped by a better box with the same phrase.
    pub repeated: usize,
    /// Without a pixel inside the photo.
    pub outside: usize,
    /// With the same mask as a better box of any phrase.
    pub same_mask: usize,
    /// With a mask that has no pixel.
    pub empty: usize,
    /// With a mask that smaller masks cover wholly.
    pub covered: usize,
}

impl AddAssign for Dropped {
    fn add_assign(&mut self, other: Self) {
        self.unnamed += other.unnamed;
        self.repeated += other.repeated;
        self.outside += other.outside;
        self.same_mask += other.same_mask;
        self.empty += other.empty;
        self.covered += other.covered;
    }
}

/// The masks of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMasks {
    /// Ids at the size of the photo; all 0 if nothing was found.
    pub mask: Mask,
    /// One box per id, in the order of ids: clipped to the photo, with phrase and score.
    pub boxes: Vec<ViewBox>,
    /// Boxes that did not become masks.
    pub dropped: Dropped,
}

/// Number of masks of one phrase.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PhraseCount {
    /// Text of the phrase in lower case.
    pub phrase: String,
    /// Number of its masks in all views.
    pub masks: usize,
    /// Number of views with at least one.
    pub views: usize,
}

/// Totals over all views.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PromptReport {
    /// Number of views that were searched.
    pub views: usize,
    /// Names of the views in which nothing was found.
    pub views_without: Vec<String>,
    /// Number of masks, which is also the highest id.
    pub masks: usize,
    /// Counts of each phrase, in the order of the prompt.
    pub phrases: Vec<PhraseCount>,
    /// Boxes that did not become masks.
    pub dropped: Dropped,
}

impl PromptReport {
    /// An empty report for the phrases of a prompt.
    pub fn new(phrases: &[String]) -> Self {
        let count = |phrase: &String| PhraseCount { phrase: phrase.clone(), masks: 0, views: 0 };
        Self { phrases: phrases.iter().map(count).collect(), ..Self::default() }
    }

    /// A warning if there are views in which nothing was found.
    pub fn views_without_note(&self) -> Option<String> {
        let first = self.views_without.first()?;
        let (without, more) = (self.views_without.len(), if self.views_without.len() > 1 { ", ..." } else { "" });
        Some(format!("nothing was found in {without} of {} views ({first}{more})", self.views))
    }

    /// Adds the masks of a view, whose name is `name`.
    pub fn add(&mut self, name: &str, view: &ViewMasks) {
        self.views += 1;
        self.masks += view.boxes.len();
        self.dropped += view.dropped;
        if view.boxes.is_empty() {
            self.views_without.push(name.into());
        }
        for count in &mut self.phrases {
            let found = view.boxes.iter().filter(|b| b.category.as_ref() == Some(&count.phrase)).count();
            count.masks += found;
            count.views += usize::from(found > 0);
        }
    }
}
