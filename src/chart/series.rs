//! From measured points to charts: which series a setting belongs to, what a mark says.

use super::axis::number;
use super::candidates;
use super::plot::{Chart, Mark, Panel, Shape, Style};
use super::{FieldPoint, FramePoint, Report, SubjectReport, Timing, pareto};
use crate::scene::Visibility;
use crate::scene::visibility::{Filter, Method};
use crate::stages::pack;
use plotters::style::RGBColor;

/// The series, in the legend's order.
pub fn styles() -> Vec<Style> {
    let style = |name: &str, color: u32, shape| {
        let [_, r, g, b] = color.to_be_bytes();
        Style { name: name.into(), color: RGBColor(r, g, b), shape }
    };
    vec![
        style("march", 0x0072b2, Shape::Circle),
        style("hierarchical, axis", 0xd55e00, Shape::Up),
        style("hierarchical, product", 0xb8558c, Shape::Down),
        style("hierarchical, extinction", 0xc88a00, Shape::Diamond),
        style("hierarchical, box", 0x7a828b, Shape::Cross),
        style("sweep", 0x009e73, Shape::Square),
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
    Mark {
        style: style_of(&p.visibility),
        at: [p.seconds, p.error],
        spread: p.spread,
        interval: Some(p.interval),
        hollow: p.timing == Timing::Extrapolated,
        front: p.front,
        label: candidates::short(&p.visibility),
    }
}

/// Ratios that a subject has points of, its own first.
fn ratios(s: &SubjectReport) -> Vec<u32> {
    let mut ratios: Vec<u32> = s.fields.iter().map(|p| p.ratio).collect();
    ratios.sort_unstable_by_key(|&r| (r != s.ratio, r));
    ratios.dedup();
    ratios
}

/// Time against field error: one panel per subject.
pub fn field_error(report: &Report) -> Chart {
    field_chart(report, "Field error against time", |s| vec![s.ratio])
}

/// The same at the ratios beside it.
pub fn other_ratios(report: &Report) -> Chart {
    field_chart(report, "Field error against time at other ratios", |s| ratios(s).into_iter().filter(|&r| r != s.ratio).collect())
}

fn field_chart(report: &Report, title: &str, of: impl Fn(&SubjectReport) -> Vec<u32>) -> Chart {
    let mut panels = Vec::new();
    for s in &report.subjects {
        for ratio in of(s) {
            let marks: Vec<Mark> = s.fields.iter().filter(|p| p.ratio == ratio).map(field_mark).collect();
            let probes = s.references.iter().find(|r| r.ratio == ratio).map_or(0, |r| r.probes);
            panels.push(Panel { title: format!("{}, 1:{ratio}, {probes} probes", s.name), marks, ..Panel::default() });
        }
    }
    let hollow = panels.iter().any(|p| p.marks.iter().any(|m| m.hollow));
    Chart {
        title: title.into(),
        subtitle:
            "relative L2 over 16 coefficients at cells near matter, against march with 4,096 directions and steps of ¼ voxel; bars: 95 %, range of three runs"
                .into(),
        x: "device time of the whole field, s".into(),
        y: "relative L2 error, before packing".into(),
        styles: styles(),
        notes: if hollow { vec!["hollow: time extrapolated from cells drawn at random".into()] } else { Vec::new() },
        panels,
        columns: 2,
    }
}

/// Bytes of a cell against field error: bands and bits of one setting of each estimator.
pub fn packing(report: &Report) -> Chart {
    let style = |bits: u32, color, shape| Style { name: format!("{bits} bits a coefficient"), color, shape };
    let styles = vec![
        style(8, RGBColor(0xd5, 0x5e, 0x00), Shape::Up),
        style(16, RGBColor(0x00, 0x9e, 0x73), Shape::Square),
        style(32, RGBColor(0x00, 0x72, 0xb2), Shape::Circle),
    ];
    let mut panels = Vec::new();
    for s in &report.subjects {
        for v in candidates::telling(s.ratio) {
            let mut points: Vec<&FieldPoint> = s.fields.iter().filter(|p| Visibility { bands: 4, ..p.visibility.clone() } == v).collect();
            points.sort_by_key(|p| p.visibility.bands);
            let mark = |p: &FieldPoint, style: usize| {
                let (bands, bits, error) = (p.visibility.bands, [8, 16, 32][style], [p.packed[1], p.packed[0], p.error][style]);
                // Packing moves the error, not how sure it is.
                let interval = p.interval.map(|end| end * error / p.error);
                let bytes = pack::groups(bands) as f64 * f64::from(pack::formats(bands, bits).0.bytes());
                let label = if bits == 8 { candidates::counted_bands(bands) } else { String::new() };
                Mark { style, at: [bytes, error], spread: None, interval: Some(interval), hollow: false, front: false, label }
            };
            let mut marks: Vec<Mark> = (0..styles.len()).flat_map(|style| points.iter().map(move |p| mark(p, style))).collect();
            let front = pareto::front(&marks.iter().map(|m| [[m.at[0]; 2], m.interval.unwrap_or([m.at[1]; 2])]).collect::<Vec<_>>());
            marks.iter_mut().zip(front).for_each(|(m, front)| m.front = front);
            let chains = (0..styles.len()).map(|style| (style * points.len()..(style + 1) * points.len()).collect()).collect();
            if !marks.is_empty() {
                let title = format!("{}: {}", s.name, candidates::name(&v));
                panels.push(Panel { title, marks, chains, ..Panel::default() });
            }
        }
    }
    Chart {
        title: "Field error against memory".into(),
        subtitle: "one setting of each estimator with 1 to 4 bands, packed in 8, 16 and 32 bits; bands that are left out count as zero; bars: 95 %"
            .into(),
        x: "bytes a cell".into(),
        y: "relative L2 error, after packing".into(),
        styles,
        notes: Vec::new(),
        panels,
        columns: 3,
    }
}

fn frame_mark(p: &FramePoint) -> Mark {
    Mark {
        style: style_of(&p.visibility),
        at: [1e3 * p.seconds, p.rmse],
        spread: p.spread.map(|s| s.map(|v| 1e3 * v)),
        interval: Some(p.interval),
        hollow: p.step != 1.0,
        front: p.front,
        label: match p.step {
            1.0 if p.visibility.fit > 0 => format!("1:{} N {} fitted", p.ratio, p.visibility.directions),
            1.0 => format!("1:{} N {}", p.ratio, p.visibility.directions),
            step => format!("1:{} N {} step {step}", p.ratio, p.visibility.directions),
        },
    }
}

/// Frame time against image error, with the error that each number of bands leaves.
pub fn frame_error(report: &Report) -> Chart {
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
                title: format!("{}, {}×{} pixels, judged at {}×{}", s.name, s.pixels[0], s.pixels[1], s.judged[0], s.judged[1]),
                marks: s.frames.iter().map(frame_mark).collect(),
                levels: levels(s),
                chains: vec![chain],
            }
        })
        .collect();
    Chart {
        title: "Image error against frame time".into(),
        subtitle: "relative RMSE over covered pixels, against path-traced single scattering; bars: 95 % over pixels, range of five frames; dashed: what so many bands cannot hold".into(),
        x: "device time of the frame, ms".into(),
        y: "relative RMSE".into(),
        styles: styles(),
        notes: vec!["hollow: other viewing steps of one field (thin line)".into()],
        panels,
        columns: 1,
    }
}

/// Dashed lines: each number of bands, and the reference picture's own noise where it is near.
fn levels(s: &SubjectReport) -> Vec<(f64, String)> {
    let mut levels: Vec<(f64, String)> = s
        .levels
        .iter()
        .map(|l| {
            (
                l.rmse,
                format!(
                    "{}, {}: {} ± {}",
                    s.floor,
                    candidates::counted_bands(l.bands),
                    number(l.rmse),
                    number(0.5 * (l.interval[1] - l.interval[0]))
                ),
            )
        })
        .collect();
    let least = s.frames.iter().map(|p| p.rmse).fold(f64::INFINITY, f64::min);
    if s.image_reference_error > 0.2 * least {
        levels.push((s.image_reference_error, format!("noise of the reference: {}", number(s.image_reference_error))));
    }
    levels
}
