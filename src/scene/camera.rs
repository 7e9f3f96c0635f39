//! Pinhole cameras in OpenCV axes: x right, y down, z forward; pixel centres at +0.5.

use glam::{DMat3, DMat4, DVec3};

/// One view. `view_from_world` is kept in f64, as files store it; the device gets f32.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// Name of the view, without extension; output files are named after it.
    pub name: String,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point x in pixels; width / 2 is the image centre.
    pub cx: f64,
    /// Principal point y in pixels; height / 2 is the image centre.
    pub cy: f64,
    /// Rigid world-to-camera transform, rows of a 4x4 matrix, translation in scene units.
    pub view_from_world: [[f64; 4]; 4],
}

/// Largest image side: 2^14, the limit of 2D images that Vulkan devices have in common, so that a picture can also be
/// shown.
pub const MAX_IMAGE_SIDE: u32 = 16384;

/// The rows of the 4x4 matrix of a rotation and a translation.
pub fn rigid_rows(rotation: DMat3, translation: DVec3) -> [[f64; 4]; 4] {
    let row = |i: usize| {
        let [x, y, z] = rotation.row(i).to_array();
        [x, y, z, translation[i]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Why a camera cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// A side of the image is 0 or too long.
    #[error("camera {name}: size {width}x{height} is not within 1..={MAX_IMAGE_SIDE}")]
    Size {
        /// Name of the camera at fault.
        name: String,
        /// Image width in pixels.
        width: u32,
        /// Image height in pixels.
        height: u32,
    },
    /// A focal length is not positive, or an intrinsic parameter is too large or not finite.
    #[error("camera {name}: fx and fy must be positive, and all of fx, fy, cx, cy below 1e9")]
    Intrinsics {
        /// Name of the camera at fault.
        name: String,
    },
    /// The pose is not a finite rotation and translation.
    #[error("camera {name}: view_from_world is not a rigid transform")]
    Pose {
        /// Name of the camera at fault.
        name: String,
    },
}

impl Camera {
    /// Rotation part of `view_from_world`.
    pub fn rotation(&self) -> DMat3 {
        let m = &self.view_from_world;
        DMat3::from_cols(
            DVec3::new(m[0][0], m[1][0], m[2][0]),
            DVec3::new(m[0][1], m[1][1], m[2][1]),
            DVec3::new(m[0][2], m[1][2], m[2][2]),
        )
    }

    /// Translation part of `view_from_world`.
    pub fn translation(&self) -> DVec3 {
        let m = &self.view_from_world;
        DVec3::new(m[0][3], m[1][3], m[2][3])
    }

    /// The camera centre in world units.
    pub fn position_world(&self) -> DVec3 {
        -(self.rotation().transpose() * self.translation())
    }

    /// Transforms a world point to view space (x right, y down, z forward), scene units.
    pub fn view_from_point(&self, point_world: DVec3) -> DVec3 {
        self.rotation() * point_world + self.translation()
    }

    /// Projects a world point to pixel coordinates, which may lie outside the image; `None` behind the camera.
    pub fn pixel_of(&self, point_world: DVec3) -> Option<[f64; 2]> {
        let v = self.view_from_point(point_world);
        (v.z > 0.0).then(|| [self.fx * v.x / v.z + self.cx, self.fy * v.y / v.z + self.cy])
    }

    /// True if a pixel position lies within the image.
    pub fn has_pixel(&self, [x, y]: [f64; 2]) -> bool {
        (0.0..f64::from(self.width)).contains(&x) && (0.0..f64::from(self.height)).contains(&y)
    }

    /// A camera at `eye` that looks at `target`, with `up` roughly upwards in the image, the vertical field of view
    /// `fov_y` in radians and a centred principal point. `eye` must differ from `target`, and `up` must not be parallel
    /// to the view.
    pub fn look_at(name: &str, eye: DVec3, target: DVec3, up: DVec3, fov_y: f64, size: (u32, u32)) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let focal = 0.5 * f64::from(size.1) / (0.5 * fov_y).tan();
        let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(eye)];
        Self {
            name: name.into(),
            width: size.0,
            height: size.1,
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(size.0),
            cy: 0.5 * f64::from(size.1),
            view_from_world: [row(right), row(down), row(forward), [0.0, 0.0, 0.0, 1.0]],
        }
    }

    /// The same view at another image size; intrinsics are scaled per axis.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let sx = f64::from(width) / f64::from(self.width);
        let sy = f64::from(height) / f64::from(self.height);
        Self { width, height, fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy, ..self.clone() }
    }

    /// A camera for pictures of another shape: with the same pose, vertical field of view and shape of pixels. The picture shows
    /// more or less at its sides, where [`Camera::resized`] squeezes or stretches it.
    pub fn in_shape(&self, [width, height]: [u32; 2]) -> Self {
        let scaled = f64::from(height) / f64::from(self.height);
        let from_middle = self.cx - 0.5 * f64::from(self.width);
        Self {
            width,
            height,
            fx: self.fx * scaled,
            fy: self.fy * scaled,
            cx: 0.5 * f64::from(width) + from_middle * scaled,
            cy: self.cy * scaled,
            ..self.clone()
        }
    }

    /// The camera-to-world transform `world_from_view`.
    pub fn world_from_view(&self) -> DMat4 {
        DMat4::from_cols_array_2d(&self.view_from_world).transpose().inverse()
    }

    /// Checks sizes and focal lengths, and that the pose is finite and rigid within 1e-3.
    ///
    /// # Errors
    /// The text says what is wrong.
    pub fn validate(&self) -> Result<(), CameraError> {
        let name = || self.name.clone();
        if self.width == 0 || self.height == 0 || self.width > MAX_IMAGE_SIDE || self.height > MAX_IMAGE_SIDE {
            return Err(CameraError::Size { name: name(), width: self.width, height: self.height });
        }
        // The device computes in f32, whose 24 bits resolve no pixel beyond 1e9.
        let fits = |v: f64| v.abs() < 1e9;
        let positive = |v: f64| fits(v) && v > 0.0;
        if !(positive(self.fx) && positive(self.fy) && fits(self.cx) && fits(self.cy)) {
            return Err(CameraError::Intrinsics { name: name() });
        }
        let rotation = self.rotation();
        let error = (rotation.transpose() * rotation - DMat3::IDENTITY)
            .to_cols_array()
            .iter()
            .fold(0.0, |a: f64, v| a.max(v.abs()));
        // Inverted poses from files carry rounding in the last row.
        let last_row = self.view_from_world[3].iter().zip([0.0, 0.0, 0.0, 1.0]);
        let affine = last_row.map(|(v, want)| (v - want).abs()).fold(0.0, f64::max) < 1e-6;
        let rigid =
            affine && error < 1e-3 && rotation.determinant() > 0.0 && self.translation().abs().max_element() < 1e30;
        if !rigid {
            return Err(CameraError::Pose { name: name() });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_where_the_picture_shows_them() {
        let camera = Camera::look_at("", DVec3::new(0.0, -2.0, 0.0), DVec3::ZERO, DVec3::Z, 0.5, (64, 48));
        let near =
            |at: Option<[f64; 2]>, want: [f64; 2]| at.is_some_and(|at| (0..2).all(|k| (at[k] - want[k]).abs() < 1e-9));
        assert!(near(camera.pixel_of(DVec3::ZERO), [32.0, 24.0]));
        // To the right by 0.1 at distance 2, and up by the same.
        let pixels = 0.05 * 24.0 / 0.25f64.tan();
        assert!(near(camera.pixel_of(DVec3::new(0.1, 0.0, 0.1)), [32.0 + pixels, 24.0 - pixels]));
        assert_eq!(camera.pixel_of(DVec3::new(0.0, -3.0, 0.0)), None, "behind");
        assert!(camera.has_pixel([0.0, 47.9]) && !camera.has_pixel([64.0, 3.0]) && !camera.has_pixel([3.0, -0.1]));
    }
}
