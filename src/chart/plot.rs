//! Scatter charts on logarithmic axes: small multiples that share their axes, marks by colour and shape, error bars, the
//! Pareto front, levels.

use super::svg::{self, Anchor, GRID, GROUND, INK, MUTED, Svg};
use std::fmt::Write as _;

/// Shapes that stay apart without colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// ●
    Circle,
    /// ▲
    Up,
    /// ▼
    Down,
    /// ◆
    Diamond,
    /// ■
    Square,
    /// ✕
    Cross,
}

/// One series' looks. Colours are Okabe and Ito's, told apart by colour-blind eyes.
#[derive(Clone, Debug)]
pub struct Style {
    /// In the legend.
    pub name: String,
    /// Class, for a page that overrides the colour.
    pub class: &'static str,
    /// On a light ground.
    pub color: &'static str,
    /// Its mark.
    pub shape: Shape,
}

/// One measured point.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Index of its style.
    pub style: usize,
    /// Both above 0.
    pub at: [f64; 2],
    /// Error bar along y.
    pub interval: Option<[f64; 2]>,
    /// Drawn hollow.
    pub hollow: bool,
    /// On the Pareto front: joined to its neighbours and labelled.
    pub front: bool,
    /// Beside the mark, where there is room and it is on the front.
    pub label: String,
    /// Shown by a browser under the pointer.
    pub title: String,
}

/// One small multiple.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Its points.
    pub marks: Vec<Mark>,
    /// Horizontal lines with their names.
    pub levels: Vec<(f64, String)>,
    /// Marks that a thin line joins, by index.
    pub chains: Vec<Vec<usize>>,
}

/// A whole chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// First line.
    pub title: String,
    /// Second line, muted.
    pub subtitle: String,
    /// Name of the x axis with its unit.
    pub x: String,
    /// Name of the y axis.
    pub y: String,
    /// Series.
    pub styles: Vec<Style>,
    /// What hollow marks and the front's line mean, where they occur.
    pub notes: Vec<String>,
    /// Row by row.
    pub panels: Vec<Panel>,
    /// Panels in a row.
    pub columns: usize,
}

const WIDTH: f64 = 1080.0;
const LEFT: f64 = 74.0;
const RIGHT: f64 = 18.0;
const GAP: f64 = 22.0;
const LABEL: f64 = 11.0;

/// A logarithmic axis over `lo..hi`, on the pixels `from..to`.
#[derive(Clone, Copy)]
struct Axis {
    lo: f64,
    hi: f64,
    from: f64,
    to: f64,
}

impl Axis {
    /// Around positive values, with some room on both sides.
    fn around(values: impl Iterator<Item = f64>) -> Self {
        let (lo, hi) = values.filter(|v| v.is_finite() && *v > 0.0).fold((f64::INFINITY, 0f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
        let (lo, hi) = if lo <= hi { (lo, hi) } else { (0.1, 1.0) };
        let room = (0.06 * (hi / lo).log10()).max(0.12);
        Self { lo: lo * 10f64.powf(-room), hi: hi * 10f64.powf(room), from: 0.0, to: 1.0 }
    }

    fn on(self, from: f64, to: f64) -> Self {
        Self { from, to, ..self }
    }

    fn at(&self, v: f64) -> f64 {
        let t = (v.max(self.lo * 0.5) / self.lo).log10() / (self.hi / self.lo).log10();
        self.from + t.min(1.5) * (self.to - self.from)
    }

    /// Values of the grid's lines, and whether each is written.
    fn ticks(&self) -> Vec<(f64, bool)> {
        let decades = (self.hi / self.lo).log10();
        let named: &[f64] = match decades {
            d if d < 0.8 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
            d if d < 2.2 => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let mut ticks = Vec::new();
        for decade in self.lo.log10().floor() as i32..=self.hi.log10().ceil() as i32 {
            for m in [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0] {
                let v = m * 10f64.powi(decade);
                if (m != 1.5 || named.contains(&1.5)) && v >= self.lo && v <= self.hi {
                    ticks.push((v, named.contains(&m)));
                }
            }
        }
        ticks
    }
}

/// A number as an axis says it: at most two digits that count.
pub fn number(v: f64) -> String {
    let digits = (1 - v.abs().max(1e-12).log10().floor() as i32).max(0) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// The chart as SVG.
pub fn draw(chart: &Chart) -> String {
    let columns = chart.columns.clamp(1, chart.panels.len().max(1));
    let rows = chart.panels.len().div_ceil(columns);
    let inner = WIDTH - LEFT - RIGHT - GAP * (columns - 1) as f64;
    let w = inner / columns as f64;
    let h = if columns == 1 { 430.0 } else { (1.05 * w).clamp(300.0, 400.0) };
    let legend = legend_rows(chart);
    let top = 62.0 + 20.0 * legend.len() as f64;
    let row_height = h + 66.0;
    let height = top + rows as f64 * row_height + 14.0;
    let mut svg = Svg::new(WIDTH, height);
    svg.text([18.0, 27.0], 17.0, Anchor::Start, INK, &chart.title);
    svg.text([18.0, 47.0], 12.0, Anchor::Start, MUTED, &chart.subtitle);
    for (row, entries) in legend.iter().enumerate() {
        let mut x = 18.0;
        for (entry, width) in entries {
            let y = 66.0 + 20.0 * row as f64;
            match entry {
                Entry::Style(style) => svg.raw(&mark(style, [x + 6.0, y], 5.2, false)),
                Entry::Front => svg.polyline(&[[x, y + 4.0], [x + 8.0, y - 4.0], [x + 16.0, y - 4.0]], INK, 1.2),
                Entry::Text(_) => {}
            }
            let (indent, text) = match entry {
                Entry::Style(s) => (17.0, s.name.as_str()),
                Entry::Front => (22.0, FRONT),
                Entry::Text(t) => (0.0, t.as_str()),
            };
            svg.text([x + indent, y + 4.2], 12.0, Anchor::Start, INK, text);
            x += width;
        }
    }
    let all = || chart.panels.iter().flat_map(|p| p.marks.iter());
    let x_axis = Axis::around(all().map(|m| m.at[0]));
    let levels = chart.panels.iter().flat_map(|p| p.levels.iter().map(|l| l.0));
    let y_axis = Axis::around(all().flat_map(|m| [Some(m.at[1]), m.interval.map(|i| i[1])]).flatten().chain(levels));
    for (i, panel) in chart.panels.iter().enumerate() {
        let (column, row) = (i % columns, i / columns);
        let x0 = LEFT + column as f64 * (w + GAP);
        let y0 = top + row as f64 * row_height + 22.0;
        let area = Area { x: x_axis.on(x0, x0 + w), y: y_axis.on(y0 + h, y0) };
        svg.text([x0, y0 - 8.0], 13.0, Anchor::Start, INK, &panel.title);
        grid(&mut svg, &area, column == 0, w);
        if column == 0 {
            svg.text_up([20.0, y0 + 0.5 * h], 12.0, INK, &chart.y);
        }
        svg.text([x0 + 0.5 * w, y0 + h + 37.0], 12.0, Anchor::Middle, INK, &chart.x);
        content(&mut svg, chart, panel, &area);
    }
    svg.finish(&format!("{}. {}", chart.title, chart.subtitle))
}

struct Area {
    x: Axis,
    y: Axis,
}

impl Area {
    fn at(&self, p: [f64; 2]) -> [f64; 2] {
        [self.x.at(p[0]), self.y.at(p[1])]
    }
}

enum Entry<'a> {
    Style(&'a Style),
    Front,
    Text(&'a String),
}

const FRONT: &str = "Pareto front: nothing is both faster and closer";

/// The legend's entries with their widths, in lines.
fn legend_rows(chart: &Chart) -> Vec<Vec<(Entry<'_>, f64)>> {
    let used = |i: &usize| chart.panels.iter().any(|p| p.marks.iter().any(|m| m.style == *i));
    let styles = (0..chart.styles.len()).filter(used).map(|i| Entry::Style(&chart.styles[i]));
    let front = chart.panels.iter().any(|p| p.marks.iter().any(|m| m.front)).then_some(Entry::Front);
    let entries = styles.chain(front).chain(chart.notes.iter().map(Entry::Text));
    let mut rows: Vec<Vec<(Entry<'_>, f64)>> = vec![Vec::new()];
    let mut x = 0.0;
    for entry in entries {
        let width = match &entry {
            Entry::Style(s) => 17.0 + svg::width(&s.name, 12.0),
            Entry::Front => 22.0 + svg::width(FRONT, 12.0),
            Entry::Text(t) => svg::width(t, 12.0),
        } + 20.0;
        if x + width > WIDTH - 36.0 && x > 0.0 {
            rows.push(Vec::new());
            x = 0.0;
        }
        x += width;
        if let Some(row) = rows.last_mut() {
            row.push((entry, width));
        }
    }
    rows
}

fn grid(svg: &mut Svg, area: &Area, first: bool, width: f64) {
    let (x0, x1, y0, y1) = (area.x.from, area.x.to, area.y.from, area.y.to);
    let mut last = f64::NEG_INFINITY;
    for (v, named) in area.x.ticks() {
        let x = area.x.at(v);
        svg.line([x, y0], [x, y1], GRID, if named { 1.0 } else { 0.5 }, "");
        let text = number(v);
        let half = 0.5 * svg::width(&text, LABEL);
        if named && x - half > last + 6.0 && x + half < x0 + width + GAP {
            svg.text([x, y0 + 16.0], LABEL, Anchor::Middle, MUTED, &text);
            last = x + half;
        }
    }
    for (v, named) in area.y.ticks() {
        let y = area.y.at(v);
        svg.line([x0, y], [x1, y], GRID, if named { 1.0 } else { 0.5 }, "");
        if named && first {
            svg.text([x0 - 7.0, y + 4.0], LABEL, Anchor::End, MUTED, &number(v));
        }
    }
    svg.line([x0, y0], [x1, y0], MUTED, 1.0, "");
    svg.line([x0, y0], [x0, y1], MUTED, 1.0, "");
}

fn content(svg: &mut Svg, chart: &Chart, panel: &Panel, area: &Area) {
    let mut taken: Vec<[f64; 4]> = Vec::new();
    for chain in &panel.chains {
        let points: Vec<[f64; 2]> = chain.iter().filter_map(|&i| panel.marks.get(i)).map(|m| area.at(m.at)).collect();
        svg.polyline(&points, MUTED, 0.7);
    }
    let mut front: Vec<[f64; 2]> = panel.marks.iter().filter(|m| m.front).map(|m| area.at(m.at)).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // Between two of its points the front is the corner that both leave.
    let steps: Vec<[f64; 2]> = front.windows(2).flat_map(|w| [w[0], [w[1][0], w[0][1]]]).chain(front.last().copied()).collect();
    svg.polyline(&steps, INK, 1.2);
    for m in &panel.marks {
        let [x, y] = area.at(m.at);
        if let (Some([lo, hi]), Some(style)) = (m.interval, chart.styles.get(m.style)) {
            let color = (style.class, style.color);
            svg.line([x, area.y.at(lo)], [x, area.y.at(hi)], color, 1.1, "");
            for end in [lo, hi] {
                svg.line([x - 3.0, area.y.at(end)], [x + 3.0, area.y.at(end)], color, 1.1, "");
            }
        }
        let bar = m.interval.map_or([y, y], |[lo, hi]| [area.y.at(hi), area.y.at(lo)]);
        taken.push([x - 6.0, bar[0].min(y - 6.0), x + 6.0, bar[1].max(y + 6.0)]);
    }
    for m in &panel.marks {
        if let Some(style) = chart.styles.get(m.style) {
            let title = svg::escape(&m.title);
            svg.raw(&format!("<g><title>{title}</title>{}</g>", mark(style, area.at(m.at), if m.front { 5.6 } else { 4.4 }, m.hollow)));
        }
    }
    for (level, name) in &panel.levels {
        let y = area.y.at(*level);
        svg.line([area.x.from, y], [area.x.to, y], INK, 1.0, "5 4");
        let width = svg::width(name, LABEL);
        let right = area.x.to - 6.0;
        let free = |y: f64| !taken.iter().any(|t| overlaps(t, &[right - width, y - 11.0, right, y + 2.0]));
        let place = [y - 4.0, y + 13.0].into_iter().find(|y| free(*y)).unwrap_or(y - 4.0);
        svg.text([right, place], LABEL, Anchor::End, INK, name);
        taken.push([right - width, place - 11.0, right, place + 3.0]);
    }
    let mut labelled: Vec<&Mark> = panel.marks.iter().filter(|m| m.front && !m.label.is_empty()).collect();
    labelled.sort_by(|a, b| a.at[0].total_cmp(&b.at[0]));
    for m in labelled {
        let [x, y] = area.at(m.at);
        let width = svg::width(&m.label, LABEL);
        let places = [
            (9.0, -7.0),
            (9.0, 14.0),
            (-9.0 - width, 14.0),
            (-9.0 - width, -7.0),
            (9.0, 4.0),
            (-9.0 - width, 4.0),
            (9.0, -20.0),
            (-9.0 - width, 27.0),
            (9.0, 27.0),
        ];
        let fits = |b: &[f64; 4]| {
            b[0] > area.x.from + 2.0 && b[2] < area.x.to && b[1] > area.y.to && b[3] < area.y.from && !taken.iter().any(|t| overlaps(t, b))
        };
        let boxes = places.map(|(dx, dy)| [x + dx, y + dy - 10.0, x + dx + width, y + dy + 3.0]);
        // Where there is no room, the pointer and the table still tell.
        if let Some(b) = boxes.into_iter().find(|b| fits(b)) {
            svg.text([b[0], b[3] - 3.0], LABEL, Anchor::Start, INK, &m.label);
            taken.push(b);
        }
    }
}

fn overlaps(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// A series' mark around a point.
pub fn mark(style: &Style, [x, y]: [f64; 2], r: f64, hollow: bool) -> String {
    let polygon = |points: &[[f64; 2]]| {
        let mut text = String::from("<polygon points=\"");
        for p in points {
            let _ = write!(text, "{:.1},{:.1} ", x + r * p[0], y + r * p[1]);
        }
        text + "\""
    };
    let (class, color) = (style.class, style.color);
    let body = match style.shape {
        Shape::Circle => format!(r#"<circle cx="{x:.1}" cy="{y:.1}" r="{r:.1}""#),
        Shape::Up => polygon(&[[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]]),
        Shape::Down => polygon(&[[0.0, 1.2], [1.1, -0.8], [-1.1, -0.8]]),
        Shape::Diamond => polygon(&[[0.0, -1.25], [1.1, 0.0], [0.0, 1.25], [-1.1, 0.0]]),
        Shape::Square => polygon(&[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]]),
        Shape::Cross => {
            let (a, b) = (0.35, 1.05);
            polygon(&[
                [0.0, -a],
                [b - a, -b],
                [b, a - b],
                [a, 0.0],
                [b, b - a],
                [b - a, b],
                [0.0, a],
                [a - b, b],
                [-b, b - a],
                [-a, 0.0],
                [-b, a - b],
                [a - b, -b],
            ])
        }
    };
    match hollow {
        true => format!(r#"{body} class="ground {class}-line" fill="{}" stroke="{color}" stroke-width="1.6"/>"#, GROUND.1),
        false => format!(r#"{body} class="{class} ground-line" fill="{color}" stroke="{}" stroke-width="0.7"/>"#, GROUND.1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_on_axes_are_short() {
        for (v, text) in [(0.01, "0.01"), (0.015, "0.015"), (1.0, "1"), (20.0, "20"), (100.0, "100"), (5000.0, "5000"), (0.2, "0.2")] {
            assert_eq!(number(v), text);
        }
    }

    #[test]
    fn an_axis_is_logarithmic_and_holds_its_values() {
        let axis = Axis::around([0.01, 1.0, f64::NAN, 0.0].into_iter()).on(0.0, 100.0);
        let (a, b, c) = (axis.at(0.01), axis.at(0.1), axis.at(1.0));
        assert!(a > 0.0 && c < 100.0 && ((b - a) - (c - b)).abs() < 1e-9);
        assert!(axis.ticks().iter().any(|t| t.1));
        // Nothing to show, or all the same: still an axis.
        assert!(Axis::around([].into_iter()).ticks().len() > 1 && !Axis::around([3.0].into_iter()).ticks().is_empty());
    }
}
