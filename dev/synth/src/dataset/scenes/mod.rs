//! The scenes that [`super::write`] can make.

mod cars;
mod facade;
mod hall;
mod lot;
mod orchard;
mod seats;
mod shelf;
mod unrelated;

use super::scene_builder::Scene;

/// How many objects a scene has.
#[derive(Clone, Copy, Debug)]
pub struct ObjectCount {
    /// Number of objects without `--instances`.
    pub usual: u32,
    /// Smallest number allowed.
    pub least: u32,
    /// Largest number allowed.
    pub most: u32,
}

/// A scene that can be made by name.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// Name on the command line.
    pub name: &'static str,
    /// What the scene shows, one line.
    pub about: &'static str,
    /// How many objects the scene can have.
    pub instances: ObjectCount,
    /// Builds the scene from a seed and a number of objects.
    pub build: fn(u64, u32) -> Scene,
}

const fn recipe(
    name: &'static str,
    about: &'static str,
    [usual, least, most]: [u32; 3],
    build: fn(u64, u32) -> Scene,
) -> Recipe {
    let instances = ObjectCount { usual, least, most };
    Recipe { name, about, instances, build }
}

/// All scenes that can be made by name.
pub const RECIPES: [Recipe; 11] = [
    recipe("cars", "racing cars on a car park: liveries, wings, roof racks", [8, 2, 64], cars::build),
    recipe("hall", "chairs, tables and vases in a hall, three groups", [18, 6, 60], hall::build),
    recipe("orchard", "fruit trees of all sizes", [12, 2, 64], orchard::build),
    recipe("facade", "windows of a house: blinds, curtains, flower boxes", [15, 2, 64], facade::build),
    recipe("unrelated", "a car and a chair in one group, where sharing must fail", [2, 2, 2], unrelated::build),
    recipe("lot", "a full car park from above; most of it is cars", [24, 2, 60], lot::build),
    recipe(
        "lot_sparse",
        "a full car park from low above: a car is in six photos at most",
        [60, 2, 60],
        lot::build_sparse,
    ),
    recipe("seats", "rows of theatre seats, some folded up or worn", [108, 4, 200], seats::build),
    recipe("seats_sparse", "the seats from close by: one is in six photos at most", [200, 4, 200], seats::build_sparse),
    recipe("shelf", "cartons, bottles and cans on a shelf; labels differ", [60, 12, 120], shelf::build),
    recipe(
        "shelf_sparse",
        "the shelf from close by: a package is in six photos at most",
        [120, 12, 120],
        shelf::build_sparse,
    ),
];
