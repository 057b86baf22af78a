//! What the command line may say. The options for a scene's keys come from the library's table of keys.

use super::args_keys::{OF_CHART, OF_FIELD, OF_FRAMES, OF_LIGHT, OF_SCENE, scene_args};
use super::args_values::{parse_bytes, parse_positive, parse_range, parse_seconds};
use clap::{Arg, ArgAction, Command, value_parser};
use std::path::PathBuf;

/// The whole command.
pub fn command() -> Command {
    Command::new("halflight")
        .version(env!("CARGO_PKG_VERSION"))
        .about("Natural light for scalar volumes: visibility in spherical harmonics, precomputed on any Vulkan device")
        .after_help(
            "Exit codes: 0 done, 1 internal error or validation messages, 2 wrong usage, 3 bad input or output file, \
             4 no usable device, 5 out of memory, 6 device lost, 130 and 143 stopped by a signal.\n\n\
             RUST_LOG (error, warn, info, debug, trace) says what is logged on stderr, in place of -v.\n\
             Compiled kernels are kept in $XDG_CACHE_HOME/halflight, or else ~/.cache/halflight; the folder may be deleted.",
        )
        .subcommand_required(true)
        .arg_required_else_help(true)
        .args(global())
        .args(device("Device, of demo, precompute, render, frames and chart"))
        .subcommand(
            Command::new("demo")
                .about("Light a made-up machine part with a made-up sky: a translucent and an opaque picture, no files needed")
                .arg(path("out", "DIR", "where the pictures go").short('o').long("out").default_value("halflight-demo"))
                .arg(Arg::new("quick").long("quick").action(ArgAction::SetTrue).help("coarser field, smaller pictures"))
                .args(device("Device")),
        )
        .subcommand(
            Command::new("info")
                .about("Describe a volume, a light probe, a visibility field, a picture or a scene")
                .arg(
                    path(
                        "file",
                        "FILE",
                        "volume (NRRD, NIfTI, MetaImage, VTK, OpenVDB, TIFF, PNG, DICOM file or folder, 'slice_####.tif', headerless), \
                         probe (.hdr, .exr), field (.nrrd), a picture of halflight's own (.exr, .png), or scene (.toml)",
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
                    path("in", "FILE", "ParaView or NiiVue .json, Slicer .xml or .vp, Voreen .tfi or .tfg, Inviwo .itf, ImageVis3D .1dt, Exposure Render .xml")
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
                .arg(measure("60", "measure the field's error against a dense reference, in about so many seconds of device time at most, but at 64 cells [60]"))
                .arg(frame())
                .args(wanted())
                .args(device("Device"))
                .args(scene_args(OF_FIELD))
                .arg(nan_as()),
        )
        .subcommand(
            Command::new("render")
                .about("Render a scene")
                .arg(scene())
                .arg(path("out", "FILE", "the picture: .exr (linear) or .png (sRGB)").short('o').long("out").required(true))
                .arg(frame())
                .args(super::layers::args().map(|a| a.conflicts_with("reference")))
                .arg(field().conflicts_with("reference"))
                .args(wanted())
                .arg(
                    measure("20", "measure the picture's error at fewer of its pixels against Monte Carlo without harmonics, in about so many seconds [20]")
                        .conflicts_with("reference"),
                )
                .args(reference())
                .args(device("Device"))
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
                .arg(
                    flag("estimate", "render a few of the frames and say what all of them will cost")
                        .conflicts_with_all(["skip-existing", "no-reuse"]),
                )
                .arg(flag("no-reuse", "compute everything anew for each frame; the pictures are the same"))
                .arg(field())
                .arg(
                    path("fields", "DIR", "keep fields here under their hash and take those that are there: no field is computed twice")
                        .long("fields")
                        .conflicts_with_all(["field", "no-reuse"]),
                )
                .arg(
                    Arg::new("progress")
                        .long("progress")
                        .value_name("HOW")
                        .value_parser(["auto", "tty", "lines", "openjd", "json", "none"])
                        .default_value("auto")
                        .help("a bar, a line per frame, what Open Job Description listens to, JSON lines, or none: the summary alone"),
                )
                .args(device("Device"))
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
                .arg(path("out", "DIR", "where the report goes; in a checkout of halflight a record goes into its benches/records, too").short('o').long("out").required(true))
                .arg(Arg::new("quick").long("quick").action(ArgAction::SetTrue).help("under a minute: fewer settings, fewer probes"))
                .arg(
                    Arg::new("budget")
                        .long("budget")
                        .value_name("SECONDS")
                        .value_parser(parse_seconds)
                        .help("time for all scenes together (default: 540, with --quick 48)"),
                )
                .args(device("Device"))
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

fn global() -> Vec<Arg> {
    vec![
        Arg::new("json").long("json").action(ArgAction::SetTrue).help("one JSON object on stdout, nothing else").global(true),
        Arg::new("verbose")
            .short('v')
            .long("verbose")
            .action(ArgAction::Count)
            .help("say more on stderr; twice for still more")
            .global(true),
    ]
}

/// Options of the commands that open a device, before the command or behind it.
pub const OF_DEVICE: [&str; 4] = ["device", "threads", "memory", "validate"];

fn device(heading: &'static str) -> [Arg; 4] {
    [
        Arg::new("device").long("device").value_name("DEVICE").help("device by place in `halflight devices`, part of its name, or uuid"),
        Arg::new("threads")
            .long("threads")
            .value_name("N")
            .value_parser(value_parser!(u32).range(1..=1024))
            .help("threads of a CPU device (lavapipe)"),
        Arg::new("memory").long("memory").value_name("BUDGET").value_parser(parse_bytes).help(
            "most device memory to use: 512M, 1.5G; what buffers and images ask for is counted, not counted are up to 64 MiB for \
             copies and the free rest of blocks of 64 MiB (32 on a CPU) that small buffers share, seldom more than one block",
        ),
        Arg::new("validate")
            .long("validate")
            .action(ArgAction::SetTrue)
            .help("run under the Vulkan validation layers; any message fails the command"),
    ]
    .map(|a| a.help_heading(heading))
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
        Arg::new("tolerance").long("tolerance").value_name("ERROR").conflicts_with("quality").allow_negative_numbers(true).help(
            "largest field error at its cells' centres, such as 0.05: finds the cheapest march or sweep that meets it, and says what is \
                 missed between them, for which it takes cells as fine as 1:2; takes the place of the scene's method and its settings, while a ratio, bits, bands and \
                 cells that the scene names stay",
        ),
        Arg::new("quality")
            .long("quality")
            .value_name("draft|normal|fine")
            .help("the same in words: error 0.12 at 1:8, 0.06 at 1:4, 0.03 at 1:2"),
    ]
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
            .value_parser(value_parser!(u32).range(32..=1 << 24))
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

fn path(id: &'static str, name: &'static str, help: &'static str) -> Arg {
    Arg::new(id).value_name(name).help(help).value_parser(value_parser!(PathBuf))
}

fn scene() -> Arg {
    path("scene", "SCENE", "scene file (.toml), or a volume file to show with default settings").required(true)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_command_is_consistent() {
        command().debug_assert();
    }
}
