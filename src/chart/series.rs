//! From measured points to charts: which series a setting belongs to, what a mark says.

use super::candidates;
use super::plot::{self, Chart, Mark, Panel, Shape, Style};
use super::{FieldPoint, FramePoint, Report, SubjectReport, Timing};
use crate::scene::Visibility;
use crate::scene::visibility::{Filter, Method};

/// The series, in the legend's order.
pub fn styles() -> Vec<Style> {
    let style = |name: &str, class, color, shape| Style { name: name.into(), class, color, shape };
    vec![
        style("march", "s-march", "#0072b2", Shape::Circle),
        style("hierarchical, axis", "s-axis", "#d55e00", Shape::Up),
        style("hierarchical, product", "s-product", "#b8558c", Shape::Down),
        style("hierarchical, extinction", "s-extinction", "#c88a00", Shape::Diamond),
        style("hierarchical, box", "s-box", "#7a828b", Shape::Cross),
        style("sweep", "s-sweep", "#009e73", Shape::Square),
    ]
}

/// Index into [`styles`].
pub fn style_of(v: &Visibility) -> usize {
    match (v.method, v.filter) {
        (Method::March, _) => 0,
        (Method::Hierarchical, Filter::Axis) => 1,
        (Method::Hierarchical, Filter::Product) => 2,
        (Method::Hierarchical, Filter::Extinction) => 3,
        (Method::Hierarchical, Filter::Box) => 4,
        (Method::Sweep, _) => 5,
    }
}

fn field_mark(p: &FieldPoint) -> Mark {
    let how = if p.timing == Timing::Whole { "" } else { ", extrapolated" };
    Mark {
        style: style_of(&p.visibility),
        at: [p.seconds, p.error],
        interval: Some(p.interval),
        hollow: p.timing == Timing::Extrapolated,
        front: p.front,
        label: candidates::short(&p.visibility),
        title: format!(
            "{}: {:.3} s{how}, error {:.4} [{:.4}, {:.4}], {:.4} in 8 bits",
            p.name, p.seconds, p.error, p.interval[0], p.interval[1], p.packed[1]
        ),
    }
}

/// Ratios that a subject has points of, its own first.
fn ratios(s: &SubjectReport) -> Vec<u32> {
    let mut ratios: Vec<u32> = s.fields.iter().map(|p| p.ratio).collect();
    ratios.sort_unstable_by_key(|&r| (r != s.ratio, r));
    ratios.dedup();
    ratios
}

/// Time against field error: one panel per subject and ratio.
pub fn field_error_svg(report: &Report) -> String {
    let mut panels = Vec::new();
    for s in &report.subjects {
        for ratio in ratios(s) {
            let marks: Vec<Mark> = s.fields.iter().filter(|p| p.ratio == ratio).map(field_mark).collect();
            let probes = s.references.iter().find(|r| r.ratio == ratio).map_or(0, |r| r.probes);
            panels.push(Panel { title: format!("{}, 1:{ratio}, {probes} probes", s.name), marks, ..Panel::default() });
        }
    }
    let hollow = panels.iter().any(|p| p.marks.iter().any(|m| m.hollow));
    let columns = report.subjects.iter().map(|s| ratios(s).len()).max().unwrap_or(1);
    plot::draw(&Chart {
        title: "Field error against time".into(),
        subtitle:
            "relative L2 over 16 coefficients at cells near matter, against march with 4,096 directions and steps of ¼ voxel; bars: 95 %"
                .into(),
        x: "device time of the whole field, s".into(),
        y: "relative L2 error, before packing".into(),
        styles: styles(),
        notes: if hollow { vec!["hollow: time extrapolated from cells drawn at random".into()] } else { Vec::new() },
        panels,
        columns,
    })
}

fn frame_mark(p: &FramePoint) -> Mark {
    Mark {
        style: style_of(&p.visibility),
        at: [1e3 * p.seconds, p.rmse],
        interval: None,
        hollow: p.step != 1.0,
        front: p.front,
        label: match p.step {
            1.0 => format!("1:{} N {}", p.ratio, p.visibility.directions),
            step => format!("1:{} N {} step {step}", p.ratio, p.visibility.directions),
        },
        title: format!(
            "{}, viewing step {}: frame {:.1} ms, relative RMSE {:.4}; its field took {:.2} s",
            p.name,
            p.step,
            1e3 * p.seconds,
            p.rmse,
            p.field_seconds
        ),
    }
}

/// Frame time against image error, with the error that each number of bands leaves.
pub fn frame_error_svg(report: &Report) -> String {
    let panels: Vec<Panel> = report
        .subjects
        .iter()
        .filter(|s| !s.frames.is_empty())
        .map(|s| {
            // The field that was rendered with several steps: its marks belong together.
            let varied = s.frames.iter().find(|p| p.step != 1.0).map(|p| p.visibility.clone());
            let mut chain: Vec<usize> = (0..s.frames.len()).filter(|&i| Some(&s.frames[i].visibility) == varied.as_ref()).collect();
            chain.sort_by(|&a, &b| s.frames[a].step.total_cmp(&s.frames[b].step));
            Panel {
                title: format!("{}, {}×{} pixels; dense field: {}", s.name, s.pixels[0], s.pixels[1], s.dense_field),
                marks: s.frames.iter().map(frame_mark).collect(),
                levels: levels(s),
                chains: vec![chain],
            }
        })
        .collect();
    plot::draw(&Chart {
        title: "Image error against frame time".into(),
        subtitle:
            "relative RMSE over covered pixels, against path-traced single scattering; dashed: the dense field seen through so many bands"
                .into(),
        x: "device time of the frame, ms".into(),
        y: "relative RMSE".into(),
        styles: styles(),
        notes: vec!["hollow: other viewing steps of one field (thin line)".into()],
        panels,
        columns: 1,
    })
}

/// Dashed lines: each number of bands, and the reference picture's own noise where it is near.
fn levels(s: &SubjectReport) -> Vec<(f64, String)> {
    let bands = |n| if n == 1 { "1 band".to_owned() } else { format!("{n} bands") };
    let mut levels: Vec<(f64, String)> =
        s.levels.iter().map(|l| (l.rmse, format!("dense field, {}: {}", bands(l.bands), plot::number(l.rmse)))).collect();
    let least = s.frames.iter().map(|p| p.rmse).fold(f64::INFINITY, f64::min);
    if s.image_reference_error > 0.2 * least {
        levels.push((s.image_reference_error, format!("noise of the reference: {}", plot::number(s.image_reference_error))));
    }
    levels
}
