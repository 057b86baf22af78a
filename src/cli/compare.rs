//! `compare`: a picture against its reference, in numbers and as a picture of the difference.

use super::Context;
use super::fail::Failure;
use super::output::{Kind, Output, PICTURES};
use super::path_of;
use clap::ArgMatches;
use halflight::Error;
use halflight::error::shown;
use halflight::io::{self, PictureKind};
use halflight::measure::{self, Difference, flip};
use halflight::scene::scene::Background;
use serde_json::json;
use std::path::Path;

/// `halflight compare PICTURE REFERENCE [-o DIFFERENCE.png|exr]`
pub fn run(context: &Context, m: &ArgMatches) -> Result<(), Failure> {
    let mut report = context.report();
    let paths = [path_of(m, "picture")?, path_of(m, "reference")?];
    let output = match m.get_one::<std::path::PathBuf>("out") {
        Some(path) => Some(Output::check(path, PICTURES)?),
        None => None,
    };
    if let Some(output) = &output {
        output.is_none_of(&paths)?;
    }
    let [(kind, a), (other, mut b)] = [io::read_picture(paths[0])?, io::read_picture(paths[1])?];
    if kind != other {
        let what = |kind| if kind == PictureKind::Radiance { "linear radiance (OpenEXR)" } else { "for display (PNG)" };
        return Err(wrong(paths[0], format!("it is {}, the reference is {}", what(kind), what(other)), "both must be of one kind"));
    }
    let own = io::read_coverage(paths[1])?.filter(|own| own.len() == b.rgba.len());
    if let Some(own) = &own {
        b.rgba.iter_mut().zip(own).for_each(|(p, &covered)| p[3] = covered);
    } else if b.rgba.iter().all(|p| p[3] > 0.0) && has_background(paths[1])? {
        let warning = format!(
            "{}: its background counts as picture and makes the error over covered pixels look smaller; write the reference as .exr with \
             render --reference or --aov opacity, which says what the volume covers",
            shown(paths[1])
        );
        log::warn!("{warning}");
        report.set("warning", json!(warning));
    }
    // The library knows no files: what it refuses is said of them.
    let blame = |e: Error| match e {
        Error::Invalid { what, right, .. } => wrong(paths[0], format!("compared with {}: {what}", shown(paths[1])), &right),
        other => other.into(),
    };
    let difference = measure::compare(&a, &b).map_err(blame)?;
    let flip = match kind {
        PictureKind::Radiance => flip::radiance(&a, &b),
        PictureKind::Display => flip::display(&a, &b),
    };
    let flip = flip.map_err(blame)?;

    let Difference { size: [width, height], covered, max, max_at: [x, y, c], .. } = difference;
    report.line("picture", format!("{}, {width}x{height} pixels", shown(paths[0])));
    let layer = if own.is_some() { " (its layer opacity; of a background what shines through there counts)" } else { "" };
    report.line("reference", format!("{}, covers {covered} of {}{layer}", shown(paths[1]), width * height));
    let figure = |v: Option<f64>| v.map_or_else(|| "none: the reference is black".into(), |v| format!("{v:.5}"));
    report.line(
        "rel. RMSE",
        format!(
            "{} over covered pixels, {} over all, each of the reference's mean there",
            figure(difference.relative_rmse),
            figure(difference.relative_rmse_all)
        ),
    );
    report.line("mean ratio", format!("{} over covered pixels", figure(difference.mean_ratio)));
    report.line("largest", format!("{max:.6} in {} at column {x}, row {y}", ["red", "green", "blue"][c]));
    let name = match flip.exposures {
        Some((first, last, count)) => format!("HDR-FLIP over {count} exposures, {first:+.2} to {last:+.2} stops"),
        None => "LDR-FLIP".into(),
    };
    report
        .line("FLIP", format!("{:.6} mean, {:.6} largest ({name}; {:.1} pixels per degree)", flip.mean, flip.max, flip::PIXELS_PER_DEGREE));
    let weighted: Vec<String> = flip::PERCENTILES.iter().zip(flip.weighted).map(|(p, v)| format!("{p} %: {v:.4}")).collect();
    report.line("weighted", weighted.join("  "));
    report.set("picture", json!(paths[0].display().to_string()));
    report.set("reference", json!(paths[1].display().to_string()));
    report.set("coverage", json!(if own.is_some() { "opacity" } else { "alpha" }));
    report.set("difference", json!(difference));
    report.set(
        "flip",
        json!({
            "kind": if flip.exposures.is_some() { "hdr" } else { "ldr" }, "mean": flip.mean, "max": flip.max,
            "weighted_percentiles": flip::PERCENTILES.iter().zip(flip.weighted).map(|(p, v)| (p.to_string(), json!(v))).collect::<serde_json::Map<_, _>>(),
            "exposures": flip.exposures.map(|(first, last, count)| json!({ "first": first, "last": last, "count": count })),
            "pixels_per_degree": flip::PIXELS_PER_DEGREE,
        }),
    );
    if let Some(output) = output {
        let meta = [("picture", paths[0]), ("reference", paths[1])].map(|(key, path)| (key.to_owned(), shown(path)));
        // Signed numbers for programs, the map's colours for the eye.
        let drawn = match output.kind {
            Kind::Exr => measure::signed(&a, &b).map_err(blame)?,
            _ => flip.drawn(b.width, b.height),
        };
        output.write(&drawn, 0.0, &meta)?;
        report.wrote(&output.path);
        report.set("output", json!(output.path.display().to_string()));
    }
    report.finish()
}

/// Whether a picture was laid over a background, by the scene in its header.
fn has_background(path: &Path) -> Result<bool, Failure> {
    let Some(info) = io::describe_picture(path)? else { return Ok(false) };
    let text = info.meta.iter().find(|(key, _)| key == "scene").map(|(_, text)| text.as_str());
    let scene = text.and_then(|text| io::parse_scene(text, "", Path::new(""), &[]).ok());
    Ok(scene.is_some_and(|scene| scene.image.background != Background::Transparent))
}

fn wrong(path: &Path, what: String, right: &str) -> Failure {
    Error::Format { path: path.to_owned(), what, right: right.into() }.into()
}
