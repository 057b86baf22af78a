//! Names beside levels and marks, each where nothing else is.

use super::axis::{Axis, Coordinate};
use super::canvas::{self, Canvas, Drawn, INK};
use super::plot::{Mark, Panel, SMALL};
use plotters::chart::ChartContext;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

type Context<'a, B> = ChartContext<'a, B, Cartesian2d<Coordinate, Coordinate>>;

/// A rectangle of pixels: left, top, right, bottom.
type Box4 = [i32; 4];

fn overlaps(a: &Box4, b: &Box4) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// What a line from `a` to `b` covers, piece by piece.
fn along(a: (i32, i32), b: (i32, i32), piece: i32) -> impl Iterator<Item = Box4> {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let pieces = (dx.abs().max(dy.abs()) / piece.max(1)).max(1);
    let at = move |i: i32| (a.0 + dx * i / pieces, a.1 + dy * i / pieces);
    (0..pieces).map(move |i| {
        let (p, q) = (at(i), at(i + 1));
        [p.0.min(q.0) - 1, p.1.min(q.1) - 1, p.0.max(q.0) + 1, p.1.max(q.1) + 1]
    })
}

/// Names of levels and of marks on the front, each where nothing else is: no mark, no bar, none of the `lines`.
pub fn draw<B: DrawingBackend>(
    on: &Canvas<B>,
    chart: &Context<B>,
    panel: &Panel,
    shown: &[&Mark],
    lines: &[Vec<(f64, f64)>],
    [x, y]: [Axis; 2],
) -> Drawn<B> {
    let (xs, ys) = chart.plotting_area().get_pixel_range();
    let at = |v: [f64; 2]| chart.backend_coord(&(x.on(v[0]), y.on(v[1])));
    let style = on.font(SMALL, INK).pos(Pos::new(HPos::Left, VPos::Center));
    let half = on.px(7.0);
    let mut taken: Vec<Box4> = Vec::new();
    for m in shown {
        let (px, py) = at(m.at);
        let bar = m.interval.map_or([py, py], |[lo, hi]| [at([m.at[0], hi]).1, at([m.at[0], lo]).1]);
        taken.push([px - on.px(6.0), bar[0].min(py - on.px(6.0)), px + on.px(6.0), bar[1].max(py + on.px(6.0))]);
        if let Some([lo, hi]) = m.spread {
            taken.push([at([lo, m.at[1]]).0, py - on.px(3.0), at([hi, m.at[1]]).0, py + on.px(3.0)]);
        }
    }
    for w in lines.iter().flat_map(|line| line.windows(2)) {
        taken.extend(along(chart.backend_coord(&w[0]), chart.backend_coord(&w[1]), on.px(6.0)));
    }
    // Lines of levels hold no label either, but their own beside them.
    let lines: Vec<Box4> = panel.levels.iter().map(|l| at([x.lo, l.0]).1).map(|py| [xs.start, py - 1, xs.end, py + 1]).collect();
    let put = |text: &str, places: &[(i32, i32)], last: bool, taken: &mut Vec<Box4>| -> Drawn<B> {
        let text = canvas::plain(text);
        let long = on.px(canvas::width(&text, SMALL));
        // A place is a text's left end, half up.
        let boxes = places.iter().map(|&(px, py)| [px, py - half, px + long, py + half]);
        let inside = |b: &Box4| b[0] > xs.start && b[2] < xs.end && b[1] > ys.start && b[3] < ys.end;
        let free = |b: &Box4| inside(b) && !taken.iter().chain(&lines).any(|t| overlaps(t, b));
        let fallback = boxes.clone().next().filter(|_| last);
        // Where there is no room, the table still tells.
        if let Some(b) = boxes.into_iter().find(free).or(fallback) {
            on.area.draw_text(&text, &style, (b[0], b[1] + half + on.sunk(SMALL)))?;
            taken.push(b);
        }
        Ok(())
    };
    for (level, name) in &panel.levels {
        let py = at([x.lo, *level]).1;
        let long = on.px(canvas::width(&canvas::plain(name), SMALL));
        let rows = [py - on.px(8.0), py + on.px(9.0)];
        let right = xs.end - on.px(6.0) - long;
        let left = xs.start + on.px(6.0);
        let middle = (left + right) / 2;
        let places: Vec<(i32, i32)> = [right, left, middle].into_iter().flat_map(|px| rows.map(|py| (px, py))).collect();
        put(name, &places, true, &mut taken)?;
    }
    let mut labelled: Vec<&&Mark> = shown.iter().filter(|m| m.front && !m.label.is_empty()).collect();
    labelled.sort_by(|a, b| a.at[0].total_cmp(&b.at[0]));
    for m in labelled {
        let (px, py) = at(m.at);
        let (right, left) = (px + on.px(9.0), px - on.px(9.0) - on.px(canvas::width(&canvas::plain(&m.label), SMALL)));
        let places = [(right, -11.0), (right, 11.0), (left, 11.0), (left, -11.0), (right, 0.0), (left, 0.0)];
        let further = [(right, -24.0), (left, 24.0), (right, 24.0), (left, -24.0)];
        let places: Vec<(i32, i32)> = places.iter().chain(&further).map(|&(px, dy)| (px, py + on.px(dy))).collect();
        put(&m.label, &places, false, &mut taken)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_covered_from_end_to_end() {
        for (a, b) in [((0, 0), (100, 0)), ((0, 50), (0, 0)), ((0, 0), (30, 100)), ((5, 5), (5, 5))] {
            let boxes: Vec<Box4> = along(a, b, 12).collect();
            let holds = |x: i32, y: i32| boxes.iter().any(|t| overlaps(t, &[x, y, x + 1, y + 1]));
            assert!((0..=10).all(|i| holds(a.0 + (b.0 - a.0) * i / 10, a.1 + (b.1 - a.1) * i / 10)));
            // A slanted line leaves the corners of its rectangle free.
            assert!(a.0 == b.0 || a.1 == b.1 || !holds(b.0 - 2, a.1 + 2));
        }
    }
}
