//! The object at a point of a cloud: the Gaussians connected to that point above the ground, and a box around them.

use std::f64::consts::FRAC_PI_2;

use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::components::{components, usual_reach};
use super::ground_plane::ground_plane;
use instgs_vk::math::covariance::sigmoid;
use instgs_vk::math::nearest::{Neighbour, PointSet};
use instgs_vk::math::plane::Plane;
use instgs_vk::math::sh::widened;
use instgs_vk::math::statistics::{median, percentile};
use instgs_vk::scene::Gaussians;

/// Fainter Gaussians belong to no surface; the same limit as in registration.
const MIN_OPACITY: f64 = 0.3;
/// Half the thickness of the slab in which the ground is searched, in usual reaches of the cloud (`usual_reach`).
const GROUND_REACH: f64 = 0.5;
/// Height above the ground from which Gaussians count as standing on it, in usual reaches: the ground's own are lower.
const LIFT: f64 = 0.25;
/// Rank of the neighbour whose distance is a Gaussian's spacing.
const NEIGHBOURS: usize = 6;
/// Gaussians around the place that give the first spacing: fewer than the smallest object has.
const AROUND: usize = 60;
/// Gaussians are connected up to this many times the spacing. Smaller values break objects apart; larger ones join
/// chairs to their table.
const REACH: f64 = 1.4;
/// Rounds in which the spacing grows with the piece: the place can be denser than the rest of its object.
const ROUNDS: usize = 5;
/// The piece that holds most of this many nearest Gaussians is the one at the place.
const VOTERS: usize = 8;
/// Gaussians around the place that are searched.
const MOST: usize = 200_000;
/// A piece that does not reach the ground and has others beside it is part of a larger object, like a bunch of leaves:
/// its spacing grows by this factor until it reaches the ground or nothing is beside it.
const WIDER: f64 = 1.4;
/// How often the spacing grows by [`WIDER`] at most.
const WIDENINGS: usize = 5;
/// A piece is among others if more than this part of its members have something beside them.
const AMONG_PART: f64 = 0.1;
/// What is no higher than this lowest part of the members does not count as beside: the piece lies on it, and may sink
/// in.
const BOTTOM_PART: f64 = 0.1;
/// Neighbours of a member that are searched for something beside it.
const BESIDE: usize = 24;
/// A piece with more than this part of everything above the ground is no object but, for instance, a wall.
const MOST_PART: f64 = 0.5;
/// Edge of the box around an unclear place, in distances from the eye: a sixth of the picture's height.
const USUAL_SIZE: f64 = 0.15;
/// A piece with fewer Gaussians is no object.
const FEWEST: usize = 12;
/// Yaw angles of the box that are tried, one per degree; a rectangle repeats after 90.
const TURNS: usize = 90;

/// A box with one axis along the scene's up direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UprightBox {
    /// Centre of the box, world units.
    pub center: DVec3,
    /// Edge lengths, world units: x and y are level with x the longer one, z is upright.
    pub size: DVec3,
    /// Rotation from the box's axes to the world's.
    pub world_from_box: DQuat,
}

/// What [`Surroundings::at`] found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Standing {
    /// An object, and the box around it.
    Object(UprightBox),
    /// No object could be separated from its surroundings; a cube of visible size at the place.
    Unclear(UprightBox),
    /// The place is on the ground.
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

/// A cloud prepared for [`Surroundings::at`].
pub struct Surroundings {
    up: DVec3,
    ground: Option<Plane>,
    /// Height above the ground from which Gaussians count as standing on it, world units.
    lift: f64,
    /// Means of the opaque Gaussians above the ground.
    positions: Vec<[f32; 3]>,
    set: PointSet,
}

impl Surroundings {
    /// `up` is a unit vector of the world; where a ground plane is found, its normal replaces it.
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

    /// The up direction: a unit vector of the world.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// The object at a point of the world that is seen from `eye`; both world units.
    pub fn at(&self, place: DVec3, eye: DVec3) -> Standing {
        let near = self.set.nearest(place.as_vec3().to_array(), MOST);
        let height = self.ground.map_or(f64::INFINITY, |ground| ground.height(place));
        let distance = near.first().map_or(f64::INFINITY, |n| n.squared_distance.sqrt());
        // The foot of an object is as low as the ground, but close to the rest of the object.
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
        // Hills and skies enclose the eye.
        if found.contains(eye) { unclear() } else { Standing::Object(found) }
    }

    /// The piece connected to the first of `points`, as indices into them, and its spacing; `None` without points, or
    /// if they coincide.
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

    /// Grows a piece that hangs in the air beside others until it stands, and returns it with its spacing; `close`
    /// itself if that leads to no object. `near` holds the points' indices in the set.
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

    /// Whether enough members of a piece have something else within `reach` that is higher above the ground than
    /// `bottom`.
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

    /// Median distance of some points to their sixth neighbour; 0 if there are none.
    fn spacing(&self, points: &[[f32; 3]], of: &[u32]) -> f64 {
        let farthest = |&i: &u32| {
            let neighbours = self.set.nearest(points[i as usize], NEIGHBOURS + 1);
            neighbours.last().map_or(0.0, |n| n.squared_distance.sqrt())
        };
        median(&of.par_iter().map(farthest).collect::<Vec<f64>>())
    }

    /// The upright box with the smallest footprint; it is extended to the ground if it nearly reaches it.
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

/// The connected piece at the first of `points` for a given spacing.
fn first_piece(points: &[[f32; 3]], spacing: f64) -> Option<Vec<u32>> {
    let pieces = components(points, REACH * spacing);
    let votes = |piece: &&Vec<u32>| piece.iter().take_while(|&&i| (i as usize) < VOTERS).count();
    // `max_by_key` returns the last of equal maxima: in reverse order, the largest piece.
    pieces.iter().rev().max_by_key(votes).cloned()
}

impl UprightBox {
    fn contains(&self, point_world: DVec3) -> bool {
        let local = self.world_from_box.inverse() * (point_world - self.center);
        local.abs().cmple(0.5 * self.size).all()
    }

    /// An upright cube with its centre at a place.
    fn cube(center: DVec3, edge: f64, up: DVec3) -> Self {
        let side = up.any_orthonormal_vector();
        let turn = DMat3::from_cols(side, up.cross(side), up);
        Self { center, size: DVec3::splat(edge), world_from_box: DQuat::from_mat3(&turn) }
    }
}

/// A rectangle around points of a plane; its axes are turned by `angle` radians.
#[derive(Clone, Copy, Debug, Default)]
struct Footprint {
    angle: f64,
    low: DVec2,
    high: DVec2,
}

impl Footprint {
    /// The footprint of the smallest area, with the longer edge first.
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
    use instgs_vk::math::covariance::logit;
    use instgs_vk::math::rng::Rng;

    /// Points on a floor at height 1 and on the sides and tops of blocks on it: (centre, edges, yaw).
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
        // Scattered points between the blocks that are connected to nothing.
        for _ in 0..4000 {
            put(DVec3::new(rng.range(-6.0, 6.0), rng.range(-6.0, 6.0), rng.range(1.0, 3.0)), 0.1);
        }
        for &([x, y], size, angle) in blocks {
            for _ in 0..800 {
                let mut p = DVec3::new(rng.range(-0.5, 0.5), rng.range(-0.5, 0.5), rng.range(-0.5, 0.5));
                // Projected onto one of the five visible faces.
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

    /// Points on a floor, in balls (centre, radius, count), and on a table: its top at height 1.8 and one leg.
    fn cloud_of_bunches(bunches: &[(DVec3, f64, usize)]) -> Gaussians {
        let mut rng = Rng::new(5);
        let mut out = cloud(&[], DVec3::Z);
        let mut points = Vec::new();
        for &(middle, radius, count) in bunches {
            points.extend((0..count).map(|_| middle + radius * rng.unit_vector()));
        }
        let mut around = |height: f64| DVec3::new(rng.range(-0.05, 0.05), rng.range(-0.05, 0.05), height);
        // The trunk and the leg stand at the centres of the bunches and of the table.
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
            // Evenly distributed on a sphere.
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
        // A few have nothing within reach. Without growing, no piece is an object.
        let whole = bunches[..48].iter().filter(holds_tree).count();
        assert!(whole >= 30, "{whole}");
        let Standing::Object(found) = around.at(vase.0 + DVec3::Z * 0.12, eye) else { panic!() };
        assert!((found.size - DVec3::splat(0.25)).abs().max_element() < 0.08, "{found:?}");
    }

    #[test]
    fn what_cannot_be_told_apart_gets_a_box_of_the_usual_size() {
        // Everything above the ground is one wall.
        let wall = cloud(&[([0.0, 0.0], DVec3::new(8.0, 0.2, 3.0), 0.0)], DVec3::Z);
        let (place, eye) = (DVec3::new(1.0, 0.1, 2.0), DVec3::new(1.0, 4.1, 5.0));
        let Standing::Unclear(found) = Surroundings::new(&wall, DVec3::Z).at(place, eye) else { panic!() };
        assert_eq!((found.center, found.size), (place, DVec3::splat(0.75)));
        // One of three blocks, seen from inside, as hills enclose the eye.
        let block = |x: f64| ([x, 0.0], DVec3::new(2.0, 2.0, 1.0), 0.0);
        let inside = Surroundings::new(&cloud(&[block(-4.0), block(0.0), block(4.0)], DVec3::Z), DVec3::Z);
        let wall = DVec3::new(1.0, 0.0, 1.5);
        assert!(matches!(inside.at(wall, DVec3::new(0.0, 0.0, 1.5)), Standing::Unclear(_)));
        assert!(matches!(inside.at(wall, DVec3::new(2.0, 0.0, 1.5)), Standing::Object(_)));
        let empty = Surroundings::new(&Gaussians::default(), DVec3::Z);
        assert!(matches!(empty.at(place, eye), Standing::Unclear(_)));
    }
}
