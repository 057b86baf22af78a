//! `chart`: speed against accuracy of every estimator on one's own scenes, as a folder of charts and tables.

use super::Context;
use super::args_keys::{OF_CHART, check_used, overrides};
use super::fail::Failure;
use super::load;
use super::output::Folder;
use super::path_of;
use super::progress::Progress;
use clap::ArgMatches;
use halflight::chart::{self, Options, Subject};
use halflight::error::shown;
use halflight::record::Machine;
use halflight::scene::{Clip, ImageSettings, Light, Probe, Sky};
use halflight::{Error, demo, io};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Seconds from which on there is time for the table of hard scenes.
const HARD_FROM: f64 = 300.0;

/// `halflight chart [SCENE…] -o DIR [--quick] [--budget SECONDS]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let folder = path_of(m, "out")?;
    let given = overrides(m).map_err(Failure::usage)?;
    check_used(&given, OF_CHART, "a chart").map_err(Failure::usage)?;
    let scenes: Vec<&PathBuf> = m.get_many::<PathBuf>("scenes").into_iter().flatten().collect();
    if let (true, Some((key, _))) = (scenes.is_empty(), given.first()) {
        return Err(Failure::usage(format!("`{key}` needs a SCENE to change: the built-in one is charted as it is")));
    }
    let base = if m.get_flag("quick") { Options::QUICK } else { Options::FULL };
    let options = Options { seconds: m.get_one::<f64>("budget").copied().unwrap_or(base.seconds), ..base };

    let bar = Progress::new(&[load::READ, "hard scenes", "measure", "draw"]);
    let mut subjects = Vec::new();
    for path in &scenes {
        subjects.push(subject(path, &given, &bar)?);
    }
    if subjects.is_empty() {
        subjects.push(built_in()?);
    }
    let engine = context.engine()?;
    let _made = Folder::make(folder)?;
    report.device(&engine);
    report.line("budget", format!("{:.0} s for {}", options.seconds, counted(subjects.len(), "scene")));
    report.flush()?;

    bar.plan(&[("measure", 1.0)]);
    // The table of hard scenes takes about a minute: only where that is little. What it leaves of the time is measured in.
    let (begun, mut hard) = (Instant::now(), Vec::new());
    if options.seconds >= HARD_FROM {
        bar.enter("hard scenes");
        hard = chart::stability(&engine, &mut bar.job())?;
    }
    bar.enter("measure");
    let measured = Options { seconds: (options.seconds - begun.elapsed().as_secs_f64()).max(0.5 * options.seconds), ..options };
    let charted = chart::run(&engine, &subjects, &measured, &mut bar.job())?;
    let seconds = begun.elapsed().as_secs_f64();
    let charted = chart::Report { budget: options.seconds, seconds, stability: hard, ..charted };
    bar.enter("draw");
    let machine = Machine::of(engine.device());
    let object = json!({ "machine": machine, "report": charted });
    let mut files: Vec<(String, Vec<u8>)> = vec![
        ("report.html".into(), chart::report_html(&charted, &machine)?.into_bytes()),
        ("report.json".into(), format!("{object:#}\n").into_bytes()),
        ("points.csv".into(), chart::points_csv(&charted).into_bytes()),
        ("table.md".into(), chart::tables_md(&charted).into_bytes()),
    ];
    for figure in chart::figures(&charted) {
        files.push((format!("{}.png", figure.name), figure.png()?));
        files.push((format!("{}.svg", figure.name), figure.svg()?.into_bytes()));
    }
    let record = chart::record(&charted, engine.device());
    files.push(("record.json".into(), record.text().into_bytes()));
    // All is drawn before the first file is written.
    for (name, bytes) in &files {
        write(&folder.join(name), bytes)?;
    }
    drop(bar);
    for s in &charted.subjects {
        report.line("scene", format!("{}: {} measured, {} left out", s.name, counted(s.fields.len(), "field"), s.left_out.len()));
    }
    report.wrote(&folder.join("report.html"));
    report.line("", format!("and {} files beside it", files.len() - 1));
    // Runs inside this project's checkout are kept where those of `cargo bench` are.
    if let Some(records) = std::env::current_dir().ok().and_then(|here| halflight::record::folder(&here)) {
        report.wrote(&record.write(&records)?);
    }
    for (key, value) in object.as_object().into_iter().flatten() {
        report.set(key, value.clone());
    }
    context.verdict(&engine)?;
    report.finish()
}

fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

fn subject(path: &Path, given: &[(String, String)], bar: &Progress) -> Result<Subject, Failure> {
    let scene = load::scene(path, given)?;
    if scene.clip != Clip::default() {
        return Err(Failure::usage(format!("{}: a chart knows no [clip]; leave it out there", shown(path))));
    }
    let loaded = load::load(&scene, bar)?;
    let name = path.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    if loaded.matter.is_vacuum(loaded.volume.range()) {
        let sentence = format!("{}: the scene is empty, there is no error to measure; change its transfer function", shown(path));
        return Err(Failure::new(3, sentence));
    }
    Ok(Subject {
        name: name.strip_suffix(".nii").unwrap_or(&name).to_owned(),
        volume: loaded.volume,
        matter: loaded.matter,
        light: loaded.light,
        sky: Sky::from_settings(&scene.light, loaded.probe.as_ref())?,
        camera: loaded.camera,
        image: scene.image,
        ratio: scene.visibility.ratio,
    })
}

/// The demo's translucent scene.
fn built_in() -> Result<Subject, Failure> {
    let volume = demo::volume(128)?;
    let camera = demo::camera(volume.grid());
    Ok(Subject {
        name: "demo".into(),
        matter: demo::dvr()?,
        light: Light::from_probe(&Probe::two_colored()),
        sky: Sky::from_probe(&Probe::two_colored()),
        camera,
        image: ImageSettings { width: 640, height: 480, exposure: demo::EXPOSURES[0], ..ImageSettings::default() },
        ratio: 4,
        volume,
    })
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    io::write_aside(path, |out| out.write_all(bytes).map_err(|source| Error::Io { path: path.to_owned(), action: "write", source }))?;
    Ok(())
}
