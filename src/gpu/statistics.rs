//! What a driver says of the machine code that it made of kernels (`VK_KHR_pipeline_executable_properties`).

use ash::{khr, vk};

use super::context::Gpu;
use super::error::GpuError;

/// A pipeline that a device has compiled.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct CompiledPipeline {
    /// Stem of the kernel's file.
    pub kernel: &'static str,
    /// Lanes per subgroup that the pipeline requires; `None` if any number will do, or if the device takes no wishes.
    pub required_subgroup_size: Option<u32>,
    /// Specialisation constants by name.
    pub constants: Vec<(String, u32)>,
    /// The machine code: empty unless the device was opened with
    /// [`GpuOptions::pipeline_statistics`](super::GpuOptions::pipeline_statistics).
    pub executables: Vec<Executable>,
}

/// One piece of machine code. A driver may make several of a kernel, for instance one per subgroup size.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Executable {
    /// The driver's name of it.
    pub name: String,
    /// Lanes per subgroup.
    pub subgroup_size: u32,
    /// Figures by the driver's names, in its units and order.
    pub statistics: Vec<(String, f64)>,
}

/// The driver's functions that describe pipelines.
pub(super) struct DriverStatistics(khr::pipeline_executable_properties::Device);

impl DriverStatistics {
    /// For a device that was created with the extension.
    pub(super) fn new(instance: &ash::Instance, device: &ash::Device) -> Self {
        Self(khr::pipeline_executable_properties::Device::new(instance, device))
    }

    /// The machine code of a pipeline.
    ///
    /// # Safety
    /// The pipeline is of this device and was created with `CAPTURE_STATISTICS`.
    unsafe fn executables(&self, pipeline: vk::Pipeline) -> Result<Vec<Executable>, vk::Result> {
        let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
        // SAFETY: guaranteed by the caller.
        let properties = unsafe { self.0.get_pipeline_executable_properties(&info) }?;
        let of_one = |(index, one): (usize, &vk::PipelineExecutablePropertiesKHR<'_>)| {
            let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index as u32);
            // SAFETY: guaranteed by the caller; the index is below the number of executables.
            let statistics = unsafe { self.0.get_pipeline_executable_statistics(&info) }?;
            let name = text(one.name_as_c_str());
            let statistics = statistics.iter().map(|s| (text(s.name_as_c_str()), value(s))).collect();
            Ok(Executable { name, subgroup_size: one.subgroup_size, statistics })
        };
        properties.iter().enumerate().map(of_one).collect()
    }
}

fn text(name: Result<&std::ffi::CStr, std::ffi::FromBytesUntilNulError>) -> String {
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Counts of more than 53 bits, which only hashes have, are rounded.
fn value(statistic: &vk::PipelineExecutableStatisticKHR<'_>) -> f64 {
    let value = statistic.value;
    // SAFETY: the format says which member the driver has written.
    unsafe {
        match statistic.format {
            vk::PipelineExecutableStatisticFormatKHR::BOOL32 => f64::from(value.b32),
            vk::PipelineExecutableStatisticFormatKHR::INT64 => value.i64 as f64,
            vk::PipelineExecutableStatisticFormatKHR::UINT64 => value.u64 as f64,
            _ => value.f64,
        }
    }
}

impl Gpu {
    /// All pipelines that the device has compiled so far, by name of the kernel and by constants.
    ///
    /// # Errors
    /// The driver fails to describe one.
    pub fn compiled_pipelines(&self) -> Result<Vec<CompiledPipeline>, GpuError> {
        let describe = |(key, handle)| {
            let (kernel, required_subgroup_size, constants) = key;
            let executables = match &self.statistics {
                // SAFETY: the store holds pipelines of this device; with `statistics` they were created with the flag.
                Some(driver) => unsafe { driver.executables(handle) }.map_err(GpuError::vulkan(kernel))?,
                None => Vec::new(),
            };
            Ok(CompiledPipeline { kernel, required_subgroup_size, constants, executables })
        };
        self.pipelines.handles().into_iter().map(describe).collect()
    }
}
