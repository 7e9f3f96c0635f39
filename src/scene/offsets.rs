//! Per-instance, per-Gaussian differences from a template (DESIGN Eq. 6).

/// M offset records, shared by all instances of a scene; instance k owns the run
/// `first_offset .. first_offset + N` where N is the size of its template, in the template's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Offsets {
    /// Added to the template mean in the template's frame, before the instance transform.
    pub means: Vec<[f32; 3]>,
    /// Added to SH coefficient 0, in SH units.
    pub sh_dc: Vec<[f32; 3]>,
    /// Added to the opacity logit.
    pub opacity_logits: Vec<f32>,
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

    /// Bytes of the offsets as f32 tensors: 28 per record.
    pub fn tensor_bytes(&self) -> u64 {
        28 * self.len() as u64
    }
}
