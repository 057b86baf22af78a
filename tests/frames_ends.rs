//! How a run of `halflight frames` ends: one object that sums up, one sentence for what is of no frame, nothing begun in vain.
#![cfg(feature = "cli")]

mod common;
use common::run;
use common::sequence::*;
use serde_json::Value;
use std::path::Path;

/// Three steps of a series, the third of them missing, the others the same bytes.
const SERIES: &str = "[volume]\nfile = \"step_#.nrrd\"\n[transfer]\npoints = [[0, 1, 1, 1, 0], [255, 1, 1, 1, 0.5]]\n\
                      [visibility]\nmethod = \"sweep\"\ndirections = 16\n[image]\nwidth = 8\nheight = 8\n\
                      [animation]\nframes = 4\n";

fn with_series() -> tempfile::TempDir {
    let here = folder();
    for n in [1, 2, 4] {
        std::fs::copy(here.path().join("v.nrrd"), here.path().join(format!("step_{n}.nrrd"))).expect("a step");
    }
    std::fs::write(here.path().join("series.toml"), SERIES).expect("a scene");
    here
}

/// An object without what differs from run to run.
fn timeless(mut value: Value) -> Value {
    match &mut value {
        Value::Object(map) => {
            map.iter_mut().for_each(|(key, v)| match key.as_str() {
                "seconds" | "took" => *v = Value::Null,
                _ => *v = timeless(v.take()),
            });
            map.get_mut("stages").and_then(Value::as_object_mut).into_iter().flatten().for_each(|(_, v)| *v = Value::Null);
        }
        Value::Array(list) => list.iter_mut().for_each(|v| *v = timeless(v.take())),
        _ => {}
    }
    value
}

/// Exit code and object of `--json`, which is the last of `--progress json` but for the times.
fn object(folder: &Path, arguments: &[&str]) -> (i32, Value) {
    let of = |how: &[&str]| {
        let (code, out, err) = run(folder, &[&["frames"], arguments, how].concat());
        let objects: Vec<Value> = out.lines().map(|l| serde_json::from_str(l).expect("JSON")).collect();
        assert!(!objects.is_empty(), "{arguments:?} {how:?}: {err}");
        (code, objects)
    };
    let ((code, alone), (again, lines)) = (of(&["--json"]), of(&["--progress", "json"]));
    assert_eq!((code, alone.len()), (again, 1), "{arguments:?}");
    let one = alone.into_iter().next().expect("an object");
    assert_eq!(timeless(one.clone()), timeless(lines.into_iter().next_back().expect("a last one")), "{arguments:?}");
    assert_eq!(one["code"].as_i64().unwrap_or(0), i64::from(code), "{arguments:?}: {one}");
    (code, one)
}

#[test]
fn json_is_the_last_object_of_progress_json_however_the_run_ends() {
    let here = with_series();
    let seconds = |o: &Value| o["seconds"].as_f64().expect("seconds");
    let (code, done) = object(here.path(), &["s.toml", "-o", "a/f.#.exr", "--frames", "1-3"]);
    assert_eq!((code, &done["written"]), (0, &3.into()));
    let paid: f64 = done["frames"].as_array().expect("frames").iter().map(seconds).sum();
    assert!(seconds(&done) > paid && seconds(&done) < paid + 60.0, "the run's own time: {} of {paid}", seconds(&done));
    let (_, kept) = object(here.path(), &["s.toml", "-o", "a/f.#.exr", "--frames", "1-3", "--skip-existing"]);
    assert_eq!((&kept["written"], &kept["skipped"]), (&0.into(), &3.into()));
    let (_, estimate) = object(here.path(), &["s.toml", "-o", "e/f.#.exr", "--frames", "1-3", "--estimate"]);
    assert!(estimate["estimate"]["seconds"].is_f64(), "{estimate}");
    // A frame that fails by its own file.
    let (code, failed) = object(here.path(), &["series.toml", "-o", "b/f.#.exr"]);
    assert_eq!((code, &failed["written"], &failed["failed"][0]["frame"]), (3, &3.into(), &3.into()));
    assert!(failed["error"].as_str().is_some_and(|e| e.starts_with("frame 3 failed: step_3.nrrd")), "{failed}");
    assert!(seconds(&failed) > 0.001, "{failed}");
    // What is of no frame: the sentence and its code, as of other commands.
    for (arguments, code) in [
        (&["s.toml", "-o", "p/f.#.jpg"][..], 2),
        (&["s.toml", "-o", "p/f.#.exr", "--frames", "9"], 2),
        (&["s.toml", "-o", "p/f.#.exr", "--device", "nope"], 4),
        (&["s.toml", "-o", "v.nrrd/f.#.exr"], 3),
        (&["gone.toml", "-o", "p/f.#.exr"], 3),
    ] {
        let (found, object) = object(here.path(), arguments);
        assert_eq!((found, object.as_object().map(serde_json::Map::len)), (code, Some(2)), "{arguments:?}: {object}");
    }
}

#[test]
#[cfg(unix)]
fn json_of_a_run_that_is_stopped_sums_up_too() {
    use std::process::{Command, Stdio};
    let here = folder();
    for how in [&["--json"][..], &["--progress", "json"]] {
        let out = format!("{}/f.#.exr", how.len());
        let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
        command
            .current_dir(here.path())
            .args(["frames", "s.toml", "-o", &out, "--no-reuse", "--visibility.directions", "4000", "--visibility.ratio", "1"])
            .args(how);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the command runs");
        while !here.path().join(out.replace('#', "1")).exists() {
            assert!(child.try_wait().expect("a child").is_none(), "it ended before its first frame");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill").success());
        let done = child.wait_with_output().expect("it ends");
        let text = String::from_utf8(done.stdout).expect("UTF-8");
        let last: Value = serde_json::from_str(text.lines().next_back().expect("an object")).expect("JSON");
        assert!(how.len() == 2 || text.lines().count() == 1, "{text}");
        assert_eq!((done.status.code(), &last["code"]), (Some(143), &143.into()), "{last}");
        let written = last["written"].as_u64().expect("a count");
        assert!((1..8).contains(&written) && last["frames"].as_array().is_some_and(|f| f.len() as u64 == written), "{last}");
        assert!(last["error"].as_str().is_some_and(|e| e.starts_with("stopped by SIGTERM; finished frames are kept")), "{last}");
    }
}

/// Runs what must be refused before anything is rendered: one sentence, nothing said on stdout, nothing left.
fn refused(folder: &Path, arguments: &[&str], code: i32, part: &str) {
    let before = std::fs::read_dir(folder).expect("a folder").count();
    let (found, out, err) = run(folder, &[&["frames"], arguments].concat());
    assert!(found == code && err.contains(part) && err.lines().count() == 1, "{arguments:?}: {found} {err}");
    assert!(out.is_empty() && !err.contains("frame 1:"), "{arguments:?}: {out} {err}");
    assert_eq!(std::fs::read_dir(folder).expect("a folder").count(), before, "{arguments:?}");
}

#[test]
fn what_is_of_no_frame_is_one_sentence_before_the_first() {
    let here = folder();
    for (arguments, code, part) in [
        (&["s.toml", "-o", "p/f.#.jpg"][..], 2, "p/f.#.jpg: its extension must be .exr or .png"),
        (&["s.toml", "-o", "p/f.#.exr", "--device", "nope"], 4, "halflight: no Vulkan device: none is called 'nope'"),
        (&["s.toml", "-o", "p/f.#.exr", "--volume.component", "7"], 2, "`volume.component`"),
        (&["s.toml", "-o", "p/f.#.exr", "--light.probe", "gone.hdr"], 3, "halflight: gone.hdr: cannot read: no such file"),
        (&["s.toml", "-o", "v.nrrd/f.#.exr"], 3, "v.nrrd: cannot make this folder: there is a file of that name; name another"),
        (&["s.toml", "-o", "p/f.#.exr", "--fields", "v.nrrd"], 3, "v.nrrd: cannot make this folder: there is a file of that name"),
        (&["s.toml", "-o", "p/f.#.png", "--exr-type", "half"], 2, "p/f.#.png: only an .exr has the types of --exr-type"),
        (&["s.toml", "-o", "p/f.#.png", "--compression", "zip"], 2, "p/f.#.png: only an .exr has the compressions of --compression"),
    ] {
        refused(here.path(), arguments, code, part);
    }
    // A frame's place that is taken, seen before the first frame; frames beside it are not concerned.
    std::fs::create_dir_all(here.path().join("o/f.6.exr")).expect("a folder");
    refused(here.path(), &["s.toml", "-o", "o/f.#.exr"], 3, "o/f.6.exr: is a folder; name a file");
    assert_eq!(std::fs::read_dir(here.path().join("o")).expect("a folder").count(), 1, "nothing beside it");
    assert_eq!(frames(here.path(), &["-o", "o/f.#.exr", "--frames", "1-2,7"]).0, 0);
}

#[test]
fn no_frame_is_written_over_what_the_frames_are_made_of() {
    let here = folder();
    let probe = halflight::scene::Picture { width: 8, height: 4, rgba: vec![[1.0; 4]; 32] };
    halflight::io::write_exr(&here.path().join("sky.3.exr"), &probe, &[]).expect("a probe");
    let of_sky = ["s.toml", "-o", "sky.#.exr", "--light.probe", "sky.3.exr"];
    let said = "sky.3.exr: is an input of this command; name another output";
    refused(here.path(), &of_sky, 2, said);
    refused(here.path(), &[&of_sky[..], &["--skip-existing"]].concat(), 2, said);
    // Nor over a name that leads there.
    std::fs::hard_link(here.path().join("sky.3.exr"), here.path().join("also.4.exr")).expect("a link");
    refused(here.path(), &["s.toml", "-o", "also.#.exr", "--light.probe", "sky.3.exr"], 2, "also.4.exr: is an input");
    assert_eq!(run(here.path(), &[&["frames"], &of_sky[..], &["--frames", "1-2"]].concat()).0, 0, "frames beside it");
    // The slices of a stack, by pattern and by folder.
    std::fs::create_dir(here.path().join("cut")).expect("a folder");
    assert_eq!(frames(here.path(), &["-o", "cut/s.#.png", "--frames", "1-4"]).0, 0);
    for stack in ["cut/s.#.png", "cut"] {
        let more = ["--volume.file", stack, "--volume.component", "r"];
        refused(here.path(), &[&["s.toml", "-o", "cut/s.#.png"], &more[..]].concat(), 2, "cut/s.1.png: is an input");
        let (code, _, err) = run(here.path(), &["render", stack, "-o", "cut/s.4.png", "--volume.component", "r"]);
        assert!(code == 2 && err.contains("cut/s.4.png: is an input"), "{code} {err}");
    }
}

#[test]
fn a_field_that_cannot_serve_all_frames_is_refused_before_the_first() {
    let here = with_series();
    let precompute = |scene: &str, out: &str, more: &[&str]| {
        let (code, _, err) = run(here.path(), &[&["precompute", scene, "-o", out], more].concat());
        assert_eq!(code, 0, "{err}");
    };
    precompute("s.toml", "one.nrrd", &["--frame", "1"]);
    let out = ["s.toml", "-o", "p/f.#.exr"];
    let with = |more: &[&'static str]| [&out[..], more].concat();
    refused(here.path(), &with(&["--field", "none.nrrd"]), 3, "none.nrrd: cannot open: no such file; check the path\n");
    refused(here.path(), &with(&["--field", "v.nrrd", "--frames", "1-3"]), 3, "v.nrrd: it has 3 axes of type uint8; a field has 4");
    refused(
        here.path(),
        &with(&["--field", "one.nrrd"]),
        2,
        "--field holds one field, and frame 6 needs another than frame 1, for its transfer function, surface or clipping differs; --fields DIR",
    );
    // Only what is asked for counts: the matter holds up to frame 5.
    let (code, _, err) = frames(here.path(), &["-o", "p/f.#.exr", "--frames", "1-3,5", "--field", "one.nrrd"]);
    assert_eq!(code, 0, "{err}");
    assert_eq!(frames(here.path(), &["-o", "q/f.#.exr", "--frames", "8", "--field", "one.nrrd"]).0, 3, "a field of another matter");
    // Files of the same contents have one field, others not.
    precompute("series.toml", "series.nrrd", &[]);
    let series = |frames: &'static str| ["series.toml", "-o", "r/f.#.exr", "--frames", frames, "--field", "series.nrrd"];
    let (code, _, err) = run(here.path(), &[&["frames"], &series("1,2,4")[..]].concat());
    assert_eq!(code, 0, "{err}");
    let mut bytes = std::fs::read(here.path().join("step_4.nrrd")).expect("a step");
    *bytes.last_mut().expect("a sample") ^= 1;
    std::fs::write(here.path().join("step_4.nrrd"), bytes).expect("changed");
    refused(here.path(), &series("1,2,4"), 2, "frame 4 needs another than frame 1, for its volume differs");
    // What a file turns out to be is of no frame either.
    let said = "one.nrrd: it was computed with other [visibility] settings";
    refused(here.path(), &with(&["--field", "one.nrrd", "--frames", "1-3", "--visibility.directions", "33"]), 3, said);
}

#[test]
fn a_tolerance_beside_a_field_is_refused_on_the_command_line_only() {
    let here = folder();
    let text = SCENE.replace("method = \"sweep\"\ndirections = 32\n", "tolerance = 0.5\nratio = 8\n");
    std::fs::write(here.path().join("t.toml"), text).expect("a scene");
    let (code, _, err) = run(here.path(), &["precompute", "t.toml", "-o", "f.nrrd", "--frame", "1"]);
    assert_eq!(code, 0, "{err}");
    let part = "chooses how a field is computed, and --field takes one from a file; drop one of the two";
    refused(here.path(), &["t.toml", "-o", "p/f.#.exr", "--frames", "1-2", "--field", "f.nrrd", "--visibility.quality", "fine"], 2, part);
    for more in [&["--tolerance", "0.1"][..], &["--quality", "draft"], &["--set", "visibility.tolerance=0.5"]] {
        let (code, _, err) = run(here.path(), &[&["render", "t.toml", "-o", "x.exr", "--frame", "1", "--field", "f.nrrd"], more].concat());
        assert!(code == 2 && err.contains(part), "{more:?}: {code} {err}");
    }
    // A preview has settings of its own, which take the place of the scene's, not of the command line's.
    let quick = ["t.toml", "-o", "q/f.#.exr", "--frames", "1-2", "--quick"];
    refused(here.path(), &[&quick[..], &["--visibility.quality", "fine"]].concat(), 2, "frames would differ from run to run");
    refused(here.path(), &quick[..5], 2, "frames would differ from run to run");
    let (code, out, err) = run(here.path(), &[&["frames"], &quick[..]].concat());
    assert!(code == 0 && out.contains("a field at 1:8 swept in 32 directions"), "{code} {out} {err}");
    // In the scene it is how the field was made.
    let (code, _, err) = run(here.path(), &["render", "t.toml", "-o", "x.exr", "--frame", "1", "--field", "f.nrrd"]);
    assert_eq!(code, 0, "{err}");
    let (code, _, err) = run(here.path(), &["frames", "t.toml", "-o", "p/f.#.exr", "--frames", "1-2", "--field", "f.nrrd"]);
    assert_eq!(code, 0, "{err}");
    // Frames are of the field that there is: of another one in its place, none is kept.
    for (directions, kept) in [("16", 0), ("16", 2), ("48", 0)] {
        let (code, _, err) =
            run(here.path(), &["precompute", "s.toml", "-o", "f.nrrd", "--frame", "1", "--visibility.directions", directions]);
        assert_eq!(code, 0, "{err}");
        let again = ["frames", "t.toml", "-o", "p/f.#.exr", "--frames", "1-2", "--field", "f.nrrd", "--skip-existing", "--json"];
        let (code, out, err) = run(here.path(), &again);
        let summary: Value = serde_json::from_str(&out).expect("JSON");
        assert_eq!((code, &summary["skipped"]), (0, &kept.into()), "{directions}: {summary} {err}");
        let info = run(here.path(), &["info", "p/f.1.exr"]).1;
        assert!(info.contains(&format!("directions = {directions}")) && !info.contains("tolerance"), "{info}");
    }
}
