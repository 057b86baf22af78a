//! Real, orthonormal spherical harmonics: `index(l, m) = l(l+1)+m`, signs as in Sloan, "Stupid Spherical Harmonics (SH)
//! Tricks", 2008 (Y₁₋₁ = −½√(3/π)·y: the Condon–Shortley phase (−1)^m for both signs of m). Mirrored by `glsl/sh.glsl`.

use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// Bands of visibility and light: l = 0..=3.
pub const BANDS: usize = 4;
/// Their coefficients.
pub const COEFFICIENTS: usize = BANDS * BANDS;
/// Highest band that a product of two functions of [`BANDS`] bands reaches.
pub const PRODUCT_BAND: usize = 2 * (BANDS - 1);
/// Coefficients up to [`PRODUCT_BAND`].
pub const PRODUCT_COEFFICIENTS: usize = (PRODUCT_BAND + 1) * (PRODUCT_BAND + 1);

/// Linear index of Y_lm; |m| ≤ l.
pub const fn index(l: usize, m: i32) -> usize {
    ((l * (l + 1)) as i64 + m as i64) as usize
}

/// (l, m) of a linear index.
pub const fn band_and_order(index: usize) -> (usize, i32) {
    let l = index.isqrt();
    (l, index as i32 - (l * (l + 1)) as i32)
}

/// Y_lm(dir) for l ≤ 3, `dir` of unit length: the closed forms of Sloan 2008, appendix A2, as polynomials of x, y, z.
pub fn basis(dir: DVec3) -> [f64; COEFFICIENTS] {
    let DVec3 { x, y, z } = dir;
    let zz = z * z;
    [
        0.282_094_791_773_878_14,
        -0.488_602_511_902_919_9 * y,
        0.488_602_511_902_919_9 * z,
        -0.488_602_511_902_919_9 * x,
        1.092_548_430_592_079_2 * x * y,
        -1.092_548_430_592_079_2 * y * z,
        0.946_174_695_757_560_1 * zz - 0.315_391_565_252_520_05,
        -1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (x * x - y * y),
        -0.590_043_589_926_643_5 * y * (3.0 * x * x - y * y),
        2.890_611_442_640_554_3 * x * y * z,
        -0.457_045_799_464_465_8 * y * (5.0 * zz - 1.0),
        z * (1.865_881_662_950_577 * zz - 1.119_528_997_770_346_2),
        -0.457_045_799_464_465_8 * x * (5.0 * zz - 1.0),
        1.445_305_721_320_277_2 * z * (x * x - y * y),
        -0.590_043_589_926_643_5 * x * (x * x - 3.0 * y * y),
    ]
}

/// Y_lm(dir) for l ≤ `l_max` by the three-term recursion of the normalised Legendre functions; (sin θ)^m e^{imφ} is taken
/// as (x + iy)^m, so that nothing is lost at the poles. Writes (`l_max`+1)² values; those beyond the end of `out` are left
/// away.
pub fn basis_up_to(l_max: usize, dir: DVec3, out: &mut [f64]) {
    let mut put = |l: usize, m: i32, value: f64| {
        if let Some(slot) = out.get_mut(index(l, m)) {
            *slot = value;
        }
    };
    // P̄_mm without its (sin θ)^m, and (x + iy)^m.
    let mut diagonal = (0.25 / PI).sqrt();
    let (mut re, mut im) = (1.0, 0.0);
    for m in 0..=l_max {
        if m > 0 {
            diagonal *= -((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            (re, im) = (re * dir.x - im * dir.y, re * dir.y + im * dir.x);
        }
        let (mut before, mut now) = (0.0, diagonal);
        for l in m..=l_max {
            if l > m {
                let scale = |l: usize| ((4 * l * l - 1) as f64 / (l * l - m * m) as f64).sqrt();
                let previous = if l - 1 > m { before / scale(l - 1) } else { 0.0 };
                (before, now) = (now, scale(l) * (dir.z * now - previous));
            }
            if m == 0 {
                put(l, 0, now);
            } else {
                put(l, m as i32, 2f64.sqrt() * now * re);
                put(l, -(m as i32), 2f64.sqrt() * now * im);
            }
        }
    }
}

/// Legendre polynomial P_l(t).
pub fn legendre(l: usize, t: f64) -> f64 {
    let (mut before, mut now) = (0.0, 1.0);
    for k in 0..l {
        (before, now) = (now, ((2 * k + 1) as f64 * t * now - k as f64 * before) / (k + 1) as f64);
    }
    now
}

/// ∫ f(n·ω) Y_lm(ω) dω = √(4π/(2l+1))·z_l·Y_lm(n) for a function of the angle to n alone, whose zonal coefficient about
/// the z axis is z_l = ∫ f Y_l0 dω (Funk–Hecke).
pub fn zonal_scale(l: usize) -> f64 {
    (4.0 * PI / (2 * l + 1) as f64).sqrt()
}

/// Zonal coefficient of a cone: 1 where n·ω > `cos_half_angle`, else 0.
pub fn zonal_cone(l: usize, cos_half_angle: f64) -> f64 {
    let t = cos_half_angle.clamp(-1.0, 1.0);
    let below = if l == 0 { 1.0 } else { legendre(l - 1, t) };
    2.0 * PI * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt() * (below - if l == 0 { t } else { legendre(l + 1, t) }) / (2 * l + 1) as f64
}

/// Zonal coefficient of a half-space (the visibility above an opaque plane): 1 where n·ω > 0, else 0.
pub fn zonal_half_space(l: usize) -> f64 {
    zonal_cone(l, 0.0)
}

/// Zonal coefficient of the clamped cosine max(0, n·ω): Ramamoorthi & Hanrahan 2001, eq. 19 (there named A_l, without the
/// factor 2π that makes irradiance of it). Zero for odd l ≥ 3.
pub fn zonal_clamped_cosine(l: usize) -> f64 {
    let norm = 2.0 * PI * ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
    match l {
        1 => norm / 3.0,
        l if l % 2 == 1 => 0.0,
        l => {
            // l!/(2^l (l/2)!²) = Π (2k−1)/(2k), and the sign of (−1)^{l/2−1}/((l+2)(l−1)), which also holds for l = 0.
            let half = l / 2;
            let central: f64 = (1..=half).map(|k| (2 * k - 1) as f64 / (2 * k) as f64).product();
            let sign = if half % 2 == 1 { 1.0 } else { -1.0 };
            norm * sign * central / ((l as f64 + 2.0) * (l as f64 - 1.0))
        }
    }
}

/// Factors per band that damp the ringing of a truncated series (Sloan 2008, "Windowing"); the number is the window's
/// width in bands, larger damps less. The mean (l = 0) is never changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Window {
    /// No window: all factors 1.
    #[default]
    None,
    /// ½(1 + cos(πl/w)) for l < w, 0 beyond.
    Hanning(f64),
    /// sinc: sin(πl/w)/(πl/w) for l < w, 0 beyond.
    Lanczos(f64),
    /// exp(−½(πl/(2w))²): never negative, its kernel has no side lobes.
    Gauss(f64),
}

impl Window {
    /// The factor of band `l`, 0..=1. A width that is not above 0 leaves the mean only.
    pub fn factor(self, l: usize) -> f64 {
        let x = l as f64;
        match self {
            Window::None => 1.0,
            _ if l == 0 => 1.0,
            Window::Hanning(w) if x < w => 0.5 * (1.0 + (PI * x / w).cos()),
            Window::Lanczos(w) if x < w => (PI * x / w).sin() / (PI * x / w),
            Window::Gauss(w) if w > 0.0 => (-0.5 * (PI * x / (2.0 * w)).powi(2)).exp(),
            _ => 0.0,
        }
    }
}

/// Nodes and weights on [−1, 1] that integrate polynomials up to degree 2n − 1 exactly (Gauss–Legendre, by Newton's
/// method on P_n).
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|i| {
            let mut t = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..8 {
                let (p, below) = (legendre(n, t), legendre(n - 1, t));
                slope = n as f64 * (t * p - below) / (t * t - 1.0);
                t -= p / slope;
            }
            (t, 2.0 / ((1.0 - t * t) * slope * slope))
        })
        .collect()
}

/// Directions and weights (steradian, sum 4π) that integrate every polynomial on the sphere up to `degree` exactly, so
/// also a product of harmonics whose bands sum to it: Gauss–Legendre in z, evenly spaced in azimuth.
pub fn sphere_quadrature(degree: usize) -> Vec<(DVec3, f64)> {
    let turns = degree + 1;
    let mut nodes = Vec::with_capacity((degree / 2 + 1) * turns);
    for (z, w) in gauss_legendre(degree / 2 + 1) {
        let r = (1.0 - z * z).sqrt();
        for k in 0..turns {
            let (s, c) = (2.0 * PI * (k as f64 + 0.5) / turns as f64).sin_cos();
            nodes.push((DVec3::new(r * c, r * s, z), w * 2.0 * PI / turns as f64));
        }
    }
    nodes
}

/// A rotation of SH vectors, bands 0..=3: block diagonal, exact, made once and applied to any number of vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotation {
    rows: [[f64; COEFFICIENTS]; COEFFICIENTS],
}

impl Rotation {
    /// The rotation (or mirroring) that carries f to f∘R⁻¹. `rotation` must be orthonormal.
    pub fn new(rotation: DMat3) -> Self {
        // R_ij = ∫ Y_i(ω) Y_j(R⁻¹ω) dω, of degree 2·3: the quadrature is exact.
        let mut rows = [[0.0; COEFFICIENTS]; COEFFICIENTS];
        let inverse = rotation.transpose();
        for (dir, weight) in sphere_quadrature(PRODUCT_BAND) {
            let (to, from) = (basis(dir), basis(inverse * dir));
            for (i, row) in rows.iter_mut().enumerate() {
                let l = i.isqrt();
                for j in l * l..(l + 1) * (l + 1) {
                    row[j] += weight * to[i] * from[j];
                }
            }
        }
        Self { rows }
    }

    /// The coefficients of the turned function.
    pub fn apply(&self, coefficients: &[f64; COEFFICIENTS]) -> [f64; COEFFICIENTS] {
        std::array::from_fn(|i| self.rows[i].iter().zip(coefficients).map(|(r, c)| r * c).sum())
    }
}

/// Gaunt coefficient (SH triple product) ∫ Y_i Y_j Y_k dω of three linear indices, by exact quadrature.
pub fn gaunt(i: usize, j: usize, k: usize) -> f64 {
    let [a, b, c] = [i, j, k].map(|n| n.isqrt());
    // Selection rules: the bands form a triangle and their sum is even.
    if (a + b + c) % 2 == 1 || a > b + c || b > a + c || c > a + b {
        return 0.0;
    }
    let l_max = a.max(b).max(c);
    let mut y = vec![0.0; (l_max + 1) * (l_max + 1)];
    sphere_quadrature(a + b + c)
        .into_iter()
        .map(|(dir, weight)| {
            basis_up_to(l_max, dir, &mut y);
            weight * y[i] * y[j] * y[k]
        })
        .sum()
}

/// Rows of [`lambert_matrix`] that reach the irradiance: bands 0, 1, 2, 4 and 6, for the clamped cosine is zero in bands
/// 3 and 5.
pub fn lambert_rows() -> impl Iterator<Item = usize> {
    (0..PRODUCT_COEFFICIENTS).filter(|&k| zonal_clamped_cosine(k.isqrt()) != 0.0)
}

/// The product of a light with a visibility, as a linear map of the visibility: A_ki = Σ_j G_ijk L_j (k in 0..49, bands
/// 0..=6; RGB). With H_k(n) of [`lambert_lobe`], Σ_k H_k(n) Σ_i A_ki v_i = ∫ V L max(0, n·ω) dω, exactly, for V and L of
/// bands 0..=3.
pub fn lambert_matrix(light: &[[f64; 3]; COEFFICIENTS]) -> Vec<[[f64; 3]; COEFFICIENTS]> {
    let mut matrix = vec![[[0.0; 3]; COEFFICIENTS]; PRODUCT_COEFFICIENTS];
    let mut y = [0.0; PRODUCT_COEFFICIENTS];
    // ∫ Y_k Y_i L dω has degree 6 + 3 + 3.
    for (dir, weight) in sphere_quadrature(2 * PRODUCT_BAND) {
        basis_up_to(PRODUCT_BAND, dir, &mut y);
        let radiance: [f64; 3] = std::array::from_fn(|c| light.iter().zip(&y).map(|(l, y)| l[c] * y).sum());
        for (row, yk) in matrix.iter_mut().zip(&y) {
            for (entry, yi) in row.iter_mut().zip(&y) {
                for (e, l) in entry.iter_mut().zip(radiance) {
                    *e += weight * yk * yi * l;
                }
            }
        }
    }
    matrix
}

/// H_k(n) = √(4π/(2l+1))·h_l·Y_k(n), k in 0..49: the clamped cosine about the normal n (unit length).
pub fn lambert_lobe(normal: DVec3) -> [f64; PRODUCT_COEFFICIENTS] {
    let mut lobe = [0.0; PRODUCT_COEFFICIENTS];
    basis_up_to(PRODUCT_BAND, normal, &mut lobe);
    for (k, h) in lobe.iter_mut().enumerate() {
        let l = k.isqrt();
        *h *= zonal_scale(l) * zonal_clamped_cosine(l);
    }
    lobe
}
