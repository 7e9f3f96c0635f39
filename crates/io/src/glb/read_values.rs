//! Values of accessors of a glTF file.

use std::collections::BTreeSet;
use std::path::Path;

use super::document::SPLATS;
use super::read_document::{Accessor, BufferView, Document};
use crate::error::{IoError, Place};
use crate::{LEAST_LOG_SCALE, logit_of_byte};
use instgs_vk::math::covariance::logit;
use instgs_vk::scene::Gaussians;
use instgs_vk::scene::gaussians::MAX_SH_DEGREE;

/// Accessors of a mesh of Gaussians, by index.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Attributes {
    pub(super) position: usize,
    pub(super) rotation: usize,
    pub(super) scale: usize,
    pub(super) opacity: usize,
    pub(super) sh_dc: usize,
    /// SH coefficients 1 and more: none, 3, 8 or 15.
    pub(super) sh_rest: Vec<usize>,
}

impl Attributes {
    /// The accessors that `index` finds by semantic.
    ///
    /// # Errors
    /// Names the attribute that is missing.
    pub(super) fn find(index: impl Fn(&str) -> Option<usize>) -> Result<Self, String> {
        let required = |name: String| index(&name).ok_or_else(|| format!("has no attribute {name}"));
        let splat = |name: &str| required(format!("{SPLATS}:{name}"));
        let mut sh_rest = Vec::new();
        for degree in 1..=MAX_SH_DEGREE {
            let names = (0..=2 * degree).map(|c| format!("{SPLATS}:SH_DEGREE_{degree}_COEF_{c}"));
            let names: Vec<String> = names.collect();
            if names.iter().all(|name| index(name).is_none()) {
                break;
            }
            for name in names {
                sh_rest.push(required(name)?);
            }
        }
        Ok(Self {
            position: required("POSITION".into())?,
            rotation: splat("ROTATION")?,
            scale: splat("SCALE")?,
            opacity: splat("OPACITY")?,
            sh_dc: splat("SH_DEGREE_0_COEF_0")?,
            sh_rest,
        })
    }

    /// The SH degree.
    pub(super) fn sh_degree(&self) -> u32 {
        ((self.sh_rest.len() + 1).isqrt() - 1) as u32
    }
}

/// How a component of an element is stored.
#[derive(Clone, Copy)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    F32,
}

impl Component {
    /// The component of glTF's number.
    fn of(number: u32) -> Option<Self> {
        match number {
            5120 => Some(Self::I8),
            5121 => Some(Self::U8),
            5122 => Some(Self::I16),
            5123 => Some(Self::U16),
            5126 => Some(Self::F32),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// The value that becomes 1 if values are normalised.
    fn most(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32_767.0,
            Self::U16 => 65_535.0,
            Self::F32 => 1.0,
        }
    }

    /// The value in the first bytes; 0 if there are too few.
    fn value(self, bytes: &[u8]) -> f64 {
        fn first<const N: usize>(bytes: &[u8]) -> [u8; N] {
            bytes.first_chunk().copied().unwrap_or([0; N])
        }
        match self {
            Self::I8 => f64::from(i8::from_le_bytes(first(bytes))),
            Self::U8 => f64::from(u8::from_le_bytes(first(bytes))),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes))),
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes))),
        }
    }
}

/// A document and its binary chunk.
pub(super) struct Values<'a> {
    pub(super) document: &'a Document,
    pub(super) binary: &'a [u8],
    pub(super) path: &'a Path,
    /// Whether scales are logarithms; see [`Values::has_negative_scale`].
    pub(super) scales_are_logs: bool,
}

impl Values<'_> {
    fn fail(&self, accessor: usize, what: impl Into<String>) -> IoError {
        IoError::new(self.path, what).at(Place::Field(format!("accessors[{accessor}]")))
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, IoError> {
        self.document.accessors.get(index).ok_or_else(|| self.fail(index, "does not exist"))
    }

    /// Number of elements of an accessor, as it claims.
    pub(super) fn count(&self, accessor: usize) -> Result<usize, IoError> {
        Ok(self.accessor(accessor)?.count)
    }

    /// The bytes of a buffer view that an accessor uses.
    fn view(&self, accessor: usize, view: &BufferView) -> Result<&[u8], IoError> {
        if let Some(name) = view.extensions.keys().find(|name| name.contains("compression")) {
            let error = self.fail(accessor, format!("is compressed by {name}, which is not read"));
            return Err(error.advise("write it without compression"));
        }
        let buffer = self.document.buffers.get(view.buffer);
        if view.buffer != 0 || buffer.is_none_or(|buffer| buffer.uri.is_some()) {
            let error = self.fail(accessor, "has its data outside of the file's binary chunk");
            return Err(error.advise("write it as one .glb"));
        }
        let end = view.byte_offset.checked_add(view.byte_length);
        end.and_then(|end| self.binary.get(view.byte_offset..end)).ok_or_else(|| {
            let (begin, length, have) = (view.byte_offset, view.byte_length, self.binary.len());
            self.fail(accessor, format!("has {length} bytes from {begin} on, of a binary chunk of {have}"))
        })
    }

    /// True if any of these meshes has a finite scale below 0. No length is, so the scales of the whole file are then
    /// logarithms, as in drafts of the extension. Meshes of several lengths, which [`Values::cloud`] refuses, are not looked at.
    ///
    /// # Errors
    /// An accessor does not fit the file.
    pub(super) fn has_negative_scale<'m>(&self, meshes: impl Iterator<Item = &'m Attributes>) -> Result<bool, IoError> {
        let accessors: BTreeSet<(usize, usize)> = meshes.map(|mesh| (mesh.scale, mesh.position)).collect();
        let is_negative = |scale: [f32; 3]| scale.iter().any(|s| s.is_finite() && *s < 0.0);
        for (scale, position) in accessors {
            if self.count(scale)? == self.count(position)? && self.elements::<3>(scale)?.any(is_negative) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The elements of an accessor of `N` components.
    fn read<const N: usize>(&self, index: usize) -> Result<Vec<[f32; N]>, IoError> {
        Ok(self.elements(index)?.collect())
    }

    /// The same, one after the other.
    fn elements<const N: usize>(&self, index: usize) -> Result<impl ExactSizeIterator<Item = [f32; N]>, IoError> {
        let accessor = self.accessor(index)?;
        let fail = |what: String| self.fail(index, what);
        let want = ["SCALAR", "VEC2", "VEC3", "VEC4"].get(N - 1).copied().unwrap_or_default();
        if accessor.element != want {
            return Err(fail(format!("has elements {}, not {want}", accessor.element)));
        }
        let component = Component::of(accessor.component_type)
            .ok_or_else(|| fail(format!("has the component type {}, which is not read", accessor.component_type)))?;
        let view = accessor.buffer_view.and_then(|view| self.document.buffer_views.get(view));
        let Some(view) = view.filter(|_| accessor.sparse.is_none()) else {
            return Err(fail("is sparse, or has no buffer view".into()));
        };
        let bytes = self.view(index, view)?;
        let size = N * component.bytes();
        let stride = view.byte_stride.unwrap_or(size);
        let last = accessor.count.checked_sub(1).map(|last| last.checked_mul(stride));
        let end = last.map(|last| last?.checked_add(accessor.byte_offset)?.checked_add(size));
        if stride < size || end.is_some_and(|end| end.is_none_or(|end| end > bytes.len())) {
            let what = format!("{} elements of {size} bytes do not fit its {} bytes", accessor.count, bytes.len());
            return Err(fail(what));
        }
        let scale = if accessor.normalized { component.most() } else { 1.0 };
        let least = if accessor.normalized { -1.0 } else { f64::NEG_INFINITY };
        let element = move |i: usize| {
            let element = bytes.get(accessor.byte_offset + i * stride..).unwrap_or_default();
            std::array::from_fn(|k| {
                let value = component.value(element.get(k * component.bytes()..).unwrap_or_default());
                // Not max, which would hide that a value is no number.
                let value = value / scale;
                if value < least { least as f32 } else { value as f32 }
            })
        };
        Ok((0..accessor.count).map(element))
    }

    /// The cloud of a mesh in its own frame.
    ///
    /// # Errors
    /// An accessor does not fit the file, or accessors have different lengths.
    pub(super) fn cloud(&self, attributes: &Attributes) -> Result<Gaussians, IoError> {
        let means = self.read::<3>(attributes.position)?;
        let count = means.len();
        let checked = |index: usize| -> Result<usize, IoError> {
            match self.count(index)? {
                same if same == count => Ok(index),
                other => Err(self.fail(index, format!("has {other} elements, where the positions are {count}"))),
            }
        };
        let quats = self.read::<4>(checked(attributes.rotation)?)?;
        let scales = self.read::<3>(checked(attributes.scale)?)?;
        let opacities = self.read::<1>(checked(attributes.opacity)?)?;
        let mut coefficients = vec![self.read::<3>(checked(attributes.sh_dc)?)?];
        for &index in &attributes.sh_rest {
            coefficients.push(self.read::<3>(checked(index)?)?);
        }
        let log_scale = if self.scales_are_logs { finite_log } else { log_of };
        let sh = (0..count).flat_map(|i| coefficients.iter().filter_map(move |values| values.get(i).copied()));
        Ok(Gaussians {
            sh_degree: attributes.sh_degree(),
            sh: sh.collect(),
            means,
            quats: quats.into_iter().map(|[x, y, z, w]| [w, x, y, z]).collect(),
            log_scales: scales.into_iter().map(|scale| scale.map(log_scale)).collect(),
            opacity_logits: opacities.into_iter().map(|[opacity]| opacity_logit(opacity)).collect(),
        })
    }
}

/// The logarithm of a linear scale. NaN stays NaN: the loader drops and counts such Gaussians.
fn log_of(scale: f32) -> f32 {
    if scale < f32::MIN_POSITIVE { LEAST_LOG_SCALE } else { f64::from(scale).ln() as f32 }
}

/// A scale that is a logarithm already; that of 0 becomes the least one.
fn finite_log(log_scale: f32) -> f32 {
    if log_scale == f32::NEG_INFINITY { LEAST_LOG_SCALE } else { log_scale }
}

/// The logit of an opacity, which is finite for 0 and 1 too. NaN stays NaN.
fn opacity_logit(opacity: f32) -> f32 {
    if opacity <= 0.0 {
        logit_of_byte(0)
    } else if opacity >= 1.0 {
        logit_of_byte(u8::MAX)
    } else {
        logit(f64::from(opacity)) as f32
    }
}
