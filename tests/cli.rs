//! The command as its users meet it: exit codes, sentences, JSON.
#![cfg(feature = "cli")]

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

#[test]
fn wrong_usage_is_2() {
    let f = Folder::new("usage");
    f.volume();
    f.file("s.toml", "[volume]\nfile = 'v.nrrd'\n[transfer]\npoints = [[0, 1, 1, 1, 0], [9, 1, 1, 1, 1]]");
    std::fs::create_dir(f.0.join("d.png")).unwrap();
    f.file("p.hdr", "#?RADIANCE");
    let cases: &[(&[&str], &str)] = &[
        (&[], "a command is missing: demo, info, light, transfer, precompute, render, frames, compare, chart or devices"),
        (&["rendr"], "unrecognized subcommand 'rendr'"),
        (&["render", "v.nrrd"], "--out <FILE>"),
        (&["render", "v.nrrd", "-o", "x.jpg"], "x.jpg: its extension must be .exr or .png"),
        (&["render", "v.nrrd", "-o", "x"], "x: its extension must be .exr or .png"),
        (&["precompute", "v.nrrd", "-o", "x.exr"], "x.exr: its extension must be .nrrd"),
        // The output is looked at before the input.
        (&["render", "missing.nrrd", "-o", "x.gif"], "x.gif: its extension must be"),
        (&["render", "v.nrrd", "-o", "d.png"], "d.png: is a folder; name a file"),
        (&["precompute", "v.nrrd", "-o", "v.nrrd"], "v.nrrd: is an input of this command"),
        (
            &["render", "v.nrrd", "-o", "x.png", "--visibility.ratio", "3"],
            "command line: `visibility.ratio` is 1:3; it must be 1, 2, 4 or 8",
        ),
        (&["render", "s.toml", "-o", "x.png", "--set", "image.width=0"], "command line: `image.width` is 0; it must be 1 to 16384"),
        (&["render", "s.toml", "-o", "x.png", "--image.height", "99999999999"], "command line: `image.height` is 99999999999"),
        (&["render", "s.toml", "-o", "x.png", "--set", "image.with=3"], "`image.with` is unknown; did you mean `image.width`?"),
        (&["render", "s.toml", "-o", "x.png", "--image.with", "3"], "'--image.width'"),
        (&["render", "s.toml", "-o", "x.png", "--set", "image.width"], "--set image.width has no `=`"),
        (&["render", "s.toml", "-o", "x.png", "--camera.up", "[0, 0, 0]"], "`camera.up` is [0, 0, 0]"),
        (&["render", "s.toml", "-o", "x.png", "--nan-as", "nan"], "command line: `volume.nan_as` is nan"),
        (&["devices", "--memory", "12Q"], "the unit 'Q' is unknown; use K, M, G or T"),
        (&["devices", "--threads", "0"], "'--threads <N>'"),
        (&["light", "v.nrrd", "--set", "light.probe=nope.hdr"], "`light.probe` changes nothing in `light`; it uses light.rotate"),
        (&["light", "v.nrrd", "--set", "visibility.ratio=2"], "`visibility.ratio` changes nothing in `light`"),
        (&["light", "v.nrrd", "--set", "light.scales=2"], "`light.scales` is unknown; did you mean `light.scale`?"),
        (&["precompute", "v.nrrd", "-o", "x.nrrd", "--set", "camera.fov=3"], "`camera.fov` changes nothing in a visibility field"),
        (&["info", "v.nrrd", "--image.width", "3"], "`image.width` changes nothing in the description of a volume; it uses volume"),
        (&["info", "p.hdr", "--nan-as", "3"], "`volume.nan_as` changes nothing in the description of a probe"),
        (&["devices", "--nan-as", "3"], "'--nan-as'"),
        (&["light", "v.nrrd", "-o", "x.nrrd"], "x.nrrd: its extension must be .exr or .png"),
    ];
    for (arguments, part) in cases {
        fails(&f, arguments, 2, part);
    }
}

#[test]
fn bad_input_is_3() {
    let f = Folder::new("input");
    f.volume();
    f.file("s.toml", "[volume]\nfile = 'v.nrrd'\n[surface]\niso = 99");
    f.file("gone.toml", "[volume]\nfile = 'gone.nrrd'");
    f.file("key.toml", "[volume]\nfile = 'v.nrrd'\n[camera]\nfovv = 3");
    f.file("light.toml", "[volume]\nfile = 'v.nrrd'\n[light]\nprobe = 'v.nrrd'");
    f.file("look.toml", "[volume]\nfile = 'v.nrrd'\n[camera]\nposition = [1, 1, 1]\ntarget = [1, 1, 1]");
    f.file("syntax.toml", "[volume\n");
    f.file("short.nrrd", "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n\nabc");
    f.file("nonsense.nrrd", "what?");
    let mut nan = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 2 1 1\nencoding: raw\nendian: little\n\n".to_vec();
    nan.extend([1f32, f32::NAN].iter().flat_map(|v| v.to_le_bytes()));
    f.file("nan.nrrd", nan);
    f.file("raw.bin", [0u8; 24]);
    let detached = |data: &str| format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1 1 1\nencoding: raw\ndata file: {data}\n");
    f.file("away.nhdr", detached("/dev/zero"));
    f.file("lost.nhdr", detached("lost.raw"));
    let cases: &[(&[&str], &str)] = &[
        (&["render", "missing.nrrd", "-o", "x.png"], "missing.nrrd: cannot open: no such file; check the path"),
        (&["render", "missing.toml", "-o", "x.png"], "missing.toml: cannot open"),
        (
            &["render", "gone.toml", "-o", "x.png"],
            "gone.nrrd: cannot open: no such file; check the path (paths in a scene are relative to the scene file)",
        ),
        (&["render", "s.toml", "-o", "x.png"], "s.toml line 4: `surface.iso` is 99, outside the data's range 0 to 23; choose a value"),
        (&["render", "v.nrrd", "--surface.iso", "-1", "-o", "x.png"], "command line: `surface.iso` is -1, outside the data's range"),
        (&["render", "key.toml", "-o", "x.png"], "key.toml line 4: `camera.fovv` is unknown; did you mean `camera.fov`?"),
        (&["render", "look.toml", "-o", "x.png"], "look.toml line 4: `camera.position` "),
        (&["render", "syntax.toml", "-o", "x.png"], "syntax.toml: line 1: "),
        (&["render", "light.toml", "-o", "x.png"], "v.nrrd: "),
        (&["render", "v.nrrd", "-o", "no/such/x.png"], "no/such: cannot write into this folder"),
        (&["precompute", "short.nrrd", "-o", "x.nrrd"], "short.nrrd: "),
        (&["info", "nonsense.nrrd"], "nonsense.nrrd: "),
        (&["info", "missing"], "missing: cannot open"),
        (&["info", "."], "none of them DICOM, TIFF or PNG; name a file, or the folder of a series or stack"),
        (&["render", "nan.nrrd", "-o", "x.png"], "all must be finite; --nan-as VALUE (volume.nan_as in a scene) puts a value"),
        (&["info", "raw.bin", "--volume.dims", "[5, 5, 5]", "--volume.type", "uint8"], "raw.bin: "),
        (&["info", "nonsense.nrrd"], "headerless samples where --volume.dims and --volume.type say what they are"),
        (&["info", "away.nhdr"], "it must lie in the header's folder: move it there"),
        (&["info", "lost.nhdr"], "its data file 'lost.raw' is not there"),
        (&["light", "v.nrrd"], "v.nrrd: "),
        (&["light", "missing.hdr"], "missing.hdr: cannot open"),
    ];
    for (arguments, part) in cases {
        fails(&f, arguments, 3, part);
    }
}

#[test]
#[cfg(unix)]
fn only_regular_files_are_read() {
    let f = Folder::new("irregular");
    f.volume();
    for pipe in ["pipe.toml", "pipe.nrrd", "pipe.hdr", "pipe.json"] {
        assert!(Command::new("mkfifo").arg(f.0.join(pipe)).status().unwrap().success());
    }
    std::os::unix::fs::symlink("/dev/zero", f.0.join("zero.toml")).unwrap();
    std::fs::create_dir(f.0.join("folder.toml")).unwrap();
    f.file("light.toml", "volume.file = 'v.nrrd'\nlight.probe = 'pipe.hdr'");
    f.file("volume.toml", "volume.file = 'pipe.nrrd'");
    f.file("preset.toml", "volume.file = 'v.nrrd'\ntransfer.file = 'pipe.json'");
    for (file, part) in [
        ("pipe.toml", "pipe.toml: it is a pipe or a device; a regular file is needed"),
        ("zero.toml", "zero.toml: it is a pipe or a device"),
        ("folder.toml", "folder.toml: it is a folder; name a file"),
        ("light.toml", "pipe.hdr: it is a pipe"),
        ("volume.toml", "pipe.nrrd: it is a pipe"),
        ("preset.toml", "pipe.json: it is a pipe"),
    ] {
        fails(&f, &["info", file], 3, part);
        fails(&f, &["render", file, "-o", "x.png"], 3, part);
    }
    fails(&f, &["info", "pipe.hdr"], 3, "pipe.hdr: it is a pipe");
    fails(&f, &["light", "pipe.hdr"], 3, "pipe.hdr: it is a pipe");
    fails(&f, &["light", "/dev/zero"], 3, "/dev/zero: it is a pipe or a device");
    let long = format!("{}/missing.nrrd", ["d"; 1500].join("/"));
    let out = halflight(&f.0, &["info", &long]);
    assert!(out.stderr.len() < 600 && String::from_utf8_lossy(&out.stderr).contains("/missing.nrrd: cannot open"));
}

#[test]
fn info_describes_volumes_and_scenes() {
    let f = Folder::new("info");
    f.volume();
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let v = json(&["info", "v.nrrd", "--json"]);
    assert_eq!((&v["kind"], &v["volume"]["dims"]), (&"volume".into(), &serde_json::json!([4, 3, 2])));
    assert_eq!(v["volume"]["range"], serde_json::json!([0.0, 23.0]));
    f.file("r.bin", (0..24u8).collect::<Vec<_>>());
    let raw = json(&["--json", "info", "r.bin", "--volume.dims", "[2, 3, 2]", "--set", "volume.type=int16", "--volume.endian=big"]);
    // Big-endian pairs (0, 1), (2, 3), …, (22, 23).
    assert_eq!(raw["volume"]["range"], serde_json::json!([1.0, 22.0 * 256.0 + 23.0]));
    f.file("s.toml", "volume.file = 'v.nrrd'\nvisibility.ratio = 2\ncamera.fov = 50");
    let s = json(&["info", "s.toml", "--camera.fov", "40", "--json"]);
    assert_eq!((&s["kind"], &s["camera"]["fov"]), (&"scene".into(), &serde_json::json!(40.0)));
    assert_eq!((&s["field"]["dims"], &s["given"]["camera.fov"]), (&serde_json::json!([2, 2, 1]), &"command line".into()));
    let text = String::from_utf8(halflight(&f.0, &["info", "v.nrrd"]).stdout).unwrap();
    assert!(text.contains("4x3x2 uint8, 24 B") && text.contains("0 to 23"), "{text}");
    let mut nan = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 2 1 1\nencoding: raw\nendian: little\n\n".to_vec();
    nan.extend([1f32, f32::NAN].iter().flat_map(|v| v.to_le_bytes()));
    f.file("nan.nrrd", nan);
    // Samples that are not finite are counted, and the rest described.
    let v = json(&["info", "nan.nrrd", "--json"]);
    assert_eq!((&v["volume"]["not_finite"], &v["volume"]["range"]), (&1.into(), &serde_json::json!([1.0, 1.0])));
    let text = String::from_utf8(halflight(&f.0, &["info", "nan.nrrd"]).stdout).unwrap();
    assert!(text.contains("1 of 2 samples are NaN or infinite; ") && text.contains("--nan-as VALUE"), "{text}");
    f.file("none.raw", [f32::NAN, f32::INFINITY].map(f32::to_le_bytes).concat());
    let text = halflight(&f.0, &["info", "none.raw", "--volume.dims", "2,1,1", "--volume.type", "float32"]).stdout;
    assert!(String::from_utf8(text).unwrap().contains("none: no sample is finite"));
    // It also says on stderr that samples were replaced.
    let out = halflight(&f.0, &["info", "nan.nrrd", "--nan-as", "-5", "--json"]);
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["volume"]["range"], serde_json::json!([-5.0, 1.0]));
}

#[test]
fn info_describes_fields_and_probes() {
    use halflight::scene::Grid;
    let f = Folder::new("fields");
    let json = |arguments: &[&str]| -> Value {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    // Half of the directions are seen from each of 3x2x1 cells: v₀₀ = √π.
    let v00 = std::f32::consts::PI.sqrt();
    for coefficients in [1, 4, 9, 16] {
        let data: Vec<f32> = (0..6 * coefficients).map(|i| if i % coefficients == 0 { v00 } else { 7.0 }).collect();
        let grid = Grid::axis_aligned([6, 4, 2], [0.5, 1.0, 2.0]).unwrap();
        let meta = [("scene".to_string(), "[volume]\nfile = \"v.nrrd\"".to_string()), ("device".into(), "d".into())];
        halflight::io::write_nrrd_field(&f.0.join("field.nrrd"), [3, 2, 1], coefficients, &data, &grid, &meta).unwrap();
        let v = json(&["info", "field.nrrd", "--json"]);
        assert_eq!((&v["kind"], &v["file"]), (&"field".into(), &"field.nrrd".into()));
        assert_eq!((&v["field"]["dims"], &v["field"]["coefficients"]), (&serde_json::json!([3, 2, 1]), &coefficients.into()));
        assert_eq!(v["field"]["spacing"], serde_json::json!([1.0, 2.0, 4.0]));
        assert!((v["field"]["visible"].as_f64().unwrap() - 0.5).abs() < 1e-6);
        assert_eq!(v["meta"]["scene"], meta[0].1.as_str());
        let text = String::from_utf8(halflight(&f.0, &["info", "field.nrrd"]).stdout).unwrap();
        assert!(text.contains(&format!("3x2x1 cells, {coefficients} coefficients")), "{text}");
        assert!(text.contains("50.00 %") && text.contains("\n  file = \"v.nrrd\"\n") && text.contains("device     d"), "{text}");
    }
    fails(&f, &["info", "field.nrrd", "--volume.nan_as", "3"], 2, "`volume.nan_as` changes nothing in the description of a field");
    let whole = std::fs::read(f.0.join("field.nrrd")).unwrap();
    f.file("field.nrrd", &whole[..whole.len() - 1]);
    fails(&f, &["info", "field.nrrd"], 3, "the file is cut short");
    grey(&f);
    let v = json(&["info", "grey.hdr", "--json"]);
    assert_eq!((&v["kind"], &v["file"], &v["width"]), (&"probe".into(), &"grey.hdr".into(), &8.into()));
    let text = String::from_utf8(halflight(&f.0, &["info", "grey.hdr"]).stdout).unwrap();
    assert!(text.contains("grey.hdr, 8x4 pixels"), "{text}");
}

#[test]
fn light_projects_a_probe() {
    let f = Folder::new("light");
    // 8x4 Radiance pixels of (1, ½, ¼): mantissas 128, 64, 32 at exponent 129 (2^(129−136) = 1/128).
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    hdr.extend([128, 64, 32, 129].repeat(32));
    f.file("grey.hdr", hdr);
    let out = halflight(&f.0, &["light", "grey.hdr", "--json", "--light.scale", "2", "-o", "both.png"]);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    // A constant's only coefficient is 2·L·√(4π), and its radiance is 2·L everywhere.
    let l00 = v["coefficients"][0][0].as_f64().unwrap();
    assert!((l00 / (2.0 * (4.0 * std::f64::consts::PI).sqrt()) - 1.0).abs() < 0.02, "{l00}");
    assert!((v["coefficients"][0][1].as_f64().unwrap() / l00 - 0.5).abs() < 0.02);
    let up = &v["radiance"]["+z"];
    assert!((up["projected"][0].as_f64().unwrap() - up["probe"][0].as_f64().unwrap()).abs() < 0.02);
    assert!(std::fs::metadata(f.0.join("both.png")).unwrap().len() > 100);
    let text = String::from_utf8(halflight(&f.0, &["light", "grey.hdr"]).stdout).unwrap();
    assert!(text.contains("band 0") && text.contains("-z"), "{text}");
}

#[test]
fn no_device_is_4() {
    let f = Folder::new("device");
    f.volume();
    let out = Command::new(env!("CARGO_BIN_EXE_halflight"))
        .current_dir(&f.0)
        .args(["render", "v.nrrd", "-o", "x.png", "--json"])
        .env("VK_DRIVER_FILES", "/nonexistent/icd.json")
        .env("VK_ICD_FILENAMES", "/nonexistent/icd.json")
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(4), "{}", String::from_utf8_lossy(&out.stderr));
    let object: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(object["error"].as_str().unwrap().contains("Vulkan device"), "{object}");
    assert!(!f.0.join("x.png").exists());
}

#[test]
fn demo_without_a_device_leaves_no_folder() {
    let f = Folder::new("nodemo");
    let run = |arguments: &[&str], driver: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
        for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            driver.map(|d| command.env(name, d));
        }
        command.current_dir(&f.0).args(arguments).output().unwrap().status.code()
    };
    assert_eq!(run(&["demo", "-o", "a/b"], Some("/nonexistent/icd.json")), Some(4));
    assert!(names(&f.0).is_empty());
    if device() {
        // Neither does one with too little memory.
        assert_eq!(run(&["demo", "-o", "a/b", "--memory", "1K"], None), Some(5));
        assert!(names(&f.0).is_empty());
        std::fs::create_dir(f.0.join("mine")).unwrap();
        assert_eq!(run(&["demo", "-o", "mine", "--memory", "1K"], None), Some(5));
        assert!(f.0.join("mine").is_dir(), "a folder that was there stays");
    }
}

/// 8x4 grey pixels.
fn grey(f: &Folder) {
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".to_vec();
    hdr.extend([128, 128, 128, 129].repeat(32));
    f.file("grey.hdr", hdr);
}

#[test]
#[cfg(unix)]
fn outputs_go_where_the_user_means() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let f = Folder::new("outputs");
    f.volume();
    grey(&f);
    std::fs::hard_link(f.0.join("v.nrrd"), f.0.join("hard.png")).unwrap();
    std::fs::hard_link(f.0.join("grey.hdr"), f.0.join("grey.png")).unwrap();
    symlink("v.nrrd", f.0.join("soft.png")).unwrap();
    assert!(Command::new("mkfifo").arg(f.0.join("pipe.png")).status().unwrap().success());
    for (arguments, part) in [
        (["render", "v.nrrd", "-o", "hard.png"], "hard.png: is an input of this command"),
        (["render", "v.nrrd", "-o", "soft.png"], "soft.png: is an input of this command"),
        (["light", "grey.hdr", "-o", "grey.png"], "grey.png: is an input of this command"),
        (["render", "v.nrrd", "-o", "o.png/"], "o.png/: is a folder; name a file"),
        (["render", "v.nrrd", "-o", "o.png/."], "o.png/.: is a folder; name a file"),
        (["render", "v.nrrd", "-o", "pipe.png"], "pipe.png: is a pipe or a device; name a regular file"),
        (["render", "v.nrrd", "-o", "v.nrrd/x.png"], "v.nrrd: cannot write into this folder: a part of the path is a file"),
    ] {
        let code = if part.contains("cannot") { 3 } else { 2 };
        fails(&f, &arguments, code, part);
    }
    // A link is written through; what it leads to keeps its permissions.
    std::fs::create_dir(f.0.join("d")).unwrap();
    f.file("d/real.png", "old");
    std::fs::set_permissions(f.0.join("d/real.png"), std::fs::Permissions::from_mode(0o600)).unwrap();
    symlink("d/real.png", f.0.join("link.png")).unwrap();
    assert_eq!(halflight(&f.0, &["light", "grey.hdr", "-o", "link.png"]).status.code(), Some(0));
    let real = std::fs::metadata(f.0.join("d/real.png")).unwrap();
    assert!(real.len() > 100 && real.permissions().mode() & 0o777 == 0o600);
    assert!(f.0.join("link.png").symlink_metadata().unwrap().is_symlink());
    // New files are what the umask leaves; a limit of file sizes is a sentence, not a signal.
    let shell = |script: &str| {
        let script = format!("{script} {} light grey.hdr -o new.exr", env!("CARGO_BIN_EXE_halflight"));
        Command::new("sh").args(["-c", &script]).current_dir(&f.0).output().unwrap()
    };
    let out = shell("ulimit -f 1;");
    if Path::new("/proc/self/limits").exists() {
        let stderr = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(3), "{stderr}");
        assert!(stderr.contains("new.exr: cannot write: it would be larger than files may become here"), "{stderr}");
        assert!(!f.0.join("new.exr").exists());
    }
    for (umask, mode) in [("027", 0o640), ("000", 0o666)] {
        let _ = std::fs::remove_file(f.0.join("new.exr"));
        assert_eq!(shell(&format!("umask {umask};")).status.code(), Some(0));
        assert_eq!(std::fs::metadata(f.0.join("new.exr")).unwrap().permissions().mode() & 0o777, mode);
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_stdout_does_not_hide_what_was_written() {
    let f = Folder::new("full");
    grey(&f);
    for arguments in [&["light", "grey.hdr", "-o", "x.png"][..], &["light", "grey.hdr", "-o", "x.png", "--json"]] {
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let out = Command::new(env!("CARGO_BIN_EXE_halflight")).current_dir(&f.0).args(arguments).stdout(full).output().unwrap();
        let stderr = String::from_utf8(out.stderr).unwrap();
        assert_eq!(out.status.code(), Some(3), "{stderr}");
        assert!(stderr.contains("standard output: cannot write: ") && stderr.contains("; x.png was written all the same"), "{stderr}");
        std::fs::remove_file(f.0.join("x.png")).unwrap();
    }
}

#[test]
fn help_lists_every_key_of_a_scene_with_its_default() {
    let help = String::from_utf8(halflight(Path::new("."), &["frames", "--help"]).stdout).unwrap();
    let flat = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for key in halflight::scene::keys::KEYS {
        assert!(flat.contains(&format!("--{} <", key.name)), "{}", key.name);
        let default = key.default.trim_start_matches('[').trim_end_matches(']').replace(", ", ",");
        assert!(default.is_empty() || flat.replace(", ", ",").contains(&format!("(default: {default}")), "{}", key.name);
    }
    assert!(flat.contains("--camera.up <X,Y,Z> direction that is up in the picture (default: 0,0,1)"), "{flat}");
    let short = String::from_utf8(halflight(Path::new("."), &["render", "-h"]).stdout).unwrap();
    assert!(!short.contains("--camera.up") && short.contains("--help lists all keys"), "{short}");
    let out = halflight(Path::new("."), &["--help"]);
    assert_eq!(out.status.code(), Some(0));
    assert!(String::from_utf8(out.stdout).unwrap().contains("Exit codes"));
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_halflight"))
        .args(["render", "--help"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
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

#[test]
fn render_makes_a_picture_and_says_what_it_took() {
    if !device() {
        return;
    }
    let f = Folder::new("render");
    sphere(&f);
    let run = |arguments: &[&str]| {
        let out = halflight(&f.0, arguments);
        assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    let v: Value = serde_json::from_str(&run(&["render", "scene.toml", "-o", "a.exr", "--json"])).unwrap();
    assert_eq!(v["field"]["dims"], serde_json::json!([8, 6, 4]));
    assert_eq!(v["picture"], serde_json::json!({ "width": 40, "height": 30 }));
    let kernels: Vec<&str> = v["timings"].as_array().unwrap().iter().map(|t| t["kernel"].as_str().unwrap()).collect();
    assert!(["classify", "minify", "hierarchical", "raymarch"].iter().all(|k| kernels.contains(k)), "{kernels:?}");
    assert!(v["memory"]["peak"].as_u64().unwrap() > 0 && v["device"]["name"].is_string() && v["seconds"].is_f64());
    let a = halflight::io::read_picture_exr(&f.0.join("a.exr")).unwrap();
    assert_eq!((a.width, a.height), (40, 30));
    // The sphere is in the middle, the corner is empty; nearly unoccluded, it sends back its albedo's colour.
    let middle = a.rgba[15 * 40 + 20];
    assert!(middle[3] > 0.9 && middle[0] > 0.15 && middle[0] <= 1.01, "{middle:?}");
    assert!((middle[1] / middle[0] - 0.5).abs() < 1e-3 && a.rgba[0] == [0.0; 4], "{middle:?}");
    // An override shows: twice the light, twice the radiance; a background fills what was empty.
    run(&["render", "scene.toml", "-o", "b.exr", "--light.scale", "2", "--image.background", "light"]);
    let b = halflight::io::read_picture_exr(&f.0.join("b.exr")).unwrap();
    assert_eq!(b.rgba[0], [2.0, 2.0, 2.0, 1.0]);
    let expected = 2.0 * middle[0] + (1.0 - middle[3]) * 2.0;
    assert!((b.rgba[15 * 40 + 20][0] - expected).abs() < 0.02 * expected);
    let text = run(&["render", "scene.toml", "-o", "c.png", "--surface.iso", "100", "--surface.shading", "isotropic"]);
    assert!(["device", "16x12x8 uint8", "needs about", "isosurface", "c.png after"].iter().all(|p| text.contains(p)), "{text}");
    assert!(std::fs::metadata(f.0.join("c.png")).unwrap().len() > 100);
}

#[test]
fn precompute_writes_the_field() {
    if !device() {
        return;
    }
    let f = Folder::new("precompute");
    sphere(&f);
    let out = halflight(&f.0, &["precompute", "scene.toml", "-o", "field.nrrd", "--visibility.bands", "3", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", String::from_utf8_lossy(&out.stderr));
    let info: Value = serde_json::from_slice(&halflight(&f.0, &["info", "field.nrrd", "--json"]).stdout).unwrap();
    assert_eq!((&info["kind"], &info["field"]["coefficients"]), (&"field".into(), &9.into()));
    assert!(info["meta"]["scene"].as_str().unwrap().contains("bands = 3"), "{info}");
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert_eq!((field.coefficients, field.grid.dims()), (9, [8, 6, 4]));
    // The corner sees nearly all of the sky: v₀₀ near 2√π. The middle of the sphere sees little of it.
    let most = 2.0 * std::f32::consts::PI.sqrt();
    let middle = field.data[9 * (4 + 8 * (3 + 6 * 2))];
    assert!(field.data[0] > 0.9 * most && field.data[0] <= 1.01 * most && middle < 0.5 * most, "{} {middle}", field.data[0]);
    // Sabotage of the same comparison: without matter the middle sees all.
    let vacuum = ["precompute", "scene.toml", "-o", "field.nrrd", "--transfer.points", "[[0, 1, 1, 1, 0]]", "--visibility.cells", "all"];
    let out = halflight(&f.0, &vacuum);
    assert_eq!(out.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&out.stderr).contains("the picture will be empty"));
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert!(field.data[16 * (4 + 8 * (3 + 6 * 2))] > 0.99 * most);
    // Cells that no renderer reads are zero unless all are asked for.
    assert_eq!(halflight(&f.0, &vacuum[..6]).status.code(), Some(0));
    let field = halflight::io::read_nrrd_field(&f.0.join("field.nrrd"), &Default::default()).unwrap();
    assert!(field.data.iter().all(|&v| v == 0.0));
}

#[test]
fn too_little_memory_is_5_and_an_unknown_device_4() {
    if !device() {
        return;
    }
    let f = Folder::new("memory");
    sphere(&f);
    let out = halflight(&f.0, &["render", "scene.toml", "-o", "x.png", "--memory", "1K"]);
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(5), "{stderr}");
    assert!(
        stderr.contains("the volume of ")
            && stderr.contains("of device memory, 1.0 KiB of 1.0 KiB are free")
            && stderr.contains("resample")
            && !f.0.join("x.png").exists(),
        "{stderr}"
    );
    fails(&f, &["render", "scene.toml", "-o", "x.png", "--device", "no such device"], 4, "no such device");
}
