//! Compiles every `glsl/*.comp` twice (a debug module to reflect, an optimised one to ship) and writes the Rust side of
//! each shader's interface to `OUT_DIR/interface.rs`: buffer bindings, push constants, shared structs, spec constants,
//! and the comment at the top of the shader as the documentation of its module.
//! The Rust types are generated from the GLSL ones and asserted against the reflected offsets, so a layout mismatch
//! cannot be written; using a field, binding or access that the shader does not declare is a compile error.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use shaderc::{
    CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion, TargetEnv,
};
use spirq::ty::{AccessType, DescriptorType, ScalarType, StructType, Type};
use spirq::var::Variable;

/// Specialisation id of the work-group size: `local_size_x_id` in `glsl/include/common.glsl`.
const LOCAL_SIZE_ID: u32 = 1;

fn main() {
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let out_dir = PathBuf::from(env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=glsl");
    let mut stems: Vec<PathBuf> = fs::read_dir(root.join("glsl"))
        .expect("glsl/ is readable")
        .map(|entry| entry.expect("glsl/ is readable").path())
        .filter(|path| path.extension().is_some_and(|e| e == "comp"))
        .collect();
    stems.sort();

    let compiler = Compiler::new().expect("shaderc starts");
    let mut structs = BTreeMap::new();
    let mut modules = String::new();
    let mut all_shaders = String::new();
    for path in &stems {
        let stem = path.file_stem().and_then(|s| s.to_str()).expect("shader names are UTF-8").to_string();
        let shader = ShaderSource::read(path, &root.join("glsl"));
        let debug = shader.compile(&compiler, OptimizationLevel::Zero);
        let optimised = shader.compile(&compiler, OptimizationLevel::Performance);
        fs::write(out_dir.join(format!("{stem}.spv")), &optimised).expect("OUT_DIR is writable");
        let uses_subgroups = uses_subgroups(&optimised);
        modules.push_str(&shader.rust_module(&stem, &debug, uses_subgroups, &mut structs));
        writeln!(all_shaders, "    &shaders::{stem}::SHADER,").expect("writing to a String");
    }
    let mut out = String::from("/// Structs that shaders share, generated from `glsl/`.\npub mod types {\n");
    for generated in structs.values() {
        out.push_str(&generated.text);
    }
    out.push_str("}\n");
    out.push_str(&constants_module(&root.join("glsl/include")));
    out.push_str("/// One module per shader, named after its file.\npub mod shaders {\n    use super::*;\n");
    out.push_str(&modules);
    out.push_str("}\n");
    writeln!(out, "/// Every shader of the crate, by name.\npub static ALL_SHADERS: &[&Shader] = &[\n{all_shaders}];")
        .expect("writing to a String");
    fs::write(out_dir.join("interface.rs"), out).expect("OUT_DIR is writable");
}

/// A GLSL file and the comments of its declarations, those of included files among them.
struct ShaderSource {
    path: PathBuf,
    include_dir: PathBuf,
    text: String,
    /// Trailing `// comment` of a declaration, by `Block.member` (structs and buffer blocks).
    docs: BTreeMap<String, String>,
}

/// A generated struct with its layout, to compare between shaders.
struct GeneratedStruct {
    layout: String,
    text: String,
}

impl ShaderSource {
    fn read(path: &Path, glsl_dir: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let include_dir = glsl_dir.join("include");
        let mut docs = BTreeMap::new();
        collect_docs(&text, &mut docs);
        if let Ok(entries) = fs::read_dir(&include_dir) {
            for entry in entries.flatten() {
                collect_docs(&fs::read_to_string(entry.path()).unwrap_or_default(), &mut docs);
            }
        }
        Self { path: path.into(), include_dir, text, docs }
    }

    fn compile(&self, compiler: &Compiler, level: OptimizationLevel) -> Vec<u8> {
        let mut options = CompileOptions::new().expect("shaderc gives options");
        options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
        // The first version with subgroup operations; no later feature is used. From 1.4 on, entry points list storage
        // buffers, at which spirv-reflect 0.2.3 (a second opinion in tests/suite/interface.rs) aborts.
        options.set_target_spirv(SpirvVersion::V1_3);
        options.set_optimization_level(level);
        options.set_warnings_as_errors();
        if level == OptimizationLevel::Zero {
            options.set_generate_debug_info();
        }
        let include_dir = self.include_dir.clone();
        options.set_include_callback(move |name, _, _, _| {
            let path = include_dir.join(name);
            let content = fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
        });
        let name = self.path.display().to_string();
        match compiler.compile_into_spirv(&self.text, ShaderKind::Compute, &name, "main", Some(&options)) {
            Ok(artifact) => artifact.as_binary_u8().to_vec(),
            Err(error) => panic!("{error}"),
        }
    }

    /// The leading `//` comment block of the file as documentation of its module; Markdown, so indentation is kept.
    fn header_doc(&self) -> String {
        let lines = self.text.lines().skip_while(|l| l.starts_with("#version"));
        lines.map_while(|l| l.strip_prefix("//")).map(|l| format!("///{}\n", l.trim_end())).collect()
    }

    fn doc(&self, block: &str, member: &str) -> String {
        let text = self.docs.get(&format!("{block}.{member}")).cloned();
        let text =
            text.unwrap_or_else(|| panic!("{}: {block}.{member} needs a trailing // comment", self.path.display()));
        format!("/// {text}")
    }

    /// The generated `pub mod stem { ... }`; shared structs go to `structs`.
    fn rust_module(
        &self,
        stem: &str,
        spirv: &[u8],
        uses_subgroups: bool,
        structs: &mut BTreeMap<String, GeneratedStruct>,
    ) -> String {
        let entry_points = spirq::ReflectConfig::new()
            .spv(spirv.to_vec())
            .ref_all_rscs(true)
            .reflect()
            .unwrap_or_else(|e| panic!("{stem}: {e}"));
        let [entry] = entry_points.as_slice() else { panic!("{stem}: one entry point expected") };
        let mut params = None;
        let mut bindings = BTreeMap::new();
        let mut spec_constants = BTreeMap::new();
        for variable in &entry.vars {
            match variable {
                Variable::Descriptor { desc_bind, desc_ty, ty, .. } => {
                    assert_eq!(desc_bind.set(), 0, "{stem}: only descriptor set 0 is used");
                    let DescriptorType::StorageBuffer(access) = desc_ty else { panic!("{stem}: storage buffers only") };
                    let previous = bindings.insert(desc_bind.bind(), self.binding(stem, access, ty, structs));
                    assert!(previous.is_none(), "{stem}: binding {} is declared twice", desc_bind.bind());
                }
                Variable::PushConstant { ty: Type::Struct(block), .. } => {
                    assert!(
                        size_of_type(&Type::Struct(block.clone())) <= 128,
                        "{stem}: push constants exceed 128 bytes"
                    );
                    params = Some(self.rust_struct("Params", block, "push constants", structs));
                }
                Variable::SpecConstant { name, spec_id, .. } => {
                    // The constant behind local_size_x_id has no name where the shader does not use it by name.
                    let name = match name.as_deref() {
                        Some(name) => name,
                        None if *spec_id == LOCAL_SIZE_ID => "WORKGROUP_SIZE",
                        None => panic!("{stem}: unnamed spec constant {spec_id}"),
                    };
                    spec_constants.insert(*spec_id, name.to_string());
                }
                _ => {}
            }
        }
        let mut out = String::new();
        let kernel = pascal_case(stem);
        let header = self.header_doc();
        assert!(!header.is_empty(), "{stem}: a shader opens with a // comment that says what it does");
        write!(out, "{header}pub mod {stem} {{\n    use super::*;\n").expect("String");
        let params_type = if params.is_some() { "Params" } else { "()" };
        if let Some(generated) = &params {
            out.push_str(&generated.text);
        }
        out.push_str(
            "/// Buffers of this kernel: `&` is only read, `&mut` may be written.\npub struct Bindings<'a> {\n",
        );
        for binding in bindings.values() {
            let reference = if binding.writable { "&'a mut" } else { "&'a" };
            writeln!(out, "{}\npub {}: {reference} Buffer<{}>,", binding.doc, binding.name, binding.element)
                .expect("String");
        }
        out.push_str(
            "}\nimpl BindingSet for Bindings<'_> {\n fn visit(&self, visit: &mut dyn FnMut(BoundBuffer<'_>)) {\n",
        );
        for (number, binding) in &bindings {
            let (name, writable) = (&binding.name, binding.writable);
            writeln!(out, "visit(BoundBuffer::new({number}, {writable}, self.{name}));").expect("String");
        }
        out.push_str("}\n}\n");
        let infos: String = bindings
            .iter()
            .map(|(n, b)| format!("BindingInfo {{ name: {:?}, binding: {n}, writable: {} }},", b.name, b.writable))
            .collect();
        let specs: String =
            spec_constants.iter().map(|(id, name)| format!("SpecConstant {{ name: {name:?}, id: {id} }},")).collect();
        write!(
            out,
            "/// The compiled shader and its interface.\npub static SHADER: Shader = Shader {{ name: {stem:?}, \
             spirv: include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{stem}.spv\")), uses_subgroups: {uses_subgroups}, \
             bindings: &[{infos}], spec_constants: &[{specs}], \
             push_constant_bytes: std::mem::size_of::<{params_type}>() as u32 }};\n\
             /// Kernel marker type.\npub struct {kernel};\n\
             // SAFETY: all of this was reflected from the shader.\n\
             unsafe impl Kernel for {kernel} {{ const SHADER: &'static Shader = &SHADER; type Params = {params_type}; type Bindings<'a> = Bindings<'a>; }}\n}}\n"
        )
        .expect("String");
        out
    }

    fn binding(
        &self,
        stem: &str,
        access: &AccessType,
        ty: &Type,
        structs: &mut BTreeMap<String, GeneratedStruct>,
    ) -> Binding {
        let Type::Struct(block) = ty else { panic!("{stem}: a buffer block expected") };
        let block_name = block.name.clone().unwrap_or_default();
        let [member] = block.members.as_slice() else { panic!("{stem}: buffer {block_name} must have one member") };
        let name = member.name.clone().unwrap_or_else(|| panic!("{stem}: unnamed member in {block_name}"));
        let element = match &member.ty {
            Type::Array(array) => {
                assert!(array.nelement.is_none(), "{stem}: buffer {block_name} must be a runtime array or a struct");
                let element = self.rust_type(&array.element_ty, structs);
                assert_eq!(
                    array.stride,
                    Some(size_of_type(&array.element_ty)),
                    "{stem}: {block_name} is not layout(scalar)"
                );
                element
            }
            other => self.rust_type(other, structs),
        };
        let doc = self.doc(&block_name, &name);
        Binding { name, element, writable: *access != AccessType::ReadOnly, doc }
    }

    fn rust_type(&self, ty: &Type, structs: &mut BTreeMap<String, GeneratedStruct>) -> String {
        match ty {
            Type::Scalar(scalar) => scalar_name(scalar).into(),
            Type::Vector(vector) => format!("[{}; {}]", scalar_name(&vector.scalar_ty), vector.nscalar),
            Type::Array(array) => {
                let count = array.nelement.expect("arrays in structs have a length");
                format!("[{}; {count}]", self.rust_type(&array.element_ty, structs))
            }
            Type::Struct(block) => {
                let name = block.name.clone().expect("structs are named");
                let generated = self.rust_struct(&name, block, &name, structs);
                if let Some(known) = structs.get(&name) {
                    assert_eq!(known.layout, generated.layout, "{name} is declared differently in two shaders");
                } else {
                    structs.insert(name.clone(), generated);
                }
                format!("types::{name}")
            }
            other => panic!("{}: type {other:?} is not used in buffers here", self.path.display()),
        }
    }

    fn rust_struct(
        &self,
        rust_name: &str,
        block: &StructType,
        what: &str,
        structs: &mut BTreeMap<String, GeneratedStruct>,
    ) -> GeneratedStruct {
        let glsl_name = block.name.clone().unwrap_or_default();
        let mut fields = String::new();
        let mut asserts = String::new();
        let mut layout = String::new();
        for member in &block.members {
            let name = member.name.clone().expect("members are named");
            let ty = self.rust_type(&member.ty, structs);
            let offset = member.offset.expect("members have offsets");
            // Structs of structs would need `super::`; inside `types` a plain name is enough.
            let ty = if rust_name == "Params" { ty } else { ty.replace("types::", "") };
            writeln!(fields, "{}\npub {name}: {ty},", self.doc(&glsl_name, &name)).expect("String");
            writeln!(asserts, "const _: () = assert!(std::mem::offset_of!({rust_name}, {name}) == {offset}, \"{rust_name}.{name}: GLSL and Rust offsets differ\");")
                .expect("String");
            writeln!(layout, "{name}:{ty}@{offset}").expect("String");
        }
        let size = size_of_type(&Type::Struct(block.clone()));
        let text = format!(
            "/// {what}: generated from `{glsl_name}`.\n#[repr(C)]\n#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]\n\
             pub struct {rust_name} {{\n{fields}}}\n{asserts}\
             const _: () = assert!(std::mem::size_of::<{rust_name}>() == {size}, \"{rust_name}: GLSL and Rust sizes differ\");\n"
        );
        GeneratedStruct { layout, text }
    }
}

/// True if a module has subgroup operations, built-ins about subgroups, or barriers of a subgroup.
fn uses_subgroups(spirv: &[u8]) -> bool {
    const HEADER_WORDS: usize = 5;
    const OP_CONSTANT: u32 = 43;
    const OP_DECORATE: u32 = 71;
    const BARRIERS: [u32; 2] = [224, 225];
    const DECORATION_BUILT_IN: u32 = 11;
    const SCOPE_SUBGROUP: u32 = 3;
    // OpGroupNonUniformElect to OpGroupNonUniformQuadSwap; OpSubgroupBallotKHR to OpSubgroupReadInvocationKHR.
    let is_operation = |op: u32| (333..=366).contains(&op) || (4421..=4432).contains(&op);
    // SubgroupSize to SubgroupLocalInvocationId; SubgroupEqMask to SubgroupLtMask.
    let is_built_in = |number: u32| (36..=41).contains(&number) || (4416..=4420).contains(&number);
    let words: Vec<u32> = spirv.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let mut subgroup_scopes = Vec::new();
    let mut at = HEADER_WORDS;
    while at < words.len() {
        let (op, length) = (words[at] & 0xffff, (words[at] >> 16).max(1) as usize);
        let operands = &words[at + 1..at + length];
        let found = match (op, operands) {
            (OP_CONSTANT, &[_, id, SCOPE_SUBGROUP]) => {
                subgroup_scopes.push(id);
                false
            }
            (OP_DECORATE, &[_, DECORATION_BUILT_IN, number]) => is_built_in(number),
            // The scope of execution, or of memory.
            (op, &[scope, ..]) if BARRIERS.contains(&op) => subgroup_scopes.contains(&scope),
            (op, _) => is_operation(op),
        };
        if found {
            return true;
        }
        at += length;
    }
    false
}

/// One storage buffer of a shader.
struct Binding {
    name: String,
    element: String,
    writable: bool,
    doc: String,
}

/// `const uint NAME = <number>;  // comment` lines of the headers as Rust constants.
fn constants_module(include_dir: &Path) -> String {
    let mut out =
        String::from("/// Numbers that shaders and host share, generated from `glsl/include/`.\npub mod constants {\n");
    let mut headers: Vec<_> =
        fs::read_dir(include_dir).expect("glsl/include is readable").flatten().map(|e| e.path()).collect();
    headers.sort();
    for header in headers {
        for line in fs::read_to_string(&header).expect("headers are readable").lines() {
            let Some((code, doc)) = line.split_once("//") else { continue };
            let Some(definition) = code.trim().strip_prefix("const uint ") else { continue };
            let Some((name, value)) = definition.trim_end_matches([' ', ';']).split_once(" = ") else { continue };
            let digits = value.strip_prefix("0x").unwrap_or(value);
            if digits.chars().all(|c| c.is_ascii_hexdigit()) {
                writeln!(out, "/// {}\npub const {name}: u32 = {value};", doc.trim()).expect("String");
            }
        }
    }
    out + "}\n"
}

/// Records the trailing comment of every one-line declaration inside `struct X {`, `buffer X {` and `uniform X {`,
/// and of one-line buffer blocks `buffer X { T name[]; };  // comment`.
fn collect_docs(text: &str, docs: &mut BTreeMap<String, String>) {
    let mut block: Option<String> = None;
    for line in text.lines() {
        let (code, comment) = line.split_once("//").map_or((line, ""), |(code, comment)| (code, comment.trim()));
        let code = code.trim();
        if let Some(open) = code.find('{') {
            let words: Vec<&str> = code[..open].split_whitespace().collect();
            let is_block = words.len() >= 2 && ["struct", "buffer", "uniform"].contains(&words[words.len() - 2]);
            let Some(name) = words.last().filter(|_| is_block) else { continue };
            let body = code[open + 1..].trim_end_matches([';', '}', ' ']);
            if body.is_empty() {
                block = Some((*name).to_string());
            } else {
                record_doc(name, body, comment, docs);
            }
        } else if code.starts_with('}') {
            block = None;
        } else if let Some(name) = &block {
            record_doc(name, code.trim_end_matches(';'), comment, docs);
        }
    }
}

fn record_doc(block: &str, declaration: &str, comment: &str, docs: &mut BTreeMap<String, String>) {
    let Some(member) = declaration.split_whitespace().last() else { return };
    let member = member.split('[').next().unwrap_or(member);
    if !comment.is_empty() {
        docs.insert(format!("{block}.{member}"), comment.to_string());
    }
}

fn scalar_name(scalar: &ScalarType) -> &'static str {
    match scalar {
        ScalarType::Integer { bits: 32, is_signed: false } => "u32",
        ScalarType::Integer { bits: 32, is_signed: true } => "i32",
        ScalarType::Integer { bits: 16, is_signed: false } => "u16",
        ScalarType::Float { bits: 32 } => "f32",
        other => panic!("scalar {other:?} is not used in buffers here"),
    }
}

/// Size under `layout(scalar)`: members at their offsets, no tail padding beyond the element alignment (all 4-byte here).
fn size_of_type(ty: &Type) -> usize {
    match ty {
        Type::Scalar(ScalarType::Integer { bits, .. } | ScalarType::Float { bits }) => *bits as usize / 8,
        Type::Vector(vector) => size_of_type(&Type::Scalar(vector.scalar_ty.clone())) * vector.nscalar as usize,
        Type::Array(array) => size_of_type(&array.element_ty) * array.nelement.expect("sized array") as usize,
        Type::Struct(block) => block.members.last().map_or(0, |m| m.offset.expect("offset") + size_of_type(&m.ty)),
        other => panic!("type {other:?} has no scalar-layout size here"),
    }
}

fn pascal_case(stem: &str) -> String {
    let capitalise = |word: &str| word[..1].to_uppercase() + &word[1..];
    stem.split('_').map(capitalise).collect()
}
