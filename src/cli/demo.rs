//! `demo`: two pictures of a made-up scene, and what each kernel took.

use super::Context;
use super::fail::Failure;
use super::output::{Folder, Output, PICTURES};
use super::path_of;
use super::progress::Progress;
use super::render::works;
use clap::ArgMatches;
use halflight::demo;
use halflight::scene::scene::fill_background;
use halflight::scene::{ImageSettings, Light, Probe};
use serde_json::json;

/// `halflight demo [-o DIR] [--quick]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let folder = path_of(m, "out")?;
    let quick = m.get_flag("quick");
    let engine = context.engine()?;
    let _made = Folder::make(folder)?;
    report.device(&engine);
    report.flush()?;

    let bar = Progress::new(&["model", "visibility", "render", "write", "visibility", "render", "write"]);
    bar.enter("model");
    let volume = demo::volume(128)?;
    let probe = Probe::two_colored();
    let light = Light::from_probe(&probe);
    let settings = demo::visibility(quick);
    let camera = demo::camera(volume.grid());
    let (width, height) = if quick { (320, 240) } else { (640, 480) };
    let image = ImageSettings { width, height, step: 0.5, ..ImageSettings::default() };
    let rays = camera.rays(volume.grid(), width, height)?;
    let on_device = engine.upload(&volume)?;
    bar.plan(&works(&settings, &image, volume.grid()));
    let mut written = Vec::new();
    let scenes = [("demo_dvr", demo::dvr()?), ("demo_iso", demo::iso()?)];
    for ((name, matter), exposure) in scenes.into_iter().zip(demo::EXPOSURES) {
        let medium = engine.classify(&on_device, &matter)?;
        bar.enter("visibility");
        let field = engine.precompute(&medium, &settings, &mut bar.job())?;
        let lit = engine.relight(&field, &light)?;
        bar.enter("render");
        let mut picture = engine.render(&medium, &lit, &camera, &image, &mut bar.job())?;
        bar.enter("write");
        let backdrop = demo::BACKGROUND.map(|v| v * 0.5f32.powf(exposure as f32));
        fill_background(&mut picture, &rays, |_| backdrop);
        for extension in ["png", "exr"] {
            let output = Output::check(&folder.join(format!("{name}.{extension}")), PICTURES)?;
            output.write(&picture, exposure, &[("scene".into(), name.into())])?;
            report.wrote(&output.path);
            written.push(output.path.display().to_string());
        }
        report.flush()?;
    }
    drop(bar);
    report.set("outputs", json!(written));
    report.work(&engine, &engine.take_timings());
    context.verdict(&engine)?;
    report.finish()
}
