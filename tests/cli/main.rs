//! The command as its users meet it: exit codes, sentences, JSON.
#![cfg(feature = "cli")]

mod describes;
mod outputs;
mod usage;
mod work;

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A folder of this test's own, gone at the end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("halflight-cli-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.0.join(name), content).unwrap();
        self.0.join(name)
    }

    /// A 4x3x2 volume, sample = index.
    fn volume(&self) -> PathBuf {
        let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n\n".to_vec();
        bytes.extend(0..24u8);
        self.file("v.nrrd", bytes)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn halflight(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_halflight")).current_dir(folder).args(arguments).env_remove("RUST_LOG").output().unwrap()
}

/// Runs and expects `code` and one sentence on stderr with `part` in it; stdout stays empty. Nothing is left behind.
fn fails(folder: &Folder, arguments: &[&str], code: i32, part: &str) {
    let before = names(&folder.0);
    let out = halflight(&folder.0, arguments);
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(code), "{arguments:?}: {stderr}");
    assert!(stderr.starts_with("halflight: ") && stderr.contains(part), "{arguments:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
    assert!(out.stdout.is_empty(), "{arguments:?}");
    assert_eq!(names(&folder.0), before, "{arguments:?} left something behind");
    // The same as JSON: one object, the same sentence and code.
    let mut arguments = arguments.to_vec();
    arguments.push("--json");
    let out = halflight(&folder.0, &arguments);
    let object: Value = serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{arguments:?}: {e}"));
    assert_eq!(object["code"], code);
    assert_eq!(format!("halflight: {}", object["error"].as_str().unwrap()), stderr.trim_end());
}

fn names(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    names
}

/// 8x4 grey pixels.
fn grey(f: &Folder) {
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    hdr.extend([128, 128, 128, 129].repeat(32));
    f.file("grey.hdr", hdr);
}

/// Whether this machine has a device; says so where it has none.
fn device() -> bool {
    let found = halflight(Path::new("."), &["devices"]).status.code() == Some(0);
    if !found {
        println!("skipped: no Vulkan device here");
    }
    found
}

/// A scene of a 16x12x8 volume: a dense sphere, seen small.
fn sphere(f: &Folder) {
    let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 12 8\nencoding: raw\n\n".to_vec();
    for i in 0..16 * 12 * 8 {
        let (x, y, z) = (f64::from(i % 16) - 7.5, f64::from(i / 16 % 12) - 5.5, f64::from(i / 192) - 3.5);
        bytes.push((200.0 * (3.5 - (x * x + y * y + z * z).sqrt()).clamp(0.0, 1.0)) as u8);
    }
    f.file("sphere.nrrd", bytes);
    f.file(
        "scene.toml",
        "volume.file = 'sphere.nrrd'\nvisibility.ratio = 2\nvisibility.directions = 32\nimage.width = 40\nimage.height = 30\n\
         transfer.points = [[50, 1, 0.5, 0.25, 0], [150, 1, 0.5, 0.25, 0.9]]",
    );
}
