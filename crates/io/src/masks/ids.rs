//! Ids for the objects of masks that other programs number or name in ways of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::groups::MAX_INSTANCE_ID;

/// What the files say of an object in one photo.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Seen {
    /// The same for the same object in every photo; `None` if the files do not say which object it is.
    pub(super) object: Option<String>,
    /// Its kind, if it has a name.
    pub(super) category: Option<String>,
}

/// Ids of the objects in every photo.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Numbered {
    /// By photo, in the order of its objects.
    pub(super) ids: Vec<Vec<u16>>,
    /// Names of the ids that have one.
    pub(super) categories: BTreeMap<u32, String>,
}

/// Numbers the objects of photos. If all say which object they are, an id is the same object in every photo: the number that
/// `number_of` reads from its name if those are different and fit (all one more if one is 0), else 1, 2, 3 in their order.
/// Otherwise every photo's ids are its own, and only the kind of an id is the same in all.
///
/// # Errors
/// More objects than ids, or an object of two kinds.
pub(super) fn number(photos: &[Vec<Seen>], number_of: fn(&str) -> Option<u64>) -> Result<Numbered, String> {
    match photos.iter().flatten().all(|seen| seen.object.is_some()) {
        true => number_objects(photos, number_of),
        false => number_in_photos(photos),
    }
}

fn number_objects(photos: &[Vec<Seen>], number_of: fn(&str) -> Option<u64>) -> Result<Numbered, String> {
    let mut kinds: BTreeMap<&str, Option<&str>> = BTreeMap::new();
    for seen in photos.iter().flatten() {
        let (name, kind) = (seen.object.as_deref().unwrap_or_default(), seen.category.as_deref());
        let other = *kinds.entry(name).or_insert(kind);
        if other != kind {
            let named = |kind: Option<&str>| kind.unwrap_or("nothing").to_owned();
            return Err(format!("the object {name:?} is a {} and a {}", named(other), named(kind)));
        }
    }
    let ids = ids_of(kinds.keys().copied(), number_of)?;
    let id = |seen: &Seen| ids.get(seen.object.as_deref().unwrap_or_default()).copied().unwrap_or_default();
    let categories = kinds.iter().filter_map(|(name, kind)| Some((u32::from(*ids.get(name)?), (*kind)?.to_owned())));
    Ok(Numbered {
        ids: photos.iter().map(|seen| seen.iter().map(id).collect()).collect(),
        categories: categories.collect(),
    })
}

fn ids_of<'a>(
    names: impl ExactSizeIterator<Item = &'a str> + Clone,
    number_of: fn(&str) -> Option<u64>,
) -> Result<BTreeMap<&'a str, u16>, String> {
    let count = names.len();
    let numbers: Option<BTreeSet<u64>> = names.clone().map(number_of).collect();
    let from = |numbers: &BTreeSet<u64>| u64::from(numbers.contains(&0));
    let fit = |numbers: &BTreeSet<u64>| {
        numbers.len() == count && numbers.last().is_none_or(|last| last + from(numbers) <= u64::from(MAX_INSTANCE_ID))
    };
    let id = |number: u64| u16::try_from(number).map_err(|_| too_many(count));
    match numbers.filter(|numbers| fit(numbers)) {
        Some(numbers) => {
            names.map(|name| Ok((name, id(number_of(name).unwrap_or_default() + from(&numbers))?))).collect()
        }
        None => (1..).zip(names).map(|(number, name)| Ok((name, id(number)?))).collect(),
    }
}

/// Every kind has as many ids as the photo with most of its objects needs.
fn number_in_photos(photos: &[Vec<Seen>]) -> Result<Numbered, String> {
    let mut most: BTreeMap<Option<&str>, u32> = BTreeMap::new();
    for photo in photos {
        let mut count: BTreeMap<Option<&str>, u32> = BTreeMap::new();
        photo.iter().for_each(|seen| *count.entry(seen.category.as_deref()).or_default() += 1);
        for (kind, n) in count {
            let most = most.entry(kind).or_default();
            *most = n.max(*most);
        }
    }
    let (mut next, mut first_of_kind, mut categories) = (1u32, BTreeMap::new(), BTreeMap::new());
    for (kind, count) in most {
        first_of_kind.insert(kind, next);
        categories.extend(kind.into_iter().flat_map(|kind| (next..next + count).map(move |id| (id, kind.to_owned()))));
        next += count;
    }
    if next > MAX_INSTANCE_ID + 1 {
        return Err(too_many(next as usize - 1));
    }
    let mut ids = Vec::with_capacity(photos.len());
    for photo in photos {
        let mut next = first_of_kind.clone();
        let mut ids_in = Vec::with_capacity(photo.len());
        for seen in photo {
            let next = next.entry(seen.category.as_deref()).or_default();
            ids_in.push(*next as u16);
            *next += 1;
        }
        ids.push(ids_in);
    }
    Ok(Numbered { ids, categories })
}

fn too_many(count: usize) -> String {
    format!("has {count} objects, and masks have {MAX_INSTANCE_ID} ids at most")
}

/// The number at the end of a name: 7 of `car_007`.
pub(super) fn last_number(name: &str) -> Option<u64> {
    name[without_number(name).len()..].trim_start_matches(is_between).parse().ok()
}

/// A name without the number at its end and what stands between: `car` of `car_007`.
pub(super) fn without_number(name: &str) -> &str {
    name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(is_between)
}

/// What separates a name and a number.
fn is_between(c: char) -> bool {
    matches!(c, '_' | '-' | ' ' | '.' | '#')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(object: &str, category: &str) -> Seen {
        let some = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        Seen { object: some(object), category: some(category) }
    }

    #[test]
    fn objects_keep_their_numbers_where_they_can() -> Result<(), String> {
        let ids = |names: &[&str]| {
            let photo = names.iter().map(|name| seen(name, "")).collect();
            number(&[photo], last_number).map(|numbered| numbered.ids[0].clone())
        };
        assert_eq!(ids(&["car_7", "car_3", "car_7"])?, [7, 3, 7]);
        assert_eq!(ids(&["0", "5", "65534"])?, [1, 6, 65535]);
        // Twice the same number, a name without one, and too large ones.
        assert_eq!((ids(&["tree_1", "car_1"])?, ids(&["tree", "car_9"])?), (vec![2, 1], vec![2, 1]));
        assert_eq!((ids(&["0", "65535"])?, ids(&["99999999999999999999"])?), (vec![1, 2], vec![1]));
        assert_eq!(number(&[], last_number)?, Numbered::default());
        Ok(())
    }

    #[test]
    fn without_names_every_photo_has_ids_of_its_own_by_kind() -> Result<(), String> {
        let (car, tree, none) = (seen("", "car"), seen("", "tree"), seen("", ""));
        let photos = [vec![car.clone(), tree.clone(), car.clone()], vec![], vec![tree.clone(), none, tree, car]];
        let numbered = number(&photos, last_number)?;
        // One of no kind is first, then two cars, then two trees.
        assert_eq!(numbered.ids, [vec![2, 4, 3], vec![], vec![4, 1, 5, 2]]);
        let names: Vec<(u32, &str)> = numbered.categories.iter().map(|(id, name)| (*id, name.as_str())).collect();
        assert_eq!(names, [(2, "car"), (3, "car"), (4, "tree"), (5, "tree")]);
        Ok(())
    }

    #[test]
    fn two_kinds_and_too_many_objects_are_named() {
        let two = number(&[vec![seen("1", "car")], vec![seen("1", "tree")]], last_number);
        assert!(two.as_ref().is_err_and(|e| e.contains("a car and a tree")), "{two:?}");
        let many = |object: &dyn Fn(usize) -> Seen| number(&[(0..65_536).map(object).collect()], |_| None);
        assert!(many(&|i| seen(&i.to_string(), "")).is_err_and(|e| e.contains("65536 objects")));
        assert!(many(&|_| seen("", "car")).is_err_and(|e| e.contains("65536 objects")));
    }

    #[test]
    fn names_are_cut_before_their_number() {
        let parts = |name| (without_number(name), last_number(name));
        assert_eq!((parts("car_007"), parts("a 1 b")), (("car", Some(7)), ("a 1 b", None)));
        assert_eq!((parts("12"), parts("é3"), parts("")), (("", Some(12)), ("é", Some(3)), ("", None)));
    }
}
