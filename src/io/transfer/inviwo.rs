//! Inviwo's transfer functions (`.itf`): points of position 0..1 over the data's range or, by `type` (without one: where they
//! lie outside), of the data's own scalars, colour and opacity; transparent outside a mask. Since 2018
//! they are `Points`, not `dataPoints`: so they are written.

use super::super::limits::bad;
use super::Preset;
use super::preset::STEP;
use super::voreen::clip;
use super::xml::Element;
use crate::error::Result;
use std::path::Path;

/// Its shaders' REF_SAMPLING_INTERVAL.
const PARTS: u32 = 150;

pub(super) fn read(path: &Path, root: &Element, stem: &str) -> Result<Preset> {
    let is_list = |e: &Element| e.child("dataPoints").is_some() || e.child("Points").is_some();
    let function = root.find(&is_list).unwrap_or(root);
    let list = function.child("dataPoints").or(function.child("Points"));
    let list = list.ok_or_else(|| bad(path, "it has no dataPoints", "a transfer function with points is needed"))?;
    let mut points = Vec::new();
    for point in list.all("point").chain(list.all("Point")) {
        let x = point.needed(path, "pos")?.number(path, &["x", "content"])?;
        let rgba = point.needed(path, "rgba")?;
        let mut p = [x, 0.0, 0.0, 0.0, 0.0];
        for (number, names) in p[1..].iter_mut().zip([["x", "r"], ["y", "g"], ["z", "b"], ["w", "a"]]) {
            *number = rgba.number(path, &names)?;
        }
        points.push(p);
    }
    if points.is_empty() {
        return Err(bad(path, format!("line {}: it has no points", list.line), "at least one is needed"));
    }
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // 0 or 1 (TFPrimitiveSetType); of older files the points tell.
    let relative = match function.number_of(path, "type", "content")? {
        Some(kind) => kind == 0.0,
        None => points.iter().all(|p| (0.0..=1.0).contains(&p[0])),
    };
    let mask = |name: &str, otherwise: f64| Ok(function.number_of(path, name, "content")?.unwrap_or(otherwise));
    let (low, high): (f64, f64) = (mask("maskMin", 0.0)?, mask("maskMax", 1.0)?);
    if relative {
        clip(&mut points, low, high);
    }
    let mut preset = Preset::of_points(stem, &points);
    preset.parts = Some(PARTS);
    if relative {
        (preset.domain, preset.relative) = ([0.0, 1.0], true);
    } else if (low, high) != (0.0, 1.0) && (low > -1e300 || high < 1e300) {
        preset.lost.push("the mask, which is of functions over 0 to 1".into());
    }
    // Version 1.0 knows a second interpolation, which no Inviwo ever carried out.
    if function.number_of(path, "interpolationType_", "content")?.is_some_and(|t| t != 0.0) {
        preset.lost.push("cubic interpolation between the points: they are joined by straight lines".into());
    }
    preset.checked(path)
}

/// A preset as Inviwo reads it.
pub(super) fn write(preset: &Preset) -> String {
    // A function of the data's own scalars has no mask: it lets all through.
    let (placed, kind, [low, high]) = match preset.relative {
        true => (preset.on([0.0, 1.0]), 0, [0.0, 1.0]),
        false => (preset.spanning(), 1, [f64::MIN, f64::MAX]),
    };
    let hair = STEP * (placed.domain[1] - placed.domain[0]);
    let mut out = format!(
        "<?xml version=\"1.0\" ?>\n<InviwoWorkspace version=\"3\">\n    <maskMin content=\"{low:e}\" />\n    <maskMax content=\"{high:e}\" />\n    \
         <type content=\"{kind}\" />\n    <Points>\n"
    );
    let mut point = |x: f64, [r, g, b, a]: [f64; 4]| {
        let x = if preset.relative { x.clamp(0.0, 1.0) } else { x };
        out += &format!(
            "        <Point>\n            <pos content=\"{x}\" />\n            <rgba x=\"{r}\" y=\"{g}\" z=\"{b}\" w=\"{a}\" />\n        </Point>\n"
        );
    };
    for key in placed.keys() {
        point(key.x, key.left);
        if key.left != key.right {
            point(key.x + hair, key.right);
        }
    }
    out + "    </Points>\n</InviwoWorkspace>\n"
}
