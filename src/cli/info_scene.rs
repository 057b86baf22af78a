//! `info` of a scene: what it asks for, beside its volume.

use super::info::v3;
use super::load::Loaded;
use super::report::Report;
use halflight::engine::precompute_memory;
use halflight::error::{bytes, escaped};
use halflight::scene::animation::Animation;
use halflight::scene::scene::LightSource;
use halflight::scene::{Scene, scene_at};
use serde_json::{Value, json};
use std::collections::HashSet;
use std::path::PathBuf;

/// Missing files that are named.
const SHOWN: usize = 6;

/// What a scene asks for.
pub fn say(report: &mut Report, scene: &Scene, loaded: &Loaded) {
    let (grid, v) = (loaded.volume.grid(), &scene.visibility);
    let [fx, fy, fz] = grid.field_dims(v.ratio as usize);
    // A plan finds the ratio, too, unless it is given; what it takes of memory it says then.
    let known = scene.wanted.is_none() || scene.origins.keys.contains_key("visibility.ratio");
    let mut field = json!({ "coefficients": v.coefficients(), "tolerance": scene.wanted.map(|w| w.tolerance()) });
    if known {
        field["dims"] = json!([fx, fy, fz]);
    }
    match scene.surface {
        Some(s) => report.line("surface", format!("iso {}, {}", s.iso, word(s.shading))),
        None => report.line(
            "matter",
            format!("{} colour and {} opacity points", loaded.matter.transfer.colors().len(), loaded.matter.transfer.opacities().len()),
        ),
    }
    report.line(
        "light",
        match &scene.light.source {
            LightSource::Probe(path) => format!("probe {}", path.display()),
            LightSource::Constant([r, g, b]) => format!("constant [{r}, {g}, {b}]"),
        },
    );
    match scene.wanted {
        Some(wanted) => {
            let dims = if known { format!("{fx}x{fy}x{fz}, ") } else { String::new() };
            report.line("field", format!("{dims}planned when it is computed, for an error of {}", wanted.tolerance()));
        }
        None => {
            report.line(
                "field",
                format!("{fx}x{fy}x{fz}, {} coefficients, {} directions, {}", v.coefficients(), v.directions, word(v.method)),
            );
            let (kept, scratch) = precompute_memory(grid, v);
            report.line("memory", format!("at most {} for the field, {} more while it is computed", bytes(kept), bytes(scratch)));
            (field["bytes"], field["scratch_bytes"]) = (json!(kept), json!(scratch));
        }
    }
    let (p, t) = (loaded.camera.position, loaded.camera.target);
    report.line("camera", format!("at {} towards {}, {} degrees", v3(p.to_array()), v3(t.to_array()), loaded.camera.fov_degrees));
    report.line("image", format!("{}x{} pixels", scene.image.width, scene.image.height));
    if let Some(animation) = &scene.animation {
        let (range, tracks) = (animation.range(), animation.tracks.iter().map(|t| t.channel).collect::<Vec<_>>().join(", "));
        let moves = if tracks.is_empty() { String::new() } else { format!("; {tracks}") };
        report.line("animation", format!("frames {} to {}, {} a second{moves}", range.start(), range.end(), animation.rate));
        if scene.volume.steps.is_some() {
            series(report, scene, animation);
        }
    }
    let given: serde_json::Map<String, Value> = scene.origins.keys.iter().map(|(k, o)| (k.clone(), json!(o))).collect();
    report.set("given", Value::Object(given));
    report.set("field", field);
    report.set("camera", json!({ "position": p.to_array(), "target": t.to_array(), "fov": loaded.camera.fov_degrees }));
    report.set("image", json!({ "width": scene.image.width, "height": scene.image.height }));
}

/// The files of a time series that its frames show.
fn series(report: &mut Report, scene: &Scene, animation: &Animation) {
    // Of each frame nothing but its file.
    let tracks = animation.tracks.iter().filter(|t| t.channel == "volume.number").cloned().collect();
    let bare = Scene {
        volume: scene.volume.clone(),
        animation: Some(Animation { tracks, ..animation.clone() }),
        ..Scene::of_volume(PathBuf::new())
    };
    let mut seen = HashSet::new();
    let files: Vec<PathBuf> =
        animation.range().map(|frame| scene_at(&bare, frame).volume.file).filter(|file| seen.insert(file.clone())).collect();
    let name = |file: &PathBuf| file.file_name().map_or_else(String::new, |n| escaped(&n.to_string_lossy()).collect());
    let missing: Vec<String> = files.iter().filter(|file| !file.exists()).map(name).collect();
    let (first, last) = (files.first().map_or_else(String::new, name), files.last().map_or_else(String::new, name));
    let mut text = match files.len() {
        1 => format!("1 file, {first}"),
        n => format!("{n} files, {first} to {last}"),
    };
    if !missing.is_empty() {
        text += &format!("; {} missing: {}", missing.len(), missing[..missing.len().min(SHOWN)].join(", "));
        text += if missing.len() > SHOWN { ", …" } else { "" };
    }
    report.line("series", text);
    report.set("series", json!({ "files": files.len(), "first": first, "last": last, "missing": missing }));
}

/// A choice as a scene writes it.
fn word(choice: impl std::fmt::Debug) -> String {
    format!("{choice:?}").to_lowercase()
}
