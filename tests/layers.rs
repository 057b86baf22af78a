//! Who may use what: each layer of the source names only the layers below it.

use std::path::{Path, PathBuf};

/// Place, and words that its code may not contain; with `::`, a module that it may not name.
const RULES: [(&str, &[&str]); 10] = [
    ("src/scene", &["ash", "unsafe", "vk", "gpu_allocator", "stages", "kernels"]),
    ("src/io", &["ash", "unsafe", "vk", "gpu_allocator", "stages", "kernels"]),
    ("src/stages", &["ash", "unsafe", "gpu_allocator"]),
    ("src/engine", &["ash", "unsafe", "gpu_allocator"]),
    ("src/plan", &["ash", "unsafe", "gpu_allocator"]),
    ("src/measure", &["ash", "unsafe", "gpu_allocator"]),
    ("src/chart", &["ash", "unsafe", "vk", "gpu_allocator"]),
    ("src/cli", &["ash", "unsafe", "vk", "gpu_allocator"]),
    ("src/ffi", &["ash", "vk", "gpu_allocator", "stages", "kernels"]),
    (
        "src/vk",
        &[
            "visibility",
            "opacity",
            "irradiance",
            "radiance",
            "albedo",
            "extinction",
            "transmittance",
            "light",
            "voxel",
            "volume",
            "scene",
            "ray",
            "harmonic",
            "crate::io",
        ],
    ),
];

/// `unsafe` stands here and nowhere else.
const UNSAFE: [&str; 2] = ["src/vk", "src/ffi"];

fn rust_files(place: &Path, found: &mut Vec<PathBuf>) {
    let file = place.with_extension("rs");
    if file.is_file() {
        found.push(file);
    }
    for entry in std::fs::read_dir(place).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Words of the code, comments left out. Names are cut at `_` and lower-cased, so that `light_volume` holds both words.
fn words(text: &str) -> Vec<String> {
    let code = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n");
    let whole = code.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|w| !w.is_empty()).map(str::to_lowercase);
    // The lint that forbids it is named where it is switched on.
    whole.filter(|w| w != "unsafe_code").flat_map(|w| w.split('_').map(str::to_owned).chain([w.clone()]).collect::<Vec<_>>()).collect()
}

fn offences(text: &str, forbidden: &[&str]) -> Vec<String> {
    let words = words(text);
    let found = |f: &&&str| match f.split_once("::") {
        Some((root, module)) => modules(text, root).iter().any(|m| m == module),
        None => words.iter().any(|w| w == **f),
    };
    forbidden.iter().filter(found).map(|f| (*f).to_owned()).collect()
}

/// Modules right below `root` that the code names: `root::a` and `root::{a::b, c}`.
fn modules(text: &str, root: &str) -> Vec<String> {
    let code: String = text.lines().flat_map(|line| line.split("//").next().unwrap_or("").split_whitespace()).collect();
    let name = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = Vec::new();
    for (at, _) in code.match_indices(&format!("{root}::")) {
        let rest = &code[at + root.len() + 2..];
        match rest.strip_prefix('{') {
            // Deeper groups count as well: too many names are no harm.
            Some(group) => found.extend(group.split(';').next().unwrap_or("").split(['{', ',', '}']).map(name)),
            None => found.push(name(rest)),
        }
    }
    found
}

#[test]
fn each_layer_names_only_what_is_below_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut wrong = Vec::new();
    for (place, forbidden) in RULES {
        let mut files = Vec::new();
        rust_files(&root.join(place), &mut files);
        for file in files {
            for word in offences(&std::fs::read_to_string(&file).unwrap(), forbidden) {
                wrong.push(format!("{}: '{word}' has no place in {place}", file.strip_prefix(root).unwrap().display()));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn unsafe_stands_in_its_places_only() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    rust_files(&root.join("src"), &mut files);
    assert!(files.len() > 5);
    for file in files {
        let inside = UNSAFE.iter().any(|place| file.starts_with(root.join(place)) || file == root.join(place).with_extension("rs"));
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(inside || offences(&text, &["unsafe"]).is_empty(), "{}", file.display());
    }
}

#[test]
fn offences_are_seen() {
    assert_eq!(offences("use ash::vk;", &["ash", "vk"]), ["ash", "vk"]);
    assert_eq!(offences("let light_volume = 1; // unsafe", &["light", "unsafe"]), ["light"]);
    assert_eq!(offences("crate::io::write()", &["crate::io"]), ["crate::io"]);
    assert_eq!(offences("use crate::{error::Result, io};", &["crate::io"]), ["crate::io"]);
    assert!(offences("use std::io; Err(crate::Error::Io)", &["crate::io"]).is_empty());
    assert!(offences("flash(lightly) // ash", &["ash", "light"]).is_empty());
}
