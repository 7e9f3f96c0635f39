//! Clustering on tables made by hand: the mask that each point lies in.

use super::*;
use instgs_vk::math::rng::Rng;

/// Number of points of an object.
const POINTS: usize = 27;

/// By view, by point: the id of the mask it lies in; and positions of points.
pub(super) struct Table {
    ids: Vec<Vec<u16>>,
    positions: Vec<[f32; 3]>,
}

impl Table {
    /// Objects in a row, ten apart, each of 3x3x3 points one apart. `views` has the id of every object in each view,
    /// for all of its points; 0 = none.
    pub(super) fn new<const N: usize>(views: &[[u16; N]]) -> Self {
        let views: Vec<Vec<u16>> = views.iter().map(|view| view.to_vec()).collect();
        Self::of_objects(&views, N)
    }

    fn of_objects(views: &[Vec<u16>], objects: usize) -> Self {
        let of_view = |view: &Vec<u16>| view.iter().flat_map(|&id| [id; POINTS]).collect();
        let position = |i: usize| {
            let (object, p) = (i / POINTS, i % POINTS);
            [10 * object + p % 3, p / 3 % 3, p / 9].map(|v| v as f32)
        };
        Self { ids: views.iter().map(of_view).collect(), positions: (0..objects * POINTS).map(position).collect() }
    }

    pub(super) fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    pub(super) fn observations(&self, min_points: usize) -> Observations {
        let sightings: Vec<Vec<(u32, u16)>> =
            self.ids.iter().map(|view| (0..).zip(view.iter().copied()).filter(|&(_, id)| id != 0).collect()).collect();
        let ids_of_view: Vec<Vec<u16>> = sightings
            .iter()
            .map(|view| {
                let mut ids: Vec<u16> = view.iter().map(|&(_, id)| id).collect();
                ids.sort_unstable();
                ids.dedup();
                ids
            })
            .collect();
        Observations::new((0..self.positions.len() as u32).collect(), &ids_of_view, &sightings, min_points)
    }

    fn consensus(&self, options: &ConsensusOptions) -> Consensus {
        let observations = self.observations(options.min_points);
        let positions: Vec<[f32; 3]> = observations.gaussians.iter().map(|&i| self.positions[i as usize]).collect();
        of_observations(&observations, &positions, &BTreeMap::new(), options).unwrap()
    }

    /// By object found: the true objects with more than a few points in its masks, over all views.
    fn truth_of_objects(&self, table: &IdTable) -> BTreeMap<u16, Vec<usize>> {
        let mut counts: BTreeMap<u16, BTreeMap<usize, usize>> = BTreeMap::new();
        for (view, ids) in self.ids.iter().enumerate() {
            for (point, &id) in ids.iter().enumerate() {
                if let Some(object) = table.object_of(view, id).filter(|&object| object != 0) {
                    *counts.entry(object).or_default().entry(point / POINTS).or_default() += 1;
                }
            }
        }
        let large = |of: BTreeMap<usize, usize>| of.into_iter().filter(|&(_, n)| n > POINTS).map(|(o, _)| o).collect();
        counts.into_iter().map(|(object, of)| (object, large(of))).collect()
    }
}

/// Masks of `objects` in a row from a poor segmenter: an eighth are missing, some join neighbours, some split an
/// object; ids are random; a tenth of the points lie in no mask.
fn careless(seed: u64, views: usize, objects: usize, merged: f64) -> Table {
    let mut rng = Rng::new(seed);
    let mut table = Table::of_objects(&vec![vec![0; objects]; views], objects);
    for view in &mut table.ids {
        let mut ids: Vec<u16> = (1..=2 * objects as u16).map(|id| 3 * id).collect();
        rng.shuffle(&mut ids);
        for object in 0..objects {
            if rng.chance(0.12) {
                continue;
            }
            let own = &mut view[object * POINTS..(object + 1) * POINTS];
            own.fill(ids[object]);
            if rng.chance(0.12) {
                own[..9].fill(ids[objects + object]);
            }
        }
        for pair in 0..objects / 2 {
            if rng.chance(merged) {
                view[2 * pair * POINTS..(2 * pair + 2) * POINTS].fill(ids[2 * pair]);
            }
        }
        view.iter_mut().for_each(|id| *id = if rng.chance(0.1) { 0 } else { *id });
    }
    table
}

/// Every object is found once, and no mask of two objects is used.
#[test]
fn objects_are_found_in_the_masks_of_a_bad_segmenter() {
    for seed in 0..20 {
        let table = careless(seed, 24, 8, 0.2);
        let found = table.consensus(&ConsensusOptions::default());
        assert!(!found.report.ids_agree && found.report.agreement < 0.3, "{:?}", found.report);
        let truth: Vec<Vec<usize>> = table.truth_of_objects(&found.table).into_values().collect();
        let mut sorted = truth.clone();
        sorted.sort();
        assert_eq!(sorted, (0..8).map(|object| vec![object]).collect::<Vec<_>>(), "seed {seed}: {truth:?}");
        assert!(found.report.undersegmented > 5, "{:?}", found.report);
        let told = found.report.warning().unwrap();
        assert!(told.contains("merged into 8 objects") && told.contains("masks of several"), "{told}");
        assert_eq!(table.consensus(&ConsensusOptions::default()), found, "repeated");
    }
}

/// The same masks without the filter: neighbours become one object.
#[test]
fn without_the_filter_of_undersegmented_masks_neighbours_are_joined() {
    let lenient = ConsensusOptions { undersegmented_part: 1.0, ..ConsensusOptions::default() };
    let mixed = |seed: u64| {
        let table = careless(seed, 24, 8, 0.2);
        let truth = table.truth_of_objects(&table.consensus(&lenient).table);
        truth.len() != 8 || truth.values().any(|of| of.len() != 1)
    };
    let wrong = (0..20).filter(|&seed| mixed(seed)).count();
    assert!(wrong >= 10, "{wrong} of 20");
}

/// Ids that agree are kept, with their categories.
#[test]
fn ids_that_agree_are_kept() {
    let table = Table::new(&[[700, 2, 9], [700, 2, 0], [700, 2, 9], [0, 2, 9]]);
    let categories = BTreeMap::from([(2, "car".to_owned())]);
    let observations = table.observations(5);
    let found = of_observations(&observations, &table.positions, &categories, &ConsensusOptions::default()).unwrap();
    assert_eq!((found.table, found.report.ids_agree, found.report.agreement), (IdTable::Same, true, 1.0));
    let objects: Vec<_> = found.report.objects.iter().map(|o| (o.id, o.views, o.category.as_deref())).collect();
    assert_eq!(objects, [(2, 4, Some("car")), (9, 3, None), (700, 3, None)]);
    assert_eq!(found.report.warning(), None);
}

#[test]
fn an_object_has_the_name_of_most_of_its_masks() {
    let categories =
        BTreeMap::from([(1, "car"), (2, "car"), (3, "bus"), (4, "van")].map(|(id, name)| (id, name.to_owned())));
    let name = |ids: &[u16]| category(&ids.iter().map(|&id| MaskKey { view: 0, id }).collect::<Vec<_>>(), &categories);
    assert_eq!(name(&[3, 1, 2]).as_deref(), Some("car"));
    assert_eq!(name(&[4, 3, 9, 9, 9]).as_deref(), Some("bus"), "of equals the first; 9 has no name");
    assert_eq!(name(&[9]), None);
}

/// A few views see the whole object, most see pieces of it: one object with all masks.
#[test]
fn pieces_of_an_object_are_joined() {
    let mut table = Table::new(&[[1, 2], [2, 1], [5, 6], [6, 7], [1, 3], [3, 1], [4, 2], [2, 4], [1, 9], [9, 1]]);
    table.ids[3][..9].fill(100);
    table.ids[5][9..18].fill(100);
    let found = table.consensus(&ConsensusOptions::default());
    assert_eq!(table.truth_of_objects(&found.table).into_values().collect::<Vec<_>>(), [vec![0], vec![1]]);
    assert_eq!(found.report.objects[0].masks, 12);
    assert_eq!((found.report.objects[0].views, found.report.unassigned), (10, 0));
}

/// Masks of four points are too small to cluster, but join the object they lie on; masks beside it join none.
#[test]
fn small_masks_go_to_the_object_that_has_their_points() {
    let mut table = Table::new(&[[1, 2], [2, 1], [3, 4], [0, 5], [0, 7]]);
    table.ids[3][3..7].fill(8);
    table.ids[4][3..5].fill(9);
    let found = table.consensus(&ConsensusOptions::default());
    assert_eq!((found.table.object_of(3, 8), found.table.object_of(4, 9)), (Some(1), None), "two points are too few");
    assert_eq!((found.report.objects[0].masks, found.report.unassigned), (4, 1));
}

/// Three views see two objects as one, with masks that contain either; four see two.
#[test]
fn repeated_objects_side_by_side_are_not_joined() {
    let table = Table::new(&[[1, 2], [2, 1], [1, 2], [2, 1], [7, 7], [8, 8], [9, 9]]);
    let found = table.consensus(&ConsensusOptions { undersegmented_part: 1.0, ..ConsensusOptions::default() });
    let truth: Vec<Vec<usize>> = table.truth_of_objects(&found.table).into_values().collect();
    assert!(truth.len() == 2 && truth[0] != truth[1], "{truth:?}");
}

/// Two objects that are missed in turn and merged once: only space tells them apart.
#[test]
fn what_does_not_hang_together_is_taken_apart() {
    let views = [[1, 0], [2, 0], [3, 0], [0, 4], [0, 5], [0, 6], [7, 7]];
    let table = Table::new(&views);
    let found = table.consensus(&ConsensusOptions { undersegmented_part: 1.0, ..ConsensusOptions::default() });
    let mut near = Table::new(&views);
    near.positions.iter_mut().filter(|p| p[0] >= 10.0).for_each(|p| p[0] -= 7.0);
    let joined = near.consensus(&ConsensusOptions { undersegmented_part: 1.0, ..ConsensusOptions::default() });
    assert_eq!((found.report.objects.len(), joined.report.objects.len()), (2, 1), "{:?}", found.report);
}

/// Four views see one side of an object and four the other, with a ninth of its points in common; all see another
/// object.
#[test]
fn sides_of_an_object_are_one_object() {
    let mut table = Table::new(&[[1, 2], [3, 1], [4, 5], [6, 3], [2, 1], [4, 3], [5, 4], [7, 6]]);
    table.ids[..4].iter_mut().for_each(|view| view[15..POINTS].fill(0));
    table.ids[4..].iter_mut().for_each(|view| view[..12].fill(0));
    let found = table.consensus(&ConsensusOptions::default());
    let truth = table.truth_of_objects(&found.table);
    assert_eq!(truth.into_values().collect::<Vec<_>>(), [vec![0], vec![1]]);
    assert_eq!(found.report.objects.iter().map(|object| object.masks).collect::<Vec<_>>(), [8, 8]);
}
