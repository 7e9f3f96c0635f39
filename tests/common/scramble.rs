//! Masks as a segmenter of single images gives them, from true ones.

use std::collections::{BTreeMap, BTreeSet};

use instgs_io::masks::Mask;
use instgs_vk::math::rng::Rng;

/// How masks are spoilt.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scramble {
    /// Part of the masks that are missing.
    pub(crate) missing: f64,
    /// Part of the masks that are one with the mask beside them.
    pub(crate) merged: f64,
}

impl Default for Scramble {
    fn default() -> Self {
        Self { missing: 0.1, merged: 0.05 }
    }
}

/// Spoilt masks, and what they show.
pub(crate) struct Scrambled {
    pub(crate) masks: Vec<Mask>,
    /// By view: the true objects of every id, two where they are merged.
    pub(crate) truth: Vec<BTreeMap<u16, BTreeSet<u16>>>,
}

/// New ids by chance in every view, with some masks missing and some merged with the nearest.
pub(crate) fn scrambled(masks: &[Mask], how: Scramble, seed: u64) -> Scrambled {
    let of_view = |(view, mask)| scrambled_view(mask, how, &mut Rng::new(seed).fork(view));
    let views: Vec<_> = (0..).zip(masks).map(of_view).collect();
    let (masks, truth) = views.into_iter().unzip();
    Scrambled { masks, truth }
}

fn scrambled_view(mask: &Mask, how: Scramble, rng: &mut Rng) -> (Mask, BTreeMap<u16, BTreeSet<u16>>) {
    let present: Vec<u16> = mask.ids_present().into_keys().collect();
    let shown: Vec<u16> = present.into_iter().filter(|_| !rng.chance(how.missing)).collect();
    let mut shuffled: Vec<u16> = (1..=shown.len() as u16).collect();
    rng.shuffle(&mut shuffled);
    let mut new_id: BTreeMap<u16, u16> = shown.iter().copied().zip(shuffled).collect();
    for &id in &shown {
        if rng.chance(how.merged)
            && let Some(beside) = nearest(mask, id, &shown)
        {
            let (of_id, of_beside) = (new_id[&id], new_id[&beside]);
            new_id.values_mut().filter(|new| **new == of_id).for_each(|new| *new = of_beside);
        }
    }
    let ids = mask.ids.iter().map(|id| new_id.get(id).copied().unwrap_or(0)).collect();
    let mut truth: BTreeMap<u16, BTreeSet<u16>> = BTreeMap::new();
    for (&old, &new) in &new_id {
        truth.entry(new).or_default().insert(old);
    }
    (Mask { ids, ..*mask }, truth)
}

/// The object with the pixel that is nearest to a pixel of `id`, the lower of equals.
fn nearest(mask: &Mask, id: u16, among: &[u16]) -> Option<u16> {
    let width = mask.width as usize;
    let pixels = |of: u16| (0..mask.ids.len()).filter(move |&i| mask.ids[i] == of).map(move |i| (i % width, i / width));
    let own: Vec<(usize, usize)> = pixels(id).collect();
    let square = |other: u16| {
        let to_own =
            |(x, y): (usize, usize)| own.iter().map(move |&(u, v)| x.abs_diff(u).pow(2) + y.abs_diff(v).pow(2)).min();
        pixels(other).filter_map(to_own).min()
    };
    among.iter().copied().filter(|&other| other != id).min_by_key(|&other| (square(other), other))
}
