//! What of a scene decides on the code of kernels.

/// Which SH bands are in use, and which of the rare offsets a scene has.
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
    /// Levels of detail.
    pub levels: bool,
}

impl SceneTraits {
    /// Of a scene without the rare offsets.
    pub fn plain(sh_degree: u32) -> Self {
        Self { sh_degree, ..Self::default() }
    }

    /// As spec constants.
    pub(super) fn constants(&self) -> [(&'static str, u32); 4] {
        [
            ("SH_DEGREE", self.sh_degree),
            ("OFFSET_SH_REST", u32::from(self.offset_sh_rest)),
            ("OFFSET_LOG_SCALES", u32::from(self.offset_log_scales)),
            ("OFFSET_QUATS", u32::from(self.offset_quats)),
        ]
    }
}
