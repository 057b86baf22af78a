//! `halflight info` of volumes in several files, of a component, and its plot.

#![cfg(feature = "cli")]

mod common;
mod io_common;
use common::run;
use halflight::io::SampleType;
use io_common::{Folder, dicom_series, png_grey, slice, tiff_pages};

#[test]
fn info_describes_series_stacks_and_components() {
    let dir = Folder::new();
    dicom_series(&dir.path("ct"), |_, _| {});
    std::fs::create_dir(dir.path("stack")).unwrap();
    (0..3).for_each(|z| drop(dir.file(&format!("stack/s_{z}.png"), &[&png_grey(5, 4, false, &slice(SampleType::U8, z))])));
    let rgb = vec![slice(SampleType::U8, 0).iter().flat_map(|&v| [v, 7, 9]).collect::<Vec<u8>>()];
    dir.file("rgb.tif", &[&tiff_pages::<tiff::encoder::colortype::RGB8>(5, 4, &rgb, true)]);
    let info = |arguments: &[&str]| {
        let (code, out, err) = run(dir.path("").as_path(), &[&["info"], arguments].concat());
        assert_eq!(code, 0, "{arguments:?}: {err}");
        out
    };
    let out = info(&["ct"]);
    assert!(out.contains("5x4x3 uint8") && out.contains("spacing    [0.75, 0.5, 2.5]") && out.contains("points = [["), "{out}");
    assert!(info(&["stack/s_#.png", "--volume.spacing", "1,1,4"]).contains("spacing    [1, 1, 4]"));
    assert!(info(&["rgb.tif", "--volume.component", "B"]).contains("range      9 to 9"));
    let json: serde_json::Value = serde_json::from_str(&info(&["stack", "--json", "--plot", "h.svg"])).unwrap();
    assert_eq!(json["volume"]["dims"], serde_json::json!([5, 4, 3]));
    assert!(json["transfer"]["points"].as_array().is_some_and(|p| p.len() > 1));
    assert!(std::fs::read_to_string(dir.path("h.svg")).unwrap().contains("<svg"));
    info(&["stack", "--plot", "h.png"]);
    assert!(std::fs::read(dir.path("h.png")).unwrap().starts_with(b"\x89PNG"));
    // Wrong wishes: usage, named after their key.
    for (arguments, code, says) in [
        (&["rgb.tif"][..], 3, "choose one with volume.component: R, G, B"),
        (&["rgb.tif", "--volume.component", "X"], 2, "`volume.component` 'X' is none of"),
        (&["ct", "--volume.series", "7"], 2, "`volume.series` is '7'"),
        (&["ct", "--plot", "h.bmp"], 2, "must end in .png or .svg"),
    ] {
        let (found, _, err) = run(dir.path("").as_path(), &[&["info"], arguments].concat());
        assert!(found == code && err.contains(says), "{arguments:?}: {found} {err}");
    }
}
