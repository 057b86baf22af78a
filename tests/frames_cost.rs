//! `halflight frames`: what each frame pays for, what is said of it beforehand, and memory over many frames.
#![cfg(feature = "cli")]

mod common;
use common::run;
use common::sequence::*;
use std::process::{Command, Stdio};

#[test]
fn each_frame_pays_for_what_changed_and_says_so() {
    let here = folder();
    let (code, out, err) = frames(here.path(), &["-o", "f.##.png"]);
    assert_eq!(code, 0, "{err}");
    let line = |n: usize| out.lines().find(|l| l.starts_with(&format!("frame {n:>4} "))).expect("a line").to_owned();
    assert!(line(1).contains("read") && line(1).contains("upload") && line(1).contains("visibility"), "{out}");
    assert!(!line(2).contains("visibility") && line(2).contains("relight") && !line(2).contains("read"), "{out}");
    assert!(line(6).contains("classify") && line(6).contains("visibility"), "{out}");
    assert!(!line(7).contains("classify"), "{out}");
    assert!(out.contains("frames     8 written in") && out.contains("stages     read") && out.contains("said beforehand"), "{out}");
    assert!(out.contains("estimate: ") && out.contains("estimate   was"), "{out}");
    // For programs: one object with each frame's stages.
    let (code, out, _) = frames(here.path(), &["-o", "f.##.png", "--frames", "1-2", "--json"]);
    let object: serde_json::Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!((code, object["written"].as_u64()), (0, Some(2)));
    assert!(object["frames"][0]["stages"]["visibility"].is_f64() && object["frames"][1]["stages"]["visibility"].is_null());
    // And line by line.
    let (_, out, _) = frames(here.path(), &["-o", "f.##.png", "--frames", "1-2", "--progress", "json"]);
    let first: serde_json::Value = serde_json::from_str(out.lines().next().expect("a line")).expect("JSON");
    assert_eq!((first["frame"].as_i64(), first["done"].as_f64()), (Some(1), Some(0.5)));
}

/// What is there already costs nothing, and is no part of what is said to be left.
#[test]
fn an_estimate_leaves_out_what_will_be_skipped() {
    let here = folder();
    let run = |more: &[&str]| frames(here.path(), &[&["-o", "f.#.png"], more].concat());
    assert_eq!(run(&[]).0, 0);
    let drop = |gone: &[i32]| gone.iter().for_each(|n| std::fs::remove_file(here.path().join(format!("f.{n}.png"))).expect("a frame"));
    drop(&[1, 2, 3, 4, 8]);
    let (code, out, err) = run(&["--skip-existing"]);
    assert_eq!(code, 0, "{err}");
    assert!(out.contains("frames     5 written in") && out.contains("3 were whole already"), "{out}");
    assert!(out.contains(" more for 1 frame, ") && out.contains("estimate   was"), "{out}");
    // Where a file that was there turns out not to be whole, what was said was of something else, and nothing is made of it.
    drop(&[1, 2, 3, 4, 8]);
    std::fs::write(here.path().join("f.7.png"), "no picture").expect("a file");
    let (code, out, err) = run(&["--skip-existing"]);
    assert_eq!(code, 0, "{err}");
    assert!(out.contains("frames     6 written in") && out.contains("estimate: ") && !out.contains("estimate   was"), "{out}");
    // Nor are files kept that are all of another scene.
    let (code, out, err) = run(&["--skip-existing", "--image.exposure", "1"]);
    assert_eq!(code, 0, "{err}");
    assert!(out.contains("frames     8 written in") && out.contains(" more for 4 frames, ") && out.contains("estimate   was"), "{out}");
    // Sabotage: with nothing there, four are left.
    drop(&[1, 2, 3, 4, 5, 6, 7, 8]);
    assert!(run(&["--skip-existing"]).1.contains(" more for 4 frames, "));
}

#[test]
fn a_preview_and_an_estimate_say_what_they_are() {
    let here = folder();
    let (code, out, _) =
        frames(here.path(), &["-o", "q/f.#.png", "--quick", "--image.width", "640", "--image.height", "480", "--frames", "1"]);
    assert!(code == 0 && out.contains("preview: 320x240 pixels, a field at 1:8 swept in 32 directions"), "{out}");
    let picture = halflight::io::read_picture_png(&here.path().join("q/f.1.png")).expect("a picture");
    assert_eq!((picture.width, picture.height), (320, 240));
    let (code, out, err) = frames(here.path(), &["-o", "e/f.#.png", "--estimate"]);
    assert_eq!(code, 0, "{err}");
    assert!(out.contains("estimate: ") && out.contains("for 8 frames, ") && out.contains("of device memory"), "{out}");
    assert!(out.contains("frame    8 (4/4) "), "{out}");
    let (code, _, err) = frames(here.path(), &["-o", "e/f.#.png", "--estimate", "--skip-existing"]);
    assert!(code == 2 && err.contains("cannot be used with"), "{err}");
    assert_eq!(files(&here.path().join("e")).len(), 4);
}

/// The most memory that a run of the command holds, KiB, as the system counts it; and its report.
#[cfg(target_os = "linux")]
fn most_memory(folder: &std::path::Path, arguments: &[&str]) -> (u64, serde_json::Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
    command.current_dir(folder).args(arguments).stdout(Stdio::piped()).stderr(Stdio::inherit());
    let mut child = command.spawn().expect("the command runs");
    let (status, mut most) = (format!("/proc/{}/status", child.id()), 0);
    while child.try_wait().expect("a child").is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        most = line.and_then(|l| l.split_whitespace().next()?.parse().ok()).unwrap_or(most);
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let done = child.wait_with_output().expect("it ends");
    assert!(done.status.success());
    (most, serde_json::from_slice(&done.stdout).expect("JSON"))
}

#[test]
#[cfg(target_os = "linux")]
fn memory_does_not_grow_with_frames() {
    let here = folder();
    // Two steps of a series in turn, matter that fades, a clip box that moves, a camera that orbits, layers: all that can stay.
    for n in [1, 2] {
        let mut bytes = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 80 80 80\nendian: little\nencoding: raw\n\n".to_vec();
        let value =
            |i: i32| 255.0 - 6.0 * ([i % 80, i / 80 % 80, i / 6400].map(|x| (x - 40).pow(2)).iter().sum::<i32>() as f32).sqrt() / n as f32;
        bytes.extend((0..80 * 80 * 80).flat_map(|i| value(i).to_le_bytes()));
        std::fs::write(here.path().join(format!("step_{n}.nrrd")), bytes).expect("a step");
    }
    let scene = |frames: usize| {
        let mut text = "[volume]\nfile = \"step_#.nrrd\"\n[visibility]\nmethod = \"sweep\"\nratio = 4\ndirections = 8\n[image]\nwidth = 64\nheight = 48\n".to_owned();
        text += &format!("[animation]\nframes = {frames}\n");
        for frame in 1..=frames {
            let (even, part) = (frame % 2, frame as f64 / frames as f64);
            text += &format!(
                "[[animation.keyframe]]\nframe = {frame}\nvolume.number = {}\ncamera.orbit = [0, 0, 1, {}]\nclip.box = [0, 0, 0, 1, 1, {}]\n\
                 transfer.points = [[{}, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]\n",
                1 + even,
                360.0 * part,
                0.5 + 0.5 * part,
                40.0 + 30.0 * part
            );
        }
        std::fs::write(here.path().join(format!("m{frames}.toml")), text).expect("a scene");
    };
    let (few, many) = (8, 48);
    scene(few);
    scene(many);
    let of = |frames: usize, more: &[&str]| {
        let (scene, out) = (format!("m{frames}.toml"), format!("m{frames}/f.##.exr"));
        most_memory(here.path(), &[&["frames", &scene, "-o", &out, "--json", "--aov", "depth,normal"], more].concat())
    };
    for more in [&[][..], &["--fields", "fields"]] {
        let ((a, few_said), (b, many_said)) = (of(few, more), of(many, more));
        println!("{more:?}: {a} KiB for {few} frames, {b} KiB for {many}");
        // A volume that stayed would be 2000 KiB a frame, 80000 for the 40 frames more, on the device as much again; a picture with
        // its layers 100. What allocators keep differs from run to run.
        assert!(b < a + 12000, "{more:?}: {a} KiB for {few} frames, {b} KiB for {many}");
        let memory = |o: &serde_json::Value| ["peak", "estimate"].map(|k| o["memory"][k].as_u64().expect("bytes"));
        assert_eq!(memory(&few_said)[0], memory(&many_said)[0], "{more:?}");
        assert!(memory(&many_said)[0] <= memory(&many_said)[1], "{more:?}: {:?}", memory(&many_said));
    }
    // The comparison can fail: a picture that takes as much as a leak would is seen.
    let (a, _) = of(few, &["--image.width", "64"]);
    let (b, _) = of(few, &["--image.width", "800", "--image.height", "600"]);
    assert!(b > a + 12000, "{a} {b}");
}

#[test]
fn memory_and_time_are_said_beforehand_with_a_field_from_a_file_too() {
    let here = folder();
    let text = SCENE.split("[[animation.keyframe]]\nframe = 3").next().expect("text").to_owned();
    std::fs::write(here.path().join("s.toml"), text).expect("a scene");
    let (code, _, err) =
        run(here.path(), &["precompute", "s.toml", "-o", "field.nrrd", "--transfer.points", "[[60, 1,1,1, 0], [200, 1,1,1, 0.4]]"]);
    assert_eq!(code, 0, "{err}");
    for given in [&["--field", "field.nrrd", "--visibility.bands", "4"][..], &["--fields", "fields"], &["--fields", "fields"], &[]] {
        let points = ["--transfer.points", "[[60, 1,1,1, 0], [200, 1,1,1, 0.4]]"];
        let (code, out, err) = frames(here.path(), &[&["-o", "f.#.png"], given, &points].concat());
        assert!(code == 0 && out.contains("estimate: ") && out.contains("estimate   was"), "{given:?}: {out} {err}");
        let (code, out, _) = frames(here.path(), &[&["-o", "f.#.png", "--json"], given, &points].concat());
        let object: serde_json::Value = serde_json::from_str(&out).expect("JSON");
        let memory = ["peak", "estimate"].map(|k| object["memory"][k].as_u64().expect("bytes"));
        assert!(code == 0 && memory[0] <= memory[1] && memory[1] < 2 * memory[0], "{given:?}: {memory:?}");
    }
}
