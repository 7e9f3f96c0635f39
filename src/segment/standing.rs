//! What stands at a place of a cloud: the Gaussians that hang together with it above the ground, and a box around them.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::components::{components, usual_reach};
use super::ground_plane::ground_plane;
use crate::math::covariance::sigmoid;
use crate::math::nearest::{Neighbour, PointSet};
use crate::math::plane::Plane;
use crate::math::sh::widened;
use crate::math::statistics::{median, percentile};
use crate::scene::Gaussians;

/// Gaussians that are fainter belong to no surface: as in registration.
const MIN_OPACITY: f64 = 0.3;
/// Half the thickness of what is searched for the ground, in usual reaches of the cloud; and what is above this part of it
/// stands on the ground. Measured on trained clouds of 40,000 Gaussians: the ground's own are up to 0.2 reaches above it.
const GROUND_REACH: f64 = 0.5;
const LIFT: f64 = 0.25;
/// Neighbours that tell how far apart an object's Gaussians are.
const NEIGHBOURS: usize = 6;
/// Gaussians around the place whose neighbours are looked at: less than the smallest object has.
const AROUND: usize = 60;
/// Gaussians hang together up to this many times their median distance to that neighbour. Measured on trained cars, halls
/// and orchards (clouds of 40,000 Gaussians, two of each of the first): at 1.4 every car, chair, vase and tree but one is a
/// piece of its own, tables with the chairs that touch them; at 1.0 some fall apart, at 2 chairs join their tables.
const REACH: f64 = 1.4;
/// Rounds of growing: where the place is denser than the rest of its object, what hangs together there says how far apart
/// Gaussians are farther away.
const ROUNDS: usize = 5;
/// The nearest so many decide of which piece the place is.
const VOTERS: usize = 8;
/// Gaussians around the place that are searched for what hangs together.
const MOST: usize = 200_000;
/// What hangs in the air among others is a part of its object, as a bunch of leaves is of a tree: it is widened by this
/// factor until it reaches the ground or nothing is beside it, this many times at most. Measured on trained orchards (three
/// clouds of 40,000 Gaussians, twelve places on each of 36 trees): 81 % of the boxes hold their tree without it, 87 % with
/// it; most others are of trunks. With 1.25 and 8 times 84 %. On two halls and two sets of cars nothing changes.
const WIDER: f64 = 1.4;
const WIDENINGS: usize = 5;
/// More than this part of its members have something beside them: it is among others.
const AMONG_PART: f64 = 0.1;
/// What a piece lies on is not beside it, nor what is no higher than this part of its members: they may sink in.
const BOTTOM_PART: f64 = 0.1;
/// Neighbours of a member that are looked at for it.
const BESIDE: usize = 24;
/// A piece with more than this part of all that stands is no object but, for instance, a wall.
const MOST_PART: f64 = 0.5;
/// A box around what is unclear, in distances from the eye: a sixth of what a picture is high.
const USUAL_SIZE: f64 = 0.15;
/// Fewer Gaussians are no object.
const FEWEST: usize = 12;
/// Turns of the box that are tried, one per degree; a rectangle is the same after 90.
const TURNS: usize = 90;

/// An upright box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UprightBox {
    /// World units.
    pub center: DVec3,
    /// Edges, world units; the longer level one is x, the upright one z.
    pub size: DVec3,
    /// From the box's axes to the world's.
    pub world_from_box: DQuat,
}

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Standing {
    /// An object, and a box around it.
    Object(UprightBox),
    /// Something that cannot be told from what is around it, and a box that one sees well.
    Unclear(UprightBox),
    /// The ground.
    Ground,
}

/// Points that hang together.
#[derive(Clone)]
struct Piece {
    /// Indices of the points.
    members: Vec<u32>,
    /// How far apart its points usually are, world units.
    spacing: f64,
}

/// A cloud, prepared for questions of what stands where.
pub struct Surroundings {
    up: DVec3,
    ground: Option<Plane>,
    /// What is higher than this above it stands on it, world units.
    lift: f64,
    /// Of the opaque Gaussians above the ground.
    positions: Vec<[f32; 3]>,
    set: PointSet,
}

impl Surroundings {
    /// Of a cloud whose vertical is `up`, a unit vector; the ground's own direction counts if there is one.
    pub fn new(cloud: &Gaussians, up: DVec3) -> Self {
        let is_opaque = |&i: &usize| cloud.is_finite(i) && sigmoid(f64::from(cloud.opacity_logits[i])) > MIN_OPACITY;
        let mut positions: Vec<[f32; 3]> = (0..cloud.len()).filter(is_opaque).map(|i| cloud.means[i]).collect();
        let reach = usual_reach(&positions);
        let ground = reach.and_then(|reach| ground_plane(&positions, up, GROUND_REACH * reach));
        let lift = LIFT * reach.unwrap_or(0.0);
        if let Some(ground) = ground {
            positions.retain(|&p| ground.height(widened(p)) > lift);
        }
        let set = PointSet::new(&positions);
        Self { up: ground.map_or(up, |ground| ground.normal), ground, lift, positions, set }
    }

    /// Up, as a unit vector of the world.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// What stands at a place of the world that is seen from `eye`.
    pub fn at(&self, place: DVec3, eye: DVec3) -> Standing {
        let near = self.set.nearest(place.as_vec3().to_array(), MOST);
        let height = self.ground.map_or(f64::INFINITY, |ground| ground.height(place));
        let distance = near.first().map_or(f64::INFINITY, |n| n.squared_distance.sqrt());
        // The foot of an object is as low as the ground, but near the rest of it.
        if height <= self.lift && distance > 2.0 * self.lift {
            return Standing::Ground;
        }
        let points: Vec<[f32; 3]> = near.iter().map(|n| self.positions[n.index as usize]).collect();
        let unclear = || Standing::Unclear(UprightBox::cube(place, USUAL_SIZE * eye.distance(place), self.up));
        let Some(close) = self.piece_around(&points) else { return unclear() };
        let near: Vec<u32> = near.iter().map(|n| n.index).collect();
        let Piece { members: piece, spacing } = self.widened_to_the_ground(&near, &points, close);
        if piece.len() < FEWEST || self.is_too_large(&piece) {
            return unclear();
        }
        let members: Vec<DVec3> = piece.iter().map(|&i| widened(points[i as usize])).collect();
        let found = self.box_around(&members, 0.5 * spacing);
        // Hills and skies are around everything.
        if found.contains(eye) { unclear() } else { Standing::Object(found) }
    }

    /// What hangs together with the first of some points, and how far apart its points are; `None` without points, and if
    /// they are in one place.
    fn piece_around(&self, points: &[[f32; 3]]) -> Option<Piece> {
        let first: Vec<u32> = (0..points.len().min(AROUND) as u32).collect();
        let mut spacing = self.spacing(points, &first);
        let mut best = None;
        for _ in 0..ROUNDS {
            if spacing <= 0.0 {
                break;
            }
            let members = first_piece(points, spacing)?;
            let wider = self.spacing(points, &members);
            best = Some(Piece { members, spacing });
            if wider <= spacing {
                break;
            }
            spacing = wider;
        }
        best
    }

    /// A piece that does not stand but has others beside it, with more of what is around it; the piece itself if that does
    /// not make it an object. `near` are the points as indices of the set.
    fn widened_to_the_ground(&self, near: &[u32], points: &[[f32; 3]], close: Piece) -> Piece {
        let Some(ground) = self.ground else { return close };
        let Piece { members: mut piece, mut spacing } = close.clone();
        for _ in 0..WIDENINGS {
            let heights: Vec<f64> = piece.iter().map(|&i| ground.height(widened(points[i as usize]))).collect();
            let stands = percentile(&heights, 0.0) < 2.0 * self.lift + spacing;
            let bottom = percentile(&heights, BOTTOM_PART);
            if stands || !self.is_among_others(near, &piece, ground, bottom, WIDER * REACH * spacing) {
                return Piece { members: piece, spacing };
            }
            spacing *= WIDER;
            match first_piece(points, spacing) {
                Some(wider) if !self.is_too_large(&wider) => piece = wider,
                _ => break,
            }
        }
        close
    }

    /// True if much of a piece has something else within `reach` that is higher above the ground than `bottom`.
    fn is_among_others(&self, near: &[u32], piece: &[u32], ground: Plane, bottom: f64, reach: f64) -> bool {
        let mut is_member = vec![false; self.positions.len()];
        piece.iter().for_each(|&i| is_member[near[i as usize] as usize] = true);
        let is_beside = |n: &Neighbour| {
            let other = n.index as usize;
            !is_member[other]
                && n.squared_distance < reach * reach
                && ground.height(widened(self.positions[other])) > bottom
        };
        let has_beside = |&&i: &&u32| {
            let from = self.positions[near[i as usize] as usize];
            self.set.nearest(from, BESIDE).iter().any(is_beside)
        };
        piece.par_iter().filter(has_beside).count() as f64 > AMONG_PART * piece.len() as f64
    }

    fn is_too_large(&self, piece: &[u32]) -> bool {
        piece.len() as f64 > MOST_PART * self.positions.len() as f64
    }

    /// How far apart some of the points usually are from their neighbours; 0 if there are none.
    fn spacing(&self, points: &[[f32; 3]], of: &[u32]) -> f64 {
        let farthest = |&i: &u32| {
            let neighbours = self.set.nearest(points[i as usize], NEIGHBOURS + 1);
            neighbours.last().map_or(0.0, |n| n.squared_distance.sqrt())
        };
        median(&of.par_iter().map(farthest).collect::<Vec<f64>>())
    }

    /// The upright box of the least footprint; what nearly reaches the ground stands on it.
    fn box_around(&self, members: &[DVec3], margin: f64) -> UprightBox {
        let side = self.up.any_orthonormal_vector();
        let ahead = self.up.cross(side);
        let flat: Vec<DVec2> = members.iter().map(|p| DVec2::new(side.dot(*p), ahead.dot(*p))).collect();
        let footprint = Footprint::around(&flat);
        let heights = members.iter().map(|p| self.up.dot(*p));
        let (mut low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        low -= margin;
        if let Some(ground) = self.ground.filter(|ground| low - ground.offset < 2.0 * self.lift) {
            low = ground.offset;
        }
        let x = side * footprint.angle.cos() + ahead * footprint.angle.sin();
        let y = self.up.cross(x);
        let [from, to] = [footprint.low - margin, footprint.high + margin];
        let middle = 0.5 * (from + to);
        UprightBox {
            center: x * middle.x + y * middle.y + self.up * (0.5 * (low + high + margin)),
            size: DVec3::new(to.x - from.x, to.y - from.y, high + margin - low),
            world_from_box: DQuat::from_mat3(&DMat3::from_cols(x, y, self.up)),
        }
    }
}

/// What hangs together with the first points when neighbours are `spacing` apart.
fn first_piece(points: &[[f32; 3]], spacing: f64) -> Option<Vec<u32>> {
    let pieces = components(points, REACH * spacing);
    let votes = |piece: &&Vec<u32>| piece.iter().take_while(|&&i| (i as usize) < VOTERS).count();
    // Of equals the last one wins: the largest.
    pieces.iter().rev().max_by_key(votes).cloned()
}

impl UprightBox {
    fn contains(&self, point_world: DVec3) -> bool {
        let local = self.world_from_box.inverse() * (point_world - self.center);
        local.abs().cmple(0.5 * self.size).all()
    }

    /// With six equal faces, around a place.
    fn cube(center: DVec3, edge: f64, up: DVec3) -> Self {
        let side = up.any_orthonormal_vector();
        let turn = DMat3::from_cols(side, up.cross(side), up);
        Self { center, size: DVec3::splat(edge), world_from_box: DQuat::from_mat3(&turn) }
    }
}

/// A rectangle around points of a plane, along axes that are turned by an angle.
#[derive(Clone, Copy, Debug, Default)]
struct Footprint {
    angle: f64,
    low: DVec2,
    high: DVec2,
}

impl Footprint {
    /// The one of the least area, its longer edge first.
    fn around(flat: &[DVec2]) -> Self {
        let turned = (0..TURNS).map(|turn| Self::at((turn as f64).to_radians(), flat));
        let least = turned.min_by(|a, b| a.area().total_cmp(&b.area())).unwrap_or_default();
        let edges = least.high - least.low;
        if edges.y > edges.x { Self::at(least.angle + FRAC_PI_2, flat) } else { least }
    }

    fn at(angle: f64, flat: &[DVec2]) -> Self {
        let back = DVec2::from_angle(-angle);
        let wider = |(low, high): (DVec2, DVec2), p: &DVec2| {
            let p = back.rotate(*p);
            (low.min(p), high.max(p))
        };
        let (low, high) = flat.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), wider);
        Self { angle, low, high }
    }

    fn area(&self) -> f64 {
        let edges = self.high - self.low;
        edges.x * edges.y
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::covariance::logit;
    use crate::math::rng::Rng;

    /// Points on a floor at height 1 and on the sides and tops of blocks on it: (middle, edges, turn).
    fn cloud(blocks: &[([f64; 2], DVec3, f64)], up: DVec3) -> Gaussians {
        let mut rng = Rng::new(11);
        let turn = DQuat::from_rotation_arc(DVec3::Z, up);
        let mut out = Gaussians::with_capacity(0, 0);
        let mut put = |point: DVec3, opacity: f64| {
            out.means.push((turn * point).as_vec3().to_array());
            out.quats.push([1.0, 0.0, 0.0, 0.0]);
            out.log_scales.push([-4.0; 3]);
            out.opacity_logits.push(logit(opacity) as f32);
            out.sh.push([0.0; 3]);
        };
        for _ in 0..4000 {
            put(DVec3::new(rng.range(-6.0, 6.0), rng.range(-6.0, 6.0), 1.0 + 0.01 * rng.normal()), 0.9);
        }
        // Fog between the blocks, of which nothing hangs together.
        for _ in 0..4000 {
            put(DVec3::new(rng.range(-6.0, 6.0), rng.range(-6.0, 6.0), rng.range(1.0, 3.0)), 0.1);
        }
        for &([x, y], size, angle) in blocks {
            for _ in 0..800 {
                let mut p = DVec3::new(rng.range(-0.5, 0.5), rng.range(-0.5, 0.5), rng.range(-0.5, 0.5));
                // Onto one of the five faces that are seen.
                let face = rng.index(5);
                p[face % 3] = if face < 3 { 0.5 } else { -0.5 };
                let p = DQuat::from_rotation_z(angle) * (p * size);
                put(DVec3::new(x, y, 1.0 + 0.5 * size.z) + p, 0.9);
            }
        }
        out
    }

    #[test]
    fn a_box_is_where_the_block_is_whatever_is_up() {
        let blocks = [
            ([0.0, 0.0], DVec3::new(2.0, 1.0, 0.8), 0.5),
            ([3.0, 0.5], DVec3::new(1.0, 2.0, 0.8), -0.3),
            ([-2.0, 3.0], DVec3::new(0.5, 0.5, 1.5), 0.0),
        ];
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.2, 0.3, -1.0).normalize()] {
            let turn = DQuat::from_rotation_arc(DVec3::Z, up);
            let (around, eye) = (Surroundings::new(&cloud(&blocks, up), up), turn * DVec3::new(0.0, -20.0, 10.0));
            assert!(around.up().dot(up) > 0.9999);
            for &([x, y], size, angle) in &blocks {
                // The top, and a side near the floor.
                let side = DQuat::from_rotation_z(angle) * DVec3::new(0.5 * size.x, 0.0, 0.0);
                for place in [DVec3::new(x, y, 1.0 + size.z), DVec3::new(x, y, 1.02) + side] {
                    let Standing::Object(found) = around.at(turn * place, eye) else { panic!("{place} {up}") };
                    let want = turn * DVec3::new(x, y, 1.0 + 0.5 * size.z);
                    assert!(found.center.distance(want) < 0.1, "{place}: {found:?} {want}");
                    let edges = [size.x.max(size.y), size.x.min(size.y), size.z];
                    assert!((found.size - DVec3::from_array(edges)).abs().max_element() < 0.2, "{place}: {found:?}");
                    let long = if size.x >= size.y { DVec3::X } else { DVec3::Y };
                    let along = turn * (DQuat::from_rotation_z(angle) * long);
                    let got = found.world_from_box * DVec3::X;
                    assert!(size.x == size.y || got.dot(along).abs() > 0.99, "{place}: {found:?}");
                    assert!((found.world_from_box * DVec3::Z).dot(up) > 0.9999);
                }
            }
            assert_eq!(around.at(turn * DVec3::new(-3.0, -3.0, 1.0), eye), Standing::Ground);
        }
    }

    /// Points near those of a floor, each of these groups: (middle, radius, count), and a table: its top at height 1.8,
    /// one leg.
    fn cloud_of_bunches(bunches: &[(DVec3, f64, usize)]) -> Gaussians {
        let mut rng = Rng::new(5);
        let mut out = cloud(&[], DVec3::Z);
        let mut points = Vec::new();
        for &(middle, radius, count) in bunches {
            points.extend((0..count).map(|_| middle + radius * rng.unit_vector()));
        }
        let mut around = |height: f64| DVec3::new(rng.range(-0.05, 0.05), rng.range(-0.05, 0.05), height);
        // Trunk and leg, at the bunches' and the table's middle.
        points.extend((0..200).map(|i| around(1.0 + 0.006 * f64::from(i))));
        points.extend((0..200).map(|i| DVec3::new(4.0, 4.0, 0.0) + around(1.0 + 0.004 * f64::from(i))));
        points.extend((0..1500).map(|_| DVec3::new(rng.range(3.2, 4.8), rng.range(3.2, 4.8), 1.8)));
        for p in points {
            out.means.push(p.as_vec3().to_array());
            out.quats.push([1.0, 0.0, 0.0, 0.0]);
            out.log_scales.push([-4.0; 3]);
            out.opacity_logits.push(logit(0.9) as f32);
            out.sh.push([0.0; 3]);
        }
        out
    }

    #[test]
    fn a_bunch_of_leaves_is_of_its_tree_and_a_vase_is_not_of_its_table() {
        let crown = (0..48).map(|i| {
            // Evenly around a ball.
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 48.0;
            let turn = 2.399_963 * f64::from(i);
            let level = (1.0 - z * z).sqrt();
            (DVec3::new(0.0, 0.0, 2.8) + 0.7 * DVec3::new(level * turn.cos(), level * turn.sin(), z), 0.1, 20)
        });
        let vase = (DVec3::new(4.1, 3.9, 2.06), 0.12, 300);
        let bunches: Vec<_> = crown.chain([vase]).collect();
        let around = Surroundings::new(&cloud_of_bunches(&bunches), DVec3::Z);
        let eye = DVec3::new(0.0, -20.0, 10.0);
        let holds_tree = |&&(middle, ..): &&(DVec3, f64, usize)| match around.at(middle, eye) {
            Standing::Object(found) => (found.size - DVec3::new(1.6, 1.6, 2.6)).abs().max_element() < 0.3,
            _ => false,
        };
        // A few have nothing within reach. Without widening it is none.
        let whole = bunches[..48].iter().filter(holds_tree).count();
        assert!(whole >= 30, "{whole}");
        let Standing::Object(found) = around.at(vase.0 + DVec3::Z * 0.12, eye) else { panic!() };
        assert!((found.size - DVec3::splat(0.25)).abs().max_element() < 0.08, "{found:?}");
    }

    #[test]
    fn what_cannot_be_told_apart_gets_a_box_of_the_usual_size() {
        // All that stands is one wall.
        let wall = cloud(&[([0.0, 0.0], DVec3::new(8.0, 0.2, 3.0), 0.0)], DVec3::Z);
        let (place, eye) = (DVec3::new(1.0, 0.1, 2.0), DVec3::new(1.0, 4.1, 5.0));
        let Standing::Unclear(found) = Surroundings::new(&wall, DVec3::Z).at(place, eye) else { panic!() };
        assert_eq!((found.center, found.size), (place, DVec3::splat(0.75)));
        // One of three blocks, from inside of it: as hills are around the eye.
        let block = |x: f64| ([x, 0.0], DVec3::new(2.0, 2.0, 1.0), 0.0);
        let inside = Surroundings::new(&cloud(&[block(-4.0), block(0.0), block(4.0)], DVec3::Z), DVec3::Z);
        let wall = DVec3::new(1.0, 0.0, 1.5);
        assert!(matches!(inside.at(wall, DVec3::new(0.0, 0.0, 1.5)), Standing::Unclear(_)));
        assert!(matches!(inside.at(wall, DVec3::new(2.0, 0.0, 1.5)), Standing::Object(_)));
        let empty = Surroundings::new(&Gaussians::default(), DVec3::Z);
        assert!(matches!(empty.at(place, eye), Standing::Unclear(_)));
    }
}
