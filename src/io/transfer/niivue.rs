//! NiiVue's colour maps: lists of equal length R, G, B, A and I, all 0..255; I = 0 stands at `min` and 255 at `max`, or at
//! the ends of the data where the map does not say.

use super::super::limits::{bad, quote};
use super::Preset;
use crate::error::Result;
use serde_json::Value;
use std::path::Path;

/// Whether this is such a map.
pub(super) fn is_map(json: &Value) -> bool {
    ["R", "G", "B"].iter().all(|key| json.get(key).is_some_and(Value::is_array))
}

pub(super) fn read(path: &Path, json: &Value, stem: &str) -> Result<Preset> {
    let wrong = |what: String| bad(path, what, "R, G, B, A and I must be lists of as many numbers in 0..255");
    let list = |key: &str| -> Result<Option<Vec<f64>>> {
        let Some(value) = json.get(key) else { return Ok(None) };
        let numbers = value.as_array().map(|list| list.iter().map(|v| v.as_f64().filter(|v| (0.0..=255.0).contains(v))));
        let numbers = numbers.and_then(|mut n| n.by_ref().collect::<Option<Vec<f64>>>());
        numbers.map(Some).ok_or_else(|| wrong(format!("its {key} is {}", quote(&value.to_string()))))
    };
    let needed = |key: &str| list(key)?.ok_or_else(|| wrong(format!("it has no {key}")));
    let (r, g, b) = (needed("R")?, needed("G")?, needed("B")?);
    let n = r.len();
    let even = || (0..n).map(|i| 255.0 * i as f64 / (n.max(2) - 1) as f64).collect::<Vec<_>>();
    let a = list("A")?;
    let (opaque, i) = (a.is_none(), list("I")?.unwrap_or_else(even));
    let a = a.unwrap_or_else(|| vec![255.0; n]);
    if [g.len(), b.len(), a.len(), i.len()] != [n; 4] {
        return Err(wrong(format!("its lists have {n}, {}, {}, {} and {} numbers", g.len(), b.len(), a.len(), i.len())));
    }
    let end = |key: &str| json.get(key).and_then(Value::as_f64);
    let (domain, relative) = match (end("min"), end("max")) {
        (Some(lo), Some(hi)) if lo < hi => ([lo, hi], false),
        (Some(lo), Some(hi)) => return Err(bad(path, format!("its min is {lo} and its max {hi}"), "min must be below max")),
        _ => ([0.0, 1.0], true),
    };
    let x = |i: f64| domain[0] + (domain[1] - domain[0]) * i / 255.0;
    let points: Vec<[f64; 5]> = (0..n).map(|k| [x(i[k]), r[k] / 255.0, g[k] / 255.0, b[k] / 255.0, a[k] / 255.0]).collect();
    let mut preset = Preset::of_points(stem, &points);
    (preset.domain, preset.relative) = (domain, relative);
    if opaque {
        preset.lost.push("it has no A: every value is opaque".into());
    }
    preset.checked(path)
}
