//! `render`, and what `precompute` shares with it: the straight line from a scene to a file.

use super::Context;
use super::args_keys::{OF_SCENE, check_used, overrides};
use super::fail::Failure;
use super::field_file;
use super::layers::{Layers, Written};
use super::load::{self, Loaded};
use super::output::{Inputs, Kind, Output, PICTURES};
use super::path_of;
use super::plan;
use super::progress::Progress;
use super::report::{Report, many};
use super::signals::Signals;
use clap::ArgMatches;
use halflight::engine::{Engine, Field, Medium, Span};
use halflight::error::bytes;
use halflight::io;
use halflight::measure::{PictureError, Pictured};
use halflight::scene::scene::{Background, fill_background};
use halflight::scene::visibility::Method;
use halflight::scene::{Camera, Grid, ImageSettings, Picture, Probe, Scene, Sky, Visibility, scene_at};
use serde_json::json;
use std::path::Path;

/// `halflight render SCENE -o FRAME.exr|png`
pub fn render(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    stoppable(|signals| match m.contains_id("reference") {
        true => super::reference::render(context, m, signals),
        false => plain(context, m, signals),
    })
}

/// Work that SIGINT and SIGTERM end at the next dispatch or piece of a volume's file, before its output is written.
pub fn stoppable(work: impl FnOnce(&Signals) -> Result<(), Failure>) -> Result<(), Failure> {
    let signals = Signals::listen()?;
    work(&signals).map_err(|failure| signals.failure().unwrap_or(failure))
}

fn plain(context: &Context, m: &ArgMatches, signals: &Signals) -> Result<(), Failure> {
    let mut report = context.report();
    let (mut scene, output) = asked(m, PICTURES, (OF_SCENE, "a single picture"))?;
    let (given, written) = (field_file::given(m, &scene)?, Written::of(m, &output.path)?);
    let mut stages = vec![load::READ, "upload", "visibility", "relight", "render", "write"];
    let budget = m.get_one::<f64>("measure").copied();
    if budget.is_some() {
        stages.insert(5, "measure");
    }
    if written.behind() {
        stages.insert(5, "layers");
    }
    if scene.wanted.is_some() {
        stages.insert(2, plan::STAGE);
    }
    let bar = Progress::new(&stages).until(signals);
    let loaded = load::load(&scene, &bar)?;
    let engine = context.engine()?;
    let (medium, field) = visibility(&engine, &mut scene, &loaded, (Some(&written), given.as_deref()), &bar, &mut report)?;
    bar.enter("relight");
    let lit = engine.relight(&field, &loaded.light)?;
    bar.enter("render");
    let (mut picture, hits) = engine.render_with_distance(&medium, &lit, &loaded.camera, &scene.image, &mut bar.job())?;
    if written.behind() {
        bar.enter("layers");
    }
    let of = (&medium, &loaded.matter, &lit);
    let behind = written.gather(&engine, of, (&loaded.camera, &scene.image), (&picture, &hits), &mut bar.job())?;
    report.line("picture", format!("{}x{} pixels", picture.width, picture.height));
    report.set("picture", json!({ "width": picture.width, "height": picture.height }));
    let spans = engine.take_timings();
    let mut meta = picture_header(&scene, &loaded, &engine, &spans)?;
    if let Some(seconds) = budget {
        report.flush()?;
        bar.enter("measure");
        let sky = Sky::from_settings(&scene.light, loaded.probe.as_ref())?;
        let of = Pictured { medium: &medium, lit: &lit, sky: &sky, camera: &loaded.camera, image: &scene.image };
        match PictureError::measure(&engine, &of, seconds, &mut bar.job())? {
            Some(error) => {
                report.line("error", error.sentence());
                report.set("picture_error", json!(error));
                meta.extend(error.meta());
            }
            None => report.line("error", "not measured: nothing is seen, or nothing that is lit"),
        }
    }
    bar.check()?;
    bar.enter("write");
    background(&scene, &loaded, &mut picture)?;
    written.write(&output, &Layers { picture, behind }, &scene, &meta)?;
    drop(bar);
    finish(context, report, &engine, &spans, &output)
}

/// What an output file says of its making: the whole scene, the device, and each kernel's time.
pub fn header(scene: &Scene, engine: &Engine, spans: &[Span]) -> Vec<(String, String)> {
    let timings: Vec<String> = spans.iter().map(|s| format!("{} {:.6} s in {} dispatches", s.kernel, s.seconds, s.calls)).collect();
    let device = engine.device();
    vec![
        ("scene".into(), io::scene_text(scene)),
        ("device".into(), format!("{}; {}", device.name, device.driver)),
        ("timings".into(), timings.join("; ")),
    ]
}

/// The same of a picture: its camera where it stands, too.
pub fn picture_header(scene: &Scene, loaded: &Loaded, engine: &Engine, spans: &[Span]) -> Result<Vec<(String, String)>, Failure> {
    let mut meta = header(&scene.placed(loaded.volume.grid()), engine, spans);
    meta.extend(io::camera_meta(&loaded.camera, scene.image.aspect())?);
    Ok(meta)
}

/// The scene and the checked output of a command line, for `work` by the keys that it uses.
pub fn asked(m: &ArgMatches, kinds: &[(&str, Kind)], (used, work): (&[&str], &str)) -> Result<(Scene, Output), Failure> {
    let path = path_of(m, "scene")?;
    let overrides = overrides(m).map_err(Failure::usage)?;
    check_used(&overrides, used, work).map_err(Failure::usage)?;
    let output = Output::check(path_of(m, "out")?, kinds)?;
    let mut scene = load::scene(path, &overrides)?;
    if let Some(&frame) = m.try_get_one::<i64>("frame").ok().flatten() {
        let animation = scene.animation.as_ref().ok_or_else(|| Failure::usage("--frame: the scene has no [animation]"))?;
        load::check_frame(animation, frame, "--frame")?;
        scene = scene_at(&scene, frame);
    }
    let mut inputs = load::inputs(&scene);
    inputs.push(path.to_owned());
    Inputs::of(inputs).spare(&output.path)?;
    Ok((scene, output))
}

/// Volume to the device, matter on it, visibility of it. Says what the whole scene will need, with its picture under its light
/// if one is to be `written`, before it starts. A field file may be `given` in place of computing it. The scene then holds the
/// settings that were used.
pub fn visibility(
    engine: &Engine,
    scene: &mut Scene,
    loaded: &Loaded,
    (written, given): (Option<&Written>, Option<&Path>),
    bar: &Progress,
    report: &mut Report,
) -> Result<(Medium, Field), Failure> {
    let (volume, grid) = (&loaded.volume, loaded.volume.grid());
    let pixels = written.map(|_| (scene.image.width, scene.image.height));
    let ([x, y, z], [lo, hi], kind) = (grid.dims(), volume.range(), volume.samples().type_name());
    report.device(engine);
    report.line("volume", format!("{x}x{y}x{z} {kind}, {lo} to {hi}"));
    report.set("volume", json!({ "file": scene.volume.file.display().to_string(), "dims": [x, y, z], "type": kind, "range": [lo, hi] }));
    if pixels.is_some() && given.is_none() {
        plan::bands(scene, loaded, report);
    }
    if scene.wanted.is_none() && given.is_none() {
        said(grid, &scene.visibility, report);
    }
    report.flush()?;

    let [visibility, render] = works(&scene.visibility, &scene.image, grid);
    bar.plan(&[visibility, render, (plan::STAGE, visibility.1)]);
    bar.enter("upload");
    let on_device = engine.upload(volume)?;
    let medium = engine.classify_frame(&on_device, &loaded.matter, &scene.clip).map_err(|e| scene.origins.blame(e))?;
    if let Some(path) = given {
        let keys = field_file::keys(scene, volume, &loaded.matter);
        let field = field_file::read(engine, path, volume, scene, &keys, None)?.field;
        (scene.visibility, scene.wanted) = (field.settings().clone(), None);
        report.line("field", format!("{}, {} packed", path.display(), bytes(field.bytes())));
        return Ok((medium, field));
    }
    if scene.wanted.is_none() {
        let need = engine.admit(&medium, &scene.visibility, pixels).map_err(|e| scene.origins.blame(e))?;
        report.needs(engine, need.peak() + written.map_or(0, |w| w.bytes(&scene.image)));
        report.flush()?;
    }
    let field = match plan::field(engine, scene, loaded, &medium, pixels, bar, report)? {
        Some(made) => made.field,
        None => {
            bar.enter("visibility");
            engine.precompute(&medium, &scene.visibility, &mut bar.job()).map_err(|e| scene.origins.blame(e))?
        }
    };
    let (v, coefficients) = (&scene.visibility, scene.visibility.coefficients());
    report.set(
        "field",
        json!({ "dims": field.dims(), "ratio": v.ratio, "coefficients": coefficients, "bits": v.bits, "bytes": field.bytes() }),
    );
    report.line("field", format!("{} packed", bytes(field.bytes())));
    Ok((medium, field))
}

/// Says what field there will be.
fn said(grid: &Grid, v: &Visibility, report: &mut Report) {
    let ([fx, fy, fz], coefficients) = (grid.field_dims(v.ratio as usize), v.coefficients());
    let packing = if v.bits == 32 { "32-bit float".into() } else { format!("{} bits", v.bits) };
    let fitted = if v.fit > 0 { format!(", fitted to {} points a cell", v.fit) } else { String::new() };
    report.line(
        "field",
        format!("{fx}x{fy}x{fz} (1:{}), {} of {packing}, {} directions{fitted}", v.ratio, many(coefficients, "coefficient"), v.directions),
    );
}

/// Trilinear taps of the long stages, roughly: what the bar shows as their shares.
pub fn works(v: &Visibility, image: &ImageSettings, grid: &Grid) -> [(&'static str, f64); 2] {
    let side = grid.dims().into_iter().max().unwrap_or(1) as f64;
    let cells: f64 = grid.field_dims(v.ratio as usize).iter().map(|&n| n as f64).product();
    // A ray leaves after half the longest side, on average.
    let (way, growth) = (0.5 * side, f64::from(v.growth));
    let taps = match v.method {
        Method::March => way / f64::from(v.step),
        Method::Sweep => (f64::from(v.near * v.ratio) * 1.3 / f64::from(v.step) + 2.0) * (1.0 + 0.5 * f64::from(v.fit)),
        // Single voxels up to 1/growth, then steps that grow with the distance; two levels a tap.
        Method::Hierarchical => 2.0 * (way.min(1.0 / growth) + (way * growth).max(1.0).ln() / growth),
    };
    // Half of the pixels see the box; each step asks for a value and its light.
    let pixels = 0.5 * (image.width * image.height) as f64;
    [("visibility", cells * f64::from(v.directions) * taps), ("render", pixels * 2.0 * side / image.step)]
}

/// Lays the picture over its background, if the scene has one.
pub(super) fn background(scene: &Scene, loaded: &Loaded, picture: &mut Picture) -> Result<(), Failure> {
    if scene.image.background == Background::Transparent {
        return Ok(());
    }
    lay_background(scene, loaded.volume.grid(), &loaded.camera, loaded.probe.as_ref(), picture)
}

/// The same of a scene's parts.
pub fn lay_background(scene: &Scene, grid: &Grid, camera: &Camera, probe: Option<&Probe>, picture: &mut Picture) -> Result<(), Failure> {
    let rays = camera.rays(grid, picture.width, picture.height)?;
    match scene.image.background {
        Background::Transparent => {}
        Background::Color(rgb) => fill_background(picture, &rays, |_| rgb),
        Background::Light => fill_background(picture, &rays, |dir| scene.light.background(probe, dir)),
    }
    Ok(())
}

/// Says what was done, unless validation had something to say.
pub fn finish(context: &Context, mut report: Report, engine: &Engine, spans: &[Span], output: &Output) -> Result<(), Failure> {
    report.work(engine, spans);
    report.wrote(&output.path);
    report.set("output", json!(output.path.display().to_string()));
    context.verdict(engine)?;
    report.finish()
}
