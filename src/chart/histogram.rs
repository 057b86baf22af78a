//! The histogram of a volume, with the opacity of a transfer function over it.

use super::axis::number;
use super::canvas::{self, Canvas, Draw, Drawn, GRID, INK, MUTED, WIDTH};
use crate::error::Result;
use crate::io::VolumeInfo;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

const HEIGHT: f64 = 430.0;
const BAR: RGBColor = RGBColor(0x9d, 0xb4, 0xc8);

/// Where the axes are, units.
const LEFT: f64 = 78.0;
const RIGHT: f64 = WIDTH - 70.0;
const TOP: f64 = 92.0;
const BOTTOM: f64 = HEIGHT - 56.0;

/// Voxels per bin on a logarithmic axis, and the points of a transfer function.
struct Histogram<'a> {
    title: &'a str,
    info: &'a VolumeInfo,
    points: &'a [[f64; 5]],
}

/// The histogram of a volume as an SVG document; `points` are those of a transfer function, [scalar, linear red, green,
/// blue, opacity], drawn as a line with its colours.
///
/// # Errors
/// [`crate::Error::Invalid`] with what the drawing library says.
pub fn histogram_svg(title: &str, info: &VolumeInfo, points: &[[f64; 5]]) -> Result<String> {
    canvas::svg(&Histogram { title, info, points })
}

/// The same as a PNG file.
///
/// # Errors
/// As [`histogram_svg`].
pub fn histogram_png(title: &str, info: &VolumeInfo, points: &[[f64; 5]]) -> Result<Vec<u8>> {
    canvas::png(&Histogram { title, info, points })
}

impl Draw for Histogram<'_> {
    fn height(&self) -> f64 {
        HEIGHT
    }

    fn draw<B: DrawingBackend>(&self, on: &Canvas<B>) -> Drawn<B> {
        let info = self.info;
        let [x, y, z] = info.dims;
        on.text([18.0, 21.0], 17.0, HPos::Left, INK, self.title)?;
        let range = info.range.map(|v| short(f64::from(v)));
        let about = format!("{x}x{y}x{z} {}, {} to {}, mean {}", info.sample_type, range[0], range[1], short(info.mean));
        on.text([18.0, 43.0], 12.0, HPos::Left, MUTED, &about)?;
        on.text([18.0, 70.0], 12.0, HPos::Left, INK, "voxels per bin")?;
        on.text([WIDTH - 18.0, 70.0], 12.0, HPos::Right, INK, "opacity per voxel, a first guess")?;
        let most = info.histogram.iter().copied().max().unwrap_or(0).max(1) as f64;
        let top = most.log10().ceil().max(1.0);
        // One voxel is seen, too.
        let height = |n: f64| if n < 1.0 { 0.0 } else { (n.log10() + 0.3) / (top + 0.3) * (BOTTOM - TOP) };
        for decade in 0..=top as i32 {
            let y = BOTTOM - height(10f64.powi(decade));
            rule(on, [LEFT, y], [RIGHT, y], GRID)?;
            let label = if decade < 4 { 10i64.pow(decade as u32).to_string() } else { format!("1e{decade}") };
            on.text([LEFT - 8.0, y], 11.0, HPos::Right, MUTED, &label)?;
        }
        let width = (RIGHT - LEFT) / info.histogram.len().max(1) as f64;
        for (i, &n) in info.histogram.iter().enumerate().filter(|(_, n)| **n > 0) {
            let (a, b) = (LEFT + i as f64 * width, LEFT + (i + 1) as f64 * width);
            let corners = [(on.px(a + 0.5), on.px(BOTTOM - height(n as f64))), (on.px(b - 0.5), on.px(BOTTOM))];
            on.area.draw(&Rectangle::new(corners, BAR.filled()))?;
        }
        rule(on, [LEFT, BOTTOM], [RIGHT, BOTTOM], MUTED)?;
        let [lo, hi] = info.range.map(f64::from);
        for quarter in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let at = LEFT + quarter * (RIGHT - LEFT);
            on.text([at, BOTTOM + 16.0], 11.0, HPos::Center, MUTED, &short(lo + quarter * (hi - lo)))?;
        }
        on.text([0.5 * (LEFT + RIGHT), BOTTOM + 38.0], 12.0, HPos::Center, INK, "value")?;
        self.curve(on)
    }
}

impl Histogram<'_> {
    /// Opacity, with its own axis on the right.
    fn curve<B: DrawingBackend>(&self, on: &Canvas<B>) -> Drawn<B> {
        let most = self.points.iter().map(|p| p[4]).fold(0.0, f64::max);
        let [lo, hi] = self.info.range.map(f64::from);
        if most <= 0.0 || hi <= lo {
            return Ok(());
        }
        let y = |opacity: f64| BOTTOM - 0.94 * opacity / most * (BOTTOM - TOP);
        let at = |p: &[f64; 5]| {
            let x = LEFT + ((p[0] - lo) / (hi - lo)).clamp(0.0, 1.0) * (RIGHT - LEFT);
            (on.px(x), on.px(y(p[4])))
        };
        let line: Vec<(i32, i32)> = self.points.iter().map(at).collect();
        on.area.draw(&PathElement::new(line, on.line(INK, 1.5)))?;
        for p in self.points {
            let channel = |c: f64| (crate::io::png::srgb(c as f32) * 255.0).round() as u8;
            let color = RGBColor(channel(p[1]), channel(p[2]), channel(p[3]));
            on.area.draw(&Circle::new(at(p), on.px(5.5), INK.filled()))?;
            on.area.draw(&Circle::new(at(p), on.px(4.5), color.filled()))?;
        }
        on.text([RIGHT + 8.0, y(most)], 11.0, HPos::Left, MUTED, &number(most))?;
        on.text([RIGHT + 8.0, BOTTOM], 11.0, HPos::Left, MUTED, "0")
    }
}

fn rule<B: DrawingBackend>(on: &Canvas<B>, a: [f64; 2], b: [f64; 2], color: RGBColor) -> Drawn<B> {
    on.area.draw(&PathElement::new([(on.px(a[0]), on.px(a[1])), (on.px(b[0]), on.px(b[1]))], on.line(color, 1.0)))
}

/// Four significant digits.
fn short(v: f64) -> String {
    let scale = 10f64.powi((3 - v.abs().max(1e-6).log10().floor() as i32).clamp(0, 9));
    format!("{}", (v * scale).round() / scale)
}
