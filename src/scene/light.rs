//! Distant light: a lat-long probe, and its projection to spherical harmonics.

use super::sh::{self, COEFFICIENTS, Rotation, Window};
use crate::error::{Error, Result};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::PI;

/// Largest width of a probe, pixels.
pub const MAX_PROBE_WIDTH: usize = 16_384;

/// A lat-long environment map of linear RGB radiance. The top row looks to world +z; azimuth u = atan2(x, y)/2π in 0..1,
/// so that the left edge looks to +y and a quarter further to +x (Mitsuba's `envmap` turned by +90° about x, its +y up to
/// our +z). Its invariants (2:1, finite, not negative) hold from construction on.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Probe {
    /// A probe of `width`·`height` pixels, top row first.
    ///
    /// # Errors
    /// [`Error::Invalid`] when the shape is not 2:1, the number of pixels is not that of the shape, or a pixel is
    /// negative, NaN or infinite.
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Result<Self> {
        let bad = |what, right: &str| Err(Error::Invalid { item: "light probe", what, right: right.into() });
        if let Some(right) = bad_shape(width, height) {
            return bad(format!("{width}x{height} pixels"), &right);
        }
        if pixels.len() != width * height {
            return bad(format!("{} pixels for {width}x{height}", pixels.len()), "there must be one per place");
        }
        if let Some((what, right)) = bad_pixels(width, &pixels) {
            return bad(what, right);
        }
        Ok(Self { width, height, pixels })
    }

    /// A probe whose pixels are a formula of the direction of their centre.
    ///
    /// # Errors
    /// As [`Probe::new`].
    pub fn from_fn(width: usize, height: usize, radiance: impl Fn(DVec3) -> [f32; 3]) -> Result<Self> {
        if let Some(right) = bad_shape(width, height) {
            return Err(Error::Invalid { item: "light probe", what: format!("{width}x{height} pixels"), right });
        }
        Self::new(width, height, sampled(width, height, radiance))
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Linear RGB radiance, row by row from the top (+z).
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Radiance seen along `dir` (any length but 0): bilinear between pixel centres, which lie at (i+½)/width and
    /// (j+½)/height; wraps around in azimuth, clamps at the poles. To look a rotated light up, turn `dir` back.
    ///
    /// Mitsuba 3's `envmap` puts its first and last row onto the poles instead (row j at j/(height−1)): the same on the
    /// horizon, half a row off toward the poles, and 2 % darker or brighter where a pole's sky is (256x128).
    pub fn radiance(&self, dir: DVec3) -> [f32; 3] {
        let dir = dir.normalize_or(DVec3::Z);
        let u = (dir.x.atan2(dir.y) / (2.0 * PI)).rem_euclid(1.0) * self.width as f64 - 0.5;
        let v = dir.z.clamp(-1.0, 1.0).acos() / PI * self.height as f64 - 0.5;
        let (column, row) = (u.floor(), v.floor());
        let (s, t) = ((u - column) as f32, (v - row) as f32);
        let at = |i: f64, j: f64| {
            let i = i.rem_euclid(self.width as f64) as usize % self.width;
            let j = (j.max(0.0) as usize).min(self.height - 1);
            self.pixels[j * self.width + i]
        };
        let (a, b) = (at(column, row), at(column + 1.0, row));
        let (c, d) = (at(column, row + 1.0), at(column + 1.0, row + 1.0));
        std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + (b[k] - a[k]) * s, c[k] + (d[k] - c[k]) * s);
            upper + (lower - upper) * t
        })
    }

    /// Mean radiance over the sphere, each pixel weighted with its solid angle.
    pub fn mean(&self) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (j, row) in self.pixels.chunks_exact(self.width).enumerate() {
            let band = (PI * j as f64 / self.height as f64).cos() - (PI * (j + 1) as f64 / self.height as f64).cos();
            for pixel in row {
                for (s, p) in sum.iter_mut().zip(pixel) {
                    *s += f64::from(*p) * band / (2.0 * self.width as f64);
                }
            }
        }
        sum
    }

    /// A made-up studio, 256x128: a warm lamp toward +x+y, a cool one toward −x−y, a dim sky above. Coloured shadows show
    /// which light each place sees.
    pub fn two_colored() -> Self {
        // Soft discs: no ringing to speak of, and a penumbra as of a large softbox.
        let lamp = |dir: DVec3, at: DVec3, degrees: f64| {
            let x = (dir.dot(at.normalize()).clamp(-1.0, 1.0).acos().to_degrees() - degrees) / (0.4 * degrees);
            let t = (0.5 - x).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        };
        let radiance = |dir: DVec3| {
            let warm = lamp(dir, DVec3::new(0.80, 0.45, 0.45), 26.0);
            let cool = lamp(dir, DVec3::new(-0.75, -0.60, 0.25), 30.0);
            let sky = 0.5 + 0.5 * dir.z;
            let mix = |w: f64, c: f64, zenith: f64, nadir: f64| (w * warm + c * cool + nadir + (zenith - nadir) * sky) as f32;
            [mix(16.0, 1.1, 0.16, 0.035), mix(4.6, 3.6, 0.18, 0.030), mix(1.3, 13.0, 0.24, 0.028)]
        };
        Self { width: 256, height: 128, pixels: sampled(256, 128, radiance) }
    }
}

/// What is right, where a probe's shape is not.
pub(crate) fn bad_shape(width: usize, height: usize) -> Option<String> {
    let good = height.checked_mul(2) == Some(width) && (2..=MAX_PROBE_WIDTH).contains(&width);
    (!good).then(|| format!("a lat-long probe is 2:1, at most {MAX_PROBE_WIDTH} pixels wide"))
}

/// What is wrong and what right, where pixels are negative or not finite.
pub(crate) fn bad_pixels(width: usize, pixels: &[[f32; 3]]) -> Option<(String, &'static str)> {
    let bad = |p: &[f32; 3]| !p.iter().all(|x| x.is_finite() && *x >= 0.0);
    let first = pixels.iter().position(bad)?;
    let count = pixels.iter().filter(|p| bad(p)).count();
    let what = format!("pixel ({}, {}) is {:?}, and {} more like it", first % width, first / width, pixels[first], count - 1);
    Some((what, "radiance must be finite and not negative"))
}

/// A formula at the direction of every pixel's centre.
fn sampled(width: usize, height: usize, radiance: impl Fn(DVec3) -> [f32; 3]) -> Vec<[f32; 3]> {
    let at = |i: usize| {
        let (u, v) = (((i % width) as f64 + 0.5) / width as f64, ((i / width) as f64 + 0.5) / height as f64);
        let ((s, c), (r, z)) = ((2.0 * PI * u).sin_cos(), (PI * v).sin_cos());
        radiance(DVec3::new(r * s, r * c, z))
    };
    (0..width * height).map(at).collect()
}

/// Distant light as SH coefficients: L_lm = ∫ L(ω) Y_lm dω for each of R, G, B; radiance is linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// [coefficient by [`sh::index`]][R, G, B].
    pub coefficients: [[f64; 3]; COEFFICIENTS],
}

impl Light {
    /// No light.
    pub const DARK: Self = Self { coefficients: [[0.0; 3]; COEFFICIENTS] };

    /// The same radiance from everywhere.
    pub fn constant(radiance: [f64; 3]) -> Self {
        let mut light = Self::DARK;
        light.coefficients[0] = radiance.map(|r| r * (4.0 * PI).sqrt());
        light
    }

    /// Light from one direction (`toward` points to it), given by the irradiance on a surface that faces it.
    pub fn directional(toward: DVec3, irradiance: [f64; 3]) -> Self {
        Self { coefficients: sh::basis(toward.normalize_or(DVec3::Z)).map(|y| irradiance.map(|e| e * y)) }
    }

    /// A disc of even radiance about the direction `toward`, analytically: the projection of a round area light.
    pub fn cone(toward: DVec3, half_angle_degrees: f64, radiance: [f64; 3]) -> Self {
        let y = sh::basis(toward.normalize_or(DVec3::Z));
        let cos_half_angle = half_angle_degrees.clamp(0.0, 180.0).to_radians().cos();
        Self {
            coefficients: std::array::from_fn(|i| {
                let l = i.isqrt();
                radiance.map(|r| r * sh::zonal_scale(l) * sh::zonal_cone(l, cos_half_angle) * y[i])
            }),
        }
    }

    /// The projection of a probe whose pixels are patches of even radiance: each basis function is integrated over each
    /// pixel (in azimuth in closed form, in height by Gauss–Legendre), in f64 throughout, so that a small, very bright lamp
    /// keeps its energy.
    pub fn from_probe(probe: &Probe) -> Self {
        let mut light = Self::DARK;
        let (w, h) = (probe.width as f64, probe.height as f64);
        // ∫ cos(mα) dα and ∫ sin(mα) dα over each column, α = 2πu measured from +y toward +x.
        let columns: Vec<[[f64; 2]; sh::BANDS]> = (0..probe.width)
            .map(|i| {
                let (a, b) = (2.0 * PI * i as f64 / w, 2.0 * PI * (i + 1) as f64 / w);
                std::array::from_fn(|m| match m {
                    0 => [b - a, 0.0],
                    _ => {
                        let m = m as f64;
                        [((m * b).sin() - (m * a).sin()) / m, ((m * a).cos() - (m * b).cos()) / m]
                    }
                })
            })
            .collect();
        let nodes = sh::gauss_legendre(8);
        for (j, row) in probe.pixels.chunks_exact(probe.width).enumerate() {
            let mut fourier = [[[0.0; 3]; 2]; sh::BANDS];
            for (pixel, column) in row.iter().zip(&columns) {
                for (sum, factor) in fourier.iter_mut().zip(column) {
                    for part in 0..2 {
                        for c in 0..3 {
                            sum[part][c] += f64::from(pixel[c]) * factor[part];
                        }
                    }
                }
            }
            // The other factor of Y_lm, integrated over the row's polar angles.
            let (top, bottom) = (PI * j as f64 / h, PI * (j + 1) as f64 / h);
            for &(t, weight) in &nodes {
                let theta = 0.5 * (top + bottom) + 0.5 * (bottom - top) * t;
                let weight = 0.5 * (bottom - top) * weight * theta.sin();
                for (i, coefficient) in light.coefficients.iter_mut().enumerate() {
                    let (l, m) = sh::band_and_order(i);
                    let order = m.unsigned_abs() as usize;
                    // In our azimuth φ = 90° − α from +x: cos mφ and sin mφ out of cos mα and sin mα.
                    let (s, c) = (order as f64 * PI / 2.0).sin_cos();
                    let [cosine, sine] = fourier[order];
                    let meridian = weight * meridian(l, order, theta);
                    for k in 0..3 {
                        let azimuth = if m < 0 { s * cosine[k] - c * sine[k] } else { c * cosine[k] + s * sine[k] };
                        coefficient[k] += meridian * azimuth;
                    }
                }
            }
        }
        light
    }

    /// The light turned by `degrees` about `axis` (right-handed), by rotating the coefficients: nothing is projected
    /// anew. An axis of length 0 turns nothing.
    pub fn rotated(&self, axis: DVec3, degrees: f64) -> Self {
        match axis.try_normalize() {
            Some(axis) => self.transformed(DMat3::from_quat(DQuat::from_axis_angle(axis, degrees.to_radians()))),
            None => *self,
        }
    }

    /// The light carried by an orthonormal matrix.
    pub fn transformed(&self, rotation: DMat3) -> Self {
        let rotation = Rotation::new(rotation);
        let [r, g, b] = std::array::from_fn(|c| rotation.apply(&self.coefficients.map(|rgb| rgb[c])));
        Self { coefficients: std::array::from_fn(|i| [r[i], g[i], b[i]]) }
    }

    /// The light `factor` times as bright.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { coefficients: self.coefficients.map(|rgb| rgb.map(|x| x * factor)) }
    }

    /// Both lights together.
    pub fn plus(&self, other: &Self) -> Self {
        Self { coefficients: std::array::from_fn(|i| std::array::from_fn(|c| self.coefficients[i][c] + other.coefficients[i][c])) }
    }

    /// The first `n` bands; the others become 0.
    pub fn bands(&self, n: usize) -> Self {
        self.per_band(|l| if l < n { 1.0 } else { 0.0 })
    }

    /// The light with a window against ringing.
    pub fn windowed(&self, window: Window) -> Self {
        self.per_band(|l| window.factor(l))
    }

    /// Radiance toward `dir` (unit length) that the series gives; it rings, so it may be negative.
    pub fn radiance(&self, dir: DVec3) -> [f64; 3] {
        let y = sh::basis(dir);
        std::array::from_fn(|c| self.coefficients.iter().zip(y).map(|(rgb, y)| rgb[c] * y).sum())
    }

    /// Σ_m L_lm² of each band and channel: invariant under rotation; together at most ∫ L² dω.
    pub fn energy(&self) -> [[f64; 3]; sh::BANDS] {
        let mut energy = [[0.0; 3]; sh::BANDS];
        for (i, rgb) in self.coefficients.iter().enumerate() {
            for (e, x) in energy[i.isqrt()].iter_mut().zip(rgb) {
                *e += x * x;
            }
        }
        energy
    }

    /// The coefficients in single precision, as the kernels take them.
    pub fn to_f32(&self) -> [[f32; 3]; COEFFICIENTS] {
        self.coefficients.map(|rgb| rgb.map(|x| x as f32))
    }

    fn per_band(&self, factor: impl Fn(usize) -> f64) -> Self {
        Self { coefficients: std::array::from_fn(|i| self.coefficients[i].map(|x| x * factor(i.isqrt()))) }
    }
}

/// Y_lm at polar angle `theta` where its azimuth part cos mφ (m ≥ 0) or sin |m|φ (m < 0) is 1; `order` is |m|.
fn meridian(l: usize, order: usize, theta: f64) -> f64 {
    let (s, c) = theta.sin_cos();
    sh::basis(DVec3::new(s, 0.0, c))[sh::index(l, order as i32)]
}
