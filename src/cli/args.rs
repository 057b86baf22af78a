//! What the command line may say. The options for a scene's keys come from the library's table of keys.

use clap::{Arg, ArgAction, ArgMatches, Command, value_parser};
use halflight::scene::keys::{self, KEYS, Key};
use std::path::PathBuf;

/// What `light` uses of a scene.
pub const OF_LIGHT: &[&str] = &["light.rotate", "light.scale", "light.bands", "light.window", "image.exposure"];

/// What a visibility field depends on.
pub const OF_FIELD: &[&str] = &["volume", "transfer", "surface", "clip", "visibility"];

/// What a volume alone depends on.
pub const OF_VOLUME: &[&str] = &["volume"];

/// All of a scene.
pub const OF_SCENE: &[&str] = &["volume", "transfer", "surface", "clip", "light", "visibility", "camera", "image"];

/// All of a scene and its animation.
pub const OF_FRAMES: &[&str] = &["volume", "transfer", "surface", "clip", "light", "visibility", "camera", "image", "animation"];

/// What a chart uses: the estimators' own settings are what it varies.
pub const OF_CHART: &[&str] = &["volume", "transfer", "surface", "light", "visibility.ratio", "camera", "image"];

/// What a reference picture depends on.
pub const OF_REFERENCE: &[&str] =
    &["volume", "transfer", "surface", "clip", "light.probe", "light.constant", "light.rotate", "light.scale", "camera", "image"];

/// The whole command.
pub fn command() -> Command {
    Command::new("halflight")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Natural light for scalar volumes: visibility in spherical harmonics, precomputed on any Vulkan device")
        .after_help(
            "Exit codes: 0 done, 1 internal error or validation messages, 2 wrong usage, 3 bad input or output file, \
             4 no usable device, 5 out of memory, 6 device lost, 130 and 143 stopped by a signal.",
        )
        .subcommand_required(true)
        .arg_required_else_help(true)
        .args(global())
        .subcommand(
            Command::new("demo")
                .about("Light a made-up machine part with a made-up sky: a translucent and an opaque picture, no files needed")
                .arg(path("out", "DIR", "where the pictures go").short('o').long("out").default_value("halflight-demo"))
                .arg(Arg::new("quick").long("quick").action(ArgAction::SetTrue).help("coarser field, smaller pictures")),
        )
        .subcommand(
            Command::new("info")
                .about("Describe a volume, a light probe, a visibility field or a scene")
                .arg(
                    path(
                        "file",
                        "FILE",
                        "volume (NRRD, NIfTI, MetaImage, VTK, TIFF, PNG, DICOM file or folder, 'slice_####.tif', headerless), probe \
                         (.hdr, .exr), field (.nrrd), or scene (.toml)",
                    )
                    .required(true),
                )
                .arg(
                    path("plot", "FILE", "also draw a volume's histogram, and a first guess of a transfer function (.png or .svg)")
                        .long("plot"),
                )
                .args(scene_args(OF_SCENE))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("light")
                .about("Project a light probe to spherical harmonics and print them")
                .arg(path("probe", "PROBE", "lat-long probe, .hdr or .exr").required(true))
                .arg(path("out", "FILE", "also draw the probe and, right of it, its projection (.png or .exr)").short('o').long("out"))
                .args(scene_args(OF_LIGHT)),
        )
        .subcommand(
            Command::new("transfer")
                .about("List the transfer functions in another program's file, or convert them and say what is lost")
                .arg(
                    path("in", "FILE", "ParaView or NiiVue .json, Slicer .xml or .vp, Voreen .tfi or .tfg, Inviwo .itf, ImageVis3D .1dt")
                        .required(true),
                )
                .arg(path("out", "FILE", "what to write: .json, .xml, .vp, .tfi, .itf or .1dt").short('o').long("out"))
                .arg(
                    Arg::new("preset")
                        .long("preset")
                        .value_name("NAME")
                        .help("one preset of a file that holds several (without: all, where the output holds several)"),
                )
                .arg(
                    Arg::new("range")
                        .long("range")
                        .value_name("LOW,HIGH")
                        .value_parser(parse_range)
                        .allow_hyphen_values(true)
                        .requires("out")
                        .help("scalars that the preset's ends are laid on"),
                )
                .arg(
                    Arg::new("list")
                        .long("list")
                        .action(ArgAction::SetTrue)
                        .conflicts_with("out")
                        .help("only name the presets, one a line"),
                ),
        )
        .subcommand(
            Command::new("precompute")
                .about("Compute a scene's visibility field and write its coefficients")
                .arg(scene())
                .arg(path("out", "FILE", "the field (.nrrd)").short('o').long("out").required(true))
                .arg(measure("60", "measure the field's error against a dense reference, in about so many seconds of device time at most [60]"))
                .arg(frame())
                .args(wanted())
                .args(scene_args(OF_FIELD))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("render")
                .about("Render a scene")
                .arg(scene())
                .arg(path("out", "FILE", "the picture: .exr (linear) or .png (sRGB)").short('o').long("out").required(true))
                .arg(frame())
                .arg(field())
                .args(wanted())
                .arg(
                    measure("20", "measure the picture's error at fewer of its pixels against Monte Carlo without harmonics, in about so many seconds [20]")
                        .conflicts_with("reference"),
                )
                .args(reference())
                .args(scene_args(OF_SCENE))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("frames")
                .about("Render a scene's animation as numbered pictures")
                .arg(scene())
                .arg(path("out", "FILE", "the pictures: out/f.####.exr or f.%04d.png").short('o').long("out").required(true))
                .args(super::layers::args())
                .arg(
                    Arg::new("frames")
                        .long("frames")
                        .value_name("RANGE")
                        .allow_hyphen_values(true)
                        .help("7, 1-100, 1-100x2, 1-100:2, 1:100:5, 100-1, or several with commas: 5,10,20-24 (default: all)"),
                )
                .arg(flag("skip-existing", "keep pictures that are there, whole and of this scene"))
                .arg(flag("quick", "preview: small pictures, a coarse field of few directions"))
                .arg(flag("estimate", "render a few of the frames and say what all of them will cost"))
                .arg(flag("no-reuse", "compute everything anew for each frame; the pictures are the same"))
                .arg(field())
                .arg(
                    Arg::new("progress")
                        .long("progress")
                        .value_name("HOW")
                        .value_parser(["auto", "tty", "lines", "openjd", "json", "none"])
                        .default_value("auto")
                        .help("a bar, a line per frame, what Open Job Description listens to, or JSON lines"),
                )
                .args(scene_args(OF_FRAMES))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("chart")
                .about("Chart speed against accuracy of every estimator on your scenes: a folder with report.html")
                .arg(
                    path("scenes", "SCENE", "scene files (.toml), or volumes to show with default settings; none: a built-in scene")
                        .num_args(0..),
                )
                .arg(path("out", "DIR", "where the report goes").short('o').long("out").required(true))
                .arg(Arg::new("quick").long("quick").action(ArgAction::SetTrue).help("under a minute: fewer settings, fewer probes"))
                .arg(
                    Arg::new("budget")
                        .long("budget")
                        .value_name("SECONDS")
                        .value_parser(parse_seconds)
                        .help("time for all scenes together (default: 540, with --quick 48)"),
                )
                .arg(path("record", "DIR", "also write a record of the run there, named by date and device").long("record"))
                .args(scene_args(OF_CHART))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("compare")
                .about("Compare a picture with a reference: relative RMSE and FLIP")
                .arg(path("picture", "PICTURE", "the picture, .exr (linear) or .png").required(true))
                .arg(path("reference", "REFERENCE", "what it should be: of the same kind and size").required(true))
                .arg(
                    path("out", "FILE", "draw the difference: FLIP's map (.png) or picture minus reference (.exr)").short('o').long("out"),
                ),
        )
        .subcommand(Command::new("devices").about("List the Vulkan devices of this machine"))
}

/// Whether `key` is one of `used`: tables, or single keys.
fn is_used(key: &str, used: &[&str]) -> bool {
    used.iter().any(|u| key == *u || key.split_once('.').is_some_and(|(table, _)| table == *u))
}

/// Refuses overrides that would change nothing in `work`.
pub fn check_used(overrides: &[(String, String)], used: &[&str], work: &str) -> Result<(), String> {
    match overrides.iter().find(|(key, _)| keys::find(key).is_some() && !is_used(key, used)) {
        None => Ok(()),
        Some((key, _)) => {
            let there = if used.is_empty() { "it uses no key of a scene".into() } else { format!("it uses {}", used.join(", ")) };
            Err(format!("command line: `{key}` changes nothing in {work}; {there}"))
        }
    }
}

/// The overrides of scene keys in the order given: (key, value as TOML).
pub fn overrides(matches: &ArgMatches) -> Result<Vec<(String, String)>, String> {
    let mut found: Vec<(usize, String, String)> = Vec::new();
    if let Ok(Some(sets)) = matches.try_get_many::<String>("set") {
        for (text, at) in sets.zip(matches.indices_of("set").into_iter().flatten()) {
            let Some((key, value)) = text.split_once('=') else {
                return Err(format!("--set {text} has no `=`; write it as --set key=value, such as --set visibility.ratio=2"));
            };
            found.push((at, key.trim().into(), value.trim().into()));
        }
    }
    for key in KEYS {
        if let Ok(Some(values)) = matches.try_get_many::<String>(key.name) {
            for (value, at) in values.zip(matches.indices_of(key.name).into_iter().flatten()) {
                found.push((at, key.name.into(), value.clone()));
            }
        }
    }
    found.sort_by_key(|f| f.0);
    let mut overrides: Vec<_> = found.into_iter().map(|(_, key, value)| (key, value)).collect();
    for (id, key) in [("tolerance", "visibility.tolerance"), ("quality", "visibility.quality")] {
        if let Ok(Some(value)) = matches.try_get_one::<String>(id) {
            overrides.push((key.into(), value.clone()));
        }
    }
    if let Ok(Some(value)) = matches.try_get_one::<String>("nan-as") {
        overrides.push(("volume.nan_as".into(), value.clone()));
    }
    Ok(overrides)
}

fn global() -> Vec<Arg> {
    vec![
        Arg::new("json").long("json").action(ArgAction::SetTrue).help("one JSON object on stdout, nothing else").global(true),
        Arg::new("device")
            .long("device")
            .value_name("DEVICE")
            .help("device by place in `halflight devices`, part of its name, or uuid")
            .global(true),
        Arg::new("threads")
            .long("threads")
            .value_name("N")
            .value_parser(value_parser!(u32).range(1..=1024))
            .help("threads of a CPU device (lavapipe)")
            .global(true),
        Arg::new("validate")
            .long("validate")
            .action(ArgAction::SetTrue)
            .help("run under the Vulkan validation layers; any message fails the command")
            .global(true),
        Arg::new("memory")
            .long("memory")
            .value_name("BUDGET")
            .value_parser(parse_bytes)
            .help("most device memory to use: 512M, 1.5G")
            .global(true),
        Arg::new("verbose")
            .short('v')
            .long("verbose")
            .action(ArgAction::Count)
            .help("say more on stderr; twice for still more")
            .global(true),
    ]
}

fn flag(id: &'static str, help: &'static str) -> Arg {
    Arg::new(id).long(id).action(ArgAction::SetTrue).help(help)
}

fn frame() -> Arg {
    Arg::new("frame")
        .long("frame")
        .value_name("N")
        .value_parser(value_parser!(i64))
        .allow_negative_numbers(true)
        .help("the scene at this frame of its animation")
}

fn field() -> Arg {
    path("field", "FILE", "take the visibility field from this file, which halflight precompute wrote for this scene").long("field")
}

fn measure(seconds: &'static str, help: &'static str) -> Arg {
    Arg::new("measure")
        .long("measure")
        .value_name("SECONDS")
        .num_args(0..=1)
        .require_equals(true)
        .default_missing_value(seconds)
        .value_parser(parse_seconds)
        .help(help)
}

/// What a plan is asked for, in short.
fn wanted() -> [Arg; 2] {
    [
        Arg::new("tolerance")
            .long("tolerance")
            .value_name("ERROR")
            .conflicts_with("quality")
            .allow_negative_numbers(true)
            .help("largest field error, such as 0.05: finds the cheapest settings that meet it, and says them beforehand"),
        Arg::new("quality")
            .long("quality")
            .value_name("draft|normal|fine")
            .help("the same in words: error 0.12 at 1:8, 0.06 at 1:4, 0.03 at 1:2"),
    ]
}

/// "0,255": two finite numbers that ascend.
fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.trim().trim_start_matches('[').trim_end_matches(']').split_once(',');
    let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    match numbers.and_then(|(a, b)| Some([number(a)?, number(b)?])) {
        Some([lo, hi]) if lo < hi => Ok([lo, hi]),
        _ => Err("it must be two ascending numbers, such as -1000,3000".into()),
    }
}

/// Seconds above 0.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s.is_finite() && s > 0.0 => Ok(s),
        _ => Err("it must be a number of seconds above 0".into()),
    }
}

fn nan_as() -> Arg {
    Arg::new("nan-as")
        .long("nan-as")
        .value_name("VALUE")
        .allow_negative_numbers(true)
        .help("what NaN and infinite samples are replaced by; without it they are an error")
}

/// The reference renderer in place of a visibility field.
fn reference() -> [Arg; 3] {
    [
        Arg::new("reference")
            .long("reference")
            .value_name("ERROR")
            .num_args(0..=1)
            .require_equals(true)
            .default_missing_value("0.01")
            .value_parser(parse_positive)
            .help("trace the exact light without bias, until the picture's relative standard error is ERROR (without: 0.01)"),
        Arg::new("samples")
            .long("samples")
            .value_name("N")
            .value_parser(value_parser!(u32).range(1..=1 << 24))
            .requires("reference")
            .help("most samples of a pixel of --reference, in blocks of 16, at least 32 (default: 65536)"),
        Arg::new("seconds")
            .long("seconds")
            .value_name("S")
            .value_parser(parse_positive)
            .requires("reference")
            .help("seconds after which --reference begins no further pass"),
    ]
}

/// A finite number above 0.
fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("it must be a number above 0, such as 0.01".into()),
    }
}

fn path(id: &'static str, name: &'static str, help: &'static str) -> Arg {
    Arg::new(id).value_name(name).help(help).value_parser(value_parser!(PathBuf))
}

fn scene() -> Arg {
    path("scene", "SCENE", "scene file (.toml), or a volume file to show with default settings").required(true)
}

/// One option per key of `used` (tables or keys), and `--set`. Where they are many, the short help leaves them out.
fn scene_args(used: &[&str]) -> Vec<Arg> {
    let keys: Vec<&Key> = KEYS.iter().filter(|k| is_used(k.name, used)).collect();
    let many = keys.len() > 8;
    let option = |k: &&Key| {
        let table = k.name.split('.').next().unwrap_or_default();
        Arg::new(k.name)
            .long(k.name)
            .value_name(value_name(k))
            .help(key_help(k))
            .help_heading(heading(table))
            .hide_short_help(many)
            .action(ArgAction::Append)
            .allow_hyphen_values(k.value.starts_with('['))
            .allow_negative_numbers(!k.value.starts_with('['))
    };
    let set = Arg::new("set").long("set").value_name("KEY=VALUE").action(ArgAction::Append).help(if many {
        "override a key of the scene: --set visibility.ratio=2 (or --visibility.ratio 2); --help lists all keys"
    } else {
        "override a key: --set light.scale=2 (or --light.scale 2)"
    });
    keys.iter().map(option).chain([set]).collect()
}

/// What the help shows in angle brackets: lists without their own (clap wants it static).
fn value_name(key: &Key) -> &'static str {
    match key.value {
        "[X, Y, Z]" => "X,Y,Z",
        "[X, Y, Z, DEGREES]" => "X,Y,Z,DEGREES",
        "[R, G, B]" => "R,G,B",
        "[R, G, B]|light" => "R,G,B|light",
        "[LOW, HIGH]" => "LOW,HIGH",
        "[[S, R, G, B, A], …]" => "POINTS",
        "[X0, Y0, Z0, X1, Y1, Z1]" => "X0,Y0,Z0,X1,Y1,Z1",
        "[[NX, NY, NZ, D], …]" => "PLANES",
        "[{KEYFRAME}, …]" => "KEYFRAMES",
        other => other,
    }
}

/// The key's meaning and default.
fn key_help(key: &Key) -> String {
    let form = if key.value.starts_with("[[") { format!(": {}", key.value) } else { String::new() };
    let bare = key.default.strip_prefix('[').and_then(|d| d.strip_suffix(']')).map(|d| d.replace(' ', ""));
    match bare.as_deref().unwrap_or(key.default) {
        "" => format!("{}{form}", key.help),
        default => format!("{}{form} (default: {default})", key.help),
    }
}

/// The table's heading in the help; clap wants it static.
fn heading(table: &str) -> &'static str {
    match table {
        "volume" => "Scene: [volume]",
        "transfer" => "Scene: [transfer]",
        "surface" => "Scene: [surface]",
        "light" => "Scene: [light]",
        "visibility" => "Scene: [visibility]",
        "clip" => "Scene: [clip]",
        "camera" => "Scene: [camera]",
        "animation" => "Scene: [animation]",
        "image" => "Scene: [image]",
        _ => "Scene",
    }
}

/// "512M", "1.5GiB", "1000000": bytes; K, M, G, T count in 1024s.
fn parse_bytes(text: &str) -> Result<u64, String> {
    let split = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let power = match unit.trim().to_ascii_lowercase().trim_end_matches('b').trim_end_matches('i') {
        "" => 0,
        "k" => 1,
        "m" => 2,
        "g" => 3,
        "t" => 4,
        _ => return Err(format!("the unit '{unit}' is unknown; use K, M, G or T")),
    };
    match number.parse::<f64>() {
        Ok(n) if n > 0.0 && n * 1024f64.powi(power) <= 1e18 => Ok((n * 1024f64.powi(power)) as u64),
        _ => Err("it must be a size above 0, such as 512M or 1.5G".into()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_command_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn sizes_are_read_with_units() {
        for (text, bytes) in [("1", 1), ("2K", 2048), ("1.5G", 3 << 29), ("512 MiB", 512 << 20), ("3gb", 3 << 30)] {
            assert_eq!(parse_bytes(text), Ok(bytes), "{text}");
        }
        for text in ["", "0", "-1", "G", "1X", "1.2.3G", "1e3", "99999999T"] {
            assert!(parse_bytes(text).is_err(), "{text}");
        }
    }

    #[test]
    fn help_of_a_key_reads_well() {
        let shown = |name| {
            let k = keys::find(name).unwrap();
            format!("<{}> {}", value_name(k), key_help(k))
        };
        assert_eq!(shown("camera.up"), "<X,Y,Z> direction that is up in the picture (default: 0,0,1)");
        assert_eq!(shown("image.width"), "<PIXELS> pixels per row (default: 1024)");
        assert!(shown("volume.file").starts_with("<PATH> volume, relative to the scene file"));
        assert!(
            shown("transfer.points").contains("<POINTS>") && shown("transfer.points").contains("[[S, R, G, B, A], …] (default: a grey")
        );
        for k in KEYS {
            assert!(!value_name(k).contains(['[', ']', ' ']) && !key_help(k).contains("[default"), "{}", k.name);
        }
    }

    #[test]
    fn keys_that_change_nothing_are_refused() {
        let given = |key: &str| vec![(key.to_string(), "1".to_string())];
        assert!(check_used(&given("light.scale"), OF_LIGHT, "`light`").is_ok());
        assert!(check_used(&given("visibility.ratio"), OF_FIELD, "`precompute`").is_ok());
        let refused = check_used(&given("visibility.ratio"), OF_LIGHT, "`light`").unwrap_err();
        assert!(refused.starts_with("command line: `visibility.ratio` changes nothing in `light`; it uses light.rotate"), "{refused}");
        // Unknown keys are for the scene's reader to refuse.
        assert!(check_used(&given("light.scales"), OF_LIGHT, "`light`").is_ok());
        let tables: Vec<&str> = keys::tables();
        assert_eq!(tables, OF_FRAMES);
    }

    #[test]
    fn overrides_keep_their_order() {
        let m = command()
            .try_get_matches_from([
                "halflight",
                "render",
                "s.toml",
                "-o",
                "x.png",
                "--visibility.ratio",
                "2",
                "--set",
                "image.width=7",
                "--set",
                "visibility.ratio = 4",
                "--image.exposure",
                "-1.5",
                "--nan-as",
                "-3",
            ])
            .unwrap();
        let found = overrides(m.subcommand().unwrap().1).unwrap();
        let found: Vec<_> = found.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        let expected = [
            ("visibility.ratio", "2"),
            ("image.width", "7"),
            ("visibility.ratio", "4"),
            ("image.exposure", "-1.5"),
            ("volume.nan_as", "-3"),
        ];
        assert_eq!(found, expected);
    }
}
