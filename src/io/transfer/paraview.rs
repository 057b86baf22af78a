//! ParaView's JSON presets, also those of vtk.js: `RGBPoints` (x, r, g, b; display sRGB), often `Points` (x, opacity,
//! midpoint, sharpness), and how colours are interpolated. A preset within 0..1 is relative: ParaView rescales it to the
//! data's range; so is one of -1..1, which most of its own presets have. Without `Points` the opacity rises linearly from 0 to 1
//! over the colours' range, ParaView's default.

use super::super::limits::{bad, quote};
use super::color::Space;
use super::preset::POINTS;
use super::{Named, Preset, niivue};
use crate::error::Result;
use serde_json::{Value, json};
use std::path::Path;

/// The presets of a JSON text.
pub(super) fn read(path: &Path, text: &str, stem: &str) -> Result<(&'static str, Vec<Named>)> {
    let json: Value = serde_json::from_str(text).map_err(|e| {
        bad(
            path,
            format!("it is no JSON: {}", quote(&e.to_string())),
            "presets of ParaView and NiiVue are JSON; other programs' are known by their extension",
        )
    })?;
    if niivue::is_map(&json) {
        let preset = niivue::read(path, &json, stem)?;
        return Ok(("NiiVue", vec![Named { name: preset.name.clone(), preset: Ok(preset) }]));
    }
    let presets: Vec<&Value> = match &json {
        Value::Array(all) => all.iter().filter(|p| p.is_object()).collect(),
        Value::Object(_) => vec![&json],
        _ => Vec::new(),
    };
    if presets.is_empty() {
        return Err(bad(path, "it holds no preset", "a preset is a JSON object with RGBPoints, or an array of them"));
    }
    let named = |json: &Value| {
        let name = json.get("Name").and_then(Value::as_str).unwrap_or("").to_owned();
        Named { preset: preset(path, json, &name), name }
    };
    Ok(("ParaView", presets.into_iter().map(named).collect()))
}

/// A list of numbers in groups of `N`.
fn points<const N: usize>(path: &Path, json: &Value, key: &str) -> Result<Option<Vec<[f64; N]>>> {
    let Some(value) = json.get(key).filter(|v| !v.is_null()) else { return Ok(None) };
    let wrong = |what: String| bad(path, format!("its {key} {what}"), format!("it must be a list of finite numbers, {N} per point"));
    let list = value.as_array().ok_or_else(|| wrong("is no list".into()))?;
    if list.is_empty() || list.len() % N != 0 || list.len() / N > POINTS {
        return Err(wrong(format!("has {} numbers", list.len())));
    }
    let mut points = Vec::with_capacity(list.len() / N);
    for group in list.chunks_exact(N) {
        let mut point = [0.0; N];
        for (number, value) in point.iter_mut().zip(group) {
            // JSON has no infinity; a number beyond f64 is refused by the parser.
            *number = value.as_f64().ok_or_else(|| wrong(format!("has '{}'", quote(&value.to_string()))))?;
        }
        points.push(point);
    }
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    Ok(Some(points))
}

fn preset(path: &Path, json: &Value, name: &str) -> Result<Preset> {
    let Some(colors) = points::<4>(path, json, "RGBPoints")? else {
        let right = "a continuous preset with RGBPoints is needed";
        let what = match json.get("IndexedColors") {
            Some(_) => "it has IndexedColors: a palette for categories, not for a continuous scalar",
            None if json.get("volumeProperties").is_some() => {
                return Err(bad(
                    path,
                    "it is a volume property of Slicer as JSON",
                    "Slicer's .vp and presets.xml are read: save it as .vp",
                ));
            }
            None => "it has no RGBPoints",
        };
        return Err(bad(path, what, right));
    };
    let (first, last) = (colors[0][0], colors[colors.len() - 1][0]);
    let opacities = points::<4>(path, json, "Points")?.unwrap_or_else(|| vec![[first, 0.0, 0.5, 0.0], [last, 1.0, 0.5, 0.0]]);
    let colors = colors.iter().map(|p| (p[0], [p[1], p[2], p[3]])).collect();
    let mut preset = Preset::new(name, colors, opacities);
    preset.relative = preset.domain[0] >= 0.0 && preset.domain[1] <= 1.0 || preset.domain == [-1.0, 1.0];
    preset.space = space(path, json)?;
    if json.get("UseLogScale").and_then(Value::as_f64).is_some_and(|v| v != 0.0) {
        preset.lost.push("UseLogScale: colours over the scalar's logarithm; they are taken over the scalar".into());
    }
    preset.checked(path)
}

fn space(path: &Path, json: &Value) -> Result<Space> {
    // ParaView's switch; its presets rarely write it, its default is off.
    let wrap = json.get("HSVWrap").is_some_and(|v| v.as_bool().unwrap_or(v.as_f64().is_some_and(|n| n != 0.0)));
    let Some(name) = json.get("ColorSpace") else { return Ok(Space::Rgb) };
    Ok(match name.as_str().map(str::to_ascii_lowercase).as_deref() {
        Some("rgb") => Space::Rgb,
        Some("hsv") => Space::Hsv { wrap },
        Some("wrapped") => Space::Hsv { wrap: true },
        Some("lab" | "cielab") => Space::Lab,
        Some("diverging") => Space::Diverging,
        Some("step") => Space::Step,
        _ => {
            let what = format!("its ColorSpace is {}", quote(&name.to_string()));
            return Err(bad(path, what, "RGB, HSV, Lab, Diverging and Step are read"));
        }
    })
}

/// The presets as ParaView reads them.
pub(super) fn write(presets: &[Preset]) -> String {
    let list: Vec<Value> = presets.iter().map(object).collect();
    format!("{:#}\n", Value::Array(list))
}

fn object(preset: &Preset) -> Value {
    let (space, wrap) = match preset.space {
        Space::Rgb => ("RGB", false),
        Space::Hsv { wrap } => ("HSV", wrap),
        Space::Lab => ("Lab", false),
        Space::Diverging => ("Diverging", false),
        Space::Step => ("Step", false),
    };
    let mut json = json!({
        "ColorSpace": space,
        "Name": preset.name,
        "Points": preset.opacities.iter().flatten().collect::<Vec<_>>(),
        "RGBPoints": preset.colors.iter().flat_map(|(x, [r, g, b])| [x, r, g, b]).collect::<Vec<_>>(),
    });
    if wrap {
        json["HSVWrap"] = json!(true);
    }
    json
}
