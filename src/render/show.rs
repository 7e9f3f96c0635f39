//! Views of a picture in a window, and the optional passes that each view needs.

use crate::gpu::interface::constants::{
    SHOW_ALPHA, SHOW_COLOR, SHOW_DEPTH, SHOW_INSTANCES, SHOW_MARKS, SHOW_OFFSETS, SHOW_TEMPLATES, SHOW_TILE_LOAD,
};

use super::marks::MarkShape;

/// Default top of the scale of [`Show::TileLoad`], (splat, tile) pairs: eight per pixel of an 8x8 tile. Trained scenes
/// have about 90 per such tile on average, and more than this where objects are small. GPUs have larger tiles with longer lists.
pub const TILE_LOAD_TOP: f32 = 512.0;

/// Default top of the scale of [`Show::Offsets`], in radii of the template: of trained cars, chairs and trees, 99 % of
/// the offsets are shorter than 0.11 to 0.22, and half of them shorter than 0.05.
pub const OFFSET_TOP: f32 = 0.2;

/// Default minimum alpha of [`Show::Ellipses`]. It hides the faint, large splats close to the camera that haze views
/// far from the training views; splats of surfaces are less transparent.
pub const ELLIPSE_ALPHA: f32 = 0.3;

/// View of a picture in a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Show {
    /// Colour over the background.
    #[default]
    Color,
    /// Coverage, 1 - T, as grey.
    Alpha,
    /// View depth as grey, from white at the first to black at the second depth; scene units.
    Depth([f32; 2]),
    /// A colour per instance, black where there is none; needs the id buffer.
    Instances,
    /// A colour per template, dark grey for the background's Gaussians, black where nothing is; needs the id buffer.
    Templates,
    /// Heat by the (splat, tile) pairs of a pixel's tile, in the last depth slab: black for none, palest from this
    /// number on.
    TileLoad(f32),
    /// Heat by the length of the position offset of the Gaussian at the surface, relative to the radius of its
    /// template's ball: black for none, palest from this ratio on; needs the id buffer. Position is shown because
    /// colour offsets are visible anyway.
    Offsets(f32),
    /// A small disc on the centre of every splat, in its colour, nearest first; needs marks.
    Points,
    /// The ellipse of one standard deviation of every splat where its alpha is at least this, in its colour, nearest
    /// first; needs marks.
    Ellipses(f32),
}

impl Show {
    /// True if the view needs the id buffer of the picture.
    pub fn needs_surfaces(self) -> bool {
        matches!(self, Self::Instances | Self::Templates | Self::Offsets(_))
    }

    /// Shape of the marks that the view needs.
    pub fn marks(self) -> Option<MarkShape> {
        match self {
            Self::Points => Some(MarkShape::Points),
            Self::Ellipses(alpha) => Some(MarkShape::Ellipses(alpha)),
            _ => None,
        }
    }

    /// The `SHOW_*` code and the range of values for kernel `present`.
    pub(super) fn code(self) -> (u32, [f32; 2]) {
        match self {
            Self::Color => (SHOW_COLOR, [0.0; 2]),
            Self::Alpha => (SHOW_ALPHA, [0.0; 2]),
            Self::Depth(range) => (SHOW_DEPTH, range),
            Self::Instances => (SHOW_INSTANCES, [0.0; 2]),
            Self::Templates => (SHOW_TEMPLATES, [0.0; 2]),
            Self::TileLoad(top) => (SHOW_TILE_LOAD, [0.0, top]),
            Self::Offsets(top) => (SHOW_OFFSETS, [0.0, top]),
            Self::Points | Self::Ellipses(_) => (SHOW_MARKS, [0.0; 2]),
        }
    }
}
