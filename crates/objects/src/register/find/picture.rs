//! Draws a layer of the cloud in parallel projection.

use glam::{DMat3, DVec3, Vec3};

use crate::register::pose::Pose;
use crate::register::sample::is_opaque;
use instgs_vk::math::covariance::{rotation_from_quat, sigmoid};
use instgs_vk::math::sh::{SH_C0, widened};
use instgs_vk::scene::Gaussians;

/// Fainter Gaussians are left out: they are more often haze in front of a wall than part of it.
const MIN_OPACITY: f64 = 0.1;
/// Radius to which a Gaussian is drawn, standard deviations: beyond, it has less than 1 % of its peak.
const REACH: f64 = 3.0;
/// Variance that the pixel filter adds to a Gaussian, pixels squared: that of 3DGS, whatever the scene's, as these pictures only
/// tell what is visible.
const PIXEL_VARIANCE: f64 = 0.3;
/// A pixel is visible if Gaussians cover at least this part of it.
const COVERED: f32 = 0.4;

/// A Gaussian in the local frame of the selected object.
pub(super) struct Splat {
    pub mean: DVec3,
    /// Radius of the Gaussian, scene units.
    pub reach: f64,
    /// Columns: vectors of one standard deviation along the axes.
    deviations: DMat3,
    opacity: f32,
    color: Vec3,
}

/// The opaque Gaussians with a radius of at most `most` (scene units), relative to `origin` (world).
pub(super) fn splats(cloud: &Gaussians, origin: DVec3, most: f64) -> Vec<Splat> {
    let splat = |i: usize| {
        let scales = widened(cloud.log_scales[i]).exp();
        Splat {
            mean: widened(cloud.means[i]) - origin,
            reach: REACH * scales.max_element(),
            deviations: rotation_from_quat(cloud.quats[i].map(f64::from)) * DMat3::from_diagonal(scales),
            opacity: sigmoid(f64::from(cloud.opacity_logits[i])) as f32,
            color: (widened(cloud.sh_of(i)[0]) * SH_C0 + 0.5).as_vec3().clamp(Vec3::ZERO, Vec3::ONE),
        }
    };
    (0..cloud.len()).filter(|&i| is_opaque(cloud, i, MIN_OPACITY)).map(splat).filter(|s| s.reach <= most).collect()
}

/// Camera of a parallel projection, local frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub middle: DVec3,
    /// Columns: right and up in the picture, and towards the viewer.
    pub axes: DMat3,
    /// Edge of a pixel, scene units.
    pub cell: f64,
    /// Number of pixels across and up.
    pub size: [usize; 2],
    /// Half the depth of the layer that is drawn, scene units.
    pub half_depth: f64,
}

impl Frame {
    /// The frame moved by a pose, which draws the same picture of a moved object.
    pub(super) fn moved(&self, pose: &Pose) -> Self {
        Self {
            middle: pose.apply(self.middle),
            axes: pose.rotation * self.axes,
            cell: self.cell * pose.scale,
            half_depth: self.half_depth * pose.scale,
            ..*self
        }
    }

    /// The frame with `by` more pixels on all four sides.
    pub(super) fn wider(&self, by: usize) -> Self {
        Self { size: self.size.map(|pixels| pixels + 2 * by), ..*self }
    }

    /// Width and height, scene units.
    pub(super) fn extent(&self) -> [f64; 2] {
        self.size.map(|pixels| pixels as f64 * self.cell)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pixel {
    /// Mean colour of the visible surface, rgb, 0..1.
    pub color: Vec3,
    /// Distance of that surface in front of the frame's centre, scene units.
    pub depth: f32,
    /// Weight of the pixel; 0 where nothing is visible.
    pub weight: f32,
}

/// A picture of a layer; rows start at the bottom.
pub(super) struct Picture {
    pub size: [usize; 2],
    pub pixels: Vec<Pixel>,
}

impl Picture {
    /// Blends the splats front to back.
    pub(super) fn new<'a>(splats: impl Iterator<Item = &'a Splat>, frame: &Frame) -> Self {
        let mut seen: Vec<Seen> = splats.filter_map(|splat| Seen::new(splat, frame)).collect();
        seen.sort_by(|a, b| b.depth.total_cmp(&a.depth));
        let [width, height] = frame.size;
        // Blended colour and depth, and transmittance.
        let mut sums = vec![(Vec3::ZERO, 0.0_f32, 1.0_f32); width * height];
        for s in &seen {
            let range = |at: f32, reach: f32, end: usize| {
                ((at - reach).ceil().max(0.0) as usize)..((at + reach + 1.0).max(0.0) as usize).min(end)
            };
            for y in range(s.at[1], s.reach[1], height) {
                for x in range(s.at[0], s.reach[0], width) {
                    let (dx, dy) = (x as f32 - s.at[0], y as f32 - s.at[1]);
                    let power = s.conic[0] * dx * dx + 2.0 * s.conic[1] * dx * dy + s.conic[2] * dy * dy;
                    let alpha = s.opacity * (-0.5 * power).exp();
                    let (color, depth, through) = &mut sums[y * width + x];
                    *color += s.color * (alpha * *through);
                    *depth += s.depth * (alpha * *through);
                    *through *= 1.0 - alpha;
                }
            }
        }
        let pixel = |(color, depth, through): (Vec3, f32, f32)| {
            let covered = 1.0 - through;
            let is_covered = covered > COVERED;
            if !is_covered {
                return Pixel::default();
            }
            Pixel { color: color / covered, depth: depth / covered, weight: 1.0 }
        };
        Self { size: frame.size, pixels: sums.into_iter().map(pixel).collect() }
    }

    /// The part of the given size whose first pixel is at `at`.
    pub(super) fn part(&self, at: [usize; 2], size: [usize; 2]) -> Self {
        let row = |y: usize| &self.pixels[(at[1] + y) * self.size[0] + at[0]..][..size[0]];
        Self { size, pixels: (0..size[1]).flat_map(row).copied().collect() }
    }
}

/// A Gaussian in a picture, in pixels from the centre of the first pixel.
struct Seen {
    at: [f32; 2],
    reach: [f32; 2],
    depth: f32,
    /// Inverse of the covariance: xx, xy, yy.
    conic: [f32; 3],
    opacity: f32,
    color: Vec3,
}

impl Seen {
    /// The projected Gaussian; `None` if it is outside of the picture.
    fn new(splat: &Splat, frame: &Frame) -> Option<Self> {
        let p = frame.axes.transpose() * (splat.mean - frame.middle);
        let at = [0, 1].map(|k| p[k] / frame.cell + 0.5 * (frame.size[k] as f64 - 1.0));
        let reach = splat.reach / frame.cell + REACH;
        let is_beside = |k: usize| at[k] < -reach || at[k] > frame.size[k] as f64 + reach;
        if p.z.abs() > frame.half_depth || is_beside(0) || is_beside(1) {
            return None;
        }
        let m = frame.axes.transpose() * splat.deviations * (1.0 / frame.cell);
        let (right, above) = (m.row(0), m.row(1));
        let (xx, yy) = (right.length_squared() + PIXEL_VARIANCE, above.length_squared() + PIXEL_VARIANCE);
        let xy = right.dot(above);
        let determinant = xx * yy - xy * xy;
        Some(Self {
            at: at.map(|v| v as f32),
            reach: [xx, yy].map(|variance| (REACH * variance.sqrt()) as f32),
            depth: p.z as f32,
            conic: [yy / determinant, -xy / determinant, xx / determinant].map(|v| v as f32),
            opacity: splat.opacity,
            color: splat.color,
        })
    }
}
