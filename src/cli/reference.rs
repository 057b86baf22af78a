//! `render --reference`: the picture without a visibility field, and how sure it is.

use super::Context;
use super::args_keys::OF_REFERENCE;
use super::fail::Failure;
use super::load;
use super::output::{Kind, PICTURES};
use super::progress::Progress;
use super::render::{asked, background, finish, picture_header};
use super::signals::Signals;
use clap::ArgMatches;
use halflight::engine::ReferenceSettings;
use halflight::io;
use halflight::scene::Sky;
use halflight::scene::scene::Background;
use serde_json::json;

/// `halflight render SCENE -o FRAME.exr|png --reference[=ERROR]`
pub fn render(context: &Context, m: &ArgMatches, signals: &Signals) -> Result<(), Failure> {
    let mut report = context.report();
    let (scene, output) = asked(m, PICTURES, (OF_REFERENCE, "a reference picture"))?;
    let defaults = ReferenceSettings::default();
    let settings = ReferenceSettings {
        error: m.get_one("reference").copied().unwrap_or(defaults.error),
        samples: m.get_one("samples").copied().unwrap_or(defaults.samples),
        seconds: m.get_one("seconds").copied(),
        ..defaults
    };
    let bar = Progress::new(&[load::READ, "upload", "reference", "write"]).until(signals);
    let loaded = load::load(&scene, &bar)?;
    let engine = context.engine()?;
    let ([x, y, z], [lo, hi], kind) = (loaded.volume.grid().dims(), loaded.volume.range(), loaded.volume.samples().type_name());
    report.device(&engine);
    report.line("volume", format!("{x}x{y}x{z} {kind}, {lo} to {hi}"));
    report.set("volume", json!({ "file": scene.volume.file.display().to_string(), "dims": [x, y, z], "type": kind, "range": [lo, hi] }));
    report.flush()?;
    bar.plan(&[("reference", 1.0)]);
    bar.enter("upload");
    let on_device = engine.upload(&loaded.volume)?;
    let medium = engine.classify_frame(&on_device, &loaded.matter, &scene.clip).map_err(|e| scene.origins.blame(e))?;
    let sky = Sky::from_settings(&scene.light, loaded.probe.as_ref())?;
    bar.enter("reference");
    let reference = engine
        .render_reference(&medium, &sky, &loaded.camera, &scene.image, &settings, &mut bar.job())
        .map_err(|e| scene.origins.blame(e))?;
    bar.check()?;
    bar.enter("write");
    let (samples, error) = (reference.samples, reference.relative_error);
    let mut picture = reference.picture;
    // What the volume covers is not seen in a picture over a background; a comparison asks for it.
    let covered: Option<Vec<f32>> =
        (scene.image.background != Background::Transparent).then(|| picture.rgba.iter().map(|p| p[3]).collect());
    background(&scene, &loaded, &mut picture)?;
    report.line("picture", format!("{}x{} pixels", picture.width, picture.height));
    let short = if error > settings.error { format!(", stopped before {}", settings.error) } else { String::new() };
    report.line("reference", format!("{samples} samples a pixel, relative standard error {error:.5}{short}"));
    report.set("picture", json!({ "width": picture.width, "height": picture.height }));
    report.set(
        "reference",
        json!({ "samples": samples, "relative_standard_error": error, "wanted": settings.error, "reached": error <= settings.error }),
    );
    let spans = engine.take_timings();
    let mut meta = picture_header(&scene, &loaded, &engine, &spans)?;
    meta.push(("reference".into(), format!("{samples} samples a pixel, relative standard error {error:.6}")));
    match output.kind {
        Kind::Exr => io::write_exr_with_error(output.place()?, &picture, &reference.standard_error, covered.as_deref(), &meta)?,
        _ => output.write(&picture, scene.image.exposure, &meta)?,
    }
    drop(bar);
    finish(context, report, &engine, &spans, &output)
}
