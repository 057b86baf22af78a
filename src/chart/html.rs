//! `report.html`: everything in one file that needs no network.

use super::axis::number;
use super::bars::time;
use super::{Figure, Report, Shown, StabilityRow, SubjectReport, Timing, figures, raster};
use crate::error::Result;
use crate::record::Machine;
use base64::Engine as _;
use std::fmt::Write as _;

/// The page's look, light and dark; charts take their colours from classes.
const STYLE: &str = include_str!("report.css");

/// The whole page.
///
/// # Errors
/// [`crate::Error::Invalid`] for a picture that cannot be drawn.
pub fn report_html(report: &Report, machine: &Machine) -> Result<String> {
    let [field_error, other_ratios, packing, frame_error, savings] = figures(report);
    let names: Vec<&str> = report.subjects.iter().map(|s| s.name.as_str()).collect();
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>halflight: speed against accuracy, {names}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
         <h1>Speed against accuracy</h1>\n<p class=\"lead\">{names}</p>\n",
        names = escape(&names.join(", ")),
    );
    let _ = writeln!(
        out,
        "<p class=\"machine\">{} · {} · {} processor cores · halflight {} ({}) · {} · measured in {:.0} s of {:.0} s allowed</p>",
        escape(&machine.device),
        escape(&machine.driver),
        machine.cores,
        machine.halflight,
        escape(&machine.commit),
        machine.date,
        report.seconds,
        report.budget
    );
    section(&mut out, "Field error", FIELD_TEXT);
    figure(&mut out, &field_error, "Field error against time")?;
    if report.subjects.iter().any(|s| s.fields.iter().any(|p| p.ratio != s.ratio)) {
        figure(&mut out, &other_ratios, "Field error against time at other ratios")?;
    }
    section(&mut out, "Bands and bits", PACKING_TEXT);
    figure(&mut out, &packing, "Field error against memory")?;
    section(&mut out, "Image error", IMAGE_TEXT);
    figure(&mut out, &frame_error, "Image error against frame time")?;
    section(&mut out, "Side by side", PAIR_TEXT);
    for s in &report.subjects {
        pictures(&mut out, s)?;
    }
    section(&mut out, "Savings", "");
    figure(&mut out, &savings, "What each saving brings")?;
    if !report.stability.is_empty() {
        section(&mut out, "Where methods fail", STABILITY_TEXT);
        hard_scenes(&mut out, report);
    }
    section(&mut out, "All points", "");
    for s in &report.subjects {
        tables(&mut out, s);
    }
    section(&mut out, "Left out", "What the time did not reach; a larger <code>--budget</code> does.");
    for s in &report.subjects {
        let items: Vec<String> = s.left_out.iter().map(|l| left_out(l)).collect();
        let list = if items.is_empty() { "<p>Nothing.</p>".into() } else { format!("<ul>{}</ul>", items.join("\n")) };
        let _ = writeln!(out, "<h3>{}</h3>\n{list}", escape(&s.name));
    }
    out.push_str("</main>\n</body>\n</html>\n");
    Ok(out)
}

const FIELD_TEXT: &str = "How far the coefficients of each estimator are from the dense reference, at cells drawn at random near matter, \
    against the device time of the whole field. Bars are 95 % intervals (bootstrap over cells). Fewer directions are faster, and only so \
    far worse: what stays is the estimator’s bias.";

const PACKING_TEXT: &str = "What a cell’s memory buys: more bands, or more bits for each of their coefficients. Where 8, 16 and 32 bits lie at one \
    height, the estimator is what errs. Bars are those of the field error.";

const IMAGE_TEXT: &str = "How far pictures are from the reference picture (path-traced single scattering without harmonics, its own noise \
    taken off in quadrature), against the device time of a frame; the field is computed once and is not in it. A dashed line is what so \
    many bands leave of the error when the field is exact (“SH-exact”: the reference picture under the light cut to them). A frame may lie below it only \
    where its other errors make up for it.";

const PAIR_TEXT: &str = "Ritschel’s pyramid and the sweep at about the same time, and at about the same error of their fields; and, for the \
    time of the pyramid’s best picture, the sweep fitted to what pictures read, or at a finer ratio. Below each picture its difference from the reference, dark for \
    none, yellow for half of the mean radiance or more. At a coarse ratio a picture errs by its ratio more than by its field’s \
    estimator: cells beside thin walls see more of the sky than the walls do, and an estimator that is too dark makes up for that.";

const STABILITY_TEXT: &str = "Scenes made to break estimators, and what they do there.";

/// One item; a long list of settings at a click.
fn left_out(text: &str) -> String {
    match text.split_once(": ") {
        Some((head, list)) if list.matches("; ").count() > 3 => {
            let all: Vec<String> = list.split("; ").map(escape).collect();
            format!("<li><details><summary>{}: {} settings</summary>{}</details></li>", escape(head), all.len(), all.join("<br>"))
        }
        _ => format!("<li>{}</li>", escape(text)),
    }
}

/// What fails at once, the rest at a click: there are some hundred rows.
fn hard_scenes(out: &mut String, report: &Report) {
    let (holds, fails): (Vec<_>, Vec<_>) = report.stability.iter().partition(|r| r.verdict.starts_with("holds"));
    let head = ["method", "case", "measured", "verdict"];
    let row = |r: &&StabilityRow| [&r.method, &r.case, &r.error, &r.verdict].map(|t| escape(t)).into();
    out.push_str("<div class=\"prose\">");
    table(
        out,
        &head,
        &format!("{} of {} rows: beyond the bound of good methods", fails.len(), report.stability.len()),
        fails.iter().map(row),
    );
    let _ = writeln!(out, "<details><summary>The {} rows that hold</summary>", holds.len());
    table(out, &head, "", holds.iter().map(row));
    out.push_str("</details></div>\n");
}

fn section(out: &mut String, title: &str, text: &str) {
    let _ = writeln!(out, "<h2>{title}</h2>");
    if !text.is_empty() {
        let _ = writeln!(out, "<p>{text}</p>");
    }
}

fn figure(out: &mut String, figure: &Figure, label: &str) -> Result<()> {
    let _ = writeln!(out, "<figure role=\"img\" aria-label=\"{label}; its numbers are in the tables below\">{}</figure>", figure.svg()?);
    Ok(())
}

/// Text for the inside of an element or an attribute.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in crate::error::escaped(text) {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

fn pictures(out: &mut String, s: &SubjectReport) -> Result<()> {
    let _ = writeln!(out, "<h3>{}</h3>", escape(&s.name));
    // The reference stands beside each pair, and alone where there is none.
    let reference = s.shown.first().filter(|_| s.shown.len() > 1);
    let mut groups: Vec<(&str, Vec<&Shown>)> = Vec::new();
    for shown in &s.shown[usize::from(reference.is_some())..] {
        match groups.last_mut() {
            Some((name, list)) if *name == shown.group => list.push(shown),
            _ => groups.push((&shown.group, vec![shown])),
        }
    }
    for (name, list) in groups {
        let _ = writeln!(out, "<h4>{}</h4>\n<div class=\"pictures\">", escape(name));
        for shown in reference.into_iter().chain(list) {
            let _ = writeln!(out, "<div>{}", image(&raster::picture_png(&shown.picture, s.exposure)?, &shown.title));
            if let Some(difference) = &shown.difference {
                let png = raster::heat_png(shown.picture.width, shown.picture.height, difference)?;
                out.push_str(&image(&png, "difference from the reference"));
            }
            let _ = writeln!(out, "<p>{}</p></div>", escape(&shown.title));
        }
        out.push_str("</div>\n");
    }
    Ok(())
}

fn image(png: &[u8], alt: &str) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(png);
    format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">\n", escape(alt))
}

fn tables(out: &mut String, s: &SubjectReport) {
    let [x, y, z] = s.dims;
    let _ = writeln!(out, "<h3>{}, {x}×{y}×{z} voxels</h3>", escape(&s.name));
    for r in &s.references {
        let cost = time(r.seconds);
        let _ = writeln!(
            out,
            "<p>Reference at 1:{}: march, {} directions, steps of {} voxel, at {} cells; {cost} of device time.</p>",
            r.ratio, r.directions, r.step, r.probes
        );
    }
    let fields = s.fields.iter().map(|p| {
        let error = format!("{:.4} <small>[{:.4}, {:.4}]</small>", p.error, p.interval[0], p.interval[1]);
        let approx = if p.timing == Timing::Extrapolated { "≈ " } else { "" };
        vec![
            format!("{}{}", escape(&p.name), if p.front { " <b>●</b>" } else { "" }),
            format!("1:{}", p.ratio),
            format!("{approx}{}", time(p.seconds)),
            error,
            format!("{:.4}", p.packed[0]),
            format!("{:.4}", p.packed[1]),
        ]
    });
    table(
        out,
        &["field", "ratio", "device time", "error [95 %]", "in 16 bits", "in 8 bits"],
        "● on the Pareto front of its ratio; ≈ extrapolated",
        fields,
    );
    let frames = s.frames.iter().map(|p| {
        vec![
            format!("{}{}", escape(&p.name), if p.front { " <b>●</b>" } else { "" }),
            number(p.step),
            time(p.field_seconds),
            time(p.relight_seconds),
            time(p.seconds),
            format!("{:.4} <small>[{:.4}, {:.4}]</small>", p.rmse, p.interval[0], p.interval[1]),
            format!("{:.4}", p.flip),
        ]
    });
    let [[w, h], [x, y]] = [s.pixels, s.judged];
    let note = format!("frames of {w}×{h} pixels, judged at {x}×{y} by the same camera against {}", escape(&s.image_reference));
    table(out, &["field of the frame", "viewing step", "field", "relight", "frame", "relative RMSE [95 %]", "FLIP"], &note, frames);
}

fn table(out: &mut String, head: &[&str], caption: &str, rows: impl Iterator<Item = Vec<String>>) {
    out.push_str("<div class=\"wide\"><table>");
    if !caption.is_empty() {
        let _ = write!(out, "<caption>{caption}</caption>");
    }
    let _ = writeln!(out, "<thead><tr>{}</tr></thead><tbody>", head.iter().map(|h| format!("<th>{h}</th>")).collect::<String>());
    for row in rows {
        let _ = writeln!(out, "<tr>{}</tr>", row.iter().map(|c| format!("<td>{c}</td>")).collect::<String>());
    }
    out.push_str("</tbody></table></div>\n");
}
