//! `halflight frames --fields DIR`: fields under their hash. The same bits with and without, each computed once, whoever wants it;
//! what is damaged or of something else is seen, said and replaced.
#![cfg(all(feature = "cli", unix))]

mod common;
use common::run;
use common::sequence::*;
use fs4::FileExt;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Matter that comes and goes again: frames 1 to 7 have four fields, for 1 is 7, 2 is 6 and 3 is 5.
const THERE_AND_BACK: &str = r#"
[volume]
file = "v.nrrd"
[visibility]
method = "sweep"
directions = 32
[image]
width = 24
height = 18
[animation]
frames = 7
[[animation.keyframe]]
frame = 1
transfer.points = [[60, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]
[[animation.keyframe]]
frame = 4
transfer.points = [[60, 0.2, 0.5, 1, 0], [200, 0.2, 0.9, 1, 0.2]]
[[animation.keyframe]]
frame = 7
transfer.points = [[60, 1, 0.5, 0.2, 0], [200, 1, 0.9, 0.2, 0.4]]
"#;

fn there_and_back() -> tempfile::TempDir {
    let here = folder();
    std::fs::write(here.path().join("s.toml"), THERE_AND_BACK).expect("a scene");
    here
}

/// Fields (computed, found, bad) of a run that must succeed, and its stderr.
fn counted(folder: &Path, arguments: &[&str]) -> ([u64; 3], String) {
    let (code, out, err) = frames(folder, &[arguments, &["--json"]].concat());
    assert_eq!(code, 0, "{err}");
    (counts(&out), err)
}

fn counts(out: &str) -> [u64; 3] {
    let object: serde_json::Value = serde_json::from_str(out).expect("JSON");
    ["computed", "found", "bad"].map(|k| object["fields"][k].as_u64().expect("a count"))
}

#[test]
fn frames_are_the_same_bits_with_fields_from_a_folder() {
    let here = there_and_back();
    let series = "[volume]\nfile = \"step_#.nrrd\"\n[visibility]\nmethod = \"sweep\"\ndirections = 16\n[image]\nwidth = 16\nheight = 12\n\
                  [animation]\nframes = 4\n[[animation.keyframe]]\nframe = 1\nvolume.number = 1\n[[animation.keyframe]]\nframe = 2\n\
                  volume.number = 2\n[[animation.keyframe]]\nframe = 3\nvolume.number = 1\n[[animation.keyframe]]\nframe = 4\nvolume.number = 2\n";
    let track = |key: &str, there: &str, back: &str| {
        format!(
            "[volume]\nfile = \"v.nrrd\"\n{}[visibility]\nmethod = \"hierarchical\"\ndirections = 16\n[image]\nwidth = 16\nheight = 12\n[animation]\nframes = 4\n\
             ease = \"hold\"\n[[animation.keyframe]]\nframe = 1\n{key} = {back}\n[[animation.keyframe]]\nframe = 2\n{key} = {there}\n[[animation.keyframe]]\nframe = 4\n{key} = {back}\n",
            if key == "surface.iso" { "[surface]\niso = 100\n" } else { "" }
        )
    };
    std::fs::write(here.path().join("series.toml"), series).expect("a scene");
    std::fs::write(here.path().join("iso.toml"), track("surface.iso", "150", "120")).expect("a scene");
    std::fs::write(here.path().join("clip.toml"), track("clip.box", "[0, 0, 0, 1, 1, 0.5]", "[0, 0.3, 0, 1, 1, 1]")).expect("a scene");
    let mut volume = std::fs::read(here.path().join("v.nrrd")).expect("the volume");
    std::fs::write(here.path().join("step_1.nrrd"), &volume).expect("a step");
    let half = volume.len() / 2;
    volume[half..].iter_mut().for_each(|v| *v /= 2);
    std::fs::write(here.path().join("step_2.nrrd"), &volume).expect("a step");

    let cases: [(&str, &[&str], usize, usize); 7] = [
        ("s", &["--visibility.bands", "4"], 7, 4),
        ("s", &["--visibility.method", "march", "--visibility.bits", "32", "--light.bands", "2"], 7, 4),
        ("s", &["--visibility.method", "hierarchical", "--visibility.bits", "16", "--visibility.ratio", "2"], 7, 4),
        ("s", &["--visibility.cells", "all", "--visibility.sampling", "stratified", "--visibility.bands", "3"], 7, 4),
        ("series", &[], 4, 2),
        ("iso", &[], 4, 2),
        ("clip", &[], 4, 2),
    ];
    for (i, (scene, settings, count, distinct)) in cases.into_iter().enumerate() {
        let (scene, dir) = (format!("{scene}.toml"), format!("fields{i}"));
        let of = |out: &str, more: &[&str]| {
            let pattern = format!("{out}{i}/f.#.exr");
            let (code, said, err) = run(here.path(), &[&["frames", &scene, "-o", &pattern, "--json"], settings, more].concat());
            assert_eq!(code, 0, "{err}");
            (files(&here.path().join(format!("{out}{i}"))), said)
        };
        let (plain, _) = of("plain", &[]);
        assert_eq!(plain.len(), count);
        let (cold, said) = of("cold", &["--fields", &dir]);
        assert!(cold == plain, "{scene} {settings:?}: computed");
        assert_eq!(counts(&said)[0], distinct as u64, "{scene} {settings:?}: {said}");
        let (warm, said) = of("warm", &["--fields", &dir]);
        assert!(warm == plain, "{scene} {settings:?}: found");
        assert_eq!((counts(&said)[0], counts(&said)[2]), (0, 0), "{said}");
        let kept = files(&here.path().join(&dir));
        assert!(kept.len() == distinct && kept.keys().all(|k| k.ends_with(".nrrd")), "{:?}", kept.keys());
    }
}

/// Of some frames the fields are there, of others not: what is said beforehand tells them apart.
#[test]
fn an_estimate_knows_which_fields_are_there() {
    let here = folder();
    let there = THERE_AND_BACK.split("[[animation.keyframe]]\nframe = 7").next().expect("text");
    std::fs::write(here.path().join("s.toml"), there.replace("frames = 7", "frames = 14").replace("frame = 4", "frame = 14"))
        .expect("a scene");
    let run = |more: &[&str]| {
        let (code, out, err) = frames(here.path(), &[&["-o", "f.##.png"], more].concat());
        assert_eq!(code, 0, "{err}");
        let told = out.lines().find(|l| l.starts_with("estimate: ")).unwrap_or_default().to_owned();
        (told, out)
    };
    run(&["--frames", "1-6", "--fields", "some"]);
    // Six are found before the first is computed: only then it is known what one takes.
    let (told, out) = run(&["--fields", "some"]);
    assert!(told.contains(" more for 6 frames, ") && told.contains(", 6 fields of "), "{out}");
    assert!(out.contains("fields     8 computed, 6 found"), "{out}");
    let (told, out) = run(&["--fields", "some"]);
    assert!(told.contains(" more for 10 frames, ") && !told.contains(" fields of "), "{out}");
    // An estimate that computes none says that it cannot tell; where some are computed, it counts them with the rest.
    run(&["--frames", "1,2,8,14", "--fields", "few"]);
    let (told, out) = run(&["--estimate", "--fields", "few"]);
    assert!(told.contains("none, 10 fields must be computed"), "{out}");
    let (told, out) = run(&["--estimate", "--fields", "new"]);
    assert!(told.contains(" for 14 frames, ") && told.contains(", 14 fields of "), "{out}");
}

#[test]
fn what_is_in_the_folder_is_checked() {
    let here = there_and_back();
    let at = |name: &str| here.path().join(name);
    let (counted_first, _) = counted(here.path(), &["-o", "a/f.#.exr", "--fields", "fields"]);
    assert_eq!(counted_first, [4, 3, 0]);
    let (frames_of, good) = (files(&at("a")), files(&at("fields")));
    let name = good.keys().next().expect("a field").clone();
    let (path, bytes) = (at("fields").join(&name), good[&name].clone());
    let other = good.values().nth(1).expect("another").clone();
    let with = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut out = bytes.clone();
        change(&mut out);
        out
    };
    let replaced = |from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("it is there");
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let wrong: [(&str, Vec<u8>, &str); 6] = [
        ("a bit is flipped", with(&|b| *b.last_mut().expect("a byte") ^= 1), "it is damaged; it is computed anew"),
        ("it is cut short", with(&|b| b.truncate(b.len() - 5)), "the file holds"),
        ("it is another's", other, "computed for another transfer function, surface or clipping; it is computed anew"),
        ("it is no field", b"hello\n".to_vec(), &name),
        ("it is empty", Vec::new(), &name),
        ("it does not say what it is of", replaced("data_hash", "dato_hash"), "it does not say what it was computed from"),
    ];
    for (what, content, part) in wrong {
        std::fs::write(&path, content).expect("written");
        let (counted, err) = counted(here.path(), &["-o", "b/f.#.exr", "--fields", "fields"]);
        assert_eq!(counted, [1, 6, 1], "{what}");
        assert!(err.contains(part) && err.contains(&name), "{what}: {err}");
        assert!(files(&at("b")) == frames_of, "{what}");
        assert!(files(&at("fields")) == good, "{what}: it is replaced");
    }
    // A field under the name of another of the same matter: other settings.
    let (counts, _) = counted(here.path(), &["-o", "c/f.#.exr", "--frames", "4", "--fields", "fields", "--visibility.directions", "33"]);
    assert_eq!(counts, [1, 0, 0]);
    let more = files(&at("fields"));
    let new = more.iter().find(|(k, _)| !good.contains_key(*k)).expect("one more");
    for old in good.keys() {
        std::fs::write(at("fields").join(old), new.1).expect("written");
    }
    let (counts, err) = counted(here.path(), &["-o", "b/f.#.exr", "--frames", "4", "--fields", "fields"]);
    assert_eq!(counts, [1, 0, 1]);
    assert!(err.contains("it was computed with other [visibility] settings"), "{err}");
    assert_eq!(files(&at("b")), frames_of);
    // Sabotage: numbers with a hash of their own are believed, and then pictures are others.
    for (name, bytes) in &good {
        let begin = bytes.windows(2).position(|w| w == b"\n\n").expect("the header's end") + 2;
        let mut forged = bytes.clone();
        forged[begin..].chunks_exact_mut(4).for_each(|v| {
            let half = f32::from_le_bytes([v[0], v[1], v[2], v[3]]) * 0.5;
            v.copy_from_slice(&half.to_le_bytes());
        });
        let hash = |b: &[u8]| blake3::hash(b).to_hex()[..32].to_owned();
        let (old, new) = (hash(&bytes[begin..]), hash(&forged[begin..]));
        let place = forged.windows(32).position(|w| w == old.as_bytes()).expect("its hash");
        forged[place..place + 32].copy_from_slice(new.as_bytes());
        std::fs::write(at("fields").join(name), forged).expect("written");
    }
    let (counts, _) = counted(here.path(), &["-o", "d/f.#.exr", "--fields", "fields"]);
    assert_eq!(counts, [0, 7, 0]);
    assert!(files(&at("d")).iter().all(|(name, bytes)| frames_of[name] != *bytes));
}

#[test]
fn a_field_is_found_by_what_it_depends_on_and_nothing_else() {
    let here = there_and_back();
    let of = |more: &[&str]| counted(here.path(), &[&["-o", "f.#.exr", "--frames", "1", "--fields", "fields"], more].concat()).0;
    assert_eq!(of(&[]), [1, 0, 0]);
    // Colours, light, camera, picture, settings of other methods: the same field.
    for more in [
        &["--light.scale", "2"][..],
        &["--camera.fov", "20"],
        &["--image.width", "20"],
        &["--image.exposure", "1"],
        &["--visibility.growth", "0.5"],
        &["--visibility.filter", "box"],
    ] {
        assert_eq!(of(more), [0, 1, 0], "{more:?}");
    }
    for more in [
        &["--visibility.directions", "33"][..],
        &["--visibility.near", "2"],
        &["--visibility.bits", "16"],
        &["--visibility.ratio", "2"],
        &["--visibility.method", "march"],
        &["--clip.box", "0,0,0,1,1,0.9"],
        &["--surface.iso", "120"],
    ] {
        assert_eq!(of(more), [1, 0, 0], "{more:?}");
    }
    // The volume: a sample.
    let mut volume = std::fs::read(here.path().join("v.nrrd")).expect("the volume");
    volume[3000] ^= 1;
    std::fs::write(here.path().join("v.nrrd"), volume).expect("changed");
    assert_eq!(of(&[]), [1, 0, 0]);
    // A file of the folder is a field like any other.
    let (code, ..) = frames(here.path(), &["-o", "a.#.exr", "--frames", "1", "--fields", "one"]);
    assert_eq!(code, 0);
    let name = files(&here.path().join("one")).into_keys().next().expect("a field");
    let (code, _, err) =
        frames(here.path(), &["-o", "b.#.exr", "--frames", "1", "--field", &format!("one/{name}"), "--visibility.bands", "1"]);
    assert_eq!(code, 0, "{err}");
    let rgba = |name: &str| halflight::io::read_picture_exr(&here.path().join(name)).expect("a picture").rgba;
    assert_eq!(rgba("a.1.exr"), rgba("b.1.exr"));
}

fn start(folder: &Path, arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_halflight"));
    command.current_dir(folder).args(["frames", "s.toml"]).args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("the command runs")
}

#[test]
fn several_processes_compute_each_field_once() {
    let here = there_and_back();
    let at = |name: &str| here.path().join(name);
    let (code, ..) = frames(here.path(), &["-o", "plain/f.#.exr"]);
    assert_eq!(code, 0);
    let outs = ["n1/f.#.exr", "n2/f.#.exr", "n3/f.#.exr"];
    let nodes: Vec<Child> = outs.iter().map(|out| start(here.path(), &["-o", out, "--fields", "fields", "--json"])).collect();
    let mut computed = 0;
    for node in nodes {
        let done = node.wait_with_output().expect("it ends");
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        computed += counts(&String::from_utf8_lossy(&done.stdout))[0];
    }
    assert_eq!(computed, 4);
    for node in ["n1", "n2", "n3"] {
        assert!(files(&at(node)) == files(&at("plain")), "{node}");
    }
    // A lock that a process left behind holds nobody up; one that is held does, also against SIGTERM.
    let name = files(&at("fields")).into_keys().next().expect("a field");
    let lock = at("fields").join(name.replace(".nrrd", ".lock"));
    std::fs::write(&lock, "").expect("a lock");
    std::fs::remove_file(at("fields").join(&name)).expect("removed");
    let (counts, _) = counted(here.path(), &["-o", "b/f.#.exr", "--fields", "fields"]);
    assert_eq!(counts, [1, 6, 0]);
    assert!(!lock.exists());
    let held = std::fs::File::create(&lock).expect("a lock");
    FileExt::lock(&held).expect("locked");
    std::fs::remove_file(at("fields").join(&name)).expect("removed");
    let mut node = start(here.path(), &["-o", "c/f.#.exr", "--fields", "fields", "-v"]);
    let mut lines = BufReader::new(node.stderr.take().expect("stderr")).lines().map_while(Result::ok);
    assert!(lines.any(|l| l.contains("another process computes this field, waiting for it")));
    assert!(Command::new("kill").args(["-TERM", &node.id().to_string()]).status().expect("kill").success());
    assert!(lines.any(|l| l.contains("stopped by SIGTERM")));
    assert_eq!(node.wait().expect("it ends").code(), Some(143));
    let node = start(here.path(), &["-o", "c/f.#.exr", "--fields", "fields"]);
    std::thread::sleep(std::time::Duration::from_secs(1));
    drop(held);
    let done = node.wait_with_output().expect("it ends");
    assert!(done.status.success());
    assert!(files(&at("c")) == files(&at("plain")));
}

#[test]
fn a_folder_that_cannot_be_used_is_one_sentence() {
    let here = there_and_back();
    for (arguments, expected, part) in [
        (&["--fields", "v.nrrd"][..], 3, "v.nrrd: cannot make this folder"),
        (&["--fields", "/proc/fields"], 3, "/proc/fields: cannot make this folder"),
        (&["--fields", "fields", "--no-reuse"], 2, "cannot be used with"),
        (&["--fields", "fields", "--field", "f.nrrd"], 2, "cannot be used with"),
    ] {
        let (code, _, err) = frames(here.path(), &[&["-o", "f.#.png", "--frames", "1"], arguments].concat());
        assert!(code == expected && err.contains(part) && err.lines().count() == 1, "{arguments:?}: {code} {err}");
    }
    // A limit of file sizes stands for a full disk: 960 cells of 16 floats are 60 KiB.
    let script = format!(
        "ulimit -f 16; exec {} frames s.toml -o f.#.png --fields fields --visibility.bands 4 --visibility.ratio 2",
        env!("CARGO_BIN_EXE_halflight")
    );
    let done = Command::new("sh").args(["-c", &script]).current_dir(here.path()).output().expect("sh");
    let err = String::from_utf8(done.stderr).expect("UTF-8");
    assert!(done.status.code() == Some(3) && err.contains("larger than files may become here"), "{err}");
    // No frame's own fault: the others are not begun.
    let out = String::from_utf8_lossy(&done.stdout);
    assert!(out.contains("6 not begun or not finished") && out.contains("failed     1"), "{out}");
    assert!(!here.path().join("fields").exists(), "no half of a field, no lock, and no folder that was made in vain");
}

#[test]
fn a_lock_that_lost_its_name_is_not_taken_for_the_one_that_has_it() {
    let here = there_and_back();
    let at = |name: &str| here.path().join("fields").join(name);
    let one = ["-o", "f.#.exr", "--frames", "1", "--fields", "fields"];
    assert_eq!(counted(here.path(), &one).0, [1, 0, 0]);
    let name = files(&here.path().join("fields")).into_keys().next().expect("a field");
    let (field, lock) = (at(&name), at(&name.replace(".nrrd", ".lock")));
    std::fs::remove_file(&field).expect("removed");
    let hold = || {
        let held = std::fs::File::create(&lock).expect("a lock");
        FileExt::lock(&held).expect("locked");
        held
    };
    let first = hold();
    let mut node = start(here.path(), &[&one[..], &["--json", "-v"]].concat());
    let mut lines = BufReader::new(node.stderr.take().expect("stderr")).lines().map_while(Result::ok);
    assert!(lines.any(|l| l.contains("another process computes this field, waiting for it")));
    // Its holder gives up and takes the file away; a third process has begun meanwhile.
    std::fs::remove_file(&lock).expect("removed");
    let second = hold();
    drop(first);
    std::thread::sleep(std::time::Duration::from_secs(2));
    assert!(node.try_wait().expect("a child").is_none() && !field.exists(), "the field is the third's to compute");
    drop(second);
    let done = node.wait_with_output().expect("it ends");
    assert!(done.status.success());
    assert_eq!(counts(&String::from_utf8_lossy(&done.stdout)), [1, 0, 0]);
    assert!(field.exists() && !lock.exists());
}
