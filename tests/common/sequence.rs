//! A small animation for the tests of `frames`.

use super::run;
use std::collections::BTreeMap;
use std::path::Path;

/// A folder with a small volume and a scene whose light turns, whose surface of view moves and whose matter fades.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 24 20 16\nencoding: raw\n\n".to_vec();
    let sphere = |x: i32, y: i32, z: i32| 255 - 14 * (((x - 12).pow(2) + (y - 10).pow(2) + (z - 8).pow(2)) as f32).sqrt() as i32;
    for i in 0..24 * 20 * 16 {
        bytes.push(sphere(i % 24, i / 24 % 20, i / 480).clamp(0, 255) as u8);
    }
    std::fs::write(folder.path().join("v.nrrd"), bytes).expect("a volume");
    std::fs::write(folder.path().join("s.toml"), SCENE).expect("a scene");
    folder
}

pub const SCENE: &str = r#"
[volume]
file = "v.nrrd"
[visibility]
method = "sweep"
directions = 32
[image]
width = 32
height = 24
background = [0.2, 0.1, 0]
[light]
constant = [1, 0.9, 0.8]
[animation]
frames = 8
[[animation.keyframe]]
frame = 1
camera.orbit = [0, 0, 1, 0]
light.scale = 1
ease = "smooth"
[[animation.keyframe]]
frame = 9
camera.orbit = [0, 0, 1, 360]
light.scale = 2
[[animation.keyframe]]
frame = 3
ease = "hold"
transfer.points = [[60, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]
[[animation.keyframe]]
frame = 6
transfer.points = [[60, 0.2, 0.5, 1, 0], [200, 0.2, 0.9, 1, 0.2]]
"#;

/// The files of a folder inside `folder`, by name.
pub fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    entries
        .map(|e| e.expect("an entry"))
        .map(|e| (e.file_name().into_string().expect("a name"), std::fs::read(e.path()).expect("a file")))
        .collect()
}

pub fn frames(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    run(folder, &[&["frames", "s.toml"], arguments].concat())
}
