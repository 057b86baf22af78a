//! `precompute`: a scene's visibility field as a file, and how wrong it is.

use super::Context;
use super::args_keys::OF_FIELD;
use super::fail::Failure;
use super::field_file;
use super::load;
use super::output::Kind;
use super::plan;
use super::progress::Progress;
use super::render::{asked, finish, header, stoppable, visibility, works};
use super::report::Report;
use super::signals::Signals;
use clap::ArgMatches;
use halflight::engine::{Engine, Field, Medium, Span};
use halflight::io;
use halflight::measure::{self, Budget, Plan};
use halflight::scene::visibility::Method;
use halflight::scene::{Visibility, Volume};
use serde_json::json;

/// `halflight precompute SCENE -o FIELD.nrrd [--measure[=SECONDS]]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    stoppable(|signals| computed(context, m, signals))
}

fn computed(context: &Context, m: &ArgMatches, signals: &Signals) -> Result<(), Failure> {
    let mut report = context.report();
    let (mut scene, output) = asked(m, &[("nrrd", Kind::Nrrd)], (OF_FIELD, "a visibility field"))?;
    let budget = m.get_one::<f64>("measure").copied();
    let mut stages = vec![load::READ, "upload", "visibility", "write"];
    if budget.is_some() {
        stages.insert(3, "measure");
    }
    if scene.wanted.is_some() {
        stages.insert(2, plan::STAGE);
    }
    let bar = Progress::new(&stages).until(signals);
    let loaded = load::load(&scene, &bar)?;
    let engine = context.engine()?;
    let (medium, field) = visibility(&engine, &mut scene, &loaded, (None, None), &bar, &mut report)?;
    let data = engine.read_field(&field)?;
    let spans = engine.take_timings();
    let mut meta = header(&scene, &engine, &spans);
    meta.extend(field_file::keys(&scene, &loaded.volume, &loaded.matter).meta(&data));
    if let Some(seconds) = budget {
        let known = !spans.is_empty() && spans.iter().all(|s: &Span| s.timed);
        let budget = Budget { seconds, field_seconds: known.then(|| spans.iter().map(|s| s.seconds).sum()) };
        bar.plan(&[works(&scene.visibility, &scene.image, loaded.volume.grid())[0], reference_work(&loaded.volume)]);
        bar.enter("measure");
        let measured = measured(&engine, &loaded.volume, &medium, (&field, &data), &budget, &bar, &mut report)?;
        meta.extend(measured.meta());
    }
    bar.check()?;
    bar.enter("write");
    io::write_nrrd_field(output.place()?, field.dims(), scene.visibility.coefficients(), &data, loaded.volume.grid(), &meta)?;
    drop(bar);
    finish(context, report, &engine, &spans, &output)
}

/// Measures a field; says beforehand how long that takes, and then what was found.
fn measured(
    engine: &Engine,
    volume: &Volume,
    medium: &Medium,
    (field, data): (&Field, &[f32]),
    budget: &Budget,
    bar: &Progress,
    report: &mut Report,
) -> Result<measure::Report, Failure> {
    let plan = Plan::new(engine, volume, medium, field.settings(), budget)?;
    if !plan.cells.is_empty() {
        report.line("measuring", announced(&plan, field.settings(), budget));
    }
    report.flush()?;
    let measured = measure::Report::measure(engine, medium, field, data, &plan, &mut bar.job())?;
    say(report, &measured);
    Ok(measured)
}

/// "1,024 probes × 4,096 directions, about 14 s".
fn announced(plan: &Plan, settings: &Visibility, budget: &Budget) -> String {
    let mut text = format!(
        "{} probes × {} directions, about {}",
        thousands(plan.cells.len()),
        thousands(measure::REFERENCE_DIRECTIONS as usize),
        time(plan.seconds)
    );
    match (plan.again, plan.before, budget.field_seconds) {
        (Some(s), ..) => text += &format!(", and {} to sweep again for the error before packing", time(s)),
        (None, false, Some(s)) => {
            text += &format!(
                "; not before packing: to sweep again would take {}, --measure={} allows it",
                time(s),
                Budget::for_sweep(s).ceil()
            );
        }
        _ if settings.method == Method::Sweep && settings.bits != 32 => text += ", and a second sweep for the error before packing",
        _ => {}
    }
    text
}

/// The measured error as a table, and for programs.
pub fn say(report: &mut Report, measured: &measure::Report) {
    if measured.probes == 0 {
        report.line("error", measured.sentence());
    } else {
        report.line(
            "error",
            format!(
                "at {} {} against {} directions in steps of {} voxel; with 95 % intervals",
                thousands(measured.probes),
                measured.of(),
                thousands(measured.directions as usize),
                measured.step
            ),
        );
    }
    for line in measured.table() {
        report.text(line);
    }
    if let Some(note) = measured.note() {
        report.line("note", note);
    }
    if measured.probes > 0 {
        report.line("measured", format!("in {} of device time", time(measured.seconds)));
    }
    report.set("field_error", json!(measured));
}

/// Trilinear taps of the reference, roughly, as [`works`] counts.
fn reference_work(volume: &Volume) -> (&'static str, f64) {
    let side = volume.grid().dims().into_iter().max().unwrap_or(1) as f64;
    ("measure", 1024.0 * f64::from(measure::REFERENCE_DIRECTIONS) * 0.5 * side / f64::from(measure::REFERENCE_STEP))
}

/// "0.42 s", "14 s".
fn time(seconds: f64) -> String {
    if seconds < 9.95 { format!("{seconds:.1} s") } else { format!("{seconds:.0} s") }
}

/// "4,096".
fn thousands(n: usize) -> String {
    if n < 1000 { n.to_string() } else { format!("{},{:03}", thousands(n / 1000), n % 1000) }
}
