//! Sizes of a scene: numbers of Gaussians, and bytes of file and memory. Reports contain them under these names.

use instgs_vk::scene::InstancedScene;
use serde::{Deserialize, Serialize};

/// Numbers of Gaussians of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Gaussians in templates; 0 for a plain cloud.
    pub template: u64,
    /// Number of offset records; 0 for a plain cloud.
    pub offsets: u64,
    /// Gaussians that instances have of their own; reports leave it out where there are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub own: u64,
    /// Gaussians in the background; all of a plain cloud.
    pub background: u64,
    /// Gaussians after expanding all instances.
    pub expanded: u64,
    /// Those of them that instances hide by their offsets: stored, but never drawn. Reports leave it out where there are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub hidden: u64,
}

impl Counts {
    /// Counts the Gaussians of a scene.
    pub fn of(scene: &InstancedScene) -> Self {
        Self {
            template: scene.templates.len() as u64,
            offsets: scene.offsets.len() as u64,
            own: scene.own.len() as u64,
            background: scene.background.len() as u64,
            expanded: scene.expanded_len(),
            hidden: scene.hidden_len(),
        }
    }

    /// Number of Gaussians in the file: those of templates, instances' own, and background.
    pub fn stored(&self) -> u64 {
        self.template + self.own + self.background
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Sizes in bytes of a scene's file and of memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bytes {
    /// Length of the scene file.
    pub file: u64,
    /// Numbers of the scene that were read into host memory, as f32: of a scene in pages, coarse levels in place of its
    /// background.
    pub host: u64,
    /// Scene buffers that kernels read.
    pub device_scene: u64,
    /// How much of that is in host memory, because it is too large for the device's.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub scene_on_host: u64,
    /// Largest amount of device memory in use at a time, including frame buffers and staging.
    pub device_peak: u64,
}
