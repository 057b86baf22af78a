//! `table.md`: the telling settings of all scenes side by side, as a README wants them.

use super::bars::time;
use super::candidates;
use super::{FieldPoint, FramePoint, Report, SubjectReport, Timing};
use crate::scene::Visibility;
use std::fmt::Write as _;

/// Fields at each scene's own ratio, and pictures: error, its 95 % interval, device time; one column a scene.
pub fn tables_md(report: &Report) -> String {
    let mut out = String::from("Field: relative L2 of 16 coefficients [95 %], device time of the whole field (≈ extrapolated).\n\n");
    let probes = |s: &SubjectReport| s.references.iter().find(|r| r.ratio == s.ratio).map_or(0, |r| r.probes);
    head(&mut out, "field", report, |s| format!("1:{}, {} probes", s.ratio, probes(s)));
    for v in candidates::of_ratio(1) {
        let of = |s: &SubjectReport| {
            let same = |p: &&FieldPoint| p.visibility == Visibility { ratio: s.ratio, ..v.clone() };
            s.fields.iter().find(same).map(|p| {
                let about = if p.timing == Timing::Extrapolated { "≈ " } else { "" };
                format!("{}, {about}{}", error(p.error, p.interval), time(p.seconds))
            })
        };
        row(&mut out, &candidates::name(&v), report, of);
    }
    out += "\nPicture: relative RMSE against path-traced single scattering [95 %], device time of the frame.\n\n";
    let noise = |s: &SubjectReport| {
        let [[w, h], [x, y]] = [s.pixels, s.judged];
        format!("{w}×{h} pixels, judged at {x}×{y}, noise of the reference {:.4}", s.image_reference_error)
    };
    head(&mut out, "field of the frame", report, noise);
    let mut names: Vec<&str> = Vec::new();
    let plain = |p: &&FramePoint| p.step == 1.0;
    for p in report.subjects.iter().flat_map(|s| s.frames.iter().filter(plain)) {
        if !names.contains(&p.name.as_str()) {
            names.push(&p.name);
        }
    }
    for name in names {
        let of = |s: &SubjectReport| {
            let found = s.frames.iter().filter(plain).find(|p| p.name == name);
            found.map(|p| format!("{}, {}", error(p.rmse, p.interval), time(p.seconds)))
        };
        row(&mut out, name, report, of);
    }
    out
}

/// "0.055 [0.049, 0.061]".
fn error(value: f64, [lo, hi]: [f64; 2]) -> String {
    format!("{value:.3} [{lo:.3}, {hi:.3}]")
}

fn head(out: &mut String, first: &str, report: &Report, more: impl Fn(&SubjectReport) -> String) {
    let scenes: String = report.subjects.iter().map(|s| format!(" {}, {} |", cell(&s.name), more(s))).collect();
    let _ = writeln!(out, "| {first} |{scenes}\n|---|{}", "---|".repeat(report.subjects.len()));
}

fn row(out: &mut String, name: &str, report: &Report, of: impl Fn(&SubjectReport) -> Option<String>) {
    let cells: Vec<Option<String>> = report.subjects.iter().map(of).collect();
    // What no scene's time reached is no row.
    if cells.iter().any(Option::is_some) {
        let cells: String = cells.into_iter().map(|c| format!(" {} |", c.unwrap_or_else(|| "–".into()))).collect();
        let _ = writeln!(out, "| {name} |{cells}");
    }
}

/// Text that ends no cell.
fn cell(text: &str) -> String {
    crate::error::escaped(text).collect::<String>().replace('|', "\\|")
}
