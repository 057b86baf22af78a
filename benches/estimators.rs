//! Every estimator on one scene in one run: device time of a whole field at 1:4, 8 bits, cells near matter, and its error
//! before and after packing at the same cells drawn at random near matter.
//!
//! `cargo bench --bench estimators -- VOLUME [--opacity VALUE:ALPHA,...] [--probes 1024] [--rounds 3]`; opacities are per
//! voxel, of a white medium. What takes less than ten seconds runs `rounds` times in turns, the others once; the median
//! counts. Without VOLUME: the demo volume. The reference is computed once: 4,096 directions, steps of ¼ voxel.

use halflight::demo;
use halflight::engine::{Engine, Options};
use halflight::io::{ReadOptions, read_volume};
use halflight::measure::{self, FieldError};
use halflight::record::Record;
use halflight::scene::transfer::{Kind, Reference};
use halflight::scene::visibility::{Method, Sampling};
use halflight::scene::{Matter, Transfer, Visibility};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const USAGE: &str = "usage: estimators [VOLUME] [--opacity VALUE:ALPHA,...] [--probes N] [--rounds N]";

/// Seconds beyond which a candidate runs once.
const DEAR: f64 = 10.0;

type Failure = Box<dyn std::error::Error>;

struct Arguments {
    volume: Option<PathBuf>,
    /// Scalar and opacity per voxel.
    opacity: Vec<[f64; 2]>,
    probes: usize,
    rounds: usize,
    /// Only whether it runs.
    test: bool,
}

/// `None`: the words are meant for another bench.
fn arguments() -> Result<Option<Arguments>, Failure> {
    let mut a = Arguments { volume: None, opacity: vec![[70.0, 0.0], [120.0, 0.15], [200.0, 0.6]], probes: 1024, rounds: 3, test: true };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or_else(|| format!("{word} lacks its value\n{USAGE}"));
        match word.as_str() {
            // What cargo says: bench is measured, anything else is a test.
            "--bench" => a.test = false,
            "--test" => return Ok(Some(Arguments { test: true, ..a })),
            "--opacity" => {
                let text = value()?;
                let point = |p: &str| p.split_once(':').and_then(|(v, o)| Some([v.parse().ok()?, o.parse().ok()?]));
                let points: Option<Vec<_>> = text.split(',').map(point).collect();
                a.opacity = points.ok_or_else(|| format!("--opacity: {text}; e.g. 40:0,60:0.8,255:0.95"))?;
            }
            "--probes" => a.probes = value()?.parse().map_err(|e| format!("--probes: {e}"))?,
            "--rounds" => a.rounds = value()?.parse().map_err(|e| format!("--rounds: {e}"))?,
            _ if word.starts_with('-') => return Err(format!("unknown option {word}\n{USAGE}").into()),
            _ if Path::new(&word).exists() || word.contains(['/', '.']) => a.volume = Some(word.into()),
            _ => {
                println!("estimators: `{word}` is no file, taken as the filter of another bench");
                return Ok(None);
            }
        }
    }
    Ok(Some(a))
}

/// What is compared, the cheap first.
fn candidates(ratio: u32) -> Vec<(String, Visibility)> {
    let base = Visibility { ratio, ..Visibility::default() };
    let sweep = |(directions, near, step): (u32, u32, f32)| {
        let name = format!("sweep N = {directions}, near {near}, step {step}");
        (name, Visibility { method: Method::Sweep, directions, near, step, ..base.clone() })
    };
    let sets = [(64, 1, 2.0), (128, 1, 2.0), (128, 2, 2.0), (288, 2, 1.0), (352, 2, 1.0)];
    let mut all: Vec<_> = sets.map(sweep).into();
    all.push((
        "hierarchical N = 400, axis, growth 1/4".into(),
        Visibility { method: Method::Hierarchical, directions: 400, ..base.clone() },
    ));
    all.push((
        "march N = 400 jittered, step 1".into(),
        Visibility { method: Method::March, sampling: Sampling::Jittered, directions: 400, ..base.clone() },
    ));
    all
}

struct Row {
    name: String,
    seconds: Vec<f64>,
    before: FieldError,
    after: FieldError,
}

impl Row {
    fn median(&self) -> f64 {
        let mut s = self.seconds.clone();
        s.sort_by(f64::total_cmp);
        s.get(s.len() / 2).copied().unwrap_or(f64::NAN)
    }
}

fn run() -> Result<(), Failure> {
    let Some(a) = arguments()? else { return Ok(()) };
    let (name, volume) = match &a.volume {
        Some(path) => {
            (path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()), read_volume(path, &ReadOptions::default())?)
        }
        None => (String::from("the demo volume"), demo::volume(if a.test { 24 } else { 96 })?),
    };
    let matter = match &a.volume {
        Some(_) => {
            let points: Vec<[f64; 5]> = a.opacity.iter().map(|&[value, alpha]| [value, 1.0, 1.0, 1.0, alpha]).collect();
            Matter { transfer: Transfer::from_points(&points, Kind::Opacity, Reference::Voxel)?, surface: None }
        }
        None => demo::dvr()?,
    };
    let engine = Engine::new(&Options::default())?;
    let mut quiet = |_: &'static str, _: f32| ControlFlow::Continue(());
    let medium = engine.classify(&engine.upload(&volume)?, &matter)?;
    let ratio = 4;
    let probes = measure::probes(&engine, &volume, &medium, ratio, if a.test { 8 } else { a.probes }).expect("probes");
    let device_seconds = || engine.take_timings().iter().map(|s| s.seconds).sum::<f64>();
    device_seconds();
    let truth = measure::reference(&engine, &medium, ratio, &probes, &mut quiet)?;
    let info = engine.device();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    println!("halflight {}; {}; {}; {cores} processor cores", env!("CARGO_PKG_VERSION"), info.name, info.driver);
    let d = volume.grid().dims();
    println!(
        "{name}, {}x{}x{} voxels, opacity {:?}; 1:{ratio}, {} probes near matter, their reference took {:.1} s\n",
        d[0],
        d[1],
        d[2],
        a.opacity,
        probes.len(),
        device_seconds()
    );
    let mut rows: Vec<Row> = Vec::new();
    for round in 0..if a.test { 1 } else { a.rounds.max(1) } {
        for (i, (name, settings)) in candidates(ratio).into_iter().enumerate() {
            let settings = if a.test { Visibility { directions: 16, ..settings } } else { settings };
            if rows.get(i).is_some_and(|r| r.median() > DEAR) {
                continue;
            }
            // A kernel is compiled at its first dispatch.
            if round == 0 {
                engine.precompute(&medium, &Visibility { directions: 12, ..settings.clone() }, &mut quiet)?;
            }
            device_seconds();
            let field = engine.precompute(&medium, &settings, &mut quiet)?;
            let seconds = device_seconds();
            if let Some(row) = rows.get_mut(i) {
                row.seconds.push(seconds);
                continue;
            }
            let kept = engine.read_field(&field)?;
            let after: Vec<[f32; 16]> = probes.iter().map(|&c| std::array::from_fn(|k| kept[16 * c as usize + k])).collect();
            let before = engine.estimate(&medium, &settings, &probes, &mut quiet)?;
            let error = |v: &[[f32; 16]]| measure::field_error(v, &truth);
            rows.push(Row { name, seconds: vec![seconds], before: error(&before), after: error(&after) });
        }
    }
    println!("| estimator | error [95 %] | after 8 bits | device time |\n|---|---|---|---|");
    let mut record = Record::new("estimators", info);
    for row in &rows {
        let e = row.before;
        println!(
            "| {} | {:.4} [{:.4}, {:.4}] | {:.4} | {:.2} s |",
            row.name,
            e.relative_l2,
            e.interval[0],
            e.interval[1],
            row.after.relative_l2,
            row.median()
        );
        record.add(format!("{name}: {}: device time", row.name), "s", row.seconds.clone());
        record.figures.push(halflight::record::Figure {
            name: format!("{name}: {}: field error, its 95 % interval", row.name),
            unit: "1",
            value: e.relative_l2,
            spread: Some(e.interval),
        });
    }
    println!();
    for dear in rows.iter().skip(candidates(ratio).len() - 2) {
        for row in rows.iter().filter(|r| r.name.starts_with("sweep") && r.before.relative_l2 <= dear.before.relative_l2) {
            let factor = dear.median() / row.median();
            println!(
                "{}: {factor:.0} times as fast as {} at {:.2} of its error",
                row.name,
                dear.name,
                row.before.relative_l2 / dear.before.relative_l2
            );
        }
    }
    if !a.test {
        println!("wrote {}", record.write(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/benches/records")))?.display());
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}
