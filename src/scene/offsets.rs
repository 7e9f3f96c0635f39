//! Offsets: per-instance, per-Gaussian differences from a template, which are added to its parameters (Eq. 6 of the
//! InstGS paper).

/// M offset records, which all instances of a scene share; instance k uses the run `first_offset .. first_offset + N`,
/// N being the size of its template, in the template's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Offsets {
    /// Added to the template's means, in the template's frame, before the instance's transform.
    pub means: Vec<[f32; 3]>,
    /// Added to SH coefficient 0; SH units, not colour.
    pub sh_dc: Vec<[f32; 3]>,
    /// Added to the opacity logit.
    pub opacity_logits: Vec<f32>,
    /// Added to SH coefficients 1.., 3 x RGB for degree 1, 8 for 2, 15 for 3 (the templates' degree), record by record;
    /// empty without such offsets. Only for ablations: normally all instances share them.
    pub sh_rest: Vec<[f32; 3]>,
    /// Added to the log standard deviations; empty without such offsets. Only for ablations.
    pub log_scales: Vec<[f32; 3]>,
    /// Added to the quaternions as stored (w, x, y, z), before the sum is normalised; empty without such offsets. Only
    /// for ablations.
    pub quats: Vec<[f32; 4]>,
}

impl Offsets {
    /// Number of offset records.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if there are no offsets.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// The SH coefficients 1.. of record `m`; empty without `sh_rest`.
    pub fn rest_of(&self, m: usize) -> &[[f32; 3]] {
        let coefficients = self.sh_rest.len() / self.len().max(1);
        &self.sh_rest[m * coefficients..][..coefficients]
    }

    /// True if every value of record `m` is finite.
    pub fn is_finite(&self, m: usize) -> bool {
        let colours = self.rest_of(m).iter().chain(self.log_scales.get(m)).chain([&self.means[m], &self.sh_dc[m]]);
        let scalars = self.quats.get(m).into_iter().flatten().chain([&self.opacity_logits[m]]);
        colours.flatten().chain(scalars).all(|v| v.is_finite())
    }

    /// Appends record `m` of `other`.
    pub fn push_from(&mut self, other: &Offsets, m: usize) {
        self.means.push(other.means[m]);
        self.sh_dc.push(other.sh_dc[m]);
        self.opacity_logits.push(other.opacity_logits[m]);
        self.sh_rest.extend_from_slice(other.rest_of(m));
        self.log_scales.extend(other.log_scales.get(m));
        self.quats.extend(other.quats.get(m));
    }

    /// Size of the offsets as f32 tensors, bytes: 28 per record without ablation offsets.
    pub fn tensor_bytes(&self) -> u64 {
        let ablations = 12 * (self.sh_rest.len() + self.log_scales.len()) + 16 * self.quats.len();
        (28 * self.len() + ablations) as u64
    }
}
