//! What every twin needs of a camera: the values the device is handed, that is rounded to f32, then used in f64.

use glam::{DMat3, DVec2, DVec3};

use crate::scene::camera::Camera;

/// The constants of a render that are not in the scene or the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Nearest view depth that is drawn, exclusive, scene units.
    pub near: f64,
    /// Added to both diagonal entries of the 2D covariance, px^2.
    pub dilation: f64,
    /// Scale the opacity by sqrt(max(2.5e-5, det / det')), so that dilation adds no light.
    pub antialias: bool,
    /// Colour behind everything, linear combination with weight T.
    pub background: [f64; 3],
}

impl Default for RenderOptions {
    /// DESIGN section 3: near 0.2, dilation 0.3 px^2, no compensation, black.
    fn default() -> Self {
        Self { near: 0.2, dilation: 0.3, antialias: false, background: [0.0; 3] }
    }
}

/// `v` rounded to f32.
pub fn device_rounded(v: f64) -> f64 {
    f64::from(v as f32)
}

/// The camera as the device sees it: intrinsics and pose rounded to f32, name and size unchanged.
pub fn device_camera(camera: &Camera) -> Camera {
    Camera {
        fx: device_rounded(camera.fx),
        fy: device_rounded(camera.fy),
        cx: device_rounded(camera.cx),
        cy: device_rounded(camera.cy),
        view_from_world: camera.view_from_world.map(|row| row.map(device_rounded)),
        ..camera.clone()
    }
}

/// The options as the device sees them: numbers rounded to f32.
pub fn device_options(options: &RenderOptions) -> RenderOptions {
    RenderOptions {
        near: device_rounded(options.near),
        dilation: device_rounded(options.dilation),
        antialias: options.antialias,
        background: options.background.map(device_rounded),
    }
}

/// A camera with options, prepared for projection.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Image width, px.
    pub width: u32,
    /// Image height, px.
    pub height: u32,
    /// Focal lengths, px.
    pub focal_px: DVec2,
    /// Principal point, px, pixel centres at +0.5.
    pub principal_px: DVec2,
    /// Rotation of the pose.
    pub view_from_world: DMat3,
    /// Translation of the pose: the world origin in view coordinates.
    pub world_origin_view: DVec3,
    /// Camera centre, world.
    pub camera_world: DVec3,
    /// The Jacobian's clamp of x/z and y/z, lower bounds (negative when the principal point is inside the image).
    pub slope_min: DVec2,
    /// Upper bounds of the same clamp.
    pub slope_max: DVec2,
    /// See `RenderOptions`.
    pub options: RenderOptions,
}

/// How far beyond the image border the Jacobian still follows the centre, as a fraction of the image size.
pub const SLOPE_MARGIN: f64 = 0.15;

impl View {
    /// Takes camera and options as they are, without rounding: finite differences need that.
    pub fn exact(camera: &Camera, options: &RenderOptions) -> Self {
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let focal_px = DVec2::new(camera.fx, camera.fy);
        let principal_px = DVec2::new(camera.cx, camera.cy);
        let margin_px = SLOPE_MARGIN * size;
        Self {
            width: camera.width,
            height: camera.height,
            focal_px,
            principal_px,
            view_from_world: camera.rotation(),
            world_origin_view: camera.translation(),
            camera_world: camera.position_world(),
            slope_min: (-margin_px - principal_px) / focal_px,
            slope_max: (size + margin_px - principal_px) / focal_px,
            options: *options,
        }
    }

    /// The view with everything rounded to f32 first, as the device gets it.
    pub fn device(camera: &Camera, options: &RenderOptions) -> Self {
        Self::exact(&device_camera(camera), &device_options(options))
    }
}
