//! What a kernel binds, takes and can be specialised with, read from its unoptimised SPIR-V, and the Rust that says the same.

use spirq::prelude::*;
use spirq::spirv::{Dim, ExecutionMode};
use spirq::ty::{ScalarType, VectorType};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::Path;

/// Vulkan promises no more room for push constants.
const MAX_PUSH_BYTES: usize = 128;

/// One kernel as its GLSL declares it.
pub struct Kernel {
    name: String,
    bindings: Vec<Binding>,
    params: Vec<Field>,
    spec: Vec<SpecConstant>,
    local_size: [u32; 3],
}

struct Binding {
    name: String,
    number: u32,
    kind: &'static str,
    access: &'static str,
}

struct Field {
    name: String,
    rust: String,
    bytes: usize,
}

struct SpecConstant {
    name: String,
    id: u32,
    rust: &'static str,
    default: u32,
}

/// The module with every OpSpecConstantOp made an OpUndef of the same type and id: spirq would evaluate them, does not know
/// all operations, and nothing that is reflected depends on their values.
fn without_folded_specialization(words: &[u32]) -> Vec<u32> {
    const SPEC_CONSTANT_OP: u32 = 52;
    const UNDEF: u32 = 1;
    let (header, mut rest) = words.split_at(words.len().min(5));
    let mut out = header.to_vec();
    while let [first, ..] = rest {
        let (op, length) = (first & 0xffff, ((first >> 16) as usize).clamp(1, rest.len()));
        if op == SPEC_CONSTANT_OP && length >= 3 {
            out.extend([3 << 16 | UNDEF, rest[1], rest[2]]);
        } else {
            out.extend(&rest[..length]);
        }
        rest = &rest[length..];
    }
    out
}

pub fn reflect(source: &Path, words: &[u32]) -> Result<Kernel, String> {
    let name = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let entry = ReflectConfig::new()
        .spv(without_folded_specialization(words).as_slice())
        .ref_all_rscs(true)
        .reflect()
        .map_err(|e| format!("cannot be reflected: {e}"))?
        .into_iter()
        .next()
        .ok_or("has no entry point")?;
    let read_write = declared_read_write(source)?;
    let defaults = spec_defaults(words);

    let named: Vec<u32> = entry
        .vars
        .iter()
        .filter_map(|v| match v {
            Variable::SpecConstant { name: Some(_), spec_id, .. } => Some(*spec_id),
            _ => None,
        })
        .collect();
    let mut kernel = Kernel { name, bindings: Vec::new(), params: Vec::new(), spec: Vec::new(), local_size: local_size(&entry)? };
    for variable in &entry.vars {
        match variable {
            Variable::Descriptor { name, desc_bind, desc_ty, ty, nbind } => {
                kernel.bindings.push(binding(name.as_deref(), *desc_bind, desc_ty, ty, *nbind, &read_write)?);
            }
            Variable::PushConstant { ty, .. } => kernel.params = params(ty)?,
            // `local_size_y_id` makes constants of its own without a name, of the id that a named one has.
            Variable::SpecConstant { name: None, spec_id, .. } if named.contains(spec_id) => {}
            Variable::SpecConstant { name, spec_id, ty } => {
                let name = name.clone().ok_or_else(|| format!("the specialization constant {spec_id} has no name"))?;
                let rust = match ty {
                    Type::Scalar(ScalarType::Boolean) => "bool",
                    Type::Scalar(ScalarType::Integer { bits: 32, is_signed: true }) => "i32",
                    Type::Scalar(ScalarType::Integer { bits: 32, is_signed: false }) => "u32",
                    Type::Scalar(ScalarType::Float { bits: 32 }) => "f32",
                    other => return Err(format!("the specialization constant '{name}' has type {other}; use int, uint, float or bool")),
                };
                let default = *defaults.get(spec_id).ok_or_else(|| format!("the specialization constant '{name}' has no default"))?;
                kernel.spec.push(SpecConstant { name: name.to_lowercase(), id: *spec_id, rust, default });
            }
            Variable::Input { .. } | Variable::Output { .. } => {}
        }
    }
    kernel.bindings.sort_by_key(|b| b.number);
    kernel.spec.sort_by_key(|s| s.id);
    for pair in kernel.bindings.windows(2) {
        if pair[0].number == pair[1].number {
            return Err(format!("'{}' and '{}' share binding {}; give each its own", pair[0].name, pair[1].name, pair[0].number));
        }
    }
    Ok(kernel)
}

/// Names in lines `// readwrite: a, b` of the kernel and of the files beside it: the author means both.
fn declared_read_write(source: &Path) -> Result<Vec<String>, String> {
    let folder = source.parent().unwrap_or(Path::new("."));
    let shared = std::fs::read_dir(folder).map_err(|e| format!("cannot list {}: {e}", folder.display()))?;
    let mut files: Vec<_> =
        shared.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.extension().is_some_and(|e| e == "glsl")).collect();
    files.push(source.to_owned());
    let mut names = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).map_err(|e| format!("cannot read {}: {e}", file.display()))?;
        for line in text.lines() {
            if let Some(list) = line.trim().strip_prefix("// readwrite:") {
                names.extend(list.split(',').map(|n| n.trim().to_owned()));
            }
        }
    }
    Ok(names)
}

fn binding(
    name: Option<&str>,
    at: DescriptorBinding,
    kind: &DescriptorType,
    ty: &Type,
    count: u32,
    read_write: &[String],
) -> Result<Binding, String> {
    // A block without an instance name is known by its only member.
    let name = match (name, ty) {
        (Some(n), _) if !n.is_empty() => n.to_owned(),
        (_, Type::Struct(s)) if s.members.len() == 1 => s.members[0].name.clone().unwrap_or_default(),
        (_, Type::Struct(s)) => s.name.clone().unwrap_or_default().to_lowercase(),
        _ => String::new(),
    };
    if name.is_empty() {
        return Err(format!("the binding {} has no name", at.bind()));
    }
    if at.set() != 0 {
        return Err(format!("'{name}' is in set {}; use set 0", at.set()));
    }
    if count != 1 {
        return Err(format!("'{name}' is an array of bindings; bind each by its own name"));
    }
    let dim = match ty {
        Type::CombinedImageSampler(t) => Some(t.sampled_image_ty.dim),
        Type::SampledImage(t) => Some(t.dim),
        Type::StorageImage(t) => Some(t.dim),
        _ => None,
    };
    if dim.is_some_and(|d| d != Dim::Dim3D) {
        return Err(format!("'{name}' is not a 3-D image; declare image3D or sampler3D"));
    }
    let declared = |access: &AccessType| match access {
        AccessType::ReadOnly => Ok("ComputeRead"),
        AccessType::WriteOnly => Ok("ComputeWrite"),
        AccessType::ReadWrite if read_write.contains(&name) => Ok("ComputeReadWrite"),
        AccessType::ReadWrite => Err(format!(
            "'{name}' says neither readonly nor writeonly; say one, or, if the kernel does both, add a line `// readwrite: {name}`"
        )),
    };
    let (kind, access) = match kind {
        DescriptorType::StorageBuffer(access) => ("StorageBuffer", declared(access)?),
        DescriptorType::StorageImage(access) => ("StorageImage", declared(access)?),
        DescriptorType::CombinedImageSampler() => ("SampledImage", "ComputeRead"),
        DescriptorType::UniformBuffer() => ("UniformBuffer", "ComputeRead"),
        other => return Err(format!("'{name}' is a {other:?}; use a buffer, an image3D or a sampler3D")),
    };
    Ok(Binding { name, number: at.bind(), kind, access })
}

/// The push-constant block, refused when Rust's packed layout would differ from the GLSL's.
fn params(ty: &Type) -> Result<Vec<Field>, String> {
    let Type::Struct(block) = ty else { return Err(String::from("the push constants are no block")) };
    let mut fields = Vec::new();
    let mut end = 0;
    for member in &block.members {
        let name = member.name.clone().unwrap_or_default();
        let offset = member.offset.ok_or_else(|| format!("the push constant '{name}' has no offset"))?;
        if offset != end {
            return Err(format!(
                "the push constant '{name}' starts at byte {offset}, the fields before it end at {end}; add explicit padding"
            ));
        }
        let (rust, bytes) = field_type(&member.ty).map_err(|e| format!("the push constant '{name}' {e}"))?;
        end += bytes;
        fields.push(Field { name, rust, bytes });
    }
    if end > MAX_PUSH_BYTES {
        return Err(format!("the push constants take {end} bytes, at most {MAX_PUSH_BYTES} are promised; move some to a buffer"));
    }
    Ok(fields)
}

/// Rust's type of a GLSL type, and its bytes, where both have the same layout.
fn field_type(ty: &Type) -> Result<(String, usize), String> {
    match ty {
        Type::Scalar(s) => Ok((scalar(s)?.to_owned(), 4)),
        Type::Vector(VectorType { scalar_ty, nscalar }) => Ok((format!("[{}; {nscalar}]", scalar(scalar_ty)?), 4 * *nscalar as usize)),
        Type::Matrix(m) => {
            let (rows, columns) = (m.vector_ty.nscalar, m.nvector);
            if m.stride != Some(4 * rows as usize) {
                return Err(format!("is a matrix with padded columns ({ty}); use a mat4 or vectors"));
            }
            Ok((format!("[[{}; {rows}]; {columns}]", scalar(&m.vector_ty.scalar_ty)?), (4 * rows * columns) as usize))
        }
        Type::Array(a) => {
            let (element, bytes) = field_type(&a.element_ty)?;
            let count = a.nelement.ok_or("has no fixed length")?;
            if a.stride != Some(bytes) {
                return Err(format!("is an array with padded elements ({ty}); use elements of 4, 8 or 16 bytes"));
            }
            Ok((format!("[{element}; {count}]"), bytes * count as usize))
        }
        other => Err(format!("has type {other}; use float, int, uint, their vectors, or mat4")),
    }
}

fn scalar(ty: &ScalarType) -> Result<&'static str, String> {
    match ty {
        ScalarType::Float { bits: 32 } => Ok("f32"),
        ScalarType::Integer { bits: 32, is_signed: true } => Ok("i32"),
        ScalarType::Integer { bits: 32, is_signed: false } => Ok("u32"),
        other => Err(format!("has components of type {other}; use float, int or uint")),
    }
}

fn local_size(entry: &EntryPoint) -> Result<[u32; 3], String> {
    let mode = entry
        .exec_modes
        .iter()
        .find(|m| matches!(m.exec_mode, ExecutionMode::LocalSize | ExecutionMode::LocalSizeId))
        .ok_or("declares no local size")?;
    let mut size = [1; 3];
    for (slot, constant) in size.iter_mut().zip(&mode.operands) {
        let bytes = constant.value.to_typeless().ok_or("has an unreadable local size")?;
        *slot = u32::from_le_bytes(bytes.get(..4).and_then(|b| b.try_into().ok()).ok_or("has an unreadable local size")?);
    }
    Ok(size)
}

/// Default bits of each specialization constant, by its id. Reflection does not hand them out; the words do.
fn spec_defaults(words: &[u32]) -> HashMap<u32, u32> {
    const OP_SPEC_TRUE: u32 = 48;
    const OP_SPEC_FALSE: u32 = 49;
    const OP_SPEC: u32 = 50;
    const OP_DECORATE: u32 = 71;
    const SPEC_ID: u32 = 1;
    let (mut ids, mut values) = (HashMap::new(), HashMap::new());
    let mut at = 5;
    while at < words.len() {
        let (opcode, length) = (words[at] & 0xffff, (words[at] >> 16).max(1) as usize);
        let operand = |i: usize| words.get(at + i).copied().unwrap_or(0);
        match opcode {
            OP_DECORATE if operand(2) == SPEC_ID => drop(ids.insert(operand(1), operand(3))),
            OP_SPEC_TRUE => drop(values.insert(operand(2), 1)),
            OP_SPEC_FALSE => drop(values.insert(operand(2), 0)),
            OP_SPEC => drop(values.insert(operand(2), operand(3))),
            _ => {}
        }
        at += length;
    }
    ids.into_iter().filter_map(|(result, id)| Some((id, *values.get(&result)?))).collect()
}

impl Kernel {
    /// The module of this kernel.
    pub fn rust(&self, spirv: &[u32]) -> String {
        let mut t = String::new();
        let name = &self.name;
        let push: usize = self.params.iter().map(|f| f.bytes).sum();
        let hidden = if name.starts_with("test_") { "#[doc(hidden)]\n" } else { "" };
        let _ = writeln!(t, "/// Kernel `glsl/{name}.comp`.\n{hidden}pub mod {} {{", ident(name));
        let _ = writeln!(t, "    const SPIRV: &[u32] = &{spirv:?};\n");
        let _ = writeln!(t, "    /// What the GLSL declares.\n    pub const KERNEL: crate::vk::KernelInfo = crate::vk::KernelInfo {{");
        let _ = writeln!(t, "        name: {name:?},\n        spirv: SPIRV,\n        bindings: &[");
        for b in &self.bindings {
            let _ = writeln!(
                t,
                "            crate::vk::BindingInfo {{ name: {:?}, number: {}, kind: crate::vk::BindingKind::{}, access: crate::vk::Access::{} }},",
                b.name, b.number, b.kind, b.access
            );
        }
        let ids: Vec<u32> = self.spec.iter().map(|s| s.id).collect();
        let _ = writeln!(
            t,
            "        ],\n        push_bytes: {push},\n        local_size: {:?},\n        spec_ids: &{ids:?},\n    }};\n",
            self.local_size
        );
        self.params_rust(&mut t);
        self.spec_rust(&mut t);
        self.bindings_rust(&mut t);
        t.push_str("}\n\n");
        t
    }

    fn params_rust(&self, t: &mut String) {
        if self.params.is_empty() {
            t.push_str("    /// The kernel takes no push constants.\n    pub type Params = ();\n\n");
            return;
        }
        t.push_str("    /// Push constants.\n    #[repr(C)]\n    #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]\n    pub struct Params {\n");
        for f in &self.params {
            let _ = writeln!(t, "        /// `{}`\n        pub {}: {},", f.name, ident(&f.name), f.rust);
        }
        t.push_str("    }\n\n");
    }

    fn spec_rust(&self, t: &mut String) {
        if self.spec.is_empty() {
            t.push_str("    /// The kernel has no specialization constants.\n    pub type Spec = ();\n\n");
            return;
        }
        t.push_str(
            "    /// Specialization constants; the defaults are the GLSL's.\n    #[derive(Clone, Copy, Debug)]\n    pub struct Spec {\n",
        );
        for s in &self.spec {
            let _ = writeln!(t, "        /// `constant_id = {}`\n        pub {}: {},", s.id, ident(&s.name), s.rust);
        }
        t.push_str("    }\n\n    #[allow(clippy::derivable_impls)]\n    impl Default for Spec {\n        fn default() -> Self {\n            Self {\n");
        for s in &self.spec {
            let value = match s.rust {
                "bool" => format!("{}", s.default != 0),
                "i32" => format!("{}", s.default as i32),
                "f32" => format!("f32::from_bits({:#x})", s.default),
                _ => format!("{}", s.default),
            };
            let _ = writeln!(t, "                {}: {value},", ident(&s.name));
        }
        t.push_str("            }\n        }\n    }\n\n    impl crate::vk::Specialization for Spec {\n        fn words(&self) -> Vec<u32> {\n            vec![");
        for s in &self.spec {
            let field = ident(&s.name);
            let word = match s.rust {
                "bool" => format!("u32::from(self.{field})"),
                "i32" => format!("self.{field}.cast_unsigned()"),
                "f32" => format!("self.{field}.to_bits()"),
                _ => format!("self.{field}"),
            };
            let _ = write!(t, "{word}, ");
        }
        t.push_str("]\n        }\n    }\n\n");
    }

    fn bindings_rust(&self, t: &mut String) {
        t.push_str("    /// What the kernel binds, by the GLSL's names.\n    #[derive(Clone, Copy)]\n    pub struct Bindings<'a> {\n");
        for b in &self.bindings {
            let ty = match b.kind {
                "StorageImage" => "crate::vk::Storage<'a>",
                "SampledImage" => "crate::vk::Sampled<'a>",
                _ => "&'a crate::vk::Buffer",
            };
            let _ = writeln!(t, "        /// Binding {}: {}, {}.\n        pub {}: {ty},", b.number, b.kind, b.access, ident(&b.name));
        }
        t.push_str("    }\n\n    impl crate::vk::Bindings for Bindings<'_> {\n        const KERNEL: crate::vk::KernelInfo = KERNEL;\n");
        t.push_str("        type Params = Params;\n        type Spec = Spec;\n\n        fn bound(&self) -> Vec<crate::vk::Bound<'_>> {\n            vec![");
        for b in &self.bindings {
            let variant = match b.kind {
                "StorageImage" => "Storage",
                "SampledImage" => "Sampled",
                _ => "Buffer",
            };
            let _ = write!(t, "crate::vk::Bound::{variant}(self.{}), ", ident(&b.name));
        }
        t.push_str("]\n        }\n    }\n");
    }
}

/// A GLSL name that is a Rust keyword gets its raw form.
fn ident(name: &str) -> String {
    const KEYWORDS: [&str; 24] = [
        "as", "box", "dyn", "enum", "extern", "fn", "impl", "in", "let", "loop", "match", "mod", "move", "mut", "priv", "pub", "ref",
        "static", "trait", "type", "unsafe", "use", "where", "yield",
    ];
    if KEYWORDS.contains(&name) { format!("r#{name}") } else { name.to_owned() }
}
