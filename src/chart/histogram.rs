//! The histogram of a volume, with the opacity of a transfer function over it.

use super::plot::number;
use super::svg::{Anchor, GRID, INK, MUTED, Svg};
use crate::io::VolumeInfo;

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 58.0;
const TOP: f64 = 66.0;
const BOTTOM: f64 = 52.0;

/// Voxels per bin on a logarithmic axis as SVG; `points` are those of a transfer function, [scalar, linear red, green,
/// blue, opacity], drawn as a line with its colours.
pub fn histogram_svg(title: &str, info: &VolumeInfo, points: &[[f64; 5]]) -> String {
    let mut svg = Svg::new(WIDTH, HEIGHT);
    let [x, y, z] = info.dims;
    svg.text([18.0, 26.0], 16.0, Anchor::Start, INK, title);
    let about = format!("{x}x{y}x{z} {}, {} to {}, mean {}", info.sample_type, info.range[0], info.range[1], short(info.mean));
    svg.text([18.0, 45.0], 12.0, Anchor::Start, MUTED, &about);
    let (x0, x1, y0, y1) = (LEFT, WIDTH - RIGHT, HEIGHT - BOTTOM, TOP);
    let most = info.histogram.iter().copied().max().unwrap_or(0).max(1) as f64;
    let top = most.log10().ceil().max(1.0);
    let height = |n: f64| if n < 1.0 { 0.0 } else { (n.log10() + 0.3) / (top + 0.3) * (y0 - y1) };
    for decade in 0..=top as i32 {
        let y = y0 - height(10f64.powi(decade));
        svg.line([x0, y], [x1, y], GRID, 0.8, "");
        let label = if decade < 4 { format!("{}", 10i64.pow(decade as u32)) } else { format!("1e{decade}") };
        svg.text([x0 - 7.0, y + 4.0], 11.0, Anchor::End, MUTED, &label);
    }
    let width = (x1 - x0) / info.histogram.len().max(1) as f64;
    for (i, &n) in info.histogram.iter().enumerate() {
        let h = height(n as f64);
        if h <= 0.0 {
            continue;
        }
        svg.rect([x0 + i as f64 * width + 0.5, y0 - h, (width - 1.0).max(0.5), h], ("bar", "#9db4c8"));
    }
    let (lo, hi) = (f64::from(info.range[0]), f64::from(info.range[1]));
    for i in 0..=4 {
        let at = x0 + 0.25 * f64::from(i) * (x1 - x0);
        svg.text([at, y0 + 17.0], 11.0, Anchor::Middle, MUTED, &short(lo + 0.25 * f64::from(i) * (hi - lo)));
    }
    svg.line([x0, y0], [x1, y0], MUTED, 1.0, "");
    svg.text([0.5 * (x0 + x1), y0 + 38.0], 12.0, Anchor::Middle, INK, "value");
    svg.text_up([16.0, 0.5 * (y0 + y1)], 12.0, INK, "voxels per bin");
    curve(&mut svg, points, [lo, hi], [x0, x1, y0, y1]);
    svg.finish(title)
}

/// Opacity over the histogram, with its own axis on the right.
fn curve(svg: &mut Svg, points: &[[f64; 5]], [lo, hi]: [f64; 2], [x0, x1, y0, y1]: [f64; 4]) {
    let most = points.iter().map(|p| p[4]).fold(0.0, f64::max);
    if most <= 0.0 || hi <= lo {
        return;
    }
    let at = |p: &[f64; 5]| [x0 + ((p[0] - lo) / (hi - lo)).clamp(0.0, 1.0) * (x1 - x0), y0 - 0.94 * p[4] / most * (y0 - y1)];
    let line: Vec<[f64; 2]> = points.iter().map(at).collect();
    svg.polyline(&line, INK, 1.6);
    for p in points {
        let [x, y] = at(p);
        let channel = |c: f64| (crate::io::png::srgb(c as f32) * 255.0).round() as u8;
        let (r, g, b) = (channel(p[1]), channel(p[2]), channel(p[3]));
        svg.raw(&format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#{r:02x}{g:02x}{b:02x}\" stroke=\"{}\"/>\n", INK.1));
    }
    let y = y0 - 0.94 * (y0 - y1);
    svg.text([x1 + 6.0, y + 4.0], 11.0, Anchor::Start, MUTED, &number(most));
    svg.text([x1 + 6.0, y0 + 4.0], 11.0, Anchor::Start, MUTED, "0");
    svg.text_up([WIDTH - 12.0, 0.5 * (y0 + y1)], 12.0, INK, "opacity per voxel (a first guess)");
}

/// Four significant digits.
fn short(v: f64) -> String {
    let scale = 10f64.powi((3 - v.abs().max(1e-6).log10().floor() as i32).clamp(0, 9));
    format!("{}", (v * scale).round() / scale)
}
