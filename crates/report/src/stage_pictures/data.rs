//! What the stages from masks to templates did, as pictures for the page: plain data, which the rest of this module
//! draws.

use crate::Rgb8;

/// All of it; empty for a plain cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StagePictures {
    /// What a reader should know of masks and objects, one sentence each.
    pub notes: Vec<String>,
    /// The objects by id.
    pub objects: Vec<ObjectColor>,
    /// Some training views.
    pub views: Vec<StageView>,
    /// The groups with the poses of their objects; last, if there are any, the objects that are in no group.
    pub overlays: Vec<GroupOverlay>,
    /// Groups whose poses are not shown.
    pub groups_left_out: usize,
    /// The first templates in the scene's order.
    pub templates: Vec<TemplatePictures>,
    /// Templates that are not shown.
    pub templates_left_out: usize,
}

/// An object and its colour in all pictures.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectColor {
    /// Its number.
    pub id: u32,
    /// What it is, if anybody said.
    pub name: Option<String>,
    /// sRGB.
    pub color: [u8; 3],
}

/// From the mask to the labels in one view; all pictures are of one size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageView {
    /// View name.
    pub name: String,
    /// The photograph.
    pub photo: Rgb8,
    /// The ids of the mask as given; `None` if the view has no mask.
    pub given: Option<Rgb8>,
    /// The objects that the mask shows.
    pub objects: Option<Rgb8>,
    /// The plain cloud in the colours of its objects.
    pub labels: Rgb8,
}

/// Objects of a group, each brought to the place of the group's reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupOverlay {
    /// What the group is.
    pub name: String,
    /// Reference first.
    pub tiles: Vec<OverlayTile>,
    /// Objects of the group that are not shown.
    pub left_out: usize,
}

/// One object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverlayTile {
    /// Its number.
    pub id: u32,
    /// Its colour.
    pub color: [u8; 3],
    /// The object alone in its own colours; `None` if it has no Gaussians.
    pub own: Option<Rgb8>,
    /// In its colour over the reference's grey, from the front and from a side; that grey alone for the reference;
    /// empty without a reference.
    pub over: Vec<Rgb8>,
    /// How far its outline is the reference's in these pictures: intersection by union, 0..=1; `None` for the
    /// reference.
    pub overlap: Option<f64>,
}

/// A template without the differences of any instance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TemplatePictures {
    /// What its group is.
    pub name: String,
    /// Its Gaussians when it was merged.
    pub gaussians: u64,
    /// Its instances.
    pub instances: u64,
    /// As merged, from the front and from behind.
    pub merged: Vec<Rgb8>,
    /// As the joint phase left it, likewise; empty until then.
    pub trained: Vec<Rgb8>,
}
