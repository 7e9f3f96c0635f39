//! Cameras and options as the twins use them: rounded to f32 as the device gets them, then used in f64.

use glam::{DMat3, DVec2, DVec3};

use instgs_vk::scene::camera::Camera;

/// Rendering constants that belong neither to the scene nor to the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Nearest view depth that is drawn, exclusive, scene units.
    pub near: f64,
    /// Dilation: added to both diagonal entries of the 2D covariance, px^2.
    pub dilation: f64,
    /// Whether opacity is scaled by sqrt(max(2.5e-5, det / det')), so that dilation adds no light.
    pub antialias: bool,
    /// Background colour, weighted with the remaining transmittance.
    pub background: [f64; 3],
}

impl Default for RenderOptions {
    /// The renderer's defaults: near 0.2, dilation 0.3 px^2, no compensation, black.
    fn default() -> Self {
        Self { near: 0.2, dilation: 0.3, antialias: false, background: [0.0; 3] }
    }
}

/// Rounds `v` to f32, as the device gets it.
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

/// The options as the device sees them, rounded to f32.
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
    /// Width of the image, px.
    pub width: u32,
    /// Height of the image, px.
    pub height: u32,
    /// Focal lengths along x and y, px.
    pub focal_px: DVec2,
    /// Principal point, px, pixel centres at +0.5.
    pub principal_px: DVec2,
    /// Rotation part of the camera's pose.
    pub view_from_world: DMat3,
    /// Translation part of the pose: the world origin in view coordinates, scene units.
    pub world_origin_view: DVec3,
    /// Camera centre in the world, scene units.
    pub camera_world: DVec3,
    /// Lower bounds of the Jacobian's clamp of x/z and y/z (negative when the principal point is inside the image).
    pub slope_min: DVec2,
    /// Upper bounds of the same clamp.
    pub slope_max: DVec2,
    /// The options of the render.
    pub options: RenderOptions,
}

/// The Jacobian follows the centre up to this fraction of the image size beyond the border, and is clamped there.
pub const SLOPE_MARGIN: f64 = 0.15;

impl View {
    /// A view of camera and options without rounding, as finite differences need it.
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
