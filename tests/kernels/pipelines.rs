//! Which pipelines are compiled, and what they require.

use std::collections::BTreeSet;

use instgs_vk::gpu::interface::ALL_SHADERS;
use instgs_vk::gpu::{Gpu, GpuOptions, PipelineCache};
use instgs_vk::kernels::{Variant, compile_every_pipeline};

use crate::common::gpu::{assert_silent, gpu};

/// SwiftShader binds no more in a stage, Metal 31. Most test runs are on drivers that bind far more, and would not notice.
#[test]
fn no_kernel_needs_more_than_30_storage_buffers() {
    for shader in ALL_SHADERS {
        let needed = shader.bindings.len();
        assert!(needed <= 30, "{} needs {needed}", shader.name);
    }
}

#[test]
fn every_kernel_is_compiled_and_only_those_with_subgroups_require_a_size() {
    let Some(shared) = gpu() else { return };
    let device = shared.caps().name.parse().unwrap();
    // One of its own, which no other test has pipelines on.
    let gpu = Gpu::open(&GpuOptions { device, validation: true, ..Default::default() }).unwrap();
    let variant = Variant::for_device(gpu.caps());
    compile_every_pipeline(&gpu, &PipelineCache::new(&gpu, None).unwrap(), variant).unwrap();
    let compiled = gpu.compiled_pipelines().unwrap();
    let names: BTreeSet<&str> = compiled.iter().map(|p| p.kernel).collect();
    assert_eq!(names, ALL_SHADERS.iter().map(|s| s.name).collect::<BTreeSet<_>>());
    let requires = gpu.caps().can_require_subgroup_size.then_some(variant.subgroup_size);
    for pipeline in &compiled {
        let shader = ALL_SHADERS.iter().find(|s| s.name == pipeline.kernel).unwrap();
        let wanted = requires.filter(|_| shader.uses_subgroups);
        assert_eq!(pipeline.required_subgroup_size, wanted, "{}", pipeline.kernel);
        assert!(pipeline.executables.is_empty(), "the device was not asked for statistics");
    }
    assert_silent(&gpu);
}
