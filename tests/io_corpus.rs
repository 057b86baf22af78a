//! What fuzzing begins with (`fuzz/corpus`) opens. With HALFLIGHT_WRITE_CORPUS=1 it is written anew, from the seeds of
//! the mutation test.

mod io_common;
use halflight::io::{ReadOptions, TransferOptions, read_probe, read_transfer, read_volume};
use io_common::{Folder, seeds, target, zeros};
use std::path::Path;

const SCENE: &str = r#"[volume]
file = "step_####.vti"
[transfer]
points = [[0, 0.1, 0.2, 0.3, 0.0], [100.5, 1, 1, 1, 0.5]]
[surface]
iso = 42
[clip]
box = [0, 0, 0, 1, 0.5, 1]
planes = [[1, 0, 0, 0.5]]
[light]
constant = [1, 2, 3]
rotate = [0, 0, 2, 90]
[visibility]
method = "sweep"
ratio = 2
[camera]
orbit = [0, 0, 1, 30]
fov = 30
[image]
width = 64
background = "light"
[animation]
frames = 10
[[animation.keyframe]]
frame = 1
camera.orbit = [0, 0, 1, 0]
[[animation.keyframe]]
frame = 10
ease = "smooth"
camera.orbit = [0, 0, 1, 90]
"#;

#[test]
fn the_corpus_opens() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let dir = Folder::new();
    let mut all = seeds(&dir);
    // Inputs of targets that no reader takes as they are.
    let dicom = |name: &str| all.iter().find(|s| s.0 == name).unwrap().1.clone();
    let (first, second) = (dicom("series/a.dcm"), std::fs::read(dir.path("series/other.dcm")).unwrap());
    all.push(("two.series", [&(first.len() as u16).to_be_bytes()[..], &first, &second].concat()));
    all.push(("scene.toml", SCENE.into()));
    for (name, content) in all {
        let target = match name {
            "two.series" => "dicom_series",
            "scene.toml" => "scene",
            _ => target(name),
        };
        let content = if target == "vdb" { zeros::pack(&content) } else { content };
        let folder = root.join(target);
        // Without an extension: the content tells.
        let path = folder.join(name.replace(['/', '.'], "_"));
        if std::env::var_os("HALFLIGHT_WRITE_CORPUS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&path, content).unwrap();
        }
        let content = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!(content.len() < 4096, "{}: a corpus is small", path.display());
        let content = if target == "vdb" { zeros::unpack(&content, 1 << 17) } else { content };
        let copy = dir.file(name, &[&content]);
        let options = TransferOptions { name: Some("a".into()), ..TransferOptions::new([0.0, 1.0]) };
        let opens = match target {
            "hdr" | "exr" => read_probe(&copy).map(|_| ()),
            "dicom_series" => continue,
            "scene" => halflight::io::read_scene(&copy, &[]).map(|_| ()),
            _ if target.starts_with("transfer") => read_transfer(&copy, &options).map(|_| ()),
            "nrrd_field" => halflight::io::read_nrrd_field(&copy, &ReadOptions::default()).map(|_| ()),
            _ => read_volume(&copy, &ReadOptions::default()).map(|_| ()),
        };
        opens.unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
    let targets = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/fuzz_targets");
    for folder in std::fs::read_dir(&root).unwrap() {
        let name = folder.unwrap().file_name().into_string().unwrap();
        assert!(targets.join(format!("{name}.rs")).is_file(), "{name} has a corpus and no target");
    }
}
