//! Selecting instances by index, mask id, group or template.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use crate::scene::edit::{EditReason, existing_template};
use crate::scene::instanced_scene::InstancedScene;

/// Upper limit on names that an error message lists.
const LISTED: usize = 20;

/// The instances that an edit applies to. Written as text on the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selector {
    /// One instance by index, from 0.
    Index(usize),
    /// Several by index: `0,3,4`.
    Indices(Vec<usize>),
    /// One instance by mask id, as in `groups`: `id:7`.
    Id(u32),
    /// All instances of the groups of that name: `group:chair`.
    Group(String),
    /// All instances of a template: `template:0`.
    Template(u32),
}

/// A text that names no instance.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{text}\" names no instance: want an index, several (0,3,4), id:N, group:NAME or template:N")]
pub struct ParseSelectorError {
    /// What was to be read.
    pub text: String,
}

impl FromStr for Selector {
    type Err = ParseSelectorError;

    fn from_str(text: &str) -> Result<Self, ParseSelectorError> {
        let number = |text: &str| text.parse::<u32>().ok();
        let parsed = match text.split_once(':') {
            Some(("id", id)) => number(id).map(Self::Id),
            Some(("template", template)) => number(template).map(Self::Template),
            Some(("group", name)) if !name.is_empty() => Some(Self::Group(name.to_owned())),
            Some(_) => None,
            None if text.contains(',') => {
                let several: Option<Vec<usize>> = text.split(',').map(|n| number(n).map(|n| n as usize)).collect();
                several.map(Self::Indices)
            }
            None => number(text).map(|index| Self::Index(index as usize)),
        };
        parsed.ok_or_else(|| ParseSelectorError { text: text.to_owned() })
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Index(index) => write!(f, "{index}"),
            Self::Indices(several) => {
                let several: Vec<String> = several.iter().map(usize::to_string).collect();
                f.write_str(&several.join(","))
            }
            Self::Id(id) => write!(f, "id:{id}"),
            Self::Group(name) => write!(f, "group:{name}"),
            Self::Template(template) => write!(f, "template:{template}"),
        }
    }
}

impl Selector {
    /// True if it selects a kind of object rather than single instances.
    pub(super) fn is_collective(&self) -> bool {
        matches!(self, Self::Group(_) | Self::Template(_))
    }

    /// The selected instances in ascending order, at least one.
    ///
    /// # Errors
    /// It names no instance of the scene; the text lists what exists.
    pub fn resolve(&self, scene: &InstancedScene) -> Result<Vec<usize>, EditReason> {
        let count = scene.instances.len();
        let found: Vec<usize> = match self {
            Self::Index(index) => (*index < count).then_some(*index).into_iter().collect(),
            Self::Indices(several) => {
                let mut all = several.clone();
                all.sort_unstable();
                all.dedup();
                // An index out of range rejects the whole list.
                if all.last().is_some_and(|&last| last < count) { all } else { Vec::new() }
            }
            Self::Id(id) => matching(scene, |label_id, _| label_id == Some(*id)),
            Self::Group(name) => matching(scene, |_, group| group == Some(name.as_str())),
            Self::Template(template) => {
                existing_template(scene, *template)?;
                (0..count).filter(|&k| scene.instances[k].template == *template).collect()
            }
        };
        if found.is_empty() { Err(EditReason::NoInstance(self.missing(scene))) } else { Ok(found) }
    }

    /// The only selected instance; several are an error.
    pub(super) fn resolve_one(&self, scene: &InstancedScene) -> Result<usize, EditReason> {
        match self.resolve(scene)?.as_slice() {
            [one] => Ok(*one),
            several => Err(EditReason::Several { which: self.clone(), count: several.len() }),
        }
    }

    fn missing(&self, scene: &InstancedScene) -> String {
        let count = scene.instances.len();
        if count == 0 {
            return format!("there is no instance {self}: the scene has none");
        }
        let list = |mut names: Vec<String>| {
            let more = names.len().saturating_sub(LISTED);
            names.truncate(LISTED);
            let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
            if names.is_empty() { "none".to_owned() } else { names.join(", ") + &rest }
        };
        match self {
            Self::Index(index) => format!("there is no instance {index}: there are 0 to {}", count - 1),
            Self::Indices(_) => format!("not all of the instances {self} exist: there are 0 to {}", count - 1),
            Self::Template(template) => format!("template {template} has no instances"),
            Self::Id(id) => {
                let ids = scene.groups.iter().flat_map(|g| &g.instance_ids).map(u32::to_string).collect();
                format!("there is no instance with id {id}: ids are {}", list(ids))
            }
            Self::Group(name) => {
                // A group whose instances were all deleted, or became mirror images, has none.
                let used: BTreeSet<usize> = scene.instance_labels().iter().filter_map(|label| label.group).collect();
                let names = used.into_iter().filter_map(|group| scene.groups[group].name.clone()).collect();
                format!("there is no instance of a group \"{name}\": groups are {}", list(names))
            }
        }
    }
}

/// The instances whose mask id and group name satisfy a condition.
fn matching(scene: &InstancedScene, wanted: impl Fn(Option<u32>, Option<&str>) -> bool) -> Vec<usize> {
    let labels = scene.instance_labels();
    let name = |group: Option<usize>| group.and_then(|g| scene.groups[g].name.as_deref());
    (0..labels.len()).filter(|&k| wanted(labels[k].id, name(labels[k].group))).collect()
}
