//! What is refused, with its exit code and sentence; what the help says.

use super::*;

#[test]
fn wrong_usage_is_2() {
    let f = Folder::new("usage");
    f.volume();
    f.file("s.toml", "[volume]\nfile = 'v.nrrd'\n[transfer]\npoints = [[0, 1, 1, 1, 0], [9, 1, 1, 1, 1]]");
    f.file("a.toml", "[volume]\nfile = 'v.nrrd'\n[animation]\nframes = 12");
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
        (&["chart", "-o", "x", "--memory", "12Q"], "the unit 'Q' is unknown; use K, M, G or T"),
        (&["--threads", "0", "demo"], "'--threads <N>'"),
        (&["light", "v.nrrd", "--set", "light.probe=nope.hdr"], "`light.probe` changes nothing in `light`; it uses light.rotate"),
        (&["light", "v.nrrd", "--set", "visibility.ratio=2"], "`visibility.ratio` changes nothing in `light`"),
        (&["light", "v.nrrd", "--set", "light.scales=2"], "`light.scales` is unknown; did you mean `light.scale`?"),
        (&["precompute", "v.nrrd", "-o", "x.nrrd", "--set", "camera.fov=3"], "`camera.fov` changes nothing in a visibility field"),
        (&["render", "v.nrrd", "-o", "x.png", "--set", "animation.frames=3"], "`animation.frames` changes nothing in a single picture"),
        (
            &["render", "v.nrrd", "-o", "x.png", "--reference", "--visibility.ratio", "2"],
            "`visibility.ratio` changes nothing in a reference",
        ),
        (&["info", "v.nrrd", "--image.width", "3"], "`image.width` changes nothing in the description of a volume; it uses volume"),
        (&["info", "p.hdr", "--nan-as", "3"], "`volume.nan_as` changes nothing in the description of a probe"),
        (&["devices", "--nan-as", "3"], "'--nan-as'"),
        // What opens no device has no use for its options.
        (&["compare", "a.png", "b.png", "--threads", "2"], "unexpected argument '--threads'"),
        (&["info", "v.nrrd", "--device", "0"], "unexpected argument '--device'"),
        (&["light", "p.hdr", "--validate"], "unexpected argument '--validate'"),
        (&["devices", "--validate"], "unexpected argument '--validate'"),
        (&["transfer", "p.json", "--memory", "1G"], "unexpected argument '--memory'"),
        (&["--memory", "1G", "info", "v.nrrd"], "--memory changes nothing in `info`, which opens no device; drop it"),
        (&["--validate", "devices"], "--validate changes nothing in `devices`"),
        (&["light", "v.nrrd", "-o", "x.nrrd"], "x.nrrd: its extension must be .exr or .png"),
        (&["render", "v.nrrd", "-o", "x.png", "--aov", "depth"], "x.png: only an .exr holds the layers of --aov"),
        (&["render", "v.nrrd", "-o", "x.png", "--exr-type", "half"], "x.png: only an .exr has the types of --exr-type"),
        (&["render", "v.nrrd", "-o", "x.exr", "--aov", "dept"], "'dept'"),
        (&["render", "v.nrrd", "-o", "x.exr", "--reference", "--aov", "depth"], "cannot be used with '--aov"),
        (&["render", "v.nrrd", "-o", "x.exr", "--reference", "--exr-type", "half"], "cannot be used with '--exr-type"),
        (&["render", "v.nrrd", "-o", "x.exr", "--reference", "--field", "f.nrrd"], "cannot be used with '--field"),
        (&["render", "v.nrrd", "-o", "x.exr", "--reference", "--samples", "31"], "31 is not in 32..=16777216"),
        (&["render", "v.nrrd", "-o", "x.exr", "--frame", "1"], "--frame: the scene has no [animation]"),
        (
            &["render", "a.toml", "-o", "x.exr", "--frame", "13"],
            "frame 13 lies outside the animation, which has 1 to 12; change animation.frames or --frame",
        ),
        (&["render", "a.toml", "-o", "x.exr", "--frame=-3"], "frame -3 lies outside the animation"),
        (&["precompute", "a.toml", "-o", "x.nrrd", "--frame", "99"], "frame 99 lies outside the animation"),
        (
            &["frames", "a.toml", "-o", "f.#.exr", "--frames", "12,13"],
            "frame 13 lies outside the animation, which has 1 to 12; change animation.frames or --frames",
        ),
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
fn what_paths_are_relative_to_is_said_of_those_in_a_scene() {
    let f = Folder::new("relative");
    f.volume();
    f.file("volume.toml", "[volume]\nfile = 'gone.nrrd'");
    f.file("light.toml", "[volume]\nfile = 'v.nrrd'\n[light]\nprobe = 'gone.hdr'");
    f.file("preset.toml", "[volume]\nfile = 'v.nrrd'\n[transfer]\nfile = 'gone.json'");
    f.file("frames.toml", "[volume]\nfile = 'v.nrrd'\n[light]\nprobe = 'gone.hdr'\n[animation]\nframes = 1");
    const HINT: &str = "no such file; check the path (paths in a scene are relative to the scene file)\n";
    const PLAIN: &str = "no such file; check the path\n";
    let cases: [(&[&str], &str); 12] = [
        (&["render", "volume.toml", "-o", "x.png"], HINT),
        (&["info", "light.toml"], HINT),
        (&["info", "preset.toml"], HINT),
        (&["frames", "frames.toml", "-o", "x.png"], HINT),
        (&["render", "volume.toml", "-o", "x.png", "--volume.file", "none.nrrd"], PLAIN),
        (&["info", "light.toml", "--light.probe", "none.hdr"], PLAIN),
        (&["info", "preset.toml", "--transfer.file", "none.json"], PLAIN),
        (&["render", "none.toml", "-o", "x.png"], PLAIN),
        (&["render", "none.nrrd", "-o", "x.png"], PLAIN),
        (&["render", "v.nrrd", "-o", "x.png", "--field", "none.nrrd"], PLAIN),
        (&["transfer", "none.json"], PLAIN),
        (&["compare", "none.exr", "none.exr"], PLAIN),
    ];
    for (arguments, end) in cases {
        let out = halflight(&f.0, arguments);
        let stderr = String::from_utf8(out.stderr).unwrap();
        assert!(out.status.code() == Some(3) && stderr.ends_with(end), "{arguments:?}: {stderr}");
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
fn help_lists_every_key_of_a_scene_with_its_default() {
    let help = |command: &str| String::from_utf8(halflight(Path::new("."), &[command, "--help"]).stdout).unwrap();
    let flat = help("frames").split_whitespace().collect::<Vec<_>>().join(" ");
    // A plan's frames would differ from run to run: `render` lists what `frames` refuses.
    let planned = ["visibility.tolerance", "visibility.quality"];
    for key in planned {
        assert!(help("render").contains(&format!("--{key} <")) && !flat.contains(&format!("--{key} <")), "{key}");
    }
    for key in halflight::scene::keys::KEYS.iter().filter(|k| !planned.contains(&k.name)) {
        assert!(flat.contains(&format!("--{} <", key.name)), "{}", key.name);
        let default = key.default.trim_start_matches('[').trim_end_matches(']').replace(", ", ",");
        assert!(default.is_empty() || flat.replace(", ", ",").contains(&format!("(default: {default}")), "{}", key.name);
    }
    assert!(flat.contains("--camera.up <X,Y,Z> direction that is up in the picture (default: 0,0,1)"), "{flat}");
    assert!(flat.contains("or none: the summary alone"), "{flat}");
    let info = String::from_utf8(halflight(Path::new("."), &["info", "--help"]).stdout).unwrap();
    assert!(info.contains("OpenVDB"), "{info}");
    let short = String::from_utf8(halflight(Path::new("."), &["render", "-h"]).stdout).unwrap();
    assert!(!short.contains("--camera.up") && short.contains("--help lists all keys"), "{short}");
    let out = halflight(Path::new("."), &["--help"]);
    assert_eq!(out.status.code(), Some(0));
    let top = String::from_utf8(out.stdout).unwrap();
    assert!(["Exit codes", "RUST_LOG", "~/.cache/halflight"].iter().all(|part| top.contains(part)), "{top}");
    // Options of the device stand together, where there is one.
    let options = ["--device <", "--threads <", "--memory <", "--validate"];
    for command in ["demo", "precompute", "render", "frames", "chart"] {
        let (_, rest) = help(command).split_once("\nDevice:\n").map(|(a, b)| (a.to_owned(), b.to_owned())).expect(command);
        let section = rest.split("\n\n  -").next().unwrap().split("\nScene: ").next().unwrap();
        assert!(options.iter().all(|o| section.contains(o)), "{command}: {section}");
    }
    for command in ["info", "light", "transfer", "compare", "devices"] {
        assert!(options.iter().all(|o| !help(command).contains(o)), "{command}");
    }
}
