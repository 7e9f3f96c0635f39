//! How many bytes the device spends on a number of a scene that is drawn.

/// How the device holds a scene that is drawn. Training needs f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum DevicePrecision {
    /// Every number as it is.
    #[default]
    F32,
    /// Half as many bytes: f16 for all but means and colour matrices.
    F16,
    /// As f16, with offsets in 8 bits.
    Q8,
}

impl DevicePrecision {
    /// Every precision, from the most bytes to the fewest.
    pub const ALL: [Self; 3] = [Self::F32, Self::F16, Self::Q8];

    /// Its name in flags and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::Q8 => "q8",
        }
    }

    /// Value of the spec constant OFFSET_BITS of kernels that read packed offsets; 0 for offsets in f32.
    pub const fn offset_bits(self) -> u32 {
        match self {
            Self::F32 => 0,
            Self::F16 => 16,
            Self::Q8 => 8,
        }
    }
}
