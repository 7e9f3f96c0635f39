//! Undo steps: the parts of a scene before a change, and which device data a change affects.

use std::collections::{BTreeMap, BTreeSet};

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::edit::Edit;
use instgs_vk::scene::instanced_scene::{ColorMatrix, ForeignTensor};
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, SourceRange};

/// The part of a scene that must be uploaded again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Changed {
    /// The poses of these instances.
    Places(Vec<usize>),
    /// Whether these instances are drawn.
    Shown(Vec<usize>),
    /// The whole scene, for instance after its templates changed.
    Everything,
}

impl Changed {
    /// The combined effect of two changes in order.
    pub(super) fn and(self, then: Self) -> Self {
        match (self, then) {
            (Self::Places(first), Self::Places(then)) => {
                let both: BTreeSet<usize> = first.into_iter().chain(then).collect();
                Self::Places(both.into_iter().collect())
            }
            _ => Self::Everything,
        }
    }
}

/// The parts of a scene that an edit changes, as they were before it. Parts that an edit leaves alone are absent.
#[derive(Default)]
pub(super) struct Parts {
    instances: Option<Vec<Instance>>,
    groups: Option<Vec<Group>>,
    offsets: Option<Offsets>,
    own: Option<(Gaussians, Vec<SourceRange>)>,
    color_from_template: Option<Vec<ColorMatrix>>,
    template_sh: Option<Vec<[f32; 3]>>,
    /// The whole source pool with its colours: present only if Gaussians were removed from it.
    templates: Option<(Gaussians, Vec<SourceRange>)>,
    /// Present only if Gaussians were given to an instance or taken back.
    background: Option<Gaussians>,
    foreign_tensors: Option<BTreeMap<String, ForeignTensor>>,
}

/// One undo step: the scene's parts, the selection, and the hidden and locked instances before a change.
pub(super) struct Step {
    /// Name of the change.
    pub(super) what: &'static str,
    pub(super) parts: Parts,
    pub(super) chosen: BTreeSet<usize>,
    pub(super) hidden: BTreeSet<usize>,
    pub(super) locked: BTreeSet<usize>,
}

impl Parts {
    /// Copies the parts that an edit may change. Moving instances happens many times a second during a drag, and copies
    /// the list of instances only.
    pub(super) fn before(scene: &InstancedScene, edit: &Edit) -> Self {
        let places = Self { instances: Some(scene.instances.clone()), ..Self::default() };
        let lists = |parts: Self| Self {
            groups: Some(scene.groups.clone()),
            offsets: Some(scene.offsets.clone()),
            own: Some((scene.own.clone(), scene.own_ranges.clone())),
            color_from_template: Some(scene.color_from_template.clone()),
            foreign_tensors: Some(scene.foreign_tensors.clone()),
            ..parts
        };
        match edit {
            Edit::MoveBy { .. } | Edit::MoveTo { .. } | Edit::Rotate { .. } | Edit::Scale { .. } => places,
            Edit::Duplicate { .. } | Edit::Delete { .. } | Edit::Swap { .. } | Edit::Scatter(_) => lists(places),
            Edit::Recolour { .. } => Self { template_sh: Some(scene.templates.sh.clone()), ..lists(places) },
            Edit::Align { .. } | Edit::Distribute { .. } => places,
            Edit::Reset { .. } | Edit::Relight { .. } => lists(places),
            Edit::Rename { .. } => Self { groups: Some(scene.groups.clone()), ..Self::default() },
            Edit::Give { .. } | Edit::Take { .. } => {
                Self { background: Some(scene.background.clone()), ..lists(places) }
            }
            Edit::Crop { .. } | Edit::Erase { .. } | Edit::Mirror { .. } | Edit::MakeUnique { .. } => {
                Self { templates: Some((scene.templates.clone(), scene.template_ranges.clone())), ..lists(places) }
            }
        }
    }

    /// Keeps the parts that differ from a scene's present ones.
    pub(super) fn that_differ_from(self, scene: &InstancedScene) -> Self {
        Self {
            instances: self.instances.filter(|was| *was != scene.instances),
            groups: self.groups.filter(|was| *was != scene.groups),
            offsets: self.offsets.filter(|was| *was != scene.offsets),
            own: self.own.filter(|was| was.0 != scene.own || was.1 != scene.own_ranges),
            color_from_template: self.color_from_template.filter(|was| *was != scene.color_from_template),
            template_sh: self.template_sh.filter(|was| *was != scene.templates.sh),
            templates: self.templates.filter(|was| was.0 != scene.templates || was.1 != scene.template_ranges),
            background: self.background.filter(|was| *was != scene.background),
            foreign_tensors: self.foreign_tensors.filter(|was| *was != scene.foreign_tensors),
        }
    }

    /// Stored pose of an instance, if the instances are among the parts.
    pub(super) fn place_of(&self, k: usize) -> Option<Similarity> {
        Some(self.instances.as_ref()?.get(k)?.world_from_template)
    }

    /// True if names and members of groups are among the parts.
    pub(super) fn has_groups(&self) -> bool {
        self.groups.is_some()
    }

    /// True if the background is among the parts.
    pub(super) fn has_background(&self) -> bool {
        self.background.is_some()
    }

    /// True if no part of the scene is stored.
    pub(super) fn is_empty(&self) -> bool {
        self.instances.is_none() && self.has_no_more_than_instances()
    }

    /// True if the poses of instances are all that is stored.
    pub(super) fn are_places(&self) -> bool {
        self.instances.is_some() && self.has_no_more_than_instances()
    }

    fn has_no_more_than_instances(&self) -> bool {
        let Self {
            instances: _,
            groups,
            offsets,
            own,
            color_from_template,
            template_sh,
            templates,
            background,
            foreign_tensors,
        } = self;
        let lists = groups.is_none() && offsets.is_none() && color_from_template.is_none() && foreign_tensors.is_none();
        let clouds = own.is_none() && template_sh.is_none() && templates.is_none() && background.is_none();
        lists && clouds
    }

    /// Memory of the parts in bytes, without names.
    pub(super) fn bytes(&self) -> u64 {
        let instances = self.instances.as_ref().map_or(0, |instances| 56 * instances.len() as u64);
        let offsets = self.offsets.as_ref().map_or(0, Offsets::tensor_bytes);
        let of_own = |(own, ranges): &(Gaussians, Vec<SourceRange>)| own.tensor_bytes() + 8 * ranges.len() as u64;
        let own = self.own.as_ref().map_or(0, of_own);
        let colors = self.color_from_template.as_ref().map_or(0, |matrices| 48 * matrices.len() as u64);
        let sh = self.template_sh.as_ref().map_or(0, |sh| 12 * sh.len() as u64);
        let templates = self.templates.as_ref().map_or(0, |(templates, _)| templates.tensor_bytes());
        let foreign = self.foreign_tensors.as_ref();
        let foreign = foreign.map_or(0, |all| all.values().map(|tensor| tensor.bytes.len() as u64).sum());
        let background = self.background.as_ref().map_or(0, Gaussians::tensor_bytes);
        instances + offsets + own + colors + sh + templates + background + foreign
    }

    /// What must be uploaded when the scene's parts and these are swapped.
    pub(super) fn changed(&self, scene: &InstancedScene) -> Changed {
        let pools = self.offsets.is_some()
            || self.own.is_some()
            || self.color_from_template.is_some()
            || self.template_sh.is_some()
            || self.templates.is_some()
            || self.background.is_some();
        let none = Vec::new();
        let (was, is) = match &self.instances {
            Some(instances) => (instances, &scene.instances),
            None => (&none, &none),
        };
        let alike = |(a, b): (&Instance, &Instance)| (a.template, a.first_offset) == (b.template, b.first_offset);
        if pools || was.len() != is.len() || !was.iter().zip(is).all(alike) {
            return Changed::Everything;
        }
        let elsewhere = |(k, (a, b)): (usize, (&Instance, &Instance))| (a != b).then_some(k);
        Changed::Places(was.iter().zip(is).enumerate().filter_map(elsewhere).collect())
    }

    /// Swaps the stored parts with those of the scene.
    pub(super) fn exchange(&mut self, scene: &mut InstancedScene) {
        swap(&mut self.instances, &mut scene.instances);
        swap(&mut self.groups, &mut scene.groups);
        swap(&mut self.offsets, &mut scene.offsets);
        if let Some((own, ranges)) = &mut self.own {
            std::mem::swap(own, &mut scene.own);
            std::mem::swap(ranges, &mut scene.own_ranges);
        }
        swap(&mut self.color_from_template, &mut scene.color_from_template);
        swap(&mut self.template_sh, &mut scene.templates.sh);
        if let Some((templates, ranges)) = &mut self.templates {
            std::mem::swap(templates, &mut scene.templates);
            std::mem::swap(ranges, &mut scene.template_ranges);
        }
        swap(&mut self.background, &mut scene.background);
        swap(&mut self.foreign_tensors, &mut scene.foreign_tensors);
    }
}

fn swap<T>(part: &mut Option<T>, value: &mut T) {
    if let Some(part) = part {
        std::mem::swap(part, value);
    }
}
