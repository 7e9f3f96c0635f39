//! Traits of a scene that kernels are specialised for.

use crate::scene::DevicePrecision;

/// Which SH bands are in use, and what a scene has that most have not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneTraits {
    /// Largest SH degree in use; kernels omit the code of higher bands.
    pub sh_degree: u32,
    /// SH coefficients above 0 that have offsets.
    pub offset_sh_rest: u32,
    /// True if log scales have offsets.
    pub offset_log_scales: bool,
    /// True if quaternions have offsets.
    pub offset_quats: bool,
    /// True if instances have colour matrices.
    pub color_matrices: bool,
    /// True in training if instances may get Gaussians of their own.
    pub own_may_grow: bool,
    /// True if the scene has levels of detail.
    pub levels: bool,
    /// True if arrays of source Gaussians are larger than a binding, so that kernels see them in windows.
    pub windowed: bool,
    /// How the device holds the scene.
    pub precision: DevicePrecision,
}

impl SceneTraits {
    /// Traits of a scene without rare offsets or levels.
    pub fn plain(sh_degree: u32) -> Self {
        Self { sh_degree, ..Self::default() }
    }

    /// As spec constants of kernels that read source Gaussians and offsets.
    pub(super) fn constants(&self) -> [(&'static str, u32); 4] {
        [
            ("SH_DEGREE", self.sh_degree),
            ("OFFSET_SH_REST", self.offset_sh_rest),
            ("OFFSET_LOG_SCALES", u32::from(self.offset_log_scales)),
            ("OFFSET_QUATS", u32::from(self.offset_quats)),
        ]
    }

    /// The spec constant of kernels that see windows of the source Gaussians.
    pub(super) fn windowed_constant(&self) -> (&'static str, u32) {
        ("WINDOWED", u32::from(self.windowed))
    }

    /// The spec constant of kernels that colour instances.
    pub(super) fn color_matrices_constant(&self) -> (&'static str, u32) {
        ("COLOR_MATRICES", u32::from(self.color_matrices))
    }
}
