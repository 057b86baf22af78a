//! Transfer functions from ParaView's JSON presets (also those of vtk.js).
//!
//! A preset has `RGBPoints` (x, r, g, b; display sRGB) and often `Points` (x, opacity, midpoint, sharpness). Between its
//! points VTK interpolates in display colours and in shaped curves; here both are resampled, so that the
//! piecewise-linear, scene-linear [`Transfer`] follows them.

use super::limits::{bad, io, open, quote};
use super::paraview_color::{Rgb, Space, linear, mix};
use crate::error::{Error, Result};
use crate::scene::Transfer;
use crate::scene::transfer::{Kind, Reference};
use serde_json::Value;
use std::io::Read;
use std::path::Path;

/// Largest preset file, bytes.
const FILE_BYTES: u64 = 64 << 20;

/// Most points of one preset, colours or opacities.
const POINTS: usize = 1 << 16;

/// How to read a transfer function.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferOptions {
    /// Scalars that the preset's first and last point are moved to. Without it, a preset within 0..1 spans `data_range`
    /// (ParaView's "rescale to data range") and any other stays where it is.
    pub range: Option<[f64; 2]>,
    /// Smallest and largest value of the volume.
    pub data_range: [f64; 2],
    /// The length that the preset's opacities are meant over.
    pub reference: Reference,
    /// Which preset, in a file of several.
    pub name: Option<String>,
}

impl TransferOptions {
    /// For data of this range; opacities over one voxel.
    pub fn new(data_range: [f64; 2]) -> Self {
        Self { range: None, data_range, reference: Reference::default(), name: None }
    }
}

/// Reads a ParaView preset. Without `Points` the opacity rises linearly from 0 to 1 over the colours' range, ParaView's
/// default.
///
/// # Errors
/// [`Error::Io`] from the system; [`Error::Format`] for a file that is no such preset, and where its name is missing or
/// unknown; [`Error::Invalid`] for a range that is not finite or descends.
pub fn read_transfer(path: &Path, options: &TransferOptions) -> Result<Transfer> {
    for (item, range) in [("transfer range", options.range.unwrap_or([0.0, 1.0])), ("data range", options.data_range)] {
        if !(range[0].is_finite() && range[1].is_finite() && range[0] <= range[1]) {
            let what = format!("{} to {}", range[0], range[1]);
            return Err(Error::Invalid { item, what, right: "both ends must be finite and ascend".into() });
        }
    }
    let (mut file, length) = open(path)?;
    if length > FILE_BYTES {
        return Err(bad(path, format!("it has {length} bytes"), format!("a preset file has at most {} MiB", FILE_BYTES >> 20)));
    }
    let mut text = Vec::new();
    file.by_ref().take(FILE_BYTES).read_to_end(&mut text).map_err(|e| io(path, "read", e))?;
    // Some programs write a byte order mark.
    let json = serde_json::from_slice(text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text));
    let json: Value =
        json.map_err(|e| bad(path, format!("it is no JSON: {}", quote(&e.to_string())), "ParaView's JSON presets are read"))?;
    let preset = choose(path, &json, options.name.as_deref())?;
    Preset { path, json: preset }.transfer(options)
}

/// The preset of that name.
fn choose<'a>(path: &Path, json: &'a Value, name: Option<&str>) -> Result<&'a Value> {
    let presets: Vec<&Value> = match json {
        Value::Array(all) => all.iter().filter(|p| p.is_object()).collect(),
        Value::Object(_) => vec![json],
        _ => Vec::new(),
    };
    let title = |p: &Value| p.get("Name").and_then(Value::as_str).unwrap_or("").to_owned();
    let names = || quote(&presets.iter().map(|p| format!("'{}'", title(p))).collect::<Vec<_>>().join(", "));
    match (name, presets.as_slice()) {
        (_, []) => Err(bad(path, "it holds no preset", "a preset is a JSON object with RGBPoints, or an array of them")),
        (None, [only]) => Ok(only),
        (None, _) => Err(bad(path, format!("it holds {} presets and none was named", presets.len()), format!("name one of {}", names()))),
        (Some(name), _) => {
            let exact = presets.iter().find(|p| title(p) == name);
            let found = exact.or_else(|| presets.iter().find(|p| title(p).eq_ignore_ascii_case(name)));
            found.copied().ok_or_else(|| bad(path, format!("no preset is named '{}'", quote(name)), format!("it holds {}", names())))
        }
    }
}

struct Preset<'a> {
    path: &'a Path,
    json: &'a Value,
}

/// An opacity point: x, opacity, and the shape of the curve to the next point.
type OpacityPoint = [f64; 4];

impl Preset<'_> {
    /// A list of numbers in groups of `N`, sorted by the first.
    fn points<const N: usize>(&self, key: &str) -> Result<Option<Vec<[f64; N]>>> {
        let Some(value) = self.json.get(key) else { return Ok(None) };
        let wrong =
            |what: String| bad(self.path, format!("its {key} {what}"), format!("it must be a list of finite numbers, {N} per point"));
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

    fn transfer(&self, options: &TransferOptions) -> Result<Transfer> {
        let Some(colors) = self.points::<4>("RGBPoints")? else {
            let right = "a continuous preset with RGBPoints is needed";
            let what = match self.json.get("IndexedColors") {
                Some(_) => "it has IndexedColors: a palette for categories, not for a continuous scalar",
                None => "it has no RGBPoints",
            };
            return Err(bad(self.path, what, right));
        };
        if let Some(p) = colors.iter().find(|p| p[1..].iter().any(|c| !(0.0..=1.0).contains(c))) {
            return Err(bad(self.path, format!("the colour {:?} at {}", &p[1..], p[0]), "red, green and blue must lie in 0..1"));
        }
        let (first, last) = (colors[0][0], colors[colors.len() - 1][0]);
        let opacities = self.points::<4>("Points")?.unwrap_or_else(|| vec![[first, 0.0, 0.5, 0.0], [last, 1.0, 0.5, 0.0]]);
        if let Some(p) = opacities.iter().find(|p| p[1..].iter().any(|c| !(0.0..=1.0).contains(c))) {
            return Err(bad(self.path, format!("the opacity point {p:?}"), "opacity, midpoint and sharpness must lie in 0..1"));
        }
        let lo = first.min(opacities[0][0]);
        let hi = last.max(opacities[opacities.len() - 1][0]);
        let target = options.range.or((lo >= 0.0 && hi <= 1.0).then_some(options.data_range));
        let place = |x: f64| match target {
            Some([a, b]) if hi > lo => a + (b - a) * ((x - lo) / (hi - lo)),
            Some([a, _]) => a,
            None => x,
        };
        let colors = colors.iter().map(|p| (place(p[0]), [p[1], p[2], p[3]])).collect::<Vec<_>>();
        let opacities = opacities.iter().map(|p| [place(p[0]), p[1], p[2], p[3]]).collect::<Vec<_>>();
        let made = Transfer::new(resample_colors(self.space()?, &colors), resample_opacities(&opacities), Kind::Opacity, options.reference);
        made.map_err(|e| match e {
            Error::Invalid { item, what, right } => bad(self.path, format!("{item}: {what}"), right),
            other => other,
        })
    }

    fn space(&self) -> Result<Space> {
        // ParaView's switch; its presets rarely write it, its default is off.
        let wrap = self.json.get("HSVWrap").is_some_and(|v| v.as_bool().unwrap_or(v.as_f64().is_some_and(|n| n != 0.0)));
        let Some(name) = self.json.get("ColorSpace") else { return Ok(Space::Rgb) };
        Ok(match name.as_str().map(str::to_ascii_lowercase).as_deref() {
            Some("rgb") => Space::Rgb,
            Some("hsv") => Space::Hsv { wrap },
            Some("wrapped") => Space::Hsv { wrap: true },
            Some("lab" | "cielab") => Space::Lab,
            Some("diverging") => Space::Diverging,
            Some("step") => Space::Step,
            _ => {
                let what = format!("its ColorSpace is {}", quote(&name.to_string()));
                return Err(bad(self.path, what, "RGB, HSV, Lab, Diverging and Step are read"));
            }
        })
    }
}

/// Pieces that one interval is cut into: enough that a straight line in each stays within about a 1000th of the curve,
/// fewer where there are many intervals.
fn pieces(intervals: usize) -> usize {
    (4096 / intervals.max(1)).clamp(1, 64)
}

/// Scene-linear colour points along the curve through display colours.
fn resample_colors(space: Space, points: &[(f64, Rgb)]) -> Vec<(f64, [f32; 3])> {
    let albedo = |c: Rgb| c.map(|v| linear(v) as f32);
    let pieces = pieces(points.len() - 1);
    let mut out = vec![(points[0].0, albedo(points[0].1))];
    for pair in points.windows(2) {
        let ((x0, a), (x1, b)) = (pair[0], pair[1]);
        if space == Space::Step {
            // The later colour holds from just behind the earlier point.
            out.push((x0.next_up().min(x1), albedo(b)));
        } else if x1 > x0 && a != b {
            let inner = (1..pieces).map(|i| i as f64 / pieces as f64);
            out.extend(inner.map(|s| (x0 + (x1 - x0) * s, albedo(mix(space, s, a, b)))));
        }
        out.push((x1, albedo(b)));
    }
    out
}

/// Opacity points along VTK's curve (vtkPiecewiseFunction): the midpoint is where the mean of both ends is reached,
/// the sharpness turns the line into a step.
fn resample_opacities(points: &[OpacityPoint]) -> Vec<(f64, f64)> {
    let pieces = pieces(points.len() - 1);
    let mut out = vec![(points[0][0], points[0][1])];
    for pair in points.windows(2) {
        let ([x0, a, midpoint, sharpness], [x1, b, ..]) = (pair[0], pair[1]);
        let midpoint = midpoint.clamp(1e-5, 1.0 - 1e-5);
        let at = |s: f64| x0 + (x1 - x0) * s;
        if x1 > x0 && a != b {
            if sharpness > 0.99 {
                out.extend([(at(midpoint), a), (at(midpoint), b)]);
            } else if sharpness < 0.01 {
                // Two straight lines; one for the usual midpoint.
                if midpoint != 0.5 {
                    out.push((at(midpoint), 0.5 * (a + b)));
                }
            } else {
                let inner = (1..pieces).map(|i| i as f64 / pieces as f64).chain([midpoint]);
                let mut curve: Vec<_> = inner.map(|s| (at(s), shaped(s, midpoint, sharpness, a, b))).collect();
                curve.sort_by(|p, q| p.0.total_cmp(&q.0));
                out.append(&mut curve);
            }
        }
        out.push((x1, b));
    }
    out
}

/// VTK's curve at `s` in 0..1 for a sharpness of 0.01 to 0.99: a Hermite curve of compressed argument.
fn shaped(s: f64, midpoint: f64, sharpness: f64, a: f64, b: f64) -> f64 {
    let s = if s < midpoint { 0.5 * s / midpoint } else { 0.5 + 0.5 * (s - midpoint) / (1.0 - midpoint) };
    let power = 1.0 + 10.0 * sharpness;
    let s = if s < 0.5 { 0.5 * (2.0 * s).powf(power) } else { 1.0 - 0.5 * (2.0 * (1.0 - s)).powf(power) };
    let (s2, s3) = (s * s, s * s * s);
    let tangent = (1.0 - sharpness) * (b - a);
    let y = (2.0 * s3 - 3.0 * s2 + 1.0) * a + (3.0 * s2 - 2.0 * s3) * b + (2.0 * s3 - 3.0 * s2 + s) * tangent;
    y.clamp(a.min(b), a.max(b))
}
