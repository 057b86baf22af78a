//! ImageVis3D's one-dimensional functions (`.1dt`): how many entries, then red, green, blue and opacity of each, evenly over
//! the data's range.

use super::super::limits::{bad, quote};
use super::Preset;
use super::preset::POINTS;
use crate::error::Result;
use std::fmt::Write;
use std::path::Path;

pub(super) fn read(path: &Path, text: &str, stem: &str) -> Result<Preset> {
    let mut words = text.split_ascii_whitespace();
    let right = "a .1dt file has the number of entries and then red, green, blue and opacity of each";
    let first = words.next().ok_or_else(|| bad(path, "it is empty", right))?;
    let count = first.parse::<usize>().ok().filter(|n| (1..=POINTS).contains(n));
    let count = count.ok_or_else(|| bad(path, format!("its number of entries is '{}'", quote(first)), "it must be 1 to 65536"))?;
    let mut points = Vec::new();
    for i in 0..count {
        let mut point = [i as f64 / (count.max(2) - 1) as f64, 0.0, 0.0, 0.0, 0.0];
        for number in &mut point[1..] {
            let word = words.next().ok_or_else(|| bad(path, format!("it ends in entry {i} of {count}"), right))?;
            let value = word.parse::<f64>().ok().filter(|v| v.is_finite());
            *number = value.ok_or_else(|| bad(path, format!("entry {i} has '{}'", quote(word)), "it must be four numbers in 0..1"))?;
        }
        points.push(point);
    }
    if let Some(word) = words.next() {
        return Err(bad(path, format!("'{}' stands behind its {count} entries", quote(word)), right));
    }
    let mut preset = Preset::of_points(stem, &points);
    (preset.domain, preset.relative) = ([0.0, 1.0], true);
    preset.checked(path)
}

/// A preset as a table: of 256 entries where its points stand on them, else of 4096.
pub(super) fn write(preset: &Preset) -> String {
    let unit = preset.on([0.0, 1.0]);
    let keys = unit.keys();
    let on = |n: usize| keys.iter().all(|k| k.left == k.right && (k.x * (n - 1) as f64 - (k.x * (n - 1) as f64).round()).abs() < 1e-6);
    let count = if on(256) { 256 } else { 4096 };
    let mut out = format!("{count}\n");
    for i in 0..count {
        let x = i as f64 / (count - 1) as f64;
        let after = keys.partition_point(|k| k.x <= x);
        let value = match (after.checked_sub(1).and_then(|i| keys.get(i)), keys.get(after)) {
            (Some(a), _) if a.x == x => a.left,
            (Some(a), Some(b)) => std::array::from_fn(|c| a.right[c] + (b.left[c] - a.right[c]) * (x - a.x) / (b.x - a.x)),
            (Some(a), None) => a.right,
            (None, Some(b)) => b.left,
            (None, None) => [0.0; 4],
        };
        let [r, g, b, a] = value;
        // Writing to a text cannot fail.
        let _ = writeln!(out, "{r} {g} {b} {a}");
    }
    out
}
