//! Pictures through the C interface are those of the command, bit for bit.
#![cfg(feature = "cli")]

use crate::scenes::*;
use crate::{Engine, init};
use halflight::ffi::*;
use halflight::io;
use halflight::scene::{Picture, Probe};
use std::ffi::CString;
use std::path::Path;

const POINTS: [[f64; 5]; 3] = [[30.0, 0.9, 0.4, 0.2, 0.0], [90.0, 0.3, 0.8, 0.5, 0.12], [200.0, 0.8, 0.8, 0.9, 0.5]];

/// Renders with the command: linear pixels.
pub fn by_command(folder: &Path, scene: &str) -> Vec<f32> {
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
        .current_dir(folder)
        .args(["render", "scene.toml", "-o", "out.exr"])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    io::read_picture_exr(&folder.join("out.exr")).unwrap().rgba.into_flattened()
}

#[test]
fn the_same_scene_is_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let n = 20;
    std::fs::write(folder.path().join("v.raw"), ball(n)).unwrap();
    let probe = Probe::two_colored();
    let rgba = probe.pixels().iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    io::write_exr(&folder.path().join("probe.exr"), &Picture { width: probe.width(), height: probe.height(), rgba }, &[]).unwrap();
    let scene = |method: &str, more: &str| {
        format!(
            "[volume]\nfile = \"v.raw\"\ndims = [{n}, {n}, {n}]\ntype = \"uint8\"\nspacing = [0.5, 0.6, 0.7]\n\
             [transfer]\nreference = \"side\"\nkind = \"extinction\"\npoints = {POINTS:?}\n\
             [light]\nprobe = \"probe.exr\"\nrotate = [0.3, 1.0, 0.2, 40]\nscale = 1.3\nbands = 3\nwindow = \"gauss\"\n\
             [visibility]\nmethod = {method}\nratio = 2\ndirections = 40\nbits = 16\n\
             [camera]\nposition = [1.2, -1.4, 0.9]\ntarget = [0.05, 0, 0]\nup = [0.1, 0, 1]\nfov = 35\n\
             [image]\nwidth = 60\nheight = 44\nstep = 0.7\n{more}"
        )
    };

    let engine = Engine::new();
    let data = ball(n);
    let mut volume = std::ptr::null_mut();
    let info = hl_volume_info { spacing: [0.5, 0.6, 0.7], ..volume_info(&data, n) };
    ok!(hl_volume_create(engine.0, &info, &mut volume));
    let mut transfer = std::ptr::null_mut();
    let info = hl_transfer_info { kind: HL_EXTINCTION, reference: HL_PER_SIDE, ..transfer_info(&POINTS) };
    ok!(hl_transfer_create(engine.0, &info, &mut transfer));
    let (mut image, mut light) = (std::ptr::null_mut(), std::ptr::null_mut());
    let path = CString::new(folder.path().join("probe.exr").to_str().unwrap()).unwrap();
    ok!(hl_image_load(engine.0, path.as_ptr(), &mut image));
    let info = hl_light_info {
        kind: HL_LIGHT_PROBE,
        probe: image,
        bands: 3,
        window: HL_WINDOW_GAUSS,
        scale: 1.3,
        axis: [0.3, 1.0, 0.2],
        degrees: 40.0,
        ..init()
    };
    ok!(hl_light_create(engine.0, &info, &mut light));
    let camera =
        hl_camera { position: [1.2, -1.4, 0.9], target: [0.05, 0.0, 0.0], up: [0.1, 0.0, 1.0], fov: 35.0, space: HL_CAMERA_SIDE, ..init() };
    let surface = hl_surface { iso: 100.0, ..init() };
    // A fitted field is a sweep's with a line more.
    let fitted = "\"sweep\"\nfit = 8";
    let methods = [
        (HL_METHOD_SWEEP, "\"sweep\""),
        (HL_METHOD_MARCH, "\"march\""),
        (HL_METHOD_HIERARCHICAL, "\"hierarchical\""),
        (HL_METHOD_SWEEP, fitted),
    ];
    for (method, word) in methods {
        let fit = if word == fitted { 8 } else { 0 };
        for solid in [false, true].into_iter().filter(|solid| fit == 0 || !solid) {
            let surface = if solid { &raw const surface } else { std::ptr::null() };
            let info = hl_precompute_info { volume, transfer, surface, method, ratio: 2, directions: 40, bits: 16, fit, ..init() };
            let field = field(engine.0, &info);
            let view = hl_render_info {
                field,
                light,
                camera: &camera,
                width: 60,
                height: 44,
                step: 0.7,
                background: HL_BACKGROUND_LIGHT,
                ..init()
            };
            let ours = pixels(self::image(engine.0, &view));
            let more = if solid { "background = \"light\"\n[surface]\niso = 100\n" } else { "background = \"light\"\n" };
            let theirs = by_command(folder.path(), &scene(word, more));
            let differ = ours.iter().zip(&theirs).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
            assert!(differ == 0 && ours.len() == theirs.len(), "{word}, surface {solid}: {differ} of {} numbers differ", ours.len());
        }
    }
    // Sabotage: a slightly other light is another picture.
    ok!(hl_light_rotate(light, [0.3, 1.0, 0.2].as_ptr(), 40.5));
    let field = field(engine.0, &hl_precompute_info { volume, transfer, ratio: 2, directions: 40, bits: 16, ..quick(volume) });
    let view =
        hl_render_info { field, light, camera: &camera, width: 60, height: 44, step: 0.7, background: HL_BACKGROUND_LIGHT, ..init() };
    assert_ne!(pixels(self::image(engine.0, &view)), by_command(folder.path(), &scene("\"sweep\"", "background = \"light\"\n")));
}

#[test]
fn fields_go_to_files_and_back() {
    let engine = Engine::new();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| CString::new(folder.path().join(name).to_str().unwrap()).unwrap();
    let volume = volume(engine.0, 20);
    for bits in [8, 16, 32] {
        let info = hl_precompute_info { bits, ratio: 2, ..quick(volume) };
        let field = field(engine.0, &info);
        ok!(hl_field_save(field, path("f.nrrd").as_ptr()));
        let mut again = std::ptr::null_mut();
        ok!(hl_field_load(engine.0, path("f.nrrd").as_ptr(), &hl_precompute_info { volume, ..init() }, &mut again));
        let (mut a, mut b) = (init::<hl_field_info>(), init::<hl_field_info>());
        ok!(hl_field_get_info(field, &mut a));
        ok!(hl_field_get_info(again, &mut b));
        assert_eq!((a.dims, a.bits, a.directions, a.method), (b.dims, b.bits, b.directions, b.method));
        assert_eq!(pixels(image(engine.0, &small(field))), pixels(image(engine.0, &small(again))), "{bits} bits");
    }
    // As the command, only what says what it is.
    let unnamed = field(engine.0, &quick(volume));
    // SAFETY: a field and a path of ours.
    assert_eq!(unsafe { hl_field_save(unnamed, path("f.txt").as_ptr()) }, HL_ERROR_INVALID);
    assert!(crate::last(engine.0).1.contains(".nrrd") && !folder.path().join("f.txt").exists());
    // The command takes what was saved here: the picture is that of the field that it computes itself.
    std::fs::write(folder.path().join("v.raw"), ball(20)).unwrap();
    let saved = field(engine.0, &quick(volume));
    ok!(hl_field_save(saved, path("f.nrrd").as_ptr()));
    let render = |more: &[&str], out: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"));
        command.current_dir(folder.path()).args(["render", "v.raw", "--volume.dims", "[20,20,20]", "--volume.type", "uint8"]);
        command.args(["--visibility.method", "sweep", "--visibility.directions", "32", "--image.width", "40", "--image.height", "30"]);
        command.args(more).args(["-o", out]).output().unwrap()
    };
    for (more, out) in [(&["--field", "f.nrrd"][..], "a.exr"), (&[], "b.exr")] {
        let said = render(more, out);
        assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    }
    let read = |name: &str| io::read_picture_exr(&folder.path().join(name)).unwrap().rgba.into_flattened();
    assert!(read("a.exr") == read("b.exr") && read("a.exr") == pixels(image(engine.0, &small(saved))));
    // Sabotage: not for other matter, nor for another volume; neither there nor here.
    let points = points(true, 0.5);
    let other = transfer(engine.0, &points);
    let said = render(&["--field", "f.nrrd", "--transfer.points", "[[0,1,1,1,0],[255,1,1,1,0.5]]"], "c.exr");
    assert!(!said.status.success() && String::from_utf8_lossy(&said.stderr).contains("another transfer function"), "{said:?}");
    let mut none = std::ptr::null_mut();
    let info = hl_precompute_info { volume, transfer: other, ..init() };
    refused!(HL_ERROR_FORMAT, "another transfer function", hl_field_load(engine.0, path("f.nrrd").as_ptr(), &info, &mut none));
    let mut moved = ball(20);
    moved.rotate_right(1);
    let mut second = std::ptr::null_mut();
    ok!(hl_volume_create(engine.0, &volume_info(&moved, 20), &mut second));
    let info = hl_precompute_info { volume: second, ..init() };
    refused!(HL_ERROR_FORMAT, "another volume", hl_field_load(engine.0, path("f.nrrd").as_ptr(), &info, &mut none));
    let clip = hl_clip { high: [0.5, 1.0, 1.0], ..init() };
    let info = hl_precompute_info { volume, clip: &clip, ..init() };
    refused!(HL_ERROR_FORMAT, "or clipping", hl_field_load(engine.0, path("f.nrrd").as_ptr(), &info, &mut none));
    // The command's own file, and one of another volume.
    let out = std::process::Command::new(env!("CARGO_BIN_EXE_halflight"))
        .current_dir(folder.path())
        .args(["precompute", "v.raw", "--volume.dims", "[20,20,20]", "--volume.type", "uint8", "--visibility.method", "sweep"])
        .args(["--visibility.directions", "32", "-o", "c.nrrd"])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let mut theirs = std::ptr::null_mut();
    ok!(hl_field_load(engine.0, path("c.nrrd").as_ptr(), &hl_precompute_info { volume, ..init() }, &mut theirs));
    assert_eq!(pixels(image(engine.0, &small(theirs))), pixels(image(engine.0, &small(field(engine.0, &quick(volume))))));
    let other = self::volume(engine.0, 24);
    let info = hl_precompute_info { volume: other, ..init() };
    refused!(HL_ERROR_FORMAT, "do not belong to 24x24x24", hl_field_load(engine.0, path("c.nrrd").as_ptr(), &info, &mut theirs));
}
