//! Scatter charts on logarithmic axes: small multiples that share their axes, marks by colour and shape, error bars, the
//! Pareto front, levels.

use super::axis::{Axis, number};
use super::canvas::{self, Canvas, Draw, Drawn, GRID, GROUND, INK, MUTED, WIDTH};
use super::labels;
use plotters::coord::Shift;
use plotters::element::ComposedElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

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
    /// Its colour.
    pub color: RGBColor,
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
    /// Error bar along x.
    pub spread: Option<[f64; 2]>,
    /// Error bar along y.
    pub interval: Option<[f64; 2]>,
    /// Drawn hollow.
    pub hollow: bool,
    /// On the Pareto front: joined to its neighbours and labelled.
    pub front: bool,
    /// Beside the mark, where there is room and it is on the front.
    pub label: String,
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

/// Units: the legend's left edge, a line of it, size of its text, of an axis's numbers, width of the room for those.
const LEFT: f64 = 18.0;
const LINE: f64 = 20.0;
const TEXT: f64 = 12.0;
pub(super) const SMALL: f64 = 11.0;
const NUMBERS: f64 = 68.0;

const FRONT: &str = "Pareto front (large marks): nothing beats it; bars that overlap are a tie";

impl Draw for Chart {
    fn height(&self) -> f64 {
        self.head() + self.rows() as f64 * self.panel_height() + 8.0
    }

    fn draw<B: DrawingBackend>(&self, on: &Canvas<B>) -> Drawn<B> {
        on.text([LEFT, 21.0], 17.0, HPos::Left, INK, &self.title)?;
        on.text([LEFT, 43.0], TEXT, HPos::Left, MUTED, &self.subtitle)?;
        for (entry, [x, y]) in self.legend() {
            match entry {
                Entry::Series(style) => on.area.draw(&mark::<_, B>(on, style, (on.px(x + 6.0), on.px(y)), 5.2, false))?,
                Entry::Front => {
                    let corner = [[x, y + 4.0], [x + 8.0, y + 4.0], [x + 8.0, y - 4.0], [x + 16.0, y - 4.0]];
                    on.area.draw(&PathElement::new(corner.map(|[x, y]| (on.px(x), on.px(y))), on.line(INK, 1.2)))?;
                }
                Entry::Note(_) => {}
            }
            on.text([x + entry.indent(), y], TEXT, HPos::Left, INK, entry.text())?;
        }
        let marks = || self.panels.iter().flat_map(|p| p.marks.iter());
        let x = Axis::around(marks().flat_map(|m| [m.at[0]].into_iter().chain(m.spread.into_iter().flatten())));
        let levels = self.panels.iter().flat_map(|p| p.levels.iter().map(|l| l.0));
        let y = Axis::around(marks().flat_map(|m| [Some(m.at[1]), m.interval.map(|i| i[1])]).flatten().chain(levels));
        let (_, below) = on.area.split_vertically(on.px(self.head()));
        let (body, _) = below.split_vertically(on.px(self.rows() as f64 * self.panel_height()));
        for (panel, area) in self.panels.iter().zip(body.split_evenly((self.rows(), self.columns()))) {
            self.panel(on, &area, panel, [x, y])?;
        }
        Ok(())
    }
}

/// A line of the legend.
#[derive(Clone, Copy)]
enum Entry<'a> {
    Series(&'a Style),
    Front,
    Note(&'a str),
}

impl<'a> Entry<'a> {
    fn text(&self) -> &'a str {
        match self {
            Self::Series(style) => &style.name,
            Self::Front => FRONT,
            Self::Note(text) => text,
        }
    }

    fn indent(&self) -> f64 {
        match self {
            Self::Series(_) => 17.0,
            Self::Front => 22.0,
            Self::Note(_) => 0.0,
        }
    }
}

impl Chart {
    fn columns(&self) -> usize {
        self.columns.clamp(1, self.panels.len().max(1))
    }

    fn rows(&self) -> usize {
        self.panels.len().div_ceil(self.columns())
    }

    /// Units down to the first panel.
    fn head(&self) -> f64 {
        72.0 + self.legend().last().map_or(0.0, |(_, [_, y])| y - 56.0)
    }

    fn panel_width(&self) -> f64 {
        WIDTH / self.columns() as f64
    }

    fn panel_height(&self) -> f64 {
        if self.columns() == 1 { 500.0 } else { self.panel_width().clamp(340.0, 460.0) + 20.0 }
    }

    /// What occurs, and where it is explained.
    fn legend(&self) -> Vec<(Entry<'_>, [f64; 2])> {
        let marks = || self.panels.iter().flat_map(|p| p.marks.iter());
        let series = self.styles.iter().enumerate().filter(|(i, _)| marks().any(|m| m.style == *i)).map(|(_, s)| Entry::Series(s));
        let front = marks().any(|m| m.front).then_some(Entry::Front);
        let (mut x, mut y) = (LEFT, 66.0);
        let place = |entry: Entry<'_>| {
            let width = entry.indent() + canvas::width(entry.text(), TEXT) + 20.0;
            if x + width > WIDTH && x > LEFT {
                (x, y) = (LEFT, y + LINE);
            }
            x += width;
            [x - width, y]
        };
        let entries: Vec<Entry<'_>> = series.chain(front).chain(self.notes.iter().map(|n| Entry::Note(n))).collect();
        let places: Vec<[f64; 2]> = entries.iter().copied().map(place).collect();
        entries.into_iter().zip(places).collect()
    }

    fn panel<B: DrawingBackend>(&self, on: &Canvas<B>, area: &DrawingArea<B, Shift>, panel: &Panel, [x, y]: [Axis; 2]) -> Drawn<B> {
        let title = on.font(13.0, INK).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw_text(&canvas::plain(&panel.title), &title, (on.px(NUMBERS), on.px(14.0) + on.sunk(13.0)))?;
        let room = [self.panel_width() - NUMBERS - 14.0, self.panel_height() - 72.0];
        let mut chart = ChartBuilder::on(area)
            .margin_top(on.px(28.0))
            .margin_left(on.px(10.0))
            .margin_right(on.px(14.0))
            .y_label_area_size(on.px(NUMBERS - 10.0))
            .x_label_area_size(on.px(44.0))
            .build_cartesian_2d(x.coordinate(room[0], 36.0, 6.5), y.coordinate(room[1], 26.0, 0.0))?;
        chart
            .configure_mesh()
            .bold_line_style(on.line(GRID, 1.5))
            .light_line_style(on.line(GRID, 0.5))
            .axis_style(on.line(MUTED, 1.0))
            .set_all_tick_mark_size(on.px(4.0))
            .y_label_offset(on.sunk(SMALL))
            .label_style(on.font(SMALL, MUTED))
            .axis_desc_style(on.font(TEXT, INK))
            .x_label_formatter(&|v| number(*v))
            .y_label_formatter(&|v| number(*v))
            .x_desc(&self.x)
            .y_desc(&self.y)
            .draw()?;
        let at = |m: &Mark| (x.on(m.at[0]), y.on(m.at[1]));
        let drawable = |m: &&Mark| m.at.iter().all(|v| v.is_finite() && *v > 0.0);
        let shown: Vec<&Mark> = panel.marks.iter().filter(drawable).collect();
        for chain in &panel.chains {
            let line = chain.iter().filter_map(|&i| panel.marks.get(i)).filter(drawable).map(at);
            chart.draw_series(LineSeries::new(line, on.line(MUTED, 0.7)))?;
        }
        let steps = steps(shown.iter().filter(|m| m.front).map(|m| at(m)).collect());
        chart.draw_series(LineSeries::new(steps.iter().copied(), on.line(INK, 1.2)))?;
        for (level, _) in &panel.levels {
            let ends = [(x.lo, y.on(*level)), (x.hi, y.on(*level))];
            chart.draw_series(DashedLineSeries::new(ends, on.px(5.0), on.px(4.0), on.line(INK, 1.0)))?;
        }
        let styled = || shown.iter().filter_map(|m| self.styles.get(m.style).map(|s| (*m, s)));
        chart.draw_series(styled().filter_map(|(m, s)| {
            let [lo, hi] = m.spread?;
            let (mid, y) = at(m);
            Some(ErrorBar::new_horizontal(y, x.on(lo), mid, x.on(hi), on.line(s.color, 1.2), on.px(6.0) as u32))
        }))?;
        chart.draw_series(styled().filter_map(|(m, s)| {
            let [lo, hi] = m.interval?;
            let (x, mid) = at(m);
            Some(ErrorBar::new_vertical(x, y.on(lo), mid, y.on(hi), on.line(s.color, 1.2), on.px(6.0) as u32))
        }))?;
        chart.draw_series(styled().map(|(m, s)| mark(on, s, at(m), if m.front { 5.6 } else { 4.4 }, m.hollow)))?;
        let mut lines = vec![steps];
        lines.extend(panel.chains.iter().map(|c| c.iter().filter_map(|&i| panel.marks.get(i)).filter(drawable).map(at).collect()));
        labels::draw(on, &chart, panel, &shown, &lines, [x, y])
    }
}

/// The front's line: between two of its points, the corner that both leave. Points that only tie lie off it.
fn steps(mut front: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    front.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut least = f64::INFINITY;
    front.retain(|p| {
        let lower = p.1 < least;
        least = least.min(p.1);
        lower
    });
    front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(front.last().copied()).collect()
}

/// A series' mark at a point.
fn mark<C, B: DrawingBackend>(on: &Canvas<B>, style: &Style, at: C, r: f64, hollow: bool) -> Marker<C, B> {
    let outline: Vec<(i32, i32)> = style.shape.outline().iter().map(|p| (on.px(r * p[0]), on.px(r * p[1]))).collect();
    let closed: Vec<(i32, i32)> = outline.iter().chain(outline.first()).copied().collect();
    let (inside, edge) = if hollow { (GROUND, on.line(style.color, 1.6)) } else { (style.color, on.line(GROUND, 0.6)) };
    EmptyElement::at(at) + Polygon::new(outline, inside.filled()) + PathElement::new(closed, edge)
}

type Marker<C, B> = ComposedElement<C, B, Polygon<(i32, i32)>, PathElement<(i32, i32)>>;

impl Shape {
    /// Corners about the origin, y down, of about radius 1.
    fn outline(self) -> Vec<[f64; 2]> {
        let (a, b) = (0.35, 1.05);
        match self {
            Self::Circle => (0..24).map(|i| (f64::from(i) * std::f64::consts::PI / 12.0).sin_cos()).map(|(s, c)| [s, c]).collect(),
            Self::Up => vec![[0.0, -1.2], [1.1, 0.8], [-1.1, 0.8]],
            Self::Down => vec![[0.0, 1.2], [1.1, -0.8], [-1.1, -0.8]],
            Self::Diamond => vec![[0.0, -1.25], [1.1, 0.0], [0.0, 1.25], [-1.1, 0.0]],
            Self::Square => vec![[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
            Self::Cross => {
                let arm = [[0.0, -a], [b - a, -b], [b, a - b]];
                // Each quarter is the one before, turned.
                let turned = |n: usize, [x, y]: [f64; 2]| (0..n).fold([x, y], |[x, y], _| [-y, x]);
                (0..4).flat_map(|n| arm.map(|p| turned(n, p))).collect()
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn chart(label: &str) -> Chart {
        let style = Style { name: label.into(), color: RGBColor(0, 114, 178), shape: Shape::Cross };
        let mark = |x: f64, y: f64, front: bool| Mark {
            style: 0,
            at: [x, y],
            spread: Some([0.9 * x, 1.1 * x]),
            interval: Some([0.8 * y, 1.3 * y]),
            hollow: !front,
            front,
            label: label.into(),
        };
        let marks = vec![mark(0.1, 0.5, true), mark(1.0, 0.1, true), mark(2.0, 0.3, false), mark(f64::NAN, 0.0, true)];
        let panel = Panel { title: "σ ≤ ¼".into(), marks, levels: vec![(0.05, "floor".into())], chains: vec![vec![0, 2, 9]] };
        let [title, subtitle, x, y] = ["t", "s", "x", "y"].map(String::from);
        Chart { title, subtitle, x, y, styles: vec![style], notes: Vec::new(), panels: vec![panel.clone(), panel], columns: 2 }
    }

    #[test]
    fn both_backends_draw_the_same_chart() {
        let (svg, png) = (canvas::svg(&chart("a <b> & \"c\"")).unwrap(), canvas::png(&chart("a")).unwrap());
        // Escaped, whole, and nothing that is no number.
        assert!(svg.contains("a &lt;b&gt; &amp; &quot;c&quot;") && svg.trim_end().ends_with("</svg>") && !svg.contains("NaN"));
        // Per panel: two labels on the front and one floor; and the legend's.
        assert_eq!((svg.matches("a &lt;b").count(), svg.matches("floor").count()), (5, 2));
        let info = png::Decoder::new(std::io::Cursor::new(&png)).read_info().unwrap().info().clone();
        assert!(svg.contains(&format!("viewBox=\"0 0 {} {}\"", info.width, info.height)));
        // A sabotage: without its label the picture is another.
        assert_ne!(png, canvas::png(&chart("")).unwrap());
    }

    #[test]
    fn the_fronts_line_leaves_out_what_only_ties() {
        let line = steps(vec![(3.0, 1.0), (1.0, 4.0), (2.0, 4.5)]);
        assert_eq!(line, [(1.0, 4.0), (3.0, 4.0), (3.0, 1.0)]);
        assert!(steps(Vec::new()).is_empty());
    }

    #[test]
    fn an_empty_chart_is_drawn() {
        let empty = Chart { panels: Vec::new(), ..chart("a") };
        assert!(canvas::svg(&empty).is_ok() && canvas::png(&empty).is_ok());
    }
}
