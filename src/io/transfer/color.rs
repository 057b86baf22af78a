//! Colour spaces in which ParaView (VTK's vtkColorTransferFunction) interpolates. All colours here are display sRGB.

use std::f64::consts::PI;

pub(super) type Rgb = [f64; 3];

/// How colours are interpolated between two points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Rgb,
    /// With `wrap`, hue takes the shorter way round.
    Hsv {
        wrap: bool,
    },
    Lab,
    /// Moreland's diverging maps ("Diverging Color Maps for Scientific Visualization", 2009), through Msh.
    Diverging,
    /// The later colour holds for the whole interval.
    Step,
}

/// The colour at `s` in 0..1 between `a` and `b`.
pub(super) fn mix(space: Space, s: f64, a: Rgb, b: Rgb) -> Rgb {
    let lerp = |a: Rgb, b: Rgb| std::array::from_fn(|i| (1.0 - s) * a[i] + s * b[i]);
    let out = match space {
        Space::Rgb => lerp(a, b),
        Space::Step => b,
        Space::Lab => lab_to_rgb(lerp(rgb_to_lab(a), rgb_to_lab(b))),
        Space::Diverging => diverging(s, a, b),
        Space::Hsv { wrap } => {
            let (mut a, mut b) = (rgb_to_hsv(a), rgb_to_hsv(b));
            if wrap && (a[0] - b[0]).abs() > 0.5 {
                if a[0] > b[0] { a[0] -= 1.0 } else { b[0] -= 1.0 }
            }
            let [h, s, v] = lerp(a, b);
            hsv_to_rgb([h.rem_euclid(1.0), s, v])
        }
    };
    out.map(|c| c.clamp(0.0, 1.0))
}

/// Scene-linear value of a display sRGB component (IEC 61966-2-1).
pub(super) fn linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

fn encoded(c: f64) -> f64 {
    if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// Hue, saturation and value, all 0..1.
fn rgb_to_hsv([r, g, b]: Rgb) -> [f64; 3] {
    let (max, min) = (r.max(g).max(b), r.min(g).min(b));
    let range = max - min;
    if range <= 0.0 {
        return [0.0, 0.0, max];
    }
    let sixth = if max == r {
        (g - b) / range
    } else if max == g {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    [(sixth / 6.0).rem_euclid(1.0), range / max, max]
}

fn hsv_to_rgb([h, s, v]: [f64; 3]) -> Rgb {
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + 6.0 * h) % 6.0;
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// White point as VTK has it: D65, 2 degrees.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];

/// CIE L*a*b* of a display sRGB colour.
fn rgb_to_lab(rgb: Rgb) -> [f64; 3] {
    let [r, g, b] = rgb.map(linear);
    let xyz = [0.4124 * r + 0.3576 * g + 0.1805 * b, 0.2126 * r + 0.7152 * g + 0.0722 * b, 0.0193 * r + 0.1192 * g + 0.9505 * b];
    let f: [f64; 3] = std::array::from_fn(|i| {
        let t = xyz[i] / WHITE[i];
        if t > 0.008856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
    });
    [116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])]
}

/// The way back; colours outside the display's gamut are scaled to their largest component, and clipped at 0, as VTK does.
fn lab_to_rgb([l, a, b]: [f64; 3]) -> Rgb {
    let y = (l + 16.0) / 116.0;
    let f = [a / 500.0 + y, y, y - b / 200.0];
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| {
        let cube = f[i].powi(3);
        WHITE[i] * if cube > 0.008856 { cube } else { (f[i] - 16.0 / 116.0) / 7.787 }
    });
    let rgb =
        [3.2406 * x - 1.5372 * y - 0.4986 * z, -0.9689 * x + 1.8758 * y + 0.0415 * z, 0.0557 * x - 0.2040 * y + 1.0570 * z].map(encoded);
    let top = rgb.iter().copied().fold(1.0, f64::max);
    rgb.map(|c| (c / top).max(0.0))
}

/// Msh, the polar form of L*a*b*: magnitude, saturation angle, hue angle.
fn lab_to_msh([l, a, b]: [f64; 3]) -> [f64; 3] {
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { (l / m).clamp(-1.0, 1.0).acos() } else { 0.0 };
    [m, s, if s > 0.001 { b.atan2(a) } else { 0.0 }]
}

/// Moreland's interpolation: between two saturated, different hues the way leads over white.
fn diverging(mut t: f64, a: Rgb, b: Rgb) -> Rgb {
    /// Angle below which a colour counts as grey.
    const GREY: f64 = 0.05;
    let (mut p, mut q) = (lab_to_msh(rgb_to_lab(a)), lab_to_msh(rgb_to_lab(b)));
    let turn = (p[2] - q[2]).abs() % (2.0 * PI);
    if p[1] > GREY && q[1] > GREY && turn.min(2.0 * PI - turn) > 0.33 * PI {
        let white = [p[0].max(q[0]).max(88.0), 0.0, 0.0];
        if t < 0.5 {
            q = white;
            t *= 2.0;
        } else {
            p = white;
            t = 2.0 * t - 1.0;
        }
    }
    if p[1] < GREY && q[1] > GREY {
        p[2] = hue_beside(q, p[0]);
    } else if q[1] < GREY && p[1] > GREY {
        q[2] = hue_beside(p, q[0]);
    } else if (p[2] - q[2]).abs() > PI {
        // The shorter way round. VTK 9.7.2 takes it from the larger hue to the smaller; else it turns from the first away
        // from the second, and jumps at the second point.
        if p[2] < q[2] { p[2] += 2.0 * PI } else { q[2] += 2.0 * PI }
    }
    let [m, s, h]: [f64; 3] = std::array::from_fn(|i| (1.0 - t) * p[i] + t * q[i]);
    lab_to_rgb([m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()])
}

/// The hue that a grey of magnitude `grey` takes beside a saturated colour, for an even perceived change.
fn hue_beside([m, s, h]: [f64; 3], grey: f64) -> f64 {
    if m >= grey - 0.1 {
        return h;
    }
    let spin = s * (grey * grey - m * m).sqrt() / (m * s.sin());
    if h > -0.3 * PI { h + spin } else { h - spin }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: Rgb, b: Rgb, tolerance: f64) -> bool {
        (0..3).all(|i| (a[i] - b[i]).abs() < tolerance)
    }

    #[test]
    fn every_space_begins_and_ends_at_its_colours() {
        let (a, b) = ([0.23, 0.3, 0.75], [0.7, 0.016, 0.15]);
        for space in [Space::Rgb, Space::Hsv { wrap: false }, Space::Hsv { wrap: true }, Space::Lab, Space::Diverging] {
            // The printed matrices of sRGB are inverse to 4 digits.
            assert!(near(mix(space, 0.0, a, b), a, 2e-3), "{space:?}: {:?}", mix(space, 0.0, a, b));
            assert!(near(mix(space, 1.0, a, b), b, 2e-3), "{space:?}: {:?}", mix(space, 1.0, a, b));
        }
    }

    #[test]
    fn known_colours() {
        // L* of sRGB mid grey 119/255 is 50; red is (53.24, 80.09, 67.20) in CIE L*a*b* (D65).
        assert!((rgb_to_lab([119.0 / 255.0; 3])[0] - 50.0).abs() < 0.1);
        assert!(near(rgb_to_lab([1.0, 0.0, 0.0]), [53.24, 80.09, 67.20], 0.05));
        assert!(near(rgb_to_hsv([0.0, 0.0, 1.0]), [2.0 / 3.0, 1.0, 1.0], 1e-12));
        assert!(near(hsv_to_rgb([1.0 / 3.0, 1.0, 0.5]), [0.0, 0.5, 0.0], 1e-12));
        // Moreland's cool to warm: the ends meet at a light grey of L* 88, sRGB (0.865, 0.865, 0.865).
        let mid = mix(Space::Diverging, 0.5, [0.230, 0.299, 0.754], [0.706, 0.016, 0.150]);
        assert!(near(mid, [0.865; 3], 0.01), "{mid:?}");
        // Between near hues on both sides of the half turn: not over all others. The colour is VTK 9.7.2's from b to a.
        let (a, b) = ([0.084, 0.833, 0.787], [0.239, 0.876, 0.059]);
        for mid in [mix(Space::Diverging, 0.5, b, a), mix(Space::Diverging, 0.5, a, b)] {
            assert!(near(mid, [0.0, 0.9184, 0.6168], 1e-3), "{mid:?}");
        }
        // Blue to red in HSV: over green without wrapping, over magenta with it.
        let (blue, red) = ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
        assert!(near(mix(Space::Hsv { wrap: false }, 0.5, blue, red), [0.0, 1.0, 0.0], 1e-9));
        assert!(near(mix(Space::Hsv { wrap: true }, 0.5, blue, [1.0, 0.0, 0.001]), [1.0, 0.0, 1.0], 2e-3));
        assert!((linear(0.5) - 0.214_041).abs() < 1e-6 && (encoded(linear(0.7)) - 0.7).abs() < 1e-6);
    }
}
