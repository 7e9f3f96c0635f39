//! Samples points on an object's surface from its Gaussians.

use std::f64::consts::TAU;

use glam::DVec3;

use super::fpfh::{Feature, features};
use super::icp::LevelSurface;
use super::normals::{Viewers, covariance, unit_normals};
use super::options::RegisterOptions;
use super::surface::{Sample, Surface};
use instgs_vk::math::covariance::{rotation_from_quat, sigmoid};
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::{SH_C0, widened};
use instgs_vk::scene::{Camera, Gaussians};

/// Points drawn on an object: three or four per voxel of the finest level, which are averaged.
pub(super) const SAMPLES: usize = 6000;
/// Radius of a Gaussian's disc, standard deviations: most of what a picture shows of it.
const REACH: f64 = 1.5;
/// A Gaussian whose distance from its neighbours exceeds the median by this factor is a stray.
const STRAY: f64 = 4.0;
/// Number of neighbours for that distance.
const STRAY_NEIGHBOURS: usize = 6;
/// Beyond this coordinate squares of f32 coordinates overflow.
const FARTHEST: f32 = 1e15;
/// Fewer Gaussians fix no pose: a coarse level has as many points.
pub const MIN_SURFACE_GAUSSIANS: usize = 24;
/// Objects with fewer Gaussians get relaxed limits of opacity and size: a blurred surface is better than none.
pub(super) const FEW_GAUSSIANS: usize = 40;
/// Factor by which both limits are relaxed.
const RELAXED: f64 = 2.0;
/// Voxel sizes of the levels relative to the base voxel, coarse to fine.
pub(super) const LEVELS: [f64; 4] = [4.0, 2.0, 1.0, 0.5];
/// Index of the base level, whose points have features.
pub(super) const BASE: usize = 2;

/// Index of the finest level.
pub(super) const FINE: usize = LEVELS.len() - 1;

/// Surface of an object, as registration uses it.
pub(super) struct ObjectSurface {
    /// Mask id of the object.
    pub id: u32,
    /// Origin of the local frame: the centroid of the surface, world frame.
    pub centroid: DVec3,
    /// Centre of the surface's axis-aligned bounding box, world frame.
    pub box_middle: DVec3,
    /// Diagonal of a box with the surface's second moments, scene units; unlike that of a bounding box it does not
    /// depend on the object's rotation.
    pub size: f64,
    /// Edges of that box, ascending, scene units.
    pub extents: DVec3,
    /// Number of opaque, small Gaussians on its surface: a measure of how well the object was seen.
    pub gaussians: usize,
    /// Number of Gaussians that points were drawn on; includes fainter and larger ones for coarse objects.
    pub discs: usize,
    /// Index of the nearest of these Gaussians for each point of the finest level.
    pub disc_of_point: Vec<u32>,
    /// Points at the resolutions of [`LEVELS`], local frame; from the base level on, normals are unit vectors.
    pub levels: [Surface; 4],
    /// Features of the points of the base level.
    pub features: Vec<Feature>,
}

/// One opaque Gaussian of an object, as a disc.
pub(super) struct Disc {
    /// Centre of the disc, world frame.
    pub position: DVec3,
    /// Vectors of one standard deviation along the two longer axes.
    axes: [DVec3; 2],
    /// Normal; its length, 0..=1, is the flatness of the Gaussian.
    normal: DVec3,
    color: DVec3,
    /// Opacity times area, the weight for drawing points.
    pub weight: f64,
}

impl ObjectSurface {
    /// Samples the Gaussians `indices` of the cloud; the error is a short reason for the report.
    pub(super) fn new(
        id: u32,
        indices: &[u32],
        cloud: &Gaussians,
        cameras: &[Camera],
        options: &RegisterOptions,
    ) -> Result<Self, String> {
        let (opaque, discs) = enough_discs(cloud, indices, cameras, options);
        if discs.len() < MIN_SURFACE_GAUSSIANS {
            return Err(format!("only {} of its Gaussians are opaque, small and no strays", discs.len()));
        }
        let step = discs.iter().map(|d| d.weight).sum::<f64>() / SAMPLES as f64;
        let mut samples = drawn(&discs, step, Rng::new(options.seed).fork(u64::from(id)));
        // The centroid of voxels does not depend on the density of Gaussians.
        let places: Vec<DVec3> = samples.iter().map(|s| s.position).collect();
        let rough = Surface::new(&samples, extents_of(&places).length() / options.voxels_per_size);
        let centroid = rough.positions.iter().sum::<DVec3>() / rough.len() as f64;
        let extents = extents_of(&rough.positions);
        let size = extents.length();
        if !(size > 0.0 && size.is_finite()) {
            return Err("all of its Gaussians are in one place".into());
        }
        let box_middle = middle(&rough.positions);
        samples.iter_mut().for_each(|s| s.position -= centroid);
        let voxel = size / options.voxels_per_size;
        let fine = Surface::new(&samples, LEVELS[FINE] * voxel);
        let of_fine = fine.samples();
        let level = |k: usize| Surface::new(&of_fine, LEVELS[k] * voxel);
        let mut levels = [level(0), level(1), level(2), fine];
        let viewers = Viewers::new(cameras, centroid);
        for level in &mut levels[BASE..] {
            level.normals = unit_normals(level, |p| viewers.direction(p + centroid));
        }
        let features = features(&levels[BASE]);
        let disc_of_point = nearest_discs(&discs, &levels[FINE], centroid);
        let (gaussians, discs) = (opaque, discs.len());
        Ok(Self { id, centroid, box_middle, size, extents, gaussians, discs, disc_of_point, levels, features })
    }

    /// The points of a level, and those of the finest level.
    pub(super) fn at(&self, level: usize) -> LevelSurface<'_> {
        LevelSurface { points: &self.levels[level], finest: &self.levels[FINE] }
    }

    /// Size of the base voxel, scene units.
    pub(super) fn voxel(&self) -> f64 {
        self.levels[BASE].voxel
    }
}

/// For each point of a surface, the disc with the nearest centre.
fn nearest_discs(discs: &[Disc], surface: &Surface, centroid: DVec3) -> Vec<u32> {
    let middles: Vec<[f32; 3]> = discs.iter().map(|d| (d.position - centroid).as_vec3().to_array()).collect();
    let set = PointSet::new(&middles);
    let nearest = |p: &DVec3| set.nearest_one(p.as_vec3().to_array()).map_or(0, |near| near.index);
    surface.positions.iter().map(nearest).collect()
}

/// Number of opaque, small Gaussians, and the Gaussians to draw points on: with relaxed limits if there are too few.
fn enough_discs(
    cloud: &Gaussians,
    indices: &[u32],
    cameras: &[Camera],
    options: &RegisterOptions,
) -> (usize, Vec<Disc>) {
    let strict = discs(cloud, indices, cameras, options);
    if strict.len() >= FEW_GAUSSIANS {
        return (strict.len(), strict);
    }
    (strict.len(), discs(cloud, indices, cameras, &relaxed(options)))
}

/// Relaxed limits for objects with few Gaussians.
pub(super) fn relaxed(options: &RegisterOptions) -> RegisterOptions {
    RegisterOptions {
        min_opacity: options.min_opacity / RELAXED,
        max_relative_scale: options.max_relative_scale * RELAXED,
        ..*options
    }
}

/// The Gaussians that are opaque and small enough, without strays.
pub(super) fn discs(cloud: &Gaussians, indices: &[u32], cameras: &[Camera], options: &RegisterOptions) -> Vec<Disc> {
    let kept: Vec<u32> =
        indices.iter().copied().filter(|&i| is_opaque(cloud, i as usize, options.min_opacity)).collect();
    let kept = without_strays(cloud, kept);
    let means: Vec<DVec3> = kept.iter().map(|&i| widened(cloud.means[i as usize])).collect();
    let size = extents_of(&means).length();
    let viewers = Viewers::new(cameras, middle(&means));
    let disc = |&i: &u32| disc(cloud, i as usize, &viewers, options.max_relative_scale * size);
    kept.iter().filter_map(disc).collect()
}

/// Whether a Gaussian is finite, has an opacity above the limit and a coordinate below [`FARTHEST`].
pub(super) fn is_opaque(cloud: &Gaussians, i: usize, min_opacity: f64) -> bool {
    let is_placed = cloud.is_finite(i) && cloud.means[i].iter().all(|v| v.abs() < FARTHEST);
    is_placed && sigmoid(f64::from(cloud.opacity_logits[i])) > min_opacity
}

/// A Gaussian as a disc; `None` if its largest standard deviation exceeds `max_scale`.
pub(super) fn disc(cloud: &Gaussians, i: usize, viewers: &Viewers, max_scale: f64) -> Option<Disc> {
    let rotation = rotation_from_quat(cloud.quats[i].map(f64::from));
    let mut axes = [0, 1, 2].map(|k| (f64::from(cloud.log_scales[i][k]).exp(), rotation.col(k)));
    axes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(thin, across), (middle, first), (long, second)] = axes;
    if long > max_scale {
        return None;
    }
    let position = widened(cloud.means[i]);
    let side = if across.dot(viewers.direction(position)) < 0.0 { -1.0 } else { 1.0 };
    let flatness = if middle > 0.0 { 1.0 - thin / middle } else { 0.0 };
    let opacity = sigmoid(f64::from(cloud.opacity_logits[i]));
    Some(Disc {
        position,
        axes: [first * middle, second * long],
        normal: across * side * flatness,
        color: widened(cloud.sh_of(i)[0]) * SH_C0 + 0.5,
        weight: opacity * middle * long,
    })
}

/// Removes Gaussians that are far from all others.
fn without_strays(cloud: &Gaussians, indices: Vec<u32>) -> Vec<u32> {
    let positions: Vec<[f32; 3]> = indices.iter().map(|&i| cloud.means[i as usize]).collect();
    let set = PointSet::new(&positions);
    let spacing = |&p: &[f32; 3]| set.mean_squared_distance_to_others(p, STRAY_NEIGHBOURS).sqrt();
    let spacings: Vec<f64> = positions.iter().map(spacing).collect();
    let mut sorted = spacings.clone();
    sorted.sort_by(f64::total_cmp);
    let Some(&median) = sorted.get(sorted.len() / 2) else { return indices };
    // If most coincide, the median is 0 and useless.
    let limit = if median > 0.0 { STRAY * median } else { f64::INFINITY };
    indices.into_iter().zip(spacings).filter(|&(_, spacing)| spacing <= limit).map(|(i, _)| i).collect()
}

/// Points uniform on the discs: one per `step` of opacity times area, or one per disc if `step` is 0.
pub(super) fn drawn(discs: &[Disc], step: f64, mut rng: Rng) -> Vec<Sample> {
    let mut out = Vec::with_capacity(SAMPLES + discs.len());
    let mut left = 0.0;
    for disc in discs {
        // Each Gaussian gets its share, and the remainder carries over; one without area still counts.
        left += if step > 0.0 { disc.weight / step } else { 1.0 };
        while left >= 0.5 {
            left -= 1.0;
            // The square root makes the distribution uniform over the disc.
            let (radius, turn) = (REACH * rng.uniform().sqrt(), TAU * rng.uniform());
            let offset = disc.axes[0] * (radius * turn.cos()) + disc.axes[1] * (radius * turn.sin());
            out.push(Sample { position: disc.position + offset, normal: disc.normal, color: disc.color });
        }
    }
    out
}

/// Edges, ascending, of a box with the points' second moments: an edge L has the variance L^2 / 12.
pub(super) fn extents_of(points: &[DVec3]) -> DVec3 {
    DVec3::from_array(symmetric_eigen(covariance(points)).map(|(value, _)| (12.0 * value.max(0.0)).sqrt()))
}

/// Centre of the axis-aligned bounding box.
fn middle(points: &[DVec3]) -> DVec3 {
    let wider = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
    let (low, high) = points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), wider);
    0.5 * (low + high)
}
