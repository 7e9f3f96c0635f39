//! What was found, and what was not kept.

use std::ops::AddAssign;

use serde::Serialize;

use crate::io::Mask;
use crate::scene::ViewBox;

/// Boxes that became no mask, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Dropped {
    /// Above the box threshold, but no phrase above the text threshold.
    pub unnamed: usize,
    /// Covered by a better box of the same phrase.
    pub repeated: usize,
    /// Without a pixel in the photo.
    pub outside: usize,
    /// Their mask is that of a better box, of whatever phrase.
    pub same_mask: usize,
    /// Their mask has no pixel.
    pub empty: usize,
    /// Smaller masks cover theirs wholly.
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
    /// Ids, at the size of the photo; all 0 if nothing was found.
    pub mask: Mask,
    /// One box per id, in the order of ids: the part of it in the photo, its phrase and score.
    pub boxes: Vec<ViewBox>,
    /// Boxes that became no mask.
    pub dropped: Dropped,
}

/// What one phrase found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PhraseCount {
    /// The phrase.
    pub phrase: String,
    /// Masks of it, in all views.
    pub masks: usize,
    /// Views with at least one.
    pub views: usize,
}

/// The masks of all views.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PromptReport {
    /// Views looked at.
    pub views: usize,
    /// Names of those in which nothing was found.
    pub views_without: Vec<String>,
    /// Masks, which is also the highest id.
    pub masks: usize,
    /// By phrase, in the order of the prompt.
    pub phrases: Vec<PhraseCount>,
    /// Boxes that became no mask.
    pub dropped: Dropped,
}

impl PromptReport {
    /// Of no views yet.
    pub fn new(phrases: &[String]) -> Self {
        let count = |phrase: &String| PhraseCount { phrase: phrase.clone(), masks: 0, views: 0 };
        Self { phrases: phrases.iter().map(count).collect(), ..Self::default() }
    }

    /// Counts a view in.
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
