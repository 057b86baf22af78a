//! The headers are written by hand, to be read; here they are compared with the Rust that they describe, as cbindgen reads it:
//! every prototype, every struct's layout, every constant.
#![cfg(feature = "capi")]

use cbindgen::{Config, ItemType, Language, Style};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn headers() -> String {
    ["halflight.h", "halflight_vulkan.h"].map(|name| std::fs::read_to_string(Path::new(ROOT).join("include").join(name)).unwrap()).concat()
}

/// What cbindgen makes of some items of src/ffi, names prefixed.
fn generated(items: &[ItemType], prefix: &str) -> String {
    let mut config = Config { language: Language::C, style: Style::Both, no_includes: true, ..Config::default() };
    config.export.item_types = items.to_vec();
    // Nothing but a pointer to void leads to these.
    config.export.include = ["hl_header", "hl_vulkan_device", "hl_vulkan_image", "hl_vulkan_buffer"].map(String::from).to_vec();
    config.export.prefix = (!prefix.is_empty()).then(|| prefix.to_owned());
    let mut builder = cbindgen::Builder::new().with_config(config);
    let mut files: Vec<PathBuf> = std::fs::read_dir(Path::new(ROOT).join("src/ffi")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for file in files.iter().filter(|f| f.file_name().is_some_and(|n| n != "mod.rs")) {
        builder = builder.with_src(file);
    }
    let mut text = Vec::new();
    builder.generate().expect("cbindgen").write(&mut text);
    String::from_utf8(text).unwrap()
}

/// Struct → members, of C text with one member a line or several (`double a, b;`).
fn structs(text: &str) -> BTreeMap<String, Vec<String>> {
    let mut all = BTreeMap::new();
    let text = without_comments(text);
    for part in text.split("typedef struct").skip(1) {
        let Some((head, rest)) = part.split_once('{') else { continue };
        if head.contains(';') {
            continue;
        }
        let (body, _) = rest.split_once('}').expect("a closed struct");
        let members = body.split(';').filter(|m| !m.trim().is_empty()).flat_map(|m| {
            m.split(',').map(|one| {
                let name = one.split('[').next().unwrap_or("").trim();
                name.rsplit([' ', '*']).next().unwrap_or("").to_owned()
            })
        });
        all.insert(head.trim().to_owned(), members.collect());
    }
    all
}

fn without_comments(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((code, after)) = rest.split_once("/*") {
        out += code;
        rest = after.split_once("*/").map_or("", |(_, rest)| rest);
    }
    out + rest
}

/// Names of the object-like macros.
fn constants(text: &str, prefix: &str) -> BTreeSet<String> {
    let defines = without_comments(text).lines().filter_map(|l| l.strip_prefix("#define ").map(str::to_owned)).collect::<Vec<_>>();
    let names = defines.iter().filter_map(|l| l.split_whitespace().next()).filter(|n| !n.contains('(') && !n.ends_with("_H"));
    names.filter_map(|n| n.strip_prefix(prefix)).map(str::to_owned).collect()
}

/// Compiles C text beside the headers; what the compiler says against it.
fn compile(text: &str) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("check.c");
    std::fs::write(&file, format!("#include <halflight_vulkan.h>\n#include <stddef.h>\n{text}\n")).unwrap();
    let out = Command::new("cc")
        // Rust has no arrays as arguments: `const double axis[3]` is a pointer there.
        .args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-array-parameter", "-fsyntax-only", "-I"])
        .arg(Path::new(ROOT).join("include"))
        .arg(&file)
        .output()
        .expect("a C compiler (Debian: build-essential)");
    if out.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&out.stderr).into_owned()) }
}

#[test]
fn prototypes_are_those_of_the_rust() {
    let prototypes = generated(&[ItemType::Functions], "");
    // A second declaration of another type is an error in C.
    compile(&prototypes).unwrap_or_else(|e| panic!("{e}"));
    let names = |text: &str| -> BTreeSet<String> {
        let words = without_comments(text);
        let called = words.split('(').filter_map(|w| w.rsplit([' ', '*', '\n']).next());
        called.filter(|w| w.starts_with("hl_") && !w.contains(')')).map(str::to_owned).collect()
    };
    let exported: BTreeSet<String> = include_str!("ffi/symbols.txt").lines().map(str::to_owned).collect();
    assert_eq!(names(&prototypes), exported);
    assert_eq!(names(&headers()), exported);
    // Sabotage: a changed argument is seen.
    let wrong = prototypes.replacen("uint32_t", "int32_t", 1);
    assert!(wrong != prototypes && compile(&wrong).is_err_and(|e| e.contains("conflicting types")));
}

#[test]
fn structs_lie_as_in_the_rust() {
    let text = generated(&[ItemType::Structs, ItemType::Typedefs, ItemType::OpaqueItems], "cb_");
    let (theirs, ours) = (structs(&text), structs(&headers()));
    let named: BTreeMap<String, Vec<String>> = theirs
        .into_iter()
        .filter(|(_, members)| members.iter().all(|m| !m.is_empty()) && members != &["_private"])
        .map(|(name, members)| (name.trim_start_matches("cb_").to_owned(), members))
        .collect();
    assert_eq!(named, ours);
    assert!(named.len() > 15);
    // Handles point to nothing, which C has no word for.
    let mut checks = text.replace("_private[0]", "_private[1]");
    let mut count = 0;
    let mut same = |a: String, b: String| {
        count += 1;
        writeln!(checks, "typedef char check_{count}[({a} == {b}) ? 1 : -1];").unwrap();
    };
    for (name, members) in &named {
        same(format!("sizeof({name})"), format!("sizeof(cb_{name})"));
        for member in members {
            same(format!("offsetof({name}, {member})"), format!("offsetof(cb_{name}, {member})"));
            same(format!("sizeof((({name} *)0)->{member})"), format!("sizeof(((cb_{name} *)0)->{member})"));
        }
        // Nothing hidden between the members: what C calls their size is all there is.
        let sum: Vec<String> = members.iter().map(|m| format!("sizeof((({name} *)0)->{m})")).collect();
        same(format!("sizeof({name})"), sum.join(" + "));
    }
    compile(&checks).unwrap_or_else(|e| panic!("{e}"));
    // Sabotage: a member moved is seen.
    let wrong = checks.replacen("uint64_t memory;", "uint32_t memory;", 1);
    assert!(wrong != checks && compile(&wrong).is_err());
}

#[test]
fn constants_are_those_of_the_rust() {
    let text = generated(&[ItemType::Constants], "cb_");
    let (theirs, ours) = (constants(&text, "cb_"), constants(&headers(), ""));
    // Of the crate itself, not of the interface.
    let theirs: BTreeSet<String> = theirs.into_iter().filter(|n| n.starts_with("HL_")).collect();
    assert_eq!(theirs, ours);
    let check = |text: &str| {
        let lines: Vec<String> = ours.iter().map(|n| format!("typedef char check_{n}[({n} == cb_{n}) ? 1 : -1];")).collect();
        compile(&format!("{text}\n{}", lines.join("\n")))
    };
    check(&text).unwrap_or_else(|e| panic!("{e}"));
    assert!(check(&text.replace("cb_HL_ERROR_BUSY -3", "cb_HL_ERROR_BUSY -4")).is_err());
}
