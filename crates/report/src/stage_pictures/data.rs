//! Pictures of the stages from masks to templates, as plain data for the page; the rest of this module draws them.

use crate::Rgb8;

/// Pictures of all stages; empty for a plain cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StagePictures {
    /// Remarks on masks and objects for the reader, one sentence each.
    pub notes: Vec<String>,
    /// The objects in ascending order of id.
    pub objects: Vec<ObjectColor>,
    /// A selection of training views.
    pub views: Vec<StageView>,
    /// The groups with the poses of their objects; last, if there are any, the objects that are in no group.
    pub overlays: Vec<GroupOverlay>,
    /// Number of groups whose poses are not shown.
    pub groups_left_out: usize,
    /// The first templates in the scene's order.
    pub templates: Vec<TemplatePictures>,
    /// Number of templates that are not shown.
    pub templates_left_out: usize,
}

/// An object and its colour in all pictures.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectColor {
    /// Object id as in the labels.
    pub id: u32,
    /// Its category, if the masks have one.
    pub name: Option<String>,
    /// Its colour, sRGB in 0..=255.
    pub color: [u8; 3],
}

/// One view from its mask to the labels; all pictures have the same size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageView {
    /// Name of the training view.
    pub name: String,
    /// The photo of the view.
    pub photo: Rgb8,
    /// The mask ids as given; `None` if the view has no mask.
    pub given: Option<Rgb8>,
    /// The objects that the mask shows; `None` if the view has no mask.
    pub objects: Option<Rgb8>,
    /// The plain cloud in the colours of its objects.
    pub labels: Rgb8,
}

/// Objects of a group, each moved to the pose of the group's reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupOverlay {
    /// Name of the group on the page.
    pub name: String,
    /// The objects, the reference first.
    pub tiles: Vec<OverlayTile>,
    /// Number of objects of the group that are not shown.
    pub left_out: usize,
}

/// Pictures of one object of a group.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverlayTile {
    /// Object id as in the labels.
    pub id: u32,
    /// Its colour, sRGB in 0..=255.
    pub color: [u8; 3],
    /// The object alone in its own colours; `None` if it has no Gaussians.
    pub own: Option<Rgb8>,
    /// The object in its colour over the grey reference, from the front and from a side; the grey alone for the
    /// reference; empty without a reference.
    pub over: Vec<Rgb8>,
    /// Agreement of its outline with the reference's: intersection over union, 0..=1; `None` for the reference.
    pub overlap: Option<f64>,
}

/// A template without the offsets of any instance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TemplatePictures {
    /// Name of its group on the page.
    pub name: String,
    /// Number of its Gaussians after merging.
    pub gaussians: u64,
    /// Number of its instances.
    pub instances: u64,
    /// After merging, from the front and from behind.
    pub merged: Vec<Rgb8>,
    /// After the joint phase, from the same cameras; empty until then.
    pub trained: Vec<Rgb8>,
}
