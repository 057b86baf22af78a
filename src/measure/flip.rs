//! FLIP: the difference that an observer perceives when two pictures alternate, 0..1 per pixel.
//!
//! Andersson et al. 2020 (*FLIP: A Difference Evaluator for Alternating Images*): both pictures are blurred by the eye's
//! contrast sensitivity in an opponent space; their colours are compared by HyAB in Hunt-adjusted L*a*b*, and the result is
//! raised where edges or points differ: ΔE = ΔE_c^(1 − ΔE_f). Andersson et al. 2021 (*Visualizing Errors in Rendered High
//! Dynamic Range Images*): for radiance, the largest of that over the exposures from the one that shows the brightest pixel
//! to the one that shows the median. `tests/compare.rs` holds it to the authors' own evaluator, to 1e-4.
//!
//! Separable filters: per pixel, picture and exposure 21 multiply-adds in each of four filtered planes and directions, and
//! 19 in each of three and five of the feature planes.

use super::picture::comparable;
use crate::error::{Error, Result};
use crate::io::png;
use crate::scene::Picture;
use serde::Serialize;

/// Pixels per degree of a 0.7 m wide screen of 3840 pixels seen from 0.7 m: the authors' default.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * std::f64::consts::PI / 180.0;

/// Exponents and break of the colour difference's map to 0..1 (q_c, p_c, p_t), and the exponent of features (q_f).
const COLOR: [f32; 3] = [0.7, 0.4, 0.95];
const FEATURE_EXPONENT: f32 = 0.5;

/// Width of a feature, degrees.
const FEATURE_WIDTH: f64 = 0.082;

/// Contrast sensitivity in Y, Cx and Cz as sums of Gaussians a·√(π/b)·exp(−π²z²/b), z in degrees: (a, b).
const SENSITIVITY: [[(f64, f64); 2]; 3] = [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// The tone map of HDR-FLIP, (x(ax + b) + c)/(x(dx + e) + f): the fit of ACES by Narkowicz, with its exposure taken out.
const TONE: [f64; 6] = [0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14];

/// Linear RGB of sRGB's primaries to X, Y, Z under D65.
const TO_XYZ: [[f64; 3]; 3] = [
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
];

/// A map of differences and what is said of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Flip {
    /// Difference per pixel, 0..1; row 0 is the top row.
    #[serde(skip)]
    pub map: Vec<f32>,
    /// Mean over all pixels.
    pub mean: f64,
    /// Largest.
    pub max: f64,
    /// At each of [`PERCENTILES`]: the difference below which that share of the summed difference lies (each pixel counts
    /// by its own difference, so that untouched pixels count nothing).
    pub weighted: [f64; 6],
    /// (first stop, last stop, number) of the exposures; `None` for pictures meant for display.
    pub exposures: Option<(f64, f64, usize)>,
}

/// Percent of [`Flip::weighted`].
pub const PERCENTILES: [u32; 6] = [1, 25, 50, 75, 95, 99];

/// Most pixels: 8K UHD. A comparison takes some 120 bytes a pixel.
const MAX_PIXELS: usize = 1 << 25;

/// Three planes.
type Planes = [Vec<f32>; 3];

/// Of pictures meant for display: linear RGB, clamped to 0..1 (LDR-FLIP).
///
/// # Errors
/// [`Error::Invalid`] for pictures of different sizes or more than 33,554,432 pixels, and for pixels that are not finite.
pub fn display(test: &Picture, reference: &Picture) -> Result<Flip> {
    usable(test, reference)?;
    let size = (reference.width, reference.height);
    let opponent = |p: &Picture| opponent(&p.rgba, |v| v.clamp(0.0, 1.0));
    Ok(pooled(ldr(size, opponent(test), opponent(reference)), None))
}

/// Of pictures of linear radiance (HDR-FLIP), over exposures chosen from the reference.
///
/// # Errors
/// As [`display`].
pub fn radiance(test: &Picture, reference: &Picture) -> Result<Flip> {
    usable(test, reference)?;
    let size = (reference.width, reference.height);
    let (start, stop) = exposures(reference);
    let count = ((stop - start).ceil() as usize).max(2);
    let at = |i: usize| start + (stop - start) * i as f64 / (count - 1) as f64;
    let mut map = vec![0f32; reference.rgba.len()];
    for i in 0..count {
        let gain = at(i).exp2() as f32;
        let opponent = |p: &Picture| opponent(&p.rgba, |v| tone(v * gain));
        for (most, e) in map.iter_mut().zip(ldr(size, opponent(test), opponent(reference))) {
            *most = most.max(e);
        }
    }
    Ok(pooled(map, Some((start, stop, count))))
}

/// Refuses what cannot be compared, or only in more memory than is reasonable.
fn usable(test: &Picture, reference: &Picture) -> Result<()> {
    comparable(test, reference)?;
    if reference.rgba.len() > MAX_PIXELS {
        return Err(Error::Invalid {
            item: "compared pictures",
            what: format!("{}x{} pixels", reference.width, reference.height),
            right: format!("FLIP takes at most {MAX_PIXELS}: compare parts of them"),
        });
    }
    Ok(())
}

/// The exposures, in stops, that bring the brightest and the median luminance to 85 % of the tone map's white.
fn exposures(reference: &Picture) -> (f64, f64) {
    let [a, b, c] = [0, 1, 2].map(|i| TONE[i] - 0.85 * TONE[i + 3]);
    let roots = [1.0, -1.0].map(|sign| (-b + sign * (b * b - 4.0 * a * c).sqrt()) / (2.0 * a));
    let white = roots[0].max(roots[1]);
    let mut luminance: Vec<f32> = reference.rgba.iter().map(|p| 0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]).collect();
    luminance.sort_by(f32::total_cmp);
    // Of an even number the upper one, as the authors' evaluator takes it.
    let [last, middle] = [luminance.len() - 1, luminance.len() / 2];
    let stops = |y: f32| (white / f64::from(y.max(f32::EPSILON))).log2();
    (stops(luminance[last]), stops(luminance[middle]))
}

fn tone(x: f32) -> f32 {
    let [a, b, c, d, e, f] = TONE.map(|t| t as f32);
    ((x * (a * x + b) + c) / (x * (d * x + e) + f)).clamp(0.0, 1.0)
}

/// Y, Cx, Cz of each pixel after `shown` made its channels 0..1.
fn opponent(rgba: &[[f32; 4]], shown: impl Fn(f32) -> f32) -> Planes {
    let mut planes: Planes = std::array::from_fn(|_| Vec::with_capacity(rgba.len()));
    for p in rgba {
        let [x, y, z] = relative_xyz([shown(p[0]), shown(p[1]), shown(p[2])]);
        planes[0].push(116.0 * y - 16.0);
        planes[1].push(500.0 * (x - y));
        planes[2].push(200.0 * (y - z));
    }
    planes
}

/// X, Y, Z relative to those of white.
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    TO_XYZ.map(|row| {
        let white: f64 = row.iter().sum();
        (0..3).map(|c| (row[c] / white) as f32 * rgb[c]).sum()
    })
}

/// The inverse of [`relative_xyz`], by Cramer's rule.
fn to_rgb() -> [[f32; 3]; 3] {
    let m = TO_XYZ.map(|row| row.map(|v| v / row.iter().sum::<f64>()));
    let cross = |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let columns = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let det: f64 = (0..3).map(|c| m[0][c] * columns[0][c]).sum();
    std::array::from_fn(|r| std::array::from_fn(|c| (columns[c][r] / det) as f32))
}

/// Hunt-adjusted L*a*b* of linear RGB.
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = relative_xyz(rgb).map(f);
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
}

/// City block in L*, Euclidean in a*b*.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
}

/// The difference of two pictures in opponent space.
fn ldr(size: (usize, usize), test: Planes, reference: Planes) -> Vec<f32> {
    let colors = [&test, &reference].map(|p| seen_color(size, p));
    let features = [&test[0], &reference[0]].map(|luma| features(size, luma));
    let [exponent, middle, top] = COLOR;
    let most = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(exponent);
    let knee = middle * most;
    (0..test[0].len())
        .map(|i| {
            let d = hyab(colors[0][i], colors[1][i]).powf(exponent);
            let color = if d < knee { top / knee * d } else { top + (d - knee) / (most - knee) * (1.0 - top) };
            let [t, r] = [features[0][i], features[1][i]];
            let feature = (t[0] - r[0]).abs().max((t[1] - r[1]).abs());
            color.powf(1.0 - (feature * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT))
        })
        .collect()
}

/// Hunt-adjusted L*a*b* of each pixel of a picture, blurred by the eye's contrast sensitivity.
fn seen_color(size: (usize, usize), planes: &Planes) -> Vec<[f32; 3]> {
    let widest = SENSITIVITY.iter().flatten().fold(0.0, |m: f64, g| m.max(g.1));
    let radius = (3.0 * (widest / (2.0 * std::f64::consts::PI.powi(2))).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
    let blurred: Planes = std::array::from_fn(|c| {
        // Both Gaussians of a channel: (weight, taps); the two weights share one normalisation over the whole square.
        let gaussians: Vec<(f64, Vec<f64>)> = SENSITIVITY[c]
            .iter()
            .filter(|(a, _)| *a > 0.0)
            .map(|&(a, b)| {
                let pi = std::f64::consts::PI;
                (a * (pi / b).sqrt(), taps(radius, |x| (-(pi * x / PIXELS_PER_DEGREE).powi(2) / b).exp()))
            })
            .collect();
        let whole: f64 = gaussians.iter().map(|(w, t)| w * t.iter().sum::<f64>().powi(2)).sum();
        let mut sum = vec![0f32; planes[c].len()];
        for (weight, taps) in gaussians {
            let along_x: Vec<f32> = taps.iter().map(|t| *t as f32).collect();
            let along_y: Vec<f32> = taps.iter().map(|t| (t * weight / whole) as f32).collect();
            for (s, v) in sum.iter_mut().zip(filter_y(size, &filter_x(size, &planes[c], &along_x), &along_y)) {
                *s += v;
            }
        }
        sum
    });
    let to_rgb = to_rgb();
    (0..blurred[0].len())
        .map(|i| {
            let y = (blurred[0][i] + 16.0) / 116.0;
            let xyz = [y + blurred[1][i] / 500.0, y, y - blurred[2][i] / 200.0];
            hunt_lab(to_rgb.map(|row| (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]).clamp(0.0, 1.0)))
        })
        .collect()
}

/// Strength of edges and of points at each pixel: first and second derivatives of a Gaussian.
fn features(size: (usize, usize), luma: &[f32]) -> Vec<[f32; 2]> {
    let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as usize;
    let gauss = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
    let single = |mut taps: Vec<f64>| {
        // Positive taps sum to 1, negative ones to −1.
        let sum = |sign: f64| taps.iter().map(|t| (sign * t).max(0.0)).sum::<f64>();
        let (up, down) = (sum(1.0), sum(-1.0));
        taps.iter_mut().for_each(|t| *t /= if *t > 0.0 { up } else { down.max(f64::MIN_POSITIVE) });
        taps.into_iter().map(|t| t as f32).collect::<Vec<f32>>()
    };
    let smooth = single(taps(radius, gauss));
    let edge = single(taps(radius, |x| -x * gauss(x)));
    let point = single(taps(radius, |x| (x * x / (sigma * sigma) - 1.0) * gauss(x)));
    let luma: Vec<f32> = luma.iter().map(|y| (y + 16.0) / 116.0).collect();
    let across = filter_x(size, &luma, &smooth);
    let of = |taps: &[f32]| (filter_y(size, &filter_x(size, &luma, taps), &smooth), filter_y(size, &across, taps));
    let ((edge_x, edge_y), (point_x, point_y)) = (of(&edge), of(&point));
    (0..luma.len()).map(|i| [edge_x[i].hypot(edge_y[i]), point_x[i].hypot(point_y[i])]).collect()
}

/// A filter's taps at −radius..=radius pixels.
fn taps(radius: usize, of: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..=2 * radius).map(|i| of(i as f64 - radius as f64)).collect()
}

/// Rows filtered, the edge's pixels repeated.
fn filter_x((width, height): (usize, usize), plane: &[f32], taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let mut out = vec![0f32; width * height];
    let mut padded = vec![0f32; width + 2 * radius];
    for (row, out) in plane.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
        padded[..radius].fill(row[0]);
        padded[radius..radius + width].copy_from_slice(row);
        padded[radius + width..].fill(row[width - 1]);
        for (k, tap) in taps.iter().enumerate() {
            out.iter_mut().zip(&padded[k..]).for_each(|(o, v)| *o += tap * v);
        }
    }
    out
}

/// Columns filtered, the edge's pixels repeated.
fn filter_y((width, height): (usize, usize), plane: &[f32], taps: &[f32]) -> Vec<f32> {
    let radius = taps.len() / 2;
    let mut out = vec![0f32; width * height];
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        for (k, tap) in taps.iter().enumerate() {
            let from = (y + k).saturating_sub(radius).min(height - 1) * width;
            out.iter_mut().zip(&plane[from..from + width]).for_each(|(o, v)| *o += tap * v);
        }
    }
    out
}

/// Mean, largest, and the weighted percentiles of a map.
fn pooled(map: Vec<f32>, exposures: Option<(f64, f64, usize)>) -> Flip {
    let mut sorted = map.clone();
    sorted.sort_by(f32::total_cmp);
    let sum: f64 = sorted.iter().map(|&v| f64::from(v)).sum();
    let at = |percent: u32| {
        let mut below = 0.0;
        let over = sorted.iter().find(|&&v| {
            below += f64::from(v);
            below > sum * f64::from(percent) / 100.0
        });
        over.map_or(0.0, |&v| f64::from(v))
    };
    Flip { mean: sum / map.len() as f64, max: sorted.last().map_or(0.0, |&v| f64::from(v)), weighted: PERCENTILES.map(at), exposures, map }
}

impl Flip {
    /// The map in colours for the eye ([`magma`]); `width` pixels a row.
    pub fn drawn(&self, width: usize, height: usize) -> Picture {
        let color = |&e: &f32| {
            let [r, g, b] = magma(e).map(|v| png::linear(f32::from(v) / 255.0));
            [r, g, b, 1.0]
        };
        Picture { width, height, rgba: self.map.iter().map(color).collect() }
    }
}

/// The colour of a difference 0..1 in matplotlib's map "magma" (van der Walt and Smith, CC0), sRGB 0..255: sixteen of its
/// colours, linear between; within 2.2 of the table of 256.
pub fn magma(difference: f32) -> [u8; 3] {
    const COLORS: [u32; 16] = [
        0x000004, 0x0b0924, 0x20114b, 0x3b0f70, 0x57157e, 0x721f81, 0x8c2981, 0xa8327d, 0xc43c75, 0xde4968, 0xf1605d, 0xfa7f5e, 0xfe9f6d,
        0xfebf84, 0xfddea0, 0xfcfdbf,
    ];
    let at = if difference.is_nan() { 0.0 } else { difference.clamp(0.0, 1.0) * 15.0 };
    let i = (at as usize).min(14);
    let part = at - i as f32;
    [16, 8, 0].map(|shift| {
        let of = |k: usize| (COLORS[k] >> shift & 255) as f32;
        (of(i) + (of(i + 1) - of(i)) * part).round() as u8
    })
}
