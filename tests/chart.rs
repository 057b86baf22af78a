//! Charts: what is measured of a small scene, within its budget, and what is written of it.
#![cfg(feature = "chart")]

mod common;
use common::*;
use halflight::chart::{self, Options, Report, Subject, Timing};
use halflight::record::Machine;
use halflight::scene::visibility::Method;
use halflight::scene::{Camera, Grid, ImageSettings, Light, Probe, Sky};
use std::ops::ControlFlow;
use std::process::Command;

fn subject(name: &str) -> Subject {
    let volume = blobs(Grid::axis_aligned([24, 20, 16], [1.0; 3]).unwrap(), 7);
    let image = ImageSettings { width: 32, height: 24, ..ImageSettings::default() };
    let camera = Camera::from_settings(&Default::default(), volume.grid(), 32.0 / 24.0).unwrap();
    let probe = Probe::two_colored();
    Subject {
        name: name.into(),
        matter: linear(0.4),
        light: Light::from_probe(&probe),
        sky: Sky::from_probe(&probe),
        camera,
        image,
        ratio: 4,
        volume,
    }
}

fn measured(seconds: f64) -> Report {
    let engine = engine();
    let options = Options { seconds, probes: 64, pixels: 32 * 24, judged: 32 * 24 };
    chart::run(&engine, &[subject("a <b> & \"c\"")], &options, &mut quiet).unwrap()
}

#[test]
fn a_small_scene_is_measured_and_written() {
    let report = measured(12.0);
    let s = &report.subjects[0];
    let of = |method| s.fields.iter().filter(move |p| p.visibility.method == method && p.ratio == 4);
    for method in [Method::March, Method::Hierarchical, Method::Sweep] {
        assert!(of(method).next().is_some(), "{method:?} was not measured");
    }
    for p in &s.fields {
        assert!(p.seconds > 0.0 && p.error > 0.0 && p.error.is_finite(), "{}", p.name);
        assert!(p.interval[0] <= p.error && p.error <= p.interval[1], "{}", p.name);
        // So small a field is always computed whole.
        assert_eq!(p.timing, Timing::Whole);
        // 8 bits add about their quantum, 16 a 256th of it.
        assert!((p.packed[0] - p.error).abs() < 1e-3 && (p.packed[1] - p.error).abs() < 0.02, "{}", p.name);
        // Recomputed by hand: none on the front is faster and closer beyond all bars.
        let fastest = |p: &halflight::chart::FieldPoint| p.spread.unwrap_or([p.seconds; 2]);
        let ahead = |q: &halflight::chart::FieldPoint| fastest(q)[1] < fastest(p)[0] && q.interval[1] < p.interval[0];
        let beaten = s.fields.iter().any(|q| q.ratio == p.ratio && q.front && ahead(q));
        assert!(!(p.front && beaten), "{}", p.name);
    }
    // More directions of the dense march are closer to the reference: the error is measured, not made up.
    let march = |n| of(Method::March).find(|p| p.visibility.directions == n && p.visibility.step == 1.0).map(|p| p.error);
    if let (Some(few), Some(many)) = (march(64), march(400)) {
        assert!(many < few, "{many} {few}");
    }
    assert!(s.fields.iter().any(|p| p.front) && s.references[0].probes >= 32);
    assert!(s.frames.len() >= 4 && s.frames.iter().all(|p| p.seconds > 0.0 && p.rmse.is_finite() && p.flip >= 0.0));
    // The reference picture is as sure as it should be, or said not to be.
    let doubt = s.left_out.iter().any(|l| l.starts_with("reference picture: its noise"));
    assert!(s.image_reference_wanted > 0.0 && s.image_reference_error > 0.0, "{}", s.image_reference);
    assert_eq!(doubt, s.image_reference_error > 1.05 * s.image_reference_wanted, "{:?}", s.left_out);
    // Pictures side by side: the reference first, then pairs, each judged; the sweep of the last fitted or at a finer ratio.
    assert!(s.shown[0].difference.is_none() && s.shown.len() % 2 == 1);
    for pair in s.shown[1..].chunks(2) {
        assert!(pair[0].group == pair[1].group && pair[0].title.starts_with("hierarchical") && pair[1].title.starts_with("sweep"));
        assert!(pair.iter().all(|p| p.difference.is_some() && p.title.contains("image relative RMSE")));
    }
    // One band of light is further from the truth than four.
    let level = |bands| s.levels.iter().find(|l| l.bands == bands).map_or(0.0, |l| l.rmse);
    assert!(level(1) > level(3), "{:?}", s.levels);

    let csv = chart::points_csv(&report);
    let rows: Vec<&str> = csv.lines().collect();
    assert_eq!(rows.len(), 1 + s.fields.len());
    assert!(rows[1].starts_with("\"a <b> & \"\"c\"\"\",\"sweep, N 128"), "{}", rows[1]);
    let table = chart::tables_md(&report);
    let first = s.fields.iter().find(|p| p.name == "sweep, N 128, near 2, step 2" && p.ratio == 4).unwrap();
    assert!(
        table.contains(&format!("| {} | {:.3} [{:.3}, {:.3}], ", first.name, first.error, first.interval[0], first.interval[1])),
        "{table}"
    );
    assert!(
        table.contains(&format!("1:4, {} probes |", s.references[0].probes)) && table.lines().all(|l| l.matches('|').count() % 3 == 0),
        "{table}"
    );
    for figure in chart::figures(&report) {
        let (svg, png) = (figure.svg().unwrap(), figure.png().unwrap());
        let none = figure.name == "other_ratios" && s.fields.iter().all(|p| p.ratio == s.ratio);
        assert!(png.starts_with(b"\x89PNG") && (none || png.len() > 5_000), "{}", figure.name);
        // Names are escaped, and what cannot be drawn is left out. Savings come last: on a busy machine there may be none.
        let named = svg.contains("a &lt;b&gt; &amp; &quot;c&quot;") || figure.name == "savings" && s.savings.is_empty() || none;
        assert!(named && !svg.contains("<b>") && !svg.contains("NaN"), "{}", figure.name);
    }
    let machine = Machine::of(engine().device());
    let html = chart::report_html(&report, &machine).unwrap();
    let outside: Vec<&str> = html.match_indices("http").map(|(i, _)| &html[i..(i + 30).min(html.len())]).collect();
    assert!(outside.iter().all(|u| u.starts_with("http://www.w3.org/2000/svg")), "{outside:?}");
    assert!(html.contains("data:image/png;base64,") && html.contains(&machine.date) && !html.contains("<b> &"));
    let record = chart::record(&report, engine().device());
    assert!(record.figures.len() >= 2 * s.fields.len());
}

/// A sky that two bands hold whole leaves no floor from two bands on, and one band leaves what the second holds.
#[test]
fn bands_leave_what_they_cannot_hold() {
    let engine = engine();
    let gradient = Probe::from_fn(128, 64, |dir| [(1.0 + 0.9 * dir.z) as f32; 3]).unwrap();
    let subject = Subject { light: Light::from_probe(&gradient), sky: Sky::from_probe(&gradient), ..subject("gradient") };
    let report =
        chart::run(&engine, &[subject], &Options { seconds: 15.0, probes: 64, pixels: 32 * 24, judged: 32 * 24 }, &mut quiet).unwrap();
    let s = &report.subjects[0];
    let level = |bands| s.levels.iter().find(|l| l.bands == bands).map_or(0.0, |l| l.rmse);
    println!("floors {:?}, noise {}", [1, 2, 3, 4].map(level), s.image_reference_error);
    assert_eq!(s.floor, "SH-exact");
    // The noise is taken off in quadrature, from 500 pixels: a quarter of it remains at most.
    assert!(level(1) > 0.05 && (2..=4).all(|bands| level(bands) < 0.25 * level(1)), "{:?}", s.levels);
}

#[test]
fn a_cancel_is_heard() {
    let engine = engine();
    let options = Options { seconds: 60.0, probes: 64, pixels: 32 * 24, judged: 32 * 24 };
    let mut calls = 0;
    let mut stop = |_: &'static str, _: f32| {
        calls += 1;
        if calls > 20 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let done = chart::run(&engine, &[subject("a")], &options, &mut stop);
    assert!(matches!(done, Err(halflight::Error::Cancelled)));
}

#[test]
#[cfg(feature = "cli")]
fn the_command_writes_a_folder_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 12 8\nencoding: raw\n\n".to_vec();
    bytes.extend((0..16 * 12 * 8).map(|i| (i % 16 * 12) as u8));
    std::fs::write(folder.path().join("v.nrrd"), bytes).unwrap();
    let run = |arguments: &[&str]| {
        let out = Command::new(env!("CARGO_BIN_EXE_halflight")).current_dir(folder.path()).arg("chart").args(arguments).output().unwrap();
        (out.status.code(), String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap())
    };
    for (arguments, code, part) in [
        (&["v.nrrd"][..], 2, "--out <DIR>"),
        (&["v.nrrd", "-o", "r", "--budget", "0"], 2, "a number of seconds above 0"),
        (&["v.nrrd", "-o", "r", "--set", "visibility.method=march"], 2, "`visibility.method` changes nothing in a chart"),
        (&["-o", "r", "--visibility.ratio", "2"], 2, "`visibility.ratio` needs a SCENE to change"),
        (&["gone.nrrd", "-o", "r"], 3, "gone.nrrd: cannot open: no such file"),
        (&["v.nrrd", "-o", "r", "--transfer.points", "[[0, 1, 1, 1, 0]]"], 3, "the scene is empty"),
        (&["v.nrrd", "-o", "v.nrrd"], 3, "v.nrrd"),
    ] {
        let (got, stdout, stderr) = run(arguments);
        assert_eq!(got, Some(code), "{arguments:?}: {stderr}");
        assert!(stderr.contains(part) && stdout.is_empty(), "{arguments:?}: {stderr}");
        assert!(!folder.path().join("r").exists(), "{arguments:?}");
    }
    let arguments = ["v.nrrd", "-o", "r", "--budget", "4", "--json", "--image.width", "40", "--image.height", "30"];
    let (code, stdout, stderr) = run(&arguments);
    assert_eq!(code, Some(0), "{stderr}");
    let object: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert!(object["report"]["subjects"][0]["fields"].as_array().unwrap().len() >= 4 && object["machine"]["cores"].is_u64());
    for name in [
        "report.html",
        "report.json",
        "points.csv",
        "table.md",
        "field_error.svg",
        "field_error.png",
        "frame_error.svg",
        "packing.png",
        "savings.png",
        "record.json",
    ] {
        assert!(std::fs::metadata(folder.path().join("r").join(name)).unwrap().len() > 100, "{name}");
    }
    // Elsewhere than in this project's checkout nothing else is written; there, a record.
    let names = |at: &std::path::Path| -> Vec<_> { std::fs::read_dir(at).unwrap().map(|e| e.unwrap().file_name()).collect() };
    assert_eq!(names(folder.path()).len(), 2);
    let records = folder.path().join("benches/records");
    std::fs::create_dir_all(&records).unwrap();
    std::fs::write(folder.path().join("Cargo.toml"), "[package]\nname = \"halflight\"\n").unwrap();
    let (code, stdout, stderr) = run(&[&arguments[..5], &arguments[6..]].concat());
    assert_eq!(code, Some(0), "{stderr}");
    let kept = records.join(&names(&records)[0]);
    assert!(names(&records).len() == 1 && stdout.contains(&kept.display().to_string()), "{stdout}");
    assert_eq!(std::fs::read(kept).unwrap(), std::fs::read(folder.path().join("r/record.json")).unwrap());
}
