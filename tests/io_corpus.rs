//! What fuzzing begins with (`fuzz/corpus`) opens. With HALFLIGHT_WRITE_CORPUS=1 it is written anew, from the seeds of
//! the mutation test.

mod io_common;
use halflight::io::{ReadOptions, TransferOptions, read_probe, read_transfer, read_volume};
use io_common::{Folder, seeds};
use std::path::Path;

/// A Radiance picture of 8x4 pixels without run lengths.
fn radiance() -> Vec<u8> {
    let pixels: Vec<u8> = (0..32u8).flat_map(|i| [i, 2 * i, 3 * i, 120 + i / 8]).collect();
    [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 4 +X 8\n".to_vec(), pixels].concat()
}

/// The target that a seed is for.
fn target(name: &str) -> &'static str {
    let ends = |e: &str| name.ends_with(e);
    match name {
        _ if ends(".mha") || ends(".mhd") => "metaimage",
        _ if ends(".vti") => "vti",
        _ if ends(".vtk") => "vtk_legacy",
        _ if ends(".dcm") => "dicom",
        _ if ends(".tif") => "tiff",
        _ if ends(".png") => "png",
        "field.nrrd" => "nrrd_field",
        _ if ends(".nrrd") || ends(".nhdr") => "nrrd",
        _ if ends(".json") => "paraview",
        _ if ends(".hdr") => "hdr",
        _ => "nifti",
    }
}

#[test]
fn the_corpus_opens() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let dir = Folder::new();
    let mut all = seeds(&dir);
    all.push(("picture.hdr", radiance()));
    for (name, content) in all {
        let folder = root.join(target(name));
        // Without an extension: the content tells.
        let path = folder.join(name.replace(['/', '.'], "_"));
        if std::env::var_os("HALFLIGHT_WRITE_CORPUS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&path, content).unwrap();
        }
        let content = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!(content.len() < 4096, "{}: a corpus is small", path.display());
        let copy = dir.file(name, &[&content]);
        let opens = match target(name) {
            "hdr" => read_probe(&copy).map(|_| ()),
            "paraview" => read_transfer(&copy, &TransferOptions { name: Some("a".into()), ..TransferOptions::new([0.0, 1.0]) }).map(|_| ()),
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
