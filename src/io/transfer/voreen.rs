//! Voreen's one-dimensional functions: keys (`.tfi`) and Gaussian curves (`.tfg`). Intensities 0..1 lie on the function's
//! domain; one within 0..1 is relative. A split key has two colours: the left one still holds at the key itself.

use super::super::limits::{bad, quote};
use super::Preset;
use super::preset::STEP;
use super::xml::Element;
use crate::error::Result;
use std::path::Path;

/// Samples of a sum of Gaussian curves.
const SAMPLES: usize = 2049;

/// Its shaders' SAMPLING_BASE_INTERVAL_RCP.
const PARTS: u32 = 200;

pub(super) fn read(path: &Path, root: &Element, stem: &str) -> Result<Preset> {
    let function = root.find(&|e| e.child("Keys").is_some() || e.child("Curves").is_some());
    let right = "a function with Keys (.tfi) or Curves (.tfg) is needed";
    let function = function.ok_or_else(|| bad(path, "it holds no function of one variable", right))?;
    let mut lost = Vec::new();
    let mut points = match function.child("Keys") {
        Some(keys) => of_keys(path, keys)?,
        None => {
            lost.push(format!("Gaussian curves: {SAMPLES} samples of them take their place"));
            of_curves(path, function.needed(path, "Curves")?)?
        }
    };
    let (lower, upper) = match function.child("threshold") {
        Some(t) => (t.number(path, &["x"])?, t.number(path, &["y"])?),
        None => (function.number_of(path, "lower", "value")?.unwrap_or(0.0), function.number_of(path, "upper", "value")?.unwrap_or(1.0)),
    };
    // 0: nothing is opaque, 2: everything is; older files have a flag for the latter. Of those that say their data type (since
    // TransFuncBase), what has no opacity keeps none.
    let mode = function.number_of(path, "alphaMode", "value")?.unwrap_or(1.0);
    let ignored = function.child("ignoreAlpha").and_then(|e| e.get("value")) == Some("true");
    if mode == 0.0 || mode == 2.0 || ignored {
        let alpha = if mode == 0.0 { 0.0 } else { 1.0 };
        points = match function.child("dataType") {
            Some(_) if mode == 2.0 => opaque(&points),
            _ => points.into_iter().map(|[x, r, g, b, _]| [x, r, g, b, alpha]).collect(),
        };
    }
    clip(&mut points, lower, upper);
    if let Some(gamma) = function.number_of(path, "gammaValue", "value")?.filter(|g| *g != 1.0) {
        lost.push(format!("gammaValue {gamma}: it is taken as 1"));
    }
    let domain = match function.child("domain") {
        Some(d) => [d.number(path, &["x"])?, d.number(path, &["y"])?],
        None => [0.0, 1.0],
    };
    if domain[0] >= domain[1] {
        return Err(bad(path, format!("its domain is {} to {}", domain[0], domain[1]), "it must ascend"));
    }
    let relative = domain[0] >= 0.0 && domain[1] <= 1.0;
    if relative && domain != [0.0, 1.0] {
        // Older files say which part of the normalised values is drawn; the keys are placed in the whole nevertheless.
        lost.push(format!("domain {} to {}: the data's range takes its place", domain[0], domain[1]));
    }
    let domain = if relative { [0.0, 1.0] } else { domain };
    points.iter_mut().for_each(|p| p[0] = domain[0] + (domain[1] - domain[0]) * p[0]);
    let mut preset = Preset::of_points(stem, &points);
    (preset.domain, preset.relative, preset.lost, preset.parts) = (domain, relative, lost, Some(PARTS));
    preset.checked(path)
}

/// Opaque wherever there is any opacity.
fn opaque(points: &[[f64; 5]]) -> Vec<[f64; 5]> {
    let seen = |i: Option<usize>| i.and_then(|i| points.get(i)).is_some_and(|p| p[4] > 0.0);
    let mut out = Vec::new();
    for (i, &[x, r, g, b, alpha]) in points.iter().enumerate() {
        let at = |x: f64, alpha: f64| [x, r, g, b, alpha];
        if alpha > 0.0 {
            out.push(at(x, 1.0));
            continue;
        }
        // From nothing the line rises at once.
        out.extend(seen(i.checked_sub(1)).then(|| at(x - 0.5 * STEP, 1.0)));
        out.push(at(x, 0.0));
        out.extend(seen(Some(i + 1)).then(|| at(x + 0.5 * STEP, 1.0)));
    }
    out
}

/// A colour of 0..255 as red, green, blue and opacity 0..1.
fn color(path: &Path, e: &Element) -> Result<[f64; 4]> {
    Ok([e.number(path, &["r"])? / 255.0, e.number(path, &["g"])? / 255.0, e.number(path, &["b"])? / 255.0, e.number(path, &["a"])? / 255.0])
}

fn of_keys(path: &Path, keys: &Element) -> Result<Vec<[f64; 5]>> {
    let mut points = Vec::new();
    for key in keys.all("key") {
        let x = key.needed(path, "intensity")?.number(path, &["value"])?;
        let left = color(path, key.needed(path, "colorL")?)?;
        points.push([x, left[0], left[1], left[2], left[3]]);
        if key.child("split").and_then(|s| s.get("value")) == Some("true") {
            let right = color(path, key.needed(path, "colorR")?)?;
            points.push([x + STEP, right[0], right[1], right[2], right[3]]);
        }
    }
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    if points.is_empty() { Err(bad(path, format!("line {}: it has no keys", keys.line), "at least one is needed")) } else { Ok(points) }
}

/// One of Voreen's Gaussian curves.
struct Curve {
    centre: f64,
    /// Twice this is the divisor of the square.
    width: f64,
    /// Opacity far off.
    base: f64,
    /// Peak and base colour below and above the centre.
    peak: [[f64; 4]; 2],
    foot: [[f64; 4]; 2],
}

/// Colours are a mean weighted by the curves' opacities, the opacity is that of the highest (Voreen's
/// `TransFunc1DGaussian`).
fn of_curves(path: &Path, curves: &Element) -> Result<Vec<[f64; 5]>> {
    let mut all = Vec::new();
    for e in curves.all("curve").take(1024) {
        if e.child("active").and_then(|a| a.get("value")) == Some("false") {
            continue;
        }
        let value = |name: &str| e.needed(path, name)?.number(path, &["value"]);
        let side = |name: &str, other: [f64; 4]| e.child(name).map_or(Ok(other), |c| color(path, c));
        let left = color(path, e.needed(path, "colorL")?)?;
        let right = side("colorR", left)?;
        let foot = side("baseColorL", left)?;
        let curve = Curve {
            centre: value("intensity")?,
            width: value("width")?,
            base: value("baseValue")?,
            peak: [left, right],
            foot: [foot, if e.child("baseColorL").is_some() { side("baseColorR", foot)? } else { right }],
        };
        if curve.width <= 0.0 {
            return Err(bad(
                path,
                format!("line {}: the width of a curve is {}", e.line, quote(&curve.width.to_string())),
                "it must be above 0",
            ));
        }
        all.push(curve);
    }
    let at = |x: f64| {
        let (mut rgb, mut sum, mut alpha) = ([0.0; 3], 0.0, 0.0f64);
        for c in &all {
            let side = usize::from(x >= c.centre);
            let g = (-(x - c.centre).powi(2) / (2.0 * c.width)).exp();
            let opacity = g * (c.peak[side][3] - c.base) + c.base;
            let weight = opacity.max(1e-30);
            sum += weight;
            (0..3).for_each(|i| rgb[i] += weight * (c.peak[side][i] * g + c.foot[side][i] * (1.0 - g)));
            alpha = alpha.max(opacity);
        }
        let rgb = rgb.map(|c: f64| (c / f64::min(sum, 1.0)).clamp(0.0, 1.0));
        [x, rgb[0], rgb[1], rgb[2], alpha.clamp(0.0, 1.0)]
    };
    if all.is_empty() {
        return Err(bad(path, format!("line {}: it has no active curve", curves.line), "at least one is needed"));
    }
    Ok((0..SAMPLES).map(|i| at(i as f64 / (SAMPLES - 1) as f64)).collect())
}

/// Makes everything outside a threshold transparent.
pub(super) fn clip(points: &mut Vec<[f64; 5]>, lower: f64, upper: f64) {
    for (edge, inside) in [(lower, 1.0), (upper, -1.0)] {
        let out = |x: f64| (x - edge) * inside < 0.0;
        if (inside > 0.0 && edge <= 0.0) || (inside < 0.0 && edge >= 1.0) {
            continue;
        }
        let value = between(points, edge);
        points.iter_mut().filter(|p| out(p[0])).for_each(|p| p[4] = 0.0);
        let mut outer = value;
        (outer[0], outer[4]) = (edge - inside * STEP, 0.0);
        points.extend([value, outer]);
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
}

/// The point on the line at `x`.
fn between(points: &[[f64; 5]], x: f64) -> [f64; 5] {
    let after = points.partition_point(|p| p[0] <= x);
    let (a, b) = (points[after.saturating_sub(1)], points[after.min(points.len() - 1)]);
    let s = if b[0] > a[0] { ((x - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0) } else { 0.0 };
    let mut p: [f64; 5] = std::array::from_fn(|i| a[i] + (b[i] - a[i]) * s);
    p[0] = x;
    p
}

/// A preset as Voreen reads it: 8 bits a colour.
pub(super) fn write(preset: &Preset) -> String {
    let [lo, hi] = preset.domain;
    let byte = |v: f64| (v * 255.0).round() as u8;
    let color = |name: &str, [r, g, b, a]: [f64; 4]| {
        format!("                <{name} r=\"{}\" g=\"{}\" b=\"{}\" a=\"{}\" />\n", byte(r), byte(g), byte(b), byte(a))
    };
    let mut out = format!(
        "<?xml version=\"1.0\" ?>\n<VoreenData version=\"1\">\n    <TransFuncIntensity type=\"TransFuncIntensity\">\n        \
         <alphaMode value=\"1\" />\n        <texDimensions x=\"1024\" y=\"1\" z=\"1\" />\n        <filter value=\"0\" />\n        \
         <dataType value=\"5121\" />\n        <gammaValue value=\"1\" />\n        <domain x=\"{lo}\" y=\"{hi}\" />\n        \
         <threshold x=\"0\" y=\"1\" />\n        <Keys>\n"
    );
    for key in preset.keys() {
        let x = if hi > lo { ((key.x - lo) / (hi - lo)).clamp(0.0, 1.0) as f32 } else { 0.0 };
        let split = key.left != key.right;
        out += &format!(
            "            <key type=\"TransFuncMappingKey\">\n                <intensity value=\"{x}\" />\n                <split value=\"{split}\" />\n"
        );
        out += &color("colorL", key.left);
        if split {
            out += &color("colorR", key.right);
        }
        out += "            </key>\n";
    }
    out + "        </Keys>\n    </TransFuncIntensity>\n</VoreenData>\n"
}
