//! The list of the arrays that training may change. Upload, download, gradients, Adam's moments, Adam, checkpoints,
//! densification and sizes in bytes are generated from it: a new array is one line here, its values on the host
//! (`Offsets::arrays` if it is one of offsets), and the kernels that use it. `render::ParameterBuffers` has a typed
//! buffer for every line.

use std::borrow::Cow;
use std::ops::{Index, IndexMut};

use super::gaussians::{Gaussians, sh_coefficients};
use super::instanced_scene::InstancedScene;
use super::source_layout::CloudSize;

/// The elements that an array has rows for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// Every source Gaussian: first those of the templates, then instances' own, then those of the background.
    Source,
    /// Every source Gaussian of the clouds whose SH degree is at least this band.
    ShBand(u32),
    /// An offset record, or part of one; none in scenes without such offsets.
    Offset,
    /// An instance; none in scenes in which no instance has such a thing.
    Instance,
}

/// Calls a macro with the list: documentation, variant of [`Parameter`], field of the typed buffers, element of the buffer,
/// name in checkpoints, owner, and f32 in a row. The order is that of checkpoints and of the passes of Adam.
macro_rules! for_parameters {
    ($callback:ident) => {
        $callback! {
            /// Means of source Gaussians, scene units.
            Means means: [f32; 3], "means", Owner::Source, 3;
            /// Source quaternions wxyz, not normalised.
            Quats quats: [f32; 4], "quats", Owner::Source, 4;
            /// Logarithms of the standard deviations of source Gaussians.
            LogScales log_scales: [f32; 3], "log_scales", Owner::Source, 3;
            /// Opacity logits of source Gaussians.
            OpacityLogits opacity_logits: f32, "opacity_logits", Owner::Source, 1;
            /// SH band 0: one coefficient per source Gaussian.
            Sh0 sh0: [f32; 3], "sh_band_0", Owner::ShBand(0), 3;
            /// SH band 1: three coefficients per source Gaussian of the clouds that have it (`Instance::first_in_band`).
            /// Bands are separate because some drivers limit a binding to 128 MiB.
            Sh1 sh1: [f32; 3], "sh_band_1", Owner::ShBand(1), 9;
            /// SH band 2: five coefficients per source Gaussian of the clouds that have it.
            Sh2 sh2: [f32; 3], "sh_band_2", Owner::ShBand(2), 15;
            /// SH band 3: seven coefficients per source Gaussian of the clouds that have it.
            Sh3 sh3: [f32; 3], "sh_band_3", Owner::ShBand(3), 21;
            /// Offsets of means, template frame, template units.
            OffsetMeans offset_means: [f32; 3], "offset_means", Owner::Offset, 3;
            /// Offsets of SH coefficient 0.
            OffsetShDc offset_sh_dc: [f32; 3], "offset_sh_dc", Owner::Offset, 3;
            /// Offsets of opacity logits.
            OffsetOpacityLogits offset_opacity_logits: f32, "offset_opacity_logits", Owner::Offset, 1;
            /// Offsets of SH coefficients above 0, record by record; a row is one coefficient.
            OffsetShRest offset_sh_rest: [f32; 3], "offset_sh_rest", Owner::Offset, 3;
            /// Offsets of log standard deviations.
            OffsetLogScales offset_log_scales: [f32; 3], "offset_log_scales", Owner::Offset, 3;
            /// Offsets of quaternions.
            OffsetQuats offset_quats: [f32; 4], "offset_quats", Owner::Offset, 4;
            /// By instance, rows of (M | b): its colour is M rgb + b, before the clamp at 0.
            ColorFromTemplate color_from_template: [f32; 4], "color_from_template", Owner::Instance, 12;
        }
    };
}
pub(crate) use for_parameters;

macro_rules! parameter_enum {
    ($($(#[$doc:meta])* $variant:ident $field:ident: $element:ty, $name:literal, $owner:expr, $width:literal;)*) => {
        /// An array that training may change.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Parameter {
            $($(#[$doc])* $variant,)*
        }

        impl Parameter {
            /// Every array once, in the order of checkpoints.
            pub const ALL: [Self; [$($width),*].len()] = [$(Self::$variant),*];

            /// Name of its tensor in checkpoints, after `parameter.` or `moment.`.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// The elements that have a row of it.
            pub const fn owner(self) -> Owner {
                match self { $(Self::$variant => $owner,)* }
            }

            /// Number of f32 in a row.
            pub const fn width(self) -> usize {
                match self { $(Self::$variant => $width,)* }
            }

            /// Number of f32 in an element of its buffer; a row is a whole number of elements.
            pub const fn element(self) -> usize {
                match self { $(Self::$variant => size_of::<$element>() / 4,)* }
            }
        }
    };
}
for_parameters!(parameter_enum);

/// One value for every parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParameterSet<T>(pub [T; Parameter::ALL.len()]);

impl<T> ParameterSet<T> {
    /// Calls `of` for every parameter.
    pub fn from_fn(of: impl FnMut(Parameter) -> T) -> Self {
        Self(Parameter::ALL.map(of))
    }

    /// Calls `of` for every parameter.
    ///
    /// # Errors
    /// The first error that `of` returns.
    pub fn try_from_fn<E>(of: impl FnMut(Parameter) -> Result<T, E>) -> Result<Self, E> {
        let values = Parameter::ALL.into_iter().map(of).collect::<Result<Vec<T>, E>>()?;
        let values: Result<[T; Parameter::ALL.len()], _> = values.try_into();
        Ok(Self(values.unwrap_or_else(|_| unreachable!("one value per parameter"))))
    }

    /// Every parameter with a reference to its value.
    pub fn iter(&self) -> impl Iterator<Item = (Parameter, &T)> {
        Parameter::ALL.into_iter().zip(&self.0)
    }

    /// Every parameter with a mutable reference to its value.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (Parameter, &mut T)> {
        Parameter::ALL.into_iter().zip(&mut self.0)
    }

    /// Every parameter with its value in each of two sets.
    pub fn zip<U>(self, others: ParameterSet<U>) -> impl Iterator<Item = (Parameter, T, U)> {
        let values = self.0.into_iter().zip(others.0);
        Parameter::ALL.into_iter().zip(values).map(|(parameter, (value, other))| (parameter, value, other))
    }

    /// A set of mutable references to the values, for [`ParameterSet::zip`].
    pub fn each_mut(&mut self) -> ParameterSet<&mut T> {
        ParameterSet(self.0.each_mut())
    }
}

impl<T> IntoIterator for ParameterSet<T> {
    type Item = (Parameter, T);
    type IntoIter = std::iter::Zip<
        std::array::IntoIter<Parameter, { Parameter::ALL.len() }>,
        std::array::IntoIter<T, { Parameter::ALL.len() }>,
    >;

    fn into_iter(self) -> Self::IntoIter {
        Parameter::ALL.into_iter().zip(self.0)
    }
}

impl<T> Index<Parameter> for ParameterSet<T> {
    type Output = T;

    fn index(&self, parameter: Parameter) -> &T {
        &self.0[parameter as usize]
    }
}

impl<T> IndexMut<Parameter> for ParameterSet<T> {
    fn index_mut(&mut self, parameter: Parameter) -> &mut T {
        &mut self.0[parameter as usize]
    }
}

/// Numbers of rows of an array in two consecutive groups: `[of templates and instances, of background]`, or `[all, 0]`.
pub type Rows = [usize; 2];

/// A row of an array on the host: one or several f32.
pub trait FloatRow: bytemuck::Pod {}
impl FloatRow for f32 {}
impl<const N: usize> FloatRow for [f32; N] where [f32; N]: bytemuck::Pod {}

/// An array on the host as flat f32, whatever the width of its rows.
pub trait FloatArray {
    /// The numbers of all rows.
    fn flat(&self) -> &[f32];

    /// The same, to be changed.
    fn flat_mut(&mut self) -> &mut [f32];

    /// Appends whole rows; an incomplete last row is dropped.
    fn extend_flat(&mut self, values: &[f32]);

    /// Appends `rows` rows: copies of its rows from `source` on, or zeros.
    fn append_rows(&mut self, source: Option<usize>, rows: usize);

    /// Reserves memory for `rows` more rows, or fails if there is not enough.
    fn try_reserve_rows(&mut self, rows: usize) -> Result<(), std::collections::TryReserveError>;

    /// Removes all rows of the array.
    fn clear_rows(&mut self);
}

impl<R: FloatRow> FloatArray for Vec<R> {
    fn flat(&self) -> &[f32] {
        bytemuck::cast_slice(self)
    }

    fn flat_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(self)
    }

    fn extend_flat(&mut self, values: &[f32]) {
        let width = size_of::<R>() / size_of::<f32>();
        self.extend_from_slice(bytemuck::cast_slice(&values[..values.len() / width * width]));
    }

    fn append_rows(&mut self, source: Option<usize>, rows: usize) {
        match source {
            Some(first) => self.extend_from_within(first..first + rows),
            None => self.resize(self.len() + rows, R::zeroed()),
        }
    }

    fn try_reserve_rows(&mut self, rows: usize) -> Result<(), std::collections::TryReserveError> {
        self.try_reserve(rows)
    }

    fn clear_rows(&mut self) {
        self.clear();
    }
}

impl Gaussians {
    /// The numbers of a parameter of source Gaussians, row by row; empty for a band above the cloud's degree.
    pub fn parameter(&self, parameter: Parameter) -> Cow<'_, [f32]> {
        match parameter {
            Parameter::Means => self.means.flat().into(),
            Parameter::Quats => self.quats.flat().into(),
            Parameter::LogScales => self.log_scales.flat().into(),
            Parameter::OpacityLogits => self.opacity_logits.flat().into(),
            _ => match parameter.owner() {
                Owner::ShBand(l) if l <= self.sh_degree => {
                    let mut out = Vec::with_capacity(self.len() * parameter.width());
                    let of_gaussians = self.sh.chunks_exact(self.sh_coefficients());
                    of_gaussians.for_each(|sh| out.extend_from_slice(sh[band_of(l)].as_flattened()));
                    out.into()
                }
                _ => (&[][..]).into(),
            },
        }
    }

    /// Replaces the numbers of a parameter of source Gaussians; bands above the cloud's degree are ignored.
    pub fn set_parameter(&mut self, parameter: Parameter, values: &[f32]) {
        let array: &mut dyn FloatArray = match parameter {
            Parameter::Means => &mut self.means,
            Parameter::Quats => &mut self.quats,
            Parameter::LogScales => &mut self.log_scales,
            Parameter::OpacityLogits => &mut self.opacity_logits,
            _ => return self.set_sh_band(parameter, values),
        };
        array.clear_rows();
        array.extend_flat(values);
    }

    fn set_sh_band(&mut self, parameter: Parameter, values: &[f32]) {
        let (Owner::ShBand(l), coefficients) = (parameter.owner(), self.sh_coefficients()) else { return };
        if l <= self.sh_degree {
            self.sh.resize(values.len() / parameter.width() * coefficients, [0.0; 3]);
            let rows = self.sh.chunks_exact_mut(coefficients).zip(values.chunks_exact(parameter.width()));
            rows.for_each(|(sh, row)| sh[band_of(l)].as_flattened_mut().copy_from_slice(row));
        }
    }
}

/// The coefficients of SH band `l`.
fn band_of(l: u32) -> std::ops::Range<usize> {
    (l * l) as usize..sh_coefficients(l)
}

impl InstancedScene {
    /// Numbers of rows of every parameter.
    pub fn parameter_rows(&self) -> ParameterSet<Rows> {
        let posed = CloudSize { len: self.templates.len() + self.own.len(), ..CloudSize::of(&self.templates) };
        let clouds = [posed, CloudSize::of(&self.background)];
        ParameterSet::from_fn(|parameter| {
            let all = || [self.parameter(parameter).len() / parameter.width(), 0];
            parameter.source_rows(clouds).unwrap_or_else(all)
        })
    }

    /// The numbers of a parameter, row by row.
    pub fn parameter(&self, parameter: Parameter) -> Cow<'_, [f32]> {
        match parameter.owner() {
            Owner::Source | Owner::ShBand(_) => {
                let parts = [&self.templates, &self.own, &self.background].map(|cloud| cloud.parameter(parameter));
                let mut filled = parts.iter().filter(|part| !part.is_empty());
                match (filled.next(), filled.next()) {
                    (Some(only), None) => only.clone(),
                    _ => parts.concat().into(),
                }
            }
            Owner::Offset => self.offsets.array(parameter).map_or(&[][..], FloatArray::flat).into(),
            Owner::Instance => self.color_from_template.as_flattened().as_flattened().into(),
        }
    }

    /// True if both show the same, to the bit: templates, instances with offsets and own Gaussians, background. Names, where they came
    /// from, and what a file had besides may differ.
    pub fn shows_the_same(&self, other: &Self) -> bool {
        self.template_ranges == other.template_ranges
            && self.instances == other.instances
            && self.own_ranges == other.own_ranges
            && (self.pixel_filter, self.near_plane) == (other.pixel_filter, other.near_plane)
            && Parameter::ALL.iter().all(|&parameter| self.parameter(parameter) == other.parameter(parameter))
    }

    /// Replaces the numbers of a parameter, of which there are `rows` rows; SH degrees, and the number of instances' own
    /// Gaussians, stay unchanged.
    pub fn set_parameter(&mut self, parameter: Parameter, rows: Rows, values: &[f32]) {
        match parameter.owner() {
            Owner::Source | Owner::ShBand(_) => {
                let (posed, of_background) = values.split_at((rows[0] * parameter.width()).min(values.len()));
                let of_own = if rows[0] == 0 { 0 } else { self.own.len() * parameter.width() };
                let (of_templates, of_own) = posed.split_at(posed.len().saturating_sub(of_own));
                self.templates.set_parameter(parameter, of_templates);
                self.own.set_parameter(parameter, of_own);
                self.background.set_parameter(parameter, of_background);
            }
            Owner::Offset => {
                if let Some((_, array)) = self.offsets.arrays_mut().into_iter().find(|(p, _)| *p == parameter) {
                    array.clear_rows();
                    array.extend_flat(values);
                }
            }
            Owner::Instance => self.color_from_template = values.as_chunks().0.as_chunks().0.to_vec(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SourceRange;

    /// Two clouds of different degrees, and offsets of which some are absent; all numbers are distinct.
    fn scene() -> InstancedScene {
        let mut next = 0.0;
        let mut numbers = |count: usize| -> Vec<f32> {
            let first = next;
            next += count as f32;
            (0..count).map(|k| first + k as f32).collect()
        };
        let mut scene = InstancedScene::default();
        scene.templates.sh_degree = 2;
        scene.background.sh_degree = 1;
        for parameter in Parameter::ALL {
            let rows = match parameter.owner() {
                Owner::Source | Owner::ShBand(0 | 1) => [2, 3],
                Owner::ShBand(2) => [2, 0],
                Owner::Offset if parameter != Parameter::OffsetQuats => [4, 0],
                Owner::Instance => [2, 0],
                _ => [0, 0],
            };
            scene.set_parameter(parameter, rows, &numbers((rows[0] + rows[1]) * parameter.width()));
        }
        scene
    }

    #[test]
    fn a_scene_is_what_its_parameters_say() {
        let scene = scene();
        assert_eq!((scene.templates.wrong_length(), scene.background.wrong_length()), (None, None));
        let rows = scene.parameter_rows();
        assert_eq!((rows[Parameter::Means], rows[Parameter::Sh2], rows[Parameter::Sh3]), ([2, 3], [2, 0], [0, 0]));
        assert_eq!((rows[Parameter::OffsetMeans], rows[Parameter::OffsetQuats]), ([4, 0], [0, 0]));
        let mut copy = InstancedScene::default();
        (copy.templates.sh_degree, copy.background.sh_degree) = (2, 1);
        for (parameter, rows) in rows {
            let values = scene.parameter(parameter);
            assert_eq!(values.len(), (rows[0] + rows[1]) * parameter.width(), "{parameter:?}");
            copy.set_parameter(parameter, rows, &values);
        }
        assert_eq!(copy, scene);
        // Band 1 of the first background Gaussian: after the two rows of the templates.
        assert_eq!(scene.background.sh_of(0)[1..4].as_flattened(), &scene.parameter(Parameter::Sh1)[18..27]);
    }

    #[test]
    fn what_is_drawn_is_the_same_or_not() {
        let scene = scene();
        let other = |change: &dyn Fn(&mut InstancedScene)| {
            let mut changed = scene.clone();
            change(&mut changed);
            changed
        };
        assert!(scene.shows_the_same(&other(&|s| s.source = "elsewhere".into())));
        for parameter in Parameter::ALL {
            let (rows, values) = (scene.parameter_rows()[parameter], scene.parameter(parameter).into_owned());
            let moved: Vec<f32> = values.iter().map(|v| v + 1.0).collect();
            let changed = other(&|s| s.set_parameter(parameter, rows, &moved));
            assert_eq!(scene.shows_the_same(&changed), values.is_empty(), "{parameter:?}");
        }
        let range = SourceRange { first: 0, count: 1 };
        assert!(!scene.shows_the_same(&other(&|s| s.template_ranges.push(range))));
        assert!(!scene.shows_the_same(&other(&|s| s.own_ranges.push(range))));
        assert!(!scene.shows_the_same(&other(&|s| s.pixel_filter.antialias = true)));
        assert!(!scene.shows_the_same(&other(&|s| s.near_plane.0 = 0.1)));
    }

    #[test]
    fn names_are_unique_and_rows_are_whole_elements() {
        let names: std::collections::BTreeSet<_> = Parameter::ALL.iter().map(|p| p.name()).collect();
        assert_eq!(names.len(), Parameter::ALL.len());
        assert!(Parameter::ALL.iter().all(|p| p.width() % p.element() == 0));
        assert!(Parameter::ALL.iter().enumerate().all(|(k, p)| *p as usize == k));
    }

    #[test]
    fn values_are_found_by_their_parameter() {
        let mut set = ParameterSet::from_fn(Parameter::width);
        set[Parameter::Quats] += 1;
        assert_eq!((set[Parameter::Quats], set[Parameter::OffsetQuats]), (5, 4));
        let failed = ParameterSet::try_from_fn(|p| if p == Parameter::Sh2 { Err(p) } else { Ok(p) });
        assert_eq!(failed.err(), Some(Parameter::Sh2));
        assert!(set.zip(ParameterSet::from_fn(Parameter::name)).all(|(p, _, name)| p.name() == name));
    }
}
