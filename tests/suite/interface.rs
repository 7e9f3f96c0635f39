//! A second opinion on the reflected interfaces: spirv-reflect 0.2.3 does not see storage buffers of the StorageBuffer
//! class, nor strides, spec constants or local sizes, and its list of push constants is undefined behaviour (it makes a
//! slice from a null pointer, which debug builds catch). Entry point and stage are what can be compared.

use instgs_vk::gpu::interface::{ALL_SHADERS, MOST_BINDINGS};

/// The module without its "BuiltIn WorkgroupSize" decoration, on which spirv-reflect 0.2.3 fails when the size is a
/// spec constant ("Invalid ID Reference").
fn without_workgroup_size(spirv: &[u8]) -> Vec<u8> {
    let mut words: Vec<u32> = spirv.as_chunks::<4>().0.iter().map(|&w| u32::from_le_bytes(w)).collect();
    const OP_DECORATE: u32 = 71;
    const BUILT_IN: u32 = 11;
    const WORKGROUP_SIZE: u32 = 25;
    let header = 5;
    let mut at = header;
    while at < words.len() {
        let (length, opcode) = ((words[at] >> 16) as usize, words[at] & 0xFFFF);
        if opcode == OP_DECORATE && words[at + 2..at + length] == [BUILT_IN, WORKGROUP_SIZE] {
            words.drain(at..at + length);
        } else {
            at += length;
        }
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// Of the modules that are shipped. It cannot read those with an array whose length is, or follows from, a spec constant,
/// a quarter of them.
#[test]
fn spirv_reflect_agrees_on_the_entry_point() {
    let mut seen = 0;
    for shader in ALL_SHADERS {
        let Ok(module) = spirv_reflect::ShaderModule::load_u8_data(&without_workgroup_size(shader.spirv)) else {
            continue;
        };
        assert_eq!(module.get_entry_point_name(), "main", "{}", shader.name);
        let stage = module.get_shader_stage();
        assert_eq!(stage, spirv_reflect::types::ReflectShaderStageFlags::COMPUTE, "{}", shader.name);
        seen += 1;
    }
    assert!(2 * seen > ALL_SHADERS.len(), "{seen} of {} modules", ALL_SHADERS.len());
}

#[test]
fn bindings_are_dense_and_named_once() {
    for shader in ALL_SHADERS {
        let mut numbers: Vec<u32> = shader.bindings.iter().map(|b| b.binding).collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..numbers.len() as u32).collect::<Vec<_>>(), "{}", shader.name);
        let mut names: Vec<&str> = shader.bindings.iter().map(|b| b.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), shader.bindings.len(), "{}", shader.name);
        assert!(shader.push_constant_bytes <= 128, "{}: 128 bytes are what every device has", shader.name);
    }
}

#[test]
fn the_number_of_buffers_is_the_one_that_is_promised() {
    let promised = format!("training {MOST_BINDINGS};");
    assert!(include_str!("../../src/lib.rs").contains(&promised), "src/lib.rs does not say {promised}");
}
