//! Drawing through plotters: one drawing for SVG and PNG, its text in the embedded font, so that every machine draws the
//! same. Lengths are in units, some pixels each.

use super::raster;
use crate::error::{Error, Result};
use plotters::prelude::*;
use plotters::style::FontStyle;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::{coord::Shift, drawing::DrawingAreaErrorKind};

/// DejaVu Sans, cut to Latin, figures and some signs (its licence lies beside it).
const FONT: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// What the font is called: itself, or what a browser has of the same widths.
const FAMILY: &str = "DejaVu Sans, Verdana, Geneva, sans-serif";

/// plotters' size of a text over its em: 1.24 in SVG, 1.16 (the height of a line) in pictures.
const LINE: f64 = 1.2;

/// Of a text's size: how much too high plotters centres it in pictures with fonts of `ab_glyph`.
const SINK: f64 = 0.16;

/// Pixels per unit; a picture is drawn twice as fine and averaged.
const UNIT: f64 = 2.0;

/// Units across.
pub const WIDTH: f64 = 1080.0;

/// Text and axes.
pub const INK: RGBColor = RGBColor(0x1c, 0x20, 0x24);
/// Lesser text.
pub const MUTED: RGBColor = RGBColor(0x5b, 0x65, 0x70);
/// Lines of the grid.
pub const GRID: RGBColor = RGBColor(0xe1, 0xe5, 0xe9);
/// Ground.
pub const GROUND: RGBColor = RGBColor(0xff, 0xff, 0xff);

/// What came of drawing on a backend.
pub type Drawn<B, T = ()> = std::result::Result<T, DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// Something to draw.
pub trait Draw {
    /// Units down.
    fn height(&self) -> f64;

    /// Draws itself.
    fn draw<B: DrawingBackend>(&self, on: &Canvas<B>) -> Drawn<B>;
}

/// Where it is drawn.
pub struct Canvas<B: DrawingBackend> {
    /// All of it.
    pub area: DrawingArea<B, Shift>,
    unit: f64,
    sink: f64,
}

impl<B: DrawingBackend> Canvas<B> {
    /// Units → pixels.
    pub fn px(&self, units: f64) -> i32 {
        (units * self.unit).round() as i32
    }

    /// A line so many units wide.
    pub fn line(&self, color: RGBColor, units: f64) -> ShapeStyle {
        color.stroke_width(self.px(units).max(1) as u32)
    }

    /// Text of a size.
    pub fn font(&self, size: f64, color: RGBColor) -> TextStyle<'static> {
        TextStyle { color: color.to_backend_color(), ..font(size * self.unit) }
    }

    /// One line of text, centred in height on `y`.
    pub fn text(&self, [x, y]: [f64; 2], size: f64, from: HPos, color: RGBColor, text: &str) -> Drawn<B> {
        let style = self.font(size, color).pos(Pos::new(from, VPos::Center));
        self.area.draw_text(&plain(text), &style, (self.px(x), self.px(y) + self.sunk(size)))
    }

    /// Pixels that a text which is centred on a place must stand lower to look so.
    pub fn sunk(&self, size: f64) -> i32 {
        self.px(self.sink * size)
    }
}

fn font(pixels: f64) -> TextStyle<'static> {
    TextStyle::from((FAMILY, pixels * LINE).into_font())
}

/// Text without what no line of text holds.
pub fn plain(text: &str) -> String {
    crate::error::escaped(text).collect()
}

/// Units that a text takes.
pub fn width(text: &str, size: f64) -> f64 {
    ready();
    // Sizes are whole pixels: measured large, for the sum is rounded.
    font(16.0 * size).font.box_size(text).map_or(0.0, |(w, _)| f64::from(w) / 16.0)
}

fn ready() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    // Were the font broken, drawing would say that it is missing.
    ONCE.call_once(|| drop(plotters::style::register_font(FAMILY, FontStyle::Normal, FONT)));
}

fn drawn<B: DrawingBackend>(backend: B, unit: f64, sink: f64, what: &impl Draw) -> Result<()> {
    ready();
    let canvas = Canvas { area: backend.into_drawing_area(), unit, sink };
    let all = canvas.area.fill(&GROUND).and_then(|()| what.draw(&canvas)).and_then(|()| canvas.area.present());
    all.map_err(|e| Error::Invalid { item: "chart", what: e.to_string(), right: "plotters can draw it".into() })
}

fn size(what: &impl Draw, unit: f64) -> (u32, u32) {
    ((WIDTH * unit).round() as u32, (what.height() * unit).round().max(1.0) as u32)
}

/// As an SVG document.
///
/// # Errors
/// [`Error::Invalid`] with what plotters says.
pub fn svg(what: &impl Draw) -> Result<String> {
    let mut text = String::new();
    drawn(SVGBackend::with_string(&mut text, size(what, UNIT)), UNIT, 0.0, what)?;
    Ok(text)
}

/// As a PNG file.
///
/// # Errors
/// [`Error::Invalid`] with what plotters says.
pub fn png(what: &impl Draw) -> Result<Vec<u8>> {
    let (width, height) = size(what, UNIT);
    let mut fine = vec![0; 3 * 4 * width as usize * height as usize];
    drawn(BitMapBackend::with_buffer(&mut fine, (2 * width, 2 * height)), 2.0 * UNIT, SINK, what)?;
    raster::halved_png(width, height, &fine)
}
