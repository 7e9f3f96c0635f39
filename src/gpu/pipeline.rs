//! Compute pipelines: one per kernel and set of spec constants, created once per device.

use std::collections::HashMap;
use std::io::Write as _;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use super::context::Gpu;
use super::error::GpuError;
use super::interface::{Kernel, Shader};

/// Vulkan's pipeline cache, stored in a file between runs if a path is given.
pub struct PipelineCache {
    gpu: Arc<Gpu>,
    handle: vk::PipelineCache,
    path: Option<PathBuf>,
    /// Contents of the file when the cache was opened.
    loaded: Vec<u8>,
}

/// FNV-1a over the cache's data, stored first in the file: drivers check the header of a cache, but trust its body.
fn checksum(data: &[u8]) -> [u8; 8] {
    let step = |hash: u64, &byte: &u8| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    data.iter().fold(0xcbf2_9ce4_8422_2325, step).to_le_bytes()
}

fn read_cache(path: &Path) -> Option<Vec<u8>> {
    let file = std::fs::read(path).ok()?;
    let (sum, data) = file.split_first_chunk::<8>()?;
    (*sum == checksum(data)).then(|| data.to_vec())
}

fn write_cache(path: &Path, data: &[u8]) -> std::io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    file.write_all(&checksum(data))?;
    file.write_all(data)?;
    file.persist(path)?;
    Ok(())
}

impl PipelineCache {
    /// Opens the cache. A missing, damaged or foreign file counts as an empty cache.
    pub fn new(gpu: &Arc<Gpu>, path: Option<&Path>) -> Result<Self, GpuError> {
        let loaded = path.and_then(read_cache).unwrap_or_default();
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&loaded);
        // SAFETY: the data is what a driver gave us (checksum), and drivers check its header to be their own.
        let handle =
            unsafe { gpu.device.create_pipeline_cache(&info, None) }.map_err(GpuError::vulkan("pipeline cache"))?;
        Ok(Self { gpu: gpu.clone(), handle, path: path.map(Path::to_path_buf), loaded })
    }
}

/// The user's cache file for a device, or `None` if the system names no cache folder. The file name contains the
/// device's name, so that the devices of one machine do not share a file.
pub fn user_cache_path(device_name: &str) -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let folder = variable("XDG_CACHE_HOME")
        .or_else(|| variable("LOCALAPPDATA"))
        .or_else(|| variable("HOME").map(|home| home.join(".cache")))?
        .join("instgs-vk");
    std::fs::create_dir_all(&folder).ok()?;
    let name: String = device_name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    Some(folder.join(format!("{name}.pipelines")))
}

impl Drop for PipelineCache {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // SAFETY: the cache is valid. Losing it costs only compile time, so errors are ignored.
            if let Ok(data) = unsafe { self.gpu.device.get_pipeline_cache_data(self.handle) }
                && data != self.loaded
            {
                let _ = write_cache(path, &data);
            }
        }
        // SAFETY: owned by self; pipelines made from it do not need it any more.
        unsafe { self.gpu.device.destroy_pipeline_cache(self.handle, None) };
    }
}

/// The Vulkan objects of a pipeline.
#[derive(Clone, Copy)]
struct Compiled {
    handle: vk::Pipeline,
    layout: vk::PipelineLayout,
    set_layout: vk::DescriptorSetLayout,
}

/// Kernel, required subgroup size if it needs one, and spec constants.
type Key = (&'static str, Option<u32>, Vec<(String, u32)>);

/// The pipelines of a device, which live as long as it does, so that the phases of a run share them. Drivers may
/// compile a kernel only when it is first run, which Vulkan's cache does not avoid; lavapipe takes 0.1 to 0.15 s for
/// the training kernels.
#[derive(Default)]
pub(super) struct PipelineStore(Mutex<HashMap<Key, Compiled>>);

impl PipelineStore {
    /// Returns the pipeline of `key`; calls `create` if there is none.
    fn get_or_create(
        &self,
        key: Key,
        create: impl FnOnce() -> Result<Compiled, GpuError>,
    ) -> Result<Compiled, GpuError> {
        // A panic in another thread leaves the map intact.
        let mut pipelines = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&compiled) = pipelines.get(&key) {
            return Ok(compiled);
        }
        let compiled = create()?;
        pipelines.insert(key, compiled);
        Ok(compiled)
    }

    /// The keys and handles of all pipelines, in the order of the keys.
    pub(super) fn handles(&self) -> Vec<(Key, vk::Pipeline)> {
        let pipelines = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut all: Vec<_> = pipelines.iter().map(|(key, compiled)| (key.clone(), compiled.handle)).collect();
        all.sort();
        all
    }

    /// Destroys all pipelines.
    ///
    /// # Safety
    /// The pipelines are of `device`, which is done with them, and nobody uses them afterwards.
    pub(super) unsafe fn destroy(&self, device: &ash::Device) {
        for (_, compiled) in self.0.lock().unwrap_or_else(PoisonError::into_inner).drain() {
            // SAFETY: guaranteed by the caller; drained, so each is destroyed once.
            unsafe {
                device.destroy_pipeline(compiled.handle, None);
                device.destroy_pipeline_layout(compiled.layout, None);
                device.destroy_descriptor_set_layout(compiled.set_layout, None);
            }
        }
    }
}

/// A compiled kernel with fixed spec constants.
pub struct Pipeline<K> {
    /// Keeps the device alive, which owns the handles.
    pub(super) gpu: Arc<Gpu>,
    pub(super) handle: vk::Pipeline,
    pub(super) layout: vk::PipelineLayout,
    pub(super) set_layout: vk::DescriptorSetLayout,
    kernel: PhantomData<K>,
}

impl<K: Kernel> Pipeline<K> {
    /// Kernel `K` for `subgroup_size` with the named 32-bit spec constants; compiled unless the device already has it.
    ///
    /// # Errors
    /// A subgroup size that the device does not have, a name that the shader does not declare, more storage buffers than the device lets a kernel use
    /// ([`GpuError::TooManyBindings`]), or the driver refuses the pipeline.
    pub fn new(
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        subgroup_size: u32,
        constants: &[(&str, u32)],
    ) -> Result<Self, GpuError> {
        let named = constants.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        if !gpu.caps().subgroup_sizes().contains(&subgroup_size) {
            let reason = format!("the device has no subgroups of {subgroup_size}");
            return Err(GpuError::Kernel { kernel: K::SHADER.name.into(), reason });
        }
        let required = required_subgroup_size(K::SHADER, gpu.caps().can_require_subgroup_size, subgroup_size);
        let key = (K::SHADER.name, required, named);
        let create = || compile(gpu, cache, K::SHADER, required, constants);
        let Compiled { handle, layout, set_layout } = gpu.pipelines.get_or_create(key, create)?;
        Ok(Self { gpu: gpu.clone(), handle, layout, set_layout, kernel: PhantomData })
    }
}

/// The subgroup size that a pipeline asks for, where the device takes wishes. A kernel without subgroup operations asks for
/// none: drivers then choose what suits its registers best (Intel's spill thousands of them at the largest size).
fn required_subgroup_size(shader: &Shader, can_require: bool, subgroup_size: u32) -> Option<u32> {
    (can_require && shader.uses_subgroups).then_some(subgroup_size)
}

/// Objects that [`compile`] has created so far; destroyed unless they are taken over.
struct Unfinished<'a> {
    device: &'a ash::Device,
    module: vk::ShaderModule,
    layout: vk::PipelineLayout,
    set_layout: vk::DescriptorSetLayout,
}

impl Drop for Unfinished<'_> {
    fn drop(&mut self) {
        // SAFETY: created from this device, and no pipeline in use depends on what is left here; null is ignored.
        unsafe {
            self.device.destroy_shader_module(self.module, None);
            self.device.destroy_pipeline_layout(self.layout, None);
            self.device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

fn compile(
    gpu: &Gpu,
    cache: &PipelineCache,
    shader: &Shader,
    required_subgroup_size: Option<u32>,
    constants: &[(&str, u32)],
) -> Result<Compiled, GpuError> {
    check_bindings(gpu, shader)?;
    let (entries, data) = specialisation(shader, constants)?;
    let words = ash::util::read_spv(&mut std::io::Cursor::new(shader.spirv))
        .map_err(|e| GpuError::Kernel { kernel: shader.name.into(), reason: e.to_string() })?;
    let mut made = Unfinished {
        device: &gpu.device,
        module: vk::ShaderModule::null(),
        layout: vk::PipelineLayout::null(),
        set_layout: create_set_layout(gpu, shader)?,
    };
    made.layout = create_layout(gpu, shader, made.set_layout)?;
    let module_info = vk::ShaderModuleCreateInfo::default().code(&words);
    // SAFETY: words are the SPIR-V that shaderc made; `made` destroys the module, which only pipeline creation needs.
    made.module =
        unsafe { gpu.device.create_shader_module(&module_info, None) }.map_err(GpuError::vulkan(shader.name))?;
    let specialization = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
    let mut required = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default()
        .required_subgroup_size(required_subgroup_size.unwrap_or_default());
    let mut stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .module(made.module)
        .name(c"main")
        .specialization_info(&specialization);
    if shader.uses_subgroups {
        stage = stage.flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS);
    }
    if required_subgroup_size.is_some() {
        stage = stage.push_next(&mut required);
    }
    let flags = match gpu.statistics {
        Some(_) => vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR,
        None => vk::PipelineCreateFlags::empty(),
    };
    let info = [vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(made.layout)];
    // SAFETY: every pointer of `info` lives through the call.
    let created = unsafe { gpu.device.create_compute_pipelines(cache.handle, &info, None) };
    let handle = created.map_err(|(_, e)| e).map_err(GpuError::vulkan(shader.name))?[0];
    gpu.set_name(handle, shader.name);
    let layout = std::mem::replace(&mut made.layout, vk::PipelineLayout::null());
    let set_layout = std::mem::replace(&mut made.set_layout, vk::DescriptorSetLayout::null());
    Ok(Compiled { handle, layout, set_layout })
}

/// Fails if the kernel uses more storage buffers than the device allows. Devices are opened without this check: drawing
/// needs fewer than training, and a pipeline that is never created needs none.
fn check_bindings(gpu: &Gpu, shader: &Shader) -> Result<(), GpuError> {
    let (needed, limit) = (shader.bindings.len() as u32, gpu.caps().max_storage_buffers);
    if needed <= limit {
        return Ok(());
    }
    Err(GpuError::TooManyBindings { kernel: shader.name.into(), needed, limit, device: gpu.caps().name.clone() })
}

fn specialisation(
    shader: &Shader,
    constants: &[(&str, u32)],
) -> Result<(Vec<vk::SpecializationMapEntry>, Vec<u8>), GpuError> {
    let mut entries = Vec::new();
    let mut data = Vec::new();
    for (name, value) in constants {
        let declared = shader.spec_constants.iter().find(|c| c.name == *name).ok_or_else(|| GpuError::Kernel {
            kernel: shader.name.into(),
            reason: format!("has no spec constant {name}"),
        })?;
        entries.push(vk::SpecializationMapEntry { constant_id: declared.id, offset: data.len() as u32, size: 4 });
        data.extend_from_slice(&value.to_ne_bytes());
    }
    Ok((entries, data))
}

fn create_set_layout(gpu: &Gpu, shader: &Shader) -> Result<vk::DescriptorSetLayout, GpuError> {
    let bindings: Vec<_> = shader
        .bindings
        .iter()
        .map(|b| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(b.binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        })
        .collect();
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: the bindings live through the call.
    unsafe { gpu.device.create_descriptor_set_layout(&info, None) }.map_err(GpuError::vulkan(shader.name))
}

fn create_layout(
    gpu: &Gpu,
    shader: &Shader,
    set_layout: vk::DescriptorSetLayout,
) -> Result<vk::PipelineLayout, GpuError> {
    let sets = [set_layout];
    let ranges = [vk::PushConstantRange {
        stage_flags: vk::ShaderStageFlags::COMPUTE,
        offset: 0,
        size: shader.push_constant_bytes,
    }];
    let used = if shader.push_constant_bytes > 0 { &ranges[..] } else { &[] };
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(used);
    // SAFETY: the arrays live through the call.
    unsafe { gpu.device.create_pipeline_layout(&info, None) }.map_err(GpuError::vulkan(shader.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::interface::shaders::{adam, image_loss_rows, radix_sort_scatter, scan_reduce, tile_blend};

    #[test]
    fn only_kernels_with_subgroup_operations_require_a_size() {
        for shader in [&adam::SHADER, &image_loss_rows::SHADER] {
            assert_eq!(required_subgroup_size(shader, true, 32), None, "{}", shader.name);
        }
        for shader in [&tile_blend::SHADER, &scan_reduce::SHADER, &radix_sort_scatter::SHADER] {
            assert_eq!(required_subgroup_size(shader, true, 32), Some(32), "{}", shader.name);
            assert_eq!(required_subgroup_size(shader, false, 32), None, "{}: the device takes no wishes", shader.name);
        }
    }
}
