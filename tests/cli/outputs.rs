//! Where outputs go, and what is left when something fails.

use super::*;

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
        (["render", "v.nrrd", "-o", "v.nrrd/x.png"], "v.nrrd: cannot make this folder: there is a file of that name"),
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
fn a_folder_that_is_missing_is_made_and_goes_again_where_nothing_is_written() {
    let f = Folder::new("missing");
    f.volume();
    grey(&f);
    f.file("s.toml", "[volume]\nfile = 'v.nrrd'\n[surface]\niso = 99");
    // `fails` sees that nothing is left.
    fails(&f, &["render", "s.toml", "-o", "no/such/x.png"], 3, "`surface.iso` is 99, outside the data's range");
    fails(&f, &["precompute", "s.toml", "-o", "no/such/x.nrrd"], 3, "`surface.iso` is 99");
    fails(&f, &["light", "v.nrrd", "-o", "no/such/x.png"], 3, "v.nrrd");
    let made = |arguments: &[&str], file: &str| {
        let out = halflight(&f.0, arguments);
        assert!(out.status.success() && f.0.join(file).is_file(), "{arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
    };
    made(&["light", "grey.hdr", "-o", "a/b/x.png"], "a/b/x.png");
    made(&["compare", "a/b/x.png", "a/b/x.png", "-o", "c/d.png"], "c/d.png");
    made(&["info", "v.nrrd", "--plot", "h/h.svg"], "h/h.svg");
    if device() {
        made(&["render", "v.nrrd", "-o", "r/s/x.exr", "--image.width", "8", "--image.height", "8"], "r/s/x.exr");
        made(&["precompute", "v.nrrd", "-o", "p/x.nrrd"], "p/x.nrrd");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_picture_that_main_memory_does_not_hold_is_refused() {
    let f = Folder::new("room");
    f.file("v.nrrd", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: ascii\n\n0 1 2 3 4 5 6 7\n");
    // 16384 pixels a side are 4 GiB.
    let sized = |side: &str| {
        let script = format!(
            "ulimit -v 4000000; exec {} render v.nrrd -o o.png --image.width {side} --image.height {side}",
            env!("CARGO_BIN_EXE_halflight")
        );
        Command::new("sh").args(["-c", &script]).current_dir(&f.0).output().unwrap()
    };
    let out = sized("16384");
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(5), "{stderr}");
    assert!(stderr.contains("a picture needs 4.0 GiB of main memory, which the system does not give"), "{stderr}");
    assert!(!f.0.join("o.png").exists());
    // Sabotage: a small picture is rendered under the same limit.
    assert_eq!(sized("16").status.code(), Some(0));
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
