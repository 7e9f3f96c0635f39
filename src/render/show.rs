//! What a window can show of a picture, and what each of these views needs besides it.

use crate::gpu::interface::constants::{
    SHOW_ALPHA, SHOW_COLOR, SHOW_DEPTH, SHOW_INSTANCES, SHOW_MARKS, SHOW_OFFSETS, SHOW_TEMPLATES, SHOW_TILE_LOAD,
};

use super::marks::MarkShape;

/// Hottest colour of [`Show::TileLoad`] unless the user says otherwise, (splat, tile) pairs: eight per pixel of a tile of 8x8.
/// Trained halls, orchards and car parks have about 90 a tile on average from where the player starts, and go beyond this where
/// objects are small.
pub const TILE_LOAD_TOP: f32 = 512.0;

/// Hottest colour of [`Show::Offsets`] unless the user says otherwise, in radii of the template: 99 of 100 offsets of trained
/// cars, chairs and trees are shorter than 0.11 to 0.22, half of them than 0.05.
pub const OFFSET_TOP: f32 = 0.2;

/// Least alpha in [`Show::Ellipses`] unless the user says otherwise. Large splats close to the camera, which haze a picture by up
/// to a quarter where it was not trained, are fainter, and surfaces are made of splats that are not.
pub const ELLIPSE_ALPHA: f32 = 0.3;

/// What a window shows of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Show {
    /// Colour over the background.
    #[default]
    Color,
    /// Coverage, 1 - T, as grey.
    Alpha,
    /// View depth as grey, from white at the first of these depths to black at the second; scene units.
    Depth([f32; 2]),
    /// A colour for each instance, black where there is none; needs surfaces.
    Instances,
    /// A colour for each template, dark grey for the background's own, black where nothing is; needs surfaces.
    Templates,
    /// Heat by the (splat, tile) pairs of a pixel's tile, in the last depth slab: black for none, palest from this many on.
    TileLoad(f32),
    /// Heat by the length of the position offset of the Gaussian at the surface, over the radius of the ball around its
    /// template's centres: black for none, palest from this part on; needs surfaces. Of position, since that is what colours
    /// do not show.
    Offsets(f32),
    /// A small disc on the centre of every splat, in its colour, nearest first; needs marks.
    Points,
    /// The ellipse of one standard deviation of every splat, as far as its alpha is at least this, in its colour, nearest first;
    /// needs marks.
    Ellipses(f32),
}

impl Show {
    /// The view needs the surfaces of the picture.
    pub fn needs_surfaces(self) -> bool {
        matches!(self, Self::Instances | Self::Templates | Self::Offsets(_))
    }

    /// The marks that the view needs.
    pub fn marks(self) -> Option<MarkShape> {
        match self {
            Self::Points => Some(MarkShape::Points),
            Self::Ellipses(alpha) => Some(MarkShape::Ellipses(alpha)),
            _ => None,
        }
    }

    /// `SHOW_*` and the range of values that kernel `present` takes.
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
