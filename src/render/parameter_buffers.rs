//! One device buffer for every parameter of a scene, generated from the list in `scene::parameters`.

use std::sync::Arc;

use crate::gpu::staging::{download, write};
use crate::gpu::{Buffer, BufferPart, Gpu, GpuError, Home};
use crate::scene::parameters::{Parameter, ParameterSet, Rows, for_parameters};
use crate::scene::{InstancedScene, Owner};

use super::device_scene::PlannedBytes;
use super::source_windows::SourceWindow;

macro_rules! parameter_buffers {
    ($($(#[$doc:meta])* $variant:ident $field:ident: $element:ty, $name:literal, $owner:expr, $width:literal;)*) => {
        /// A buffer for every parameter, typed for the kernels: the parameters themselves, or their gradients. A parameter
        /// without rows has one unused element, since Vulkan has no empty buffers.
        pub struct ParameterBuffers {
            $($(#[$doc])* pub $field: Buffer<$element>,)*
        }

        impl ParameterBuffers {
            /// Allocates buffers of `rows` rows with undefined contents in device memory; their names start with `prefix`.
            ///
            /// # Errors
            /// A buffer exceeds the device's limits; the error names it.
            pub fn new(gpu: &Arc<Gpu>, prefix: &str, rows: &ParameterSet<Rows>) -> Result<Self, GpuError> {
                Self::at(gpu, prefix, rows, Home::Device)
            }

            /// The same as [`ParameterBuffers::new`], at `home`.
            ///
            /// # Errors
            /// The same errors as [`ParameterBuffers::new`].
            pub fn at(gpu: &Arc<Gpu>, prefix: &str, rows: &ParameterSet<Rows>, home: Home) -> Result<Self, GpuError> {
                let name = |parameter: Parameter| format!("{prefix}{}", parameter.name());
                let elements = |parameter: Parameter| {
                    rows[parameter].iter().sum::<usize>() * parameter.width() / parameter.element()
                };
                Ok(Self {
                    $($field: {
                        let (name, elements) = (name(Parameter::$variant), elements(Parameter::$variant));
                        match $owner {
                            Owner::Source | Owner::ShBand(_) => Buffer::in_parts(gpu, &name, elements, home)?,
                            Owner::Offset | Owner::Instance => Buffer::at(gpu, &name, elements, home)?,
                        }
                    },)*
                })
            }

            /// The buffers as flat f32, for code that treats all parameters alike.
            pub fn scalars(&self) -> ParameterSet<&Buffer<f32>> {
                ParameterSet([$(self.$field.scalars()),*])
            }

            /// The same as [`ParameterBuffers::scalars`], writable.
            pub fn scalars_mut(&mut self) -> ParameterSet<&mut Buffer<f32>> {
                ParameterSet([$(self.$field.scalars_mut()),*])
            }
        }
    };
}
for_parameters!(parameter_buffers);

impl ParameterBuffers {
    /// Uploads the parameters of a scene that have `rows` to buffers at `home`.
    ///
    /// # Errors
    /// A buffer exceeds the device's limits; the error names it.
    pub fn upload(
        gpu: &Arc<Gpu>,
        scene: &InstancedScene,
        rows: &ParameterSet<Rows>,
        home: Home,
    ) -> Result<Self, GpuError> {
        let mut out = Self::at(gpu, "", rows, home)?;
        for (parameter, buffer) in out.scalars_mut() {
            if rows[parameter] != [0, 0] {
                write(gpu, buffer, &scene.parameter(parameter))?;
            }
        }
        Ok(out)
    }

    /// Downloads the parameters into a scene with the same SH degrees. Waits for the device.
    ///
    /// # Errors
    /// A Vulkan call failed.
    pub fn download(
        &self,
        gpu: &Arc<Gpu>,
        rows: &ParameterSet<Rows>,
        scene: &mut InstancedScene,
    ) -> Result<(), GpuError> {
        for (parameter, buffer) in self.scalars() {
            let rows = rows[parameter];
            let values = download(gpu, buffer, rows.iter().sum::<usize>() * parameter.width())?;
            scene.set_parameter(parameter, rows, &values);
        }
        Ok(())
    }

    /// What a window shows of the arrays of source Gaussians.
    pub fn parts(&self, window: &SourceWindow) -> Vec<BufferPart> {
        let of_sources =
            self.scalars().into_iter().filter(|(p, _)| matches!(p.owner(), Owner::Source | Owner::ShBand(_)));
        of_sources.map(|(p, buffer)| window.part(buffer, p, 4 * p.width() as u64)).collect()
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        self.scalars().into_iter().map(|(_, buffer)| buffer.bytes()).sum()
    }
}

/// Bytes of the parameters of a scene that are `kept` in f32, without a device and without tables.
pub(super) fn planned_parameter_bytes(scene: &InstancedScene, kept: impl Fn(Parameter) -> bool) -> PlannedBytes {
    let mut out = PlannedBytes::default();
    for (parameter, rows) in scene.parameter_rows() {
        let rows = if kept(parameter) { rows } else { [0, 0] };
        let row_bytes = 4 * parameter.width() as u64;
        let [first, background] = rows.map(|rows| rows as u64 * row_bytes);
        match parameter.owner() {
            _ if first + background == 0 => out.unused += 4 * parameter.element() as u64,
            Owner::Source | Owner::ShBand(_) => {
                let own = if first == 0 { 0 } else { scene.own.len() as u64 * row_bytes };
                out.templates += first - own;
                out.own += own;
                out.background += background;
            }
            Owner::Offset => out.offsets += first,
            Owner::Instance => out.instances += first,
        }
    }
    out
}
