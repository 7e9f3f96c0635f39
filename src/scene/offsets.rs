//! Offsets: per-instance, per-Gaussian differences from a template, which are added to its parameters (Eq. 6 of the
//! InstGS paper).

use super::parameters::{FloatArray, Parameter};

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
    /// Added to SH coefficients 1.., record by record: 3 x RGB for degree 1, 8 for 2, 15 for 3, of a degree up to the
    /// templates'; empty without such offsets, as is usual: all instances share them.
    pub sh_rest: Vec<[f32; 3]>,
    /// Added to the log standard deviations; empty without such offsets.
    pub log_scales: Vec<[f32; 3]>,
    /// Added to the quaternions as stored (w, x, y, z), before the sum is normalised; empty without.
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

    /// Number of SH coefficients above 0 that a record has.
    pub fn rest_coefficients(&self) -> usize {
        self.sh_rest.len() / self.len().max(1)
    }

    /// The SH degree up to which there are offsets; 0 = of the base colour alone.
    pub fn sh_degree(&self) -> u32 {
        (self.rest_coefficients() + 1).isqrt() as u32 - 1
    }

    /// The SH coefficients 1.. of record `m`; empty without `sh_rest`.
    pub fn rest_of(&self, m: usize) -> &[[f32; 3]] {
        let coefficients = self.rest_coefficients();
        &self.sh_rest[m * coefficients..][..coefficients]
    }

    /// All arrays by their parameter; rare ones may be empty.
    pub fn arrays(&self) -> [(Parameter, &dyn FloatArray); 6] {
        [
            (Parameter::OffsetMeans, &self.means),
            (Parameter::OffsetShDc, &self.sh_dc),
            (Parameter::OffsetOpacityLogits, &self.opacity_logits),
            (Parameter::OffsetShRest, &self.sh_rest),
            (Parameter::OffsetLogScales, &self.log_scales),
            (Parameter::OffsetQuats, &self.quats),
        ]
    }

    /// As [`Offsets::arrays`], to be changed.
    pub fn arrays_mut(&mut self) -> [(Parameter, &mut dyn FloatArray); 6] {
        [
            (Parameter::OffsetMeans, &mut self.means),
            (Parameter::OffsetShDc, &mut self.sh_dc),
            (Parameter::OffsetOpacityLogits, &mut self.opacity_logits),
            (Parameter::OffsetShRest, &mut self.sh_rest),
            (Parameter::OffsetLogScales, &mut self.log_scales),
            (Parameter::OffsetQuats, &mut self.quats),
        ]
    }

    /// The array of a parameter, if it is one of offsets.
    pub fn array(&self, parameter: Parameter) -> Option<&dyn FloatArray> {
        self.arrays().into_iter().find(|(p, _)| *p == parameter).map(|(_, array)| array)
    }

    /// Rows that a record has in an array: 1, or none in a rare one that is empty, or the coefficients of `sh_rest`.
    pub(crate) fn rows_per_record(&self, parameter: Parameter, array: &dyn FloatArray) -> usize {
        match parameter {
            Parameter::OffsetMeans | Parameter::OffsetShDc | Parameter::OffsetOpacityLogits => 1,
            _ => array.flat().len() / parameter.width() / self.len().max(1),
        }
    }

    /// The numbers of record `m` by array.
    fn record(&self, m: usize) -> impl Iterator<Item = &[f32]> {
        self.arrays().into_iter().map(move |(parameter, array)| {
            let width = self.rows_per_record(parameter, array) * parameter.width();
            &array.flat()[m * width..][..width]
        })
    }

    /// True if every number of record `m` is finite.
    pub fn is_finite(&self, m: usize) -> bool {
        self.record(m).flatten().all(|v| v.is_finite())
    }

    /// Makes all offsets of record `m` zero.
    pub fn clear(&mut self, m: usize) {
        let widths = self.arrays().map(|(parameter, array)| self.rows_per_record(parameter, array) * parameter.width());
        for ((_, array), width) in self.arrays_mut().into_iter().zip(widths) {
            array.flat_mut()[m * width..][..width].fill(0.0);
        }
    }

    /// Appends record `m` of `other`.
    pub fn push_from(&mut self, other: &Offsets, m: usize) {
        self.arrays_mut().into_iter().zip(other.record(m)).for_each(|((_, array), row)| array.extend_flat(row));
    }

    /// Size of the offsets as f32 tensors, bytes: 28 per record without those of shape and of SH above band 0.
    pub fn tensor_bytes(&self) -> u64 {
        let width = |(parameter, array): (Parameter, &dyn FloatArray)| {
            self.rows_per_record(parameter, array) * parameter.width()
        };
        (4 * self.len() * self.arrays().into_iter().map(width).sum::<usize>()) as u64
    }
}
