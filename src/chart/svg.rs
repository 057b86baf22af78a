//! Pieces of SVG text. Colours are attributes, so that a page's style sheet may override them by class.

use std::fmt::Write as _;

/// The family that text is set in: the embedded font, or what a browser has of the same widths.
pub const FONT: &str = "DejaVu Sans, Verdana, Geneva, sans-serif";

/// Ink, muted ink, lines of the grid, ground: class and colour on a light page.
pub const INK: (&str, &str) = ("ink", "#1c2024");
/// See [`INK`].
pub const MUTED: (&str, &str) = ("muted", "#5b6570");
/// See [`INK`].
pub const GRID: (&str, &str) = ("grid", "#e1e5e9");
/// See [`INK`].
pub const GROUND: (&str, &str) = ("ground", "#ffffff");

/// An SVG document that grows.
pub struct Svg {
    body: String,
    width: f64,
    height: f64,
}

/// Where a text is anchored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

impl Svg {
    /// A picture of that many units (pixels at 100 %) on the ground's colour.
    pub fn new(width: f64, height: f64) -> Self {
        let mut svg = Self { body: String::new(), width, height };
        svg.rect([0.0, 0.0, width, height], GROUND);
        svg
    }

    /// Filled, `[x, y, width, height]`.
    pub fn rect(&mut self, [x, y, w, h]: [f64; 4], (class, color): (&str, &str)) {
        let _ = writeln!(self.body, r#"<rect class="{class}" x="{x:.1}" y="{y:.1}" width="{w:.1}" height="{h:.1}" fill="{color}"/>"#);
    }

    /// From `a` to `b`.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2], (class, color): (&str, &str), width: f64, dash: &str) {
        let dash = if dash.is_empty() { String::new() } else { format!(r#" stroke-dasharray="{dash}""#) };
        let _ = writeln!(
            self.body,
            r#"<line class="{class}-line" x1="{:.1}" y1="{:.1}" x2="{:.1}" y2="{:.1}" stroke="{color}" stroke-width="{width}"{dash}/>"#,
            a[0], a[1], b[0], b[1]
        );
    }

    /// Through all points.
    pub fn polyline(&mut self, points: &[[f64; 2]], (class, color): (&str, &str), width: f64) {
        if points.len() < 2 {
            return;
        }
        let points: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", p[0], p[1])).collect();
        let _ = writeln!(
            self.body,
            r#"<polyline class="{class}-line" points="{}" fill="none" stroke="{color}" stroke-width="{width}" stroke-linejoin="round"/>"#,
            points.join(" ")
        );
    }

    /// One line of text; `y` is its base line.
    pub fn text(&mut self, [x, y]: [f64; 2], size: f64, anchor: Anchor, (class, color): (&str, &str), text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let _ = writeln!(
            self.body,
            r#"<text class="{class}" x="{x:.1}" y="{y:.1}" font-size="{size}" text-anchor="{anchor}" fill="{color}">{}</text>"#,
            escape(text)
        );
    }

    /// Text that runs upwards, centred on `(x, y)`.
    pub fn text_up(&mut self, [x, y]: [f64; 2], size: f64, (class, color): (&str, &str), text: &str) {
        let _ = writeln!(
            self.body,
            r#"<text class="{class}" transform="translate({x:.1},{y:.1}) rotate(-90)" font-size="{size}" text-anchor="middle" fill="{color}">{}</text>"#,
            escape(text)
        );
    }

    /// Anything else, well-formed.
    pub fn raw(&mut self, text: &str) {
        self.body.push_str(text);
        self.body.push('\n');
    }

    /// The whole document; `title` is what a reader that cannot see it is told.
    pub fn finish(self, title: &str) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" font-family=\"{FONT}\">\n<title>{}</title>\n{}</svg>\n",
            escape(title),
            self.body,
            w = self.width,
            h = self.height
        )
    }
}

/// Text for the inside of an element or an attribute.
pub fn escape(text: &str) -> String {
    crate::error::escaped(text)
        .flat_map(|c| {
            let (plain, code) = match c {
                '&' => (None, "&amp;"),
                '<' => (None, "&lt;"),
                '>' => (None, "&gt;"),
                '"' => (None, "&quot;"),
                c => (Some(c), ""),
            };
            plain.into_iter().chain(code.chars())
        })
        .collect()
}

/// Width of a text in the font, roughly (DejaVu's mean advance over such words).
pub fn width(text: &str, size: f64) -> f64 {
    text.chars()
        .map(|c| {
            if c.is_ascii_uppercase() || c == 'm' || c == 'w' {
                0.72
            } else if ".,:;'il|! ".contains(c) {
                0.34
            } else {
                0.61
            }
        })
        .sum::<f64>()
        * size
}
