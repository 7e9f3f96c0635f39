//! A cloud of 3D Gaussians, structure of arrays, in the INRIA parametrisation.

use super::instanced_scene::SourceRange;

/// Number of SH coefficients per colour channel of a `degree` (0..=3): (degree + 1)^2.
pub const fn sh_coefficients(degree: u32) -> usize {
    ((degree + 1) * (degree + 1)) as usize
}

/// The largest SH degree of the file formats and kernels.
pub const MAX_SH_DEGREE: u32 = 3;

/// N Gaussians in one frame. All arrays have N entries, except `sh`, which has `N * sh_coefficients(sh_degree)`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Spherical-harmonics degree of `sh`, 0..=3.
    pub sh_degree: u32,
    /// Centres, scene units, in the frame of the cloud: world for a background, template frame for a template.
    pub means: Vec<[f32; 3]>,
    /// Rotations as quaternions (w, x, y, z) of any length but zero; code that uses them normalises.
    pub quats: Vec<[f32; 4]>,
    /// Natural logarithms of the standard deviations along the local axes, scene units.
    pub log_scales: Vec<[f32; 3]>,
    /// Logits of the opacities: the values before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// SH coefficients `[Gaussian][coefficient][rgb]`, flattened: entry `i * C + c` is coefficient c of Gaussian i.
    pub sh: Vec<[f32; 3]>,
}

impl Gaussians {
    /// An empty cloud of the given SH degree with room for `capacity` Gaussians.
    pub fn with_capacity(sh_degree: u32, capacity: usize) -> Self {
        Self {
            sh_degree,
            means: Vec::with_capacity(capacity),
            quats: Vec::with_capacity(capacity),
            log_scales: Vec::with_capacity(capacity),
            opacity_logits: Vec::with_capacity(capacity),
            sh: Vec::with_capacity(capacity * sh_coefficients(sh_degree)),
        }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Number of SH coefficients per Gaussian and channel.
    pub fn sh_coefficients(&self) -> usize {
        sh_coefficients(self.sh_degree)
    }

    /// The first array whose length does not match the means: its name, its length, and the expected length.
    pub fn wrong_length(&self) -> Option<(&'static str, usize, usize)> {
        let count = self.len();
        let lengths = [
            ("quats", self.quats.len(), count),
            ("log_scales", self.log_scales.len(), count),
            ("opacity_logits", self.opacity_logits.len(), count),
            ("sh", self.sh.len(), count * self.sh_coefficients()),
        ];
        lengths.into_iter().find(|(_, len, want)| len != want)
    }

    /// The SH coefficients `[C][rgb]` of Gaussian `i`.
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let c = self.sh_coefficients();
        &self.sh[i * c..(i + 1) * c]
    }

    /// True if every parameter of Gaussian `i` is finite and its quaternion is not zero.
    pub fn is_finite(&self, i: usize) -> bool {
        let finite = |values: &[f32]| values.iter().all(|v| v.is_finite());
        finite(&self.means[i])
            && finite(&self.quats[i])
            && self.quats[i].iter().any(|&q| q != 0.0)
            && finite(&self.log_scales[i])
            && self.opacity_logits[i].is_finite()
            && self.sh_of(i).iter().all(|c| finite(c))
    }

    /// Appends Gaussian `i` of `other`, padding its SH with zeros or truncating it to this cloud's degree.
    pub fn push_from(&mut self, other: &Gaussians, i: usize) {
        self.means.push(other.means[i]);
        self.quats.push(other.quats[i]);
        self.log_scales.push(other.log_scales[i]);
        self.opacity_logits.push(other.opacity_logits[i]);
        let source = other.sh_of(i);
        for c in 0..self.sh_coefficients() {
            self.sh.push(source.get(c).copied().unwrap_or([0.0; 3]));
        }
    }

    /// Appends all of `other`, padding their SH with zeros or truncating it to this cloud's degree.
    pub fn append(&mut self, other: &Gaussians) {
        for i in 0..other.len() {
            self.push_from(other, i);
        }
    }

    /// A cloud of the Gaussians whose index satisfies `keep`, in order.
    pub fn filtered(&self, keep: impl Fn(usize) -> bool) -> Gaussians {
        let mut out = Gaussians::with_capacity(self.sh_degree, self.len());
        (0..self.len()).filter(|&i| keep(i)).for_each(|i| out.push_from(self, i));
        out
    }

    /// A copy of a range of the cloud.
    pub fn range(&self, range: SourceRange) -> Gaussians {
        let mut out = Gaussians::with_capacity(self.sh_degree, range.count as usize);
        range.indices().for_each(|i| out.push_from(self, i));
        out
    }

    /// Changes the SH degree: higher coefficients are dropped, missing ones are 0.
    pub fn set_sh_degree(&mut self, sh_degree: u32) {
        let (have, want) = (self.sh_coefficients(), sh_coefficients(sh_degree));
        if have != want {
            let of = |sh: &[[f32; 3]]| (0..want).map(|c| sh.get(c).copied().unwrap_or_default()).collect::<Vec<_>>();
            self.sh = self.sh.chunks(have).flat_map(of).collect();
        }
        self.sh_degree = sh_degree;
    }

    /// Removes Gaussians with a non-finite parameter or a zero quaternion; returns how many were removed.
    pub fn drop_non_finite(&mut self) -> usize {
        let before = self.len();
        if (0..before).all(|i| self.is_finite(i)) {
            return 0;
        }
        let kept = self.filtered(|i| self.is_finite(i));
        *self = kept;
        before - self.len()
    }

    /// Size of the parameters as f32 tensors, bytes.
    pub fn tensor_bytes(&self) -> u64 {
        4 * (self.len() * (3 + 4 + 3 + 1 + 3 * self.sh_coefficients())) as u64
    }
}
