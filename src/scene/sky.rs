//! The exact light, for the reference renderer: a probe as patches of even radiance, tabulated for drawing directions by
//! their brightness.

use super::light::Probe;
use super::scene::{LightSettings, LightSource};
use crate::error::Result;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Distant light without any truncation. A probe's pixels are patches of even radiance (as
/// [`Light::from_probe`](super::Light::from_probe) integrates them). Turning and scaling share the tables.
#[derive(Clone, Debug)]
pub struct Sky {
    tables: Arc<Tables>,
    rotation: DMat3,
    scale: f64,
}

/// What directions are drawn with: first a row, then a pixel of it, in proportion to its mean of R, G and B times its
/// solid angle, then a place even in solid angle. Probabilities are differences of single-precision sums, and weights are
/// made of those differences, so that rounding brings no bias; pixels of less than some 10⁻⁷ of all light may be missed.
#[derive(Debug)]
pub struct Tables {
    /// The probe.
    pub probe: Probe,
    /// Cumulative probability of the rows, then of each row's pixels.
    pub cumulative: Vec<f32>,
    /// RGB radiance/(4π·density [1/sr]) of each pixel, and 0.
    pub weights: Vec<[f32; 4]>,
}

impl Sky {
    /// The same radiance from everywhere.
    ///
    /// # Errors
    /// As [`Probe::new`].
    pub fn constant(radiance: [f32; 3]) -> Result<Self> {
        Ok(Self::from_probe(&Probe::new(2, 1, vec![radiance; 2])?))
    }

    /// The light of a probe.
    pub fn from_probe(probe: &Probe) -> Self {
        Self { tables: Arc::new(Tables::new(probe.clone())), rotation: DMat3::IDENTITY, scale: 1.0 }
    }

    /// The light of a scene: its probe or constant, turned and scaled; bands and window are of no matter.
    ///
    /// # Errors
    /// As [`Probe::new`].
    pub fn from_settings(settings: &LightSettings, probe: Option<&Probe>) -> Result<Self> {
        let sky = match (probe, &settings.source) {
            (Some(probe), _) => Self::from_probe(probe),
            (None, LightSource::Constant(rgb)) => Self::constant(*rgb)?,
            (None, LightSource::Probe(_)) => Self::constant([0.0; 3])?,
        };
        let sky = sky.scaled(settings.scale);
        Ok(settings.rotate.map_or(sky.clone(), |(axis, degrees)| sky.rotated(axis, degrees)))
    }

    /// The light turned by `degrees` about `axis` (right-handed, world); an axis of length 0 turns nothing.
    pub fn rotated(&self, axis: DVec3, degrees: f64) -> Self {
        let turn = axis.try_normalize().map_or(DMat3::IDENTITY, |a| DMat3::from_quat(DQuat::from_axis_angle(a, degrees.to_radians())));
        Self { rotation: turn * self.rotation, ..self.clone() }
    }

    /// The light `factor` times as bright.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { scale: self.scale * factor, ..self.clone() }
    }

    /// Radiance from a world direction: that of the pixel in which it lies.
    pub fn radiance(&self, dir: DVec3) -> [f32; 3] {
        let d = self.rotation.transpose() * dir.normalize_or(DVec3::Z);
        let probe = &self.tables.probe;
        let (w, h) = (probe.width(), probe.height());
        let column = (d.x.atan2(d.y) / (2.0 * PI)).rem_euclid(1.0) * w as f64;
        let row = d.z.clamp(-1.0, 1.0).acos() / PI * h as f64;
        let pixel = probe.pixels()[(row as usize).min(h - 1) * w + (column as usize).min(w - 1)];
        pixel.map(|v| v * self.scale as f32)
    }

    /// The tables of the unturned, unscaled light.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// A direction of the unturned light → world.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// Factor on the tables' radiance.
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

impl Tables {
    fn new(probe: Probe) -> Self {
        let (w, h) = (probe.width(), probe.height());
        let edge = |j: usize| (PI * j as f64 / h as f64).cos();
        let solid = |j: usize| (edge(j) - edge(j + 1)) * 2.0 * PI / w as f64;
        let bright = |p: &[f32; 3]| p.iter().map(|&v| f64::from(v)).sum::<f64>();
        let rows: Vec<&[[f32; 3]]> = probe.pixels().chunks_exact(w).collect();
        let of_rows: Vec<f64> = rows.iter().enumerate().map(|(j, row)| solid(j) * row.iter().map(bright).sum::<f64>()).collect();
        let mut cumulative = Vec::with_capacity(h + w * h);
        push_cumulative(&mut cumulative, of_rows.iter().copied());
        for row in &rows {
            push_cumulative(&mut cumulative, row.iter().map(bright));
        }
        let chance = |first: usize, i: usize| {
            let below = if i > 0 { cumulative[first + i - 1] } else { 0.0 };
            f64::from(cumulative[first + i]) - f64::from(below)
        };
        let mut weights = Vec::with_capacity(w * h);
        for (j, row) in rows.iter().enumerate() {
            for (i, pixel) in row.iter().enumerate() {
                let chance = chance(0, j) * chance(h + j * w, i);
                let factor = if chance > 0.0 { solid(j) / (4.0 * PI * chance) } else { 0.0 };
                let [r, g, b] = pixel.map(|v| (f64::from(v) * factor) as f32);
                weights.push([r, g, b, 0.0]);
            }
        }
        Self { probe, cumulative, weights }
    }
}

/// Running sums over their total, 1 at the end; even where all is dark.
fn push_cumulative(out: &mut Vec<f32>, values: impl ExactSizeIterator<Item = f64> + Clone) {
    let (total, count) = (values.clone().sum::<f64>(), values.len());
    let mut sum = 0.0;
    for (i, value) in values.enumerate() {
        sum += value;
        let share = if total > 0.0 { sum / total } else { (i + 1) as f64 / count as f64 };
        out.push(if i + 1 == count { 1.0 } else { share.min(1.0) as f32 });
    }
}
