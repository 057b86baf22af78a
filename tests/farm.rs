//! The farm files: chunks give the same bits, a lost device (exit code 6) is tried again, other codes are passed on, signals
//! end a task in order. Open Job Description is also run by its own command where that is installed.
#![cfg(all(feature = "cli", unix))]

mod common;
use common::sequence::*;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const HALFLIGHT: &str = env!("CARGO_BIN_EXE_halflight");
const TEMPLATE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/farm/halflight.openjd.yaml");
const SLURM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/farm/slurm_array.sh");

/// An executable script in a folder; its path.
fn script(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, format!("#!/bin/sh\n{text}")).expect("a script");
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("executable");
    path.display().to_string()
}

/// Stands in for the command: writes down its arguments, loses its device on the first `lost` calls for the same arguments, then
/// is the command, or ends with `code`.
fn loses_its_device(folder: &Path, lost: usize, code: Option<i32>) -> String {
    let log = folder.join("calls").display().to_string();
    let last = code.map_or(format!("exec {HALFLIGHT} \"$@\""), |code| format!("exit {code}"));
    let text = format!("echo \"$*\" >> {log}\n[ $(grep -cxF -e \"$*\" {log}) -gt {lost} ] || exit 6\n{last}\n");
    script(folder, "stand_in", &text)
}

fn calls(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join("calls")).unwrap_or_default();
    let _ = std::fs::remove_file(folder.join("calls"));
    text.lines().map(str::to_owned).collect()
}

fn said(done: &Output) -> String {
    String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr)
}

/// The template's script of a step, its parameters put in as Open Job Description would.
fn step(place: usize, parameters: &[(&str, &str)]) -> String {
    let template = std::fs::read_to_string(TEMPLATE).expect("the template");
    let block = template.split("data: |\n").nth(place + 1).expect("a script");
    let lines = block.lines().take_while(|l| l.is_empty() || l.starts_with("            "));
    let mut text = lines.map(|l| l.get(12..).unwrap_or_default()).collect::<Vec<_>>().join("\n");
    let defaults = [("Param.Field", ""), ("Param.Fields", ""), ("Param.Arguments", ""), ("Param.Tries", "3")];
    for (name, value) in parameters.iter().chain(&defaults) {
        text = text.replace(&format!("{{{{{name}}}}}"), value);
    }
    assert!(!text.contains("{{"), "{text}");
    text
}

fn bash(folder: &Path, text: &str) -> Output {
    Command::new("bash").args(["-c", text]).current_dir(folder).output().expect("bash")
}

#[test]
fn the_template_tries_again_what_lost_its_device_and_nothing_else() {
    let here = folder();
    let field = |command: &str, more: &[(&str, &str)]| {
        let parameters = [&[("Param.Scene", "s.toml"), ("Param.Field", "field.nrrd"), ("Param.Halflight", command)], more].concat();
        bash(here.path(), &step(0, &parameters))
    };
    let chunk = |command: &str, out: &str, more: &[(&str, &str)]| {
        let parameters =
            [&[("Param.Scene", "s.toml"), ("Param.Output", out), ("Task.Param.Frame", "1-2"), ("Param.Halflight", command)], more];
        bash(here.path(), &step(1, &parameters.concat()))
    };
    let (code, ..) = frames(here.path(), &["-o", "whole/f.##.exr", "--frames", "1-2"]);
    assert_eq!(code, 0);
    for lost in [0, 1, 2] {
        let command = loses_its_device(here.path(), lost, None);
        let out = format!("lost{lost}/f.##.exr");
        let done = chunk(&command, &out, &[("Param.Arguments", "--fields fields")]);
        assert_eq!(done.status.code(), Some(0), "{}", said(&done));
        assert_eq!(said(&done).matches("openjd_status: the device was lost, try ").count(), lost, "{}", said(&done));
        let calls = calls(here.path());
        assert_eq!(calls.len(), lost + 1);
        assert_eq!(calls[0], format!("frames s.toml -o {out} --frames 1-2 --skip-existing --progress openjd --fields fields"));
        assert!(files(&here.path().join(format!("lost{lost}"))) == files(&here.path().join("whole")));
        let done = field(&loses_its_device(here.path(), lost, Some(0)), &[]);
        assert_eq!((done.status.code(), self::calls(here.path()).len()), (Some(0), lost + 1), "{}", said(&done));
    }
    // It stays lost: so many tries, and its own code.
    let command = loses_its_device(here.path(), 99, None);
    for tries in ["1", "2", "3"] {
        let done = chunk(&command, "none/f.##.exr", &[("Param.Tries", tries)]);
        assert_eq!((done.status.code(), calls(here.path()).len().to_string()), (Some(6), tries.to_owned()));
        let done = field(&command, &[("Param.Tries", tries)]);
        assert_eq!((done.status.code(), calls(here.path()).len().to_string()), (Some(6), tries.to_owned()));
        assert!(said(&done).contains("openjd_fail: halflight precompute ended with code 6"), "{}", said(&done));
    }
    // What would fail again is not tried again.
    for code in [1, 2, 3, 4, 5] {
        let command = loses_its_device(here.path(), 0, Some(code));
        assert_eq!((chunk(&command, "none/f.##.exr", &[]).status.code(), calls(here.path()).len()), (Some(code), 1));
        assert_eq!((field(&command, &[]).status.code(), calls(here.path()).len()), (Some(code), 1));
    }
    // Without a field of its own, its step has nothing to do.
    let command = loses_its_device(here.path(), 0, None);
    let done = bash(here.path(), &step(0, &[("Param.Scene", "s.toml"), ("Param.Halflight", &command)]));
    assert_eq!((done.status.code(), calls(here.path()).len()), (Some(0), 0));
}

/// Starts bash, sends it `signal` once `file` is there, and hands over its end.
fn interrupted(mut command: Command, file: &Path) -> Output {
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let start = std::time::Instant::now();
    while !file.exists() && start.elapsed().as_secs() < 60 {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill").success());
    child.wait_with_output().expect("it ends")
}

#[test]
fn a_stopped_task_keeps_its_frames_and_goes_on_later() {
    let here = folder();
    let at = |name: &str| here.path().join(name);
    let (code, ..) = frames(here.path(), &["-o", "whole/f.##.exr"]);
    assert_eq!(code, 0);
    // Open Job Description.
    let slow = script(here.path(), "slow", &format!("exec {HALFLIGHT} \"$@\" --no-reuse\n"));
    let text =
        step(1, &[("Param.Scene", "s.toml"), ("Param.Output", "jd/f.##.exr"), ("Task.Param.Frame", "1-8"), ("Param.Halflight", &slow)]);
    let mut command = Command::new("bash");
    command.args(["-c", &text]).current_dir(here.path());
    let done = interrupted(command, &at("jd/f.01.exr"));
    assert_eq!(done.status.code(), Some(143), "{}", said(&done));
    assert!(said(&done).contains("openjd_fail: stopped by SIGTERM; finished frames are kept"), "{}", said(&done));
    let kept = files(&at("jd"));
    assert!(!kept.is_empty() && kept.len() < 8 && kept.keys().all(|k| k.starts_with("f.")));
    assert_eq!(bash(here.path(), &text).status.code(), Some(0));
    assert!(files(&at("jd")) == files(&at("whole")));
    // SLURM puts the task back into the queue.
    script(here.path(), "scontrol", &format!("echo \"$*\" >> {}\n", at("calls").display()));
    let task = || {
        let mut command = slurm(here.path(), "0", &["s.toml", "sl/f.##.exr", "1", "8"]);
        command.envs([("CHUNK", "8"), ("HALFLIGHT", &slow), ("SLURM_JOB_ID", "77")]);
        command.env("PATH", format!("{}:{}", here.path().display(), std::env::var("PATH").unwrap_or_default()));
        command
    };
    let done = interrupted(task(), &at("sl/f.01.exr"));
    assert_eq!(done.status.code(), Some(143), "{}", said(&done));
    assert_eq!(calls(here.path()), ["requeue 77"]);
    assert!(files(&at("sl")).len() < 8);
    let done = task().output().expect("bash");
    assert!(done.status.success() && said(&done).contains("were whole already"), "{}", said(&done));
    assert!(files(&at("sl")) == files(&at("whole")) && calls(here.path()).is_empty());
}

/// A task of the array, as SLURM would run it.
fn slurm(folder: &Path, task: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("bash");
    command.arg(SLURM).args(arguments).current_dir(folder);
    command.envs([("SLURM_ARRAY_TASK_ID", task), ("SLURM_CPUS_PER_TASK", "2"), ("HALFLIGHT", HALFLIGHT)]);
    command
}

#[test]
fn the_tasks_of_a_slurm_array_render_the_list_and_try_again_what_lost_its_device() {
    let here = folder();
    let (code, ..) = frames(here.path(), &["-o", "whole/f.####.exr"]);
    assert_eq!(code, 0);
    let task = |n: &str, out: &str, more: &[(&str, &str)]| {
        let mut command = slurm(here.path(), n, &["s.toml", out, "1", "8"]);
        command.env("CHUNK", "3").envs(more.iter().copied()).output().expect("bash")
    };
    for (n, lost) in [("0", 0), ("1", 1), ("2", 2)] {
        let command = loses_its_device(here.path(), lost, None);
        let done = task(n, "out/f.####.exr", &[("HALFLIGHT", &command), ("FIELDS", "fields")]);
        assert_eq!(done.status.code(), Some(0), "{}", said(&done));
        assert_eq!(said(&done).matches("the device was lost, try ").count(), lost);
        let (calls, range) = (calls(here.path()), ["1-3", "4-6", "7-8"][n.parse::<usize>().expect("a number")]);
        assert_eq!(calls.len(), lost + 1);
        let expected = "frames s.toml -o out/f.####.exr --frames RANGE --skip-existing --progress lines --threads 2 --fields fields";
        assert_eq!(calls[0], expected.replace("RANGE", range));
    }
    assert!(files(&here.path().join("out")) == files(&here.path().join("whole")));
    // Beyond the list there is nothing to do.
    let command = loses_its_device(here.path(), 0, None);
    assert_eq!((task("3", "out/f.####.exr", &[("HALFLIGHT", &command)]).status.code(), calls(here.path()).len()), (Some(0), 0));
    let command = loses_its_device(here.path(), 99, None);
    let done = task("0", "none/f.####.exr", &[("HALFLIGHT", &command), ("TRIES", "2")]);
    assert_eq!((done.status.code(), calls(here.path()).len()), (Some(6), 2));
    let command = loses_its_device(here.path(), 0, Some(5));
    let done = task("0", "none/f.####.exr", &[("HALFLIGHT", &command)]);
    assert_eq!((done.status.code(), calls(here.path()).len()), (Some(5), 1));
}

/// Runs the template by `openjd run`; `None` where that is not installed.
fn openjd(folder: &Path, parameters: &[(&str, &str)]) -> Option<(bool, String)> {
    let program = std::env::var_os("OPENJD").map_or("openjd".into(), std::path::PathBuf::from);
    if !Command::new(&program).arg("--version").output().is_ok_and(|o| o.status.success()) {
        println!("skipped: `openjd` is not installed (pip install openjd-cli; or name it in OPENJD)");
        return None;
    }
    let mut command = Command::new(&program);
    command.args(["run", TEMPLATE, "--step", "Frames", "--run-dependencies"]);
    for (name, value) in parameters {
        command.args(["-p", &format!("{name}={value}")]);
    }
    let done = command.current_dir(folder).output().expect("openjd");
    Some((done.status.success(), said(&done)))
}

#[test]
fn open_job_description_runs_the_template_in_chunks() {
    let here = folder();
    let (code, ..) = frames(here.path(), &["-o", "whole/f.####.exr"]);
    assert_eq!(code, 0);
    let at = |name: &str| here.path().join(name).display().to_string();
    let job = |scene: &str, command: &str, more: &[(&str, &str)]| {
        let (scene, out) = (at(scene), at("farm/f.####.exr"));
        let parameters = [("Scene", scene.as_str()), ("Output", &out), ("Frames", "1-8"), ("ChunkSize", "3"), ("Halflight", command)];
        openjd(here.path(), &[&parameters[..], more].concat())
    };
    let Some((good, log)) = job("s.toml", HALFLIGHT, &[]) else { return };
    assert!(good, "{log}");
    assert!(log.contains("openjd_progress: 100.0") && log.contains("openjd_status: frame "), "{log}");
    let whole = files(&here.path().join("whole"));
    assert!(files(&here.path().join("farm")) == whole);
    // What fails, fails the job.
    let (good, log) = job("none.toml", HALFLIGHT, &[]).expect("openjd");
    assert!(!good && log.contains("openjd_fail: ") && log.contains("no such file"), "{log}");
    // Every chunk loses its device once.
    std::fs::remove_dir_all(here.path().join("farm")).expect("removed");
    let command = loses_its_device(here.path(), 1, None);
    let (good, log) = job("s.toml", &command, &[("Fields", &at("fields"))]).expect("openjd");
    assert!(good && log.matches("openjd_status: the device was lost, try 1").count() >= 3, "{log}");
    assert_eq!(calls(here.path()).len(), 6);
    assert!(files(&here.path().join("farm")) == whole);
    // And one that never comes back fails the job with its code.
    let command = loses_its_device(here.path(), 99, None);
    let (good, log) = job("s.toml", &command, &[("Tries", "2")]).expect("openjd");
    assert!(!good && log.contains("code: 6") && calls(here.path()).len() == 2, "{log}");
}
