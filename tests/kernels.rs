//! What the build refuses in a kernel, and how it says so. The reflection is the build script's own file.

#[path = "../build/reflect.rs"]
#[allow(dead_code)]
mod reflect;

use std::process::Command;

/// Compiles and reflects a kernel with these declarations; nothing where there is no `glslc`.
fn reflected(declarations: &str, body: &str) -> Option<Result<String, String>> {
    let glslc = std::env::var_os("GLSLC").unwrap_or_else(|| "glslc".into());
    if Command::new(&glslc).arg("--version").output().is_err() {
        println!("skipped: no glslc on the path");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("probe.comp");
    let text = format!("#version 460\nlayout(local_size_x = 8, local_size_y = 2) in;\n{declarations}\nvoid main() {{\n{body}\n}}\n");
    std::fs::write(&source, text).unwrap();
    let target = folder.path().join("probe.spv");
    let output = Command::new(glslc).args(["--target-env=vulkan1.3", "-O0", "-o"]).arg(&target).arg(&source).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = std::fs::read(target).unwrap();
    let words: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Some(reflect::reflect(&source, &words).map(|kernel| kernel.rust(&words[..4])))
}

fn refused(declarations: &str, reason: &str) {
    if let Some(result) = reflected(declarations, "") {
        let error = result.err().unwrap_or_else(|| panic!("accepted: {declarations}"));
        assert!(error.contains(reason), "'{error}' does not say '{reason}'");
    }
}

fn accepted(declarations: &str, wanted: &[&str]) {
    if let Some(result) = reflected(declarations, "") {
        let rust = result.unwrap();
        for text in wanted {
            assert!(rust.contains(text), "no '{text}' in\n{rust}");
        }
    }
}

fn push(fields: &str) -> String {
    format!("layout(push_constant) uniform Params {{ {fields} }};")
}

#[test]
fn push_constants_have_rusts_layout_or_are_refused() {
    accepted(
        &push("vec3 a; float b; uvec2 c; int d[2]; mat4 type;"),
        &[
            "pub a: [f32; 3],",
            "pub b: f32,",
            "pub c: [u32; 2],",
            "pub d: [i32; 2],",
            "pub r#type: [[f32; 4]; 4],",
            "push_bytes: 96,",
            "local_size: [8, 2, 1],",
        ],
    );
    // Hidden padding, and the same said openly.
    refused(&push("float a; vec3 b;"), "'b' starts at byte 16, the fields before it end at 4");
    accepted(&push("float a; float pad[3]; vec3 b;"), &["pub b: [f32; 3],"]);
    refused(&push("vec3 a; vec2 b;"), "'b' starts at byte 16");
    refused(&push("mat3 a;"), "padded columns");
    refused(&push("vec3 a[2];"), "padded elements");
    refused(&push("mat4 a; mat4 b; float c;"), "132 bytes");
    accepted(&push("mat4 a; mat4 b;"), &["push_bytes: 128,"]);
    refused(&push("double a;"), "use float, int or uint");
}

#[test]
fn bindings_say_what_they_do() {
    let buffer = "layout(set = 0, binding = 0) buffer B { float b[]; };";
    refused(buffer, "'b' says neither readonly nor writeonly");
    accepted(&format!("// readwrite: a, b\n{buffer}"), &["pub b: &'a", "Access::ComputeReadWrite"]);
    accepted(&buffer.replace("buffer", "readonly buffer"), &["Access::ComputeRead }"]);
    accepted(&buffer.replace("buffer", "writeonly buffer"), &["Access::ComputeWrite }"]);
    refused("layout(set = 0, binding = 0, r32f) uniform image3D i;", "'i' says neither");
    accepted("layout(set = 0, binding = 0, r32f) uniform readonly image3D i;", &["pub i: crate::vk::Storage<'a>"]);
    accepted("layout(set = 0, binding = 0) uniform writeonly image3D i;", &["Access::ComputeWrite }"]);
    accepted("layout(set = 0, binding = 0) uniform usampler3D i;", &["pub i: crate::vk::Sampled<'a>"]);
    accepted("layout(set = 0, binding = 9) uniform U { vec4 x; vec4 y; } both;", &["pub both: &'a", "BindingKind::UniformBuffer"]);
    refused("layout(set = 0, binding = 0) uniform sampler2D i;", "not a 3-D image");
    refused("layout(set = 1, binding = 0) uniform sampler3D i;", "use set 0");
    refused("layout(set = 0, binding = 0) uniform sampler3D i[2];", "array of bindings");
    refused("layout(set = 0, binding = 0) uniform sampler3D i;\nlayout(set = 0, binding = 0) uniform sampler3D j;", "share binding 0");
}

#[test]
fn specialization_constants_keep_their_defaults() {
    accepted(
        "layout(constant_id = 2) const float SIZE = -1.5;\nlayout(constant_id = 0) const int bias = -3;\nlayout(constant_id = 1) const bool On = true;",
        &["pub size: f32,", "size: f32::from_bits(0xbfc00000)", "bias: -3,", "on: true,", "spec_ids: &[0, 1, 2],"],
    );
}
