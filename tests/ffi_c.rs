//! The shared library and its headers as programs in C, C++ and Python meet them.
#![cfg(all(feature = "capi", target_os = "linux"))]

use halflight::io::read_picture;
use halflight::scene::{Picture, Samples};
use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// The library that this test's crate was built with.
fn library() -> PathBuf {
    let deps = std::env::current_exe().unwrap().parent().unwrap().to_owned();
    let file = deps.join("libhalflight.so");
    assert!(file.exists(), "{} is not there: the crate's lib lacks crate-type cdylib", file.display());
    file
}

/// A place with headers, library, pkg-config file, the built examples, and a small volume.
struct Place {
    folder: tempfile::TempDir,
}

static PLACE: LazyLock<Place> = LazyLock::new(|| {
    let place = Place { folder: tempfile::tempdir().unwrap() };
    place.install();
    place.make("c", &[]);
    let Samples::U8(bytes) = halflight::demo::volume(N).unwrap().samples().clone() else { panic!("the demo's samples") };
    std::fs::write(place.at("volume.raw"), bytes).unwrap();
    place
});

/// Voxels of the volume along x and y; half of it along z.
const N: usize = 48;

fn volume() -> [String; 4] {
    [PLACE.at("volume.raw").display().to_string(), N.to_string(), N.to_string(), (N / 2).to_string()]
}

impl Place {
    fn at(&self, path: &str) -> PathBuf {
        self.folder.path().join(path)
    }

    /// What `cargo cinstall` would lay, from the library at hand.
    fn install(&self) {
        for folder in ["include", "lib/pkgconfig"] {
            std::fs::create_dir_all(self.at(folder)).unwrap();
        }
        for header in ["halflight.h", "halflight_vulkan.h"] {
            std::fs::copy(Path::new(ROOT).join("include").join(header), self.at("include").join(header)).unwrap();
        }
        std::os::unix::fs::symlink(library(), self.at("lib/libhalflight.so.0")).unwrap();
        std::os::unix::fs::symlink("libhalflight.so.0", self.at("lib/libhalflight.so")).unwrap();
        let prefix = self.folder.path().display();
        let text = format!(
            "prefix={prefix}\nName: halflight\nDescription: d\nVersion: 0.1.0\nLibs: -L${{prefix}}/lib -lhalflight\nCflags: -I${{prefix}}/include\n"
        );
        std::fs::write(self.at("lib/pkgconfig/halflight.pc"), text).unwrap();
    }

    /// Builds the examples with their own Makefile, in a folder of this name.
    fn make(&self, name: &str, variables: &[&str]) {
        std::fs::create_dir_all(self.at(name)).unwrap();
        for file in std::fs::read_dir(Path::new(ROOT).join("examples/c")).unwrap().flatten() {
            std::fs::copy(file.path(), self.at(name).join(file.file_name())).unwrap();
        }
        let out = Command::new("make")
            .args(["-s", "-C"])
            .arg(self.at(name))
            .args(variables)
            .env("PKG_CONFIG_PATH", self.at("lib/pkgconfig"))
            .output()
            .expect("make and pkg-config (Debian: build-essential pkg-config libvulkan-dev)");
        assert!(out.status.success() && out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
    }

    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env("LD_LIBRARY_PATH", self.at("lib"));
        command
    }

    fn run(&self, program: &str, arguments: &[&str]) -> Output {
        let mut command = self.command(self.at(program));
        done(command.args(arguments).env("HOST_DEVICE_VALIDATE", "1"))
    }
}

fn done(command: &mut Command) -> Output {
    let out = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let (said, wrong) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert!(out.status.success(), "{command:?}: {}\n{said}\n{wrong}", out.status);
    out
}

/// Says what could not be looked at, and why, past what the harness keeps to itself.
fn skipped(test: &str, why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED {test}: {why}");
}

fn picture(path: &Path) -> Picture {
    read_picture(path).unwrap_or_else(|e| panic!("{e}")).1
}

fn arguments<'a>(volume: &'a [String; 4], last: &'a str) -> Vec<&'a str> {
    volume.iter().map(String::as_str).chain([last]).collect()
}

#[test]
fn only_the_interface_is_exported() {
    let out = done(Command::new("nm").args(["-D", "--defined-only", "--format=posix"]).arg(library()));
    let text = String::from_utf8(out.stdout).unwrap();
    let names: BTreeSet<&str> = text.lines().filter_map(|l| l.split(' ').next()).collect();
    assert_eq!(names, include_str!("ffi/symbols.txt").lines().collect());
    let out = done(Command::new("readelf").arg("-d").arg(library()));
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("Library soname: [libhalflight.so.0]"), "{text}");
}

#[test]
fn the_commands_crates_are_not_in_the_library() {
    let out = done(Command::new(env!("CARGO")).current_dir(ROOT).args([
        "tree",
        "--offline",
        "--no-default-features",
        "--features",
        "capi",
        "-e",
        "normal",
        "--prefix",
        "none",
    ]));
    let text = String::from_utf8(out.stdout).unwrap();
    let crates: BTreeSet<&str> = text.lines().filter_map(|l| l.split(' ').next()).collect();
    assert!(crates.contains("ash") && crates.contains("png"), "{crates:?}");
    for name in ["clap", "indicatif", "env_logger", "resvg", "base64", "criterion", "cbindgen"] {
        assert!(!crates.contains(name), "{name} is in the library");
    }
}

#[test]
fn examples_build_as_cpp() {
    PLACE.make("cpp", &["CC=g++", "CFLAGS=-x c++ -O1 -Wall -Wextra -Werror"]);
    let (volume, out) = (volume(), PLACE.at("cpp.png"));
    PLACE.run("cpp/minimal", &arguments(&volume, out.to_str().unwrap()));
    assert!(picture(&out).rgba.iter().any(|p| p[3] > 0.5));
}

/// What the command makes of the examples' scene.
#[cfg(feature = "cli")]
fn by_command(name: &str) -> Picture {
    let out = PLACE.at(name);
    let dims = format!("[{N}, {N}, {}]", N / 2);
    done(
        Command::new(env!("CARGO_BIN_EXE_halflight"))
            .arg("render")
            .arg(PLACE.at("volume.raw"))
            .args(["--volume.dims", &dims, "--volume.type", "uint8", "--visibility.method", "sweep", "--visibility.directions", "96"])
            .args(["--image.width", "640", "--image.height", "480", "-o"])
            .arg(&out),
    );
    picture(&out)
}

#[test]
#[cfg(feature = "cli")]
fn a_raw_volume_becomes_the_picture_of_the_command() {
    let (volume, out) = (volume(), PLACE.at("minimal.png"));
    PLACE.run("c/minimal", &arguments(&volume, out.to_str().unwrap()));
    let (theirs, ours) = (by_command("command.png"), picture(&out));
    assert!(ours == theirs && ours.rgba.iter().any(|p| p[3] > 0.5));
    // What goes wrong is a sentence.
    let mut command = PLACE.command(PLACE.at("c/minimal"));
    let failed = command.args(arguments(&volume, "/nowhere/a.png")).output().unwrap();
    let said = String::from_utf8_lossy(&failed.stderr);
    assert!(failed.status.code() == Some(1) && said.contains("no such folder"), "{said}");
}

#[test]
#[cfg(feature = "cli")]
fn a_host_with_its_own_device_gets_the_same_picture() {
    let (volume, out) = (volume(), PLACE.at("host.png"));
    // Its validation layer has nothing to say, or it fails.
    let said = PLACE.run("c/host_device", &arguments(&volume, out.to_str().unwrap()));
    assert!(said.stderr.is_empty(), "{}", String::from_utf8_lossy(&said.stderr));
    assert!(picture(&out) == by_command("command_host.png"));
}

#[test]
fn pictures_get_better_and_lights_turn() {
    let (volume, folder) = (volume(), PLACE.at("progressive"));
    std::fs::create_dir_all(&folder).unwrap();
    let out = PLACE.run("c/progressive", &arguments(&volume, folder.to_str().unwrap()));
    let said = String::from_utf8_lossy(&out.stdout);
    println!("{said}");
    assert!(said.contains("pass of 128 directions") && said.contains("classify 0 %") && said.contains("sweep 100 %"), "{said}");
    let all: Vec<Picture> = ["pass-0", "pass-1", "edited-0", "light-0", "light-1", "light-3"]
        .map(|name| picture(&folder.join(name).with_extension("png")))
        .into();
    for (i, a) in all.iter().enumerate() {
        assert!(all[i + 1..].iter().all(|b| a != b) || i == 2, "picture {i} has a twin");
    }
    // The edit came before the light turned.
    assert!(all[2] == all[3]);
}

/// Builds the examples with AddressSanitizer, in a folder of this name.
fn sanitized(name: &str) {
    // Modules stay loaded: what a driver keeps is then still its own, and what leaks has a name.
    let keep = "int dlclose(void *module);\nint dlclose(void *module) { (void)module; return 0; }\n";
    std::fs::write(PLACE.at("keep.c"), keep).unwrap();
    let flags = format!(
        "CFLAGS=-std=c99 -g -O1 -Wall -Wextra -Werror -fsanitize=address -fno-omit-frame-pointer -rdynamic {}",
        PLACE.at("keep.c").display()
    );
    PLACE.make(name, &[&flags]);
}

/// A program that says at its end what it left behind; what the driver leaves behind is its own affair.
fn watched(program: &str, libraries: &Path) -> Command {
    let driver = "leak:libvulkan_lvp\nleak:libLLVM\nleak:libvulkan.so\n";
    std::fs::write(PLACE.at("suppressions"), driver).unwrap();
    let mut command = Command::new(PLACE.at(program));
    command.env("LD_LIBRARY_PATH", libraries).env("ASAN_OPTIONS", "detect_leaks=1");
    command.env("LSAN_OPTIONS", format!("suppressions={}:print_suppressions=0", PLACE.at("suppressions").display()));
    command
}

/// Runs all examples of a folder against a library.
fn all_watched(name: &str, libraries: &Path) {
    let volume = volume();
    for (program, last) in [("minimal", "asan.png"), ("progressive", ""), ("host_device", "asan_host.png")] {
        done(watched(&format!("{name}/{program}"), libraries).args(arguments(&volume, PLACE.at(name).join(last).to_str().unwrap())));
    }
}

#[test]
fn no_memory_is_misused_or_leaked() {
    sanitized("asan");
    all_watched("asan", &PLACE.at("lib"));
    // Sabotage: what is left behind is seen.
    let code = "#include <halflight.h>\n#include <stdlib.h>\nint main(void) { char *p = malloc(7); p = NULL; return hl_engine_destroy(0) + (p != 0); }\n";
    std::fs::write(PLACE.at("asan/leaky.c"), code).unwrap();
    let mut build = Command::new("cc");
    build.args(["-O0", "-fsanitize=address", "-rdynamic"]).arg(PLACE.at("keep.c")).arg("-I").arg(PLACE.at("include"));
    build.arg(PLACE.at("asan/leaky.c")).arg("-L").arg(PLACE.at("lib"));
    done(build.args(["-lhalflight", "-o"]).arg(PLACE.at("asan/leaky")));
    let leaky = watched("asan/leaky", &PLACE.at("lib")).output().unwrap();
    assert!(!leaky.status.success() && String::from_utf8_lossy(&leaky.stderr).contains("7 byte"), "{leaky:?}");
}

/// As above, with the library's own code instrumented, too, which only a nightly compiler can:
/// `cargo test --release --test ffi_c -- --ignored --nocapture instrumented`
#[test]
#[ignore = "needs a nightly Rust (rustup toolchain install nightly) and builds the library anew, which takes minutes"]
fn the_instrumented_library_misuses_and_leaks_nothing() {
    let target = "x86_64-unknown-linux-gnu";
    let mut build = Command::new("rustup");
    build.current_dir(ROOT).args(["run", "nightly", "cargo", "build", "--release", "--lib", "--no-default-features", "--features", "capi"]);
    build.args(["--target", target, "--target-dir", "target/asan"]).env("RUSTFLAGS", "-Zsanitizer=address");
    done(build.env_remove("CARGO").env_remove("RUSTUP_TOOLCHAIN"));
    let libraries = PLACE.at("instrumented");
    std::fs::create_dir_all(&libraries).unwrap();
    let built = Path::new(ROOT).join("target/asan").join(target).join("release/libhalflight.so");
    let out = done(Command::new("nm").args(["-D", "--undefined-only"]).arg(&built));
    assert!(String::from_utf8_lossy(&out.stdout).contains("__asan_report_load"), "the library is not instrumented");
    std::os::unix::fs::symlink(built, libraries.join("libhalflight.so.0")).unwrap();
    sanitized("asan_all");
    all_watched("asan_all", &libraries);
    // Sabotage: samples that are not there are read by the library, and seen. The plain library does not notice.
    let text = std::fs::read_to_string(PLACE.at("asan_all/minimal.c")).unwrap();
    let short = text.replace("malloc(size);", "malloc(size + 1);").replace("volume_info.data = data;", "volume_info.data = data + 2;");
    assert_ne!(short, text);
    std::fs::write(PLACE.at("asan_all/short.c"), short).unwrap();
    let flags = format!("CFLAGS=-std=c99 -g -O1 -fsanitize=address -rdynamic {}", PLACE.at("keep.c").display());
    let mut make = Command::new("make");
    make.args(["-s", "-C"]).arg(PLACE.at("asan_all")).args(["short", &flags]).env("PKG_CONFIG_PATH", PLACE.at("lib/pkgconfig"));
    done(&mut make);
    let (volume, out) = (volume(), PLACE.at("short.png"));
    let run = |libraries: &Path| watched("asan_all/short", libraries).args(arguments(&volume, out.to_str().unwrap())).output().unwrap();
    let (plain, seen) = (run(&PLACE.at("lib")), run(&libraries));
    assert!(plain.status.success(), "{plain:?}");
    assert!(!seen.status.success() && String::from_utf8_lossy(&seen.stderr).contains("heap-buffer-overflow"), "{seen:?}");
}

#[test]
fn valgrind_has_nothing_to_say() {
    if Command::new("valgrind").arg("--version").output().is_err() {
        return skipped("valgrind_has_nothing_to_say", "valgrind is not here (Debian: valgrind)");
    }
    // A small picture: the driver's compiler alone takes a minute here.
    let text = std::fs::read_to_string(PLACE.at("c/minimal.c")).unwrap();
    let small = text.replace("= 640;", "= 24;").replace("= 480;", "= 18;").replace("directions = 96", "directions = 32");
    assert_ne!(small, text);
    std::fs::write(PLACE.at("c/small.c"), small).unwrap();
    PLACE.make("c", &["PROGRAMS=small"]);
    // The C library's loader reads the search path of a driver's libraries eight bytes at a time.
    let loader = "{\n  loader\n  Memcheck:Addr8\n  fun:strncmp\n  fun:is_dst\n  ...\n}\n";
    std::fs::write(PLACE.at("loader.supp"), loader).unwrap();
    let valgrind = || {
        let mut command = PLACE.command("valgrind");
        command.args(["-q", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=definite", "--errors-for-leak-kinds=definite"]);
        command.arg(format!("--suppressions={}", PLACE.at("loader.supp").display()));
        command
    };
    let mut command = valgrind();
    std::fs::write(PLACE.at("small.raw"), [0, 90, 200, 30].repeat(1024)).unwrap();
    command.arg(PLACE.at("c/small")).arg(PLACE.at("small.raw")).args(["16", "16", "16"]).arg(PLACE.at("valgrind.png"));
    let out = done(&mut command);
    assert!(out.stderr.is_empty(), "{}", String::from_utf8_lossy(&out.stderr));
    // Sabotage: samples that are not there are seen to be read.
    let text = std::fs::read_to_string(PLACE.at("c/small.c")).unwrap();
    let short = text.replace("volume_info.data = data;", "volume_info.data = data + 8;");
    assert_ne!(short, text);
    std::fs::write(PLACE.at("c/short.c"), short).unwrap();
    PLACE.make("c", &["PROGRAMS=short"]);
    let mut command = valgrind();
    command.arg(PLACE.at("c/short")).arg(PLACE.at("small.raw")).args(["16", "16", "16"]).arg(PLACE.at("valgrind.png"));
    let out = command.output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(9) && said.contains("Invalid read") && said.contains("hl_volume_create"), "{said}");
}

#[test]
fn numpy_sees_the_picture() {
    let python = [std::env::var("PYTHON").unwrap_or_default(), format!("{ROOT}/.venv/bin/python3"), "python3".into()]
        .into_iter()
        .find(|p| Command::new(p).args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success()));
    // Without numpy the example says what is missing.
    match Command::new("python3").args(["-S", &format!("{ROOT}/examples/python/halflight_numpy.py")]).output() {
        Ok(out) => {
            let said = String::from_utf8_lossy(&out.stderr);
            assert!(out.status.code() == Some(1) && said.contains("numpy is not there"), "{said}");
        }
        Err(_) => return skipped("numpy_sees_the_picture", "no python3 is here (Debian: python3 python3-numpy)"),
    }
    let Some(python) = python else {
        return skipped("numpy_sees_the_picture", "python3 has no numpy (Debian: python3-numpy; or name another with PYTHON=)");
    };
    let out = done(
        PLACE
            .command(python)
            .arg(format!("{ROOT}/examples/python/halflight_numpy.py"))
            .arg(PLACE.at("numpy.png"))
            .env("LIBHALFLIGHT", PLACE.at("lib/libhalflight.so.0")),
    );
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(said.starts_with("(240, 320, 4) float32 coverage 0."), "{said}");
    assert!(picture(&PLACE.at("numpy.png")).rgba.iter().any(|p| p[3] > 0.5));
}

#[test]
fn cargo_c_installs_what_a_host_needs() {
    if !Command::new(env!("CARGO")).args(["cinstall", "--version"]).output().is_ok_and(|o| o.status.success()) {
        return skipped("cargo_c_installs_what_a_host_needs", "cargo-c is not here (cargo install cargo-c)");
    }
    let prefix = tempfile::tempdir().unwrap();
    let mut install = Command::new(env!("CARGO"));
    install.current_dir(ROOT).args(["cinstall", "--release", "--no-default-features", "--libdir=lib", "--prefix"]).arg(prefix.path());
    done(&mut install);
    for file in
        ["include/halflight.h", "include/halflight_vulkan.h", "lib/libhalflight.so.0", "lib/libhalflight.a", "lib/pkgconfig/halflight.pc"]
    {
        assert!(prefix.path().join(file).exists(), "{file} is not there");
    }
    let installed = prefix.path().join("lib/libhalflight.so.0");
    let out = done(Command::new("nm").args(["-D", "--defined-only", "--format=posix"]).arg(&installed));
    let text = String::from_utf8(out.stdout).unwrap();
    let names: BTreeSet<&str> = text.lines().filter_map(|l| l.split(' ').next()).collect();
    assert_eq!(names, include_str!("ffi/symbols.txt").lines().collect());
    let packages = prefix.path().join("lib/pkgconfig");
    let out = done(Command::new("pkg-config").args(["--modversion", "halflight"]).env("PKG_CONFIG_PATH", &packages));
    assert_eq!(String::from_utf8_lossy(&out.stdout).trim(), env!("CARGO_PKG_VERSION"));
    // All examples, by their own Makefile, as C and as C++; each says and writes what it should.
    let volume = volume();
    let mut pictures = Vec::new();
    for (name, variables) in [("c", &[][..]), ("cpp", &["CC=g++", "CFLAGS=-x c++ -O1 -Wall -Wextra -Werror"])] {
        let build = prefix.path().join(name);
        std::fs::create_dir(&build).unwrap();
        for file in std::fs::read_dir(Path::new(ROOT).join("examples/c")).unwrap().flatten() {
            std::fs::copy(file.path(), build.join(file.file_name())).unwrap();
        }
        done(Command::new("make").args(["-s", "-C"]).arg(&build).args(variables).env("PKG_CONFIG_PATH", &packages));
        for (program, last) in [("minimal", "minimal.png"), ("progressive", ""), ("host_device", "host.png")] {
            let out = build.join(last);
            let mut run = Command::new(build.join(program));
            run.args(arguments(&volume, out.to_str().unwrap())).env("HOST_DEVICE_VALIDATE", "1");
            let said = done(run.env("LD_LIBRARY_PATH", prefix.path().join("lib")));
            assert!(said.stderr.is_empty(), "{}", String::from_utf8_lossy(&said.stderr));
        }
        pictures.extend(["minimal.png", "host.png"].map(|p| picture(&build.join(p))));
        // Blue, as the transfer function was edited to be.
        assert!(picture(&build.join("light-5.png")).rgba.iter().any(|p| p[2] > 0.2 && p[2] > 2.0 * p[0]));
    }
    assert!(pictures.iter().all(|p| *p == pictures[0]) && pictures[0].rgba.iter().any(|p| p[3] > 0.5));
    // The static library, with what pkg-config says that it needs.
    let flags = done(Command::new("pkg-config").args(["--static", "--libs", "--cflags", "halflight"]).env("PKG_CONFIG_PATH", &packages));
    let flags = String::from_utf8(flags.stdout).unwrap().replace("-lhalflight", "-l:libhalflight.a");
    let mut build = Command::new("cc");
    build.arg(prefix.path().join("c/minimal.c")).args(flags.split_whitespace()).arg("-o").arg(prefix.path().join("static"));
    done(&mut build);
    let out = prefix.path().join("static.png");
    done(Command::new(prefix.path().join("static")).args(arguments(&volume, out.to_str().unwrap())));
    assert!(picture(&out) == pictures[0]);
    // To be looked at.
    if let Some(keep) = std::env::var_os("KEEP") {
        done(Command::new("cp").arg("-r").arg(prefix.path()).arg(keep));
    }
}
