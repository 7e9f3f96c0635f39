//! What of a scene decides on the code of kernels.

/// Which SH bands are in use, and what a scene has that most have not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneTraits {
    /// SH bands above this one have no code.
    pub sh_degree: u32,
    /// Offsets of SH coefficients above 0.
    pub offset_sh_rest: bool,
    /// Offsets of log standard deviations.
    pub offset_log_scales: bool,
    /// Offsets of quaternions.
    pub offset_quats: bool,
    /// Colour matrices of instances.
    pub color_matrices: bool,
    /// Levels of detail.
    pub levels: bool,
}

impl SceneTraits {
    /// Of a scene without the rare offsets.
    pub fn plain(sh_degree: u32) -> Self {
        Self { sh_degree, ..Self::default() }
    }

    /// As spec constants of kernels that read source Gaussians and offsets.
    pub(super) fn constants(&self) -> [(&'static str, u32); 4] {
        [
            ("SH_DEGREE", self.sh_degree),
            ("OFFSET_SH_REST", u32::from(self.offset_sh_rest)),
            ("OFFSET_LOG_SCALES", u32::from(self.offset_log_scales)),
            ("OFFSET_QUATS", u32::from(self.offset_quats)),
        ]
    }

    /// The spec constant of kernels that colour instances.
    pub(super) fn color_matrices_constant(&self) -> (&'static str, u32) {
        ("COLOR_MATRICES", u32::from(self.color_matrices))
    }
}
