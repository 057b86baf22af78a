//! What changes in an animation and what must not: fronts that pass, scales of time series, zooms, overrides, headers.
#![cfg(feature = "cli")]

mod common;
use common::run;
use common::sequence::files;
use exr::meta::MetaData;
use exr::meta::attribute::AttributeValue;
use exr::meta::header::LayerAttributes;
use halflight::io::{parse_scene, read_picture_exr};
use halflight::scene::Scene;
use std::path::Path;

const REST: &str = "[visibility]\nmethod = \"sweep\"\ndirections = 16\n[image]\nwidth = 40\nheight = 30\n";

fn write(folder: &Path, name: &str, text: impl AsRef<[u8]>) {
    std::fs::write(folder.join(name), text).expect("written");
}

/// A volume of 12x10x8 samples of `kind` that fall from `hi` in the middle to `lo`.
fn ball(folder: &Path, name: &str, kind: &str, [lo, hi]: [i32; 2]) {
    let mut bytes = format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 12 10 8\nencoding: raw\nendian: little\n\n").into_bytes();
    for i in 0..960i32 {
        let [x, y, z] = [i % 12 - 6, i / 12 % 10 - 5, i / 120 - 4];
        let value = hi - ((hi - lo) * (x * x + y * y + z * z) / 20).min(hi - lo);
        match kind {
            "uchar" => bytes.push(value as u8),
            "short" => bytes.extend((value as i16).to_le_bytes()),
            _ => bytes.extend((value as f32).to_le_bytes()),
        }
    }
    write(folder, name, bytes);
}

/// A series: the first step is below 60, the second about it, the third above.
fn front(kind: &str) -> tempfile::TempDir {
    let here = tempfile::tempdir().expect("a folder");
    for (n, range) in [[0, 20], [0, 100], [70, 100]].into_iter().enumerate() {
        ball(here.path(), &format!("step_{}.nrrd", n + 1), kind, range);
    }
    write(here.path(), "s.toml", format!("[volume]\nfile = \"step_#.nrrd\"\n[surface]\niso = 60\n[animation]\nframes = 3\n{REST}"));
    here
}

fn good(folder: &Path, arguments: &[&str]) -> (String, Vec<String>) {
    let (code, out, err) = run(folder, arguments);
    assert_eq!(code, 0, "{arguments:?}: {err}");
    (out, err.lines().map(str::to_owned).collect())
}

fn rgba(path: &Path) -> Vec<[f32; 4]> {
    read_picture_exr(path).expect("a picture").rgba
}

/// The standard attributes of a picture's header, and its own.
fn header(path: &Path) -> (LayerAttributes, impl Fn(&str) -> String + use<>) {
    let header = MetaData::read_from_file(path, false).expect("a header").headers.remove(0);
    let own = header.own_attributes.clone();
    (header.own_attributes, move |key: &str| {
        let value = own.other.iter().find(|(name, _)| name.to_string() == format!("halflight/{key}")).map(|(_, v)| v);
        let Some(AttributeValue::Text(text)) = value else { panic!("{key}: {value:?}") };
        text.to_string()
    })
}

#[test]
fn a_front_beyond_the_data_is_an_empty_picture_or_the_whole_box() {
    for kind in ["uchar", "short", "float"] {
        let here = front(kind);
        let at = |name: &str| here.path().join(name);
        let all = ["--aov", "depth,normal,irradiance,visibility", "--fields", "fields"];
        let (out, said) = good(here.path(), &[&["frames", "s.toml", "-o", "a/f.#.exr"], &all[..]].concat());
        assert!(out.contains("3 written"), "{out}");
        assert_eq!(said.len(), 2, "{said:?}");
        assert!(said[0].contains("frame 1: `surface.iso` is 60, above the data's range 0 to 20: the picture will be empty"), "{said:?}");
        assert!(said[1].contains("frame 3: `surface.iso` is 60, below the data's range 70 to 100: the whole box is solid"), "{said:?}");
        let of = |n: usize| rgba(&at(&format!("a/f.{n}.exr")));
        assert!(of(1).iter().all(|p| *p == [0.0; 4]));
        // The surface of the smallest value is the box, too: the same pixels, lit the same.
        let sized = ["--visibility.directions", "16", "--image.width", "40", "--image.height", "30", "--visibility.method", "sweep"];
        good(here.path(), &[&["render", "step_3.nrrd", "-o", "box.exr", "--surface.iso", "70"], &sized[..]].concat());
        let (whole, solid) = (rgba(&at("box.exr")), of(3));
        assert!(whole.iter().any(|p| p[0] > 0.0) && whole.iter().filter(|p| p[3] == 1.0).count() > 200);
        let worst = whole.iter().zip(&solid).flat_map(|(a, b)| (0..4).map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{kind}: {worst}");
        // The comparison can fail.
        assert!(of(2) != solid && of(2).iter().any(|p| p[3] == 1.0) && of(2).iter().any(|p| p[3] == 0.0));
        // The same bits alone, whatever was kept; and whole files stay.
        for n in ["1", "3"] {
            let (_, said) = good(here.path(), &[&["frames", "s.toml", "-o", "b/f.#.exr", "--frames", n], &all[..2]].concat());
            assert_eq!(said.len(), 1, "{said:?}");
            let name = format!("f.{n}.exr");
            assert!(files(&at("a"))[&name] == files(&at("b"))[&name], "{kind} {n}");
        }
        let (out, _) = good(here.path(), &[&["frames", "s.toml", "-o", "a/f.#.exr", "--skip-existing"], &all[..]].concat());
        assert!(out.contains("3 were whole already"), "{out}");
        let (out, _) = good(here.path(), &["frames", "s.toml", "-o", "c/f.#.exr", "--estimate"]);
        assert!(out.contains("for 3 frames"), "{out}");
        // A field of no matter, or of nothing but matter, is one; so is a picture by it, and one without.
        for n in ["1", "3"] {
            good(here.path(), &["precompute", "s.toml", "-o", "field.nrrd", "--frame", n, "--measure"]);
            let (_, said) = good(here.path(), &["render", "s.toml", "-o", "r.exr", "--frame", n, "--field", "field.nrrd"]);
            assert!(said.len() == 1 && said[0].contains("`surface.iso` is 60"), "{said:?}");
            assert_eq!(rgba(&at("r.exr")).iter().all(|p| *p == [0.0; 4]), n == "1");
            good(here.path(), &["render", "s.toml", "-o", "r.exr", "--frame", n, "--reference=0.1"]);
            assert_eq!(rgba(&at("r.exr")).iter().all(|p| p[3] == 0.0), n == "1");
        }
    }
}

#[test]
fn a_value_that_moves_may_leave_the_data_and_a_still_one_may_not() {
    let here = tempfile::tempdir().expect("a folder");
    ball(here.path(), "v.nrrd", "uchar", [0, 100]);
    let scene = |keys: &str| format!("[volume]\nfile = \"v.nrrd\"\n[animation]\nframes = 5\n{keys}{REST}");
    let track = |key: &str, a: &str, b: &str| {
        format!("[[animation.keyframe]]\nframe = 1\n{key} = {a}\n[[animation.keyframe]]\nframe = 5\n{key} = {b}\n")
    };
    write(here.path(), "s.toml", scene(&track("surface.iso", "50", "250")));
    let (_, said) = good(here.path(), &["frames", "s.toml", "-o", "f.#.exr"]);
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(said[0].contains("frame 3: `surface.iso` is 150, above"), "{said:?}");
    // One that does not move is a mistake, in an animation, too.
    let (code, _, err) = run(here.path(), &["frames", "s.toml", "-o", "f.#.exr", "--surface.iso", "150", "--frames", "1"]);
    assert!(code == 3 && err.contains("command line: `surface.iso` is 150, outside the data's range 0 to 100; choose"), "{err}");
    let one = ["--animation.keyframe", "[{ frame = 1, surface.iso = 900 }]"];
    let (code, _, err) = run(here.path(), &[&["frames", "s.toml", "-o", "f.#.exr", "--frames", "1"], &one[..]].concat());
    assert!(code == 3 && err.contains("`surface.iso` is 900, outside the data's range 0 to 100; choose"), "{err}");
    // What is wrong between two keyframes is said of both.
    write(here.path(), "s.toml", scene(&track("camera.position", "[3, 0, 0]", "[-3, 0, 0]")));
    let (code, _, err) = run(here.path(), &["frames", "s.toml", "-o", "f.#.exr"]);
    let both = "frame 3 failed: between s.toml line 5, keyframe 1 and s.toml line 8, keyframe 2: `camera.position` [0, 0, 0] is the target";
    assert!(code == 3 && err.contains(both), "{code}: {err}");
}

#[test]
fn a_scale_that_follows_each_file_is_said_once() {
    let here = front("uchar");
    let scale = |arguments: &[&str], scene: &str| {
        write(here.path(), "s.toml", format!("[volume]\nfile = \"step_#.nrrd\"\n[animation]\nframes = 3\n{scene}{REST}"));
        let (_, said) = good(here.path(), &[arguments, &["-o", "f.#.png"]].concat());
        assert!(said.len() < 2, "{said:?}");
        said.join("")
    };
    let preset = r#"[{"ColorSpace":"RGB","Name":"x","Points":[0,0,0.5,0,1,1,0.5,0],"RGBPoints":[0,0,0,0,1,1,1,1]}]"#;
    write(here.path(), "p.json", preset);
    let (frames, one) = (&["frames", "s.toml"][..], &["render", "s.toml", "--frame", "2"][..]);
    for how in [frames, one] {
        let said = scale(how, "");
        assert!(said.contains("follows the data's own range") && said.contains("give transfer.points in data values"), "{said}");
        let said = scale(how, "[transfer]\nfile = \"p.json\"\n");
        assert!(said.contains("give transfer.range = [low, high]"), "{said}");
    }
    for still in ["[transfer]\nfile = \"p.json\"\nrange = [0, 100]\n", "[transfer]\npoints = [[0, 1, 1, 1, 0], [100, 1, 1, 1, 0.5]]\n"] {
        assert_eq!(scale(frames, still), "", "{still}");
    }
    assert_eq!(scale(&["frames", "s.toml", "--volume.number", "2"], ""), "", "one file has one range");
    assert!(!scale(frames, "[surface]\niso = 90\n").contains("follows"), "a ramp is grey all over");
}

#[test]
fn an_override_is_what_is_rendered_and_what_the_header_says() {
    let here = tempfile::tempdir().expect("a folder");
    let at = |name: &str| here.path().join(name);
    ball(here.path(), "v.nrrd", "uchar", [0, 255]);
    let points = "transfer.points = [[60, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]\n";
    let scene = |still: &str, moving: &str| {
        format!(
            "[volume]\nfile = \"v.nrrd\"\n{REST}{still}[animation]\nframes = 3\n[[animation.keyframe]]\nframe = 1\nlight.scale = 1\n\
             camera.orbit = [0, 0, 1, 0]\n{moving}[[animation.keyframe]]\nframe = 3\ncamera.orbit = [0, 0, 1, 90]\n"
        )
    };
    write(here.path(), "s.toml", scene("[camera]\nposition = [1.6, -1.9, 1.1]\n", &format!("camera.fov = 20\n{points}")));
    let given = ["--camera.fov", "40", "--transfer.points", "[[1, 0, 0, 0, 0], [255, 1, 1, 1, 1]]"];
    good(here.path(), &["frames", "s.toml", "-o", "plain/f.#.exr"]);
    good(here.path(), &[&["frames", "s.toml", "-o", "over/f.#.exr"], &given[..]].concat());
    let still = "[camera]\nposition = [1.6, -1.9, 1.1]\nfov = 40\n[transfer]\npoints = [[1, 0, 0, 0, 0], [255, 1, 1, 1, 1]]\n";
    write(here.path(), "t.toml", scene(still, ""));
    good(here.path(), &["frames", "t.toml", "-o", "same/f.#.exr"]);
    assert!(files(&at("over")) == files(&at("same")));
    assert!(files(&at("plain")).iter().all(|(name, bytes)| files(&at("over"))[name] != *bytes));
    let (_, own) = header(&at("over/f.2.exr"));
    let said = parse_scene(&own("scene"), "header", Path::new(""), &[]).expect("a scene");
    assert!(said.animation.is_none() && said.camera.fov_degrees == 40.0);
    good(here.path(), &[&["render", "s.toml", "-o", "r.exr", "--frame", "2"], &given[..]].concat());
    assert!(rgba(&at("r.exr")) == rgba(&at("over/f.2.exr")));
    // A field of the keyframe's points is none of these.
    good(here.path(), &["precompute", "s.toml", "-o", "field.nrrd", "--frame", "1"]);
    good(here.path(), &["render", "s.toml", "-o", "r.exr", "--frame", "1", "--field", "field.nrrd", "--camera.fov", "40"]);
    let (code, _, err) =
        run(here.path(), &[&["render", "s.toml", "-o", "r.exr", "--frame", "1", "--field", "field.nrrd"], &given[..]].concat());
    assert!(code == 3 && err.contains("another transfer function"), "{code} {err}");
}

#[test]
fn a_zoom_zooms_and_its_header_says_from_where() {
    let here = tempfile::tempdir().expect("a folder");
    let at = |name: &str| here.path().join(name);
    ball(here.path(), "v.nrrd", "uchar", [0, 255]);
    let scene = |keys: [&str; 2]| {
        format!(
            "[volume]\nfile = \"v.nrrd\"\n[surface]\niso = 130\n{REST}[animation]\nframes = 5\nrate = 23.976\n\
             [[animation.keyframe]]\nframe = 1\n{}\n[[animation.keyframe]]\nframe = 5\n{}\n",
            keys[0], keys[1]
        )
    };
    write(here.path(), "s.toml", scene(["camera.fov = 60", "camera.fov = 30"]));
    good(here.path(), &["frames", "s.toml", "-o", "a/f.#.exr"]);
    good(here.path(), &["frames", "s.toml", "-o", "b/f.#.exr", "--frames", "5,2"]);
    good(here.path(), &["frames", "s.toml", "-o", "a/f.#.png", "--frames", "5"]);
    let (a, b) = (files(&at("a")), files(&at("b")));
    assert!(b.iter().all(|(name, bytes)| a[name] == *bytes));
    let covered = |name: &str| rgba(&at(name)).iter().filter(|p| p[3] > 0.0).count() as f64;
    let grown = covered("a/f.5.exr") / covered("a/f.1.exr");
    let expected = (30f64.to_radians().tan() / 15f64.to_radians().tan()).powi(2);
    assert!((grown / expected - 1.0).abs() < 0.2, "{grown} for {expected}");
    good(here.path(), &["render", "s.toml", "-o", "r.exr", "--frame", "5"]);
    assert!(rgba(&at("r.exr")) == rgba(&at("a/f.5.exr")));
    // The header's scene, and its camera in any scene of the volume, give the picture again.
    for name in ["a/f.5.exr", "r.exr"] {
        let (standard, own) = header(&at(name));
        let text = own("scene");
        assert!(text.contains("position = [") && !text.contains("[animation]"), "{text}");
        write(here.path(), "again.toml", &text);
        good(here.path(), &["render", "again.toml", "-o", "again.exr"]);
        assert!(rgba(&at("again.exr")) == rgba(&at(name)), "{name}");
        let camera = own("camera");
        write(here.path(), "world.toml", format!("[volume]\nfile = \"v.nrrd\"\n[surface]\niso = 130\n{REST}{camera}"));
        good(here.path(), &["render", "world.toml", "-o", "world.exr"]);
        let (world, there) = (rgba(&at("world.exr")), rgba(&at(name)));
        let off = world.iter().zip(&there).filter(|(a, b)| (0..4).any(|c| (a[c] - b[c]).abs() > 1e-3)).count();
        assert!(off <= 2, "{off} pixels");
        // Rows times the matrix: the camera is the origin, its target straight ahead, up is up and right is right.
        let m = standard.world_to_camera.expect("a matrix");
        let map = |p: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|j| (0..3).map(|i| p[i] * f64::from(m[4 * i + j])).sum::<f64>() + f64::from(m[12 + j]))
        };
        let read: Scene = parse_scene(&format!("[volume]\nfile = \"v\"\n{camera}"), "header", Path::new(""), &[]).expect("a camera");
        let (eye, target) = (read.camera.position.expect("a position"), read.camera.target.expect("a target"));
        let way = (target - eye).length();
        let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-4 * way);
        // 30 degrees from bottom to top at 4:3, as the width of the picture one unit ahead.
        let width = 2.0 * 15f32.to_radians().tan() * 4.0 / 3.0;
        assert!((standard.screen_window_width / width - 1.0).abs() < 1e-6, "{}", standard.screen_window_width);
        assert!(near(map(eye.to_array()), [0.0; 3]) && near(map(target.to_array()), [0.0, 0.0, way]));
        let right = (target - eye).cross(read.camera.up).normalize() * way;
        assert!(near(map((target + right).to_array()), [way, 0.0, way]));
        let above = map((target + read.camera.up).to_array());
        assert!(above[1] > 0.0 && above[0].abs() < 1e-4 * way && m[3] == 0.0 && m[15] == 1.0);
        assert_eq!(standard.frames_per_second, (name == "a/f.5.exr").then_some((2997, 125)));
    }
    // PNG has it as text.
    let png = String::from_utf8_lossy(&a["f.5.png"]).into_owned();
    assert!(png.contains("worldToCamera") && png.contains("[camera]"));
    // An orbit without a zoom is framed as ever.
    write(here.path(), "s.toml", scene(["camera.orbit = [0, 0, 1, 0]", "camera.orbit = [0, 0, 1, 80]"]));
    good(here.path(), &["frames", "s.toml", "-o", "o/f.#.exr", "--frames", "3"]);
    write(here.path(), "t.toml", format!("[volume]\nfile = \"v.nrrd\"\n[surface]\niso = 130\n{REST}[camera]\norbit = [0, 0, 1, 40]\n"));
    good(here.path(), &["render", "t.toml", "-o", "still.exr"]);
    assert!(rgba(&at("still.exr")) == rgba(&at("o/f.3.exr")));
    assert!(!header(&at("o/f.3.exr")).1("scene").contains("position"));
}

#[test]
fn what_clipping_leaves_nothing_of_is_said() {
    let here = tempfile::tempdir().expect("a folder");
    ball(here.path(), "v.nrrd", "uchar", [0, 255]);
    for (plane, empty) in [("[[1, 0, 0, 5]]", true), ("[[1, 0, 0, 0]]", false)] {
        let (_, said) =
            good(here.path(), &["render", "v.nrrd", "-o", "r.exr", "--image.width", "8", "--image.height", "8", "--clip.planes", plane]);
        assert_eq!(said.iter().filter(|l| l.contains("[clip] leaves nothing of the volume")).count(), usize::from(empty), "{said:?}");
        assert_eq!(rgba(&here.path().join("r.exr")).iter().all(|p| p[3] == 0.0), empty);
    }
}
