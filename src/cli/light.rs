//! `light`: a probe as spherical harmonics.

use super::Context;
use super::args_keys::{OF_LIGHT, check_used, overrides};
use super::fail::Failure;
use super::output::{Output, PICTURES};
use super::path_of;
use clap::ArgMatches;
use glam::DVec3;
use halflight::io;
use halflight::scene::scene::{LightSource, Scene};
use halflight::scene::{Light, Picture, Probe};
use serde_json::json;
use std::f64::consts::PI;

/// The six directions along the axes.
const AXES: [(&str, DVec3); 6] =
    [("+x", DVec3::X), ("-x", DVec3::NEG_X), ("+y", DVec3::Y), ("-y", DVec3::NEG_Y), ("+z", DVec3::Z), ("-z", DVec3::NEG_Z)];

/// `halflight light PROBE [-o FILE]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let path = path_of(m, "probe")?;
    let given = overrides(m).map_err(Failure::usage)?;
    check_used(&given, OF_LIGHT, "`light`").map_err(Failure::usage)?;
    let mut pairs: Vec<(&str, &str)> = given.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    let source = path.display().to_string();
    pairs.push(("light.probe", &source));
    // The settings of a scene's light, without a scene.
    let mut scene: Scene = io::scene_of_volume(path, &pairs)?;
    scene.light.source = LightSource::Probe(path.to_owned());
    let output = match m.get_one::<std::path::PathBuf>("out") {
        Some(out) => Some(Output::check(out, PICTURES)?),
        None => None,
    };
    if let Some(output) = &output {
        output.is_none_of(&[path])?;
    }
    let probe = io::read_probe(path)?;
    let light = scene.light.prepare(&Light::from_probe(&probe));

    report.line("probe", format!("{}, {}x{} pixels", path.display(), probe.width(), probe.height()));
    report.text(format!("  {:>2} {:>3} {:>12} {:>12} {:>12}", "l", "m", "red", "green", "blue"));
    for (i, [r, g, b]) in light.coefficients.iter().enumerate() {
        let l = i.isqrt() as i64;
        report.text(format!("  {l:>2} {:>3} {r:>12.5} {g:>12.5} {b:>12.5}", i as i64 - l * (l + 1)));
    }
    let energy = light.energy();
    let total: f64 = energy.iter().flatten().sum();
    for (l, band) in energy.iter().enumerate() {
        let share = if total > 0.0 { 100.0 * band.iter().sum::<f64>() / total } else { 0.0 };
        report.line(&format!("band {l}"), format!("{share:.2} % of the energy kept"));
    }
    report.text(format!("  {:<4} {:>34} {:>34}", "to", "probe", "projected"));
    let mut axes = serde_json::Map::new();
    for (name, dir) in AXES {
        let (p, s) = (scene.light.background(Some(&probe), dir), light.radiance(dir));
        report.text(format!("  {name:<4} {:>10.4} {:>11.4} {:>11.4} {:>10.4} {:>11.4} {:>11.4}", p[0], p[1], p[2], s[0], s[1], s[2]));
        axes.insert(name.into(), json!({ "probe": p, "projected": s }));
    }
    report.set("width", json!(probe.width()));
    report.set("height", json!(probe.height()));
    report.set("coefficients", json!(light.coefficients));
    report.set("energy", json!(energy));
    report.set("radiance", axes.into());
    if let Some(output) = output {
        output.write(&side_by_side(&scene, &probe, &light), scene.image.exposure, &[("probe".into(), source.clone())])?;
        report.wrote(&output.path);
        report.set("output", json!(output.path.display().to_string()));
    }
    report.finish()
}

/// The probe, and right of it its projection, both lat-long with +z at the top.
fn side_by_side(scene: &Scene, probe: &Probe, light: &Light) -> Picture {
    const HEIGHT: usize = 256;
    let mut picture = Picture::new(4 * HEIGHT, HEIGHT);
    for (p, pixel) in picture.rgba.iter_mut().enumerate() {
        let (x, y) = (p % (4 * HEIGHT), p / (4 * HEIGHT));
        let u = ((x % (2 * HEIGHT)) as f64 + 0.5) / (2 * HEIGHT) as f64;
        let ((sin, cos), (r, z)) = ((2.0 * PI * u).sin_cos(), (PI * (y as f64 + 0.5) / HEIGHT as f64).sin_cos());
        // u = 0 is +y, u = ¼ is +x: the probe's own convention.
        let dir = DVec3::new(r * sin, r * cos, z);
        let [red, green, blue] =
            if x < 2 * HEIGHT { scene.light.background(Some(probe), dir) } else { light.radiance(dir).map(|v| v.max(0.0) as f32) };
        *pixel = [red, green, blue, 1.0];
    }
    picture
}
