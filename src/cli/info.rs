//! `info`: what a file holds.

use super::Context;
use super::args_keys::{OF_VOLUME, check_used, overrides};
use super::fail::Failure;
use super::info_scene;
use super::load;
use super::output::Folder;
use super::path_of;
use super::progress::Progress;
use super::report::Report;
use clap::ArgMatches;
use halflight::chart;
use halflight::error::{Error, bytes, escaped, shown};
use halflight::io::{self, NrrdField, PictureInfo, VolumeInfo};
use halflight::measure;
use halflight::scene::{Probe, Scene};
use serde_json::{Map, json};
use std::io::Write;
use std::path::Path;

/// `halflight info FILE`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let path = path_of(m, "file")?;
    let overrides = overrides(m).map_err(Failure::usage)?;
    report.set("file", json!(path.display().to_string()));
    let single = !load::is_scene(path) && !io::is_volume_set(path);
    let picture = if single { io::describe_picture(path)? } else { None };
    if load::is_scene(path) {
        let scene = load::scene(path, &overrides)?;
        let loaded = load::load(&scene, &Progress::new(&[load::READ]))?;
        report.set("kind", json!("scene"));
        let info = io::describe(&loaded.volume);
        volume(&mut report, &scene, &info)?;
        plot(&mut report, m, &scene, &info)?;
        info_scene::say(&mut report, &scene, &loaded);
    } else if let Some(info) = picture {
        no_plot(m, "a picture")?;
        check_used(&overrides, &[], "the description of a picture").map_err(Failure::usage)?;
        // A header says all that is said here, also over pixels that are not there.
        io::whole_picture(path, &|_| true)?;
        report.set("kind", json!("picture"));
        self::picture(&mut report, path, &info);
    } else if single && io::is_probe(path)? {
        no_plot(m, "a probe")?;
        check_used(&overrides, &[], "the description of a probe").map_err(Failure::usage)?;
        report.set("kind", json!("probe"));
        probe(&mut report, path, &io::read_probe(path)?);
    } else if single && io::is_nrrd_field(path)? {
        no_plot(m, "a field")?;
        check_used(&overrides, &[], "the description of a field").map_err(Failure::usage)?;
        report.set("kind", json!("field"));
        field(&mut report, path, &io::read_nrrd_field(path, &Default::default())?);
    } else {
        check_used(&overrides, OF_VOLUME, "the description of a volume").map_err(Failure::usage)?;
        let scene = load::scene(path, &overrides)?;
        report.set("kind", json!("volume"));
        let info = load::volume_info(&scene)?;
        volume(&mut report, &scene, &info)?;
        guess(&mut report, &info);
        plot(&mut report, m, &scene, &info)?;
    }
    report.finish()
}

fn volume(report: &mut Report, scene: &Scene, info: &VolumeInfo) -> Result<(), Failure> {
    let [x, y, z] = info.dims;
    report.line("volume", scene.volume.file.display().to_string());
    report.line("dims", format!("{x}x{y}x{z} {}, {}", info.sample_type, bytes(info.bytes)));
    report.line("spacing", v3(info.spacing));
    report.line("axes", info.directions.map(v3).join(" "));
    report.line("corner", v3(info.corner));
    let voxels = info.dims.iter().map(|&n| n as u64).product::<u64>();
    match info.not_finite {
        0 => {}
        n => report.line("not finite", format!("{n} of {voxels} samples are NaN or infinite; to render, replace them with --nan-as VALUE")),
    }
    match info.not_finite == voxels {
        true => report.line("range", "none: no sample is finite"),
        false => report.line("range", format!("{} to {}, mean {}", info.range[0], info.range[1], short(info.mean))),
    }
    if (info.slope, info.intercept) != (1.0, 0.0) {
        report.line("rescale", format!("{}·sample + {}", info.slope, info.intercept));
    }
    report.line("histogram", bars(&info.histogram));
    let value = serde_json::to_value(info).map_err(|e| Failure::new(1, format!("the description cannot be written as JSON: {e}")))?;
    report.set("volume", value);
    Ok(())
}

fn no_plot(m: &ArgMatches, what: &str) -> Result<(), Failure> {
    match m.contains_id("plot") {
        true => Err(Failure::usage(format!("--plot draws the histogram of a volume, and this is {what}"))),
        false => Ok(()),
    }
}

/// A transfer function to begin with, as a scene has it.
fn guess(report: &mut Report, info: &VolumeInfo) {
    let points = io::guess_transfer(info);
    report.text("a first guess of a transfer function, for a scene:");
    report.text("  [transfer]");
    let rows = points.iter().map(|p| format!("[{}]", p.map(|v| v.to_string()).join(", "))).collect::<Vec<_>>();
    report.text(format!("  points = [{}]", rows.join(", ")));
    report.set("transfer", json!({ "reference": "voxel", "points": points }));
}

/// Draws the histogram where `--plot` asks for it.
fn plot(report: &mut Report, m: &ArgMatches, scene: &Scene, info: &VolumeInfo) -> Result<(), Failure> {
    let Some(path) = m.get_one::<std::path::PathBuf>("plot") else { return Ok(()) };
    let name = scene.volume.file.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let points = io::guess_transfer(info);
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let bytes = match extension.as_str() {
        "svg" => chart::histogram_svg(&name, info, &points)?.into_bytes(),
        "png" => chart::histogram_png(&name, info, &points)?,
        _ => return Err(Failure::usage(format!("--plot {}: it must end in .png or .svg", shown(path)))),
    };
    let _made = Folder::around(path)?;
    io::write_aside(path, |out| out.write_all(&bytes).map_err(|source| Error::Io { path: path.clone(), action: "write", source }))?;
    report.wrote(path);
    Ok(())
}

pub fn v3(v: [f64; 3]) -> String {
    // An axis has no direction -0.
    let v = v.map(|x| x + 0.0);
    format!("[{}, {}, {}]", short(v[0]), short(v[1]), short(v[2]))
}

/// A visibility field, and the scene that it was computed from.
fn field(report: &mut Report, path: &Path, field: &NrrdField) {
    let (grid, coefficients) = (&field.grid, field.coefficients);
    let [x, y, z] = grid.dims();
    // Cells far from matter are not computed, and zero. v₀₀ of a cell that sees everything is 2√π.
    let held = field.data.chunks_exact(coefficients).filter(|cell| cell.iter().any(|&v| v != 0.0));
    let (count, sum) = held.fold((0usize, 0.0), |(n, sum), cell| (n + 1, sum + f64::from(cell[0])));
    let visible = (count > 0).then(|| sum / count as f64 / (2.0 * std::f64::consts::PI.sqrt()));
    let size = 4 * field.data.len() as u64;
    let corner = grid.voxel_to_world().translation.to_array();
    report.line("field", path.display().to_string());
    report.line("dims", format!("{x}x{y}x{z} cells, {coefficients} coefficients (float32), {}", bytes(size)));
    report.line("spacing", v3(grid.spacing()));
    report.line("corner", v3(corner));
    let mean = visible.map_or_else(String::new, |v| format!("{:.2} % of the directions, on average over the ", 100.0 * v));
    report.line("visible", format!("{mean}{count} of {} cells that hold something", grid.voxels()));
    header(report, &field.meta);
    report.set(
        "field",
        json!({
            "dims": grid.dims(), "coefficients": coefficients, "bytes": size, "spacing": grid.spacing(), "corner": corner,
            "visible": visible, "cells_held": count,
        }),
    );
}

/// A picture of halflight's own, and the scene that it shows.
fn picture(report: &mut Report, path: &Path, info: &PictureInfo) {
    // "RGBA float, depth float": the channels before the first point are the picture itself.
    let mut layers: Vec<String> = Vec::new();
    for (name, number) in &info.channels {
        let layer = format!("{} {number}", name.split_once('.').map_or("RGBA", |(layer, _)| layer));
        if !layers.contains(&layer) {
            layers.push(layer);
        }
    }
    report.line("picture", format!("{}, {}x{} pixels, written by {}", path.display(), info.width, info.height, info.software));
    report.line("layers", layers.join(", "));
    header(report, &info.meta);
    let channels: Map<_, _> = info.channels.iter().map(|(name, number)| (name.clone(), json!(number))).collect();
    report.set("picture", json!({ "width": info.width, "height": info.height, "channels": channels, "software": info.software }));
}

/// What a file's header says of its making.
fn header(report: &mut Report, meta: &[(String, String)]) {
    let measured = measure::Report::from_meta(meta);
    if let Some(measured) = &measured {
        super::precompute::say(report, measured);
    }
    // Said already, where it can be read.
    let shown = |key: &str| measured.is_none() || !measure::Report::KEYS.contains(&key);
    for (key, value) in meta.iter().filter(|(key, _)| shown(key)) {
        let (key, mut lines) = (escaped(key).collect::<String>(), value.lines().map(|l| escaped(l).collect::<String>()));
        if value.trim_end().contains('\n') {
            report.line(&key, "");
            lines.for_each(|l| report.text(format!("  {l}")));
        } else {
            report.line(&key, lines.next().unwrap_or_default());
        }
    }
    report.set("meta", meta.iter().map(|(k, v)| (k.clone(), json!(v))).collect::<Map<_, _>>().into());
}

fn probe(report: &mut Report, path: &Path, probe: &Probe) {
    let brightest = probe.pixels().iter().flatten().fold(0f32, |a, &b| a.max(b));
    let mean = probe.mean();
    report.line("probe", format!("{}, {}x{} pixels", path.display(), probe.width(), probe.height()));
    report.line("mean", v3(mean));
    report.line("brightest", brightest.to_string());
    report.set("width", json!(probe.width()));
    report.set("height", json!(probe.height()));
    report.set("mean", json!(mean));
    report.set("brightest", json!(brightest));
}

/// A histogram in one line; the heights are logarithmic, empty bins are dots.
fn bars(histogram: &[u64]) -> String {
    const HEIGHTS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let most = (histogram.iter().copied().max().unwrap_or(0) as f64 + 1.0).ln();
    let bar = |&n: &u64| if n == 0 { '·' } else { HEIGHTS[((n as f64 + 1.0).ln() / most * 7.0) as usize % 8] };
    histogram.iter().map(bar).collect()
}

/// Six significant digits, no trailing zeros.
fn short(v: f64) -> String {
    let digits = 6 - v.abs().max(1e-3).log10().floor() as i32;
    let scale = 10f64.powi(digits.clamp(0, 12));
    format!("{}", (v * scale).round() / scale)
}
