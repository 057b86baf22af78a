//! Curves between a preset's points, as straight pieces.

use super::OpacityPoint;
use super::color::{Rgb, Space, linear, mix};

/// Pieces that one interval is cut into, fewer where there are many intervals. A straight line in each stays within a
/// 1000th of the curve in the mean; where the curve is all but a step or leaves what a display shows, it is off by more (the
/// tests say by how much).
fn pieces(intervals: usize) -> usize {
    (4096 / intervals.max(1)).clamp(1, 64)
}

/// Scene-linear colour points along the curve through display colours.
pub(super) fn scene_linear(space: Space, points: &[(f64, Rgb)]) -> Vec<(f64, [f32; 3])> {
    resample(space, points).into_iter().map(|(x, c)| (x, c.map(|v| linear(v) as f32))).collect()
}

/// Display colours between which a straight line in display colours follows the space's curve.
pub(super) fn display(space: Space, points: &[(f64, Rgb)]) -> Vec<(f64, Rgb)> {
    if space == Space::Rgb { points.to_vec() } else { resample(space, points) }
}

fn resample(space: Space, points: &[(f64, Rgb)]) -> Vec<(f64, Rgb)> {
    let Some(first) = points.first() else { return Vec::new() };
    let pieces = pieces(points.len() - 1);
    let mut out = vec![*first];
    for pair in points.windows(2) {
        let ((x0, a), (x1, b)) = (pair[0], pair[1]);
        if space == Space::Step {
            // The later colour holds from just behind the earlier point.
            out.push((x0.next_up().min(x1), b));
        } else if x1 > x0 && a != b {
            let inner = (1..pieces).map(|i| i as f64 / pieces as f64);
            out.extend(inner.map(|s| (x0 + (x1 - x0) * s, mix(space, s, a, b))));
        }
        out.push((x1, b));
    }
    out
}

/// Opacity points along VTK's curve (vtkPiecewiseFunction): the midpoint is where the mean of both ends is reached,
/// the sharpness turns the line into a step.
pub(super) fn opacities(points: &[OpacityPoint]) -> Vec<(f64, f64)> {
    let pieces = pieces(points.len() - 1);
    let mut out = vec![(points[0][0], points[0][1])];
    for pair in points.windows(2) {
        let ([x0, a, midpoint, sharpness], [x1, b, ..]) = (pair[0], pair[1]);
        let midpoint = midpoint.clamp(1e-5, 1.0 - 1e-5);
        let at = |s: f64| x0 + (x1 - x0) * s;
        if x1 > x0 && a != b {
            if sharpness > 0.99 {
                out.extend([(at(midpoint), a), (at(midpoint), b)]);
            } else if sharpness < 0.01 {
                // Two straight lines; one for the usual midpoint.
                if midpoint != 0.5 {
                    out.push((at(midpoint), 0.5 * (a + b)));
                }
            } else {
                let inner = (1..pieces).map(|i| i as f64 / pieces as f64).chain([midpoint]);
                let mut curve: Vec<_> = inner.map(|s| (at(s), shaped(s, midpoint, sharpness, a, b))).collect();
                curve.sort_by(|p, q| p.0.total_cmp(&q.0));
                out.append(&mut curve);
            }
        }
        out.push((x1, b));
    }
    out
}

/// VTK's curve at `s` in 0..1 for a sharpness of 0.01 to 0.99: a Hermite curve of compressed argument.
fn shaped(s: f64, midpoint: f64, sharpness: f64, a: f64, b: f64) -> f64 {
    let s = if s < midpoint { 0.5 * s / midpoint } else { 0.5 + 0.5 * (s - midpoint) / (1.0 - midpoint) };
    let power = 1.0 + 10.0 * sharpness;
    let s = if s < 0.5 { 0.5 * (2.0 * s).powf(power) } else { 1.0 - 0.5 * (2.0 * (1.0 - s)).powf(power) };
    let (s2, s3) = (s * s, s * s * s);
    let tangent = (1.0 - sharpness) * (b - a);
    let y = (2.0 * s3 - 3.0 * s2 + 1.0) * a + (3.0 * s2 - 2.0 * s3) * b + (2.0 * s3 - 3.0 * s2 + s) * tangent;
    y.clamp(a.min(b), a.max(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest and mean distance between lines through `points` and a curve over 0..1.
    fn off(points: &[(f64, f64)], curve: impl Fn(f64) -> f64) -> (f64, f64) {
        let line = |x: f64| {
            let i = points.partition_point(|p| p.0 <= x).clamp(1, points.len() - 1);
            let ((x0, a), (x1, b)) = (points[i - 1], points[i]);
            if x1 > x0 { a + (b - a) * (x - x0) / (x1 - x0) } else { b }
        };
        const STEPS: usize = 20_000;
        let distances = (0..=STEPS).map(|i| i as f64 / STEPS as f64).map(|x| (line(x) - curve(x)).abs());
        distances.fold((0.0, 0.0), |(most, mean): (f64, f64), d| (most.max(d), mean + d / (STEPS + 1) as f64))
    }

    #[test]
    fn lines_stay_beside_their_curves() {
        let mut most = 0f64;
        for sharpness in [0.05, 0.3, 0.5, 0.7, 0.9, 0.98] {
            for midpoint in [0.2, 0.5, 0.8] {
                let points = opacities(&[[0.0, 0.0, midpoint, sharpness], [1.0, 0.9, 0.5, 0.0]]);
                let (worst, mean) = off(&points, |s| shaped(s, midpoint, sharpness, 0.0, 0.9));
                assert!(worst < OPACITY && mean < 1e-3, "{sharpness} {midpoint}: {worst} {mean}");
                most = most.max(worst);
            }
        }
        assert!(most > 0.9 * OPACITY, "{most}: the bound is a tight one");
        let colors: [Rgb; 4] = [[0.23, 0.3, 0.75], [0.1, 0.9, 0.1], [0.9, 0.1, 0.6], [0.084, 0.833, 0.787]];
        let mut most = 0f64;
        for space in [Space::Hsv { wrap: true }, Space::Lab, Space::Diverging] {
            for (a, b) in colors.iter().flat_map(|a| colors.iter().map(move |b| (*a, *b))).filter(|(a, b)| a != b) {
                let points = display(space, &[(0.0, a), (1.0, b)]);
                for c in 0..3 {
                    let (worst, mean) = off(&points.iter().map(|(x, v)| (*x, v[c])).collect::<Vec<_>>(), |s| mix(space, s, a, b)[c]);
                    assert!(worst < COLOR && mean < 1e-3, "{space:?} {a:?} {b:?} {c}: {worst} {mean}");
                    most = most.max(worst);
                }
            }
        }
        assert!(most > 0.9 * COLOR, "{most}: the bound is a tight one");
    }

    /// Largest distances, measured: of opacities, and of colours.
    const OPACITY: f64 = 0.036;
    const COLOR: f64 = 0.028;
}
