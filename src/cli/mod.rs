//! The `halflight` command: reads the command line, calls the engine, says what was done.

mod args;
mod args_keys;
mod args_values;
mod chart;
mod compare;
mod demo;
mod fail;
mod field_file;
mod fingerprint;
mod frames;
mod info;
mod info_scene;
mod layers;
mod light;
mod load;
mod output;
mod plan;
mod precompute;
mod progress;
mod reference;
mod render;
mod report;
mod signals;
mod transfer;

use clap::ArgMatches;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use fail::Failure;
use halflight::engine::{Engine, Options};
use halflight::error::bytes;
use report::{Report, say};
use serde_json::json;
use std::ffi::OsString;
use std::process::ExitCode;

/// What holds for every command.
pub struct Context {
    json: bool,
    options: Options,
}

impl Context {
    fn report(&self) -> Report {
        Report::new(self.json)
    }

    fn engine(&self) -> Result<Engine, Failure> {
        Ok(Engine::new(&self.options)?)
    }

    /// Fails if the validation layers had anything to say.
    fn verdict(&self, engine: &Engine) -> Result<(), Failure> {
        let messages = if self.options.validation { engine.validation_errors() } else { Vec::new() };
        match messages.first() {
            None => Ok(()),
            Some(first) => Err(Failure::new(1, format!("{} validation messages, the first: {first}", messages.len()))),
        }
    }
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    #[cfg(unix)]
    outlive_size_limits();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    // Errors of the command line itself must be JSON too, and clap has not read it by then.
    let json = arguments.iter().skip(1).take_while(|a| *a != "--").any(|a| a == "--json");
    let done = std::panic::catch_unwind(|| run(&arguments));
    let failure = match done {
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(failure)) => failure,
        // The panic's own text is on stderr already.
        Err(_) => Failure::new(1, "internal error, please report it with the text above"),
    };
    eprintln_quietly(&format!("halflight: {}", failure.sentence));
    if json && !failure.told {
        let _ = say(&failure.json().to_string());
    }
    ExitCode::from(failure.code)
}

/// Lets a write beyond the limit of file sizes (`ulimit -f`) fail as any other, where the system would end the process: drivers
/// write caches of their own. Nobody needs the flag.
#[cfg(unix)]
fn outlive_size_limits() {
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
}

fn run(arguments: &[OsString]) -> Result<(), Failure> {
    let matches = match args::command().try_get_matches_from(arguments) {
        Ok(matches) => matches,
        Err(e) if matches!(e.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return say(e.render().to_string().trim_end());
        }
        Err(e) if matches!(e.kind(), ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand | ErrorKind::MissingSubcommand) => {
            return Err(Failure::usage(
                "a command is missing: demo, info, light, transfer, precompute, render, frames, compare, chart or devices; see halflight --help",
            ));
        }
        Err(e) => return Err(e.into()),
    };
    let Some((name, m)) = matches.subcommand() else { return Err(Failure::usage("a command is missing; see halflight --help")) };
    let options = options(&matches, name, m)?;
    log_to_stderr(m.get_count("verbose"));
    let context = Context { json: m.get_flag("json"), options };
    match name {
        "demo" => demo::run(&context, m),
        "compare" => compare::run(&context, m),
        "info" => info::run(&context, m),
        "light" => light::run(&context, m),
        "transfer" => transfer::run(&context, m),
        "precompute" => precompute::run(&context, m),
        "render" => render::render(&context, m),
        "frames" => frames::run(&context, m),
        "chart" => chart::run(&context, m),
        _ => devices(&context),
    }
}

/// What is wished of the device: behind the command, or before it.
fn options(before: &ArgMatches, name: &str, m: &ArgMatches) -> Result<Options, Failure> {
    let given =
        |m: &ArgMatches, id: &str| matches!(m.try_contains_id(id), Ok(true)) && m.value_source(id) == Some(ValueSource::CommandLine);
    // A flag has a value wherever it is known, also where it was not given.
    let opens = matches!(m.try_contains_id("validate"), Ok(true));
    if let Some(id) = args::OF_DEVICE.into_iter().find(|id| !opens && given(before, id)) {
        return Err(Failure::usage(format!("--{id} changes nothing in `{name}`, which opens no device; drop it")));
    }
    let at = |id: &str| if given(m, id) { m } else { before };
    Ok(Options {
        device: at("device").get_one::<String>("device").cloned(),
        threads: at("threads").get_one::<u32>("threads").map(|&n| n as usize),
        validation: at("validate").get_flag("validate"),
        memory_budget: at("memory").get_one::<u64>("memory").copied(),
        ..Options::default()
    })
}

/// A path argument that clap has made sure of.
fn path_of<'a>(m: &'a ArgMatches, id: &str) -> Result<&'a std::path::Path, Failure> {
    m.get_one::<std::path::PathBuf>(id).map(|p| p.as_path()).ok_or_else(|| Failure::usage(format!("{id} is missing; see halflight --help")))
}

fn devices(context: &Context) -> Result<(), Failure> {
    let mut report = context.report();
    let devices = halflight::engine::devices()?;
    for d in &devices {
        let (major, minor, patch) = d.api_version;
        report.text(format!("{}: {} ({:?})", d.index, d.name, d.kind));
        report.text(format!("   {}, Vulkan {major}.{minor}.{patch}, {} of memory, uuid {}", d.driver, bytes(d.heap_bytes), d.uuid));
    }
    let list = devices.iter().map(|d| {
        let (major, minor, patch) = d.api_version;
        json!({
            "index": d.index, "name": d.name, "kind": format!("{:?}", d.kind).to_lowercase(), "driver": d.driver,
            "vulkan": format!("{major}.{minor}.{patch}"), "memory": d.heap_bytes, "uuid": d.uuid,
        })
    });
    report.set("devices", list.collect());
    report.finish()
}

/// Warnings always, more with -v; RUST_LOG overrides.
fn log_to_stderr(verbose: u8) {
    let level = ["warn", "info", "debug"].get(usize::from(verbose)).unwrap_or(&"trace");
    let env = env_logger::Env::default().default_filter_or(*level);
    let _ = env_logger::Builder::from_env(env)
        .target(env_logger::Target::Pipe(Box::new(progress::Stderr)))
        .format(|out, record| {
            use std::io::Write;
            writeln!(out, "halflight: {}: {}", record.level().as_str().to_lowercase(), record.args())
        })
        .try_init();
}

/// A line on stderr, whether or not somebody listens.
fn eprintln_quietly(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}
