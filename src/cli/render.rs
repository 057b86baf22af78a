//! `precompute` and `render`: the straight line from a scene to a file.

use super::Context;
use super::args::{OF_FIELD, OF_SCENE, check_used, overrides};
use super::fail::Failure;
use super::load::{self, Loaded};
use super::output::{Kind, Output, PICTURES};
use super::path_of;
use super::progress::Progress;
use super::report::Report;
use clap::ArgMatches;
use halflight::engine::{Engine, Field, Medium, Span};
use halflight::error::bytes;
use halflight::io;
use halflight::scene::scene::{Background, LightSource, TransferSource, fill_background};
use halflight::scene::{Picture, Scene};
use serde_json::json;
use std::path::Path;

/// `halflight precompute SCENE -o FIELD.nrrd`
pub fn precompute(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let (scene, output) = asked(m, &[("nrrd", Kind::Nrrd)], OF_FIELD)?;
    let loaded = load::load(&scene)?;
    let engine = context.engine()?;
    let (_, field) = visibility(&engine, &scene, &loaded, None, &mut report)?;
    let data = engine.read_field(&field)?;
    let spans = engine.take_timings();
    let meta = header(&scene, &engine, &spans);
    io::write_nrrd_field(&output.path, field.dims(), scene.visibility.coefficients(), &data, loaded.volume.grid(), &meta)?;
    finish(context, report, &engine, &spans, &output)
}

/// `halflight render SCENE -o FRAME.exr|png`
pub fn render(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let (scene, output) = asked(m, PICTURES, OF_SCENE)?;
    let loaded = load::load(&scene)?;
    let engine = context.engine()?;
    let (medium, field) = visibility(&engine, &scene, &loaded, Some((scene.image.width, scene.image.height)), &mut report)?;
    let lit = engine.relight(&field, &loaded.light)?;
    let bar = Progress::new();
    let mut picture = engine.render(&medium, &lit, &loaded.camera, &scene.image, &mut bar.job())?;
    drop(bar);
    background(&scene, &loaded, &mut picture)?;
    report.line("picture", format!("{}x{} pixels", picture.width, picture.height));
    report.set("picture", json!({ "width": picture.width, "height": picture.height }));
    let spans = engine.take_timings();
    output.write(&picture, scene.image.exposure, &header(&scene, &engine, &spans))?;
    finish(context, report, &engine, &spans, &output)
}

/// What an output file says of its making: the whole scene, the device, and each kernel's time.
fn header(scene: &Scene, engine: &Engine, spans: &[Span]) -> Vec<(String, String)> {
    let timings: Vec<String> = spans.iter().map(|s| format!("{} {:.6} s in {} dispatches", s.kernel, s.seconds, s.calls)).collect();
    let device = engine.device();
    vec![
        ("scene".into(), io::scene_text(scene)),
        ("device".into(), format!("{}; {}", device.name, device.driver)),
        ("timings".into(), timings.join("; ")),
    ]
}

/// The scene and the checked output of a command line.
fn asked(m: &ArgMatches, kinds: &[(&str, Kind)], used: &[&str]) -> Result<(Scene, Output), Failure> {
    let path = path_of(m, "scene")?;
    let overrides = overrides(m).map_err(Failure::usage)?;
    check_used(&overrides, used, "a visibility field").map_err(Failure::usage)?;
    let output = Output::check(path_of(m, "out")?, kinds)?;
    let scene = load::scene(path, &overrides)?;
    let mut inputs: Vec<&Path> = vec![path, &scene.volume.file];
    if let LightSource::Probe(probe) = &scene.light.source {
        inputs.push(probe);
    }
    if let TransferSource::File { path, .. } = &scene.transfer {
        inputs.push(path);
    }
    output.is_none_of(&inputs)?;
    Ok((scene, output))
}

/// Volume to the device, matter on it, visibility of it. Says what the whole scene will need, with a picture of `pixels`,
/// before it starts.
fn visibility(
    engine: &Engine,
    scene: &Scene,
    loaded: &Loaded,
    pixels: Option<(usize, usize)>,
    report: &mut Report,
) -> Result<(Medium, Field), Failure> {
    let (volume, grid, v) = (&loaded.volume, loaded.volume.grid(), &scene.visibility);
    let ([x, y, z], [lo, hi], kind) = (grid.dims(), volume.range(), volume.samples().type_name());
    report.device(engine);
    report.line("volume", format!("{x}x{y}x{z} {kind}, {lo} to {hi}"));
    report.set("volume", json!({ "file": scene.volume.file.display().to_string(), "dims": [x, y, z], "type": kind, "range": [lo, hi] }));
    let [fx, fy, fz] = grid.field_dims(v.ratio as usize);
    let coefficients = v.coefficients();
    let packing = if v.bits == 32 { "32-bit float".into() } else { format!("{} bits", v.bits) };
    report.line("field", format!("{fx}x{fy}x{fz} (1:{}), {coefficients} coefficients of {packing}, {} directions", v.ratio, v.directions));
    let need = engine.admit(volume, v, pixels).map_err(|e| scene.origins.blame(e))?;
    report.needs(engine, need.peak());
    report.flush()?;

    let on_device = engine.upload(volume)?;
    let medium = engine.classify(&on_device, &loaded.matter).map_err(|e| scene.origins.blame(e))?;
    let bar = Progress::new();
    let field = engine.precompute(&medium, v, &mut bar.job()).map_err(|e| scene.origins.blame(e))?;
    drop(bar);
    report.set(
        "field",
        json!({ "dims": field.dims(), "ratio": v.ratio, "coefficients": coefficients, "bits": v.bits, "bytes": field.bytes() }),
    );
    report.line("field", format!("{} packed", bytes(field.bytes())));
    Ok((medium, field))
}

/// Lays the picture over its background, if the scene has one.
fn background(scene: &Scene, loaded: &Loaded, picture: &mut Picture) -> Result<(), Failure> {
    if scene.image.background == Background::Transparent {
        return Ok(());
    }
    let rays = loaded.camera.rays(loaded.volume.grid(), picture.width, picture.height)?;
    match scene.image.background {
        Background::Color(rgb) => fill_background(picture, &rays, |_| rgb),
        _ => fill_background(picture, &rays, |dir| scene.light.background(loaded.probe.as_ref(), dir)),
    }
    Ok(())
}

fn finish(context: &Context, mut report: Report, engine: &Engine, spans: &[Span], output: &Output) -> Result<(), Failure> {
    report.work(engine, spans);
    report.wrote(&output.path);
    report.set("output", json!(output.path.display().to_string()));
    context.verdict(engine)?;
    report.finish()
}
