//! `halflight frames`: the same bits in any chunks, whole files kept, interruptions, failures, fields from files, farms.
#![cfg(feature = "cli")]

mod common;
use common::run;
use common::sequence::*;
use std::process::{Command, Stdio};

#[test]
fn frames_have_the_same_bits_in_any_chunks_and_from_any_folder() {
    let here = folder();
    let aov = ["--aov", "depth,normal,albedo,irradiance,visibility,opacity", "--exr-type", "half", "--compression", "piz"];
    let (code, out, err) = frames(here.path(), &[&["-o", "a/f.####.exr"], &aov[..]].concat());
    assert_eq!(code, 0, "{err}");
    assert_eq!(out.lines().filter(|l| l.starts_with("frame ")).count(), 8, "{out}");
    let whole = files(&here.path().join("a"));
    assert_eq!(whole.keys().next().expect("frames"), "f.0001.exr");
    assert_eq!(whole.len(), 8);
    for range in ["8-5", "1-4x3", "3,2"] {
        let (code, _, err) = frames(here.path(), &[&["-o", "b/f.%04d.exr", "--frames", range], &aov[..]].concat());
        assert_eq!(code, 0, "{err}");
    }
    assert!(files(&here.path().join("b")) == whole);
    // From elsewhere, and with nothing kept between frames.
    let scene = here.path().join("s.toml");
    let elsewhere = tempfile::tempdir().expect("a folder");
    let arguments = [&["frames", scene.to_str().expect("UTF-8"), "-o", "f.####.exr", "--no-reuse"], &aov[..]].concat();
    let (code, _, err) = run(elsewhere.path(), &arguments);
    assert_eq!(code, 0, "{err}");
    assert!(files(elsewhere.path()) == whole);
    // The comparison can fail: every frame is another.
    let frames: Vec<_> = whole.values().collect();
    assert!(frames.windows(2).all(|w| w[0] != w[1]));
}

#[test]
fn whole_files_of_this_scene_are_kept_and_all_others_made_again() {
    let here = folder();
    for kind in ["png", "exr"] {
        let out = format!("o/f.##.{kind}");
        let (code, ..) = frames(here.path(), &["-o", &out, "--frames", "1-4"]);
        assert_eq!(code, 0);
        let at = |n: usize| here.path().join(format!("o/f.{n:02}.{kind}"));
        let before = files(&here.path().join("o"));
        // Frame 2 is cut short, frame 3 is of another scene.
        let bytes = std::fs::read(at(2)).expect("a frame");
        std::fs::write(at(2), &bytes[..bytes.len() - 7]).expect("cut");
        std::fs::copy(at(1), at(3)).expect("copied");
        let (code, said, _) = frames(here.path(), &["-o", &out, "--frames", "1-4", "--skip-existing"]);
        assert_eq!(code, 0);
        assert!(said.contains("2 written") && said.contains("2 were whole already"), "{said}");
        assert!(files(&here.path().join("o")) == before, "{kind}");
        // The same scene under the number of another frame, and at another rate.
        let hold = ["--animation.keyframe", "[{ frame = 1, light.scale = 1 }]", "--transfer.points", "[[60, 1,1,1, 0], [200, 1,1,1, 0.4]]"];
        let held = |more: &[&str]| frames(here.path(), &[&["-o", &out, "--frames", "1-2", "--skip-existing"], &hold[..], more].concat()).1;
        held(&[]);
        assert!(held(&[]).contains("2 were whole already"));
        std::fs::copy(at(1), at(2)).expect("copied");
        assert!(held(&[]).contains("1 written"));
        assert!(held(&["--animation.rate", "12"]).contains("2 written"));
        // Another setting, another sample of the volume: nothing is kept.
        let (_, said, _) =
            frames(here.path(), &["-o", &out, "--frames", "1-2", "--skip-existing", "--light.scale", "1.5", "--image.step", "0.9"]);
        assert!(said.contains("2 written"), "{said}");
        frames(here.path(), &["-o", &out, "--frames", "1"]);
        let mut volume = std::fs::read(here.path().join("v.nrrd")).expect("the volume");
        *volume.last_mut().expect("a sample") ^= 1;
        std::fs::write(here.path().join("v.nrrd"), volume).expect("changed");
        let (_, said, _) = frames(here.path(), &["-o", &out, "--frames", "1", "--skip-existing"]);
        assert!(said.contains("1 written"), "{said}");
    }
}

#[test]
#[cfg(unix)]
fn a_signal_stops_between_dispatches_and_keeps_what_is_finished() {
    let here = folder();
    let (code, ..) = frames(here.path(), &["-o", "whole/f.##.exr"]);
    assert_eq!(code, 0);
    for (signal, expected) in [("-TERM", 143), ("-INT", 130)] {
        let out = format!("cut{signal}/f.##.exr");
        let mut child = Command::new(env!("CARGO_BIN_EXE_halflight"))
            .current_dir(here.path())
            .args(["frames", "s.toml", "-o", &out, "--no-reuse", "--progress", "lines"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the command runs");
        // After the first frame's line.
        let mut lines = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().expect("stdout")));
        assert!(lines.next().expect("a line").expect("text").starts_with("frame    1"));
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill").success());
        let rest: Vec<String> = lines.map_while(Result::ok).collect();
        let done = child.wait_with_output().expect("it ends");
        let stderr = String::from_utf8(done.stderr).expect("UTF-8");
        assert_eq!(done.status.code(), Some(expected), "{stderr}");
        assert!(stderr.contains("finished frames are kept"), "{stderr}");
        assert!(rest.iter().any(|l| l.contains("not begun or not finished")), "{rest:?}");
        let kept = files(&here.path().join(format!("cut{signal}")));
        assert!(!kept.is_empty() && kept.len() < 8 && kept.keys().all(|name| name.starts_with("f.")));
        let (code, said, _) = frames(here.path(), &["-o", &out, "--skip-existing"]);
        assert!(code == 0 && said.contains(&format!("{} were whole already", kept.len())), "{said}");
        assert!(files(&here.path().join(format!("cut{signal}"))) == files(&here.path().join("whole")));
    }
}

#[test]
fn one_bad_frame_fails_alone_and_a_bad_output_ends_the_run() {
    let here = folder();
    let volume = std::fs::read(here.path().join("v.nrrd")).expect("the volume");
    for n in [1, 3] {
        std::fs::write(here.path().join(format!("step_{n}.nrrd")), &volume).expect("a step");
    }
    std::fs::write(here.path().join("s.toml"), "[volume]\nfile = \"step_#.nrrd\"\n[visibility]\nmethod = \"sweep\"\ndirections = 16\n[image]\nwidth = 8\nheight = 8\n[animation]\nframes = 3\n")
        .expect("a scene");
    let (code, out, err) = frames(here.path(), &["-o", "f.#.png"]);
    assert_eq!(code, 3, "{err}");
    assert!(err.contains("frame 2 failed: ") && err.contains("step_2.nrrd: cannot open: no such file"), "{err}");
    assert!(out.contains("2 written") && out.contains("failed     2"), "{out}");
    assert!(here.path().join("f.3.png").exists());
    // Usage.
    for (arguments, part) in [
        (&["-o", "f.png"][..], "3 frames would all be written here"),
        (&["-o", "f.#.png", "--frames", "2-9"], "frame 4 lies outside the animation, which has 1 to 3"),
        (&["-o", "f.#.png", "--frames", "x"], "`x` is no range of frames"),
        (&["-o", "f.#.png", "--aov", "depth"], "only an .exr holds the layers"),
        (&["-o", "f.#.jpg"], "its extension must be .exr or .png"),
        (&["-o", "f.#.png", "--visibility.tolerance", "0.1"], "frames would differ from run to run"),
    ] {
        let (code, _, err) = frames(here.path(), arguments);
        assert!(code == 2 && err.contains(part), "{arguments:?}: {code} {err}");
    }
}

#[test]
#[cfg(unix)]
fn an_output_that_cannot_be_written_is_one_sentence_and_nothing_half_written() {
    let here = folder();
    // A limit of file sizes stands for a full disk: nothing of a frame stays.
    let script = format!("ulimit -f 4; exec {} frames s.toml -o 'f.#.exr' --frames 1-3", env!("CARGO_BIN_EXE_halflight"));
    // Caches of the driver's own, here empty ones, meet the limit before the first frame does.
    let caches = folder();
    let mut sh = Command::new("sh");
    sh.args(["-c", &script]).current_dir(here.path()).env("XDG_CACHE_HOME", caches.path()).env_remove("MESA_SHADER_CACHE_DIR");
    let done = sh.output().expect("sh");
    let stderr = String::from_utf8(done.stderr).expect("UTF-8");
    assert_eq!(done.status.code(), Some(3), "{stderr}");
    assert!(stderr.contains("frame 1: f.1.exr: cannot write: it would be larger than files may become here"), "{stderr}");
    assert_eq!(files(here.path()).len(), 2, "the scene and its volume");
    // A folder that is a file, and /proc, where nobody writes.
    let (code, _, err) = frames(here.path(), &["-o", "v.nrrd/f.#.exr"]);
    assert!(code == 3 && err.contains("v.nrrd: cannot make this folder"), "{code} {err}");
    let (code, _, err) = frames(here.path(), &["-o", "/proc/f.#.exr"]);
    assert!(code == 3 && err.contains("/proc: cannot write into this folder"), "{code} {err}");
}

#[test]
fn a_field_from_a_file_gives_the_same_bits_and_is_checked() {
    let here = folder();
    let text = SCENE.split("[[animation.keyframe]]\nframe = 3").next().expect("text").to_owned()
        + "[transfer]\npoints = [[60, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]\n";
    std::fs::write(here.path().join("s.toml"), text).expect("a scene");
    let all = ["--visibility.bands", "4"];
    let (code, _, err) = run(here.path(), &[&["precompute", "s.toml", "-o", "field.nrrd", "--measure"], &all[..]].concat());
    assert_eq!(code, 0, "{err}");
    let (code, ..) = frames(here.path(), &[&["-o", "a/f.#.png", "--frames", "1-3"], &all[..]].concat());
    assert_eq!(code, 0);
    let (code, out, err) = frames(here.path(), &[&["-o", "b/f.#.png", "--frames", "1-3", "--field", "field.nrrd"], &all[..]].concat());
    assert_eq!(code, 0, "{err}");
    assert!(!out.contains("visibility "), "{out}");
    let (a, b) = (files(&here.path().join("a")), files(&here.path().join("b")));
    assert!(a.len() == 3 && b.len() == 3);
    for (name, bytes) in &a {
        let decode = |bytes: &[u8]| {
            let path = here.path().join("one.png");
            std::fs::write(&path, bytes).expect("written");
            halflight::io::read_picture_png(&path).expect("a picture").rgba
        };
        assert_eq!(decode(bytes), decode(&b[name]), "{name}");
    }
    // The measured error goes with it.
    assert!(String::from_utf8_lossy(&b["f.1.png"]).contains("before packing"));
    let (code, ..) = run(here.path(), &["render", "s.toml", "-o", "r.png", "--frame", "2", "--field", "field.nrrd"]);
    assert_eq!(code, 0);
    for (arguments, part) in [
        (&["--transfer.points", "[[50, 1,1,1, 0], [200, 1,1,1, 0.4]]"][..], "another transfer function, surface or clipping"),
        (&["--clip.box", "0,0,0,1,1,0.5"], "another transfer function, surface or clipping"),
        (&["--visibility.directions", "33"], "other [visibility] settings"),
        (&["--visibility.ratio", "2"], "other [visibility] settings"),
    ] {
        let (code, _, err) =
            frames(here.path(), &[&["-o", "c/f.#.png", "--frames", "1", "--field", "field.nrrd"], &all[..], arguments].concat());
        assert!(code == 3 && err.contains(part) && err.contains("compute it anew with halflight precompute"), "{arguments:?}: {err}");
    }
    // Colours have no part in visibility.
    let colour = ["--transfer.points", "[[60, 0,1,1, 0], [200, 0,1,0, 0.4]]"];
    let (code, _, err) =
        frames(here.path(), &[&["-o", "c/f.#.png", "--frames", "1", "--field", "field.nrrd"], &all[..], &colour[..]].concat());
    assert_eq!(code, 0, "{err}");
    let (code, _, err) = frames(here.path(), &["-o", "c/f.#.png", "--frames", "1", "--field", "v.nrrd"]);
    assert!(code == 3 && err.contains("v.nrrd"), "{err}");
}

#[test]
fn each_kind_of_progress_is_what_its_listener_expects() {
    let here = folder();
    let of = |how: &[&str]| {
        let (code, out, err) = frames(here.path(), &[&["-o", "f.#.png", "--frames", "1-3"], how].concat());
        assert!(code == 0 && err.is_empty(), "{how:?}: {code} {err}");
        out
    };
    let lines = of(&["--progress", "lines"]);
    assert_eq!(lines.lines().filter(|l| l.starts_with("frame ")).count(), 3);
    // Nobody sees a bar here.
    let kinds = |out: &str| out.lines().map(|l| l.split_whitespace().next().unwrap_or_default().to_owned()).collect::<Vec<_>>();
    assert_eq!(kinds(&of(&["--progress", "auto"])), kinds(&lines));
    assert_eq!(kinds(&of(&["--progress", "tty"])), kinds(&lines));
    let none = of(&["--progress", "none"]);
    assert!(none.starts_with("frames     3 written") && !none.contains("frame  "), "{none}");
    let openjd = of(&["--progress", "openjd"]);
    let after = |key: &str| openjd.lines().filter_map(|l| l.strip_prefix(key)).collect::<Vec<_>>();
    assert_eq!(after("openjd_status: "), ["frame 1, 1 of 3", "frame 2, 2 of 3", "frame 3, 3 of 3"]);
    assert_eq!(after("openjd_progress: "), ["33.3", "66.7", "100.0"]);
    // JSON to the last line, also of a run that fails; one object and nothing else with --json.
    let object = |line: &str| serde_json::from_str::<serde_json::Value>(line).expect("JSON");
    let out = of(&["--progress", "json"]);
    let objects: Vec<_> = out.lines().map(object).collect();
    assert_eq!(objects.iter().filter(|o| o["frame"].is_i64()).count(), 3);
    assert_eq!(objects.last().expect("an end")["written"], 3);
    std::fs::write(here.path().join("t.toml"), "[volume]\nfile = \"none.nrrd\"\n[animation]\nframes = 2\n").expect("a scene");
    let (code, out, err) = run(here.path(), &["frames", "t.toml", "-o", "f.#.png", "--progress", "json"]);
    let objects: Vec<_> = out.lines().map(object).collect();
    assert!(code == 3 && err.contains("none.nrrd") && objects.len() == 3, "{out}");
    assert!(objects[0]["error"].is_string() && objects[2]["code"] == 3 && objects[2]["failed"].as_array().is_some_and(|f| f.len() == 2));
    assert_eq!(of(&["--json", "--progress", "none"]).lines().count(), 1);
    for how in ["lines", "json", "tty", "openjd"] {
        let (code, _, err) = frames(here.path(), &["-o", "f.#.png", "--json", "--progress", how]);
        assert!(code == 2 && err.contains("--json prints one object at the end"), "{err}");
    }
}

/// A picture's channels: name, whether half, numbers.
fn channels(path: &std::path::Path) -> Vec<(String, bool, Vec<u32>)> {
    use exr::prelude::{AnyChannel, FlatSamples, ReadChannels, ReadLayers, read};
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes().from_file(path);
    let list = image.expect("a picture").layer_data.channel_data.list;
    let of = |c: &AnyChannel<FlatSamples>| {
        let half = matches!(c.sample_data, FlatSamples::F16(_));
        (c.name.to_string(), half, c.sample_data.values_as_f32().map(f32::to_bits).collect())
    };
    list.iter().map(of).collect()
}

#[test]
fn render_writes_the_same_picture_and_layers_as_frames() {
    let here = folder();
    let layers = ["--aov", "depth,normal,albedo", "--aov", "opacity", "--exr-type", "half", "--compression", "rle"];
    for more in [&[][..], &["--surface.iso", "120", "--surface.albedo", "0.2,0.5,0.9"]] {
        let (code, _, err) = frames(here.path(), &[&["-o", "f.#.exr", "--frames", "3-4"], &layers[..], more].concat());
        assert_eq!(code, 0, "{err}");
        let (code, _, err) = run(here.path(), &[&["render", "s.toml", "-o", "r.exr", "--frame", "3"], &layers[..], more].concat());
        assert_eq!(code, 0, "{err}");
        let [r, third, fourth] = ["r.exr", "f.3.exr", "f.4.exr"].map(|name| channels(&here.path().join(name)));
        assert_eq!(r.len(), 4 + 2 + 3 + 3 + 1);
        assert!(r == third && r != fourth, "{more:?}");
        assert!(r.iter().all(|(name, half, _)| *half != name.starts_with("depth")));
        // A surface's own colour is among them.
        let green = &r.iter().find(|c| c.0 == "albedo.G").expect("albedo").2;
        assert_eq!(green.contains(&0.5f32.to_bits()), !more.is_empty());
    }
    let (code, ..) = run(here.path(), &["render", "s.toml", "-o", "r.exr", "--frame", "3"]);
    assert!(code == 0 && channels(&here.path().join("r.exr")).iter().map(|c| c.0.as_str()).eq(["A", "B", "G", "R"]));
}
