//! Maps mask ids of a view to objects.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use instgs_vk::render::Contribution;

/// From mask ids to objects, which are numbered from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IdTable {
    /// An id is the same object in every view.
    #[default]
    Same,
    /// Object of each id, by view. Ids without an entry are unknown: their pixels are neither inside nor outside of any
    /// object.
    PerView(Vec<BTreeMap<u16, u16>>),
}

impl IdTable {
    /// The object of an id in a view: 0 for id 0, `None` if it is unknown.
    pub fn object_of(&self, view: usize, id: u16) -> Option<u16> {
        match self {
            _ if id == 0 => Some(0),
            Self::Same => Some(id),
            Self::PerView(views) => views.get(view)?.get(&id).copied(),
        }
    }

    /// Objects with a mask in a view whose mask has these ids; ascending, without repeats.
    pub fn objects_of_view(&self, view: usize, ids: &[u16]) -> Vec<u16> {
        let mut out: Vec<u16> = ids.iter().filter_map(|&id| self.object_of(view, id)).filter(|&id| id != 0).collect();
        out.sort_unstable();
        out.dedup();
        out
    }

    /// Contributions of a view, sorted by Gaussian and id, with objects in place of ids. Unknown ids are dropped, and
    /// contributions to several masks of one object are summed.
    pub fn translated<'a>(&self, view: usize, contributions: &'a [Contribution]) -> Cow<'a, [Contribution]> {
        if *self == Self::Same {
            return Cow::Borrowed(contributions);
        }
        let mut out: Vec<Contribution> = Vec::with_capacity(contributions.len());
        for of_gaussian in contributions.chunk_by(|a, b| a.gaussian == b.gaussian) {
            let start = out.len();
            out.extend(of_gaussian.iter().filter_map(|c| Some(Contribution { id: self.object_of(view, c.id)?, ..*c })));
            out[start..].sort_unstable();
        }
        out.dedup_by(|later, kept| {
            let same = (later.gaussian, later.id) == (kept.gaussian, kept.id);
            kept.weight += if same { later.weight } else { 0 };
            same
        });
        Cow::Owned(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_become_objects_and_unknown_ones_say_nothing() {
        let table = IdTable::PerView(vec![BTreeMap::new(), BTreeMap::from([(7, 2), (8, 1), (9, 2)])]);
        let entry = |gaussian, id, weight| Contribution { gaussian, id, weight };
        let contributions =
            [entry(3, 0, 5), entry(3, 4, 6), entry(3, 7, 1), entry(3, 8, 2), entry(3, 9, 3), entry(4, 9, 4)];
        let want = [entry(3, 0, 5), entry(3, 1, 2), entry(3, 2, 4), entry(4, 2, 4)];
        assert_eq!(*table.translated(1, &contributions), want);
        assert_eq!(*table.translated(0, &contributions), [entry(3, 0, 5)], "a view without objects has its background");
        assert_eq!(*table.translated(2, &contributions), [entry(3, 0, 5)], "no such view");
        assert_eq!(*IdTable::Same.translated(1, &contributions), contributions);
        assert_eq!(table.objects_of_view(1, &[4, 7, 8, 9]), [1, 2]);
        assert_eq!(IdTable::Same.objects_of_view(1, &[4, 7]), [4, 7]);
    }

    #[test]
    fn tables_are_written_and_read() {
        for table in [IdTable::Same, IdTable::PerView(vec![BTreeMap::from([(65_535, 1)]), BTreeMap::new()])] {
            let text = serde_json::to_string(&table).unwrap();
            assert_eq!(serde_json::from_str::<IdTable>(&text).unwrap(), table, "{text}");
        }
    }
}
